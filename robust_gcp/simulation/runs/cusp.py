"""The motion of a linkage of mobility 1 to a cusp of its mode, and back from it.

Both branches are one curve x(p), u = u* ± p². With k = x'/p, regular at the cusp, the velocity is v = k η,
η = p ṗ, and along σ, dt = p dσ,

    dp/dσ = η,    (kᵀ M k) dη/dσ = p kᵀ (τ − C) − kᵀ M k' η²,

which is regular there too: the motion arrives after a finite time with a finite speed, while its
acceleration grows as |t − t*|^(−1/2). Going on needs an impulse along the tangent; every linkage that is
nearly this one has a nose in place of the cusp, which carries the motion round onto the other branch with
the opposite velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.polynomial import chebyshev

from ...errors import CuspError
from ...maps.cluster.interpolation import fitted, nodes
from ...maps.cluster.options import BridgeOptions
from ...maps.cluster.touching.meeting import Meeting
from ...maps.cluster.touching.meeting_builder import round_cusp
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..events import Events
from ..phases.phase_run import Steps

Acting = Callable[[float, Array, Array], tuple[Array, float]]
"""(t, q, v) -> all that acts besides gravity, (nv,), and the power of its part without a potential."""

TOLERANCE = 1e-12
"""Of the steps along σ."""

LONGEST = 1e6
"""σ after which nothing happens."""


@dataclass(frozen=True)
class Part:
    """The motion on one branch: from t0 to t1, and how it ends there.

    Attributes
    ----------
    t0, t1 : float
        s.
    ends : {"cusp", "out", "late"}
        At the cusp, at the arc's end, or at the time until which it was asked for.
    """

    t0: float
    t1: float
    ends: str
    branch: float
    _arc: Arc
    _at: Callable[[float], Array]
    _sigma: float

    @property
    def eta(self) -> float:
        """η at its end."""
        return float(self._at(self._sigma)[2])

    @property
    def last(self) -> tuple[Array, Array]:
        """q and v at its end."""
        _, p, eta, _ = self._at(self._sigma)
        # the event's p is 0 but for rounding, of either sign: the other branch would begin there
        return self._arc.state(0.0 if self.ends == "cusp" else self.branch * p, eta)

    def _where(self, t: float) -> Array:
        """t, p, η and the work at a time."""
        sigma = 0.0 if t <= self.t0 else self._sigma
        if self.t0 < t < self.t1:
            # dt = p dσ, p > 0: t grows with σ; by t itself ṗ is infinite at the cusp
            sigma = float(scipy.optimize.brentq(lambda s: float(self._at(s)[0]) - t, 0.0, sigma, xtol=1e-15))
        return self._at(sigma)

    def state(self, t: float) -> tuple[Array, Array]:
        """q and v at a time of it."""
        _, p, eta, _ = self._where(t)
        return self._arc.state(self.branch * p, eta)

    def steps(self, times: Array) -> Steps:
        """Outputs at increasing times of it."""
        rows = [(t, *self._arc.output(self.branch, self._where(t))) for t in times.tolist()]
        t, q, v, a, tau, work = (np.array(column) for column in zip(*rows, strict=True))
        return Steps(self._arc.mechanism.tree, t, q, v, a, tau, work)

    def ended(self, events: Events, times: Array) -> float | None:
        """Keep the user's events between these times, and tell when one of them ends the run."""
        events.begin(float(times[0]), *self.state(float(times[0])))
        for t0, t1 in pairwise(times.tolist()):
            for zero in events.zeros(*self.state(t1), _Between(self, t0, t1)):
                events.add(zero, *self.state(zero.t))
                if zero.ends:
                    return zero.t
        return None


@dataclass(frozen=True)
class _Between:
    """Two times of a part."""

    part: Part
    t0: float
    t1: float

    def state(self, t: float) -> tuple[Array, Array]:
        return self.part.state(t)


