"""A run through phases as a chain of steps and jumps, each with its derivatives: see `links`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...dynamics.change_of_coordinates import Slope
from ...dynamics.equations import Evaluation, called_torque
from ...dynamics.prescribed.constrained_derivatives import HeldDerivatives
from ...dynamics.problem import Problem, initial_value_problem
from ...dynamics.torque_feedback import TorqueSlopes
from ...errors import NotDifferentiableError, OptionError, SingularStartError, ToggleError
from ...kernel.derivatives.derivations import derivation
from ...kernel.derivatives.step_derivatives import Derivation
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..derivatives.accelerations import derivatives
from ..derivatives.kernel_sweep import kernel_of
from ..derivatives.run_again import require_end
from ..derivatives.serving_coordinates import serving
from ..derivatives.step_derivatives import differentiated
from ..derivatives.step_of_motion import Acting
from ..runs.coordinates import in_coordinates
from ..trajectories.trajectory import Trajectory
from .decision import Phase
from .links import Link, Turned
from .rows import Kind
from .saltation import jump_of, without_parts
from .transitions import BREAK, LATCH, Passed, Turn

LONGEST = 512
"""Steps that the kernel takes at once."""

WORSE = 3.0
"""Growth of G, without units, after which other coordinates are looked for."""

ROUNDING = 1e-12
"""rad/s or m/s."""

LATER = 1e-4
"""s: step of differences of torques by time."""

At = tuple[float, Array, Array]
"""t, q, v."""


class Chain:
    """The steps and jumps of a run.

    Parameters
    ----------
    run : Trajectory
    torque_slopes : callable, optional
        Of the user's torque function.
    mode : array_like, optional

    Attributes
    ----------
    start : Slope
        In the run's own coordinates.
    undefined : ndarray of bool (2m,)
        Changes (η, u) of the start that what is held there does not allow.

    Raises
    ------
    OptionError
        Where the run does not remember its phases.
    """

    def __init__(self, run: Trajectory, torque_slopes: TorqueSlopes | None, mode: Any) -> None:
        if not isinstance(run.passed, Passed):
            raise OptionError(
                "derivatives: a file or a pickle holds no phases of a run with joints=; simulate it again"
            )
        if run.passed.machines.rows.drive is not None:
            raise OptionError(
                "derivatives: none are known of runs with joints= and drive=; leave one of them out"
            )
        _require_followed(run, run.passed)
        self._run, self._mode, self._slopes = run, mode, torque_slopes
        self._machines, self._turns = run.passed.machines, run.passed.turns
        self._mechanism, self._rows = without_parts(run.mechanism), run.passed.machines.rows
        self._kernels: dict[Mechanism, Derivation | None] = {}
        first = self._turns[0]
        if np.abs(first.after - first.before).max(initial=0.0) > 1e-9:
            raise NotDifferentiableError(
                "derivatives: the run begins with an impact, on one side of which alone it is a motion; "
                "start before it"
            )
        self.start = _slope(self._mechanism, first.q, first.before, mode)
        self.undefined = self._undefined(first.phase)

    def links(self) -> Iterator[Link | Turned]:
        """From the start to the end."""
        turns = self._turns
        for k, turn in enumerate(turns):
            until = turns[k + 1] if k + 1 < len(turns) else None
            if k:  # of several at one time the first has the output before them, the last that after them
                first, last = turns[k - 1].t < turn.t, until is None or turn.t < until.t
                yield self._turned(turns[k - 1].phase, turn, first, last)
            yield from self._steps(turn, until)

    def _steps(self, turn: Turn, until: Turn | None) -> Iterator[Link]:
        """Steps between two turns, or to the end of the run."""
        run = self._run
        stop = np.inf if until is None else np.nextafter(until.t, -np.inf)
        inside = range(*(int(np.searchsorted(run.t, t)) for t in (turn.t, stop)))
        outputs: list[int | None] = [*inside]
        nodes: list[At] = [(float(run.t[i]), run.q[i], run.v[i]) for i in inside]
        if not inside or run.t[inside[0]] > turn.t:
            outputs.insert(0, max(0, int(np.searchsorted(run.t, turn.t, side="right")) - 1))
            nodes.insert(0, (turn.t, turn.q, _unless_rounding(turn.after)))
        if until is not None and until.t > nodes[-1][0]:
            outputs.append(None)
            nodes.append((until.t, until.q, until.before))
        k = 0
        while k + 1 < len(nodes):
            own = self._serving(*nodes[k][1:])
            found = self._compiled(own, turn.phase, nodes[k : k + LONGEST + 1])
            for moved in found or [self._moved(own, turn.phase, nodes[k], nodes[k + 1])]:
                first = outputs[k]
                assert first is not None  # a turn is the last of the nodes
                yield Link(first, outputs[k + 1], own.iv_independent, *moved)
                k += 1

    def _serving(self, q: Array, v: Array) -> Mechanism:
        """The mechanism in coordinates that serve at a state."""
        mechanism = self._mechanism
        if not mechanism.nc:
            return mechanism
        try:
            found = serving(mechanism, initial_value_problem(mechanism, q, _unless_rounding(v)).start.point)
        except ToggleError as error:
            found = in_coordinates(mechanism, error.choices[0]) if error.choices else None
        except SingularStartError:  # at rest there
            found = None
        return mechanism if found is None else found

    def _compiled(self, own: Mechanism, phase: Phase, nodes: list[At]) -> list[tuple[Array, Array, Slope]]:
        """A, B and ends of the first steps, as many as the kernel takes, where nothing is held."""
        acting, found = self._acting(phase, own), list[tuple[Array, Array, Slope]]()
        torque, function = acting.torque, acting.function
        kernel = None if phase.basis else self._kernel(own, nodes[0][1], function is not None)
        if kernel is None:
            return found
        t, q, v = (np.array(part) for part in zip(*nodes, strict=True))
        held = None if torque is None or function is not None else np.asarray(torque, dtype=float)
        tau = None if held is None else np.tile(held, (len(t) - 1, 1))
        taken = kernel.take(t, q, v, tau, function=function, staged=function is not None)
        good, G, dv_dy = taken.good, taken.G, taken.dv_dy
        without_units = G[good] / own.units[:, None] * own.units[own.iv_independent]
        size = np.full(len(t), np.inf)
        size[good] = np.linalg.norm(without_units, axis=(1, 2))
        bad = np.flatnonzero(~(good & (size <= WORSE * size[0])))
        steps = max(0, int(bad[0]) - 1) if len(bad) else len(t) - 1
        if function is not None and taken.stages is not None and steps:
            kernel.follow(function, acting.slopes, taken.stages.of(0, steps))
        for k in range(steps):
            A, B, *_ = kernel.pull(k, k + 1, np.eye(2 * kernel.m))
            found.append((A, B[0], Slope(G[k + 1].copy(), dv_dy[k + 1].copy())))
        return found

    def _kernel(self, own: Mechanism, q: Array, calls: bool) -> Derivation | None:
        """The compiled derivatives; the chain's own beside a function, which may ask for derivatives too."""
        if not calls:
            return derivation(own, q)
        if own not in self._kernels:
            self._kernels[own] = kernel_of(own, self._run)
        return self._kernels[own]

    def _moved(self, own: Mechanism, phase: Phase, begin: At, end: At) -> tuple[Array, Array, Slope]:
        """A, B and the end of a step in a phase."""
        m, (t, q, v) = own.m, begin
        if len(phase.basis) >= m:  # nothing moves
            A = np.zeros((2 * m, 2 * m))
            A[:m, :m] = np.eye(m)  # of velocities nothing is left
            return A, np.zeros((2 * m, own.nv)), _slope(own, q, v)
        refined = any(since < end[0] and till > t for since, till in self._run.stats.refined)
        mode = self._mode if t == float(self._run.t[0]) else None
        moved = differentiated(own, (q, v), mode, self._acting(phase, own), t, end[0] - t, refined, end[1:])
        require_end(own, end, (moved.q, moved.v), "take smaller steps")
        return moved.A, moved.B, moved.last

    def _acting(self, phase: Phase, own: Mechanism) -> Acting:
        """What acts in a phase, with what it holds, in some coordinates."""
        torque = self._machines.torque_of(phase, own)
        held = self._rows.E[phase.basis] if phase.basis else None
        slopes = None if phase.touching else self._slopes  # a spring's own are not in them
        return Acting(torque, called_torque(own, torque), slopes, held=held)

    def _turned(self, before: Phase, turn: Turn, is_first: bool, is_last: bool) -> Turned:
        run, own = self._run, self._serving(turn.q, turn.before)
        for happening in run.happenings:
            if happening.kind == "grazing" and happening.time == turn.t:
                raise NotDifferentiableError(
                    f"at t = {turn.t:.6g} s the stop of {', '.join(happening.joints)} is met beside a dead "
                    "point of its joint: what follows depends on the start without bound; move the stop aside"
                )
        a, by_time = np.zeros((2, own.nv)), np.zeros(2 * own.nv)
        if turn.why >= 0:
            for k, (phase, v) in enumerate(((before, turn.before), (turn.phase, turn.after))):
                motion, now, acting = self._evaluated(own, phase, turn, v)
                a[k] = acting.slopes_of(motion).stage(turn.t, now)[0].a
        elif turn.why == BREAK:
            a[:], by_time[:] = self._broken(own, before, turn)
        slope = _slope(own, turn.q, turn.before)
        jump = jump_of(self._rows, own, turn, before.held, slope, (a[0], a[1]), by_time)
        ahead, then = (int(np.searchsorted(run.t, t)) for t in (np.nextafter(turn.t, -np.inf), turn.t))
        is_last &= then < len(run.t) and bool(run.t[then] == turn.t)
        return Turned(jump, ahead if is_first and ahead < then else None, then if is_last else None)

    def _evaluated(
        self, own: Mechanism, phase: Phase, turn: Turn, v: Array
    ) -> tuple[Problem, Evaluation, Acting]:
        """A phase's motion at a turn, where what it holds has no forces yet."""
        acting = self._acting(phase, own)
        motion = initial_value_problem(own, turn.q, _unless_rounding(v), None, acting.torque)
        return motion, motion.equations.at_point(turn.t, motion.start.point), acting

    def _broken(self, own: Mechanism, phase: Phase, turn: Turn) -> tuple[Array, Array]:
        """a, and how the time changes at which a force becomes too large for what it holds, or pulls.

        Rows that share their load as they can have no force of their own: 0, which leaves Ξ = I as it is.
        """
        motion, now, acting = self._evaluated(own, phase, turn, turn.before)
        slopes, by_time = acting.slopes_of(motion), np.zeros(2 * own.nv)
        held = slopes.stage(turn.t, now)[0]
        if len(phase.held) > len(phase.basis) or not isinstance(slopes, HeldDerivatives):
            return held.a, by_time
        f, by_f = slopes.forces(turn.t, now)
        bounds = self._rows.bounds[phase.basis]
        pushes = np.array([self._rows.rows[i].kind is Kind.STOP for i in phase.basis])
        margin = np.where(np.isfinite(bounds), 1.0 - np.abs(f) / bounds, np.where(pushes, np.abs(f), np.inf))
        by, m = by_f[int(np.argmin(margin))], own.m
        rate = float(by[: 2 * m] @ np.concatenate([now.point.ydot, held.ydd]))
        rate += float(by[2 * m :] @ self._torque_rate(acting, turn))
        if rate != 0.0:
            places = np.append(own.iv_independent, own.nv + own.iv_independent)
            by_time[places] = -by[: 2 * m] / rate
        return held.a, by_time

    def _torque_rate(self, acting: Acting, turn: Turn) -> Array:
        """∂τ/∂t at a state, by differences of order 4."""
        if acting.function is None:
            return np.zeros(self._mechanism.nv)
        h, function = LATER, acting.function
        one, back, two, far = (function(turn.t + s * h, turn.q, turn.before) for s in (1, -1, 2, -2))
        return np.asarray((8.0 * (one - back) - two + far) / (12.0 * h))

    def _undefined(self, phase: Phase) -> Array:
        """Which changes of the start move what is held there, or push a resting stop."""
        every, nv = self.start.whole, self._mechanism.nv
        found = np.zeros(every.shape[1], dtype=bool)
        for i in phase.held:
            E = self._rows.E[i]
            found |= np.abs(E @ every[nv:]) > 1e-9
            if self._rows.rows[i].kind is Kind.STOP:
                found |= np.abs(E @ every[:nv]) > 1e-9
        return found


