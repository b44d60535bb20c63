"""Cost of a step against the number of loops: N four-bars in a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..contender import Contender
from .measure import Point
from .motion import Motion
from .scenes import n_bars
from .verdicts import OURS, OWN

SIZES = (1, 2, 5, 10, 20, 40)
DURATION = 0.4
"""s, 400 steps of 1 ms: the cranks fall, no singular configuration is met."""

CAP = 8.0
FITTED = 3
"""Largest sizes that the exponent is fitted to."""


def motion(n: int) -> Motion:
    """N four-bars for 400 steps."""
    made = n_bars(n, DURATION, (1,), CAP)
    return replace(made, scene=replace(made.scene, name=f"cost_{n}"), crosses=False)


def enters(contender: Contender) -> bool:
    """Fixed steps; one of each kind of work: tuning does not change the cost of a step."""
    return contender.kind == "fixed" and contender.family != "published" and "Baumgarte" not in contender.name


def costs_of(points: Sequence[Point]) -> dict[str, list[tuple[int, float, float]]]:
    """N, µs a step and µs an evaluation by contender, ascending in N."""
    found: dict[str, list[tuple[int, float, float]]] = {}
    for point in points:
        head, _, size = point.scene.rpartition("_")
        if head == "cost" and point.good and point.rhs:  # what stopped early has not done the steps
            steps = DURATION / point.setting
            entry = int(size), 1e6 * point.seconds / steps, 1e6 * point.seconds / point.rhs
            found.setdefault(point.contender, []).append(entry)
    return {name: sorted(curve) for name, curve in found.items()}


def exponent(curve: Sequence[tuple[int, float, float]]) -> float | None:
    """p of cost ~ N^p over the largest sizes."""
    if len(curve) < FITTED:
        return None
    n, micro, _ = np.array(curve[-FITTED:]).T
    return float(np.polyfit(np.log(n), np.log(micro), 1)[0])


def verdict(costs: dict[str, list[tuple[int, float, float]]], families: dict[str, str]) -> str:
    """One line: cost at the largest size and its growth, ours, the implicit equations, the cheapest peer."""
    largest = max(curve[-1][0] for curve in costs.values())
    there = {name: curve for name, curve in costs.items() if curve[-1][0] == largest}
    shown = [name for name in there if families[name] in (OURS, "implicit")]
    peers = [name for name in there if families[name] not in OWN]
    shown += sorted(peers, key=lambda name: there[name][-1][1])[:1]
    parts = []
    for name in shown:
        power = exponent(there[name])
        growth = "" if power is None else f", growing as N^{power:.2f}"
        parts.append(f"{name} {there[name][-1][1]:.3g} µs{growth}")
    return f"**Cost of a step at N = {largest}**: {'; '.join(parts)}."
