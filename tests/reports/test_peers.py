"""Other tools as contenders: the same mechanism, the tool's known order, and failures as outcomes.

Each tool is held to our own equations first: the same initial accelerations (mass, gravity, springs,
Coriolis terms) and, on mechanisms whose motion meets no singularity, convergence at its own order to the
same motion. A tool that is not installed is skipped with the sentence that the study prints.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import meetings
from robust_gcp.kernel import build
from robust_gcp.kernel.build import BuildError
from robust_gcp.reports import peers
from robust_gcp.reports.contender import Contender, Scene, division, reached
from robust_gcp.reports.peers import compiled, parts, pinocchio
from robust_gcp.reports.work_precision.ours import nearest

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]

MODELS = ("crank_rocker", "andrews", "bricard", "flyball")
"""A planar loop, three loops with a spring and a drive, a spatial loop with a row too many, a tree."""


def needs(package: str) -> pytest.MarkDecorator:
    sentence = next((s for s in peers.missing() if package in s), "")
    return pytest.mark.skipif(find_spec(package) is None, reason=sentence)


built = pytest.mark.skipif(
    not compiled.path().exists(),
    reason="Pinocchio's loop is not built: python -m robust_gcp.reports.peers.compiled",
)


def contender(name: str) -> Contender:
    found = {c.name: c for c in peers.contenders()}
    return found[name]


@functools.cache
def control(name: str) -> tuple[Scene, Array]:
    """A short regular motion, and its q by an adaptive stepper, which no peer uses."""
    mechanism = rg.load(name)
    duration = {"andrews": 0.01, "flyball": 0.05}.get(name, 1.0)
    v0 = np.zeros(mechanism.nv)
    if name == "flyball":
        v0[mechanism.joint_names.index("shaft")] = 2.0 * np.pi
    times = np.linspace(0.0, duration, 41)
    stepper, rtol = ("Radau", 1e-11) if name == "flyball" else ("DOP853", 1e-13)
    run = rg.simulate(
        mechanism, v0=v0, duration=duration, step=times[1], stepper=stepper, rtol=rtol, atol=1e-14
    )
    np.testing.assert_allclose(run.t, times, atol=1e-12)
    return Scene(name, mechanism, run.q[0], run.v[0], times), run.q


def states_of(mechanism: rg.Mechanism, closed_states: States) -> list[tuple[Array, Array]]:
    """Closed configurations with velocities; any will do for a tree."""
    if mechanism.closures:
        return closed_states(mechanism, 3)
    rng = np.random.default_rng(5)
    return [
        (mechanism.home + rng.uniform(-0.1, 0.1, mechanism.nq), rng.uniform(-1.0, 1.0, mechanism.nv))
        for _ in range(3)
    ]


def errors(peer: Contender, name: str, divisions: tuple[int, ...]) -> Array:
    """Largest error of a joint over all outputs, for each number of steps between them."""
    scene, q = control(name)
    found = []
    for count in divisions:
        outcome = peer.run(scene, scene.times[1] / count)
        assert not outcome.stopped
        assert outcome.rhs >= 40 * count
        assert outcome.seconds > 0.0
        assert outcome.q.shape == outcome.v.shape == q.shape
        found.append(np.abs(outcome.q - q).max())
    return np.array(found)


def orders(found: Array) -> Array:
    """Of successive halvings of the step."""
    return np.log2(found[:-1] / found[1:])


# --------------------------------------------------------------------------- what they all share


def test_the_tools_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "find_spec", lambda package: package == "pinocchio" or None)
    assert [c.family for c in peers.contenders()] == ["Pinocchio"] * 7
    mujoco, exudyn = peers.missing()
    assert mujoco.startswith("MuJoCo") and ".[bench]" in mujoco
    assert exudyn.startswith("Exudyn") and "pip install exudyn" in exudyn


def test_names_are_unique_and_the_tuning_is_stated() -> None:
    found = peers.contenders()
    assert len({c.name for c in found}) == len(found)
    assert all(c.tuning and c.kind == "fixed" for c in found)


@pytest.mark.parametrize(("step", "count"), [(0.025, 1), (0.024, 1), (0.009, 3), (1.0, 1), (1e-4, 250)])
def test_steps_divide_the_spacing_of_the_outputs(step: float, count: int) -> None:
    scene, _ = control("crank_rocker")
    number, h = division(scene, step)
    assert number == count
    assert number * h == pytest.approx(0.025, rel=1e-14)


def test_a_blown_up_state_is_not_kept() -> None:
    scene, _ = control("crank_rocker")
    good = scene.q0, scene.v0
    for bad in (np.nan, np.inf, 1e9):
        outcome = reached(scene, [good, (scene.q0, np.full(3, bad)), good], 1.0, 8, "it blew up")
        assert outcome.stopped == "it blew up before t = 0.05 s"
        assert len(outcome.q) == len(outcome.v) == 2


def test_parts_are_the_model() -> None:
    """Closures hold together what is together at home; drives are those of the file."""
    andrews = rg.load("andrews")
    data = andrews.own_model.createData()
    pin.forwardKinematics(andrews.own_model, data, andrews.home)
    for pair in parts.closure_places(andrews):
        one, two = (data.oMi[joint].act(place.translation) for joint, place in pair)
        np.testing.assert_allclose(one, two, atol=1e-12)
    torques = parts.constant_torques(andrews)
    assert torques[andrews.joint_names.index("beta")] == 0.033
    assert np.count_nonzero(torques) == 1


def test_nothing_is_run_that_the_adapter_does_not_know() -> None:
    """A platform that floats on massless joints and a ball are for Pinocchio alone: others say why not."""
    times = np.linspace(0.0, 0.1, 3)
    stewart, model = rg.load("stewart"), pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    ball = rg.Mechanism.from_pinocchio(model)
    for mechanism, known in ((stewart, ("Pinocchio", "MuJoCo")), (ball, ("Pinocchio",))):
        scene = Scene("", mechanism, mechanism.home, np.zeros(mechanism.nv), times)
        for peer in peers.contenders():
            if peer.family not in known:
                assert "adapter" in peer.refuses(scene)
            elif peer.family == "MuJoCo":
                assert "MuJoCo takes no moving bodies without mass" in peer.refuses(scene)
    coupled = rg.Mechanism.from_pinocchio(
        rg.load("five_bar").model, [rg.CouplingClosure("q1", "q3", -1.0)], ["q1", "q2", "q4"]
    )
    scene = Scene("coupled", coupled, coupled.home, np.zeros(coupled.nv), times)
    assert "closes points, frames and hinges" in contender("Pinocchio, tuned").refuses(scene)


@built
def test_what_the_adapters_know_is_run() -> None:
    for name in MODELS:
        told = {peer.name: peer.refuses(control(name)[0]) for peer in peers.contenders(lambda _: np.zeros(0))}
        if name == "flyball":  # without loops there is one Pinocchio only
            others = [n for n in told if n.startswith("Pinocchio") and n != "Pinocchio, defaults"]
            assert all("no loop" in told.pop(n) for n in others)
        assert not any(told.values())
    assert "exact" in contender("Pinocchio, scanned").refuses(control("crank_rocker")[0])


# --------------------------------------------------------------------------- Pinocchio


@pytest.fixture
def build_anew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty cache of libraries, and nothing remembered of the one that was built."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for cached in (compiled.library, compiled.why_not):
        monkeypatch.setattr(compiled, cached.__name__, cached.__wrapped__)
    monkeypatch.setattr(pinocchio, "why_not", compiled.why_not)
    return tmp_path


@pytest.mark.usefixtures("build_anew")
def test_a_loop_that_cannot_be_built_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """No contender is run, and each says why: no such compiler."""
    monkeypatch.setenv("CXX", "no-such-compiler")
    told = contender("Pinocchio, tuned").refuses(control("crank_rocker")[0])
    assert told == "Pinocchio's loop in C++ is not there: CXX=no-such-compiler is not there"
    assert compiled.main() == 1


def test_a_loop_without_a_folder_to_write_to_is_told(build_anew: Path) -> None:
    try:
        build.headers(*compiled.HEADERS)
    except BuildError as error:
        pytest.skip(str(error))
    (build_anew / "robust_gcp").touch()
    with pytest.raises(BuildError, match="XDG_CACHE_HOME names another folder"):
        compiled.make()


@built
@pytest.mark.parametrize("name", [*MODELS, "stewart"])
def test_pinocchio_has_our_accelerations(name: str, closed_states: States) -> None:
    """Hinges about all axes, slides, a free-flyer; points, a hinge; springs on joints and lines, drives."""
    mechanism = rg.load(name)
    how = compiled.Settings("constraintDynamics" if mechanism.closures else "aba", accuracy=1e-14)
    loop = pinocchio.loop(mechanism)
    for q, v in states_of(mechanism, closed_states):
        a, _ = rg.implicit_dynamics(mechanism, q, v)
        np.testing.assert_allclose(loop.acceleration(q, v, how), a, atol=1e-8 * np.abs(a).max())


@built
def test_lcaba_is_right_to_its_regularisation(closed_states: States) -> None:
    mechanism = rg.load("crank_rocker")
    for q, v in closed_states(mechanism, 3):
        a, _ = rg.implicit_dynamics(mechanism, q, v)
        found = pinocchio.loop(mechanism).acceleration(q, v, compiled.Settings("lcaba"))
        np.testing.assert_allclose(found, a, atol=1e-5 * np.abs(a).max())


@built
def test_pinocchio_closes_a_hinge_by_two_points() -> None:
    """Opened by δ about a normal of the axis, Baumgarte's terms alone pull back: −ω² φ − 2 ω φ̇."""
    mechanism = rg.load("bricard")
    q, v = mechanism.home.copy(), np.zeros(5)
    q[4] += 1e-6
    free, held = (
        pinocchio.loop(mechanism).acceleration(q, v, compiled.Settings(omega=omega, accuracy=1e-14))
        for omega in (0.0, 100.0)
    )
    pull = held - free
    wanted = -(100.0**2) * mechanism.phi(q)
    K = mechanism.K(q)
    # rank 4 of 5: compare where K can reach; the pull is of first order in φ, as are its errors
    np.testing.assert_allclose(K @ pull, K @ np.linalg.pinv(K, rcond=1e-4) @ wanted, atol=1e-3 * 1e-2)