def _unless_rounding(v: Array) -> Array:
    """Zero in place of what rounding leaves of v at rest, which opens loops relative to its size."""
    return v if np.abs(v).max(initial=0.0) > ROUNDING else np.zeros_like(v)


def _slope(mechanism: Mechanism, q: Array, v: Array, mode: Any = None) -> Slope:
    """How v depends on position and velocity at a state, nothing held."""
    found = derivatives(mechanism, q, _unless_rounding(v), mode=mode)
    return Slope(found.G, found.dv_dy)


def _require_followed(run: Trajectory, passed: Passed) -> None:
    """Refuse held torques, outputs that are no ends of steps, locks that events close, and cusps."""
    machines = passed.machines
    if any(happening.kind == "cusp" for happening in run.happenings):
        raise NotDifferentiableError("derivatives: they do not follow a turn at a cusp; simulate up to it")
    if machines.held is not None:
        raise OptionError(
            "derivatives: torques or controls were held over steps (hold=True), which they do not follow "
            "through stops, friction and locks; simulate without hold"
        )
    if machines.bounds.vary:
        names = {row.part.joint: None for row in machines.rows.rows if row.coefficient}
        raise NotDifferentiableError(
            f"derivatives: JointFriction(coefficient=) of {', '.join(names)}: how a share of reactions "
            "changes with the state they do not follow; give its bound"
        )
    if run.stats.step is None or np.diff(run.t).max(initial=0.0) > run.stats.step * (1.0 + 1e-6):
        raise OptionError("derivatives: outputs= left out ends of steps; simulate without it")
    if any(turn.why == LATCH for turn in passed.turns):
        raise NotDifferentiableError(
            "derivatives: an event closed a lock (Lock(when=)), whose time they do not follow; name its start"
        )
