"""Which joints let the others of a cluster move evenly, and what fixed steps gain by it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.simulation.runs.evenness import GAIN, UNEVEN, evenest, kept_rates, unevenness

BACKENDS = ["python", pytest.param("native", marks=pytest.mark.skipif(
    not rg.backends()["native"].available, reason="no compiled kernel"))]  # fmt: skip


def moving(rng: np.random.Generator, n: int, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random motions (n, m), an acceleration that they may have, and a velocity among them."""
    tangent = rng.normal(size=(n, m))
    return tangent, rng.normal(size=n), tangent @ rng.normal(size=m)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_unevenness_is_of_the_components_alone(m: int) -> None:
    """Not of the basis, nor of the acceleration that is known, nor of how fast the motion is."""
    rng = np.random.default_rng(5)
    tangent, g, v = moving(rng, 7, m)
    chosen = np.sort(rng.permutation(7)[:m])
    eta = unevenness(tangent, chosen, g, v)
    other = unevenness(tangent @ rng.normal(size=(m, m)), chosen, g + tangent @ rng.normal(size=m), v)
    assert other == pytest.approx(eta, rel=1e-10)
    assert unevenness(tangent, chosen, 9.0 * g, 3.0 * v) == pytest.approx(eta, rel=1e-12)
    assert unevenness(tangent, chosen, g, 0.0 * v) == 0.0
    np.testing.assert_allclose(kept_rates(tangent, chosen, g)[1][chosen], 0.0, atol=1e-12)


def test_unevenness_of_a_slide_against_its_crank() -> None:
    """x = cos θ: with θ even, ẍ = −cos θ θ̇²; with x even, θ̈ = −θ̇² cot θ, without bounds at dead points."""
    for theta in (0.3, 1.0, 0.01):
        tangent, rate = np.array([[1.0], [-np.sin(theta)]]), 2.0
        g, v = np.array([0.0, -np.cos(theta) * rate**2]), tangent[:, 0] * rate
        assert unevenness(tangent, np.array([0]), g, v) == pytest.approx(np.cos(theta))
        assert unevenness(tangent, np.array([1]), g, v) == pytest.approx(1.0 / np.tan(theta))


@pytest.mark.parametrize("m", [1, 2])
def test_the_evenest_is_that_of_all_exchanges(m: int) -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        tangent, g, v = moving(rng, 6, m)
        chosen, everything = np.sort(rng.permutation(6)[:m]), np.arange(6)
        found = evenest(tangent, chosen, g, everything, lambda way: True)
        exchanges = [
            np.sort(np.append(np.delete(found, j), i))
            for j in range(m)
            for i in np.setdiff1d(everything, found)
        ]
        best = min(unevenness(tangent, way, g, v) for way in exchanges)
        assert unevenness(tangent, found, g, v) <= 1.06 * best
        served = evenest(tangent, chosen, g, everything, lambda way: 0 not in way)
        assert 0 not in np.setdiff1d(served, chosen)


def crank_and_rocker() -> tuple[rg.Mechanism, np.ndarray]:
    """A crank-rocker of which the rocker is y, with the crank a quarter of a turn before a dead point."""
    crank = linkages.four_bar(4.0, 1.0, 3.0, 3.5, y=2.0)
    return crank.with_independent(["q3"]), crank.lift(crank.home, [6.0])


@pytest.mark.parametrize("backend", BACKENDS[1:])
def test_uneven_coordinates_are_left_long_before_they_turn_back(backend: Any) -> None:
    """As soon as the present joint's unevenness, of g at the outputs, is 2, and twice that of another."""
    rocker, v0 = crank_and_rocker()
    run = rg.simulate(rocker, v0=v0, duration=0.5, step=1e-3, backend=backend)
    changes = [*run.stats.repartitions, (np.inf, ())]
    assert len(changes) > 1
    looked, names = 0, ("q3",)
    for t, q, v in zip(run.t, run.q, run.v, strict=True):
        if t >= changes[0][0]:
            names = changes.pop(0)[1]
        present = rocker.with_independent(names)
        g = np.abs(present.g(q, v)).max() / np.abs(v).max() ** 2
        others = [
            np.abs(rocker.with_independent([n]).g(q, v)).max() / np.abs(v).max() ** 2
            for n in ("q1", "q2", "q3")
        ]
        looked += g > UNEVEN
        assert g <= UNEVEN * 1.3 or g <= GAIN * 1.3 * min(others)
    assert looked < 30


def test_backends_take_the_same_coordinates_at_the_same_times() -> None:
    if not rg.backends()["native"].available:
        pytest.skip("no compiled kernel")
    rocker, v0 = crank_and_rocker()
    python, native = (
        rg.simulate(rocker, v0=v0, duration=1.0, step=1e-3, backend=b).stats.repartitions
        for b in ("python", "native")
    )
    assert python == native


def test_error_control_needs_no_even_coordinates() -> None:
    """Its steps are as short as they have to be: y is changed where it is about to turn back alone."""
    rocker, v0 = crank_and_rocker()
    fixed = rg.simulate(rocker, v0=v0, duration=0.5, step=1e-3).stats.repartitions
    free = rg.simulate(rocker, v0=v0, duration=0.5, step=1e-2, stepper="DOP853", rtol=1e-9, atol=1e-9)
    assert len(free.stats.repartitions) <= len(fixed)


@pytest.mark.parametrize("seed", range(6))
def test_random_linkages_in_any_coordinates_err_as_in_the_best(seed: int) -> None:
    """Against DOP853, over whole turns: a few times the error of the joint that serves best throughout."""
    rng = np.random.default_rng(seed)
    l1 = rng.uniform(0.5, 1.0)
    l0, l2, l3 = 2.0 + rng.uniform(0, 0.5), 1.6 + rng.uniform(0, 0.5), 1.8 + rng.uniform(0, 0.5)
    crank = linkages.four_bar(l0, l1, l2, l3, y=rng.uniform(0.5, 2.5))
    v0 = crank.lift(crank.home, [5.0])
    exact = rg.simulate(crank, v0=v0, duration=1.0, step=1e-2, stepper="DOP853", rtol=1e-12, atol=1e-12)
    errors = {}
    for name in ("q1", "q2", "q3"):
        run = rg.simulate(crank.with_independent([name]), v0=v0, duration=1.0, step=1e-3)
        errors[name] = np.abs(run.q[::10] - exact.q).max()
    assert max(errors.values()) < 10.0 * min(errors.values()) + 1e-11
