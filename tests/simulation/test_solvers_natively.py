"""scipy's solvers on right-hand sides of the kernel: the numbers that Python's own give, in their order."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics.equations import EquationsOfMotion
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples import families
from robust_gcp.examples.six_bars import joined_by_dyad
from robust_gcp.kernel.simulation.steps import NativeSteps, chosen_library
from robust_gcp.maps.choice import MapChoice
from robust_gcp.maps.cluster import cluster_map
from robust_gcp.simulation.runs.solver_rates import Following

from ..compiled import needs_kernel

pytestmark = needs_kernel

SOLVERS = ("RK45", "DOP853", "Radau", "BDF")
TIGHT = {"rtol": 1e-9, "atol": 1e-11}


def followed(name: str, backend: str, torque: Any = None) -> tuple[Following, Any]:
    """What a solver asks for its right-hand sides, and the motion's beginning."""
    mech = rg.load(name)
    v = mech.lift(mech.home, np.full(mech.m, 0.7))
    motion = initial_value_problem(mech, None, v, torque=torque, choice=MapChoice(error_controlled=True))
    library = chosen_library("native", "bridge", "tangent")
    assert library is not None
    native = NativeSteps(library, torque, True) if backend == "native" else None
    following = Following(motion, native, None)
    following.begin(motion.equations.evaluate(0.0, motion.x), motion.x)
    return following, motion


def pushed(t: float, q: Any, v: Any) -> Any:
    return 0.3 * np.sin(q[: len(v)]) - 0.1 * v + t


@pytest.mark.parametrize(
    "name", ["crank_rocker", "slider_crank", "delta", "five_bar", "strandbeest", "walker"]
)
@pytest.mark.parametrize("torque", [None, pushed])
def test_the_same_rates_wherever_a_solver_tries(name: str, torque: Any) -> None:
    """Ahead and back again, with a far trial between, and outputs on the way."""
    kernel, motion = followed(name, "native", torque)
    python, _ = followed(name, "python", torque)
    m, random = motion.mechanism.m, np.random.default_rng(1)
    x = motion.x.copy()
    for i in range(60):
        x[: 2 * m] += 0.004 * random.normal(size=2 * m)
        trial = x.copy()
        trial[:m] += 0.05 * random.normal(size=m) * (i % 3 == 0)
        found, wanted = kernel(0.1 * i, trial), python(0.1 * i, trial)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(wanted).max()))
        if i % 7 == 0:
            here, there = kernel.keep(0.1 * i, x), python.keep(0.1 * i, x)
            np.testing.assert_allclose(here.point.q, there.point.q, atol=1e-13)
            np.testing.assert_allclose(here.v, there.v, atol=1e-12)
    assert np.isnan(kernel(0.0, np.full(len(x), np.nan))).all()


@pytest.mark.parametrize("stepper", SOLVERS)
@pytest.mark.parametrize("name", ["crank_rocker", "rhombus", "delta"])
def test_the_same_run(name: str, stepper: Any) -> None:
    """As many right-hand sides, the same motion, through a crossing too."""
    runs = [
        rg.simulate(rg.load(name), duration=0.3, step=0.02, stepper=stepper, backend=backend, **TIGHT)
        for backend in ("native", "python")
    ]
    found, wanted = runs
    # the kernel asks for DOP853's polynomial, three of them, in one more step that may have passed something
    more = 3 if (name, stepper) == ("rhombus", "DOP853") else 0
    assert found.stats.rhs == wanted.stats.rhs + more
    # Python looks behind each step in a zone, the kernel behind those that may have passed something
    ours, theirs = found.stats.zone_evaluations, wanted.stats.zone_evaluations
    assert 0.5 * theirs <= ours <= theirs
    require_same(found, wanted)


def require_same(found: rg.Trajectory, wanted: rg.Trajectory) -> None:
    np.testing.assert_allclose(found.q, wanted.q, atol=1e-10)
    np.testing.assert_allclose(found.v, wanted.v, atol=1e-9)
    assert len(found.crossings) == len(wanted.crossings)
    for ours, theirs in zip(found.crossings, wanted.crossings, strict=True):
        assert ours.time == pytest.approx(theirs.time, abs=1e-10)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-9)
        assert ours.cluster == theirs.cluster


@pytest.mark.parametrize("stepper", SOLVERS)
def test_the_same_run_of_a_floating_base(stepper: Any) -> None:
    """Two change-point four-bars on a free body that turns by more than one chart holds, in zones too."""
    base = pin.Inertia(3.0, np.array([0.1, -0.2, 0.3]), np.diag([0.6, 0.4, 0.5]))
    mech = families.four_bars([(4.0, 2.0, 3.0, 3.0)] * 2, (2.6, 2.65), floating=base)
    v0 = mech.lift(mech.home, [0.3, 0.4, -0.2, 3.0, -0.5, 0.7, 3.0, 3.0])
    found, wanted = (
        rg.simulate(mech, v0=v0, duration=1.4, step=0.05, stepper=stepper, backend=backend, **TIGHT)
        for backend in ("native", "python")
    )
    # up to five trials of DOP853's, of some ninety, are refused by one and not by the other: by rounding
    assert abs(found.stats.rhs - wanted.stats.rhs) <= 5 * 12 + 0.01 * wanted.stats.rhs
    assert len(found.crossings) == 3
    require_same(found, wanted)


