"""Published robots' files: each loads as it is, or is refused by its true name.

The files are data beside the checkout (`../shared/robots`, or where ROBUST_GCP_ROBOTS says); without them
these tests are skipped.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf
from robust_gcp.mechanism.loops import ClosedLoops
from robust_gcp.reports.robots import files_below, tried

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
pytestmark = [
    pytest.mark.skipif(not ROBOTS.is_dir(), reason="the folder of robots' files is not here"),
    pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning"),
]


class Loaded(NamedTuple):
    """Velocities, rows of φ that are kept, and mobility."""

    nv: int
    nc: int
    m: int


LOADING = {
    "agility_cassie/cassie.xml": Loaded(32, 12, 22),
    "drake_strandbeest/StrandbeestConstraints.urdf": Loaded(79, 108, 7),
    "gepetto/5bar_linkage": Loaded(6, 3, 3),
    "gepetto/5bar_linkage_iso6d": Loaded(8, 6, 2),
    "gepetto/cassie_like": Loaded(19, 12, 7),
    "gepetto/digit_like_2legs": Loaded(48, 36, 12),
    "grbda/four_bar.urdf": Loaded(3, 2, 1),
    "grbda/parallel_chains/depth10/loop_size5.urdf": Loaded(21, 2, 19),
    "grbda/parallel_chains/depth5/loop_size11.urdf": Loaded(11, 2, 9),
    "grbda/parallel_chains/depth5/loop_size3.urdf": Loaded(11, 2, 9),
    "grbda/planar_leg_linkage.urdf": Loaded(4, 2, 2),
    "grbda/six_bar.urdf": Loaded(5, 2, 3),
    "grbda/tello_humanoid.urdf": Loaded(42, 0, 42),
    "newton_boxes_fourbar": Loaded(3, 2, 1),
    "reachy_mini/reachy_mini.xml": Loaded(30, 15, 15),
    "reachy_mini/robot_no_collision.urdf": Loaded(30, 15, 15),
    "robotiq_2f85/2f85.xml": Loaded(8, 5, 3),
    "toddlerbot/toddlerbot.xml": Loaded(62, 30, 38),
}
REFUSED: dict[str, tuple[type[Exception], str]] = {
    "gepetto/disney_robot": (rg.ModelError, "'left_spherical_free_foot', which the URDF does not have"),
    "gepetto/kangaroo_like_2legs": (rg.ClosureError, r"home: the loop closedloop\d+_.* is open by .* m \("),
}
UNREADABLE = ("disney_robot", "kangaroo_like", "kangaroo_like_2legs", "four_bar.sdf")
"""A joint that is not there, loops that no configuration closes, a loop that a program closes."""

FLOATING = ("drake_strandbeest/StrandbeestConstraints.urdf", "grbda/tello_humanoid.urdf")
"""They stand on nothing and fall."""

SPAN = 0.016
"""s of a thrown robot."""


@pytest.fixture(scope="module")
def robots() -> Any:
    """Each file loaded once."""
    known: dict[str, rg.Mechanism] = {}

    def robot(file: str) -> rg.Mechanism:
        if file not in known:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", rg.ModelWarning)
                known[file] = rg.load(ROBOTS / file)
        return known[file]

    return robot


@pytest.mark.parametrize("file", LOADING)
def test_files_load_closed(file: str, robots: Any) -> None:
    """Without any argument; home is closed to rounding and the coordinates parametrise the motion there."""
    mech: rg.Mechanism = robots(file)
    assert (mech.nv, mech.nc, mech.m) == LOADING[file]
    assert mech.closure_residual(mech.home) < 1e-12
    G = mech.G(mech.home)
    K = mech.scaled(mech.K(mech.home))
    assert np.abs(K @ (G.T / mech.column_scale).T).max(initial=0.0) < 1e-9 * max(np.abs(G).max(), 1.0)


@pytest.mark.parametrize("file", REFUSED)
def test_files_that_cannot_load_are_refused_by_name(file: str) -> None:
    kind, message = REFUSED[file]
    with pytest.raises(kind, match=message):
        rg.load(ROBOTS / file)


@pytest.mark.parametrize("file", FLOATING)
def test_floating_bases_fall_freely(file: str, robots: Any) -> None:
    """From rest the base drops by g t²/2, as the loops stay closed and nothing turns."""
    mech: rg.Mechanism = robots(file)
    motion = rg.simulate(mech, duration=0.05, step=1e-3)
    fall = motion.q[-1] - motion.q[0]
    assert motion.closure_error().max() < 1e-10
    np.testing.assert_allclose(fall[:3], 0.5 * 0.05**2 * mech.model.gravity.linear, atol=1e-12)
    np.testing.assert_allclose(fall[3:], 0.0, atol=1e-10)


@pytest.mark.parametrize("file", list(files_below(ROBOTS)), ids=lambda file: str(file.relative_to(ROBOTS)))
def test_files_run_as_they_are(file: Path) -> None:
    """0.3 s from a random velocity: loops stay closed, the energy error falls with h⁴ or is rounding."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        entry = tried(file, str(file), 0.3, None)
    assert entry.verdict == ("refused" if file.name in UNREADABLE else "runs"), entry.why
    assert entry.verdict == "refused" or entry.closure < 1e-12


