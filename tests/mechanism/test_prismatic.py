"""A slide as cut joint: the inverted slider-crank, cut at its slide and cut at its pin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.drawing.figures.mechanism import face_on, pose
from robust_gcp.simulation.trajectories.reactions import row_names

Array = NDArray[np.float64]

GROUND, CRANK, ASKEW = 1.3, 0.5, pin.exp3(np.array([0.4, -0.3, 0.8]))
"""m, m, and how the slot's axis lies in its frames: as data, no axis of coordinates."""


def body(mass: float, length: float) -> pin.Inertia:
    inertia = np.diag([1e-3, mass * length**2 / 12.0, mass * length**2 / 12.0])
    return pin.Inertia(mass, np.array([length / 2.0, 0.0, 0.0]), inertia)


def tree() -> tuple[pin.Model, int, int]:
    """Ground, crank about z at the origin, rocker with a slot about z at (GROUND, 0, 0)."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    crank = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "crank")
    model.appendBodyToJoint(crank, body(1.0, CRANK), pin.SE3.Identity())
    return model, crank, 0


def frame(model: pin.Model, name: str, joint: int, R: Array, x: float) -> None:
    place = pin.SE3(R, np.array([x, 0.0, 0.0]))
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))


def cut_at_the_slide() -> rg.Mechanism:
    """A rod on the crank's pin slides along the rocker; the slide is cut."""
    model, crank, _ = tree()
    rod = model.addJoint(crank, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([CRANK, 0, 0])), "rod")
    model.appendBodyToJoint(rod, body(0.7, 0.6), pin.SE3.Identity())
    rocker = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([GROUND, 0, 0])), "rocker")
    model.appendBodyToJoint(rocker, body(2.0, 1.0), pin.SE3.Identity())
    frame(model, "rod_end", rod, ASKEW, 0.2)
    frame(model, "slot", rocker, ASKEW, 0.1)
    axis = tuple(float(x) for x in ASKEW.T @ np.array([1.0, 0.0, 0.0]))
    closure = rg.PrismaticClosure("rod_end", "slot", axis=(axis[0], axis[1], axis[2]))
    return rg.Mechanism.from_pinocchio(model, [closure], ["crank"], home=start(cut="slide"))