def test_long_steps_over_many_crossings() -> None:
    """Outputs far apart: what steps between them passed is told of, each once and in order."""
    runs = [
        rg.simulate(
            rg.load("rhombus"),
            duration=3.0,
            step=0.5,
            stepper="DOP853",
            backend=backend,
            record=("energy",),
            **TIGHT,
        )
        for backend in ("native", "python")
    ]
    times = [[c.time for c in run.crossings] for run in runs]
    assert len(times[0]) > 3
    np.testing.assert_allclose(times[0], times[1], atol=1e-7)
    assert times[0] == sorted(times[0])
    assert np.ptp(runs[0].energy) < 1e-7 * max(1.0, np.abs(runs[0].energy).max())


@pytest.mark.parametrize("name", ["crank_rocker", "walker"])
def test_python_evaluates_next_to_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, evaluate = [], EquationsOfMotion.evaluate

    def counted(self: Any, t: float, x: Any) -> Any:
        calls.append(t)
        return evaluate(self, t, x)

    monkeypatch.setattr(EquationsOfMotion, "evaluate", counted)
    run = rg.simulate(rg.load(name), duration=1.0, step=0.05, stepper="Radau", **TIGHT)
    assert run.stats.rhs > 500
    assert len(calls) < 5


@pytest.mark.parametrize("stepper", SOLVERS)
@pytest.mark.parametrize("name", ["rhombus", "kite", "joined_by_dyad"])
def test_what_is_passed_is_told_by_the_kernel(
    name: str, stepper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state of its bridges is read in Python where coordinates may be changed, not for what is passed."""
    reads, read = [], cluster_map.read
    monkeypatch.setattr(cluster_map, "read", lambda *told: reads.append(0) or read(*told))
    mech, v0 = (joined_by_dyad(), [3.0, -1.5]) if name == "joined_by_dyad" else (rg.load(name), None)
    start = None if v0 is None else mech.G(mech.home) @ v0
    run = rg.simulate(mech, v0=start, duration=1.0, step=0.05, stepper=stepper, backend="native", **TIGHT)
    assert run.crossings and len(reads) <= len(run.stats.repartitions) < 3
    for crossing in run.crossings:
        assert np.abs(mech.phi(crossing.q)).max() < 1e-12
        np.testing.assert_allclose(run.at(crossing.time).q, crossing.q, atol=1e-4)


def test_coordinates_that_turn_back_are_changed_at_the_same_times() -> None:
    """Where the independent joint of a slider-crank reaches its dead points."""
    runs = []
    for backend in ("native", "python"):
        mech = rg.load("slider_crank").with_independent(["q3"])
        v0 = mech.lift(mech.home, [1.0])
        runs.append(
            rg.simulate(mech, v0=v0, duration=1.5, step=0.02, stepper="DOP853", backend=backend, **TIGHT)
        )
    found, wanted = runs
    assert found.stats.repartitions
    assert [names for _, names in found.stats.repartitions] == [n for _, n in wanted.stats.repartitions]
    np.testing.assert_allclose(found.q, wanted.q, atol=1e-7)


@pytest.mark.parametrize("stepper", ["DOP853", "Radau"])
def test_what_a_torque_function_raises_is_raised(stepper: Any) -> None:
    def torque(t: float, q: Any, v: Any) -> Any:
        if t > 0.1:
            raise ZeroDivisionError("a controller's own")
        return np.zeros(3)

    with pytest.raises(ZeroDivisionError, match="controller's own"):
        rg.simulate(rg.load("crank_rocker"), duration=1.0, step=0.05, stepper=stepper, torque=torque)


def test_events_and_outputs_within_long_steps() -> None:
    """Found by Python's map where the kernel is, which goes on afterwards."""

    def height(t: float, q: Any, v: Any) -> float:
        return float(np.sin(q[0]))

    runs = [
        rg.simulate(
            rg.load("crank_rocker"), duration=2.0, stepper="DOP853", events=height, backend=backend,
            outputs=np.linspace(0.0, 2.0, 7), **TIGHT,
        )
        for backend in ("native", "python")
    ]  # fmt: skip
    assert len(runs[0].t_events[0]) >= 1
    np.testing.assert_allclose(runs[0].t_events[0], runs[1].t_events[0], atol=1e-9)
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-10)
