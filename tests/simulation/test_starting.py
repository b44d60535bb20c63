"""Starts that the kernel closes, checks and judges: the same as Python's, or left to it."""

from __future__ import annotations

import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.linearise import ReducedJacobian
from robust_gcp.dynamics.problem import Problem, initial_value_problem
from robust_gcp.kernel.library import library
from robust_gcp.kernel.simulation.steps import NativeSteps
from robust_gcp.maps.choice import MapChoice
from robust_gcp.maps.cluster.options import BridgeOptions
from robust_gcp.simulation.runs.initial_state import initialise
from robust_gcp.simulation.runs.stability import StabilityCheck

from ..compiled import needs_kernel
from .test_floating import REGULAR, floating

Array = NDArray[np.float64]

pytestmark = needs_kernel

NAMES = ["crank_rocker", "slider_crank", "five_bar", "delta", "strandbeest", "walker"]


def begun(mech: rg.Mechanism, q0: Any, v0: Any, backend: Any, **options: Any) -> rg.Trajectory:
    return rg.simulate(
        mech, q0, v0, 1e-3, 1e-3, backend=backend, record=("a", "energy", "tau"), **options
    )  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("torque", [None, 0.3])
def test_the_start_of_both_backends(name: str, torque: float | None) -> None:
    """From a configuration that is closed to 1e-8, moving, under a torque."""
    mech = rg.load(name)
    random = np.random.default_rng(2)
    v0 = mech.lift(mech.home, random.normal(size=mech.m))
    q0 = mech.tree.integrate(mech.home, 1e-8 * random.normal(size=mech.nv))
    tau = None if torque is None else np.full(mech.nv, torque)
    ours, theirs = (begun(mech, q0, v0, backend, torque=tau) for backend in ("native", "python"))
    for item in ("q", "v", "tau"):
        np.testing.assert_allclose(getattr(ours, item), getattr(theirs, item), atol=1e-11)
    for item in ("a", "energy"):
        found, wanted = getattr(ours, item), getattr(theirs, item)
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-9 * max(1.0, np.abs(wanted).max()))
    assert ours.closure_error().max() < 1e-13


@pytest.mark.parametrize(
    ("q0", "v0", "error"),
    [
        ([0.1, 0.5, 0.1], None, rg.ClosureError),
        (None, [1.0, 0.0, 0.0], rg.StateError),
        ([0.1, -0.1], None, rg.StateError),
        (None, [np.nan, 0.0, 0.0], rg.StateError),
        (None, [1e60, -1e60, 1e60], rg.NonFiniteError),
    ],
)
def test_what_is_no_start_is_refused_in_the_same_words(q0: Any, v0: Any, error: Any) -> None:
    words = []
    for backend in ("native", "python"):
        with pytest.raises(error) as caught:
            rg.simulate(rg.load("rhombus"), q0, v0, 0.01, backend=backend)
        words.append(str(caught.value))
    assert words[0] == words[1]


@pytest.mark.filterwarnings("ignore::robust_gcp.CoarseStepWarning")
def test_a_step_outside_of_the_region_of_stability_is_told_in_the_same_words() -> None:
    mech = rg.load("crank_rocker")
    stiff = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home, forces=[rg.JointDamper("q1", 1e5)]
    )
    words = []
    for backend in ("native", "python"):
        with pytest.warns(rg.StabilityWarning) as caught:
            begun(stiff, None, None, backend)
        words.append(next(str(w.message) for w in caught if w.category is rg.StabilityWarning))
    assert words[0][:100] == words[1][:100]


