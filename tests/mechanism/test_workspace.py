"""The memory of Pinocchio's algorithms: the same results in less, or a refusal where there is too little."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.rnea_derivatives import RigidDerivatives
from robust_gcp.examples import linkages
from robust_gcp.mechanism.tree import workspace as memory
from robust_gcp.mechanism.tree.tree import Tree

Array = NDArray[np.float64]


def row(count: int, side_by_side: bool) -> pin.Model:
    model, parent = pin.Model(), 0
    for i in range(count):
        joint = linkages.add_link(model, parent, 0.0 if side_by_side or i == 0 else 1.0, f"j{i}", 1.0)
        parent = 0 if side_by_side else joint
    return model


ALGORITHMS: dict[str, Callable[[pin.Model, pin.Data, Array, Array], Any]] = {
    "J": lambda m, d, q, v: pin.computeJointJacobians(m, d, q).copy(),
    "dJ": lambda m, d, q, v: pin.computeJointJacobiansTimeVariation(m, d, q, v).copy(),
    "frames": lambda m, d, q, v: (
        pin.framesForwardKinematics(m, d, q),
        np.array([place.homogeneous for place in d.oMf]),
    )[1],
    "kinematics": lambda m, d, q, v: (
        pin.forwardKinematics(m, d, q, v, v),
        np.array([motion.vector for motion in d.a]),
    )[1],
    "rnea": lambda m, d, q, v: pin.rnea(m, d, q, v, v).copy(),
    "a_gf": lambda m, d, q, v: np.array([motion.vector for motion in d.a_gf]),
    "crba": lambda m, d, q, v: pin.crba(m, d, q).copy(),
    "T": lambda m, d, q, v: pin.computeKineticEnergy(m, d, q, v),
    "U": lambda m, d, q, v: pin.computePotentialEnergy(m, d, q),
}


@pytest.mark.parametrize("name", ["tripod", "spherical loop", "humanoid", "rhombus", "bricard"])
def test_a_lean_workspace_gives_what_a_whole_one_gives(
    mechanisms: dict[str, rg.Mechanism], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """To the last digit, again and again, whatever ran before."""
    monkeypatch.setattr(memory, "LEAN_FROM", 0)
    model = mechanisms[name].model.copy()
    model.armature = np.linspace(0.0, 1.0, model.nv)
    if not memory.is_lean(model.nv):
        pytest.skip("this version of Pinocchio was not looked through")
    whole, lean = pin.Data(model), memory.workspace(model)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
        v = rng.uniform(-1.0, 1.0, model.nv)
        for run in rng.permutation(list(ALGORITHMS)):
            expected, found = (ALGORITHMS[run](model, data, q, v) for data in (whole, lean))
            if run != "a_gf":
                np.testing.assert_array_equal(found, expected, err_msg=str(run))
    tree = Tree(model)
    tree.rnea(q, v, v)
    np.testing.assert_array_equal(tree.rnea(q, v, v), pin.rnea(model, whole, q, v, v))
    assert lean.tau.shape == (model.nv,)


@pytest.mark.parametrize("side_by_side", [True, False])
def test_a_large_row_runs_as_a_small_one_does(monkeypatch: pytest.MonkeyPatch, side_by_side: bool) -> None:
    """130 hinges, lean; and the same with the whole workspace."""
    mechanism = rg.Mechanism.from_pinocchio(row(130, side_by_side))
    assert memory.is_lean(mechanism.nv)
    lean = rg.simulate(mechanism, duration=3e-3, step=1e-3, backend="python")
    monkeypatch.setattr(memory, "LEAN_FROM", 10**9)
    whole = rg.simulate(
        rg.Mechanism.from_pinocchio(mechanism.model), duration=3e-3, step=1e-3, backend="python"
    )
    np.testing.assert_array_equal(lean.q, whole.q)


def resident() -> int:
    """Bytes of memory that this process has in use."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096
    except OSError:
        pytest.skip("this system does not tell")


