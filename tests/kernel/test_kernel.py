"""The compiled kernel against the Python path: the same motion, records, errors and events."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.equations import EquationsOfMotion
from robust_gcp.examples.legged import legged
from robust_gcp.examples.linkages import four_bar, n_four_bar, swinging_four_bar
from robust_gcp.kernel.library import library
from robust_gcp.kernel.simulation.workspace import Workspace
from robust_gcp.maps.cluster.cluster_map import ClusterMap
from robust_gcp.maps.cluster.options import BridgeOptions
from robust_gcp.maps.explicit import Counters
from robust_gcp.maps.regular_path import RegularPath
from robust_gcp.maps.start import initial_point
from robust_gcp.reports.robot_speed import sized
from robust_gcp.simulation.runs.record import Outputs

from ..compiled import needs_kernel

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]

pytestmark = needs_kernel

SAME = 1e-12
"""Agreement after a thousand steps, relative to each coordinate's largest value and to 1."""

ROUNDING = {"a": 100.0}
"""Accelerations have fewer digits at the edge of a zone: g errs by ε ẏ²/zone³, 1e-11 at ẏ = 3 rad/s."""

STEPS = {"andrews": 3e-5, "flyball": 1e-5}
"""s; the motions of these two are faster than the others' 1e-3."""

SPATIAL = ("tripod", "spherical loop", "seven hinges", "humanoid")


def both(mechanism: rg.Mechanism, **options: Any) -> tuple[rg.Trajectory, rg.Trajectory]:
    """The motion by either backend, up to where it stops."""
    runs = []
    for backend in ("python", "native"):
        try:
            runs.append(rg.simulate(mechanism, backend=backend, **options))
        except rg.SimulationError as error:
            assert error.trajectory is not None
            runs.append(error.trajectory)
    return runs[0], runs[1]


def apart(a: Array, b: Array) -> float:
    """Largest difference of two records, relative to each column's size or 1."""
    assert a.shape == b.shape
    return float((np.abs(a - b) / np.maximum(np.abs(a).max(axis=0), 1.0)).max())


def require_same(python: rg.Trajectory, native: rg.Trajectory, tolerance: float = SAME) -> None:
    """All that was recorded, and the crossings."""
    np.testing.assert_array_equal(python.t, native.t)
    for name in ("q", "v", "a", "energy", "multipliers", "work"):
        a, b = getattr(python, name), getattr(native, name)
        assert (a is None) == (b is None)
        if a is not None and a.size:
            assert apart(a, b) <= tolerance * ROUNDING.get(name, 1.0), name
    assert [c.kind for c in python.crossings] == [c.kind for c in native.crossings]
    for one, other in zip(python.crossings, native.crossings, strict=True):
        assert abs(one.time - other.time) <= tolerance
        assert apart(one.q, other.q) <= tolerance


@pytest.mark.parametrize("name", [n for n in rg.model_names() if n not in ("five_bar", "kite")])
def test_shipped_scenes_move_alike(name: str) -> None:
    """A thousand steps, everything recorded; the five-bar and the kite have a test of their own."""
    step = STEPS.get(name, 1e-3)
    record = ("a", "energy", "multipliers") if name != "stewart" else ("a", "energy")
    python, native = both(rg.load(name), duration=1000 * step, step=step, record=record)
    if native.multipliers is not None and native.multipliers.size:
        size = max(1.0, float(np.abs(python.multipliers).max()))
        np.testing.assert_allclose(native.multipliers, python.multipliers, atol=1e-10 * size)
        python.multipliers = native.multipliers = None
    require_same(python, native)
    assert python.stats.native_steps == 0
    assert native.stats.native_steps >= 990


@pytest.mark.parametrize("name", ["five_bar", "kite"])
def test_up_to_a_toggle_the_motion_is_the_same(name: str) -> None:
    """Both stop at the same output with the same error; 1e-12 holds where K_d is well conditioned."""
    mechanism, errors = rg.load(name), []
    for backend in ("python", "native"):
        with pytest.raises(rg.SimulationError) as caught:
            rg.simulate(mechanism, duration=2.0, backend=backend, on_toggle="error")
        errors.append(caught.value)
    assert all(isinstance(error, rg.ToggleError) for error in errors)
    python, native = (error.trajectory for error in errors)
    assert python is not None and native is not None
    assert len(python.t) == len(native.t) > 600
    regular = len(python.t) - 100
    assert apart(python.q[:regular], native.q[:regular]) <= SAME
    assert apart(python.v[:regular], native.v[:regular]) <= SAME


