"""solo12 with pinned feet, Baxter with a bar, talos with closed ankles; skipped where the data is missing."""

from __future__ import annotations

from collections.abc import Callable
from importlib import metadata

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.drawing.replay.geometry import sticks
from robust_gcp.drawing.replay.meshes import bare_bodies
from robust_gcp.drawing.skeleton import placements
from robust_gcp.examples import robots

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]

try:
    robots.robot_file("solo_description/robots/solo12.urdf")
    INSTALLED = True
except rg.MissingExtraError:
    INSTALLED = False
needs_data = pytest.mark.skipif(not INSTALLED, reason="example-robot-data (extra `robots`) is not installed")

MAKERS = {"solo12": robots.solo12_pinned, "baxter": robots.baxter_bar}
MOBILITY = {"solo12": (6, 18, 12), "baxter": (13, 19, 6)}


@pytest.fixture(scope="module")
def scenes() -> dict[str, rg.Mechanism]:
    return {name: make() for name, make in MAKERS.items()}


@needs_data
@pytest.mark.parametrize("name", MAKERS)
def test_mobility_is_velocities_less_constraints(scenes: dict[str, rg.Mechanism], name: str) -> None:
    mechanism = scenes[name]
    assert (mechanism.m, mechanism.nv, mechanism.nc) == MOBILITY[name]
    assert mechanism.closure_residual(mechanism.home) < 1e-12
    assert rg.analyse(mechanism, mechanism.home).kind == "regular"


@needs_data
@pytest.mark.parametrize("name", MAKERS)
def test_coordinates_are_well_conditioned(scenes: dict[str, rg.Mechanism], name: str) -> None:
    mechanism = scenes[name]
    K = mechanism.scaled(mechanism.K(mechanism.home))
    kernel = np.linalg.svd(K)[2][mechanism.nc :].T
    quality = np.linalg.svd(kernel[mechanism.iv_independent], compute_uv=False)[-1]
    best = mechanism.coordinate_choices(mechanism.home)[0][0]
    assert quality > 0.9 * best
    assert quality > 0.3  # each set of coordinates shows a third of any motion at least


@needs_data
@pytest.mark.parametrize("name", MAKERS)
def test_a_short_motion_keeps_loops_and_energy(scenes: dict[str, rg.Mechanism], name: str) -> None:
    """RK4: half the step, at least a tenth of the energy error (16 to 32 times less when it is smooth)."""
    mechanism = scenes[name]
    speeds = np.random.default_rng(0).uniform(-0.5, 0.5, mechanism.m)
    speeds[["finger" in joint for joint in mechanism.independent]] = 0.0
    v0 = mechanism.lift(mechanism.home, speeds)
    errors = []
    for step in (2e-3, 1e-3):
        trajectory = rg.simulate(mechanism, mechanism.home, v0, duration=0.1, step=step, record=("energy",))
        assert trajectory.closure_error().max() < 1e-12
        errors.append(float(np.abs(trajectory.energy_error()).max()))
    assert errors[1] < errors[0] / 10.0
    assert errors[1] < 1e-7


@needs_data
@pytest.mark.parametrize("name", MAKERS)
def test_accelerations_agree_with_pinocchios_constrained_dynamics(
    scenes: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    mechanism = MAKERS[name](0.0)
    if name == "baxter":  # without the springs of the fingers
        mechanism = rg.Mechanism(mechanism.model, mechanism.closures, mechanism.independent, mechanism.home)
    model = mechanism.model
    kind = pin.ContactType.CONTACT_3D if name == "solo12" else pin.ContactType.CONTACT_6D
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in mechanism.closures:
        frames = [model.frames[model.getFrameId(n)] for n in (closure.frame1, closure.frame2)]
        ends = [x for f in frames for x in (f.parentJoint, f.placement)]
        models.append(pin.RigidConstraintModel(kind, model, *ends, pin.ReferenceFrame.LOCAL))
        datas.append(models[len(models) - 1].createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-10, 50)
    for q, v in closed_states(mechanism, 3):
        theirs = pin.constraintDynamics(model, data, q, v, np.zeros(model.nv), models, datas, settings)
        ours, _ = rg.implicit_dynamics(mechanism, q, v)
        np.testing.assert_allclose(ours, theirs, atol=1e-9 * max(1.0, np.abs(theirs).max()))


@needs_data
def test_the_bar_is_as_long_as_the_hands_are_apart(scenes: dict[str, rg.Mechanism]) -> None:
    mechanism = scenes["baxter"]
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, mechanism.home)
    hands = [data.oMf[mechanism.model.getFrameId(n)].translation for n in ("left_gripper", "right_gripper")]
    assert np.linalg.norm(hands[1] - hands[0]) == pytest.approx(robots.BAR_LENGTH, abs=1e-12)


@needs_data
def test_negative_springs_are_refused() -> None:
    with pytest.raises(rg.OptionError, match="stiffness"):
        robots.solo12_pinned(-1.0)


def test_missing_data_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    for files in (absent, lambda name: None, lambda name: []):
        monkeypatch.setattr(metadata, "files", files)
        for make in MAKERS.values():
            with pytest.raises(rg.MissingExtraError, match=r'pip install "\.\[robots\]"'):
                make()


@needs_data
@pytest.mark.parametrize("name", MAKERS)
def test_shapes_show_every_body_that_a_loop_is_cut_at(scenes: dict[str, rg.Mechanism], name: str) -> None:
    """The bar too: no body is left as sticks but those that have no shape at all."""
    mechanism = scenes[name]
    visual = robots.shapes(mechanism)
    shown = {int(item.parentJoint) for item in visual.geometryObjects}
    R, p = placements(mechanism, mechanism.home[None])
    bare = bare_bodies(sticks(mechanism, R, p, None), visual)
    assert shown.isdisjoint(bare)
    assert ("bar" in {item.name for item in visual.geometryObjects}) == (name == "baxter")


def test_shapes_of_other_mechanisms_are_refused() -> None:
    with pytest.raises(rg.OptionError, match="'rhombus' is none of the robots here"):
        robots.shapes(rg.load("rhombus"))


@needs_data
@pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
def test_ankles_driven_by_parallel_cranks() -> None:
    """Alike they pitch the foot by their own angle (a parallelogram), against each other they roll it."""
    talos = robots.talos_ankles()
    assert (talos.nv, talos.nc, talos.m, len(talos.clusters)) == (44, 12, 32, 2)
    pitch, roll = (talos.joint_names.index(f"leg_left_{i}_joint") for i in (5, 6))
    for angle in (-0.4, 0.3):
        q = talos.assemble({f"ankle_{s}_{p}": angle for s in ("left", "right") for p in ("inner", "outer")})
        np.testing.assert_allclose(q[[pitch, roll]], [angle, 0.0], atol=1e-12)
    q = talos.assemble({"ankle_left_inner": 0.2, "ankle_left_outer": -0.2})
    mirrored = talos.assemble({"ankle_left_inner": -0.2, "ankle_left_outer": 0.2})
    assert abs(q[roll]) > 0.4
    np.testing.assert_allclose(mirrored[roll], -q[roll], atol=1e-12)
    errors = []
    for step in (1e-3, 5e-4):
        run = rg.simulate(talos, q, duration=0.1, step=step)
        assert run.closure_error().max() < 1e-13
        errors.append(float(np.abs(run.energy_error()).max()))
    assert np.log2(errors[0] / errors[1]) > 3.5
