"""What the backends decide on many motions: end states, crossings, bridges, changes of coordinates, warnings.

`python -m tests.oracle.decisions native|python` writes them anew. They were recorded when both backends held
the whole method, and are what later ones are compared with.
"""

from __future__ import annotations

import gzip
import json
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

import robust_gcp as rg

from ..campaigns.crossings import draw
from ..campaigns.descriptions.choices import Description, descriptions
from ..campaigns.descriptions.scenes import SCENES
from ..campaigns.trees import draw as drawn_tree
from ..campaigns.trees import mechanism_of

FOLDER = Path(__file__).parent
MOST, SEED = 4, 5
TREES, CROSSINGS = 200, 10_000
TREES_IN_PYTHON, CROSSINGS_IN_PYTHON, DESCRIPTIONS_IN_PYTHON = 20, 200, 3


@dataclass(frozen=True)
class Case:
    """A motion by its name."""

    name: str
    mechanism: rg.Mechanism
    v0: Any
    duration: float
    step: float


def cases(backend: str) -> Iterator[Case]:
    """All of them."""
    for scene in SCENES:
        yield from of_scene(scene.name, backend)
    for index in range(TREES if backend == "native" else TREES_IN_PYTHON):
        yield of_tree(index)
    for index in range(CROSSINGS if backend == "native" else CROSSINGS_IN_PYTHON):
        yield of_crossing(index)


def of_scene(name: str, backend: str) -> Iterator[Case]:
    """A scene as it is, and in other coordinates, cuts, trees, axes and units."""
    scene = next(each for each in SCENES if each.name == name)
    mechanism, v0 = scene.started()
    yield Case(f"{name}: as it is", mechanism, v0, scene.duration, scene.step)
    others = descriptions(scene, MOST, SEED)
    for other in others if backend == "native" else islice(others, DESCRIPTIONS_IN_PYTHON):
        if isinstance(other, Description):
            yield Case(f"{name}: {other.name}", other.mechanism, other.v0, scene.duration, scene.step)


def of_tree(index: int) -> Case:
    """A random tree of change-point four-bars."""
    rng = np.random.default_rng([SEED, index])
    while True:
        tree = drawn_tree(rng)
        try:
            mechanism = mechanism_of(tree)
            v0 = mechanism.lift(mechanism.home, tree.speeds)
        except rg.RobustGcpError:
            continue
        return Case(f"tree {index}", mechanism, v0, tree.step * tree.steps, tree.step)


def of_crossing(index: int) -> Case:
    """A random change-point four-bar on its way through a crossing."""
    case = draw(np.random.default_rng([SEED, index]))
    mechanism, v0 = case.set_up()
    reach = 2.0 * min(abs(case.y), abs(case.y - np.pi)) / abs(case.speed)
    return Case(
        f"crossing {index}", mechanism, v0, case.step * max(8.0, np.ceil(reach / case.step)), case.step
    )


def decided(case: Case, backend: Any) -> dict[str, Any]:
    """What a backend makes of a motion."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            run = rg.simulate(
                case.mechanism, v0=case.v0, duration=case.duration, step=case.step, backend=backend
            )
            stopped = ""
        except rg.SimulationError as error:
            stopped = type(error).__name__
            if error.trajectory is None or len(error.trajectory.t) == 0:
                return {"stopped": stopped}
            run = error.trajectory
    found = {
        "t": float(run.t[-1]),
        "q": [float(f"{x:.16g}") for x in run.q[-1]],
        "v": [float(f"{x:.16g}") for x in run.v[-1]],
        "crossings": [
            [float(f"{c.time:.12g}"), c.kind, c.corank, float(f"{c.certificate:.2g}")] for c in run.crossings
        ],
        "changes": [[float(f"{t:.12g}"), *names] for t, names in run.stats.repartitions],
        "bridges": run.stats.bridges_built,
        "refined": run.stats.refined_steps,
        "warned": sorted({each.category.__name__ for each in caught}),
        "stopped": stopped,
    }
    return {name: value for name, value in found.items() if value not in ([], 0, "")}


def recorded(backend: str) -> dict[str, dict[str, Any]]:
    """What a backend decided then, by the motion's name."""
    lines = gzip.decompress((FOLDER / f"{backend}.jsonl.gz").read_bytes()).decode().splitlines()
    return dict(json.loads(line) for line in lines)


def main(backend: str) -> None:
    """Write them."""
    lines = [json.dumps([case.name, decided(case, backend)]) for case in cases(backend)]
    text = "\n".join(lines).encode()
    (FOLDER / f"{backend}.jsonl.gz").write_bytes(gzip.compress(text, 9, mtime=0))


if __name__ == "__main__":
    main(sys.argv[1])
