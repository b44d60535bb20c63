"""Joints on groups in the compiled kernel: the same motion as in Python, order 4, momentum, accelerations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

from ..compiled import needs_kernel

Array = NDArray[np.float64]

pytestmark = needs_kernel

KINDS = {
    "free": pin.JointModelFreeFlyer(),
    "ball": pin.JointModelSpherical(),
    "planar": pin.JointModelPlanar(),
    "circle": pin.JointModelRUBZ(),
}
BODY = pin.Inertia(1.3, np.array([0.1, 0.2, -0.05]), np.diag([0.05, 0.1, 0.13]))
REGULAR, CHANGE_POINT = (0.5, 1.0, 0.8, 0.9), (0.5, 1.0, 0.5, 1.0)
FORCES = (
    rg.JointSpring("q1", 3.0, 0.5),
    rg.JointDamper("q3", 0.05),
    rg.PointSpring("universe", "tip", 4.0, 0.3, 0.1),
    rg.PointSpring("e2", "tip", 2.0, 0.1),
)


def robot(
    kinds: tuple[str, ...],
    lengths: tuple[float, ...] = REGULAR,
    gravity: bool = True,
    forces: tuple[Any, ...] = (),
    arm: str | None = None,
) -> rg.Mechanism:
    """Joints one on another, a four-bar across the last body, and an arm on its crank."""
    m, body = pin.Model(), 0
    if not gravity:
        m.gravity.linear[:] = 0.0
    place = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
    names = []
    for kind in kinds:
        names.append(f"{kind}{len(names)}")
        body = m.addJoint(body, KINDS[kind], place, names[-1])
        m.appendBodyToJoint(body, BODY, pin.SE3.Identity())

    def link(parent: int, y: float, name: str, size: float) -> int:
        j = m.addJoint(parent, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), name)
        about = np.diag([0.02 + size**2 / 12.0, 0.01, 0.02 + size**2 / 12.0])
        m.appendBodyToJoint(
            j, pin.Inertia(0.8, np.array([0.02, size / 2.0, 0.01]), about), pin.SE3.Identity()
        )
        return int(j)

    a, b, c, d = lengths
    q1 = link(body, 0.0, "q1", a)
    q2, q3 = link(q1, a, "q2", b), link(body, d, "q3", c)
    for name, at, y in (("e2", q2, b), ("e3", q3, c), ("tip", body, -0.4)):
        m.addFrame(pin.Frame(name, at, pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), pin.FrameType.OP_FRAME))
    home = pin.neutral(m)
    home[-3:] = (1.2, -1.2, 1.2) if lengths == CHANGE_POINT else (1.2, -0.9, 1.27)
    if arm is not None:
        # beside the loop, so that joints in it and in none alternate
        j = m.addJoint(body, KINDS[arm], place, "arm")
        m.appendBodyToJoint(j, BODY, pin.SE3.Identity())
        home = np.concatenate([home, pin.neutral(m)[len(home) :]])
        names.append("arm")
    mech = rg.Mechanism.from_pinocchio(
        m, [rg.PointClosure("e2", "e3")], ["q1", *names], home=home, forces=forces
    )
    mech.home = mech.assemble(home)
    return mech


def push(mech: rg.Mechanism, size: float = 1.0) -> Array:
    """A velocity that moves everything."""
    return mech.lift(mech.home, size * np.random.default_rng(5).normal(size=mech.m))


def both(mech: rg.Mechanism, **options: Any) -> list[rg.Trajectory]:
    return [rg.simulate(mech, backend=backend, **options) for backend in ("python", "native")]


def require_same(python: rg.Trajectory, native: rg.Trajectory) -> None:
    for name in ("q", "v", "energy", "work", "a"):
        one, other = getattr(python, name), getattr(native, name)
        if one is not None:
            apart = np.abs(one - other) / np.maximum(np.abs(one).max(axis=0), 1.0)
            assert apart.max() <= (1e-10 if name == "a" else 1e-12), name
    assert python.stats.native_steps == 0
    assert native.stats.native_steps == len(native.t) - 1
    for here, there in zip(python.crossings, native.crossings, strict=True):
        assert abs(here.time - there.time) < 1e-12


@pytest.mark.parametrize("lengths", [REGULAR, CHANGE_POINT])
@pytest.mark.parametrize("kind", KINDS)
def test_a_thousand_steps_are_the_same(kind: str, lengths: tuple[float, ...]) -> None:
    mech = robot((kind,), lengths)
    require_same(*both(mech, v0=push(mech, 2.0), duration=1.0, step=1e-3, record=("a", "energy")))


@pytest.mark.parametrize("kinds", [("free", "ball"), ("planar", "circle", "ball")])
def test_groups_on_groups_with_all_that_acts(kinds: tuple[str, ...]) -> None:
    """Springs between bodies and to the ground, dampers, a torque function, wrenches."""
    mech = robot(kinds, forces=FORCES, arm="ball")

    def torque(t: float, q: Array, v: Array) -> Array:
        return 0.3 * np.sin(3.0 * t + np.arange(mech.nv)) - 0.1 * v

    wrenches = [
        rg.Wrench("tip", [0.1, 0.2, -0.3, 0.05, 0.0, 0.1]),
        rg.Wrench("e3", lambda t, q, v: [0.0, t, 0.0, 0.0, 0.0, 0.1], "local"),
    ]
    options = {"torque": torque, "wrenches": wrenches, "record": ("a", "energy")}
    require_same(*both(mech, v0=push(mech), duration=0.3, step=1e-3, **options))


def test_accelerations_are_those_of_the_implicit_equations() -> None:
    mech = robot(("free", "circle"), arm="planar")
    motion = rg.simulate(mech, v0=push(mech), duration=0.2, step=1e-3, record=("a",), backend="native")
    assert motion.a is not None
    for k in (0, 57, 200):
        a, _ = rg.implicit_dynamics(mech, motion.q[k], motion.v[k])
        np.testing.assert_allclose(motion.a[k], a, atol=1e-10)


def test_steps_have_order_4_and_momentum_is_kept_to_their_error() -> None:
    mech = robot(("free", "ball"), gravity=False, arm="ball")
    v = push(mech)
    data = mech.model.createData()

    def momentum(q: Array, v: Array) -> Array:
        h = pin.computeCentroidalMomentum(mech.model, data, q, v)
        return np.concatenate([h.linear, h.angular + np.cross(data.com[0], h.linear)])

    def run(k: int) -> rg.Trajectory:
        motion = rg.simulate(mech, v0=v, duration=1.0, step=2.0**-k, backend="native")
        assert motion.stats.native_steps == len(motion.t) - 1
        assert motion.closure_error().max() < 1e-13
        return motion

    exact, before = run(13), momentum(mech.home, v)
    np.testing.assert_allclose(momentum(exact.q[-1], exact.v[-1]), before, atol=1e-11)
    errors, drifts = [], []
    for motion in map(run, range(7, 10)):
        turned = np.abs(mech.tree.difference(exact.q[-1], motion.q[-1])).max()
        errors.append(max(float(turned), float(np.abs(exact.v[-1] - motion.v[-1]).max())))
        drifts.append(float(np.abs(momentum(motion.q[-1], motion.v[-1]) - before).max()))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.1)
    assert np.all(np.log2(np.array(drifts[:-1]) / drifts[1:]) > 3.8)


def test_far_away_the_motion_is_the_same() -> None:
    """A kilometre off, where a world frame would cost three digits."""
    mech = robot(("free",), gravity=False)
    v, far = push(mech), mech.home.copy()
    far[:3] += 1000.0
    here, there = (rg.simulate(mech, q, v, 0.5, 1e-3, backend="native") for q in (mech.home, far))
    np.testing.assert_allclose(here.q[:, 3:], there.q[:, 3:], atol=1e-12)
    np.testing.assert_allclose(here.v, there.v, atol=1e-12)


@pytest.mark.filterwarnings("ignore:energy is off")
def test_large_turns_in_one_step() -> None:
    """The chart's rate has its closed form there, not the series."""
    m = pin.Model()
    m.appendBodyToJoint(m.addJoint(0, KINDS["free"], pin.SE3.Identity(), "base"), BODY, pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(m)
    v = np.array([3.0, -2.0, 1.0, 9.0, 8.0, -7.0])
    for step in (0.02, 0.05, 0.1):
        require_same(*both(mech, v0=v, duration=10 * step, step=step))
