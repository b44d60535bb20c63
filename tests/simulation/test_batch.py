"""`rg.Batch`: each row is the `Simulation` of its own, whoever steps it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.kernel.simulation import rows as kernel_rows
from robust_gcp.simulation.batches import batch as batch_module

Array = NDArray[np.float64]

needs_kernel = pytest.mark.skipif(not rg.backends()["native"].available, reason="no compiled kernel")
SCENES = (
    "rhombus",
    "parallelogram",
    "change_point",
    "crank_rocker",
    "slider_crank",
    "strandbeest",
    "delta",
    "bricard",
)
WRITTEN_OUT = (
    "rhombus",
    "parallelogram",
    "crank_rocker",
    "slider_crank",
    "strandbeest",
    "five_bar",
    "walker",
)
N = 4


def _torques(mech: rg.Mechanism, seed: int, size: float = 0.3) -> Array:
    """On the independent joints, other ones for each row."""
    tau = np.zeros((N, mech.nv))
    tau[:, mech.iv_independent] = np.random.default_rng(seed).normal(size=(N, mech.m)) * size
    return tau


def _simulations(mech: rg.Mechanism, step: float = 1e-3, **options: Any) -> list[rg.Simulation]:
    return [rg.Simulation(mech, step=step, keep="last", **options) for _ in range(N)]


@needs_kernel
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_rows_are_simulations_to_the_last_bit(name: str, threads: int) -> None:
    mech = rg.load(name)
    batch = rg.Batch(mech, N, threads=threads, specialise=False)
    alone = _simulations(mech)
    for k in range(12):
        tau = _torques(mech, k, 3.0 if mech.m == 1 else 0.3)
        q, v, A, B = batch.step(tau, 60)
        for i, one in enumerate(alone):
            one.step(tau[i], 60)
            np.testing.assert_array_equal(q[i], one.q)
            np.testing.assert_array_equal(v[i], one.v)
        assert A is None and B is None
    assert batch.crossings.tolist() == [len(one.crossings) for one in alone]
    assert batch.t.tolist() == [one.t for one in alone]
    assert not batch.errors and not batch.status.any()


@needs_kernel
@pytest.mark.parametrize("name", WRITTEN_OUT)
def test_steps_compiled_for_a_mechanism_are_the_kernel_s(name: str) -> None:
    mech = rg.load(name)
    fast, kernel = (rg.Batch(mech, N + 3, specialise=wanted) for wanted in (True, False))
    worst = 0.0
    for k in range(8):
        tau = np.vstack([_torques(mech, k, 1.0), _torques(mech, -1 - k + 100, 1.0)[:3]])
        worst = max(worst, float(np.abs(fast.step(tau, 60).q - kernel.step(tau, 60).q).max()))
    assert worst <= 2e-13 * max(1.0, float(np.abs(kernel.q).max()))
    assert worst > 0.0  # other code
    np.testing.assert_array_equal(fast.crossings, kernel.crossings)
    assert name not in ("rhombus", "parallelogram") or fast.crossings.all()


@needs_kernel
def test_they_are_compiled_when_that_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_rows, "MANY", 500)
    mech = rg.load("crank_rocker")
    kernel, later = rg.Batch(mech, N, specialise=False), rg.Batch(mech, N)
    tau = _torques(mech, 1)
    np.testing.assert_array_equal(later.step(tau, 100).q, kernel.step(tau, 100).q)
    assert 0.0 < np.abs(later.step(tau, 100).q - kernel.step(tau, 100).q).max() < 1e-14


@needs_kernel
@pytest.mark.parametrize("specialise", [True, False])
def test_coordinates_change_as_in_a_simulation(specialise: bool) -> None:
    """The kite's crank turns back: the error is that of the step, against the half of it."""
    mech, h = rg.load("kite"), 1e-3
    batch, fine = rg.Batch(mech, N, step=h, specialise=specialise), _simulations(mech, h / 2)
    coarse = _simulations(mech, h)
    tau = _torques(mech, 5, 0.05)
    for _ in range(10):
        batch.step(tau, 130)
        for i in range(N):
            coarse[i].step(tau[i], 130)
            fine[i].step(tau[i], 260)
    exact = np.array([one.q for one in fine])
    error = np.abs(np.array([one.q for one in coarse]) - exact).max()
    assert 1e-12 < error < 1e-7
    assert np.abs(batch.q - exact).max() < 3.0 * error
    assert coarse[0].trajectory.stats.repartitions
    assert batch.crossings.tolist() == [len(one.crossings) for one in coarse]