@pytest.mark.parametrize("name", SPATIAL)
def test_joints_of_all_kinds_move_alike(
    spatial: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    """Free-flyers, spherical joints, slides, points, hinges and welds as closures."""
    mechanism = spatial[name]
    _, v = closed_states(mechanism, 1)[0]
    v = mechanism.lift(mechanism.home, 0.3 * v[mechanism.iv_independent])
    steps = 20 if name == "humanoid" else 100
    require_same(*both(mechanism, v0=v, duration=steps * 1e-3, record=("a", "energy")))


CROSSINGS: dict[str, tuple[Callable[[], rg.Mechanism], list[float] | None, int]] = {
    "rhombus": (lambda: rg.load("rhombus"), [0.2, -0.2, 0.2], 9),
    "parallelogram": (lambda: rg.load("parallelogram"), [0.2, -0.2, 0.2], 6),
    "change_point": (lambda: rg.load("change_point"), None, 3),
    "three rhombi": (lambda: n_four_bar(3, 1.2), None, 6),
    "two coordinates": (lambda: swinging_four_bar(4.0, 2.0, 3.0, 3.0, 0.3, 1.0), None, 1),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.campaign) if " " in n else n for n in CROSSINGS]
)
def test_through_every_crossing(name: str) -> None:
    """5 s through certified bridges: the same outputs, and the same crossings at the same times."""
    make, q0, crossings = CROSSINGS[name]
    python, native = both(make(), q0=q0, duration=5.0, record=("a",))
    # as the rounding of what each builds for itself grows in the inverted phase of this one
    grown = magnified(make()) if name == "three rhombi" else 1.0
    require_same(python, native, SAME * grown)
    assert len(native.crossings) == crossings
    assert native.stats.bridges_built == python.stats.bridges_built
    assert native.stats.zone_evaluations == python.stats.zone_evaluations


def magnified(mechanism: rg.Mechanism, change: float = 1e-6) -> float:
    """What 5 s of the motion from home make of a change of the start, in the same units."""
    there = mechanism.home.copy()
    there[mechanism.iq_independent] += change
    runs = [
        rg.simulate(mechanism, q0=q0, duration=5.0, backend="native")
        for q0 in (mechanism.home, mechanism.assemble(there, hold=mechanism.independent))
    ]
    return float(np.abs(runs[1].v - runs[0].v).max() / change)


