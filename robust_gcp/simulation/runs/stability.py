"""A warning where a run of RK4 starts with a step outside its stability region, or a step inside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque, TorqueFunction, is_asked
from ...dynamics.linearise import Linearisation, limiting_eigenvalue, slopes_at, stable_step
from ...dynamics.problem import Problem
from ...dynamics.reduced_inertia import ReducedInertia
from ...errors import RobustGcpError
from ...kernel.simulation.steps import NativeSteps
from ...maps.choice import MapChoice
from ...maps.cluster.options import BridgeOptions
from ...maps.start import Start
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn

MANY = 12
"""Coordinates beyond which only a few directions are looked at: the check then costs as many right-hand
sides as some four steps, where a linearisation would take 2m + 1 and its eigenvalues m³."""

ENOUGH = 200
"""Calls of a torque function that are listened to: 50 steps tell of 49 coordinates."""

FITS = 1e-2
"""Relative residual up to which a torque function is taken for linear over the first steps."""

SEEN = 1e-9
"""Relative singular value below which the first steps did not show how a torque answers to a direction."""

ROUNDING = 1e-12
"""Real parts of eigenvalues below it, relative, are told as 0."""

INSIDE = 0.5
"""Share of the largest stable step that a step in parts takes at most: the motion may become faster."""

MOST_PARTS = 64
"""Parts of a step beyond which an implicit stepper costs less."""


NEAREST = 2.5
"""Less than the distance of the region's boundary from 0 in the left half-plane, which is 2.616."""

Call = tuple[float, Array, Array, Array]
"""t, q, v and τ."""


class StabilityWarning(RuntimeWarning):
    """A run starts with a step outside the stability region of RK4, or would if a step had been named."""


class StabilityCheck:
    """Linearises the equations of motion at the start, beside the run, whose map and counters it spares.

    A torque function is called for nothing but the run itself, since it may be a controller with a memory.
    How it answers to the state is read off these calls: the second and the third stage of a step ask for it
    at one time and in two states, and so do the fourth and the next step's first.

    Nothing is said at or beside a singular configuration, where the check would have to build a bridge of
    its own, or where the linearisation fails: the run itself will tell why.

    Parameters
    ----------
    mechanism : Mechanism
    torque : callable, array_like or None
    step : float
        s.
    options : BridgeOptions
        Of the run.

    Attributes
    ----------
    torque : callable, array_like or None
        What the run is to apply: the torque, listened to where it is a function.
    """

    def __init__(
        self, mechanism: Mechanism, torque: Torque | ArrayLike | None, step: float, options: BridgeOptions
    ) -> None:
        self._step, self._options = step, options
        self._listener = _Listener(torque, mechanism.nv) if is_asked(torque) else None
        self.torque = self._listener or torque

    def before(self, motion: Problem, native: NativeSteps | None = None) -> None:
        """Warn before a run that begins with this motion, where no torque function has to be known.

        Parameters
        ----------
        native : NativeSteps, optional
            The run's, by which ẋ may be asked without harm to it.
        """
        if self._listener is None:
            self._warn(self._too_fast(motion, partial(self._limiting, native)))

    def after(self, motion: Problem) -> None:
        """Warn after it where one had to."""
        if self._listener is not None and self._listener.heard:
            self._warn(self._too_fast(motion, self._limiting_with_torque))

    def parts(self, motion: Problem, native: NativeSteps | None = None) -> int:
        """Into how many parts a step that nobody named is cut before a run, 1 where it is stable; it is told.

        More than `MOST_PARTS` ask for an implicit stepper. Parameters are those of `before`.
        """
        value = None if self._listener else self._too_fast(motion, partial(self._limiting, native))
        if value is None:
            return 1
        # a power of two: ends of the usual steps are ends of parts to the last bit, as of thirds they are not
        parts = 1 << max(1, math.ceil(math.log2(self._step / (INSIDE * stable_step(value)))))
        taken = (
            f"steps of {self._step / parts:.4g} s are taken, and rows recorded as before"
            if parts <= MOST_PARTS
            else 'stepper="Radau" is taken'
        )
        warn(
            f"no step was named, and the usual {self._step:g} s {self._outside(value)}; {taken}: name a step "
            "or a stepper for another choice",
            StabilityWarning,
        )
        return parts

    def _too_fast(self, motion: Problem, limiting: Callable[[Problem], complex | None]) -> complex | None:
        """The eigenvalue at the start, under a constant torque, that allows no such step; else None."""
        start = motion.start
        if start.trackers or start.point.conditioning < self._options.zone:
            return None
        try:
            value = limiting(motion)
        except (RobustGcpError, OverflowError):
            return None
        return None if value is None or self._step <= stable_step(value) else value

    def _warn(self, value: complex | None) -> None:
        if value is not None:
            warn(
                f"step = {self._step:g} s {self._outside(value)}; take a smaller step, or an implicit "
                'stepper such as stepper="Radau"',
                StabilityWarning,
            )

    def _outside(self, value: complex) -> str:
        real = value.real if abs(value.real) > ROUNDING * abs(value) else 0.0
        shown = f"{real:.4g}" + (f" ± {abs(value.imag):.4g}i" if value.imag else "")
        return (
            "lies outside the stability region of rk4: the fastest motion at the start has the eigenvalue "
            f"{shown} 1/s, which allows steps up to {stable_step(value):.4g} s"
        )

    def _beside(self, start: Start, torque: Torque | ArrayLike | None) -> Problem:
        """The same start with a path of its own, so that nothing of the run is counted or moved."""
        choice = MapChoice(options=self._options, error_controlled=True)
        return Problem(start.afresh(), torque, choice)

    def _limiting(self, native: NativeSteps | None, motion: Problem) -> complex | None:
        first = motion.first  # where the kernel has evaluated the start
        rates = None if native is None or first is None else native.rates(motion, first, motion.x, None)
        if rates is None:  # the kernel goes back to the start by itself; a map in Python has to be another
            motion = self._beside(motion.start, self.torque)
        if motion.mechanism.m > MANY:
            return limiting_eigenvalue(motion, self._step, rate=rates)
        # not central: an error of √ε decides nothing here, and half of the right-hand sides are saved
        A = slopes_at(motion, 0.0, central=False) if rates is None else rates.slopes()
        if A is None:
            return None
        # no eigenvalue is larger than the rows' sums, of A in y and h ẏ, times h: most starts need no more
        largest = float(np.abs(A * _weights(motion.mechanism.m, self._step)).sum(axis=1).max())
        return Linearisation.of(A).limiting if NEAREST <= largest < np.inf else None

    def _limiting_with_torque(self, motion: Problem) -> complex | None:
        """Of A with (Gᵀ M G)⁻¹ Gᵀ ∂τ/∂(y, ẏ) of the torque function below; None where that is not known."""
        assert self._listener is not None  # there is such a function
        answer = _answer(motion.mechanism, self._listener.heard, self._step)
        if answer is None:
            return None
        motion = self._beside(motion.start, self._listener.heard[0][3])
        m, point = motion.mechanism.m, motion.start.point
        inertia, forces = ReducedInertia(motion.mechanism), point.G.T @ answer

        def push(change: Array) -> Array:
            return inertia.solve(point.q, point.G, forces @ change)

        if m > MANY:
            return limiting_eigenvalue(motion, self._step, push)
        A = slopes_at(motion, 0.0, central=False)
        A[m:] += np.array([push(change) for change in np.eye(2 * m)]).T
        return Linearisation.of(A).limiting


