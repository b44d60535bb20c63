"""Models that packages ship: M, bias and what drives them as MuJoCo has them, or refused by a reason."""

from __future__ import annotations

import importlib.util
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf
from tests.io.drives import Beside
from tests.io.drives import differences as driven

mujoco = pytest.importorskip("mujoco")

PACKAGES = ("gymnasium", "gymnasium_robotics", "metaworld", "dm_control", "robosuite", "myo_sim")
SAME = 1e-10
SEED = 0


def folder_of(package: str) -> Path:
    """Where a package is: installed, or unpacked below the folder in ROBUST_GCP_PACKAGES."""
    unpacked = Path(os.environ.get("ROBUST_GCP_PACKAGES", "")) / package
    if os.environ.get("ROBUST_GCP_PACKAGES") and unpacked.is_dir():
        return unpacked
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        pytest.skip(f"{package} is not installed")
    return Path(spec.origin).parent


def differences(model: pin.Model, theirs: Any, home: Any, seed: int) -> tuple[float, float]:
    """Of M and of the bias at a random state, as shares of the largest; free bodies in their own axes."""
    data, state, rng = model.createData(), mujoco.MjData(theirs), np.random.default_rng(seed)
    q = pin.integrate(model, home, rng.uniform(-0.3, 0.3, model.nv))
    v, turn, pace = rng.normal(size=model.nv), np.eye(model.nv), np.zeros(model.nv)
    qpos = q.copy()
    pin.forwardKinematics(model, data, q)
    for joint in list(model.joints)[1:]:
        if joint.nq in (4, 7):
            end = joint.idx_q + joint.nq
            qpos[end - 4 : end] = np.roll(q[end - 4 : end], 1)
        if joint.nv == 6:  # a linear velocity that is constant in the world is not in the body
            at, spin = slice(joint.idx_v, joint.idx_v + 3), v[joint.idx_v + 3 : joint.idx_v + 6]
            turn[at, at] = data.oMi[joint.id].rotation
            pace[at] = -np.cross(spin, v[at])
    state.qpos[:], state.qvel[:] = qpos, turn @ v
    mujoco.mj_forward(theirs, state)
    M = np.zeros((model.nv, model.nv))
    for row, direction in zip(M, turn.T, strict=True):
        mujoco.mj_mulM(theirs, state, row, direction.copy())
    ours = pin.crba(model, data, q)
    ours = np.triu(ours) + np.triu(ours, 1).T
    bias = pin.rnea(model, data, q, v, pace)
    size = max(np.abs(ours).max(), np.abs(bias).max(), 1e-12)
    return np.abs(M @ turn - ours).max() / size, np.abs(turn.T @ state.qfrc_bias - bias).max() / size


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("package", PACKAGES)
def test_models_are_mujocos_or_refused(package: str, seed: int, record_property: Callable[..., None]) -> None:
    folder, counts, wrong = folder_of(package), Counter[str](), list[str]()
    for file in sorted(folder.rglob("*.xml")):
        if "<mujoco" not in file.read_text(encoding="utf-8", errors="replace"):
            continue
        try:
            contents = read_mjcf(file, root=folder)
        except rg.RobustGcpError:
            counts["refused"] += 1
            continue
        try:
            theirs = mujoco.MjModel.from_xml_path(str(file))
        except ValueError:
            counts["read without files that MuJoCo misses"] += 1
            continue
        counts["read"] += 1
        same = theirs.nv == contents.model.nv
        if not same or max(differences(contents.model, theirs, contents.home, seed)) > SAME:
            wrong.append(str(file))
        elif np.nanmax(driven(Beside(file, folder), seed)) > SAME:
            wrong.append(f"{file}: forces")
        counts["actuators"] += len(contents.actuators)
        counts["tendons"] += len(contents.tendons)
    record_property(f"models of {package}", dict(counts))
    assert counts["read"] > (5 if package == "myo_sim" else 10)
    assert not wrong
