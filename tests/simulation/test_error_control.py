"""Steps with error control past modes that pass each other: the kernel's are the reference's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.examples.six_bars import stephenson, watt
from robust_gcp.examples.spatial import spherical_four_bar
from robust_gcp.simulation.runs.error_control import RefinedRun
from robust_gcp.simulation.runs.solver_rates import Following
from robust_gcp.simulation.runs.steppers import RefusedTrialError

from ..compiled import needs_kernel

pytestmark = needs_kernel

SPEED, DURATION, STEP = 3.0, 0.8, 1e-3


def missing(by: float) -> rg.Mechanism:
    """A four-bar that is a change-point linkage but for this: at about 0.67 s modes pass each other."""
    return four_bar(1.0, 2.0 + by, 1.5, 1.5, y=1.0)


def run(mech: rg.Mechanism, backend: str, **more: Any) -> rg.Trajectory:
    start = mech.home, mech.lift(mech.home, [SPEED])
    return rg.simulate(mech, *start, DURATION, STEP, backend=backend, **more)


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The steps with error control that were taken in Python."""
    taken, refined = list[int](), RefinedRun._refined

    def counted(self: RefinedRun, i: int, begun: Any) -> Any:
        taken.append(i)
        return refined(self, i, begun)

    monkeypatch.setattr(RefinedRun, "_refined", counted)
    return taken


def pull(t: float, q: Any, v: Any) -> Any:
    """A torque of the user's."""
    return np.array([np.sin(3.0 * t), 0.1 * v[0], 0.0])


TORQUES: dict[str, Any] = {"none": None, "constant": [0.2, 0.0, 0.0], "function": pull}


@pytest.mark.parametrize(
    ("by", "torque"),
    [(1e-2, "none"), (1e-3, "constant"), (-1e-3, "function"), (1e-4, "none"), (1e-5, "function")],
)
def test_the_kernel_passes_as_the_reference_does(in_python: list[int], by: float, torque: str) -> None:
    """The same stretches, and the same motion to what is asked of each step; few steps are left to Python."""
    mech, acts = missing(by), TORQUES[torque]
    reference = run(mech, "python", torque=acts)
    refined = reference.stats.refined_steps
    assert len(in_python) >= refined > 0 and reference.stats.native_steps == 0
    in_python.clear()
    found = run(mech, "native", torque=acts)
    assert len(in_python) <= 0.1 * refined
    assert found.stats.refined_steps == refined
    assert len(found.stats.refined) == len(reference.stats.refined)
    np.testing.assert_allclose(found.stats.refined, reference.stats.refined, rtol=0, atol=1e-12)
    assert [names for _, names in found.stats.repartitions] == [
        names for _, names in reference.stats.repartitions
    ]
    size = max(1.0, float(np.abs(reference.v).max()))
    np.testing.assert_allclose(found.q, reference.q, rtol=0, atol=2e-8 * size)
    np.testing.assert_allclose(found.v, reference.v, rtol=0, atol=2e-7 * size)


@pytest.mark.parametrize("by", [1e-3, -1e-3])
def test_what_changes_with_time_is_told_at_the_kernels_own_times(in_python: list[int], by: float) -> None:
    """Controls from a table and activations, and a driven joint, within steps with error control."""
    mech = missing(by)
    begun = float(mech.home[0])
    acting = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home,
        actuators=[rg.Actuator.motor("a", "q1"), rg.Actuator("f", "q1", dynamics="filter", time=0.05)],
    )  # fmt: skip
    ctrl = {
        "a": (np.array([0.0, 0.3, 0.8]), np.array([0.0, 0.4, -0.4])),
        "f": 0.2,
    }
    cases: list[tuple[rg.Mechanism, dict[str, Any]]] = [
        (acting, {"ctrl": ctrl, "v0": mech.lift(mech.home, [SPEED])})
    ]
    if by < 0.0:  # else the driven joint turns back there
        cases.append((mech, {"drive": {"q1": rg.Motion(lambda t: begun + SPEED * t)}}))
    for machine, more in cases:
        wanted = rg.simulate(machine, duration=DURATION, step=STEP, backend="python", **more)
        in_python.clear()
        found = rg.simulate(machine, duration=DURATION, step=STEP, backend="native", **more)
        assert found.stats.refined_steps == wanted.stats.refined_steps > 0 and len(in_python) <= 2
        np.testing.assert_allclose(found.q, wanted.q, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.v, wanted.v, rtol=0, atol=1e-8)


