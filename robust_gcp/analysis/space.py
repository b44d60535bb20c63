"""The configuration space of a mechanism with one degree of freedom: its modes and where they meet."""

from __future__ import annotations

from itertools import count, product
from string import ascii_lowercase

import numpy as np
from numpy.typing import NDArray

from ..checks import check_mechanism, check_number
from ..errors import ClosureError, OptionError
from ..mechanism.assembly.assembly import assembled
from ..mechanism.mechanism import Mechanism
from ..mechanism.tolerances import CLOSED, SINGULAR_HOME
from ..mechanism.tree.tree import Array
from .configuration_space import ConfigurationSpace, Curve, ModeCurve, Visit
from .curve import STEP, Continuation
from .local import LocalAnalysis, analyse
from .torus import Torus

SEEDS = 40
"""Rough configurations from which curves are looked for."""

SAME_POINT = 1e-6
"""Dimensionless distance within which two singular configurations are one."""

WELL_APART = 0.1
"""Conditioning of K from which a found configuration is clearly on one mode."""


def trace_modes(mechanism: Mechanism, seeds: int = SEEDS) -> ConfigurationSpace:
    """Trace every operation mode of a mechanism with one degree of freedom.

    A mode here is a maximal smooth curve of configurations: at a singular point, where several
    tangents exist, it goes on along its own. Each mode is followed from the home configuration, from
    every tangent of every singular point that is met, and from configurations assembled from seeds
    all over the joints' range, until it closes. A change-point linkage, whose one curve crosses
    itself, has one mode by this count, with two tangents at its singular point.

    Modes of higher dimension that it meets are told at the singular points, and not followed.

    Modes that meet at singular points make up an assembly mode: what can be reached without taking the
    mechanism apart. No finite search proves that all were found; `ConfigurationSpace.search` says how far
    it went.

    Parameters
    ----------
    mechanism : Mechanism
        With m = 1.
    seeds : int
        How many rough configurations to assemble. Modes that share a singular point with a known one
        are found without; more seeds find small separate ones more surely.

    Raises
    ------
    OptionError
        For a mechanism with another number of degrees of freedom.

    Examples
    --------
    >>> import robust_gcp as rg
    >>> space = rg.trace_modes(rg.load("parallelogram"))
    >>> [(mode.name, mode.closed) for mode in space.modes]
    [('a', True), ('b', True)]
    >>> [sorted(space.meeting(i)) for i in range(len(space.singular_points))]
    [['a', 'b'], ['a', 'b']]
    """
    check_mechanism(mechanism, Mechanism, "trace_modes")
    if mechanism.m != 1 or mechanism.nv < 2:
        raise OptionError(
            f"trace_modes is for closed loops with one degree of freedom; {mechanism.name!r} has "
            f"m = {mechanism.m} and nv = {mechanism.nv}"
        )
    check_number("seeds", seeds)
    if seeds < 0 or not float(seeds).is_integer():
        raise OptionError(f"seeds = {seeds} must be a number of configurations, 0 or more")
    search = _Search(mechanism)
    search.everywhere(int(seeds))
    return search.found(int(seeds))


