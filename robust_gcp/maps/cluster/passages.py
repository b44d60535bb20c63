"""Where in a step the motion passed singular places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...errors import SimulationError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..explicit import Crossing, Point, Stretch
from .curve import Curve
from .jet import is_singular, nearest_of, pencil_roots
from .patch import Patch
from .tracker import Tracker

SAME, NEXT = 1e-7, 1e-2
"""Shares of a step: times that are one, and those between which its ends' first order does not tell."""

BORDER = 1e-10
"""Seconds by which what is passed where two steps meet belongs to the first: both find it, to rounding."""


def passages(
    trackers: Sequence[Tracker], before: Point, after: Point, stretch: Stretch, mechanism: Mechanism
) -> list[Crossing]:
    """Singular places on a stretch between two accepted points, in the order of time.

    With one coordinate: where y meets that of a root of a curve. With several: Newton in time on the pencil
    along the velocity.
    """
    found: list[Crossing] = []
    for tracker in trackers:
        for bridge in tracker.touched:
            if isinstance(bridge, Curve):
                found += _on_curve(bridge, before, after, stretch, mechanism)
        patches = [bridge for bridge in tracker.touched if isinstance(bridge, Patch)]
        if patches:
            found += _on_patch(tracker, patches[-1], before, after, stretch, mechanism)
        # the bridge that it stands on may have places ahead, for the next step
        tracker.touched = [] if tracker.current is None else [tracker.current]
    found = [_among_others(crossing, trackers, stretch, mechanism) for crossing in found]
    return sorted(found, key=lambda crossing: crossing.time)


def _among_others(
    crossing: Crossing, trackers: Sequence[Tracker], stretch: Stretch, mechanism: Mechanism
) -> Crossing:
    """The crossing with all that is not of its cluster where y has it at that time.

    A polynomial between the ends of a long step leaves the other loops open.
    """
    if not mechanism.tree.vector_space:
        return crossing
    q, y = crossing.q.copy(), stretch.y(crossing.time)
    q[mechanism.iq_independent] = y
    for tracker in trackers:
        space, cluster = tracker.space, tracker.space.cluster
        if cluster.index == crossing.cluster:
            q[cluster.iq] = crossing.q[cluster.iq]
            continue
        kept = tracker.anchor, tracker.current, tracker.u, list(tracker.touched)
        try:
            q[cluster.iq] = space.q(tracker.jet_at(y[cluster.inputs] / space.D[cluster.chosen]).x)
        except (SimulationError, np.linalg.LinAlgError):
            q[cluster.iq] = crossing.q[cluster.iq]  # the polynomial's, good to the step's fourth power
        finally:
            tracker.anchor, tracker.current, tracker.u, tracker.touched = kept
    return replace(crossing, q=q, y=q[mechanism.iq_independent])


def _on_curve(
    curve: Curve, before: Point, after: Point, stretch: Stretch, mechanism: Mechanism
) -> list[Crossing]:
    space, cluster = curve.space, curve.space.cluster
    u0, u1 = (curve.u(space.x(point.q[cluster.iq])) for point in (before, after))
    C, unit = space.chart(cluster.chosen)[:, 0], float(space.D[cluster.chosen[0]])
    # y of the motion goes on over whole turns that x about its own reference does not have
    shift = (
        0.0 if space.flat else float(after.y[cluster.inputs[0]] - unit * (C @ space.x(after.q[cluster.iq])))
    )
    found = []
    for i, (root, corank) in enumerate(zip(curve.roots, curve.corank, strict=True)):
        # a place on which a step ends is passed in that step, not in the one that begins there
        if not corank or not ((u0 - root) * (u1 - root) < 0.0 or u0 != root == u1):
            continue
        x = curve.point(root)[0]
        wanted = shift + unit * float(C @ x)

        def ahead(t: float, wanted: float = wanted) -> float:
            return float(stretch.y(t)[cluster.inputs[0]]) - wanted

        time = stretch.zero(ahead)
        q = between(before, after, stretch, time, mechanism)
        q[cluster.iq] = space.q(x)
        what = curve.kind, curve.closure, curve.transversality, cluster.index, corank, curve.order(i)
        found.append(Crossing(time, q[mechanism.iq_numbers], q, *what))
    return found


