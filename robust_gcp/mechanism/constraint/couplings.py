"""Couplings: joints that a gear, a belt or a mimic tag moves together, φ = q₁ − P(q₂) − Σ cᵢ qᵢ.

One row each, in units of the first joint: K has 1 in its column, −P′(q₂) in the second's and −cᵢ in those of
further joints, and k = −K̇ v = P″(q₂) v₂².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import polynomial

from ...checks import check_number, check_text, listed, shown
from ...errors import ModelError, OptionError
from ..tree.joints import Array, Joint, single_joint
from .closures import Closure

LARGEST_DEGREE = 32
"""Of a polynomial; MJCF has four."""


@dataclass(frozen=True)
class CouplingClosure:
    """One joint follows another: q₁ = offset + ratio q₂ + higher₀ q₂² + higher₁ q₂³ + … + Σ more, one row.

    Parameters
    ----------
    joint1, joint2 : str
        Joints with one number in q each; joint2 None (with ratio 0): the first is held at `offset`.
    ratio : float
        rad/rad, m/rad, rad/m or m/m.
    offset : float
        q₁ at q₂ = 0, rad or m.
    higher : tuple of float
        Coefficients of q₂², q₂³, …; empty for a gear.
    more : tuple of (str, float)
        Further joints and what each adds per rad or m: a belt around several, a differential.
    """

    joint1: str
    joint2: str | None
    ratio: float
    offset: float = 0.0
    higher: tuple[float, ...] = ()
    more: tuple[tuple[str, float], ...] = ()
    kind: ClassVar[str] = "coupling"

    def __post_init__(self) -> None:
        check_text("CouplingClosure: joint1", self.joint1)
        if self.joint2 is not None:
            check_text("CouplingClosure: joint2", self.joint2)
        label = f"CouplingClosure {self.label}"
        try:
            names = self.joints
            numbers = (self.offset, self.ratio, *self.higher, *(value for _, value in self.more))
            for value in numbers:
                check_number("coefficient", value)
        except (TypeError, ValueError, OptionError) as error:
            raise ModelError(
                f"{label}: ratio, offset and higher must be numbers, more pairs of joint and number ({error})"
            ) from error
        if self.joint2 is None and (self.ratio or self.higher or self.more):
            raise ModelError(f"{label}: joint2 is None and the others are not zero; name the joint to follow")
        if len(set(names)) < len(names):
            raise ModelError(f"{label}: a joint cannot follow itself, nor count twice; name different joints")
        if not np.all(np.isfinite(np.array(numbers, dtype=float))) or len(self.higher) > LARGEST_DEGREE:
            raise ModelError(
                f"{label}: its coefficients are {shown(numbers)}; give finite numbers, and at most "
                f"{LARGEST_DEGREE} in higher"
            )

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that it ties."""
        second = () if self.joint2 is None else (self.joint2,)
        return (self.joint1, *second, *(name for name, _ in self.more))

    @property
    def label(self) -> str:
        """What to call it in messages."""
        return f"{self.joint1} – {'a constant' if self.joint2 is None else self.joint2}"

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Of P, by rising power."""
        return (float(self.offset), float(self.ratio), *map(float, self.higher))

    @classmethod
    def from_polynomial(
        cls,
        joint1: str,
        joint2: str,
        coefficients: Sequence[float],
        origin1: float = 0.0,
        origin2: float = 0.0,
    ) -> CouplingClosure:
        """q₁ − origin₁ = Σ coefficientsᵢ (q₂ − origin₂)ⁱ, as a polynomial in q₂ itself."""
        expanded = np.array([origin1])
        power = np.array([1.0])
        for c in coefficients:
            expanded = polynomial.polyadd(expanded, float(c) * power)
            power = polynomial.polymul(power, (-origin2, 1.0))  # (q₂ − origin₂)ⁱ
        # ratio and offset are always told
        expanded = np.append(expanded, np.zeros(max(0, 2 - len(expanded))))
        while len(expanded) > 2 and expanded[-1] == 0.0:
            expanded = expanded[:-1]
        offset, ratio, *higher = map(float, expanded)
        return cls(joint1, joint2, ratio, offset, tuple(higher))


class MovingCoupling(CouplingClosure):
    """A coupling whose offset changes, as what sticks does so anywhere; two of them are never equal.

    K does not depend on the offset, so that what was worked out for a mechanism serves it at all of them:
    `Couplings` and what the kernel is told read it anew. Such a mechanism serves one motion at a time.
    """

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other

    def move(self, offset: float) -> None:
        """Hold the row there."""
        object.__setattr__(self, "offset", offset)


AnyClosure = Closure | CouplingClosure
"""What ties the joints of a spanning tree: loops between two frames, and couplings of two joints."""


def closures_given(closures: Any) -> list[Any]:
    """A list of closures, of this package's kinds or of Pinocchio's, or a ModelError."""
    return listed(closures, "closures", "closures, such as PointClosure(frame1, frame2)", kind=AnyClosure)


class Couplings:
    """The rows of all couplings at once: values, slopes and curvatures of their polynomials.

    Parameters
    ----------
    joints : sequence of Joint
        All of the model.
    couplings : sequence of CouplingClosure

    Attributes
    ----------
    iq, iv : ndarray (n, 2) of int
        Indices of both joints in q and in v.
    coefficients : ndarray (n, width)
        Of each P by rising power, padded with zeros.
    moving : list of (row, MovingCoupling)
    further : list of (row, iq, iv, coefficient)
        Of the joints beyond the second.

    Raises
    ------
    ModelError
        For a joint that the model does not have, or that has several numbers.
    """

    def __init__(self, joints: Sequence[Joint], couplings: Sequence[CouplingClosure]) -> None:
        n, width = len(couplings), max((len(c.coefficients) for c in couplings), default=0)
        self.iq = np.zeros((n, 2), dtype=np.int64)
        self.iv = np.zeros((n, 2), dtype=np.int64)
        self.coefficients = np.zeros((n, width))
        self.further: list[tuple[int, int, int, float]] = []
        for i, coupling in enumerate(couplings):
            label = f"CouplingClosure {coupling.label}"
            # a joint that is held has itself as its second, at coefficients of zero
            for side, name in enumerate((coupling.joint1, coupling.joint2 or coupling.joint1)):
                joint = single_joint(joints, name, label, "choose another")
                self.iq[i, side], self.iv[i, side] = joint.idx_q, joint.idx_v
            for name, value in coupling.more:
                joint = single_joint(joints, name, label, "choose another")
                self.further.append((i, int(joint.idx_q), int(joint.idx_v), float(value)))
            self.coefficients[i, : len(coupling.coefficients)] = coupling.coefficients
        self.moving = [(i, c) for i, c in enumerate(couplings) if isinstance(c, MovingCoupling)]
        powers = np.arange(width, dtype=float)
        self._slopes = (self.coefficients * powers)[:, 1:]
        self._curvatures = (self.coefficients * powers * (powers - 1.0))[:, 2:]
        self._thirds = (self.coefficients * powers * (powers - 1.0) * (powers - 2.0))[:, 3:]

    def residual(self, q: Array) -> Array:
        """q₁ − P(q₂) − Σ cᵢ qᵢ, (n,), rad or m."""
        self.refresh()
        values = q[self.iq[:, 0]] - _values(self.coefficients, q[self.iq[:, 1]])
        for row, iq, _, value in self.further:
            values[row] -= value * q[iq]
        return np.asarray(values)

    def refresh(self) -> Array:
        """The coefficients, with offsets as they are now."""
        for i, coupling in self.moving:
            self.coefficients[i, 0] = coupling.offset
        return self.coefficients

    def slopes(self, q: Array) -> tuple[Array, Array, Array]:
        """P′, P″ and P‴ at q₂, (n,) each."""
        x = q[self.iq[:, 1]]
        return _values(self._slopes, x), _values(self._curvatures, x), _values(self._thirds, x)

    def jacobian(self, q: Array, nv: int) -> Array:
        """∂φ/∂q, (n, nv)."""
        rows = np.arange(len(self.iv))
        K = np.zeros((len(rows), nv), q.dtype)
        K[rows, self.iv[:, 1]] = -_values(self._slopes, q[self.iq[:, 1]])
        K[rows, self.iv[:, 0]] = 1.0  # a joint that is held has no second one: its own entry comes last
        for row, _, iv, value in self.further:
            K[row, iv] = -value
        return K

    def jacobian_rate(self, q: Array, v: Array) -> Array:
        """Its rate along v (nv,): −P″(q₂) v₂ in the columns of the second joints."""
        rate = np.zeros((len(self.iv), len(v)), np.result_type(q, v))
        rate[np.arange(len(rate)), self.iv[:, 1]] = -self.slopes(q)[1] * v[self.iv[:, 1]]
        return rate

    def bias(self, q: Array, v: Array) -> Array:
        """−K̇ v = P″(q₂) v₂², (n,)."""
        return np.asarray(self.slopes(q)[1] * v[self.iv[:, 1]] ** 2)


def _values(coefficients: Array, x: Array) -> Array:
    """Each row's polynomial at its x, by Horner's rule."""
    value = np.zeros(len(x))
    for column in coefficients.T[::-1]:
        value = value * x + column
    return value
