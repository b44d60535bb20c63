"""Forward dynamics and derivatives at a state in coordinates that serve there, told in the mechanism's own.

Where independent joints are close to turning back, K_d gives G only to ε/σ and its derivatives to ε/σ³,
though the motion is smooth: it is described by other joints, as `simulate` does, and transformed.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import require_finite
from ...dynamics.change_of_coordinates import transformed
from ...dynamics.derivatives import Accelerations, Derivatives, PointDerivatives
from ...dynamics.loads import Torques, Wrench, one_torque
from ...dynamics.modes.mode_rates import ZONE
from ...dynamics.modes.taylor_series import Circles, circles_of
from ...dynamics.prescribed.constrained_derivatives import HeldDerivatives
from ...dynamics.problem import Problem, initial_value_problem
from ...dynamics.torque_feedback import TorqueSlopes
from ...errors import ModelError, NonFiniteError, NotCertifiedError, SimulationError
from ...kernel.derivatives.derivations import derivation, left_to_python
from ...maps.explicit import Counters, Point
from ...mechanism.building.variable_geometry import still_rows
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import CLOSED
from ...mechanism.tree.tree import Array
from ..runs.coordinates import Coordinates, in_coordinates

log = logging.getLogger(__name__)

SHARE = 1e-3
"""Of the largest velocity that the slowest of a mechanism's own coordinates has, where these are looked at no
further."""


def serving(mechanism: Mechanism, point: Point) -> Mechanism | None:
    """The mechanism in coordinates that serve at a point; None where its own do.

    Parameters
    ----------
    point : Point
        Of a motion in the mechanism's coordinates.
    """
    # unevenness is a fault of steps; at one state conditioning alone counts
    names = Coordinates(mechanism, mechanism.independent, Counters(), even=False).better(point)
    if names is None:
        return None
    other = in_coordinates(mechanism, names)
    known = those_that_served(mechanism)
    if other not in known:
        known.append(other)
    return other


def those_that_served(mechanism: Mechanism) -> list[Mechanism]:
    """The mechanism in other coordinates, which served where its own did not."""
    known: list[Mechanism] = mechanism.memo.once("other coordinates", list)
    return known


def answered_by_others(
    mechanism: Mechanism, q: Array, v: Array, tau: Array | None, left: NDArray[np.intp]
) -> Iterator[tuple[int, Derivatives, Accelerations]]:
    """Derivatives at those of some states that the kernel has in coordinates that served before, in these.

    Parameters
    ----------
    q, v, tau : ndarray (N, nq), (N, nv), (N, nv) or None
    left : ndarray of int
        Which of the states are asked for.
    """
    for other in those_that_served(mechanism):
        done = []
        for i, found, whole in _by_kernel(other, q, v, tau, left):
            if parametrises(mechanism, found.G):
                done.append(i)
                yield i, found, whole
        left = np.setdiff1d(left, done)


def parametrises(mechanism: Mechanism, G: Array) -> bool:
    """Whether a mechanism's own coordinates, however poor, are some of a motion with this G."""
    own = mechanism.iv_independent
    sizes = np.linalg.svd(G[own] / mechanism.units[own, None], compute_uv=False)
    # below, W = (G[C])⁻¹ would cost more than three digits
    return bool(sizes[-1] > SHARE * np.abs(G / mechanism.units[:, None]).max())


def state_of(motion: Problem, q: ArrayLike | None, v: ArrayLike | None) -> tuple[Array, Array]:
    """The state (q, v) that a motion begins with, as given where it is closed to rounding.

    In poor coordinates what was given is not rounded once more by K_d.
    """
    mechanism, point = motion.mechanism, motion.start.point
    start, fast = point.q, point.G @ point.ydot
    if q is None or v is None or mechanism.nc == 0:
        return start, fast
    at, rate = mechanism.configuration(q), mechanism.velocity(v)
    u, K = rate / mechanism.column_scale, mechanism.scaled(mechanism.K(at))
    left = float(np.abs(K @ u).max()) / max(float(np.abs(u).max()), 1e-300)
    exact = mechanism.closure_residual(at) <= CLOSED and left <= CLOSED * max(1.0, float(np.abs(K).max()))
    return (at, rate) if exact else (start, fast)


def forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: Torques | None,
    mode: ArrayLike | None,
    t: float,
) -> Array:
    """`derivatives.forward_dynamics`, where the kernel does not do it in the mechanism's coordinates."""
    applied = one_torque(mechanism, tau)
    motion = initial_value_problem(mechanism, q, v, mode, applied)
    other = serving(mechanism, motion.start.point)
    if other is not None:
        state = state_of(motion, q, v)
        if mode is None and not callable(applied):
            found = _at_one(other, *state, applied)
            if found is not None:
                return require_finite(found[1].a[mechanism.iv_independent], "u̇")
        motion = initial_value_problem(other, *state, mode, applied)
    left_to_python(mechanism, "accelerations")
    now = motion.equations.at_point(t, motion.start.point)
    a = now.a
    if now.point.conditioning < ZONE:  # K_d gives it to ε/σ² only
        try:
            a = PointDerivatives(motion, known=circles_of(motion.mechanism)).whole(t, now)[1].a
        except (NotCertifiedError, NonFiniteError, ModelError) as missing:
            log.info("%s: forward dynamics by K_d: %s", mechanism.name, missing)
    return require_finite(a[mechanism.iv_independent], "u̇")


def derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: Torques | None,
    mode: ArrayLike | None,
    t: float,
    tau_slopes: TorqueSlopes | None,
    wrenches: Sequence[Wrench],
    known: Circles | None = None,
) -> Derivatives:
    """`derivatives.derivatives` at one state, where the kernel does not do it in the mechanism's coordinates.

    Parameters
    ----------
    known : Circles, optional
        Of other states of the mechanism; those made here are added.
    """
    applied = one_torque(mechanism, tau, wrenches)
    motion = initial_value_problem(mechanism, q, v, mode, applied)
    other = serving(mechanism, motion.start.point)
    if other is None:
        left_to_python(mechanism, "derivatives")
        others, still = (motion, applied, tau_slopes, known), still_rows(mechanism)
        slopes = PointDerivatives(*others) if still is None else HeldDerivatives(still, *others)
        return slopes.at_start(t)
    if mechanism.still:
        raise SimulationError(
            f"{', '.join(mechanism.independent)} do not serve as coordinates beside this place"
        )
    state = state_of(motion, q, v)
    found = None
    if mode is None and tau_slopes is None and not callable(applied):
        found = _at_one(other, *state, applied)
    if found is None:
        left_to_python(mechanism, "derivatives")
        motion = initial_value_problem(other, *state, mode, applied)
        circles = None if known is None else circles_of(other)
        found = PointDerivatives(motion, applied, tau_slopes, circles).whole_at_start(t)
    return transformed(*found, mechanism.iv_independent)


def _by_kernel(
    mechanism: Mechanism, q: Array, v: Array, tau: Array | None, which: NDArray[np.intp]
) -> Iterator[tuple[int, Derivatives, Accelerations]]:
    """The kernel's at some of many states, with the accelerations of all joints, where it has them."""
    kernel = derivation(mechanism, q[which[0]]) if len(which) else None
    if kernel is None:
        return
    found = kernel.slopes(q[which], v[which], None if tau is None else tau[which], whole=True)
    whole = found.whole
    assert whole is not None  # it was asked for
    for k in np.flatnonzero(found.good).tolist():
        yield int(which[k]), found.of_state(k), Accelerations(whole.a[k], whole.by_y[k], whole.by_u[k])


def _at_one(mechanism: Mechanism, q: Array, v: Array, tau: Any) -> tuple[Derivatives, Accelerations] | None:
    """The kernel's at one state; None where it has none."""
    held = None if tau is None else np.asarray(tau, dtype=float)[None]
    found = next(_by_kernel(mechanism, q[None], v[None], held, np.arange(1)), None)
    return found and found[1:]