def cut_at_the_pin() -> rg.Mechanism:
    """The rod slides on the rocker as a joint of the tree; its pin on the crank is cut."""
    model, crank, _ = tree()
    rocker = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([GROUND, 0, 0])), "rocker")
    model.appendBodyToJoint(rocker, body(2.0, 1.0), pin.SE3.Identity())
    rod = model.addJoint(rocker, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(rod, body(0.7, 0.6), pin.SE3.Identity())
    frame(model, "crank_pin", crank, np.eye(3), CRANK)
    frame(model, "rod_pin", rod, np.eye(3), 0.0)
    closure = rg.RevoluteClosure("crank_pin", "rod_pin")
    return rg.Mechanism.from_pinocchio(model, [closure], ["crank"], home=start(cut="pin"))


def start(cut: str, crank: float = 0.4) -> Array:
    """In closed form: the rocker points from its pivot to the crank's pin."""
    way = CRANK * np.array([np.cos(crank), np.sin(crank)]) - [GROUND, 0.0]
    rocker, reach = float(np.arctan2(way[1], way[0])), float(np.hypot(*way))
    return np.array([crank, rocker - crank, rocker] if cut == "slide" else [crank, rocker, reach])


@pytest.fixture(scope="module")
def pair() -> tuple[rg.Mechanism, rg.Mechanism]:
    return cut_at_the_slide(), cut_at_the_pin()


@pytest.mark.parametrize("backend", [pytest.param("python", marks=pytest.mark.campaign), "native"])
def test_the_same_motion_wherever_the_loop_is_cut(
    pair: tuple[rg.Mechanism, rg.Mechanism], backend: rg.Backend
) -> None:
    """Two descriptions of one mechanism; the Newton iterations differ, the motion does not.

    Both are held in the crank's angle. Left to themselves they differ: joints are weighed by the levers
    of the closure's rows, which depend on the cut, so that the one cut at the pin goes over to the rocker
    for a while, where RK4 errs by 6e-6 rad at this step instead of 2e-10.
    """
    options: dict[str, Any] = {"duration": 2.0, "step": 1e-3, "backend": backend, "on_toggle": "error"}
    slide, pin_ = (
        rg.simulate(mech, q0=mech.home, v0=mech.lift(mech.home, [1.0]), **options) for mech in pair
    )
    if backend == "native":
        assert slide.stats.native_steps == pin_.stats.native_steps == 2000
    np.testing.assert_allclose(slide.q[:, 0], pin_.q[:, 0], atol=1e-11)
    np.testing.assert_allclose(slide.q[:, 2], pin_.q[:, 1], atol=1e-11)
    np.testing.assert_allclose(slide.v[:, 0], pin_.v[:, 0], atol=1e-10)
    assert np.ptp(slide.q[:, 0]) > 1.0
    assert slide.closure_error().max() < 1e-14
    # what drifts is the stepper's doing, and so the same
    np.testing.assert_allclose(slide.energy_error(), pin_.energy_error(), atol=1e-11)


def test_rows_that_never_act_are_left_out(pair: tuple[rg.Mechanism, rg.Mechanism]) -> None:
    """In the plane: across the slot, and about z (the frames are askew, so all of r are not zero)."""
    slide, pin_ = pair
    assert (slide.m, pin_.m) == (1, 1)
    K = slide.K(slide.home)
    assert np.linalg.matrix_rank(K, tol=1e-12) == 2
    assert {name.partition(".")[0] for name in row_names(slide)} == {"rod_end-slot"}


def test_it_is_regular_where_it_is_and_both_agree_on_modes(pair: tuple[rg.Mechanism, rg.Mechanism]) -> None:
    slide, pin_ = (rg.analyse(mech, mech.home) for mech in pair)
    for picture in (slide, pin_):
        assert picture.kind in ("regular", "redundant") and picture.local_dof == 1
    (one,), (other,) = slide.modes, pin_.modes
    # rates of the rocker over those of the crank
    assert one[2] / one[0] == pytest.approx(other[1] / other[0], abs=1e-13)


def test_the_reaction_is_what_acts_on_both_bodies(pair: tuple[rg.Mechanism, rg.Mechanism]) -> None:
    """Kᵀ λ is the force at frame 1 and the moment on the first body, less the same on the second."""
    slide, _ = pair
    v0 = slide.lift(slide.home, [1.0])
    run = rg.simulate(slide, v0=v0, duration=0.1, step=1e-3, record=("multipliers",))
    found = run.reaction("rod_end")
    model, data = slide.model, slide.model.createData()
    for i in (0, 50, 100):
        pin.computeJointJacobians(model, data, run.q[i])
        pin.updateFramePlacements(model, data)
        at = data.oMf[model.getFrameId("rod_end")].translation
        tau = np.zeros(slide.nv)
        for name, sign in (("rod", 1.0), ("rocker", -1.0)):
            J = pin.getJointJacobian(model, data, model.getJointId(name), pin.ReferenceFrame.WORLD)
            wrench = np.concatenate([found.force[i], found.moment[i] + np.cross(at, found.force[i])])
            tau += sign * J.T @ wrench
        np.testing.assert_allclose(tau, slide.K(run.q[i]).T @ run.multipliers[i], atol=1e-12)
        rocker = run.q[i, 2]
        along = np.array([np.cos(rocker), np.sin(rocker), 0.0])
        assert abs(found.force[i] @ along) < 1e-12  # a slide without friction


def test_half_a_turn_is_refused(pair: tuple[rg.Mechanism, rg.Mechanism]) -> None:
    """sin θ vanishes at π too: the rod put into the slot the wrong way round."""
    slide, _ = pair
    wrong = start("slide") + [0.0, np.pi, 0.0]
    assert slide.closure_residual(wrong) < 1e-12
    with pytest.raises(rg.ClosureError, match="half a turn"):
        rg.simulate(slide, q0=wrong, duration=0.01)


def test_a_picture_shows_the_slide(pair: tuple[rg.Mechanism, rg.Mechanism]) -> None:
    slide, _ = pair
    at = pose(slide, slide.home, face_on(slide))
    (guide,) = at.guides
    crank, reach = start("pin")[0], start("pin")[2]
    rocker = start("slide")[2]
    direction = np.array([np.cos(rocker), np.sin(rocker)])
    np.testing.assert_allclose(guide[0], [GROUND, 0.0] + 0.1 * direction, atol=1e-12)
    np.testing.assert_allclose(guide[1], [GROUND, 0.0] + (reach + 0.2) * direction, atol=1e-12)
    assert crank == 0.4


YAML = """
closed_loop: [[rod, slot]]
type: [prismatic]
name_mot: [crank]
robust_gcp: {axes: [[1, 0, 0]]}
"""
URDF = """<robot name="inverted"><link name="ground"/><link name="arm">{body}</link>
<link name="rod">{body}</link><link name="slot">{body}</link>
<joint name="crank" type="continuous"><parent link="ground"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="pin" type="continuous"><parent link="arm"/><child link="rod"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/></joint>
<joint name="rocker" type="continuous"><parent link="ground"/><child link="slot"/><origin xyz="1.3 0 0"/>
<axis xyz="0 1 0"/></joint></robot>"""
BODY = """<inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def test_a_folder_names_it(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(URDF.format(body=BODY), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(YAML, encoding="utf-8")
    mech = rg.load(tmp_path)
    assert mech.closures == (rg.PrismaticClosure("rod", "slot", axis=(1.0, 0.0, 0.0)),)
    q = mech.assemble([0.4, -1.0, 0.0])
    way = np.array([0.5 * np.cos(q[0]) - 1.3, -0.5 * np.sin(q[0])])  # about +y, x turns towards −z
    across = np.array([np.sin(q[2]), np.cos(q[2])])
    assert abs(way @ across) < 1e-12
    assert q[0] + q[1] == pytest.approx(q[2], abs=1e-12)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 0.0), (1.0, 2.0), "x", (np.nan, 0.0, 1.0)])
def test_an_axis_that_is_none(axis: object) -> None:
    model, crank, _ = tree()
    frame(model, "a", crank, np.eye(3), 1.0)
    frame(model, "b", 0, np.eye(3), 1.0)
    closure = rg.PrismaticClosure("a", "b", axis=axis)  # type: ignore[arg-type]
    with pytest.raises(rg.ModelError, match=r"PrismaticClosure: axis .* is not a direction in space"):
        rg.Mechanism.from_pinocchio(model, [closure], [])