def test_a_handle_serves_run_after_run_and_knows_nothing_of_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bridges are built anew and counted, whatever was run before; the digits stay the same."""
    kernel = library()
    assert kernel is not None
    made, create = [], kernel.create

    def counted(*args: Any) -> Any:
        made.append(create(*args))
        return made[-1]

    monkeypatch.setattr(kernel, "create", counted)
    mech = rg.load("rhombus")
    runs = [rg.simulate(mech, [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], 0.5, 1e-3) for _ in range(3)]
    rg.simulate(mech, [0.2, -0.2, 0.2], [1.0, -1.0, 1.0], 0.5, 1e-3)
    last = rg.simulate(mech, [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], 0.5, 1e-3)
    assert len(made) == 1
    for run in (*runs[1:], last):
        np.testing.assert_array_equal(run.q, runs[0].q)
        assert run.stats.bridges_built == runs[0].stats.bridges_built == 1


def test_threads_have_handles_of_their_own() -> None:
    mech = rg.load("rhombus")
    start = [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0]
    alone = rg.simulate(mech, *start, 0.5, 1e-3).q
    with ThreadPoolExecutor(4) as pool:
        for q in pool.map(lambda _: rg.simulate(mech, *start, 0.5, 1e-3).q, range(12)):
            np.testing.assert_array_equal(q, alone)


def test_a_start_costs_a_few_right_hand_sides_of_python() -> None:
    """Processor time of the fastest of many, against that of a right-hand side on the same machine."""
    mech = rg.load("crank_rocker")
    equations = initial_value_problem(mech).equations
    x = np.concatenate([mech.home[mech.iq_independent], np.zeros(mech.m)])

    def fastest(work: Any) -> float:
        spent = []
        for _ in range(60):
            begun = time.thread_time_ns()
            work()
            spent.append(time.thread_time_ns() - begun)
        return float(min(spent))

    one = fastest(lambda: equations(0.0, x))
    assert fastest(lambda: rg.simulate(mech, duration=1e-3, step=1e-3)) < 12.0 * one


def of_many_kinds() -> dict[str, tuple[rg.Mechanism, Array]]:
    """Mechanisms whose kernels begin, with a motion: of one and more coordinates, on a base, in charts."""
    random = np.random.default_rng(4)
    made = {name: rg.load(name) for name in [*NAMES, "flyball"]} | {
        "on a base": floating(pin.JointModelFreeFlyer(), REGULAR),
    }
    return {name: (mech, mech.lift(mech.home, random.normal(size=mech.m))) for name, mech in made.items()}


def begun_in_the_kernel(
    mech: rg.Mechanism, v0: Array | None = None, tau: Array | None = None
) -> tuple[Problem, NativeSteps]:
    kernel = library()
    assert kernel is not None
    native = NativeSteps(kernel, tau, required=True)
    start = mech.home, v0, None
    motion = initialise(native, mech, start, tau, MapChoice(), "repartition", None, 0.0)
    return motion, native


@pytest.mark.parametrize("name", [*NAMES, "flyball", "on a base"])
def test_the_slopes_that_the_step_is_judged_by(name: str) -> None:
    """The differences in the kernel are those in Python, and leave the motion that follows as it is."""
    mech, v0 = of_many_kinds()[name]
    motion, native = begun_in_the_kernel(mech, v0, np.full(mech.nv, 0.2))
    n, near = 2 * mech.m, native.rates(motion, motion.first, motion.x, None)
    assert near is not None
    found, again = near.slopes(), near.slopes()
    assert found is not None and again is not None
    wanted = ReducedJacobian(motion.equations)(0.0, motion.x)[:n, :n]
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-5 * np.abs(wanted).max())
    np.testing.assert_allclose(again, found, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
    rate = near(0.0, motion.x)
    assert rate is not None
    np.testing.assert_allclose(rate, motion.equations(0.0, motion.x), rtol=1e-10, atol=1e-9)


def test_slopes_that_the_kernel_cannot_tell() -> None:
    """Where they leave the finite numbers nothing is said of the step, and the run itself tells why."""
    mech = rg.load("rhombus")
    motion, native = begun_in_the_kernel(mech)
    assert motion.first is not None
    near = native.rates(motion, motion.first, np.array([np.pi / 2.0 * 1e6, 1e30]), None)
    assert near is not None and near.slopes() is None
    check = StabilityCheck(mech, None, 1e-3, BridgeOptions())
    motion.x = np.array([np.pi / 2.0 * 1e6, 1e30])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check.before(motion, native)
