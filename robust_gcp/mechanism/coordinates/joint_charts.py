"""Charts of joints whose velocities are no rates of numbers in q: q = origin ⊕ w.

In such a chart w takes the place of y. It is renewed between steps, so that w stays small, and the velocity
in the joint's own axes, u, takes the place of ẏ: ẇ = dexp⁻¹(w) u.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache, cached_property
from math import factorial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...errors import NonFiniteError
from ..tree.columns import with_simple_joints
from ..tree.joints import Joint, joints_of
from ..tree.motions import motion_cross
from ..tree.tree import Array
from .coordinates import Coordinates


class JointCharts:
    """Some joints of a mechanism, side by side.

    Parameters
    ----------
    model : pin.Model
    joints : sequence of Joint

    Attributes
    ----------
    model : pin.Model
        These joints alone.
    iq, iv : ndarray of int
        Where their q and v are in those of the whole.
    """

    def __init__(self, model: pin.Model, joints: Sequence[Joint]) -> None:
        self.model = pin.Model()
        for joint in joints:
            self.model.addJoint(0, model.joints[joint.index], pin.SE3.Identity(), joint.name)
        self._planar = any("JointModelPlanar" in joint.shortname() for joint in list(self.model.joints)[1:])
        self.iq = places([(j.idx_q, j.nq) for j in joints])
        self.iv = places([(j.idx_v, j.nv) for j in joints])

    def place(self, origin: Array, w: Array) -> Array:
        """origin ⊕ w, the numbers in q after the motion w of constant velocity."""
        return np.asarray(pin.integrate(self.model, origin, w))

    def apart(self, origin: Array, q: Array) -> Array:
        """w with q = origin ⊕ w."""
        w = np.asarray(pin.difference(self.model, origin, q))
        if self._planar:  # Pinocchio's logarithm of SE(2) errs by 5e-11, less where it is small
            w += pin.difference(self.model, self.place(origin, w), q)
        return w

    def turn(self, origin: Array, w: Array) -> Array:
        """D = dexp(w): origin ⊕ w moves with the velocity D ẇ in its own axes."""
        return np.asarray(pin.dIntegrate(self.model, origin, w, pin.ArgumentPosition.ARG1))

    def rate(self, origin: Array, w: Array, v: Array) -> Array:
        """ẇ for which origin ⊕ w moves with the velocity v in its own axes: dexp⁻¹(w) v.

        Source: Iserles, Munthe-Kaas, Nørsett, Zanna, Lie-group methods, Acta Numerica 9, 2000, section 3.
        """
        if not np.any(w):  # dexp(0) = I; also where each step begins
            return v
        try:
            return np.asarray(np.linalg.solve(self.turn(origin, w), v))  # without it RK4 has order 2
        except np.linalg.LinAlgError as error:
            raise NonFiniteError(
                "a joint on a group turned by a whole turn, or no finite angle, in one step; use a smaller "
                "step, or an implicit stepper (Radau, BDF) if the mechanism is stiff"
            ) from error

    def place_slopes(self, origin: Array, w: Array) -> tuple[Array, Array]:
        """∂(origin ⊕ w) by origin and by w, (n, n) each, all in the joints' own axes."""
        by_origin = np.asarray(pin.dIntegrate(self.model, origin, w, pin.ArgumentPosition.ARG0))
        return by_origin, self.turn(origin, w)

    def rate_slopes(self, w: Array, u: Array) -> tuple[Array, Array]:
        """∂ẇ/∂w and ∂ẇ/∂u of `rate`, (n, n) each, by ẇ = Σ (−1)ᵏ Bₖ/k! ad_wᵏ u."""
        ad = np.einsum("ijk,j->ik", self._brackets, w)
        n, size = len(w), float(np.abs(ad).sum(axis=1).max(initial=0.0))
        by_w, by_u = np.zeros((n, n)), np.eye(n)
        term, term_w, term_u = u, np.zeros((n, n)), np.eye(n)
        bound = 1.0
        for coefficient in _inverse_exponential():
            bound *= size / (2.0 * np.pi)  # |Bₖ|/k! falls like (2π)⁻ᵏ: the series ends at a whole turn
            term_w = ad @ term_w - np.einsum("ijk,j->ik", self._brackets, term)
            term, term_u = ad @ term, ad @ term_u
            by_w += coefficient * term_w
            by_u += coefficient * term_u
            if bound < 1e-20:
                break
        return by_w, by_u

    @cached_property
    def _brackets(self) -> Array:
        """[i, j, k]: component i of the bracket of the unit velocities j and k."""
        simple = with_simple_joints(self.model, joints_of(self.model))
        found = np.zeros((simple.nv, simple.nv, simple.nv))
        for joint in list(simple.joints)[1:]:
            data = joint.createData()
            joint.calc(data, pin.neutral(simple))
            S = np.asarray(data.S, dtype=float).reshape(6, joint.nv)
            products = motion_cross(S.T[:, None], S.T[None])
            own = slice(joint.idx_v, joint.idx_v + joint.nv)
            # brackets stay in the span of S, as the joint's motions are a group
            found[own, own, own] = np.einsum("ix,jkx->ijk", np.linalg.pinv(S), products)
        return found


class LoopCharts(JointCharts):
    """`Coordinates.chart_joints`: joints in loops with some velocities independent, the others dependent.

    Attributes
    ----------
    inputs : ndarray of int
        Positions in y of their independent velocities.
    own : ndarray of int
        Positions of the same in w.
    """

    def __init__(self, mechanism: Coordinates) -> None:
        super().__init__(mechanism.own_model, mechanism.chart_joints)
        position = {int(i): k for k, i in enumerate(mechanism.iv_independent)}
        own = [k for k, i in enumerate(self.iv) if int(i) in position]
        self.own = np.array(own, dtype=np.int64)
        self.inputs = np.array([position[int(self.iv[k])] for k in own], dtype=np.int64)


@cache
def _inverse_exponential() -> tuple[float, ...]:
    """(−1)ᵏ Bₖ/k! for k = 1, 2, …, of the inverse of the exponential map's derivative."""
    found = [Fraction(1)]  # exact, so that odd ones but the first are zero
    for k in range(1, 60):  # to 1e-20 up to 2.9 rad a step
        found.append(-sum((c / factorial(k + 1 - j) for j, c in enumerate(found)), Fraction(0)))
    return tuple(float((-1) ** k * c) for k, c in enumerate(found))[1:]


def loop_charts(mechanism: Coordinates) -> LoopCharts | None:
    """The charts that a mechanism's loops need; None where all their coordinates are numbers in q."""
    if not mechanism.chart_joints:
        return None
    charts: LoopCharts = mechanism.memo.once("loop charts", lambda: LoopCharts(mechanism))
    return charts


def places(spans: list[tuple[int, int]]) -> NDArray[np.int64]:
    """All the indices in spans of (first, count)."""
    return np.array([i for first, count in spans for i in range(first, first + count)], dtype=np.int64)