def random_mechanism(seed: int) -> rg.Mechanism | None:
    """A random tree of hinges, slides and balls with one loop; None where no joints parametrise it."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model, parents = pin.Model(), [0]
    kinds = [
        "RX",
        "RY",
        "RZ",
        "PX",
        "PY",
        "PZ",
        "RevoluteUnaligned",
        "PrismaticUnaligned",
        "Spherical",
        "RUBX",
    ]
    count = int(rng.integers(4, 10))
    for i in range(count):
        kind = str(rng.choice(kinds, p=[0.15, 0.15, 0.15, 0.07, 0.07, 0.07, 0.16, 0.08, 0.05, 0.05]))
        axis = rng.normal(size=3)
        unaligned = [axis / np.linalg.norm(axis)] if kind.endswith("Unaligned") else []
        place = pin.SE3(pin.exp3(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-0.5, 0.5, 3))
        # each joint goes on the body before, or starts a branch there: depth first
        branch = parents[-1] if rng.random() < 0.85 else parents[len(parents) // 2]
        parents = parents[: parents.index(branch) + 1]
        joint = model.addJoint(branch, getattr(pin, f"JointModel{kind}")(*unaligned), place, f"j{i}")
        moments = np.diag(rng.uniform(0.05, 0.1, 3))
        body = pin.Inertia(rng.uniform(0.5, 2.0), rng.uniform(-0.2, 0.2, 3), moments)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        parents.append(joint)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    end = parents[-1]
    first = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))
    second = data.oMi[0].actInv(data.oMi[end] * first)
    model.addFrame(pin.Frame("end", end, first, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("ground", 0, second, pin.FrameType.OP_FRAME))
    axis = tuple(rng.normal(size=3).tolist())
    closures = [rg.PointClosure("end", "ground"), rg.FrameClosure("end", "ground")]
    closure = [*closures, rg.RevoluteClosure("end", "ground", axis)][int(rng.integers(3))]
    try:
        made = rg.Mechanism.from_pinocchio(model, [closure], "auto", home=q, name=f"random {seed}")
    except (rg.PartitionError, rg.ModelError):
        return None  # the loop is rigid
    return None if made.chart_joints else made  # components of balls in loops are not the kernel's


def random_mechanisms(count: int) -> list[rg.Mechanism]:
    """That many mechanisms whose K_d is well conditioned at home."""
    found: list[rg.Mechanism] = []
    seed = 0
    while len(found) < count:
        mechanism = random_mechanism(seed)
        seed += 1
        if mechanism is None or mechanism.m == 0 or mechanism.chart_joints:  # these stay in Python
            continue
        path = RegularPath(mechanism, mechanism.select_rows(mechanism.K(mechanism.home)))
        if path.worst_conditioning(mechanism.home) > 0.2:
            found.append(mechanism)
    return found


def compare_random(count: int, steps: int) -> list[float]:
    """Differences of q, v, a and energy on `count` random mechanisms, over 0.1 s in `steps` steps."""
    worst = []
    for i, mechanism in enumerate(random_mechanisms(count)):
        rng = np.random.default_rng(i)
        v = mechanism.lift(mechanism.home, rng.uniform(-0.5, 0.5, mechanism.m))
        options = {"v0": v, "duration": 1e-4 * steps, "step": 1e-4, "record": ("a", "energy")}
        python, native = both(mechanism, **options)
        require_same(python, native)
        worst.append(max(apart(python.q, native.q), apart(python.v, native.v)))
    return worst


def test_random_spatial_mechanisms() -> None:
    """Loops of all three kinds over random trees, a few steps each."""
    assert len(compare_random(100, 10)) == 100


@pytest.mark.campaign
def test_random_spatial_mechanisms_over_a_thousand_steps() -> None:
    """The same for a thousand steps each, on some of them."""
    assert len(compare_random(12, 1000)) == 12


# --------------------------------------------------------------------------- parts of the path


@pytest.mark.parametrize("name", ["seven hinges", "stewart", "change_point", "strandbeest_pair"])
def test_determinants_and_conditioning(mechanisms: dict[str, rg.Mechanism], name: str) -> None:
    """det, and rcond by the same estimate as LAPACK's dgecon, block by block."""
    mechanism = mechanisms[name]
    start = initial_point(mechanism, mechanism.home, None, None, BridgeOptions(), Counters())
    explicit = ClusterMap(start.path, start.point, BridgeOptions())
    equations = EquationsOfMotion(mechanism, explicit, np.zeros(mechanism.nv))
    x = np.concatenate([start.point.y, start.ydot, [0.0]])
    found = library()
    assert found is not None
    workspace = Workspace(found, mechanism, start.path, np.zeros(mechanism.nv), True)
    outputs = Outputs(np.zeros((3, mechanism.nq)), np.zeros((3, mechanism.nv)))
    times = np.array([0.0, 2e-4, 4e-4, 6e-4])
    batch = workspace.run(times, x, equations.evaluate(0.0, x), outputs, 1e-9)
    assert batch.steps == 3
    point = batch.now.point
    det, rcond = start.path.conditioning(point.q.copy())
    np.testing.assert_allclose(point.det, det, rtol=1e-10)
    np.testing.assert_allclose(point.rcond, rcond, rtol=1e-10)
    assert point.conditioning == point.rcond.min()


