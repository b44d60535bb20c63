"""Exact motions of the work-precision study: two computations of each agree, and the models with both."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.reports.work_precision import benchmarks, ours, reduced, references, scenes
from robust_gcp.reports.work_precision.measure import Judge
from robust_gcp.reports.work_precision.reduced import OneDof

Array = NDArray[np.float64]
Derivative = Callable[..., Array]

FOUR_BARS = {
    "antiparallelogram": ((2.0, 1.0, 2.0, 1.0), -1, 0.1),
    "change_point": ((4.0, 2.0, 3.0, 3.0), 1, 2.5),
    "kite": ((2.0, 1.0, 1.0, 2.0), 1, 1.0),
    "crank_rocker": ((4.0, 1.0, 3.5, 3.0), 1, 1.0),
}
QUICK = [name for name in scenes.MOTIONS if name not in ("bricard", "n_four_bar_40", "flyball", "andrews")]
SLOW = [pytest.param(n, marks=pytest.mark.slow) for n in ("bricard", "n_four_bar_40", "flyball", "andrews")]


def systems() -> dict[str, tuple[OneDof, rg.Mechanism, float]]:
    """One-degree-of-freedom systems by hand, the mechanism of the scene, and a place to look at."""
    found = {
        name: (reduced.four_bar(lengths, assembly), scenes.MOTIONS[name]().scene.mechanism, y)
        for name, (lengths, assembly, y) in FOUR_BARS.items()
    }
    return found | {"bricard": (benchmarks.bricard(), rg.load("bricard"), 0.8)}


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_two_computations_of_a_motion_agree(name: str) -> None:
    """2e-10 is 1/50 of what the study compares at its finest, and the start is the scene's."""
    motion = scenes.MOTIONS[name]()
    reference = motion.solve()
    assert reference.accuracy < 2e-10
    assert reference.q.shape == (401, motion.scene.mechanism.nq)
    np.testing.assert_allclose(reference.q[0], motion.scene.q0, atol=1e-14)
    np.testing.assert_allclose(reference.v[0], motion.scene.v0, atol=1e-13)
    assert max(np.abs(motion.scene.mechanism.phi(q)).max(initial=0.0) for q in reference.q[::40]) < 1e-11


@pytest.mark.parametrize("name", [*FOUR_BARS, "bricard"])
def test_the_hand_written_energy_is_pinocchios(name: str) -> None:
    """½ m ẏ² is the kinetic energy; V differs from the potential by a constant."""
    system, mechanism, y = systems()[name]
    offsets = []
    for angle in (y, y + 0.1, y + 0.25):
        q, G, _ = system.shape(angle)
        kinetic, potential = mechanism.tree.energies(q, 1.7 * G)
        w = system.weights(angle)
        assert 0.5 * w.inertia * 1.7**2 == pytest.approx(kinetic, rel=1e-12)
        offsets.append(w.potential - potential)
    np.testing.assert_allclose(offsets, offsets[0], atol=1e-12)


@pytest.mark.parametrize("name", [*FOUR_BARS, "bricard"])
def test_slopes_are_derivatives(name: str, derivative: Derivative) -> None:
    system, _, y = systems()[name]
    w = system.weights(y)
    assert w.half_slope == pytest.approx(0.5 * derivative(lambda h: system.weights(y + h).inertia), abs=1e-9)
    assert w.moment == pytest.approx(float(derivative(lambda h: system.weights(y + h).potential)), abs=1e-9)


def test_bricards_closed_form_closes_the_loop(derivative: Derivative) -> None:
    system, mechanism = benchmarks.bricard(), rg.load("bricard")
    for x in np.linspace(0.0, np.pi, 7):
        q, G, _ = system.shape(x)
        assert np.abs(mechanism.phi(q)).max() < 1e-14
        np.testing.assert_allclose(mechanism.K(q) @ G, 0.0, atol=1e-14)
    np.testing.assert_allclose(
        system.shape(0.8)[2], derivative(lambda h: system.shape(0.8 + h)[1]), atol=1e-9
    )


