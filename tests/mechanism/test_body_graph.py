"""Bodies and joints in any order: wherever a tree is taken, the mechanism is the same."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.building.bodies import Body, BodyJoint
from robust_gcp.mechanism.building.body_graph import spanned

GRAVITY = np.array([0.3, -9.0, -2.0])
X, Y, Z = np.eye(3)


def at(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def body(name: str, place: pin.SE3, mass: float, tip: pin.SE3) -> Body:
    lever = 0.5 * tip.translation
    inertia = 0.05 * np.eye(3) + mass / 12.0 * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    return Body(name, place, pin.Inertia(mass, lever, inertia))


def spatial() -> tuple[list[Body], list[BodyJoint]]:
    """A crank, a coupler on a ball, a cross, and a rocker: RSUR, of mobility one; drawn closed."""
    ball, cross, foot = at(0.3, 0.0, 0.0), at(0.9, 0.5, 0.3), at(1.1, 0.2, 0.1)
    coupler = at(*(cross.translation - ball.translation))
    rocker = at(*(cross.translation - foot.translation))
    bodies = [
        body("crank", at(0, 0, 0), 1.0, ball),
        body("coupler", ball, 2.0, coupler),
        body("rocker", foot, 1.5, rocker),
    ]
    still = pin.SE3.Identity()
    joints = [
        BodyJoint("a", "revolute", "world", "crank", still, still, [np.array([0.0, 0.6, 0.8])]),
        BodyJoint("s", "spherical", "crank", "coupler", ball, still),
        BodyJoint("u", "universal", "coupler", "rocker", coupler, rocker, [X, np.array([0.0, 0.8, -0.6])]),
        BodyJoint("r", "revolute", "world", "rocker", foot, still, [Z], damping=0.2),
    ]
    return bodies, joints


@pytest.mark.parametrize("cut", ["a", "s", "u", "r"])
@pytest.mark.parametrize("backwards", [False, True])
def test_the_same_motion_wherever_the_loop_is_cut(cut: str, backwards: bool) -> None:
    """And whichever of its ends a joint is listed by."""
    angles = {}
    for name, turned in (("s", False), (cut, backwards)):
        bodies, joints = spatial()
        for joint in joints:
            joint.cut = joint.name == name
            joint.damping = 0.0 if cut == "r" else joint.damping  # the damper of a cut joint is left out
            if turned and joint.name in "su":
                joint.parent, joint.child = joint.child, joint.parent
                joint.on_parent, joint.on_child = joint.on_child, joint.on_parent
                joint.axes = list(joint.axes)[::-1]
        mechanism = rg.Mechanism.from_contents(spanned("rsur", bodies, joints, GRAVITY))
        seen = "a" if cut != "a" else "r"
        assert mechanism.m == 1
        mechanism = mechanism.with_independent([seen])
        home = mechanism.home
        start = rg.simulate(mechanism, home, mechanism.lift(home, [0.8]), duration=0.4, step=1e-3)
        assert start.closure_error().max() < 1e-13
        angles[name, turned] = start[seen]
    one, other = angles["s", False], angles[cut, backwards]
    np.testing.assert_allclose(other, one, atol=1e-10)
    assert np.ptp(one) > 0.1


def test_the_order_of_the_list_does_not_matter() -> None:
    wanted = None
    for order in itertools.permutations(range(4)):
        bodies, joints = spatial()
        contents = spanned("rsur", bodies, [joints[i] for i in order], GRAVITY)
        mechanism = rg.Mechanism.from_contents(contents, independent=["r"])
        home = mechanism.home
        (du,) = rg.forward_dynamics(mechanism, home, mechanism.lift(home, [0.7]))
        wanted = du if wanted is None else wanted
        assert du == pytest.approx(wanted, rel=1e-11)


def test_bodies_float_unless_something_holds_them() -> None:
    bodies, joints = spatial()
    inner = [joint for joint in joints if joint.parent != "world"]
    floating = spanned("chain", bodies, inner, GRAVITY)
    assert floating.model.nv == 6 + 3 + 2
    assert spanned("chain", bodies, inner, GRAVITY, base="fixed").model.nv == 5
    with pytest.raises(rg.ModelError, match=r"base='free' needs .* and 'r' is a joint on the ground"):
        spanned("rsur", bodies, joints, GRAVITY, base="free")


def test_faults_are_named() -> None:
    bodies, joints = spatial()
    lone = BodyJoint("b", "revolute", "crank", "nobody", at(0, 0, 0), at(0, 0, 0), [Z])
    with pytest.raises(rg.ModelError, match="joint 'b': there is no body 'nobody'"):
        spanned("x", bodies, [*joints, lone], GRAVITY)
    with pytest.raises(rg.ModelError, match="more than one joint is called 'a'"):
        spanned("x", bodies, [*joints, joints[0]], GRAVITY)
    plane = [BodyJoint(n, "planar", "world", "crank", at(0, 0, 0), at(0, 0, 0), [X, Y, Z]) for n in "pq"]
    with pytest.raises(rg.ModelError, match="'q' closes a loop of joints that are all of kinds that no"):
        spanned("x", bodies[:1], plane, GRAVITY)