@pytest.mark.parametrize(
    ("file", "step", "most"),
    [("gepetto/digit_like_2legs", 5e-4, 5e-5), ("robotiq_2f85/2f85.xml", 1e-3, 1e-5)],
)
def test_energy_falls_with_the_order_where_joints_turn_back_fast(
    file: str, step: float, most: float, robots: Any
) -> None:
    run, finer = (rg.simulate(robots(file), duration=0.3, step=h) for h in (step, step / 2.0))
    assert run.stats.repartitions
    error, less = (float(np.abs(r.energy_error()).max()) for r in (run, finer))
    assert error < most
    assert less < error / 10.0


def test_a_trial_beyond_a_toggle_is_taken_back_to_where_the_solver_began(robots: Any) -> None:
    """The first trial in coordinates just taken leaps over a place where these turn back themselves."""
    robot = robots("reachy_mini/robot_no_collision.urdf")
    run = rg.simulate(robot, duration=0.1, stepper="DOP853", rtol=1e-10, atol=1e-12)
    assert run.stats.repartitions
    assert np.abs(run.energy_error()).max() < 1e-9


def test_a_fixed_base_runs_what_a_floating_one_does_not() -> None:
    mech = rg.load(ROBOTS / "toddlerbot/toddlerbot.xml", base="fixed")
    assert mech.nv == 62 - 6
    assert mech.closure_residual(mech.home) < 1e-12


def test_motors_are_kept_and_completed(robots: Any) -> None:
    mech: rg.Mechanism = robots("gepetto/cassie_like")
    motors = ("motor_hip1", "motor_hip2", "motor_tigh", "motor_knee", "motor_ankle")
    assert mech.actuated == mech.independent[:5] == motors
    cassie: rg.Mechanism = robots("agility_cassie/cassie.xml")
    assert len(cassie.actuated) == 10
    assert sum(name.startswith("torso_free.") for name in cassie.independent) == 6
    idle = [name for name in cassie.independent if "achilles" in name]
    assert len(idle) == 2  # one component of each rod's ball: it spins idly
    assert [cluster.m for cluster in cassie.clusters] == [4, 1, 4, 1]  # a leg's loops share no joint


def test_what_is_left_out_is_told() -> None:
    file = ROBOTS / "reachy_mini" / "reachy_mini.xml"
    with pytest.warns(rg.ModelWarning, match=r"not simulated: dry friction of joints \(yaw_body") as caught:
        mech = rg.load(file)
    assert len(caught) == 1
    told = [part.partition(" (")[0] for part in mech.left_out]
    assert told == ["dry friction of joints", "limits of joints", "contacts of bodies"]
    with pytest.raises(rg.ModelError, match=r"strict=True.*limits of joints"):
        rg.load(file, strict=True)
    assert rg.load(ROBOTS / "newton_boxes_fourbar", strict=True).left_out == ()


def test_a_heavy_linkage_with_light_links_runs_without_a_step(robots: Any) -> None:
    """654 t on a link of 25 kg that whips as it stretches: at 1 ms no branch is found; energy in J of 1e5."""
    mech: rg.Mechanism = robots("gepetto/5bar_linkage")
    with pytest.raises(rg.BranchError):
        rg.simulate(mech, duration=0.1, step=1e-3)
    with pytest.warns(rg.CoarseStepWarning, match="no step was named"):
        run = rg.simulate(mech, duration=0.1)
    assert run.closure_error().max() < 1e-13
    kinetic = max(mech.tree.kinetic(q, v) for q, v in zip(run.q, run.v, strict=True))
    assert np.abs(run.energy_error()).max() < 1e-6 * kinetic


def test_floating_cassie_keeps_its_momentum_and_the_order(robots: Any) -> None:
    """Thrown without gravity, its springs at work: order 4, closed loops, momentum to the stepper's error."""
    cassie: rg.Mechanism = robots("agility_cassie/cassie.xml")
    model = cassie.model.copy()
    model.gravity.linear = np.zeros(3)
    springs = [force for force in cassie.forces if isinstance(force, rg.JointSpring)]
    assert len(springs) >= 4
    mech = rg.Mechanism.from_pinocchio(
        model, cassie.closures, cassie.independent, home=cassie.home, forces=springs
    )
    v = mech.lift(mech.home, 2.0 * np.random.default_rng(0).normal(size=mech.m))

    def momentum(q: Any, v: Any) -> Any:
        data = model.createData()
        h = pin.computeCentroidalMomentum(model, data, q, v)
        return np.concatenate([h.linear, h.angular + np.cross(data.com[0], h.linear)])

    begun, errors, drifts = momentum(mech.home, v), [], []
    exact = rg.simulate(mech, v0=v, duration=SPAN, step=SPAN, stepper="DOP853", rtol=1e-12, atol=1e-14)
    for steps in (16, 32, 64):
        run = rg.simulate(mech, v0=v, duration=SPAN, step=SPAN / steps)
        assert run.closure_error().max() < 1e-13
        turned = np.abs(mech.tree.difference(run.q[-1], exact.q[-1])).max()
        errors.append(max(turned, np.abs(run.v[-1] - exact.v[-1]).max()))
        drifts.append(np.abs(momentum(run.q[-1], run.v[-1]) - begun).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.1)
    assert drifts[-1] < errors[-1]


