"""What a motion costs: a term at its end and one along it, with their slopes; and what it changes by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_callable, is_table, real_array, shown
from ...dynamics.prescribed.motion import Motion
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .cost_terms import Slopes, Term
from .drive_derivatives import DriveSlopes


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
        term = Term("terminal", self.terminal, self.terminal_slopes)
        return term.at(mechanism, 0.0, q, v, mechanism.tree.zero)

    @property
    def running_term(self) -> Term:
        """The running term."""
        return Term("running", self.running, self.running_slopes)


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


def checked_torques(mechanism: Mechanism, torque: ArrayLike | None, steps: int) -> Array:
    """Torques held over each step, (steps, nv), from one for all or one for each."""
    if torque is None:
        return np.zeros((steps, mechanism.nv))
    if is_table(torque):
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