def test_andrews_by_hand_reaches_the_published_end() -> None:
    """The Test Set's end values are good to 7.3 digits; the accelerations at the start are exact."""
    order = np.arange(7)
    system = benchmarks.andrews_implicit(order)
    exact = [14222.4439199541138706, -10666.8329399655854, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(system.rate(0.0, system.x0)[7:], exact, atol=1e-11 * 14222.0)
    times = np.array([0.0, 0.03])
    end = references.integrate(system, times, rtol=1e-11, atol=1e-13)[1][-1]
    published = [
        15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
        0.5244099658805303, 0.5347301163226948, 1.048080741042263,
    ]  # fmt: skip
    np.testing.assert_allclose(end, published, rtol=1e-7)


def test_flyball_by_hand_has_the_published_eigenvalues() -> None:
    """−8117 and −20.05/s (A05) of the symmetric motion."""
    system = benchmarks.flyball(np.arange(4), conserving=False)

    def column(i: int) -> Array:
        h = 1e-6 * np.eye(6)[i]
        return np.asarray((system.rate(0.0, system.x0 + h) - system.rate(0.0, system.x0 - h)) / 2e-6)

    values = np.linalg.eigvals(np.array([column(i) for i in range(6)]).T)
    for published in (-8117.0, -20.05):
        assert np.abs(values - published).min() < 6e-4 * abs(published)


@pytest.mark.parametrize("name", ["change_point", "crank_rocker"])
def test_quadrature_notices_a_wrong_motion(name: str) -> None:
    """Arrival times of positions that are off by 1e-6 rad are off by 1e-6/ẏ: from rest and turning."""
    lengths, assembly, y = FOUR_BARS[name]
    system = reduced.four_bar(lengths, assembly)
    times = np.linspace(0.0, 1.0, 81)
    start: Any = system.start(y, 0.0 if name == "change_point" else 4.0)
    states = references.integrate(start, times)[0]
    assert np.abs(references.arrival_times(system, states) - times).max() < 1e-11
    wrong = states.copy()
    wrong[40, 0] += 1e-6
    late = references.arrival_times(system, wrong) - times
    assert late[40] == pytest.approx(1e-6 / states[40, 1], rel=1e-3)


# --------------------------------------------------------------------------- what users have


@pytest.mark.parametrize(
    ("name", "crossings"),
    [("scissor_lift", 9), ("skew_antiparallelogram", 6), ("four_bar_chain", 4), ("floating_change_point", 1)],
)
def test_the_bridge_is_on_the_floor_through_every_crossing(name: str, crossings: int) -> None:
    """Several loops flat at once, redundant rows in space, clusters in their zones together, a free base."""
    motion = scenes.MOTIONS[name]()
    judge, h = Judge(motion.scene, motion.solve()), float(motion.scene.times[1])
    found = next(c for c in ours.contenders(lambda _: np.zeros(0)) if c.name == "bridge, RK4").run(
        motion.scene, h
    )
    exact = ours.Floor("rk4", motion.floor).run(motion.scene, h)
    error, least = (judge.judge(outcome)["error"] for outcome in (found, exact))
    assert error == pytest.approx(least, rel=1e-3)
    scene = motion.scene
    run = rg.simulate(scene.mechanism, scene.q0, scene.v0, float(scene.times[-1]), h)
    assert len(run.crossings) == crossings


def test_zones_of_the_chain_overlap() -> None:
    """While the second linkage crosses, the others are 0.3 and 0.05 rad beside their crossings at most."""
    motion = scenes.MOTIONS["four_bar_chain"]()
    scene = motion.scene
    run = rg.simulate(scene.mechanism, scene.q0, scene.v0, 0.5, float(scene.times[1]))
    assert [crossing.cluster for crossing in run.crossings] == [0, 1, 2]
    beside = np.abs(np.asarray(run.crossings[1].y) - np.pi)
    assert beside[2] < 0.05


def test_momentum_of_the_floating_linkage() -> None:
    """No formulation knows of it: m v + m g t and the angular momentum about the centre stay."""
    motion = scenes.MOTIONS["floating_change_point"]()
    reference, mechanism = motion.solve(), motion.scene.mechanism
    data = mechanism.model.createData()
    found = []
    for t, q, v in list(zip(motion.scene.times, reference.q, reference.v, strict=True))[::40]:
        h = pin.computeCentroidalMomentum(mechanism.model, data, q, v)
        mass = pin.computeTotalMass(mechanism.model)
        found.append([*(h.linear + mass * t * np.array([0.0, 0.0, 9.81])), *h.angular])
    np.testing.assert_allclose(found, [found[0]] * len(found), atol=1e-9)


@pytest.mark.parametrize("name", ["delta", "walker"])
def test_robots_on_their_exact_motions(name: str) -> None:
    """Order 4 against points in space, which know no joints; the points are where the joints have them."""
    motion = scenes.MOTIONS[name]()
    judge, h = Judge(motion.scene, motion.solve()), float(motion.scene.times[1])
    made = {c.name: c for c in ours.contenders(lambda _: np.zeros(0))}
    compiled = made.get("bridge compiled, RK4")
    bridge = compiled if compiled and not compiled.refuses(motion.scene) else made["bridge, RK4"]
    errors = [judge.judge(bridge.run(motion.scene, h / k))["error"] for k in (1, 2)]
    assert errors[0] < 2e-6
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)
    assert ours.Floor("rk4", motion.floor).refuses(motion.scene)
