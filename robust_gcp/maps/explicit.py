"""The explicit map q = γ(y): its contract, and what an evaluation of it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

import numpy as np
import scipy

from ..mechanism.tree.tree import Array

if TYPE_CHECKING:
    from .regular_path import RegularPath


@dataclass(slots=True)
class Point:
    """A configuration on the constraint, and the explicit map's derivatives there.

    Attributes
    ----------
    y, ydot : ndarray (m,)
    q : ndarray (nq,)
    G : ndarray (nv, m)
        ∂γ/∂y: v = G ẏ.
    g : ndarray (nv,)
        Ġ ẏ: a = G ÿ + g.
    curvature : ndarray (nv,) or None
        γ'' for m = 1 (g at ẏ = 1); None for other m.
    det, rcond : ndarray (nblocks,)
        Sign and conditioning of K_d's blocks; see `BlockFactor`.
    conditioning : float
        Smallest rcond of all blocks; 1 where nothing is dependent.
    correction : float
        Length of Newton's first step, dimensionless: how wrong the prediction was.
    distance : float
        Length of the predicted step, dimensionless.
    turn : float
        Largest rotation in the predicted step, rad, or slide in characteristic lengths.
    origin : ndarray or None
        Where y holds w of joints in a chart, q = origin ⊕ w: their numbers in q at w = 0. Their ẏ are
        velocities in their own axes, u, and ẇ is `ExplicitMap.rate`.
    """

    y: Array
    ydot: Array
    q: Array
    G: Array
    g: Array
    curvature: Array | None
    det: Array
    rcond: Array
    conditioning: float = 1.0
    correction: float = 0.0
    distance: float = 0.0
    turn: float = 0.0
    origin: Array | None = None


@dataclass
class Counters:
    """What was computed, for `Trajectory.stats`."""

    rhs: int = 0
    constraint_evaluations: int = 0
    newton_iterations: int = 0
    force_evaluations: int = 0
    second_order: int = 0
    marching_steps: int = 0
    zone_evaluations: int = 0
    bridges_built: int = 0
    svds: int = 0
    refined_steps: int = 0
    native_steps: int = 0


CrossingKind = Literal["transversal", "tangential", "near miss", "projected", "within"]


@dataclass(frozen=True)
class Crossing:
    """A singular configuration that the motion passed.

    Attributes
    ----------
    time : float
        s.
    y : ndarray (m,)
        Independent coordinates at the singular surface; those on groups are left out.
    q : ndarray (nq,)
        Configuration there.
    kind : {"transversal", "tangential", "near miss", "projected"}
        A certified crossing of modes; a certified meeting of modes that touch; a gap below the geometric
        tolerance, bridged; a passage by the projection of Eq. (7), which has no certificate of its mode.
    certificate : float
        max |φ| / length over the bridge (for "projected": at the nearest evaluation).
    transversality : float
        How clearly the modes part at second order, 0 where they touch; NaN if unknown.
    cluster : int or None
        Which of `Mechanism.clusters` it belongs to; None for methods that do not know.
    corank : int
        How many singular values of the cluster's K vanish there, and at what it passes within 1e-9 s of it:
        those are one crossing.
    order : int
        The order of contact of the modes that meet: 1 where they cross.
    """

    time: float
    y: Array
    q: Array
    kind: CrossingKind
    certificate: float
    transversality: float = float("nan")
    cluster: int | None = None
    corank: int = 1
    order: int = 1


@dataclass(frozen=True)
class Stretch:
    """A step of a motion: its ends, and y between them.

    Attributes
    ----------
    t0, t1 : float
        s.
    y : callable (t) -> ndarray (m,)
        To the order of the stepper.
    """

    t0: float
    t1: float
    y: Callable[[float], Array]

    def zero(self, ahead: Callable[[float], float]) -> float:
        """When a distance is zero; the nearer end where it keeps its sign."""
        t0, t1 = self.t0, self.t1
        f0, f1 = ahead(t0), ahead(t1)
        if not f0 * f1 < 0.0:  # x has passed it; y of the interpolant may not quite
            return t1 if abs(f1) <= abs(f0) else t0
        return float(scipy.optimize.brentq(ahead, t0, t1, xtol=4.0 * np.spacing(t1)))


class ExplicitMap(Protocol):
    """q = γ(y), G and g on one operation mode.

    A map follows its mode from the point evaluated last (`anchor`); any verified point of the mode
    will do, so evaluations may come in any order that moves in small steps, as the stages of RK4
    and the rejected steps of adaptive solvers do.
    """

    anchor: Point

    @property
    def path(self) -> RegularPath:
        """What solves on regular ground."""
        ...

    @property
    def rest(self) -> ExplicitMap:
        """The map without joints on groups."""
        ...

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y, or an error that says why there is none."""
        ...

    @property
    def met(self) -> bool:
        """Whether a singular surface was met so far, so that `passed` may have something to tell."""
        ...

    def passed(self, before: Point, after: Point, stretch: Stretch) -> list[Crossing]:
        """All singular surfaces between two accepted points, by time; one that lies on `after` is passed."""
        ...

    @property
    def counters(self) -> Counters:
        """What was computed so far."""
        ...

    def rate(self, point: Point) -> Array:
        """ẏ at a point; `point.ydot` where y are numbers in q."""
        ...

    def renewed(self, point: Point) -> Point:
        """The same point as the origin of a new chart, which is taken; itself where y are numbers in q."""
        ...

    def outgrown(self, point: Point) -> bool:
        """Whether the chart ought to be renewed at a point."""
        ...


OUTGROWN = 1.0
"""|w| in a chart, rad or m, beyond which it is renewed: dexp⁻¹ is singular at a whole turn."""


class _OnPath(Protocol):
    anchor: Point

    @property
    def path(self) -> RegularPath: ...


Own = TypeVar("Own")


class Charted:
    """The part of a map that its regular path answers for: charts of joints in loops, and what it counts."""

    @property
    def rest(self: Own) -> Own:
        """Itself: there are no joints on groups."""
        return self

    @property
    def counters(self: _OnPath) -> Counters:
        """What was computed so far."""
        return self.path.counters

    def rate(self: _OnPath, point: Point) -> Array:
        """See `ExplicitMap.rate`."""
        return self.path.rate(point)

    def renewed(self: _OnPath, point: Point) -> Point:
        """See `ExplicitMap.renewed`."""
        new = self.path.renewed(point)
        if new is not point:
            self.anchor = new
        return new

    def outgrown(self: _OnPath, point: Point) -> bool:
        """See `ExplicitMap.outgrown`."""
        return self.path.away(point) > OUTGROWN


class Unaware(Charted):
    """The part of a map that does not know of singular surfaces: none is met, none passed."""

    @property
    def met(self) -> bool:
        """Never."""
        return False

    def passed(self, before: Point, after: Point, stretch: Stretch) -> list[Crossing]:
        """Nothing."""
        return []