def between(a: Point, b: Point, stretch: Stretch, time: float, mechanism: Mechanism) -> Array:
    """q at a time of the stretch from a to b: cubic Hermite in q and v."""
    h = stretch.t1 - stretch.t0
    share = (time - stretch.t0) / h
    towards = mechanism.tree.difference(a.q, b.q)
    r0, r1 = h * (a.G @ a.ydot), h * (b.G @ b.ydot)
    way = share * (r0 + share * (3.0 * towards - 2.0 * r0 - r1 + share * (r0 + r1 - 2.0 * towards)))
    return np.array(mechanism.tree.integrate(a.q, way))


def _sharpened(
    roots: Callable[[float], tuple[Array, Array]], t: float, stretch: Stretch
) -> tuple[float, float]:
    """A time of the motion at which K is singular, from one near it, and the last step towards it."""
    step, h = np.inf, stretch.t1 - stretch.t0
    for _ in range(10):
        mu, _ = roots(t)
        if not len(mu):
            break
        step = nearest_of(mu).real
        t += step
        if not stretch.t0 - 0.6 * h <= t <= stretch.t1 + 0.6 * h or abs(step) < 1e-11 * h:
            break
    return t, step


def _on_patch(
    tracker: Tracker,
    patch: Patch[Tracker],
    before: Point,
    after: Point,
    stretch: Stretch,
    mechanism: Mechanism,
) -> list[Crossing]:
    space, cluster = tracker.space, tracker.space.cluster
    kept = tracker.anchor, tracker.current, tracker.u
    unit, inputs = space.D[cluster.chosen], cluster.inputs
    shift = space.x(after.q[cluster.iq])[cluster.chosen] - after.y[inputs] / unit
    h = stretch.t1 - stretch.t0
    eps = 1e-4 * h  # ẏ to 1e-8 of it: Newton's pace alone hangs on it, the root μ = 0 does not

    def real(mu: Array) -> Array:
        return np.asarray(mu[np.abs(mu.imag) <= 0.5 * np.abs(mu) + 1e-9 * h].real)

    def at_end(end: Point) -> Array:
        """Times until K is singular along the motion, to first order."""
        x = space.x(end.q[cluster.iq])
        way = np.linalg.solve(space.turn(x), (end.G @ end.ydot)[cluster.iv])
        return real(pencil_roots(space, kept[0].P, x, way, kept[0].C))

    def roots(t: float) -> tuple[Array, Array]:
        """The same at t, and x there."""
        rate = (stretch.y(t + eps) - stretch.y(t - eps))[inputs] / (2.0 * eps * unit)
        point = tracker.jet_at(stretch.y(t)[inputs] / unit + shift)
        mu = pencil_roots(space, point.P, point.x, point.J @ rate, point.C)
        return real(mu), point.x

    found: list[Crossing] = []
    met: list[float] = []
    try:
        ends = (stretch.t0, before), (stretch.t1, after)
        # Both ends look into the step: each sees the places on its side better.
        starts = [t + mu for t, end in ends for mu in at_end(end)]
        for start in starts:
            if not stretch.t0 - 0.5 * h <= start <= stretch.t1 + 0.5 * h:
                continue
            t, step = _sharpened(roots, float(start), stretch)
            new = not any(abs(t - known) < SAME * h for known in met)
            if abs(step) < 1e-8 * h and stretch.t0 < t - BORDER <= stretch.t1 and new:
                met.append(t)
                mu, x = roots(t)
                away = np.abs(mu)
                starts += (t + mu[(away >= SAME * h) & (away < NEXT * h)]).tolist()
                if patch.kind != "near miss" and not is_singular(space, x):
                    continue
                q = between(before, after, stretch, t, mechanism)
                q[cluster.iq] = space.q(x)
                corank = max(1, int(np.sum(away < SAME * h)))  # roots that are one; at a near miss none is 0
                what = patch.kind, patch.closure, patch.transversality, cluster.index, corank
                found.append(Crossing(t, q[mechanism.iq_numbers], q, *what))
    except (SimulationError, np.linalg.LinAlgError):
        pass  # beside the step the mode may end; what was found stands
    finally:
        tracker.anchor, tracker.current, tracker.u = kept
    return found