@built
def test_gains_of_the_scan_err_least() -> None:
    """No other rule with the same step errs less; finer steps than are scanned take the finest one's rule."""
    scene, q = control("crank_rocker")
    best = next(c for c in peers.contenders(lambda _: q) if c.name == "Pinocchio, scanned")
    for name in ("Pinocchio, mu > 0", "Pinocchio, 0.2/h"):
        for count in (1, 4):
            ours, other = (
                np.abs(c.run(scene, scene.times[1] / count).q - q).max() for c in (best, contender(name))
            )
            assert ours <= other
    assert np.abs(best.run(scene, scene.times[1] / 32).q - q).max() < 1e-10


@built
@pytest.mark.parametrize("name", ["crank_rocker", "andrews", "bricard"])
@pytest.mark.parametrize("peer", ["Pinocchio, mu > 0", "Pinocchio, tuned"])
def test_pinocchio_has_order_four(name: str, peer: str) -> None:
    """RK4, also with the tuned gains, which tie the order to steps below 0.5/ω = T/400."""
    divisions = {"Pinocchio, mu > 0": (2, 4, 8), "Pinocchio, tuned": (16, 32, 64)}[peer]
    if name == "andrews":
        divisions = (4, 8, 16) if "mu" in peer else (32, 64)
    found = errors(contender(peer), name, divisions)
    assert orders(found)[-1] > 3.6
    assert found[-1] < 1e-6


