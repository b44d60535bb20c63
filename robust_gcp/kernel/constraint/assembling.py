"""Closing the loops of many guesses, and velocities of many states, in the kernel."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mechanism.constraint.closures import WELDED, Closure, RevoluteClosure, closure_frames
from ...mechanism.constraint.separation import Separation
from ...mechanism.loops import ClosedLoops
from ...mechanism.tolerances import CLOSED, RANK
from ...mechanism.tree.joints import Index
from ...mechanism.tree.tree import Array
from ..library import Library, library
from ..loop_arrays import NotNativeError, describe_loops
from ..structures import Arrays, Assembly, address


def closed(loops: ClosedLoops, guesses: Array, free: Index) -> tuple[Array, NDArray[np.bool_]]:
    """What `assembly.assembled` finds from each guess by moving `free`, and where it is closed and proper.

    Nothing is closed where there is no kernel, or it does not know a joint.

    Parameters
    ----------
    guesses : ndarray (N, nq)

    Returns
    -------
    tuple of ndarray (N, nq), ndarray of bool (N,)
    """
    q = np.array(guesses, dtype=np.float64, order="C")
    prepared = _prepared(loops, free)
    if prepared is None or not len(q):
        return q, np.zeros(len(q), dtype=bool)
    found, description, assembly = prepared
    left, turns = np.empty(len(q)), np.empty((len(q), len(loops.loops), 3, 3))
    found.assemble(description, assembly, len(q), *map(address, (q, left, turns)))
    done = left <= CLOSED
    for c, closure in enumerate(loops.loops):
        if type(closure).is_proper is not Closure.is_proper:
            # rows of φ, by which some kinds are closed, are zero for half a turn too
            done[done] = [closure.is_proper(turn) for turn in turns[done, c]]
    return q, done


def lifted(loops: ClosedLoops, q: Array, v: Array, free: Index) -> NDArray[np.bool_] | None:
    """The velocities `free` of v (N, nv) from the others by K v = 0, in place; None as for `closed`.

    Returns
    -------
    ndarray of bool (N,)
        Where they are determined.
    """
    prepared = _prepared(loops, free)
    if prepared is None:
        return None
    found, description, assembly = prepared
    assert v.flags.c_contiguous  # the kernel writes to it row by row
    status = np.empty(len(q), dtype=np.int32)
    found.lift(description, assembly, len(q), RANK, *map(address, (np.ascontiguousarray(q), v, status)))
    return status != 0


def _prepared(loops: ClosedLoops, free: Index) -> tuple[Library, Any, Any] | None:
    """The kernel, the loops as it reads them, and how they are closed; kept with the loops."""
    found = library()
    if found is None:
        return None
    try:
        description = describe_loops(loops)
    except NotNativeError:
        return None
    key = ("assembly in the kernel", *free.tolist())
    arrays = loops.memo.once(key, lambda: _assembly(loops, free))
    return found, ctypes.byref(description.structure), ctypes.byref(arrays.structure)


def _assembly(loops: ClosedLoops, free: Index) -> Arrays:
    separation, count = Separation(loops), len(loops.loops)
    turns = describe_loops(loops).turns
    local = [turns[joint].T @ place.rotation for joint, place in closure_frames(loops.near, loops.loops)]
    sort, axis = np.zeros((count, 2), dtype=np.int32), np.zeros((count, 3))
    for c, closure in enumerate(loops.loops):
        sort[c, 0] = closure.holds
        if closure.rotation_terms() == WELDED:
            sort[c, 1] = 1
        elif isinstance(closure, RevoluteClosure):
            sort[c, 1], axis[c] = 2, closure.across()[0]
    points, turned = separation.in_points, separation.in_turns
    arrays = Arrays(
        Assembly(free_count=len(free), point_count=len(points), turn_count=len(turned), length=loops.length)
    )
    arrays.integers(free=free, points=points, turns=turned, sort=sort)
    arrays.reals(
        frames=[[*local[c].ravel(), *local[count + c].ravel()] for c in range(count)],
        axis=axis,
        row_scale=loops.row_scale,
        column_scale=loops.column_scale,
        units=loops.units,
    )
    return arrays
