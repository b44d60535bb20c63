"""What a motion costs: a term at its end and one along it, with their slopes; and what it changes by."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_callable, real_array, shown
from ...dynamics.prescribed.motion import Motion
from ...errors import NonFiniteError, OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .drive_derivatives import DriveSlopes

NUDGE = 1e-3
"""Step of differences of order 4 without units: they err by 1e-13 of smooth costs."""

Slopes = tuple[Array, Array, Array]
"""By q (nv,), along the velocities' components, by v (nv,) and by the torques (nv,)."""


@dataclass(frozen=True)
class Cost:
    """J = terminal(q, v) at the end + ∫ running(t, q, v, tau) dt, by the trapezoidal rule in each step.

    Slopes that are left out are taken by differences.

    Parameters
    ----------
    terminal : callable (q, v) -> float, optional
    running : callable (t, q, v, tau) -> float, optional
        tau (nv,) are the torques that the user applies.
    terminal_slopes : callable (q, v) -> ((nv,), (nv,)), optional
        By q, along the velocities' components (∂/∂q where v = q̇), and by v.
    running_slopes : callable (t, q, v, tau) -> ((nv,), (nv,), (nv,)), optional
        By q, v and tau.
    """

    terminal: Callable[[Array, Array], Any] | None = None
    running: Callable[[float, Array, Array, Array], Any] | None = None
    terminal_slopes: Callable[[Array, Array], Any] | None = None
    running_slopes: Callable[[float, Array, Array, Array], Any] | None = None

    def __post_init__(self) -> None:
        """Refuse what is no cost (`OptionError`)."""
        check_callable("Cost: terminal", self.terminal, "(q, v)")
        check_callable("Cost: running", self.running, "(t, q, v, tau)")
        check_callable("Cost: terminal_slopes", self.terminal_slopes, "(q, v)")
        check_callable("Cost: running_slopes", self.running_slopes, "(t, q, v, tau)")
        if self.terminal is None and self.running is None:
            raise OptionError("Cost: give terminal(q, v), running(t, q, v, tau), or both")

    def at_end(self, mechanism: Mechanism, q: Array, v: Array) -> tuple[float, Slopes]:
        """The terminal term and its slopes."""
        none, terminal = np.zeros(mechanism.nv), self.terminal
        if terminal is None:
            return 0.0, (none, none, none)

        def value(at: Array, w: Array, tau: Array) -> float:
            return number(terminal(at.copy(), w.copy()), "Cost: terminal(q, v)")

        if self.terminal_slopes is not None:
            given = self.terminal_slopes(q.copy(), v.copy())
            by_q, by_v = vectors(given, 2, mechanism.nv, "Cost: terminal_slopes(q, v)")
            return value(q, v, none), (by_q, by_v, none)
        by_q, by_v, _ = _differences(value, mechanism, q, v, none, ("q", "v"))
        return value(q, v, none), (by_q, by_v, none)

    def along(self, mechanism: Mechanism, t: float, q: Array, v: Array, tau: Array) -> tuple[float, Slopes]:
        """The running term and its slopes."""
        none, running = np.zeros(mechanism.nv), self.running
        if running is None:
            return 0.0, (none, none, none)

        def value(at: Array, w: Array, torque: Array) -> float:
            return number(running(t, at.copy(), w.copy(), torque.copy()), "Cost: running(t, q, v, tau)")

        if self.running_slopes is not None:
            given = self.running_slopes(t, q.copy(), v.copy(), tau.copy())
            by_q, by_v, by_tau = vectors(given, 3, mechanism.nv, "Cost: running_slopes(t, q, v, tau)")
            return value(q, v, tau), (by_q, by_v, by_tau)
        return value(q, v, tau), _differences(value, mechanism, q, v, tau, ("q", "v", "tau"))


