"""A cluster's map around a singular configuration, from a circle in the complex plane about it.

Along a mode the map is analytic, also where K has lost rank; K shows it nowhere near there, but everywhere
on a circle y + ρ e^{iθ} d around it. So the mode is followed along that circle in complex numbers, from a
real regular point, and what is wanted at y is the mean over the circle (Cauchy); for mobility 1 the Fourier
coefficients give it anywhere inside, see taylor_series.py. The trapezoidal rule over N points errs by
(ρ/R)^N, R the distance to the next place where the mode itself ends to be analytic. Source: Trefethen,
Weideman, The exponentially convergent trapezoidal rule, SIAM Review 56, 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...errors import NotCertifiedError
from ...mechanism.constraint.closure_rates import Placement
from ...mechanism.tree.tree import Array
from .map_rates import ClusterRates, MapRates
from .taylor_series import Around

HALF = 16
"""Points on the upper half of the circle, the last on the other side; the lower half is its mirror image."""

CLOSED = 1e-13
"""max |φ| / length at which Newton stops on the circle."""

ORDERS = 24
"""Terms of a series from a circle: beyond them Fourier coefficients are those of negative orders too."""

MAX_NEWTON = 8

CORRECTION = 0.25
"""Newton's first correction against the step along the circle: more is another branch."""


class Place:
    """Complex motions of a cluster's parts from a real placement, by the product of exponentials.

    Parameters
    ----------
    rates : ClusterRates
    q : ndarray (nq,)
        The cluster's real configuration that the motions start from.
    """

    def __init__(self, rates: ClusterRates, q: Array) -> None:
        self._rates, self._start = rates.rates, rates.rates.real(q)
        columns, loops = rates.rates.columns, rates.cluster.loops
        self._columns, nv = columns, loops.nv
        parts = len(columns.slices) + 1
        self._parent = np.zeros(parts, dtype=np.int64)
        self._parent[columns.part] = columns.parent
        self._own = np.zeros((parts, nv))
        self._own[columns.part, np.arange(nv)] = 1.0
        single = [joint for joint in loops.joints if joint.single]
        self._iq, self._iv = (
            np.array([getattr(j, n) for j in single], dtype=int) for n in ("idx_q", "idx_v")
        )
        self._moved = np.tile(np.eye(4, dtype=complex), (parts, 1, 1))
        self._shift = np.zeros(nv, dtype=complex)

    def move(self, dv: Array) -> Placement:
        """Move on by dv (nv,), each part along its own columns; the placement there."""
        # exponentials of the joints' screws are analytic in dv; Pinocchio's placements are of real numbers
        self._moved = self._moved @ exponentials(self._own @ (self._start.J * dv[:, None]))
        self._shift = self._shift + dv
        whole = self._moved.copy()
        for part in range(1, len(whole)):
            whole[part] = whole[self._parent[part]] @ self._moved[part]
        start, own, ends = self._start, self._columns.part, self._rates.part
        turn, shift = whole[:, :3, :3], whole[:, :3, 3]
        angular = np.einsum("nij,nj->ni", turn[own], start.J[:, 3:])
        linear = np.einsum("nij,nj->ni", turn[own], start.J[:, :3]) + np.cross(shift[own], angular)
        q = start.q.astype(complex)
        q[self._iq] += self._shift[self._iv]
        return Placement(
            np.hstack([linear, angular]),
            np.einsum("nij,nj->ni", turn[ends], start.p) + shift[ends],
            turn[ends] @ start.R,
            q,
        )


def exponentials(twists: Array) -> Array:
    """exp of motions (n, 6) about the world's origin, (n, 4, 4), complex; of half a turn at most."""
    linear, angular = twists[:, :3], twists[:, 3:]
    square = np.einsum("ni,ni->n", angular, angular)
    sine, cosine, rest = (np.zeros_like(square) for _ in range(3))
    term = np.ones_like(square)  # (−θ²)^k / (2k)!
    # as far as π³²/32! = 3e-20
    for k in range(16):  # by series: sin θ / θ is analytic in θ², where complex θ has branches
        sine = sine + term / (2 * k + 1)
        cosine = cosine + term / ((2 * k + 1) * (2 * k + 2))
        rest = rest + term / ((2 * k + 1) * (2 * k + 2) * (2 * k + 3))
        term = term * (-square) / ((2 * k + 1) * (2 * k + 2))
    W = np.cross(angular[:, None, :], -np.eye(3)[None])  # rows: e_i × ω, so that W u = ω × u
    WW = W @ W
    found = np.zeros((len(twists), 4, 4), dtype=complex)
    eye = np.eye(3)
    found[:, :3, :3] = eye + sine[:, None, None] * W + cosine[:, None, None] * WW
    V = eye + cosine[:, None, None] * W + rest[:, None, None] * WW
    found[:, :3, 3] = np.einsum("nij,nj->ni", V, linear)
    found[:, 3, 3] = 1.0
    return found


