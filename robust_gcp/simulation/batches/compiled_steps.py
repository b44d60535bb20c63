"""Many starts of one mechanism side by side, by steps compiled for it: see `kernel.straight`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...errors import RobustGcpError
from ...kernel.library import Library
from ...kernel.simulation.row_state import RowState
from ...kernel.simulation.rows import MANY, MotionRows
from ...maps.cluster.options import USUAL
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.initial_state import closed_by_kernel, state_given

AT_ONCE = 50_000_000
"""Numbers of outputs that are taken at once: below half a second, so that an interrupt is answered."""


def together(
    mechanism: Mechanism,
    library: Library,
    path: RegularPath,
    starts: Sequence[tuple[int, ArrayLike | None, ArrayLike | None]],
    torque: ArrayLike | None,
    times: Array,
    threads: int,
    pool: ThreadPoolExecutor,
) -> Iterator[tuple[int, Array, Array]]:
    """Number, q and v of each start that stays on regular ground; nothing where no steps are compiled.

    Parameters
    ----------
    mechanism, library, path
        As `MotionRows` takes them.
    starts : sequence of (number, q0, v0)
    torque : array_like (nv,) or None
        Held over all steps.
    times : ndarray (n + 1,)
        s, evenly apart.
    threads, pool : int, ThreadPoolExecutor
        Of so many.
    """
    steps, held = len(times) - 1, HeldTorque(mechanism)
    # compiling pays above `MANY` only, and activations would have to be integrated too
    if len(starts) * steps < MANY or held.stride:
        return
    count = max(threads, min(len(starts), AT_ONCE // (steps * (mechanism.nq + mechanism.nv))))
    state = RowState.room(count, float(times[1] - times[0]), mechanism.nq, mechanism.nv, len(held.value))
    state.held[:] = held.value
    state.held[:, : mechanism.nv] += 0.0 if torque is None else np.asarray(torque, dtype=float)
    rows = MotionRows(library, mechanism, path, held, state, USUAL, USUAL.zone, None, threads)
    if rows.specialise() is not None:
        return
    for first in range(0, len(starts), count):
        given = starts[first : first + count]
        begun = np.array([_begins(rows, k, *start[1:]) for k, start in enumerate(given)])
        state.t0[:], state.at[:] = times[0], 0
        q, v = rows.recorded(np.flatnonzero(begun), steps, pool)
        for k in np.flatnonzero(begun & (state.at[: len(given)] == steps)).tolist():
            yield given[k][0], q[k].copy(), v[k].copy()


def _begins(rows: MotionRows, k: int, q0: ArrayLike | None, v0: ArrayLike | None) -> bool:
    """Whether a row is at a start on regular ground now."""
    mechanism = rows.mechanism
    with suppress(RobustGcpError):
        begun = closed_by_kernel(rows.workspace, mechanism, *state_given(mechanism, q0, v0), rows.zone)
        if begun is not None:
            rows.put(k, rows.begun(begun))
            return True
    return False
