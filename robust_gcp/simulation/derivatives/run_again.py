"""Steps of RK4 that are taken again for derivatives: under which torques, and in which coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import is_table
from ...dynamics.equations import CheckedTorque
from ...dynamics.loads import one_torque
from ...dynamics.prescribed.control import Actuated
from ...errors import OptionError
from ...maps.start_check import by_number, checked_mode
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.acted import Acted
from ..trajectories.trajectory import Trajectory
from .cost import checked_torques

SAME_TIME = 1e-12
"""s: times so near to each other are the same."""

SAME = 1e-7
"""How far a step that is taken again may end from the recorded state: rad or lengths, and relative for v."""

SAME_WITHIN = 1e-4  # a kite at 10 ms errs by more than 1e-7 there
"""The same of the end within a step at which an event ended the run, which is on the step's polynomial."""

ALIKE = 1e-6
"""Relative difference of torques and of lengths of steps that rounding may make."""


@dataclass(frozen=True)
class Applied:
    """The torques of a run that is taken again.

    Attributes
    ----------
    function : callable (t, q, v) -> (nv,) or None
        Of the state, within the steps or, where there is a table too, at the beginning of each.
    table : ndarray (N, nv) or None
        Held over the steps; there is one where there is no function.
    """

    function: Any
    table: Array | None


def applied_again(run: Trajectory, torque: Any, steps: int) -> Applied:
    """The torques to take a run of so many steps again with: those given, else those remembered.

    Raises
    ------
    OptionError
        For a run that was driven, whose function is lost, whose wrenches do not go with a table, or whose
        actuators had power under controls that were held.
    """
    mechanism, acted = run.mechanism, Acted() if run.acted is None else run.acted
    if run.u is not None and not isinstance(acted.torque, Actuated) and not acted.lost:
        raise OptionError(
            "gradient: actuators had power under controls that were held over steps, whose gradient is not "
            "known here; simulate with ctrl= as numbers, tables or functions, without hold"
        )
    if set(acted.drive) - set(acted.motions):
        raise OptionError(
            f"gradient: {', '.join(acted.drive)} moved as prescribed (drive=), and the run's file or pickle "
            "does not hold how; simulate again"
        )
    if torque is None and acted.lost:
        raise OptionError(
            "gradient: a torque function or wrenches acted on this run, and its file or pickle holds none; "
            "give all that acted as torque=, a function (t, q, v)"
        )
    in_rows = is_table(torque)
    if in_rows and acted.wrenches:
        raise OptionError(
            "gradient: wrenches= acted on this run, which a table of torques leaves out; leave torque= out, "
            "as the trajectory remembers all, or give a function (t, q, v), to which they are added"
        )
    total = acted.torque
    if torque is not None and not in_rows:
        total = one_torque(mechanism, torque, acted.wrenches)
    if callable(total) and not in_rows:
        return Applied(total, None if acted.held is None else checked_torques(mechanism, acted.held, steps))
    table: Any = torque if in_rows else total
    if torque is None and acted.held is not None:
        table = acted.held
    return Applied(None, checked_torques(mechanism, table, steps))


def require_steps(run: Trajectory, mode: ArrayLike | None, call: str) -> ArrayLike | None:
    """Refuse a run that is not one of RK4 with an output at each step, and a mode that is none; the mode."""
    stats = run.stats
    if stats.stepper != "rk4":
        raise OptionError(
            f"{call}: the run was made by stepper={stats.stepper!r}, and steps of RK4 alone are taken "
            'again; make it with stepper="rk4" and a step'
        )
    if len(run.t) < 2:
        raise OptionError(
            f"{call}: the trajectory holds {len(run.t)} states, and so no step to take again; make it "
            'without outputs=, and a Simulation with keep="all"'
        )
    longest = float(np.diff(run.t).max())
    if stats.step is not None and longest > stats.step * (1.0 + ALIKE):
        raise OptionError(
            f"{call}: outputs of the run are up to {longest:.6g} s apart, its steps {stats.step:.6g} s; "
            f"make it with step={stats.step:.6g} and without outputs=, so that each step has one"
        )
    mode = by_number(run.mechanism, run.q[0], mode)
    if mode is not None:
        checked_mode(run.mechanism, mode)
    return mode