# --------------------------------------------------------------------------- MuJoCo's own reading

MJCF = (
    "agility_cassie/cassie.xml",
    "reachy_mini/reachy_mini.xml",
    "toddlerbot/toddlerbot.xml",
)


@pytest.mark.parametrize("file", MJCF)
def test_trees_are_those_that_mujoco_reads(file: str, robots: Any) -> None:
    """Body poses, total mass, M and gravity's torques at random configurations, meshes left out in both."""
    theirs = mujoco.MjModel.from_xml_string(without_meshes((ROBOTS / file).read_text(encoding="utf-8")))
    mech: rg.Mechanism = robots(file)
    model, state, rng = mech.model, mujoco.MjData(theirs), np.random.default_rng(0)
    assert theirs.nv == mech.nv
    data = model.createData()
    for _ in range(2):
        q = pin.integrate(model, mech.home, rng.uniform(-0.5, 0.5, mech.nv))
        state.qpos[:] = mujoco_order(mech, q)
        mujoco.mj_forward(theirs, state)
        pin.framesForwardKinematics(model, data, q)
        bodies = {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
        for body in range(1, theirs.nbody):
            name = theirs.body(body).name
            if name in bodies:
                pose = data.oMf[bodies[name]]
                np.testing.assert_allclose(pose.translation, state.xpos[body], atol=1e-12)
                np.testing.assert_allclose(pose.rotation.ravel(), state.xmat[body], atol=1e-12)
        turn = np.eye(mech.nv)  # a free body's linear velocity is in world axes there
        for joint in (j for j in mech.joints if j.type == "JointModelFreeFlyer"):
            at = slice(joint.idx_v, joint.idx_v + 3)
            turn[at, at] = data.oMi[joint.index].rotation
        M = np.zeros((mech.nv, mech.nv))
        for row, direction in zip(M, turn.T, strict=True):
            mujoco.mj_mulM(theirs, state, row, direction.copy())
        ours = pin.crba(model, data, q)
        np.testing.assert_allclose(M @ turn, np.triu(ours) + np.triu(ours, 1).T, atol=1e-9)
        weight = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(turn.T @ state.qfrc_bias, weight, atol=1e-9)


@pytest.mark.parametrize("file", MJCF)
def test_loops_are_those_that_mujoco_reads(file: str, robots: Any) -> None:
    """Row space of K beside home: MuJoCo's Jacobian of the active equalities."""
    theirs = mujoco.MjModel.from_xml_string(without_meshes((ROBOTS / file).read_text(encoding="utf-8")))
    theirs.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    mech: rg.Mechanism = robots(file)
    state = mujoco.MjData(theirs)
    contents = read_mjcf(ROBOTS / file)
    loops = ClosedLoops(contents.model, contents.closures)
    q = pin.integrate(mech.model, mech.home, np.random.default_rng(1).uniform(-0.2, 0.2, mech.nv))
    state.qpos[:] = mujoco_order(mech, q)
    mujoco.mj_forward(theirs, state)
    equal = state.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    J = state.efc_J.reshape(-1, mech.nv)[equal]
    pin.forwardKinematics(mech.model, mech.model.createData(), q)
    K = loops.K(q)
    for joint in (j for j in mech.joints if j.type == "JointModelFreeFlyer"):  # loops do not see the base
        J = np.delete(J, range(joint.idx_v, joint.idx_v + 6), axis=1)
        K = np.delete(K, range(joint.idx_v, joint.idx_v + 6), axis=1)
    kernel = np.linalg.svd(K)[2][np.linalg.matrix_rank(K, tol=1e-8) :]
    assert np.linalg.matrix_rank(J, tol=1e-8) == np.linalg.matrix_rank(K, tol=1e-8)
    assert np.abs(J @ kernel.T).max() < 1e-9


def without_meshes(text: str) -> str:
    """The document without meshes and materials, whose files are not there, and pairs of them."""
    root = ElementTree.fromstring(text)
    for section in [*root.findall("asset"), *root.findall("contact")]:
        root.remove(section)
    for parent in list(root.iter()):
        for child in list(parent):
            child.attrib.pop("material", None)
            if child.tag == "mesh" or child.get("mesh") is not None or child.get("type") == "mesh":
                parent.remove(child)
    return ElementTree.tostring(root, encoding="unicode")


def mujoco_order(mech: rg.Mechanism, q: Any) -> Any:
    """Quaternions with their scalar first."""
    q = q.copy()
    for joint in mech.joints:
        if joint.nq in (4, 7):
            end = joint.idx_q + joint.nq
            q[end - 4 : end] = np.roll(q[end - 4 : end], 1)
    return q