@built
def test_pinocchio_steps_a_tree_with_springs() -> None:
    found = errors(contender("Pinocchio, defaults"), "flyball", (8, 16))
    assert found[-1] < 1e-8


@built
def test_pinocchio_with_its_defaults_stops_on_a_planar_loop() -> None:
    """mu = 0 with a row that is zero in every configuration: NaN at once, told and not raised."""
    scene, _ = control("crank_rocker")
    outcome = contender("Pinocchio, defaults").run(scene, 0.01)
    assert outcome.stopped == "the state left the finite numbers before t = 0.025 s"
    assert len(outcome.q) == 1


# --------------------------------------------------------------------------- MuJoCo


@needs("mujoco")
@pytest.mark.parametrize("name", MODELS)
def test_mujoco_has_our_accelerations_but_for_its_softness(name: str, closed_states: States) -> None:
    """MuJoCo's constraints give way by R = (1 − d)/d: its error is proportional to it, so nothing else errs.

    From d = 0.999 to 0.9999 it falls ten times; without closures it is rounding, the thin rods' included.
    """
    import mujoco

    from robust_gcp.reports.peers.mujoco import compiled

    mechanism = rg.load(name)
    model = compiled(mechanism, "RK4", True)
    data = mujoco.MjData(model)
    for q, v in states_of(mechanism, closed_states):
        a, _ = rg.implicit_dynamics(mechanism, q, v)
        off = []
        for d in (0.999, 0.9999):
            model.eq_solimp[:, :2] = d
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_forward(model, data)
            off.append(np.abs(data.qacc - a).max() / np.abs(a).max())
        if mechanism.closures:
            assert off[1] < 1e-2
            assert off[0] / off[1] == pytest.approx(10.0, rel=0.2)
        else:
            assert off[1] < 1e-9