def require_answers(run: Trajectory, function: CheckedTorque, table: Array) -> None:
    """Refuse a function that does not give, at the beginning of each step, what was held over it."""
    for t, q, v, held in zip(run.t, run.q, run.v, table, strict=False):  # at the last output no step begins
        given = function(float(t), q, v)
        if np.abs(given - held).max() > ALIKE * (1.0 + np.abs(held).max()):
            raise OptionError(
                f"gradient: at t = {t:.6g} s torque(t, q, v) gives {given}, and {held} was held over the "
                "step; give a function of (t, q, v) alone, without a memory, or, for a gradient without "
                "feedback, what was held: torque=trajectory.acted.held"
            )


def require_same(run: Trajectory, mechanism: Mechanism, i: int, q: Array, v: Array) -> None:
    """Refuse a step to output i that ends at q and v instead of there."""
    end, remedy = (float(run.t[i]), run.q[i], run.v[i]), _remedy(run, i)
    if run.ended_by is None or i < len(run.t) - 1:
        return require_end(mechanism, end, (q, v), remedy)
    remedy = f"an event ended the run within a step: take smaller steps, or {remedy}"
    return require_end(mechanism, end, (q, v), remedy, SAME_WITHIN)


def require_end(
    mechanism: Mechanism,
    wanted: tuple[float, Array, Array],
    found: tuple[Array, Array],
    remedy: str,
    same: float = SAME,
) -> None:
    """Refuse a step that ends at (q, v) instead of at (t, q, v)."""
    t, q, v = wanted
    off = np.abs(mechanism.tree.difference(q, found[0])) / mechanism.units
    fast = np.abs(found[1] - v) / mechanism.units / (1.0 + np.abs(v).max(initial=0.0))
    # not >=, which lets NaN pass
    if not max(off.max(initial=0.0), fast.max(initial=0.0)) < same:
        raise OptionError(
            f"gradient: taken again, the step of RK4 to t = {t:.6g} s ends {off.max():.1e} rad or "
            f"lengths and {fast.max():.1e} in v from the trajectory; {remedy}"
        )


def _remedy(run: Trajectory, i: int) -> str:
    """What may be the matter with the step to output i."""
    if any(begun < run.t[i] and end > run.t[i - 1] for begun, end in run.stats.refined):
        return "there steps were taken with error control (stats.refined); take smaller steps"
    known = "leave torque= out, as the trajectory remembers it, or " if run.acted is not None else ""
    return f"{known}give the torque of the run, and its mode"


def coordinates_of(run: Trajectory) -> list[tuple[int, Mechanism]]:
    """From which output on a run has which independent joints."""
    found = [(0, run.mechanism)]
    for t, names in run.stats.repartitions:
        at = int(np.argmin(np.abs(run.t - t)))
        # coordinates that were changed again at the same output took no step
        found = [part for part in found if part[0] < at] + [(at, run.mechanism.with_independent(names))]
    return found


def refined_until(run: Trajectory, end: int) -> int:
    """The last output until `end` that a step with error control led to; 0 where there is none.

    Raises
    ------
    OptionError
        Where there is one in a run with driven joints.
    """
    times = run.t[: end + 1]
    stretches = [stretch for stretch in run.stats.refined if stretch[0] < times[-1] - SAME_TIME]
    ends = (min(int(np.searchsorted(times, stop - SAME_TIME)), end) for _, stop in stretches)
    last = max(ends, default=0)
    if last and run.acted is not None and run.acted.motions:
        raise OptionError(
            f"gradient: the step to t = {times[last]:.6g} s was taken with error control (stats.refined), "
            "and with drive= such steps have no gradient here; take smaller steps"
        )
    return last