@dataclass(frozen=True)
class Gradient:
    """A cost and its first derivatives.

    Attributes
    ----------
    value : float
    dy, dv : ndarray (m,)
        By the start: along the velocities G e_j, and by the independent velocities; NaN as in `Sensitivity`.
    dtau : ndarray (N, nv)
        By torques added over each step.
    parameters : dict
        By each of the parameters that were named.
    drive : DriveSlopes or None
        By the motions of driven joints, whose entries of `dy` and `dv` are zero; see `by_drive`.
    """

    value: float
    dy: Array
    dv: Array
    dtau: Array
    parameters: dict[str, float]
    drive: DriveSlopes | None = None

    def by_drive(self, changes: Mapping[str, Motion]) -> float:
        """dJ/dε where joints are driven along p + ε δp; their start follows, y and u of the others are held.

        Parameters
        ----------
        changes : mapping of str to Motion
            δp of driven joints; those that are not named move as they did.

        Raises
        ------
        OptionError
            For a run without driven joints, for other joints, and for what is no motion.
        """
        if self.drive is None:
            raise OptionError("by_drive: no joint of this run was driven; simulate with drive=")
        return self.drive.along(changes)


def _differences(
    f: Callable[[Array, Array, Array], float],
    mechanism: Mechanism,
    q: Array,
    v: Array,
    tau: Array,
    by: tuple[str, ...],
) -> Slopes:
    """Central differences of order 4, (8 (f(h) − f(−h)) − f(2h) + f(−2h)) / 12h."""
    tree, found = mechanism.tree, []
    for what in ("q", "v", "tau"):
        slope = np.zeros(mechanism.nv)
        for i in range(mechanism.nv if what in by else 0):
            base = {"q": mechanism.units[i], "v": max(1.0, abs(v[i])), "tau": max(1.0, abs(tau[i]))}[what]
            h = NUDGE * float(base)
            values = []
            for s in (1, -1, 2, -2):
                move = np.zeros(mechanism.nv)
                move[i] = s * h
                if what == "q":
                    values.append(f(tree.integrate(q, move), v, tau))
                else:
                    values.append(f(q, v + move, tau) if what == "v" else f(q, v, tau + move))
            slope[i] = (8.0 * (values[0] - values[1]) - values[2] + values[3]) / (12.0 * h)
        found.append(slope)
    return found[0], found[1], found[2]


def number(value: Any, label: str) -> float:
    """What a cost returned, or an OptionError."""
    if isinstance(value, float) and math.isfinite(value):  # most are
        return float(value)
    try:
        array = real_array(value)
    except TypeError as error:
        raise OptionError(f"{label} returned {shown(value)}, expected a number") from error
    if array.size != 1:
        raise OptionError(f"{label} returned shape {array.shape}, expected a number")
    if not np.isfinite(array).all():
        raise NonFiniteError(f"{label} returned {shown(value)}")
    return float(array.reshape(()))


def vectors(given: Any, count: int, nv: int, label: str) -> list[Array]:
    """What slopes of a cost returned, (nv,) each, or an OptionError."""
    try:
        vectors: list[Array] = [real_array(part) for part in given]
    except TypeError as error:
        raise OptionError(f"{label} returned {shown(given)}, expected {count} arrays ({nv},)") from error
    if [part.shape for part in vectors] != [(nv,)] * count:
        shapes = ", ".join(str(part.shape) for part in vectors)
        raise OptionError(f"{label} returned shapes {shapes}, expected {count} arrays ({nv},)")
    return vectors


def checked_torques(mechanism: Mechanism, torque: ArrayLike | None, steps: int) -> Array:
    """Torques held over each step, (steps, nv), from one for all or one for each."""
    if torque is None:
        return np.zeros((steps, mechanism.nv))
    if np.ndim(torque) == 2:
        try:
            table = real_array(torque)
        except TypeError as error:
            raise OptionError(f"torque = {shown(torque)} must hold real numbers") from error
        if table.shape != (steps, mechanism.nv) or not np.isfinite(table).all():
            raise OptionError(
                f"torque has shape {table.shape}, expected (steps, nv) = ({steps}, {mechanism.nv}) finite "
                "numbers: one row for each step of the trajectory, or (nv,) for all"
            )
        return table
    return np.tile(mechanism.velocity(torque, "torque"), (steps, 1))


def reduced(slopes: Slopes, G: Array, dv_dy: Array) -> Array:
    """Slopes by q and v as those by the independent positions and velocities, (2m,)."""
    by_q, by_v, _ = slopes
    return np.concatenate([by_q @ G + by_v @ dv_dy, by_v @ G])