@needs("mujoco")
@pytest.mark.parametrize("name", ["crank_rocker", "andrews", "bricard"])
def test_mujoco_tuned_has_order_two(name: str) -> None:
    """RK4, but the constraints' sag R f/k falls with their time constant squared, that is with h²."""
    found = errors(contender("MuJoCo connect, tuned"), name, (4, 8, 16))
    assert orders(found)[-1] > 1.6
    assert found[-1] < 1e-5


@needs("mujoco")
def test_mujoco_without_loops_has_order_four() -> None:
    found = errors(contender("MuJoCo connect, tuned"), "flyball", (8, 16))
    assert found[-1] < 1e-8


@needs("mujoco")
@pytest.mark.parametrize("peer", ["MuJoCo connect, defaults", "MuJoCo connect, implicitfast"])
def test_mujocos_other_integrators_have_order_one(peer: str) -> None:
    found = errors(contender(peer), "bricard", (4, 8, 16))
    assert 0.7 < orders(found)[-1] < 1.6


@needs("mujoco")
def test_mujoco_blows_up_quietly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """RK4 beyond its stability limit on stiff dampers: an outcome, no message, no log file, no reset."""
    monkeypatch.chdir(tmp_path)
    scene, _ = control("flyball")
    outcome = contender("MuJoCo connect, tuned").run(scene, scene.times[1])
    assert outcome.stopped.startswith("the state left the finite numbers before t = ")
    assert 1 <= len(outcome.q) < 41
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


@needs("mujoco")
def test_mujoco_takes_springs_and_dampers_of_joints() -> None:
    """Two springs and a damper on a hinge, as MuJoCo's own: our accelerations."""
    import mujoco

    from robust_gcp.reports.peers.mujoco import compiled

    bare = rg.load("flyball")
    forces = [
        rg.JointSpring("alpha1", 30.0, 0.2),
        rg.JointSpring("alpha1", 10.0, -0.4),
        rg.JointDamper("s", 3.0),
    ]
    mechanism = rg.Mechanism.from_pinocchio(bare.model, home=bare.home, forces=forces)
    v = np.array([1.0, -2.0, 0.5, 0.3])
    model = compiled(mechanism, "RK4", True)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = bare.home, v
    mujoco.mj_forward(model, data)
    a, _ = rg.implicit_dynamics(mechanism, bare.home, v)
    np.testing.assert_allclose(data.qacc, a, rtol=1e-9, atol=1e-9)


@needs("mujoco")
def test_mujoco_takes_floating_bases() -> None:
    """A linkage on a thrown body, its joint placed askew: our motion at its order; states back and forth."""
    from robust_gcp.examples.families import four_bars
    from robust_gcp.reports.peers.mujoco import Bases

    plain = four_bars(
        [(4.0, 1.0, 3.5, 3.0)], [1.0], floating=pin.Inertia(3.0, np.zeros(3), np.diag([0.6, 0.4, 0.5]))
    )
    model = plain.model.copy()
    model.jointPlacements[1] = pin.SE3(pin.exp3(np.array([0.3, -0.8, 0.5])), np.array([1.0, 2.0, 3.0]))
    mechanism = rg.Mechanism.from_pinocchio(
        model, plain.closures, independent=plain.independent, home=plain.home
    )
    q = pin.integrate(
        mechanism.model, mechanism.home, np.concatenate([[0.3, -0.2, 0.5, 1.0, -0.7, 2.0], np.zeros(3)])
    )
    ydot = np.array([0.5, -0.3, 1.0, 0.4, 0.6, -0.8, 0.9])
    v = mechanism.lift(q, ydot)
    bases = Bases(mechanism)
    for ours, again in zip((q, v), bases.ours(*bases.theirs(q, v)), strict=True):
        assert min(np.abs(ours - again).max(), np.abs(np.abs(ours) - np.abs(again)).max()) < 1e-14
    times = np.linspace(0.0, 0.4, 21)
    scene = Scene("thrown", mechanism, q, v, times)
    run = rg.simulate(mechanism, q, v, duration=0.4, step=2e-3)
    exact = run.q[::10]
    found = []
    for count in (8, 16, 32):
        outcome = contender("MuJoCo connect, tuned").run(scene, times[1] / count)
        assert not outcome.stopped
        sign = np.sign(np.sum(outcome.q[:, 3:7] * exact[:, 3:7], axis=1))[:, None]
        off = outcome.q - exact
        off[:, 3:7] = outcome.q[:, 3:7] * sign - exact[:, 3:7]
        found.append(np.abs(off).max())
        assert np.abs(outcome.v[-1] - run.v[-1]).max() < 1e3 * found[-1] + 1e-6
    assert orders(np.array(found))[-1] > 1.6
    assert found[-1] < 1e-4