class _Search:
    """Curves and singular points found so far."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.torus = mechanism, Torus(mechanism)
        self.points: list[LocalAnalysis] = []
        self.curves: list[Curve] = []
        self.met: list[int] = []
        self.continuation = Continuation(mechanism, self.points, self.number)

    def number(self, q: Array) -> tuple[int, LocalAnalysis]:
        """Number and analysis of a singular configuration, new or known."""
        for i, point in enumerate(self.points):
            if self.torus.distance(point.q, q) < SAME_POINT:
                return i, point
        home = self.mechanism.home
        near = self.mechanism.tree.integrate(home, self.torus.difference(home, q)) + 0.0  # no −0
        self.points.append(analyse(self.mechanism, near))
        return len(self.points) - 1, self.points[-1]

    def everywhere(self, seeds: int) -> None:
        """Trace from home and from the seeds, and on from every singular point."""
        for i, start in enumerate(self._starts(seeds)):
            conditioning = self.continuation.conditioning(start)
            if i == 0 and conditioning < SINGULAR_HOME:
                self.number(start)
            elif i > 0 and conditioning < WELL_APART:  # Newton from a seed may have come to either mode
                continue
            elif (known := self._known_curve(start)) is not None:
                self.met[known] += 1
                continue
            else:
                self.met += [0] * (len(self.curves) - len(self.met)) + [1]
                self._add(Curve([start], [self.continuation.tangent(start, self._preferred())]))
            while (branch := self._untraced()) is not None:
                number, tangent = branch
                t = self.continuation.directions(self.points[number])[tangent]
                self._add(Curve([self.points[number].q], [t], [(0, number, tangent)]))
            self.met += [0] * (len(self.curves) - len(self.met))

    def _add(self, curve: Curve) -> None:
        """Trace, backwards too where it does not close."""
        curve = self.continuation.trace(curve)
        if not curve.closed:
            row, last = (curve.passes[0] if curve.passes else (-1, 0, 0)), len(curve.q) - 1
            # a singular point that it began at is on both halves
            back = Curve([curve.q[0]], [-curve.tangents[0]], [row] if row[0] == 0 else [])
            back = self.continuation.trace(back)
            n = len(back.q) - 1
            passes = [(n - at, i, k) for at, i, k in reversed(back.passes)]
            passes += [(n + at, i, k) for at, i, k in curve.passes if at > 0]
            curve = Curve(
                [*reversed(back.q), *curve.q[1:]],
                [*(-t for t in reversed(back.tangents)), *curve.tangents[1:]],
                passes,
                stop="; ".join(dict.fromkeys((back.stop, curve.stop))),
            )
            assert len(curve.q) == n + last + 1
        self.curves.append(curve)

    def _untraced(self) -> tuple[int, int] | None:
        """A tangent that no curve has, at the singular point nearest to home."""
        have = {(number, tangent) for c in self.curves for _, number, tangent in c.passes}
        home = self.mechanism.home
        order = sorted(range(len(self.points)), key=lambda i: self.torus.distance(home, self.points[i].q))
        for i in order:
            if self.points[i].kind == "cusp":  # which a curve ends in
                continue
            for k, mode in enumerate(self.points[i].modes):
                if mode.ndim == 1 and (i, k) not in have:
                    return i, k
        return None

    def _preferred(self) -> Array:
        """The sense in which modes are followed: the independent joint forwards."""
        return np.eye(self.mechanism.nv)[self.mechanism.iv_independent[0]]

    def _starts(self, seeds: int) -> list[Array]:
        """Closed configurations: home, then one from each seed that closes."""
        m = self.mechanism
        found = [m.polish(m.home, np.arange(m.nv))]
        if m.closure_residual(found[0]) > CLOSED:
            found = [assembled(m, m.home, np.arange(m.nv), "trace_modes")]
        for u in _lattice(m.nv, seeds):
            way = np.full(m.nv, 2.0 * m.length)
            way[self.torus.hinges] = np.pi
            try:
                near = m.polish(m.tree.integrate(m.home, way * u), np.arange(m.nv))
                found.append(assembled(m, near, np.arange(m.nv), "trace_modes", (0.0,)))
            except ClosureError:
                continue  # not every seed closes: that is what several are for
        return found

    def _known_curve(self, q: Array) -> int | None:
        """The traced curve that passes through q: its nearest row, moved into q's normal plane, is q."""
        go = self.continuation
        t = go.tangent(q, self._preferred())
        for number, curve in enumerate(self.curves):
            distances = self.torus.distances(curve.q, q)
            near = int(np.argmin(distances))
            if curve.corank or distances[near] > 2.0 * STEP:
                continue
            here = curve.q[near]
            for _ in range(20):
                along = float(t @ (self.torus.difference(here, q) / go.scale))
                if abs(along) < 1e-12:
                    break
                heading = go.tangent(here, t)
                here = go.moved(here, heading * along / max(float(heading @ t), 0.5))
            if self.torus.distance(here, q) < SAME_POINT:
                return number
        return None

    def found(self, seeds: int) -> ConfigurationSpace:
        """Everything under its name, in the units of q and v."""
        names = (w for size in count(1) for w in map("".join, product(ascii_lowercase, repeat=size)))
        modes = []
        for name, curve in zip(names, self.curves, strict=False):
            tangents = np.array(curve.tangents) * self.continuation.scale
            tangents /= np.linalg.norm(tangents, axis=1)[:, None]
            turns = self.torus.turns(curve.q[0], curve.q[-1]) if curve.closed else (0,) * self.mechanism.nv
            visits = tuple(Visit(*at) for at in curve.passes)
            q = np.array(curve.q)
            modes.append(ModeCurve(name, q, tangents, visits, curve.closed, turns, curve.stop))
        return ConfigurationSpace(self.mechanism, tuple(modes), tuple(self.points), seeds, tuple(self.met))


def _lattice(dimension: int, size: int) -> NDArray[np.float64]:
    """Points that fill (−1, 1]^dimension evenly, (size, dimension): an additive recurrence.

    Its steps are powers of the inverse of the generalised golden ratio, x^(d + 1) = x + 1
    (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    """
    ratio = 2.0
    for _ in range(50):
        ratio = (1.0 + ratio) ** (1.0 / (dimension + 1))
    steps = ratio ** -np.arange(1.0, dimension + 1.0)
    return 1.0 - 2.0 * ((0.5 + np.outer(np.arange(1, size + 1), steps)) % 1.0)