class Arc:
    """Both branches of a cusp, and the motion along them.

    Parameters
    ----------
    mechanism : Mechanism
        Of mobility 1.
    met : Meeting
        The cusp, of one of its clusters.
    acting : callable
    options : BridgeOptions

    Raises
    ------
    NoBridgeError
        Where the branches are not known well enough.
    """

    def __init__(self, mechanism: Mechanism, met: Meeting, acting: Acting, options: BridgeOptions) -> None:
        self.mechanism, self._acting, self._space = mechanism, acting, met.curve.surface.space
        found = round_cusp(met, options)
        self.R, n = found.half, self._space.nv
        s = nodes(len(found.table))  # an even number: none at 0, where x' / p is 0 / 0
        slopes = np.array([found.values_at(self.R * p)[1] for p in s])
        self._x, self._k = found.table[:, :n], fitted(slopes / (self.R * s)[:, None])
        self._turn = chebyshev.chebder(self._k) / self.R
        self.star = self.state(0.0, 0.0)[0]

    def _on(self, series: Array, p: float) -> Array:
        return np.asarray(chebyshev.chebval(p / self.R, series))

    def state(self, p: float, eta: float) -> tuple[Array, Array]:
        """q and v of the mechanism at p of either sign."""
        cluster, x = self._space.cluster, self._on(self._x, p)
        q, v = self.mechanism.home.copy(), np.zeros(self.mechanism.nv)
        q[cluster.iq] = self._space.q(x)
        v[cluster.iv] = self._space.turn(x) @ self._on(self._k, p) * eta
        return q, v

    def along(self, q: Array, v: Array) -> tuple[float, float] | None:
        """p and η of a state; None where it is not on the arc."""
        cluster = self._space.cluster
        x = self._space.x(q[cluster.iq])
        own = np.linalg.solve(self._space.turn(x), v[cluster.iv])
        # both branches are near each other beside the cusp: the nearest of many points is on the right one
        ps = np.linspace(-self.R, self.R, 201)
        p = float(ps[np.argmin([np.abs(self._on(self._x, s) - x).max() for s in ps])])
        for _ in range(30):  # Gauss–Newton
            slope = p * self._on(self._k, p)  # x', which is 0 at the cusp; k, for the speed below, is not
            step = float(slope @ (x - self._on(self._x, p)) / (slope @ slope))
            p = min(max(p + step, -self.R), self.R)
            if abs(step) < 1e-15:
                break
        k = self._on(self._k, p)
        near = float(np.abs(self._on(self._x, p) - x).max()) < ON_ARC
        return (p, float(k @ own / (k @ k))) if near else None

    def output(self, branch: float, state: Array) -> tuple[Array, Array, Array, Array, float]:
        """q, v, a, what acts, and its work; a is not finite at the cusp."""
        t, p, eta, work = state.tolist()
        q, v = self.state(branch * p, eta)
        way, bend, rates = self._ways(branch, state)
        with np.errstate(divide="ignore", invalid="ignore"):  # at p = 0 it is infinite, and told so
            a = (way * rates[2] + bend * eta**2) / np.float64(p)
        return q, v, a, self._acting(t, q, v)[0], work

    def _ways(self, branch: float, state: Array) -> tuple[Array, Array, Array]:
        """k, k', and d(t, p, η, W)/dσ with the work W."""
        t, p, eta, _ = state
        mechanism, space = self.mechanism, self._space
        q, v = self.state(branch * p, eta)
        x, k = self._on(self._x, branch * p), self._on(self._k, branch * p)
        T = space.turn(x)
        way, bend = np.zeros(mechanism.nv), np.zeros(mechanism.nv)
        way[space.cluster.iv] = T @ k
        bend[space.cluster.iv] = T @ (branch * self._on(self._turn, branch * p)) + p * (
            space.turn_rate(x, k) @ k
        )
        tau, power = self._acting(t, q, v)
        force = tau - mechanism.tree.rnea(q, v, mechanism.tree.zero)
        M = mechanism.tree.crba(q)
        rate = (p * float(way @ force) - float(way @ M @ bend) * eta**2) / float(way @ M @ way)
        return way, bend, np.array([p, eta, rate, p * power])

    def part(self, t: float, p: float, eta: float, until: float, branch: float = 0.0) -> Part:
        """The motion from p and η at time t, until it comes to the cusp, to the arc's end, or to a time.

        Parameters
        ----------
        branch : {1, -1}, optional
            Of p = 0, where p has no sign.
        """
        branch = branch or float(np.sign(p))  # p itself is kept positive, so that time runs with σ
        ends = "cusp", "out", "late"

        def event(name: str) -> Callable[[float, Array], float]:
            def zero(_: float, state: Array) -> float:
                return float({"cusp": state[1], "out": self.R - state[1], "late": until - state[0]}[name])

            # falling alone: a motion that begins at the cusp leaves p = 0 upwards
            zero.terminal, zero.direction = True, -1  # type: ignore[attr-defined]
            return zero

        found = scipy.integrate.solve_ivp(
            lambda _, state: self._ways(branch, state)[2], (0.0, LONGEST), [t, abs(p), eta, 0.0], "DOP853",
            rtol=TOLERANCE, atol=1e-14, dense_output=True, events=[event(name) for name in ends],
        )  # fmt: skip
        how = next((name for name, times in zip(ends, found.t_events, strict=True) if len(times)), "late")
        end = until if how == "late" else float(found.y[0, -1])
        return Part(t, end, how, branch, self, found.sol, float(found.t[-1]))


ON_ARC = 1e-8
"""Dimensionless distance within which a state lies on the arc."""


def arrive(error: CuspError, mechanism: Mechanism, acting: Acting, state: tuple[float, Array, Array],
           until: float, options: BridgeOptions) -> None:  # fmt: skip
    """Follow the motion from a state to the cusp that an error tells of, and tell it when and how it arrives.

    Parameters
    ----------
    error : CuspError
        Where it has no arrival afterwards it is not followed there: for mobility above 1, or from beyond
        the arc.
    state : (t, q, v)
    until : float
        s.
    """
    t, q, v = state
    if mechanism.m != 1:
        return
    arc = Arc(mechanism, error.met, acting, options)
    at = arc.along(q, v)
    error.q = arc.star
    if at is None:
        return
    p, eta = at
    error.branches = tuple(arc.state(side * np.sign(p) * 0.5 * arc.R, 0.0)[0] for side in (1.0, -1.0))
    found = arc.part(t, p, eta, until)
    error.arrival = arc, found
    if found.ends == "cusp":
        error.time, error.v = found.t1, found.last[1]
