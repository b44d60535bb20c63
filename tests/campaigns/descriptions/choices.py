"""The descriptions of a scene: other coordinates, cuts, trees, axes and units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from robust_gcp.errors import RobustGcpError
from robust_gcp.mechanism.coordinates.partition import numerical_rank
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array

from .drawing import Drawing, View
from .graph import Graph
from .scenes import Scene

ADMISSIBLE = 0.1
"""Share of the best chart's quality that independent joints need at the start."""


@dataclass(frozen=True)
class Description:
    """A mechanism, the velocity it starts with at home, and how it was drawn."""

    name: str
    mechanism: Mechanism
    v0: Array
    drawing: Drawing | None


@dataclass(frozen=True)
class Refused:
    """A description that could not be drawn, and why."""

    name: str
    words: str


def descriptions(scene: Scene, most: int, seed: int = 1) -> Iterator[Description | Refused]:
    """Other coordinates, cuts, trees, axes and units of a scene; at most `most` choices of coordinates."""
    mechanism, v0 = scene.started()
    rng = np.random.default_rng(seed)
    for names in coordinates(mechanism, most, rng):
        yield Description(f"y = {', '.join(names)}", mechanism.with_independent(names), v0, None)
    graph = Graph(mechanism, mechanism.home, v0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    views = {
        "rotated": View(turn=turn),
        "10 m away": View(shift=np.array([6.0, -8.0, 3.0])),
        "millimetres": View(unit=1000.0),
    }
    if graph.planar and mechanism.closures:
        views["closed by hinges"] = View(hinged=True)
    known = {tuple(sorted(graph.cuts))}
    for i in range(3 * most):
        cuts = graph.spanning_cuts(rng)
        if cuts in known or len(known) > most:
            continue
        known.add(cuts)
        views[f"cut at {', '.join(cuts)}"] = View(cuts=cuts, order=i + 1)
    for name, view in views.items():
        try:
            drawn = Drawing(graph, view)
        except RobustGcpError as error:
            yield Refused(name, f"{type(error).__name__}: {error}")
            continue
        choices = coordinates(drawn.mechanism, 2, rng) or [drawn.mechanism.independent]
        for names in choices:
            other = drawn.mechanism.with_independent(names)
            yield Description(f"{name}; y = {', '.join(names)}", other, drawn.v0, drawn)


def coordinates(mechanism: Mechanism, most: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Admissible sets of independent joints, all of them or a sample."""
    names = [joint.name for joint in mechanism.joints if joint.nq == joint.nv == 1]
    iv = {name: mechanism.joint(name).idx_v for name in names}
    K = mechanism.scaled(mechanism.K(mechanism.home))
    _, s, Vt = np.linalg.svd(K)
    kernel = Vt[numerical_rank(s, 1e-9) :].T if len(K) else np.eye(mechanism.nv)
    if kernel.shape[1] != mechanism.m or mechanism.m > len(names):
        return []

    def quality(chosen: tuple[str, ...]) -> float:
        return float(np.linalg.svd(kernel[[iv[name] for name in chosen]], compute_uv=False)[-1])

    if comb(len(names), mechanism.m) <= 20_000:
        tried = list(combinations(names, mechanism.m))
    else:
        tried = [tuple(rng.choice(names, mechanism.m, replace=False).tolist()) for _ in range(2000)]
    qualities = np.array([quality(chosen) for chosen in tried])
    good = [c for c, value in zip(tried, qualities, strict=True) if value > ADMISSIBLE * qualities.max()]
    if len(good) > most:
        good = [good[i] for i in sorted(rng.choice(len(good), most, replace=False).tolist())]
    return good
