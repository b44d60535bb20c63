"""Where the position rows of welds are taken: K_d falls apart, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.maps.regular_path import RegularPath
from robust_gcp.maps.weld_points import meeting_points

BALLS = ("ball", "concurrent hinges", "none")
SHIFT = np.array([0.3, -0.2, 0.5])


def welded(ball: str, shift: np.ndarray | None = None, side: int = 0) -> rg.Mechanism:
    """Two chains, welded at their ends: one ends in a ball, or in hinges; all rotations are random.

    The weld's frames are shifted together, in their own axes.
    """
    rng, model = np.random.default_rng(5), pin.Model()

    def link(parent: int, name: str, kind: pin.JointModel, at: np.ndarray) -> int:
        joint = model.addJoint(parent, kind, pin.SE3(pin.exp3(rng.normal(size=3)), at), name)
        A = rng.normal(size=(3, 3))
        inertia = pin.Inertia(
            rng.uniform(0.5, 2.0), 0.2 * rng.normal(size=3), 0.1 * A @ A.T + 0.3 * np.eye(3)
        )
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        return joint

    first, second = 0, 0
    for i in range(2):
        first = link(first, f"a{i}", pin.JointModelRZ(), rng.normal(size=3))
    if ball == "ball":
        first = link(first, "ball", pin.JointModelSpherical(), rng.normal(size=3))
    else:
        for i in range(3):
            at = rng.normal(size=3)
            first = link(first, f"ball{i}", pin.JointModelRX(), at * (i == 0 or ball == "none"))
    for i in range(3):
        second = link(second, f"b{i}", pin.JointModelRY(), rng.normal(size=3))
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    meeting = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    meeting = meeting * pin.SE3(np.eye(3), np.zeros(3) if shift is None else shift)
    names = ["tip0", "tip1"]
    for name, joint in zip(names, (first, second), strict=True):
        place = data.oMi[joint].inverse() * meeting
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    closure = rg.FrameClosure(*names[:: -1 if side else 1])
    return rg.Mechanism.from_pinocchio(model, [closure], ("a0", "b0"), home=q)


def path_of(mech: rg.Mechanism) -> RegularPath:
    return RegularPath(mech, np.arange(mech.nc))


@pytest.mark.parametrize("side", (0, 1))
@pytest.mark.parametrize("ball", BALLS)
def test_rows_fall_apart_at_a_ball_next_to_the_cut(ball: str, side: int) -> None:
    mech = welded(ball, SHIFT, side)
    path = path_of(mech)
    assert [len(block.rows) for block in path.blocks] == ([6] if ball == "none" else [3, 3])
    joint, place = mech.model.getFrameId("tip0"), mech.model.frames[mech.model.getFrameId("tip0")].placement
    assert mech.model.frames[joint].name == "tip0"
    centre = place.actInv(np.zeros(3)) if ball != "none" else np.zeros(3)
    np.testing.assert_allclose(path.points, [centre], atol=1e-14)


@pytest.mark.parametrize("ball", BALLS)
def test_g_is_that_of_the_mechanism_s_own_rows(ball: str) -> None:
    mech = welded(ball)
    path, q = path_of(mech), mech.home
    v = mech.lift(q, np.array([0.7, -1.1]))
    point = path.settle(q.copy(), mech.y_about(q), v[mech.iv_independent])
    assert point is not None
    K, dependent = mech.K(point.q), mech.iv_dependent
    np.testing.assert_allclose(K @ point.G, 0.0, atol=1e-12)
    np.testing.assert_allclose(K @ point.g, mech.k(point.q, point.G @ point.ydot), atol=1e-11)
    np.testing.assert_allclose(
        point.G[dependent], -np.linalg.solve(K[:, dependent], K[:, mech.iv_independent]), atol=1e-11
    )


@pytest.mark.parametrize("backend", ("python", "auto"))
@pytest.mark.parametrize("ball", BALLS)
def test_the_same_motion_wherever_the_frames_are(ball: str, backend: str) -> None:
    runs = []
    for shift, side in ((None, 0), (SHIFT, 0), (SHIFT, 1)):
        mech = welded(ball, shift, side)
        v = mech.lift(mech.home, np.array([0.7, -1.1]))
        runs.append(rg.simulate(mech, mech.home, v, 0.1, 1e-3, backend=backend))
    for run in runs[1:]:
        np.testing.assert_allclose(run.q, runs[0].q, rtol=0.0, atol=1e-11)
    assert runs[0].closure_error().max() < 1e-13


def test_reactions_are_those_of_the_closure_s_own_frames() -> None:
    mech = welded("ball", SHIFT)
    v = mech.lift(mech.home, np.array([0.7, -1.1]))
    run = rg.simulate(mech, mech.home, v, 0.01, 1e-3, record=("multipliers", "a"))
    a, multipliers = rg.implicit_dynamics(mech, run.q[-1], run.v[-1])
    np.testing.assert_allclose(run.a[-1], a, atol=1e-8 * np.abs(a).max())
    np.testing.assert_allclose(run.multipliers[-1], multipliers, atol=1e-8 * np.abs(multipliers).max())


def test_rows_that_are_not_all_chosen_stay_at_the_frames() -> None:
    mech = welded("ball", SHIFT)
    assert meeting_points(mech, np.arange(6), mech.iv_dependent).any()
    assert not meeting_points(mech, np.arange(5), mech.iv_dependent).any()
    assert not meeting_points(mech, np.arange(6), mech.iv_dependent[:2]).any()
