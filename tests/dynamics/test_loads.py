"""Torques by name and wrenches on frames: virtual work, statics in closed form, one load in many words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.loads import one_torque
from robust_gcp.examples.linkages import add_link

from ..compiled import needs_kernel

Array = NDArray[np.float64]

NATIVE = needs_kernel
WAYS = {
    "rk4": {"backend": "python"},
    "kernel": {"backend": "native"},
    "DOP853": {"stepper": "DOP853", "rtol": 1e-12, "atol": 1e-14},
    "Radau": {"stepper": "Radau", "rtol": 1e-10, "atol": 1e-12},
}


@pytest.fixture(params=[pytest.param(name, marks=NATIVE if name == "kernel" else ()) for name in WAYS])
def way(request: pytest.FixtureRequest) -> dict[str, Any]:
    return WAYS[request.param]


def tree_of_all_joints() -> rg.Mechanism:
    """A free body that carries a ball, a slide and a hinge, with frames off all axes."""
    rng = np.random.default_rng(7)
    model, parent = pin.Model(), 0
    kinds = [pin.JointModelFreeFlyer(), pin.JointModelSpherical(), pin.JointModelPZ(), pin.JointModelRX()]
    for name, kind in zip(("base", "ball", "slide", "hinge"), kinds, strict=True):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, place, name)
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    model.addFrame(pin.Frame("tool", parent, tool, pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, (), independent=None)


def pendulum() -> rg.Mechanism:
    """A rod of 1 m and 2 kg on a hinge along y, which hangs along −z; its end is a frame."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    body = pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), np.diag([2.0 / 12.0, 2.0 / 12.0, 0.0]))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    tip = pin.SE3(pin.utils.rotate("y", 0.3), np.array([0.0, 0.0, -1.0]))
    model.addFrame(pin.Frame("tip", joint, tip, pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model)


@pytest.mark.parametrize("reference", ["world", "local"])
@pytest.mark.parametrize("frame", ["tool", "hinge", "ball", "base"])
def test_virtual_work(frame: str, reference: Any) -> None:
    """τ · v is what the wrench does on the frame's motion, by differences of its placement."""
    rng = np.random.default_rng(3)
    mech = tree_of_all_joints()
    model, data = mech.model, mech.model.createData()
    joint = frame if frame != "tool" else "hinge"
    place = model.frames[model.getFrameId("tool")].placement if frame == "tool" else pin.SE3.Identity()
    for _ in range(5):
        q, v, F = (
            pin.randomConfiguration(model, -np.ones(mech.nq), np.ones(mech.nq)),
            rng.normal(size=mech.nv),
            rng.normal(size=6),
        )
        torque = one_torque(mech, None, [rg.Wrench(frame, F, reference)])
        assert callable(torque)
        power, h = float(np.asarray(torque(0.0, q, v)) @ v), 1e-5

        def at(t: float, q: Array = q, v: Array = v) -> pin.SE3:
            pin.forwardKinematics(model, data, pin.integrate(model, q, t * v))
            return data.oMi[model.getJointId(joint)] * place

        here, before, after = at(0.0), at(-h), at(h)
        speed = (after.translation - before.translation) / (2.0 * h)
        spin = pin.log3(after.rotation @ before.rotation.T) / (2.0 * h)
        if reference == "local":
            speed, spin = here.rotation.T @ speed, here.rotation.T @ spin
        assert power == pytest.approx(F[:3] @ speed + F[3:] @ spin, rel=1e-7, abs=1e-7)


def test_a_pendulum_pulled_aside_rests_where_the_moments_balance() -> None:
    """F l cos θ = m g (l/2) sin θ for a horizontal force F at the end: tan θ = 2 F / (m g)."""
    mech, force = pendulum(), 3.0
    angle = -np.arctan(2.0 * force / (2.0 * 9.81))  # a turn about +y takes −z to −x
    pull = [rg.Wrench("tip", [force, 0, 0, 0, 0, 0])]
    still = rg.simulate(mech, [angle], duration=1.0, step=1e-2, wrenches=pull)
    np.testing.assert_allclose(still.q, angle, atol=1e-13)
    follower = [rg.Wrench("tip", lambda t, q, v: [force, 0, 0, 0, 0, 0], "local")]
    # its own x axis lies 0.3 rad beyond the joint's, so the arm of the force is l cos 0.3, at any angle
    held = -np.arcsin(2.0 * force * np.cos(0.3) / (2.0 * 9.81))
    still = rg.simulate(mech, [held], duration=1.0, step=1e-2, wrenches=follower)
    np.testing.assert_allclose(still.q, held, atol=1e-13)


def test_a_moment_is_a_torque(way: dict[str, Any]) -> None:
    """About the hinge's axis, whatever the frame on the body; in digits of rounding."""
    mech = pendulum()
    asked = {"duration": 1.0, "step": 1e-2, **way}
    by_moment = rg.simulate(mech, [0.3], [0.1], wrenches=[rg.Wrench("tip", [0, 0, 0, 0, 1.5, 0])], **asked)
    by_torque = rg.simulate(mech, [0.3], [0.1], torque={"hinge": 1.5}, **asked)
    np.testing.assert_allclose(by_moment.q, by_torque.q, atol=1e-9 if "stepper" in way else 1e-13)
    assert by_moment.work is not None
    assert by_torque.work is not None
    np.testing.assert_allclose(by_moment.work, by_torque.work, atol=1e-8 if "stepper" in way else 1e-12)


def test_one_load_in_many_words(way: dict[str, Any]) -> None:
    """A constant and a function by name, as one array, as one function: the same digits."""
    mech = rg.load("rhombus")
    asked = {"duration": 0.4, "step": 4e-3, "record": ("a", "energy", "multipliers"), **way}
    start = [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0]

    def swing(t: float, q: Array, v: Array) -> float:
        return float(0.3 * np.sin(20.0 * t) - 0.1 * v[0])

    runs = [
        rg.simulate(mech, *start, torque=torque, **asked)
        for torque in (
            {"q1": swing, "q3": 0.2},
            {"q1": swing, "q3": lambda t, q, v: [0.2]},
            lambda t, q, v: np.array([swing(t, q, v), 0.0, 0.2]),
        )
    ]
    for other in runs[1:]:
        for name in ("q", "v", "a", "energy", "multipliers", "work"):
            np.testing.assert_array_equal(getattr(runs[0], name), getattr(other, name), err_msg=name)
    constant = rg.simulate(mech, *start, torque={"q2": 0.2}, **asked)
    np.testing.assert_array_equal(constant.q, rg.simulate(mech, *start, torque=[0.0, 0.2, 0.0], **asked).q)


@NATIVE
def test_work_and_constraint_forces_with_a_wrench_through_a_crossing() -> None:
    """The energy balance closes at the order of RK4, and M a + C − Jᵀ F = Kᵀ λ at rounding."""
    mech = rg.load("rhombus")
    frame = mech.closures[0].frame1
    wrench = rg.Wrench(frame, lambda t, q, v: [np.cos(3.0 * t), 0.2, 1.0, 0.1, -0.3, 0.2])
    torque = one_torque(mech, {"q1": 0.1}, [wrench])
    assert callable(torque)
    errors = []
    for step in (4e-3, 2e-3):
        run = rg.simulate(
            mech, [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], 0.4, step, torque={"q1": 0.1}, wrenches=[wrench],
            record=("a", "multipliers"),
        )  # fmt: skip
        errors.append(float(np.abs(run.energy_error()).max()))
        assert len(run.crossings) >= 1
        assert run.a is not None
        assert run.multipliers is not None
        for i in (0, len(run.t) // 2, -1):
            q, v = run.q[i], run.v[i]
            left = mech.tree.rnea(q, v, run.a[i]) - np.asarray(torque(run.t[i], q, v))
            np.testing.assert_allclose(left, mech.K(q).T @ run.multipliers[i], atol=1e-8)
    assert errors[1] < 1e-8
    assert errors[0] / errors[1] > 12.0


def test_linearise_knows_them() -> None:
    """A follower force along the rod does nothing to a pendulum; a fixed one is gravity by another name."""
    mech = pendulum()
    stiff = rg.linearise(mech, [0.0], wrenches=[rg.Wrench("tip", [0, 0, -4.0, 0, 0, 0])]).A
    follower = rg.Wrench("hinge", [0, 0, -4.0, 0, 0, 0], "local")
    plain, along = rg.linearise(mech, [0.0]).A, rg.linearise(mech, [0.0], wrenches=[follower]).A
    inertia = 2.0 / 3.0
    assert stiff[1, 0] == pytest.approx(-(2.0 * 9.81 * 0.5 + 4.0) / inertia, rel=1e-8)
    np.testing.assert_allclose(along, plain, atol=1e-8)


def test_a_constant_force_does_the_work_of_its_way() -> None:
    """W = F · Δp, to the last digits of the quadrature."""
    mech = rg.Mechanism.from_pinocchio(_two_links())
    force = np.array([0.5, 0.0, -0.7])
    run = rg.simulate(
        mech, [0.4, 0.5], [1.0, -2.0], 1.0, 1e-3, wrenches=[rg.Wrench("b_tip", [*force, 0.0, 0.0, 0.0])]
    )
    way = run.frame("b_tip").position
    assert run.work is not None
    np.testing.assert_allclose(run.work, (way - way[0]) @ force, atol=1e-9)


def _two_links() -> pin.Model:
    model = pin.Model()
    add_link(model, add_link(model, 0, 0.0, "a", 1.0), 1.0, "b", 1.0)
    return model


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "joint": ({"torque": {"crank": 1.0}}, "no joint 'crank'"),
    "joint of a function": ({"torque": {"q": lambda t, q, v: 1.0}}, "did you mean"),
    "number": ({"torque": {"q1": "much"}}, r"torque\['q1'\]"),
    "numbers": ({"torque": {"q1": [1.0, 2.0]}}, r"torque\['q1'\]"),
    "infinite": ({"torque": {"q1": np.inf}}, r"torque\['q1'\]"),
    "result": ({"torque": {"q1": lambda t, q, v: [1.0, 2.0]}}, r"torque\['q1'\]\(t, q, v\) returned"),
    "nothing": ({"torque": {"q1": lambda t, q, v: None}}, r"torque\['q1'\]\(t, q, v\) returned"),
    "nan": ({"torque": {"q1": lambda t, q, v: np.nan}}, "nan at t = 0"),
    "frame": ({"wrenches": [("hinge", [1.0])]}, "no Wrench"),
    "one": ({"wrenches": 3}, "list"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_load_is_refused_by_name(what: str) -> None:
    loads, words = REFUSED[what]
    with pytest.raises(rg.RobustGcpError, match=words):
        rg.simulate(rg.load("rhombus"), duration=0.01, **loads)


def test_what_acts_twice_on_one_number_is_refused() -> None:
    """A joint and a component of it: neither takes the other's place without a word."""
    mech = rg.load("rhombus", base="free")
    words = "'root_joint' and 'root_joint.x' have a number in common"
    for alone in (1.0, lambda t, q, v: 1.0):
        torque = {"root_joint": np.ones(6), "root_joint.x": alone}
        with pytest.raises(rg.StateError, match=f"torque: {words}"):
            rg.simulate(mech, duration=0.01, torque=torque)
    with pytest.raises(rg.StateError, match=f"q0: {words}"):
        rg.simulate(mech, {"root_joint": [0, 0, 0, 0, 0, 0, 1], "root_joint.x": 1.0}, duration=0.01)


def test_wrenches_that_are_none() -> None:
    with pytest.raises(rg.RobustGcpError, match="force"):
        rg.Wrench("tip", [1.0, 2.0])
    with pytest.raises(rg.OptionError, match="reference"):
        rg.Wrench("tip", np.zeros(6), "body")  # type: ignore[arg-type]
    with pytest.raises(rg.ModelError, match="no frame 'nose'"):
        rg.simulate(pendulum(), wrenches=[rg.Wrench("nose", np.zeros(6))])
    with pytest.raises(rg.OptionError, match=r"force\(t, q, v\) returned"):
        rg.simulate(pendulum(), wrenches=[rg.Wrench("tip", lambda t, q, v: 1.0)])
