"""Descriptions of every scene as files: read back, they accelerate as before."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

from .descriptions.choices import Description, descriptions
from .descriptions.scenes import SCENES, Scene

pytest.importorskip("mujoco")

SEED, MOST = 0, 12
FEW = 3
"""Descriptions of a scene that are written by default."""
CLOSE = 1e-9


def state_in(
    one: rg.Mechanism, other: rg.Mechanism, v: np.ndarray, world: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Home and a velocity by the names of joints; numbers of free bodies are those of the `world` in MJCF."""
    q, w = np.zeros(other.nq), np.zeros(other.nv)
    for joint in one.joints:
        numbers, twin = one.home[joint.idx_q : joint.idx_q + joint.nq], other.joint(joint.name)
        if world and joint.nq == 7:
            place = one.model.jointPlacements[joint.index] * pin.XYZQUATToSE3(numbers)
            numbers = pin.SE3ToXYZQUAT(place)
        q[twin.idx_q : twin.idx_q + twin.nq] = numbers
        w[twin.v] = v[joint.v]
    return q, w


def difference(mechanism: rg.Mechanism, path: Path, ydot: np.ndarray) -> float:
    """Of u̇ at home, as a share of the largest."""
    read = rg.load(mechanism.write(path))
    model, forces = read.model.copy(), list(read.forces)
    model.gravity.linear = mechanism.model.gravity.linear
    if path.suffix == ".urdf":
        forces += [force for force in mechanism.forces if isinstance(force, rg.JointTorque)]
    read = rg.Mechanism.from_pinocchio(model, read.closures, mechanism.independent, forces=forces)
    v = mechanism.lift(mechanism.home, ydot)
    wanted = rg.forward_dynamics(mechanism, mechanism.home, v)
    found = rg.forward_dynamics(read, *state_in(mechanism, read, v, path.suffix == ".xml"))
    return float(np.abs(found - wanted).max() / max(1.0, np.abs(wanted).max()))


EVERY = [
    *(pytest.param(scene, FEW) for scene in SCENES[::12]),
    *(pytest.param(scene, MOST, marks=pytest.mark.campaign) for scene in SCENES),
]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("scene", "most"), EVERY, ids=lambda given: getattr(given, "name", str(given)))
def test_what_is_written_moves_as_before(
    scene: Scene, most: int, seed: int, tmp_path: Path, record_property: Callable[..., None]
) -> None:
    rng, counts, worst = np.random.default_rng(seed), Counter[str](), 0.0
    for number, one in enumerate(descriptions(scene, most)):
        if not isinstance(one, Description):
            continue
        for suffix in (".xml", ".urdf", ""):
            path = tmp_path / f"{number}{suffix}"
            try:
                worst = max(worst, difference(one.mechanism, path, rng.normal(size=one.mechanism.m)))
                counts["read back"] += 1
            except rg.StateError:
                counts["singular at home"] += 1
            except rg.ModelError as error:
                if "MJCF has no equality like PrismaticClosure" not in str(error):
                    raise
                counts["refused"] += 1
    with contextlib.suppress(ValueError):
        record_property(f"written {scene.name}", {**counts, "largest difference": worst})
    assert worst < CLOSE
    assert sum(counts.values()) > 0