@needs_kernel
@pytest.mark.parametrize("specialise", [True, False])
@pytest.mark.parametrize("name", ["rhombus", "five_bar"])
def test_saved_states_lead_back(name: str, specialise: bool) -> None:
    mech = rg.load(name)
    batch, tau = rg.Batch(mech, N, specialise=specialise), _torques(mech, 3, 1.0)
    for steps in (40, 333, 7, 290):  # within zones too
        batch.step(tau, steps)
        saved, crossings = batch.save(), batch.crossings
        q, t = batch.q.copy(), batch.t.copy()
        first = batch.step(-tau, 5)
        for _ in range(2):
            batch.restore(saved)
            np.testing.assert_array_equal(batch.q, q)
            np.testing.assert_array_equal(batch.t, t)
            np.testing.assert_array_equal(batch.crossings, crossings)
            again = batch.step(-tau, 5)
            np.testing.assert_array_equal(again.q, first.q)
            np.testing.assert_array_equal(again.v, first.v)


def test_some_rows_begin_anew() -> None:
    mech = rg.load("rhombus")
    batch, tau = rg.Batch(mech, N, t0=1.0), _torques(mech, 2, 1.0)
    first = batch.step(tau, 100)
    batch.step(tau, 400)
    kept = batch.q[[0, 3]].copy()
    assert batch.reset([1, 2]) is batch
    np.testing.assert_array_equal(batch.q[[1, 2]], np.tile(mech.home, (2, 1)))
    np.testing.assert_array_equal(batch.q[[0, 3]], kept)
    np.testing.assert_array_equal(batch.t, [1.5, 1.0, 1.0, 1.5])
    np.testing.assert_array_equal(batch.step(tau, 100).q[[1, 2]], first.q[[1, 2]])
    starts = np.array([mech.assemble(mech.configuration({"q1": 0.6})), mech.home])
    speeds = np.array([mech.lift(q, [2.0]) for q in starts])
    batch.reset(np.array([True, False, False, True]), starts, speeds)
    np.testing.assert_allclose(batch.q[[0, 3]], starts, atol=1e-15)
    np.testing.assert_allclose(batch.v[[0, 3]], speeds, atol=1e-14)


@pytest.mark.parametrize("specialise", [None, False])
def test_starts_at_singular_places_and_in_zones(specialise: bool | None) -> None:
    mech = rg.load("rhombus")
    flat, crossed = np.zeros(3), [1.0, -2.0, 2.0]
    beside = mech.assemble(mech.configuration({"q1": 1e-4, "q2": -2e-4, "q3": 2e-4}))
    for q0, mode in ((flat, crossed), (flat, [1.0, 0.0, -0.0]), (beside, None)):
        try:
            one = rg.Simulation(mech, q0, mode=mode, keep="last")
        except rg.RobustGcpError as refusal:
            with pytest.raises(type(refusal)):
                rg.Batch(mech, 2, q0, mode=mode)
            continue
        batch = rg.Batch(mech, 2, q0, mode=mode, specialise=specialise)
        for _ in range(3):
            q = batch.step({"q1": 0.5}, 50).q
            one.step({"q1": 0.5}, 50)
            np.testing.assert_allclose(q, np.tile(one.q, (2, 1)), rtol=0.0, atol=1e-13)


@pytest.mark.filterwarnings("ignore::robust_gcp.CoarseStepWarning")
def test_starts_that_are_no_table_are_refused() -> None:
    with pytest.raises(rg.StateError, match="is not a list of 3 numbers"):
        rg.Batch(rg.load("rhombus"), 2, [[0.2, -0.2], [0.2]])


def test_a_row_that_stops_says_why_and_the_others_go_on() -> None:
    mech = rg.load("crank_rocker")
    batch, same = rg.Batch(mech, N), rg.Batch(mech, N)
    tau = np.zeros((N, mech.nv))
    tau[2, 0] = 1e200
    q = batch.step(tau, 200).q
    assert batch.status.tolist() == [0, 0, 1, 0] and list(batch.errors) == [2]
    assert isinstance(batch.errors[2], rg.SimulationError)
    tau[2] = 0.0
    np.testing.assert_array_equal(q[[0, 1, 3]], same.step(tau, 200).q[[0, 1, 3]])
    stopped = q[2].copy()
    np.testing.assert_array_equal(batch.step(tau, 10).q[2], stopped)
    A = batch.step(tau, 1, jacobians=True).A
    assert A is not None and np.isnan(A[2]).all() and np.isfinite(A[[0, 1, 3]]).all()
    batch.reset([2])
    assert not batch.status.any() and not batch.errors
    assert np.all(batch.step(tau, 10).q[2] != stopped)