@pytest.mark.parametrize("backend", ["python", "native"])
@pytest.mark.parametrize(
    ("by", "y", "speed", "step", "duration"),
    [
        (1e-4, 1.0, 3.0, 1e-3, 0.75),  # trials behind the fold of y came back on the other side of it
        (3e-5, 1.0, 3.0, 1e-3, 0.75),
        (0.0259, 1.22, 5.81, 2e-3, 1.9),
        (1.1584144227884261e-4, 1.0317511206251233, -5.9496137687962385, 2e-3, 0.56),  # a refusal stayed
    ],
)
def test_where_coordinates_turn_back_the_motion_keeps_its_branch_and_its_energy(
    backend: str, by: float, y: float, speed: float, step: float, duration: float
) -> None:
    """Beside a miss y has a fold, with two points next to each other at each y: no trial changes them."""
    mech = four_bar(1.0, 2.0 + by, 1.5, 1.5, y=y)
    found = rg.simulate(
        mech, mech.home, mech.lift(mech.home, [speed]), duration, step, backend=backend, record=("energy",)
    )
    assert found.stats.refined_steps > 0
    # RK4's own error is 1e-3 of that in the third case, the other side of the fold took a third of it
    assert np.ptp(found.energy) < 5e-3 * float(np.abs(found.v).max()) ** 2


@pytest.mark.parametrize("by", [1e-3, -1e-4])
def test_steps_one_at_a_time_come_to_the_same_bits(by: float) -> None:
    """Nothing of an error-controlled step but its end is handed to the next one."""
    mech = missing(by)
    whole = run(mech, "native", torque=[0.2, 0.0, 0.0])
    assert whole.stats.refined_steps > 0
    sim = rg.Simulation(mech, mech.home, mech.lift(mech.home, [SPEED]), step=STEP, backend="native")
    for _ in range(len(whole.t) - 1):
        sim.step([0.2, 0.0, 0.0])
    assert np.array_equal(sim.q, whole.q[-1]) and np.array_equal(sim.v, whole.v[-1])


def test_modes_too_far_ahead_to_be_told_are_the_kernels_too() -> None:
    """They pass each other 7e-2 ahead, which second order does not tell: few steps are Python's."""
    mech = spherical_four_bar((0.8115, 0.3131, 0.9222, 0.2028), 3.246)
    start = mech.home, mech.lift(mech.home, [-0.7])
    found, reference = (rg.simulate(mech, *start, 0.06, 1e-3, backend=by) for by in ("native", "python"))
    assert found.stats.native_steps >= 55
    assert not found.stats.refined
    assert not reference.stats.refined
    assert np.abs(found.q - reference.q).max() < 1e-11