STOPPED = rg.Stop("q1", upper=1.8, restitution=0.5), rg.JointFriction("q3", bound=0.5)


@needs("mujoco")
def test_mujoco_takes_stops_and_dry_friction() -> None:
    """It tends to our motion, which has an impact, as softness goes; others say that they have neither."""
    mechanism, times = rg.load("crank_rocker"), np.linspace(0.0, 0.6, 401)
    v0 = mechanism.lift(mechanism.home, [5.0])
    run = rg.simulate(mechanism, v0=v0, duration=0.6, step=1.5e-3, joints=list(STOPPED))
    assert [x.kind for x in run.happenings][:1] == ["impact"]
    q = run.q[nearest(run.t, times)]
    scene = Scene("crank_rocker", mechanism, run.q[0], run.v[0], times, STOPPED)
    tool = contender("MuJoCo connect, tuned")
    errors = [np.abs(tool.run(scene, 1.5e-3 / parts).q - q).max() for parts in (10, 40, 160)]
    assert errors[2] < 0.5 * errors[1] < 0.25 * errors[0] < 0.1
    for other in peers.contenders():
        assert (other.refuses(scene) == "") == (other.family == "MuJoCo")


@needs("mujoco")
def test_mujoco_takes_couplings_and_exudyns_adapter_does_not() -> None:
    mechanism, times = meetings.cusp_cam(0.1), np.linspace(0.0, 0.02, 401)
    v0 = mechanism.lift(mechanism.home, [-1.0])
    run = rg.simulate(mechanism, v0=v0, duration=0.02, step=5e-5)
    scene = Scene("cam", mechanism, run.q[0], run.v[0], times)
    errors = [
        np.abs(contender("MuJoCo connect, tuned").run(scene, 5e-5 / parts).q - run.q).max()
        for parts in (1, 4)
    ]
    assert errors[1] < 0.3 * errors[0] < 1e-3
    for other in peers.contenders():
        assert (other.refuses(scene) == "") == (other.family == "MuJoCo")


@needs("mujoco")
def test_mujoco_refuses_closures_of_frames(spatial: dict[str, rg.Mechanism]) -> None:
    mechanism = spatial["seven hinges"]
    scene = Scene("ring", mechanism, mechanism.home, np.zeros(7), np.linspace(0.0, 0.1, 3))
    assert "whole frames" in contender("MuJoCo connect, tuned").refuses(scene)


# --------------------------------------------------------------------------- Exudyn


@needs("exudyn")
@pytest.mark.parametrize("name", MODELS)
def test_exudyn_has_our_accelerations(name: str, closed_states: States) -> None:
    from robust_gcp.reports.peers import exudyn
    from robust_gcp.reports.peers.exudyn_models import exu

    mechanism = rg.load(name)
    for q, v in states_of(mechanism, closed_states):
        scene = Scene(name, mechanism, q, v, np.linspace(0.0, 1e-6, 3))
        with exudyn.quiet():
            built: Any = (exudyn.PlanarBodies if name in MODELS[:2] else exudyn.KinematicTree)(scene)
            solver = exu.MainSolverImplicitSecondOrder()
            settings = exudyn.DEFAULTS.settings(scene, 1, 5e-7, built.linear_solver)
            solver.InitializeSolver(built.mbs, settings)
            solver.SolveSteps(built.mbs, settings)
            solver.FinalizeSolver(built.mbs, settings)
        q0, v0, a0 = (x[0] for x in built.tree_coordinates(exudyn.stored(built)[1]))
        np.testing.assert_allclose(q0, q, atol=1e-13)
        np.testing.assert_allclose(v0, v, atol=1e-13 * max(1.0, np.abs(v).max()))
        a, _ = rg.implicit_dynamics(mechanism, q, v)
        np.testing.assert_allclose(a0, a, atol=1e-8 * np.abs(a).max())