def test_the_zone_hands_back_at_the_last_accepted_step() -> None:
    """Without bridges the kernel stops before the first evaluation below the threshold, and says so."""
    mechanism = rg.load("rhombus")
    native = rg.simulate(mechanism, q0=[0.2, -0.2, 0.2], duration=0.2, backend="native")
    options = BridgeOptions()
    begin_at = initial_point(mechanism, [0.2, -0.2, 0.2], None, None, options, Counters())
    equations = EquationsOfMotion(mechanism, ClusterMap(begin_at.path, begin_at.point, options))
    found = library()
    assert found is not None
    workspace = Workspace(found, mechanism, begin_at.path)
    x = np.array([0.2, 0.0])
    outputs = Outputs(np.zeros((200, 3)), np.zeros((200, 3)))
    batch = workspace.run(native.t, x, equations.evaluate(0.0, x), outputs, options.zone)
    assert batch.reason.name == "ZONE"
    assert 100 < batch.steps < 200
    np.testing.assert_array_equal(outputs.q[: batch.steps], native.q[1 : batch.steps + 1])
    assert not np.any(outputs.q[batch.steps :])
    assert batch.now.point.conditioning >= options.zone


# --------------------------------------------------------------------------- forces and records


def test_torque_callback_sees_and_does_the_same() -> None:
    """A callable of t, q and v, its work, and the forces that it needs; the same as in Python."""

    def torque(t: float, q: Array, v: Array) -> Array:
        return np.array([np.sin(3.0 * t), 0.1 * q[0], -0.2 * v[2]])

    options = {"duration": 1.0, "torque": torque, "record": ("a", "energy", "multipliers")}
    python, native = both(rg.load("crank_rocker"), **options)
    require_same(python, native, 1e-11)
    assert native.work is not None
    assert np.abs(native.energy_error()).max() < 1e-6
    assert native.stats.native_steps == 1000


def test_constant_torque_does_work() -> None:
    """An array acts as a drive, beside the mechanism's own forces."""
    python, native = both(rg.load("andrews"), duration=3e-3, step=3e-5, torque=[0.01, 0, 0, 0, 0, 0, 0])
    assert native.work is not None
    require_same(python, native)


def test_an_exception_of_the_torque_arrives_unchanged() -> None:
    """Whatever a callable raises, at the time it does, with the motion so far for errors of ours."""

    class Stop(BaseException):
        pass

    def stop(t: float, q: Array, v: Array) -> Array:
        if t > 0.05:
            raise Stop
        return np.zeros(3)

    with pytest.raises(Stop):
        rg.simulate(rg.load("rhombus"), q0=[0.2, -0.2, 0.2], torque=stop, backend="native")

    def bad(t: float, q: Array, v: Array) -> Array:
        return np.full(3, np.nan if t > 0.05 else 0.0)

    with pytest.raises(rg.NonFiniteError, match="torque") as caught:
        rg.simulate(rg.load("rhombus"), q0=[0.2, -0.2, 0.2], torque=bad, backend="native")
    assert caught.value.trajectory is not None