@lru_cache
def _weights(m: int, h: float) -> Array:
    """What makes slopes of (ẏ, ÿ) by (y, ẏ) those of h (ẏ, h ÿ) by (y, h ẏ), (2m, 2m)."""
    powers = np.array([[h, 1.0], [h * h, h]])
    return np.kron(powers, np.ones((m, m)))


class _Listener(TorqueFunction):
    """A torque function whose first calls are noted."""

    def __init__(self, supplied: Torque, nv: int) -> None:
        super().__init__(supplied, nv)
        self.heard: list[Call] = []

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        tau = super().__call__(t, q, v)
        if len(self.heard) < ENOUGH:
            self.heard.append((t, q.copy(), v.copy(), tau))
        return tau


def _answer(mechanism: Mechanism, heard: Sequence[Call], step: float) -> Array | None:
    """∂τ/∂(y, ẏ), (nv, 2m), by least squares and of least norm; None where no linear law fits."""
    iv = mechanism.iv_independent
    moved, changed = [], []
    for (t0, q0, v0, tau0), (t1, q1, v1, tau1) in pairwise(heard):
        if t0 == t1:  # stages at one time: how τ answers to the state, whatever it does with time
            moved.append(np.concatenate([_apart(mechanism, q0, q1), (v1[iv] - v0[iv]) * step]))
            changed.append(tau1 - tau0)
    if not np.any(changed):  # a function of time alone
        return np.zeros((mechanism.nv, 2 * mechanism.m))
    S, D = np.array(moved), np.array(changed)
    with np.errstate(all="ignore"):
        # the second and third stage are h² apart, the fourth and the next first h³: each tells as much
        size = np.linalg.norm(S, axis=1, keepdims=True)
        S, D = S / size, D / size
        if not (np.all(np.isfinite(S)) and np.all(np.isfinite(D))):
            return None
        law = np.linalg.lstsq(S, D, rcond=SEEN)[0]
        if not np.linalg.norm(S @ law - D) <= FITS * np.linalg.norm(D):
            return None
    law[mechanism.m :] *= step  # it was found by h ẏ, commensurate with y
    return np.asarray(law.T)


def _apart(mechanism: Mechanism, q0: Array, q1: Array) -> Array:
    """From y at q0 to that at q1, (m,); on groups the constant velocity that leads there in one second."""
    if len(mechanism.numbers) < mechanism.m:
        return np.asarray(mechanism.tree.difference(q0, q1)[mechanism.iv_independent])
    iq = mechanism.iq_independent
    return np.asarray(q1[iq] - q0[iq])