@needs("exudyn")
def test_exudyn_knows_what_is_planar() -> None:
    from robust_gcp.reports.peers.exudyn import is_planar

    assert [is_planar(control(name)[0]) for name in MODELS] == [True, True, False, False]


@needs("exudyn")
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("peer", ["Exudyn generalised-alpha", "Exudyn trapezoidal, index 2"])
def test_exudyn_has_order_two(name: str, peer: str) -> None:
    found = errors(contender(peer), name, (2, 4, 8))
    assert orders(found)[-1] == pytest.approx(2.0, abs=0.3)
    assert found[-1] < 1e-2 * np.abs(control(name)[1]).max()


@needs("exudyn")
def test_exudyn_goes_through_the_rhombus() -> None:
    """Where a peer does well: position constraints and an implicit rule keep the mode and the order."""
    mechanism = rg.load("rhombus")
    run = rg.simulate(mechanism, duration=3.0, step=0.05, stepper="DOP853", rtol=1e-11, atol=1e-13)
    assert run.crossings
    scene = Scene("rhombus", mechanism, run.q[0], run.v[0], run.t)
    peer = contender("Exudyn generalised-alpha")
    found = np.array([np.abs(peer.run(scene, 0.05 / n).q - run.q).max() for n in (8, 16)])
    assert orders(found)[0] == pytest.approx(2.0, abs=0.3)


@needs("exudyn")
def test_exudyn_fails_quietly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Steps of half a swing: Newton's iterations fail, and nothing is printed or written."""
    monkeypatch.chdir(tmp_path)
    mechanism = rg.load("rhombus")
    scene = Scene("rhombus", mechanism, mechanism.home, np.zeros(3), np.linspace(0.0, 40.0, 41))
    outcome = contender("Exudyn trapezoidal, index 2").run(scene, 1.0)
    assert "before t = " in outcome.stopped
    assert len(outcome.q) < 41
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


@needs("exudyn")
def test_states_kept_late_are_brought_back_by_their_series() -> None:
    """Exact where the acceleration is constant; states kept in time stay as they are to the last bit."""
    from robust_gcp.reports.peers.exudyn import at_times

    times = np.linspace(0.0, 1.0, 5)
    late = times + np.array([0.0, 0.0, 0.03, 0.01, 0.0])

    def motion(t: Array) -> tuple[Array, Array, Array]:
        t = t[:, None]
        return 1.0 + 2.0 * t - 1.5 * t**2, 2.0 - 3.0 * t, np.full_like(t, -3.0)

    q, v = at_times(times, late, *motion(late))
    wanted = motion(times)
    np.testing.assert_allclose(q, wanted[0], atol=1e-14)
    np.testing.assert_allclose(v, wanted[1], atol=1e-14)
    assert np.array_equal(q[[0, 1, 4]], wanted[0][[0, 1, 4]])


# --------------------------------------------------------------------------- the scan


@built
def test_the_scan_scores_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten times the accuracy is one digit; a run that stops has none."""
    from robust_gcp.reports.peers import scan

    scene, q = control("crank_rocker")
    good, bad = contender("Pinocchio, mu > 0"), contender("Pinocchio, defaults")
    found = scan.score(good, [(scene, q)], [(scene, q)], (4,))
    expected = -np.log10(np.abs(good.run(scene, scene.times[1] / 4).q - q).max())
    assert found.regular == found.singular == pytest.approx(expected)
    assert (found.stopped, found.runs) == (0, 2)
    none = scan.score(bad, [(scene, q)], [(scene, q)], (4,))
    assert (none.regular, none.stopped) == (0.0, 2)
    names = {c.name for c in scan.pinocchio_candidates()}
    assert len(names) == 15
    steps = [c.omega(scene, 1e-3) for c in scan.pinocchio_candidates()]  # type: ignore[attr-defined]
    assert steps[:2] == [100.0, 200.0]
    assert steps[5] == pytest.approx(20.0)