def test_errors_are_the_same() -> None:
    """A state that leaves the finite numbers, and a spring without length, stop both backends alike."""
    for backend in ("python", "native"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            with pytest.raises(rg.NonFiniteError):
                rg.simulate(rg.load("flyball"), duration=2.0, step=0.01, backend=backend)


def test_progress_and_counters() -> None:
    """Progress ends at 1; four right-hand sides a step and one more."""
    seen: list[float] = []
    run = rg.simulate(rg.load("crank_rocker"), duration=20.0, progress=seen.append, backend="native")
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 2
    assert run.stats.rhs == 4 * 20_000 + 1
    assert run.stats.native_steps == 20_000
    assert run.stats.newton_iterations > 0


def test_classical_method_goes_its_own_way() -> None:
    """No bridges, no test of the branch; near the singular configuration Python takes over and warns."""
    runs = []
    for backend in ("python", "native"):
        with pytest.warns(rg.SingularityWarning):
            runs.append(
                rg.simulate(
                    rg.load("rhombus"), q0=[0.2, -0.2, 0.2], duration=1.0, method="classical", backend=backend
                )
            )
    assert apart(runs[0].q, runs[1].q) < 1e-9  # its digits are lost at the crossings
    assert runs[1].stats.native_steps > 900


def test_coordinates_change_at_toggles() -> None:
    """A rocker as coordinate: both backends change it at the same times."""
    mechanism = rg.load("crank_rocker").with_independent(["q3"])
    python, native = both(mechanism, duration=3.0, on_toggle="repartition")
    assert [names for _, names in python.stats.repartitions] == [n for _, n in native.stats.repartitions]
    assert len(native.stats.repartitions) > 0
    assert apart(python.q, native.q) < 1e-9  # the steps into a toggle are taken with rtol = 1e-10
    assert native.stats.native_steps > 2000


# --------------------------------------------------------------------------- choices


def test_unsupported_choices_are_refused_with_a_reason() -> None:
    """backend="native" says why not; "auto" goes on in Python."""
    rhombus = rg.load("rhombus")
    for options in ({"method": "projection"}, {"method": "closed_form"}):
        with pytest.raises(rg.OptionError, match='backend="native"'):
            rg.simulate(rhombus, q0=[0.2, -0.2, 0.2], duration=0.01, backend="native", **options)
    with pytest.raises(rg.OptionError, match="previous"):
        rg.simulate(rhombus, method="classical", newton_start="previous", backend="native")
    with pytest.raises(rg.OptionError, match="backend"):
        rg.simulate(rhombus, backend="fast")
    model = pin.Model()
    screw = pin.JointModelHelicalUnaligned(np.array([0.0, 0.0, 1.0]), 0.1)
    joint = model.addJoint(0, screw, pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    odd = rg.Mechanism.from_pinocchio(model)
    with pytest.raises(rg.OptionError, match="'screw' is of type JointModelHelicalUnaligned"):
        rg.simulate(odd, duration=1e-3, backend="native")
    assert rg.simulate(odd, duration=1e-3, backend="auto").stats.native_steps == 0


def test_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """ROBUST_GCP_NATIVE=0 is obeyed, without a warning, and backends() says so."""
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "0")
    state = rg.backends()["native"]
    assert not state.available
    assert "ROBUST_GCP_NATIVE=0" in state.reason
    assert rg.backends()["python"].available
    assert rg.simulate(rg.load("crank_rocker"), duration=0.01).stats.native_steps == 0


def test_a_broken_library_is_reported_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Something that does not load: one warning, then Python; asking for it is an error."""
    broken = tmp_path / "kernel.so"
    broken.write_bytes(b"no library")
    monkeypatch.setenv("ROBUST_GCP_NATIVE", str(broken))
    mechanism = rg.load("crank_rocker")
    with pytest.warns(rg.NativeBuildWarning, match="does not load"):
        run = rg.simulate(mechanism, duration=0.01)
    assert run.stats.native_steps == 0
    rg.simulate(mechanism, duration=0.01)  # no second warning
    with pytest.raises(rg.OptionError, match="does not load"):
        rg.simulate(mechanism, duration=0.01, backend="native")


# --------------------------------------------------------------------------- threads and memory


def test_threads_do_not_meet() -> None:
    """Runs in four threads at once give what they give one after the other, bit by bit."""
    mechanisms = [rg.load("crank_rocker"), rg.load("rhombus"), rg.load("stewart"), rg.load("crank_rocker")]
    alone = [rg.simulate(m, q0=m.home, duration=0.3, backend="native").q for m in mechanisms]
    together: dict[int, Array] = {}

    def work(i: int) -> None:
        together[i] = rg.simulate(mechanisms[i], q0=mechanisms[i].home, duration=0.3, backend="native").q

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i, q in enumerate(alone):
        np.testing.assert_array_equal(together[i], q)


@pytest.mark.parametrize("batches", [10, pytest.param(100, marks=pytest.mark.campaign)])
def test_millions_of_steps_in_constant_memory(batches: int) -> None:
    """1e6 or 1e7 steps of the crank-rocker: no allocation stays behind, energy and loops stay together."""
    mechanism = rg.load("crank_rocker")
    start = initial_point(mechanism, mechanism.home, None, None, BridgeOptions(), Counters())
    equations = EquationsOfMotion(mechanism, ClusterMap(start.path, start.point, BridgeOptions()))
    x = np.concatenate([start.point.y, start.ydot])
    now = equations.evaluate(0.0, x)
    found = library()
    assert found is not None
    workspace = Workspace(found, mechanism, start.path)
    n = 100_000
    outputs = Outputs(np.zeros((n, 3)), np.zeros((n, 3)), energy=np.zeros(n))
    times, peak = 1e-3 * np.arange(n + 1), []
    for _ in range(batches):
        batch = workspace.run(times, x, now, outputs, 0.05)
        assert batch.steps == n
        x, now = batch.x, batch.now
        peak.append(_resident())
    assert max(peak[1:]) - peak[0] < 3 << 20  # bytes; Python asks for 1 MiB at a time
    assert mechanism.closure_residual(now.point.q) < 1e-13
    assert outputs.energy is not None
    drift = outputs.energy[-1] - mechanism.energy(start.point.q, now.v * 0.0)
    assert abs(drift) < 1e-2 * abs(mechanism.energy(start.point.q, now.v * 0.0))


def _resident() -> int:
    """Memory in use, bytes, without pages of files: those come and go as other processes ask for room."""
    status = Path("/proc/self/statm")
    if not status.exists():
        pytest.skip("no /proc here")
    resident, shared = (int(pages) for pages in status.read_text().split()[1:3])
    return (resident - shared) * 4096


@pytest.mark.parametrize("lengths", ((1.0, 1.0, 1.0, 1.0), (2.0, 1.0, 2.0, 1.0), (4.0, 2.0, 3.0, 3.0)))
def test_a_crossing_on_an_output_is_listed_once(lengths: tuple[float, float, float, float]) -> None:
    """Of two steps that meet on a singular place to rounding one passes it, whoever takes them."""
    mechanism = four_bar(*lengths, y=np.pi - 0.09)
    start = {"v0": mechanism.lift(mechanism.home, [4.0])}
    (crossing,) = rg.simulate(mechanism, duration=0.04, step=1e-3, **start).crossings
    step = crossing.time / 4.0
    found = [
        rg.simulate(mechanism, duration=9.0 * h, step=h, backend=backend, **start).crossings
        for h in (step * (1.0 + change * 2.0**-50) for change in (-8, -2, -1, 0, 1, 2, 8))
        for backend in ("python", "native")
    ]
    assert [len(crossings) for crossings in found] == [1] * len(found)
    np.testing.assert_allclose([crossing.time for (crossing,) in found], 4.0 * step, rtol=1e-8)


@pytest.mark.parametrize("floating", [False, True])
def test_steps_of_robots_cost_the_same_for_each_leg(floating: bool) -> None:
    """200 joints and 50 loops: K_d or GᵀMG taken as a whole would cost 125 times what those of 10 legs do."""
    seconds = []
    for legs in (10, 50):
        mech = legged(legs, floating)
        steps = sized(mech, mech.lift(mech.home, np.linspace(-1.0, 1.0, mech.m)))
        seconds.append(min(steps()[0] for _ in range(25)))
    assert seconds[1] < 4.0 * 5.0 * seconds[0]
    v = mech.lift(mech.home, np.linspace(-1.0, 1.0, mech.m))
    motion = rg.simulate(mech, v0=v, duration=2e-3, step=1e-3, backend="native", record=("a",))
    assert motion.stats.native_steps == 2
    assert motion.closure_error().max() < 1e-14
    assert motion.a is not None
    M, C = (
        mech.tree.crba(motion.q[-1]).copy(),
        mech.tree.rnea(motion.q[-1], motion.v[-1], mech.tree.zero).copy(),
    )
    G = mech.G(motion.q[-1])
    np.testing.assert_allclose(G.T @ (M @ motion.a[-1] + C), 0.0, atol=1e-11)


def test_a_motion_hangs_on_nothing_that_was_done_before() -> None:
    """Bit by bit, whatever the same workspace was used for: small steps of Newton's use the last factors."""
    mech = rg.load("bricard")
    speeds = [0.1 + seed for seed in range(4)]

    def run(speed: float) -> NDArray[np.float64]:
        v = mech.lift(mech.home, np.full(mech.m, speed))
        return rg.simulate(mech, mech.home, v, 0.01, 1e-4, backend="native").q

    first = [run(speed) for speed in speeds]
    for seed in range(6):
        for k in np.random.default_rng(seed).permutation(4):
            np.testing.assert_array_equal(run(speeds[k]), first[k])
