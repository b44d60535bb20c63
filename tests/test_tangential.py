"""Singularities that second order does not decide: the run stops and says what it knows.

A ladder of unit length slides along the z and y axes (Cardan's trammel); its point T at the distance
b from the lower end runs on the ellipse (a cos θ, b sin θ), a = 1 − b. A dyad hinged at O with the
total reach ρ holds T. Its two assemblies meet where |T − O| = ρ. With O the centre of curvature of
the ellipse at θ* and ρ its radius there, |T − O| − ρ starts with (θ − θ*)³, and at a vertex with
(θ − θ*)⁴: a cusp and a tangential meeting of modes.
"""

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.scenes import add_link, rod

B = 0.3
A = 1.0 - B


def trammel(theta: float, share: float = 0.55) -> rg.Mechanism:
    """The mechanism whose dyad is centred on the evolute at θ; y = angle of the ladder."""
    speed2 = (A * np.sin(theta)) ** 2 + (B * np.cos(theta)) ** 2
    radius = speed2**1.5 / (A * B)
    # centre of curvature of (A cos θ, B sin θ)
    center = (A**2 - B**2) * np.array([np.cos(theta) ** 3 / A, -(np.sin(theta) ** 3) / B])
    model = pin.Model()

    def slider(name: str, joint_model: object) -> int:
        joint = model.addJoint(0, joint_model, pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia(0.1, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
        return int(joint)

    def frame(joint: int, y: float, name: str) -> None:
        placement = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    foot = slider("foot", pin.JointModelPY())
    # the ladder leans back from its foot: direction (−cos θ, sin θ), joint value π − θ
    ladder = add_link(model, foot, 0.0, "ladder", 1.0)
    frame(ladder, B, "T")
    frame(slider("head", pin.JointModelPZ()), 0.0, "head_frame")
    placement = pin.SE3(np.eye(3), np.array([0.0, *center]))
    upper = model.addJoint(0, pin.JointModelRX(), placement, "upper")
    model.appendBodyToJoint(upper, rod(share * radius), pin.SE3.Identity())
    add_link(model, upper, share * radius, "lower", (1.0 - share) * radius)
    closures = [rg.PointClosure("ladder_tip", "head_frame"), rg.PointClosure("lower_tip", "T")]
    mechanism = rg.Mechanism(model, closures, ["ladder"])
    point = np.array([A * np.cos(theta), B * np.sin(theta)]) - center
    q = [np.cos(theta), np.pi - theta, np.sin(theta), np.arctan2(point[1], point[0]), 0.0]
    mechanism.home = np.array(q)
    mechanism.require_closed(mechanism.home, 1e-14, "home")
    return mechanism


@pytest.mark.parametrize("theta", [np.pi / 2, 1.0], ids=["tangential", "cusp"])
def test_local_analysis_does_not_certify(theta):
    mechanism = trammel(theta)
    here = rg.analyse(mechanism, mechanism.home)
    assert here.kind == "not certified"
    assert here.modes == ()
    assert here.rank == 3
    assert here.local_dof is None


@pytest.mark.parametrize("theta", [np.pi / 2, 1.0], ids=["tangential", "cusp"])
def test_simulation_stops_with_what_is_known(theta):
    mechanism = trammel(theta)
    # the folded side: where |T − O| < ρ
    sides = []
    for delta in (0.3, -0.3):
        guess = mechanism.home + np.array([0.0, -delta, 0.0, 0.4, -0.8])
        guess[0], guess[2] = np.cos(theta + delta), np.sin(theta + delta)
        try:
            sides.append((delta, mechanism.assemble(guess)))
        except rg.ClosureError:
            continue
    assert len(sides) == (2 if theta == np.pi / 2 else 1)
    delta, q0 = sides[0]
    v0 = mechanism.lift(q0, [3.0 * np.sign(delta)])  # towards θ*: the ladder's angle is π − θ
    with pytest.raises((rg.NotCertifiedError, rg.ToggleError)) as caught:
        rg.simulate(mechanism, q0, v0=v0, duration=0.5, step=1e-3)
    stopped = caught.value.trajectory
    assert len(stopped.t) > 5
    assert stopped.closure_error().max() < 1e-12
    assert np.abs(stopped.energy_error()).max() < 1e-6
    if theta == np.pi / 2:
        assert isinstance(caught.value, rg.NotCertifiedError)


def test_start_at_an_uncertified_point_is_refused():
    mechanism = trammel(np.pi / 2)
    with pytest.raises(rg.NotCertifiedError, match="tangential or higher order"):
        rg.simulate(mechanism, mechanism.home)