@pytest.mark.parametrize("lean", [True, False])
def test_a_workspace_takes_what_is_said(monkeypatch: pytest.MonkeyPatch, lean: bool) -> None:
    monkeypatch.setattr(memory, "LEAN_FROM", 0 if lean else 10**9)
    model = row(220, True)
    before = resident()
    data = memory.workspace(model)
    taken = resident() - before
    assert data.nvSubtree[1] == 1
    # what the allocator had free already is not seen
    assert taken < 1.25 * memory.workspace_bytes(model.nv, model.njoints) + 2e6
    assert taken > 0.5 * memory.workspace_bytes(model.nv, model.njoints) - 5e6


def test_the_kernel_takes_no_more(tmp_path: Path) -> None:
    """300 hinges in the kernel within what is said for Python's workspace; nv³ numbers would be 0.9 GB."""
    if not rg.backends()["native"].available:
        pytest.skip("the compiled kernel is not built")
    mechanism = rg.Mechanism.from_pinocchio(row(300, True))
    if not memory.is_lean(mechanism.nv):
        pytest.skip("this version of Pinocchio was not looked through")
    script = (
        f"import resource, sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]; import robust_gcp as rg\n"
        "from test_workspace import row\n"
        "mechanism = rg.Mechanism.from_pinocchio(row(300, True))\n"
        "peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024\n"
        "before = peak(); run = rg.simulate(mechanism, duration=2e-3, step=1e-3, backend='native')\n"
        "assert run.stats.native_steps == 2; print(peak() - before)"
    )
    command = [sys.executable, "-c", script]  # elsewhere: a checkout's own files have no kernel
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert int(done.stdout) < 0.2e9


def test_what_does_not_fit_is_refused_with_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    model = row(200, True)
    monkeypatch.setattr(memory, "memory_left", lambda: 1e6)
    with pytest.raises(rg.ModelError, match=r"200 velocities need .* of 0\.0\d+ GB.*0\.001 GB are left"):
        rg.Mechanism.from_pinocchio(model)
    model = row(40, True)
    rg.Mechanism.from_pinocchio(row(2, True))
    monkeypatch.setattr(memory, "LEAN_FROM", 10**9)
    with pytest.raises(rg.ModelError, match="need a workspace"):
        rg.Mechanism.from_pinocchio(model)


def test_the_size_of_a_whole_workspace_grows_with_the_third_power() -> None:
    small, large = memory.whole_bytes(50, 51), memory.whole_bytes(100, 101)
    assert 5.0 < large / small < 8.0
    assert large > 32 * 100**3


def test_derivatives_that_do_not_fit_are_refused_with_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """They need a whole workspace where motions are served by a lean one."""
    mechanism = rg.Mechanism.from_pinocchio(row(40, True))
    monkeypatch.setattr(memory, "memory_left", lambda: 1e6)
    with pytest.raises(rg.ModelError, match=r"40 velocities need .* of 0\.0\d+ GB.*0\.001 GB are left"):
        RigidDerivatives(mechanism)


def test_a_file_that_does_not_fit_is_refused_unread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its parser takes a minute for 20,000 joints."""
    joints = "".join(
        f'<link name="l{i}"/>'
        f'<joint name="j{i}" type="{kind}"><parent link="base"/><child link="l{i}"/></joint>'
        for i, kind in enumerate(["continuous", "fixed", "floating", "continuous"] * 10)
    )
    urdf = f'<robot name="row"><link name="base"/>{joints}</robot>'
    monkeypatch.setattr(memory, "memory_left", lambda: 1e3)
    monkeypatch.setattr(pin, "buildModelFromXML", lambda *_: pytest.fail("Pinocchio was asked"))
    with pytest.raises(rg.ModelError, match="80 velocities need a workspace"):
        rg.Mechanism.from_urdf(urdf)
