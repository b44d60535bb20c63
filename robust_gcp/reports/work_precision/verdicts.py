"""What the points say: time to an error, order, distance from the floor; verdicts and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from .. import pages
from .measure import Point
from .ours import COMPILED, FLOOR, named
from .references import Reference

TARGETS = (1e-4, 1e-6, 1e-8, 1e-10)
"""rad: errors at which run times are compared."""

SHOWN = (1e-6, 1e-10)
"""Those that seconds are told for."""

OURS, PYTHON = "bridge", "bridge, RK4"
OWN = (OURS, "closed form", "published", "implicit", FLOOR)
"""Families that come with this package; all others are peers."""

STAYS = 10.0
"""An error that rises beyond this many times the target again had not reached it."""

MARGIN = 50.0
"""A floor this many times the reference's accuracy, or more, can be compared with."""


class Reach(NamedTuple):
    """What it takes to come below an error."""

    contender: str
    seconds: float
    rhs: float


Curves = dict[str, list[Point]]
"""Points of one scene by contender, coarse to fine."""

Row = tuple[str, Curves, Reference]
"""A scene's title, its curves and its exact motion."""


def curves_of(points: Iterable[Point], scene: str) -> Curves:
    """The scene's points by contender, in the order of the ladder."""
    found: Curves = {}
    for point in points:
        if point.scene == scene:
            found.setdefault(point.contender, []).append(point)
    return {name: sorted(curve, key=lambda p: -p.setting) for name, curve in found.items()}


def reach(curve: Sequence[Point], target: float) -> Reach | None:
    """Seconds and evaluations at which a curve comes below `target` and stays, between points in logarithms.

    The coarsest point's own where that is good enough already; None when no point is, or a finer one is
    lost or errs more than `STAYS` times the target: that was luck.
    """
    before: Point | None = None
    timed = [p for p in curve if p.timed]
    for i, point in enumerate(timed):
        if all(p.good and p.error <= (STAYS if p is not point else 1.0) * target for p in timed[i:]):
            if before is None or not before.good or not before.error > target:
                return Reach(point.contender, point.seconds, float(point.rhs))
            error = max(point.error, 1e-16)
            share = float(np.log(before.error / target) / np.log(before.error / error))
            seconds = before.seconds * (point.seconds / before.seconds) ** share
            return Reach(point.contender, seconds, before.rhs * (point.rhs / before.rhs) ** share)
        before = point
    return None


def _sides(curves: Curves) -> tuple[list[list[Point]], list[list[Point]]]:
    """Ours, and those of peers."""
    every = list(curves.values())
    return [c for c in every if c[0].family == OURS], [c for c in every if c[0].family not in OWN]


def fastest(curves: Sequence[Sequence[Point]], target: float) -> Reach | None:
    """The contender that is first below `target`."""
    found = (reach(curve, target) for curve in curves)
    return min((r for r in found if r is not None), key=lambda r: r.seconds, default=None)


def best_error(curves: Sequence[Sequence[Point]]) -> tuple[float, str] | None:
    """The smallest error of any good point."""
    return min(((p.error, p.contender) for curve in curves for p in curve if p.good), default=None)


def order(curve: Sequence[Point], accuracy: float) -> float | None:
    """Observed order of a fixed-step curve: slope of log error over log step, by least squares.

    Over good points with errors below 0.1 and above the reference's accuracy and rounding.
    """
    fit = [p for p in curve if p.good and max(MARGIN * accuracy, 1e-11) < p.error < 0.1]
    if len(fit) < 3 or fit[0].kind != "fixed":
        return None
    return float(np.polyfit(np.log([p.setting for p in fit]), np.log([p.error for p in fit]), 1)[0])


def over_floor(curves: Curves, contender: str, accuracy: float) -> float | None:
    """Largest error of a contender over that of its stepper's floor at the same setting."""
    curve = curves.get(contender, [])
    if not curve:
        return None
    floors = {p.setting: p for p in curves.get(named(FLOOR, curve[0].stepper), []) if p.good}
    ratios = [
        p.error / floors[p.setting].error if p.good else np.inf
        for p in curve
        if p.timed and p.setting in floors and floors[p.setting].error > MARGIN * accuracy
    ]
    return max(ratios, default=None)


def ratios(rows: Sequence[Row]) -> str:
    """Run time of ours over the fastest peer's at each error; where we lose stands in the first column."""
    heads = ["we lose at", "scene", *(f"to {target:.0e}" for target in TARGETS)]
    lines = [[*heads, "error / floor", "reference good to"]]
    for title, curves, reference in rows:
        cells, lost, (ours, peers) = [], [], _sides(curves)
        for target in TARGETS:
            text, loses = _ratio(fastest(ours, target), fastest(peers, target), best_error(peers))
            cells.append(text)
            lost += [f"{target:.0e}"] if loses else []
        floors = ((name, over_floor(curves, name, reference.accuracy)) for name in (COMPILED, PYTHON))
        over = ", ".join(f"{ratio:.3f} ({_short(name)})" for name, ratio in floors if ratio is not None)
        lines.append([", ".join(lost), title, *cells, over or "–", f"{reference.accuracy:.0e}"])
    return pages.table(lines)


def _ratio(ours: Reach | None, peer: Reach | None, best: tuple[float, str] | None) -> tuple[str, bool]:
    """The cell, and whether the peer wins."""
    if ours is None:
        return ("not reached" if peer is None else f"not reached, {peer.contender} does"), peer is not None
    if peer is None:
        return "ours alone" + (f" (best {best[0]:.0e}, {best[1]})" if best else ""), False
    ratio = ours.seconds / peer.seconds
    return f"{ratio:.2g} ({peer.contender})", ratio > 1.0


def _short(name: str) -> str:
    return name.removeprefix("bridge").removesuffix("RK4").strip(", ") or "Python"


def seconds(rows: Sequence[Row]) -> str:
    """Per scene seconds and evaluations to two errors, ours and the best peer's."""
    heads = ["scene"]
    for target in SHOWN:
        heads += [f"bridge to {target:.0e}", f"best peer to {target:.0e}"]
    lines = [heads]
    for title, curves, _ in rows:
        line, (ours, peers) = [title], _sides(curves)
        for target in SHOWN:
            line.append(_cell(fastest(ours, target), best_error(ours), named=False))
            line.append(_cell(fastest(peers, target), best_error(peers), named=True))
        lines.append(line)
    return pages.table(lines)


def _cell(reached: Reach | None, best: tuple[float, str] | None, named: bool) -> str:
    if reached is None:
        if best is None:
            return "–"
        return f"not reached ({best[0]:.0e}{', ' + best[1] if named else ''})"
    name = f", {reached.contender}" if named else f", {reached.contender.removeprefix('bridge').strip(', ')}"
    return f"{reached.seconds:.2g} s, {reached.rhs:.2g} ev.{name}"