def test_jacobians_of_several_steps() -> None:
    """Against central differences of the steps."""
    mech, h, n, d = rg.load("five_bar"), 1e-3, 20, 1e-6
    m, own = mech.m, mech.iv_independent
    tau = _torques(mech, 9, 0.3)
    batch = rg.Batch(mech, N, mech.home, mech.lift(mech.home, [0.5, -0.3]), h)
    batch.step(tau, 30)
    q0, v0 = batch.q.copy(), batch.v.copy()
    _, _, A, B = batch.step(tau, n, jacobians=True)
    assert A is not None and B is not None

    def after(i: int, change: Array, more: Array) -> Array:
        moved = q0[i].copy()
        moved[mech.iq_independent] += change[:m]
        q = mech.assemble(moved)
        one = rg.Batch(mech, 1, q, mech.lift(q, v0[i][own] + change[m:]), h)
        end = one.step(tau[i] + more, n)
        return np.concatenate([end.q[0][mech.iq_independent], end.v[0][own]])

    still, none = np.zeros(2 * m), np.zeros(mech.nv)
    for i in (0, 2):
        for k in range(2 * m):
            way = np.eye(2 * m)[k] * d
            np.testing.assert_allclose(
                (after(i, way, none) - after(i, -way, none)) / (2 * d), A[i][:, k], atol=3e-7
            )
        for k in range(mech.nv):
            way = np.eye(mech.nv)[k] * 1e-4
            slope = (after(i, still, way) - after(i, still, -way)) / 2e-4
            np.testing.assert_allclose(slope, B[i][:, k], atol=1e-7)


def test_jacobians_beside_a_dead_point_are_of_the_steps_that_were_taken() -> None:
    """In other coordinates than the mechanism's, whose own steps err by 1e-3 there."""
    mech, h, n = rg.load("kite"), 5e-3, 60
    own, d = mech.iv_independent, 1e-5
    assert np.array_equal(own, mech.iq_independent)

    def ends(*speeds: float) -> rg.Batch:
        v = mech.lift(np.tile(mech.home, (len(speeds), 1)), np.array(speeds)[:, None])
        return rg.Batch(mech, len(speeds), mech.home, v, h)

    A = ends(3.0).step(None, n, jacobians=True).A
    q, v, *_ = ends(3.0 + d, 3.0 - d).step(None, n)
    slope = np.concatenate([q[0, own] - q[1, own], v[0, own] - v[1, own]]) / (2.0 * d)
    assert A is not None
    np.testing.assert_allclose(A[0][:, 1], slope, rtol=1e-6)


@pytest.mark.parametrize("specialise", [None, False])
@pytest.mark.parametrize("name", ["crank_rocker", "five_bar"])
def test_controls_are_held(name: str, specialise: bool | None) -> None:
    mech = rg.load(name)
    names = [actuator.name for actuator in mech.actuators]
    batch, alone = rg.Batch(mech, N, specialise=specialise), _simulations(mech)
    ctrl = np.random.default_rng(0).normal(size=(N, len(names))) * 0.2
    for given in (ctrl, None, {names[0]: 0.1}, None):
        q = batch.step(None, 25, ctrl=given).q
        for i, one in enumerate(alone):
            one.step(None, 25, ctrl=given[i] if isinstance(given, np.ndarray) else given)
        np.testing.assert_allclose(q, [one.q for one in alone], rtol=0.0, atol=1e-13)


def test_what_the_kernel_does_not_take_alone() -> None:
    """Stops: rows by simulations, which is told."""
    mech = rg.load("rhombus")
    stops = [rg.Stop("q1", lower=0.2, upper=0.9)]
    with (
        pytest.warns(rg.PerformanceWarning, match="stops")
        if rg.backends()["native"].available
        else _nothing()
    ):
        batch = rg.Batch(mech, 2, joints=stops)
    one = rg.Simulation(mech, joints=stops, keep="last")
    for _ in range(5):
        q = batch.step({"q1": 2.0}, 100).q
        one.step({"q1": 2.0}, 100)
        np.testing.assert_allclose(q, np.tile(one.q, (2, 1)), rtol=0.0, atol=1e-14)
    assert one.happenings
    with pytest.raises(rg.OptionError, match="jacobians=True does not go with stops"):
        batch.step(jacobians=True)