def test_refused_trials_are_not_tried_again_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver shortens its step where the kernel cannot follow; the motion is the implicit system's."""
    told = list[str]()

    def counted(name: str) -> None:
        of: Any = getattr(Following, name)

        def call(self: Following, t: float, x: Any) -> Any:
            told.append(name)
            return of(self, t, x)

        monkeypatch.setattr(Following, name, call)

    for name in ("trial", "_in_python"):
        counted(name)
    refused = RefusedTrialError.__init__
    monkeypatch.setattr(
        RefusedTrialError, "__init__", lambda *given: (told.append("refused"), refused(*given))[1]
    )
    mech = stephenson(2.6, (4.00004, 2.0, 3.0, 3.0))
    v0 = mech.lift(mech.home, [2.0])
    found = rg.simulate(mech, mech.home, v0, 0.3, 1e-3)
    assert found.stats.refined and "trial" in told and "refused" in told
    assert "_in_python" not in told

    def rate(_t: float, x: Any) -> Any:
        q, v = np.split(x, 2)
        return np.concatenate([v, rg.implicit_dynamics(mech, q, v)[0]])

    start = np.concatenate([mech.home, v0])
    exact = solve_ivp(rate, (0.0, 0.3), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.abs(np.concatenate([found.q[-1], found.v[-1]]) - exact).max() < 1e-5


@pytest.mark.parametrize("backend", ["python", "native"])
@pytest.mark.parametrize("torque", [None, pull])
@pytest.mark.parametrize("by", [1e-3, 1e-4, 1e-5, -1e-4])
def test_what_lies_within_steps_changes_no_motion(backend: str, torque: Any, by: float) -> None:
    """Outputs beside a miss, and where the joint turns there: coordinates change in the same steps."""
    mech, rng = missing(by), np.random.default_rng(4)
    more: dict[str, Any] = {"torque": torque}
    plain = run(mech, backend, **more)
    more |= {
        "events": lambda t, q, v: v[0],
        "outputs": np.append(np.sort(rng.uniform(0.66, 0.7, 99)), DURATION),
    }
    found = run(mech, backend, **more)
    assert found.stats.refined_steps == plain.stats.refined_steps > 0
    np.testing.assert_allclose(found.q[-1], plain.q[-1], rtol=0, atol=2e-8)
    truth = run(mech, "native", stepper="DOP853", rtol=1e-11, atol=1e-13, **more)
    np.testing.assert_allclose(found.q, truth.q, rtol=0, atol=2e-8)
    np.testing.assert_allclose(found.v, truth.v, rtol=0, atol=1e-6)
    assert len(found.t_events[0]) == len(truth.t_events[0]) == (by > 0.0)
    np.testing.assert_allclose(found.t_events[0], truth.t_events[0], rtol=0, atol=1e-9)
    ended = run(mech, backend, **more | {"events": rg.Event(more["events"], terminal=True)})
    assert ended.ended_by == (0 if by > 0.0 else None)
    if by > 0.0:
        assert ended.t[-1] == pytest.approx(truth.t_events[0][0], abs=1e-9)
        np.testing.assert_allclose(ended.q[-1], truth.q_events[0][0], rtol=0, atol=2e-8)
    assert found.closure_error().max() < 1e-13


@pytest.mark.parametrize("backend", ["python", "native"])
def test_rounding_that_is_measured_beside_a_miss_loosens_no_later_step(backend: str) -> None:
    """Energy to 1e-7 J of some 40 that move, in whatever parts a step is taken."""
    mech = four_bar(1.0, 2.0 - 1.6214403737515622e-6, 1.5, 1.5, y=1.2278897808670564)
    start = mech.home, mech.lift(mech.home, [2.832292154755552]), 0.8, 1e-3
    outputs = np.append(np.sort(np.random.default_rng(1).uniform(0.44, 0.71, 40)), 0.8)
    ways: list[dict[str, Any]] = [
        {},
        {"outputs": outputs},
        {"events": lambda t, q, v: float(np.sin(q[1] - 0.4))},
    ]
    runs = [rg.simulate(mech, *start, record=("energy",), backend=backend, **way) for way in ways]
    for found in runs:
        assert found.stats.refined_steps > 0
        assert np.ptp(found.energy) < 1e-7
        np.testing.assert_allclose(found.q[-1], runs[0].q[-1], rtol=0, atol=1e-8)


@pytest.mark.parametrize("backend", ["python", "native"])
def test_error_control_outlasts_a_change_of_coordinates_on_the_way(backend: Any) -> None:
    """In others that are poorly conditioned too: one step of RK4 between erred by 5e-5."""
    mech = watt(2.532066288121126)
    start = mech.home, mech.lift(mech.home, [5.42571033]), 0.4, 2e-3
    found = rg.simulate(mech, *start, backend=backend)
    truth = rg.simulate(mech, *start, stepper="DOP853", rtol=1e-11, atol=1e-12)
    assert found.stats.repartitions and found.stats.refined_steps > 0
    np.testing.assert_allclose(found.q, truth.q, rtol=0, atol=2e-9)