@dataclass(frozen=True)
class Circle:
    """The map's rates on a circle about y.

    Attributes
    ----------
    center : ndarray (m,)
    radius : ndarray (m,)
        ρ d.
    values : list of MapRates
        At the angles π k / `HALF`, from 0 on.
    far : Placement
        On the other side, at the angle π: real on a mode that goes on analytically.
    """

    center: Array
    radius: Array
    values: list[MapRates]
    far: Placement

    def around(self, q: Array) -> Around:
        """The series about the centre, where the cluster's configuration is q; for mobility 1."""
        angles, radius = np.pi * np.arange(HALF + 1) / HALF, float(self.radius[0])
        orders = np.arange(1, ORDERS)
        G = np.array([value.G[:, 0] for value in self.values])
        # G = γ' is sampled, as γ has a constant of integration: coefficients are integrated term by term
        rates = ((_mirrored(HALF) * np.exp(-1j * np.outer(orders - 1, angles))) @ G).real
        terms = np.zeros((ORDERS, 1, G.shape[1]))
        terms[1:, 0] = radius * rates / orders[:, None]
        return Around(self.center, self.radius[:, None], terms, q)

    def mean(self) -> MapRates:
        """The values at the centre."""
        return self._unflattened(self._mean)

    @cached_property
    def error(self) -> float:
        """Relative error of the mean: the largest of the first Fourier coefficients of negative order.

        They vanish where the map is analytic within the circle, but for rounding and for what the
        trapezoidal rule leaves out.
        """
        angles = np.pi * np.arange(HALF + 1) / HALF
        orders = np.exp(1j * np.outer(np.arange(1, 4), angles))
        left = np.abs(((_mirrored(HALF) * orders) @ self._samples).real).max(axis=0)
        pairs = zip(vars(self._unflattened(left)).values(), vars(self.mean()).values(), strict=True)
        return max(float(off.max(initial=0.0) / (1.0 + np.abs(of).max(initial=0.0))) for off, of in pairs)

    def _unflattened(self, flat: Array) -> MapRates:
        """Values as they are from all their numbers in one row."""
        shapes = [part.shape for part in vars(self.values[0]).values()]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        parts = zip(np.split(flat, ends), shapes, strict=True)
        return MapRates(*(part.reshape(shape) for part, shape in parts))

    @cached_property
    def _samples(self) -> Array:
        return np.array([np.concatenate([p.ravel() for p in vars(v).values()]) for v in self.values])

    @cached_property
    def _mean(self) -> Array:
        found: Array = (_mirrored(HALF) @ self._samples).real
        return found


def _mirrored(half: int) -> Array:
    """Weights of the points from 0 to π in a mean over the whole circle."""
    weights = np.full(half + 1, 1.0 / half)
    weights[[0, -1]] = 0.5 / half
    return weights


def circle(rates: ClusterRates, q: Array, center: Array, radius: Array, u: Array) -> Circle:
    """Follow the mode around from the real configuration q at center + radius.

    Raises
    ------
    NotCertifiedError
        Where Newton leaves the mode.
    """
    place = Place(rates, q)
    values = [rates.rates_at(place.move(np.zeros(rates.cluster.loops.nv)), u)]
    turns = np.exp(1j * np.pi * np.arange(HALF + 1) / HALF)  # half: γ(ȳ) is the conjugate of γ(y)
    for before, after in pairwise(turns.tolist()):
        last, step = values[-1], (after - before) * radius
        here = led(rates, place, last.G @ step + 0.5 * np.einsum("i,j,inj->n", step, step, last.bend))
        values.append(rates.rates_at(here, u))
    return Circle(center, radius, values, here)


def led(rates: ClusterRates, place: Place, dv: Array) -> Placement:
    """Move a place on by dv (nv,), as predicted, and close the loops there.

    Raises
    ------
    NotCertifiedError
        Where Newton leaves the mode.
    """
    size = float(np.abs(dv / rates.scale).max())
    here = place.move(dv)
    for iteration in range(MAX_NEWTON):
        dv, residual = rates.correction(here)
        first = float(np.abs(dv / rates.scale).max())
        if iteration == 0 and not first < CORRECTION * size:
            raise NotCertifiedError("derivatives: the mode cannot be followed around the singular place")
        here = place.move(dv)
        if residual < CLOSED or first < 1e-15:  # φ of long chains rounds to more than CLOSED
            break
    return here