@pytest.mark.filterwarnings("ignore::robust_gcp.PerformanceWarning", "ignore::robust_gcp.ModelWarning")
def test_stops_and_friction_of_a_file_act(tmp_path: Path) -> None:
    """Where joints= is left out, as in simulate."""
    (tmp_path / "arm.xml").write_text(
        """<mujoco><option><flag contact="disable"/></option><worldbody><body>
        <joint name="q" axis="0 1 0" range="-40 20" frictionloss="0.3"/><geom size="0.1" pos="1 0 0"/>
        </body></worldbody></mujoco>"""
    )
    arm = rg.load(tmp_path / "arm.xml", limits=True, friction=True)
    q = rg.Batch(arm, 2).step(n=500).q
    np.testing.assert_allclose(q, np.tile(rg.Simulation(arm).step(n=500).q, (2, 1)), rtol=0.0, atol=1e-14)
    free = rg.load(tmp_path / "arm.xml")
    q = rg.Batch(arm, 2, joints=[]).step(n=500).q
    np.testing.assert_allclose(q, rg.Batch(free, 2).step(n=500).q, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("first", [pin.JointModelRX, pin.JointModelPlanar])
def test_beside_a_loop_that_is_held_poorly(first: type[Any]) -> None:
    """A cut slide that is in a joint's own plane, but for 0.03 of it, lets it move nowhere."""
    model, body = pin.Model(), pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4)
    at = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
    for name, kind, place in (("free", first(), pin.SE3.Identity()), ("held", pin.JointModelPlanar(), at)):
        joint = model.addJoint(0, kind, place, name)
        model.appendBodyToJoint(joint, body, at)
    model.addFrame(pin.Frame("end", joint, at, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("start", 0, at * at, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(model, [rg.PrismaticClosure("end", "start", (1.0, 0.0, 0.03))])
    v = mech.lift(mech.home, np.ones(mech.m))
    batch = rg.Batch(mech, 2, v0=v)
    batch.step(n=20)
    one = rg.Simulation(mech, v0=v).step(n=20)
    assert [*batch.status] == [0, 0]
    np.testing.assert_allclose(batch.q, np.tile(one.q, (2, 1)), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(batch.v, np.tile(one.v, (2, 1)), rtol=0.0, atol=1e-14)


class _nothing:  # noqa: N801 - a context
    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


def test_without_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    mech = rg.load("parallelogram")
    expected = rg.Batch(mech, 2, specialise=False).step({"q1": 0.4}, 40).q
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "0")
    np.testing.assert_allclose(rg.Batch(mech, 2).step({"q1": 0.4}, 40).q, expected, rtol=0.0, atol=1e-12)
    with pytest.raises(rg.OptionError, match="specialise"):
        rg.Batch(mech, 2, specialise=True)


def test_results_are_written_where_asked() -> None:
    mech = rg.load("crank_rocker")
    batch = rg.Batch(mech, N)
    q, v = np.zeros((N, 3), np.float32), np.zeros((N, 3), np.float32)
    found = batch.step(_torques(mech, 0), 20, out=(q, v))
    assert found.q is q and found.v is v
    np.testing.assert_array_equal(q, batch.q.astype(np.float32))
    copies = batch.step(None, 1)
    copies.q[:] = 7.0
    assert not np.any(batch.q == 7.0)


class TestRefusals:
    """Typed, before anything moves."""

    MECH = rg.load("crank_rocker")

    @pytest.mark.parametrize(
        "given", [{"N": 0}, {"N": 2.5}, {"step": 0.0}, {"threads": 0}, {"specialise": "yes"}]
    )
    def test_options(self, given: dict[str, Any]) -> None:
        with pytest.raises(rg.OptionError, match=next(iter(given))):
            rg.Batch(self.MECH, **({"N": 2} | given))

    @pytest.mark.parametrize("rows", [[4], [-1], [0.5], [True], "first"])
    def test_rows(self, rows: Any) -> None:
        with pytest.raises(rg.OptionError, match="rows"):
            rg.Batch(self.MECH, 4).reset(rows)

    def test_states_and_torques(self) -> None:
        batch = rg.Batch(self.MECH, 2)
        with pytest.raises(rg.StateError, match="q0"):
            batch.reset(None, np.zeros((3, 3)))
        with pytest.raises(rg.StateError, match="tau"):
            batch.step(np.zeros((3, 3)))
        with pytest.raises(rg.OptionError, match="numbers"):
            batch.step(lambda t, q, v: 0.0)  # type: ignore[arg-type]
        with pytest.raises(rg.OptionError, match="out"):
            batch.step(None, 1, out=(np.zeros((2, 3), int), np.zeros((2, 3))))
        with pytest.raises(rg.OptionError, match="save"):
            batch.restore(rg.Batch(self.MECH, 2).save())
        with pytest.raises(rg.OptionError, match="ctrl"):
            batch.step(None, 1, ctrl={"motor": 0.1, "nobody": 1.0})
        assert not np.any(batch.t)

    def test_a_start_that_is_none(self) -> None:
        q0 = np.tile(self.MECH.home, (2, 1))
        q0[1, 1] += 0.3
        with pytest.raises(rg.RobustGcpError) as refusal:
            rg.Batch(self.MECH, 2, q0)
        assert "row 1" in refusal.value.__notes__

    def test_what_is_not_written_out(self) -> None:
        if rg.backends()["native"].available:
            with pytest.raises(rg.OptionError, match="specialise=True"):
                rg.Batch(rg.load("delta"), 2, specialise=True)


@needs_kernel
def test_where_compiled_code_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "kept"
    monkeypatch.setenv("ROBUST_GCP_COMPILE", str(folder))
    rg.Batch(rg.load("rhombus"), 1, specialise=True)
    (kept,) = folder.iterdir()
    before = kept.stat().st_mtime_ns
    rg.Batch(rg.load("rhombus"), 1, specialise=True)
    assert [path.stat().st_mtime_ns for path in folder.iterdir()] == [before]
    monkeypatch.setenv("ROBUST_GCP_COMPILE", "0")
    with pytest.raises(rg.OptionError, match="ROBUST_GCP_COMPILE=0"):
        rg.Batch(rg.load("rhombus"), 1, specialise=True)


@pytest.mark.parametrize("specialise", [None, False])
def test_long_calls_are_cut_up(specialise: bool | None, monkeypatch: pytest.MonkeyPatch) -> None:
    mech, tau = rg.load("rhombus"), _torques(rg.load("rhombus"), 4, 2.0)
    whole = rg.Batch(mech, N, specialise=specialise).step(tau, 700)
    monkeypatch.setattr(batch_module, "AT_ONCE", 500)
    parts = rg.Batch(mech, N, specialise=specialise)
    np.testing.assert_array_equal(parts.step(tau, 700).q, whole.q)
    assert parts.crossings.all() and parts.t.tolist() == [700 * 1e-3] * N


@needs_kernel
@pytest.mark.parametrize("specialise", [True, False])
def test_rows_that_began_in_a_zone_cross_again(specialise: bool) -> None:
    """What was known of the first zone is not taken for the next one."""
    mech = rg.load("rhombus")
    q0 = mech.assemble(mech.configuration({"q1": 1e-4, "q2": -2e-4, "q3": 2e-4}))
    v0 = mech.lift(q0, [4.0])
    batch, one = (rg.Batch(mech, 2, q0, v0, specialise=specialise), rg.Simulation(mech, q0, v0, keep="last"))
    for k in range(30):
        if k % 7 == 5:
            saved = batch.save()
            batch.step(None, 20)
            batch.restore(saved)
        batch.step({"q1": 0.5}, 50)
        one.step({"q1": 0.5}, 50)
        np.testing.assert_allclose(batch.q, np.tile(one.q, (2, 1)), rtol=0.0, atol=1e-11)
    assert batch.crossings.tolist() == 2 * [len(one.crossings)] and len(one.crossings) > 1


@pytest.mark.parametrize("each", [1, 7, 800])
@pytest.mark.parametrize("by", [3e-2, 1e-3, -1e-4])
def test_rows_go_back_before_a_miss_as_simulations_do(by: float, each: int) -> None:
    """To where they were well conditioned, under the torques held since; saved states know of it too."""
    mech = four_bar(1.0, 2.0 + by, 1.5, 1.5, y=1.0)
    v, step, calls = mech.lift(mech.home, [4.0]), 1e-3, -(-800 // each)
    torques = 0.5 * np.random.default_rng(6).normal(size=(calls, 2, mech.nv))
    batch = rg.Batch(mech, 2, mech.home, v, step)
    alone = [rg.Simulation(mech, mech.home, v, step) for _ in range(2)]
    middle = None
    for k, tau in enumerate(torques):
        if k == calls // 2:
            middle = batch.save()
        batch.step(tau, each)
        for i, simulation in enumerate(alone):
            simulation.step(tau[i], each)
    assert all(simulation.trajectory.stats.refined_steps > 0 for simulation in alone)
    wanted = np.array([simulation.q for simulation in alone])
    np.testing.assert_allclose(batch.q, wanted, rtol=0.0, atol=1e-8)
    assert batch.crossings.tolist() == [len(simulation.crossings) for simulation in alone]
    np.testing.assert_allclose(batch.t, alone[0].t, rtol=0.0, atol=1e-12)
    if middle is not None:
        batch.restore(middle)
        for tau in torques[calls // 2 :]:
            batch.step(tau, each)
        np.testing.assert_allclose(batch.q, wanted, rtol=0.0, atol=1e-8)
