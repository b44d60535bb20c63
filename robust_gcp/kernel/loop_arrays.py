"""Joints, bodies and rows of φ as the plain arrays that the compiled kernel reads."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..maps.weld_points import moved
from ..mechanism.constraint.closures import closure_frames
from ..mechanism.constraint.couplings import CouplingClosure, Couplings
from ..mechanism.constraint.rows import ROTATION, Row, rows_of
from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.joints import OF_MOMENTS, Joint
from ..mechanism.tree.tree import Array
from ..mechanism.tree.vectors import cross
from .structures import Arrays, Description


class NotNativeError(Exception):
    """The kernel cannot take this mechanism; the message says why."""


def describe_loops(loops: ClosedLoops) -> DescribedLoops:
    """All joints and rows of φ in their own units, without forces; kept with the loops.

    Raises
    ------
    NotNativeError
        For a joint that the kernel does not know.
    """
    made: DescribedLoops = loops.memo.once(
        "description of the loops for the kernel", lambda: in_own_units(loops)
    )
    made.arrays.refresh()
    return made


class DescribedLoops(NamedTuple):
    """The kernel's `Description`, and the rotation by which each joint's frame is turned to its axis."""

    arrays: Arrays
    turns: list[Array]

    @property
    def structure(self) -> Any:
        """What the kernel reads."""
        return self.arrays.structure


def in_own_units(loops: ClosedLoops) -> DescribedLoops:
    """Joints, bodies and all rows of φ, neither scaled."""
    arrays, turns = loops_arrays(loops)
    arrays.reals(row_weight=np.ones(loops.nc), scale=np.ones(loops.nv))
    return DescribedLoops(arrays, turns)


def loops_arrays(loops: ClosedLoops) -> tuple[Arrays, list[Array]]:
    """Joints, bodies and all rows of φ; and the turns of `tree_arrays`."""
    arrays = Arrays(Description(joints=loops.own_model.njoints - 1, nq=loops.nq, nv=loops.nv))
    turns, rows = tree_arrays(loops, arrays), np.arange(loops.nc)
    closure_arrays(loops, loops, rows, turns, arrays)
    coupling_arrays(loops, loops, rows, arrays)
    return arrays, turns


def tree_arrays(mechanism: ClosedLoops, arrays: Arrays) -> list[Array]:
    """Joints and bodies; returns the rotation by which each joint's frame is turned to its axis."""
    model = mechanism.near
    kinds, placements, inertias = [], [], []
    turns: list[Array] = [np.eye(3)]
    for joint in mechanism.joints:
        if not joint.in_kernel:
            raise NotNativeError(f"joint {joint.name!r} is of type {joint.type}")
        j, turn = joint.index, turn_to_axis(joint)
        before = turns[model.parents[j]]
        place, body = model.jointPlacements[j], model.inertias[j]
        kinds.append(joint.kind)
        turns.append(turn)
        rotation = before.T @ place.rotation @ turn  # so that every axis is z in the kernel
        placements.append(np.concatenate([rotation.ravel(), before.T @ place.translation]))
        about = turn.T @ body.inertia @ turn
        inertias.append(
            np.concatenate([[body.mass], turn.T @ body.lever, about[tuple(zip(*OF_MOMENTS, strict=True))]])
        )
    arrays.integers(parent=list(model.parents)[1:], kind=kinds)
    arrays.reals(placement=placements, inertia=inertias, armature=model.armature)
    arrays.reals(gravity=model.gravity.linear, ground=mechanism.standpoint)
    return turns


def turn_to_axis(joint: Joint) -> Array:
    """The rotation by which a joint's frame is turned so that its z is the axis, (3, 3)."""
    return np.eye(3) if joint.axis is None else _with_z_along(joint.axis)


def _with_z_along(axis: Array) -> Array:
    """A rotation matrix whose last column is the axis; exact for a coordinate axis."""
    last = int(np.argmax(np.abs(axis)))
    first = cross(np.eye(3)[(last + 2) % 3], axis)  # of e_k this is e_(k+1), a cyclic turn
    first /= np.linalg.norm(first)
    return np.column_stack([first, cross(axis, first), axis])


def closure_arrays(
    mechanism: ClosedLoops,
    chooser: ClosedLoops,
    rows: NDArray[np.int64],
    turns: list[Array],
    arrays: Arrays,
    at: Array | None = None,
) -> None:
    """Cut points, and the rows chosen among those of `chooser`, which has the same closures.

    Position rows are taken at these points of the frames, at their origins where left out.
    """
    closures = mechanism.loops
    frames = closure_frames(mechanism.near, closures)
    if at is not None:
        frames = moved(frames, at)
    joints, points, local = [], [], []
    for ends in zip(frames[: len(closures)], frames[len(closures) :], strict=True):
        joints += [joint for joint, _ in ends]
        points += [turns[joint].T @ place.translation for joint, place in ends]
        local.append([turns[joint].T @ place.rotation for joint, place in ends])
    full = rows_of(closures)
    # a coupling's row has no terms here: `coupling_arrays` fills it
    chosen = [full[row] if row < len(full) else Row(-1, "", ROTATION) for row in chooser.implicit.rows[rows]]
    arrays.structure.closures, arrays.structure.rows = len(closures), len(chosen)
    arrays.integers(
        closure_joint=joints,
        row_closure=[row.closure for row in chosen],
        row_axis=[row.axis for row in chosen],
        row_terms=np.cumsum([0, *(len(row.terms) for row in chosen)]),
    )
    arrays.reals(
        closure_point=points,
        row_weight=1.0 / chooser.row_scale[rows],
        terms=[
            [weight, *(local[row.closure][0] @ u), *(local[row.closure][1] @ n)]
            for row in chosen
            for weight, u, n in row.terms
        ],
    )


def coupling_arrays(
    mechanism: ClosedLoops, chooser: ClosedLoops, chosen: NDArray[np.int64], arrays: Arrays
) -> None:
    """The couplings whose rows were chosen."""
    first = len(rows_of(mechanism.loops))
    rows = {int(full) - first: row for row, full in enumerate(chooser.implicit.rows[chosen]) if full >= first}
    given = mechanism.closures[len(mechanism.loops) :]
    ties = Couplings(mechanism.joints, [c for c in given if isinstance(c, CouplingClosure)])
    order = {coupling: place for place, coupling in enumerate(rows)}
    further = [f for f in ties.further if f[0] in order]
    width = ties.coefficients.shape[1]
    structure = arrays.structure
    structure.couplings, structure.coupling_width, structure.coupling_further = len(rows), width, len(further)
    arrays.integers(
        coupling_at=[
            [row, ties.iq[c, 0], ties.iv[c, 0], ties.iq[c, 1], ties.iv[c, 1]] for c, row in rows.items()
        ],
        further_at=[[order[c], iq, iv] for c, iq, iv, _ in further],
    )
    curve = list(rows)
    # the offsets of moving couplings change between runs
    arrays.following("coupling_curve", lambda: ties.refresh()[curve].reshape(len(curve), width).copy())
    arrays.reals(further_arm=[arm for _, _, _, arm in further])
