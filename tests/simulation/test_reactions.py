"""Forces in all joints: the same however a linkage is cut, and those of free bodies."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import rod

LENGTHS = {"crank": 1.0, "coupler": 3.0, "rocker": 3.0}


def at(y: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))


def crank_rocker(cut: str) -> rg.Mechanism:
    """4, 1, 3, 3 with a spring to the ground, cut at "B", at the rocker, or at "A", at the crank."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])

    def link(parent: int, y: float, name: str, first: float) -> int:
        """Reaches from its end A at `first` of its own axis to its end B."""
        joint = int(model.addJoint(parent, pin.JointModelRX(), at(y), name))
        length = LENGTHS[name]
        model.appendBodyToJoint(joint, rod(length), at(first))
        for end, place in (("A", first), ("B", first + length), ("middle", first + 0.5 * length)):
            model.addFrame(pin.Frame(f"{name}_{end}", joint, at(place), pin.FrameType.OP_FRAME))
        return joint

    crank = link(0, 0.0, "crank", 0.0)
    if cut == "B":
        link(crank, 1.0, "coupler", 0.0)
        link(0, 4.0, "rocker", 0.0)
        ends = "coupler_B", "rocker_B"
    else:
        link(link(0, 4.0, "rocker", 0.0), 3.0, "coupler", -3.0)
        ends = "crank_B", "coupler_A"
    spring = rg.PointSpring("universe", "coupler_middle", 20.0, 0.5, 0.3)
    mechanism = rg.Mechanism.from_pinocchio(model, [rg.PointClosure(*ends)], ["crank"], forces=[spring])
    guess = {"crank": 0.7, "coupler": -0.2 if cut == "B" else -1.4, "rocker": 1.9}
    mechanism.home = mechanism.assemble([guess[name] for name in mechanism.joint_names], hold=["crank"])
    return mechanism


def moving(cut: str, **options: Any) -> rg.Trajectory:
    mechanism = crank_rocker(cut)
    wrench = rg.Wrench("coupler_middle", lambda t, q, v: [0.0, 3.0, np.sin(t), 2.0, 0.0, 0.0])
    v0 = mechanism.lift(mechanism.home, [2.0])
    options = {"torque": {"crank": 1.5}, "wrenches": [wrench], "record": ("a", "multipliers"), **options}
    return rg.simulate(mechanism, v0=v0, duration=0.3, step=1e-3, **options)


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_forces_do_not_hang_on_the_cut(backend: str) -> None:
    """Every bearing of a linkage, with gravity, a spring, a wrench and a torque that act."""
    at_b, at_a = moving("B", backend=backend), moving("A", backend=backend)
    np.testing.assert_allclose(at_a["crank"], at_b["crank"], rtol=0.0, atol=1e-10)
    assert np.abs(at_b.reaction("crank").force).max() > 10.0
    for bearing in ("crank", "rocker"):
        one, other = at_b.reaction(bearing), at_a.reaction(bearing)
        np.testing.assert_allclose(one.force, other.force, rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(one.moment, other.moment, rtol=0.0, atol=1e-7)
    # on the coupler from the crank, in the tree; on the crank from the coupler, in the cut joint
    np.testing.assert_allclose(at_b.reaction("coupler").force, -at_a.reaction(0).force, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(at_a.reaction("coupler").force, at_b.reaction(0).force, rtol=0.0, atol=1e-7)


def test_a_joint_gives_its_axis_what_acts_there() -> None:
    run = moving("B")
    assert run.reaction("crank").moment[:, 0] == pytest.approx(1.5, abs=1e-9)
    for free in ("coupler", "rocker"):
        assert np.abs(run.reaction(free).moment[:, 0]).max() < 1e-9


def test_without_recorded_accelerations_it_is_good_to_the_fourth_order() -> None:
    exact = moving("B").reaction("crank").force
    rough = moving("B", record=("multipliers",)).reaction("crank").force
    np.testing.assert_allclose(rough, exact, rtol=0.0, atol=1e-5)


def test_a_pendulum_far_from_the_origin() -> None:
    """Force in the pivot: m (a − g) of a rod's centre, less what pulls at its tip."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    pivot = np.array([30.0, -50.0, 70.0])
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3(np.eye(3), pivot), "pivot")
    model.appendBodyToJoint(joint, rod(2.0), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", joint, at(2.0), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("centre", joint, at(1.0), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("nail", 0, pin.SE3(np.eye(3), pivot + [0.0, 1.0, 2.0]), pin.FrameType.OP_FRAME))
    spring, push = rg.PointSpring("nail", "tip", 7.0, 0.4, 0.2), np.array([0.0, 0.5, -1.0])
    mechanism = rg.Mechanism.from_pinocchio(model, [], ["pivot"], forces=[spring])
    wrench = rg.Wrench("tip", [*push, 0.0, 0.0, 0.0])
    run = rg.simulate(mechanism, [0.3], [1.0], 0.5, 1e-2, wrenches=[wrench], record=("a",))
    tip, nail = run.frame("tip"), run.frame("nail")
    along = nail.position - tip.position
    length = np.linalg.norm(along, axis=1)
    rate = -np.einsum("ij,ij->i", along, tip.velocity) / length
    pull = ((7.0 * (length - 0.4) + 0.2 * rate) / length)[:, None] * along
    mass = model.inertias[joint].mass
    needed = mass * (run.frame("centre").acceleration - model.gravity.linear) - pull - push
    np.testing.assert_allclose(run.reaction("pivot").force, needed, rtol=0.0, atol=1e-9)


def test_what_a_file_does_not_hold_is_said(tmp_path: Any) -> None:
    run = moving("B")
    again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.reaction(0).force, run.reaction(0).force)
    with pytest.raises(rg.OptionError, match="its file or pickle holds none"):
        again.reaction("crank")
    with pytest.raises(rg.OptionError, match="multipliers"):
        moving("B", record=()).reaction("crank")
    swung = moving("B", wrenches=[], torque={"crank": lambda t, q, v: np.sin(t)})
    for kept in (rg.load_trajectory(swung.save(tmp_path / "swung.npz")), pickle.loads(pickle.dumps(swung))):
        np.testing.assert_allclose(kept.reaction("crank").moment, swung.reaction("crank").moment, atol=1e-12)
