"""What a batch is given: numbers of rows, starts, torques, and where results are to be written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import checked_rows, is_table, shown
from ...dynamics.prescribed.control import Controls, held_controls
from ...errors import OptionError, RobustGcpError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..derivatives.one_step import step_jacobians
from ..derivatives.step_derivatives import differentiated
from ..derivatives.step_of_motion import Acting

Rows = NDArray[np.int64]


def rows_given(rows: ArrayLike | None, count: int) -> Rows:
    """The numbers of rows."""
    if rows is None:
        return np.arange(count)
    given = np.atleast_1d(np.asarray(rows))
    if given.dtype == bool and given.shape == (count,):
        return np.flatnonzero(given)
    whole = given.ndim == 1 and (given.dtype.kind in "iu" or not len(given))
    if not whole or np.any((given < 0) | (given >= count)):
        raise OptionError(
            f"rows = {shown(rows)} must be numbers from 0 to {count - 1}, or {count} times bool"
        )
    found: Rows = given.astype(np.int64)
    return found


def torques_given(mechanism: Mechanism, tau: ArrayLike | Mapping[str, Any] | None, count: int) -> Array:
    """τ of all rows."""
    nv = mechanism.nv
    if tau is None:
        return np.zeros(nv)
    if not isinstance(tau, Mapping) and is_table(tau):
        return checked_rows(tau, count, nv, "tau", "nv")
    given = tau.values() if isinstance(tau, Mapping) else (tau,)
    if any(map(callable, given)):
        raise OptionError(f"tau = {shown(tau)}: a step holds numbers, those of each row: (N, nv)")
    return mechanism.velocity(tau, "tau")


def controls_given(
    mechanism: Mechanism, ctrl: Controls | ArrayLike, before: Array | None, count: int
) -> tuple[Array, Array]:
    """Controls of all rows, (count, n_u), and what the actuators make of them."""
    actuators = mechanism.actuators
    if not isinstance(ctrl, Mapping) and is_table(ctrl):
        given = checked_rows(ctrl, count, len(actuators), "ctrl", "n_u")
    elif before is None or not isinstance(ctrl, Mapping):
        given = np.tile(held_controls(mechanism, ctrl), (count, 1))
    else:
        given = np.stack([held_controls(mechanism, ctrl, row) for row in before])
    ranges = np.array([a.ctrl_range or (-np.inf, np.inf) for a in actuators], dtype=float)
    return given, np.clip(given, ranges[:, 0], ranges[:, 1])


def spread(value: ArrayLike | None, count: int, size: int, what: str) -> Array | None:
    """A row for each, of one or as many."""
    if value is None or isinstance(value, Mapping) or not is_table(value):
        return None if value is None else [value] * count  # type: ignore[return-value]
    return checked_rows(value, count, size, what, "nq" if what == "q0" else "nv")


def require_room(out: Any, q: Array, v: Array) -> None:
    """Refuse what q and v cannot be written to; None is none."""
    if out is None:
        return
    pair: Any = out if isinstance(out, tuple) and len(out) == 2 else (None, None)
    for name, array, values in (("q", pair[0], q), ("v", pair[1], v)):
        sound = isinstance(array, np.ndarray) and array.shape == values.shape and array.dtype.kind == "f"
        if not sound or not array.flags.writeable:
            raise OptionError(
                f"out: {name} must be an array of floats, {values.shape}, that can be written to"
            )


def slopes_of_step(
    mechanism: Mechanism, q: Array, v: Array, tau: Array, step: float, own: Sequence[Mechanism]
) -> tuple[Array, Array]:
    """A and B of a step from each state, as `step_jacobians`; NaN where there are none.

    Those of rows that move in other coordinates, `own`, are taken in these, and told in the mechanism's.
    """
    same = np.array([other is mechanism for other in own], dtype=bool)
    if same.all():
        return _in_the_mechanisms(mechanism, q, v, tau, step)
    n = 2 * mechanism.m
    A, B = np.full((len(q), n, n), np.nan), np.full((len(q), n, mechanism.nv), np.nan)
    A[same], B[same] = _in_the_mechanisms(mechanism, q[same], v[same], tau[same], step)
    for i in np.flatnonzero(~same).tolist():
        with suppress(RobustGcpError, np.linalg.LinAlgError):
            moved = differentiated(own[i], (q[i], v[i]), None, Acting(tau[i]), 0.0, step)
            moved = moved.told_in(mechanism)
            A[i], B[i] = moved.A, moved.B
    return A, B


def _in_the_mechanisms(
    mechanism: Mechanism, q: Array, v: Array, tau: Array, step: float
) -> tuple[Array, Array]:
    try:
        return step_jacobians(mechanism, q, v, tau, step)
    # one row that is refused refuses all: then each is asked by itself
    except RobustGcpError:
        if len(q) > 1:
            rows = [
                _in_the_mechanisms(mechanism, q[i : i + 1], v[i : i + 1], tau[i : i + 1], step)
                for i in range(len(q))
            ]
            return np.concatenate([A for A, _ in rows]), np.concatenate([B for _, B in rows])
    m = mechanism.m
    return np.full((1, 2 * m, 2 * m), np.nan), np.full((1, 2 * m, mechanism.nv), np.nan)
