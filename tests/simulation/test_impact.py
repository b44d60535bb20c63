"""`Mechanism.impact`: closed forms, momentum, and the energy that Newton's law takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from .machines import pendulum, sliders


def mass(mech: rg.Mechanism, q: Any) -> np.ndarray:
    upper = np.triu(mech.tree.crba(np.asarray(q)))
    return upper + np.triu(upper, 1).T


def test_a_pendulum() -> None:
    """P = (1 + e) m l² ω on the angle; the loss is (1 − e²) of the kinetic energy."""
    found = pendulum().impact([-0.7], [-3.0], [rg.Stop("q1", lower=-0.7, restitution=0.6)])
    assert found.v == pytest.approx([1.8], abs=1e-15)
    assert found.impulses == {"stop.q1": pytest.approx(1.6 * 3.0, rel=1e-14)}
    assert found.loss == pytest.approx(0.5 * 9.0 * (1.0 - 0.36), rel=1e-14)


@pytest.mark.parametrize("y", ["q1", "q2", "q3"])
@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
def test_the_slide_of_a_slider_crank(y: str, e: float) -> None:
    """m = 1: u⁺ = −e u⁻ and P = (1 + e) M_r |u| / |∂r/∂y|, whichever joint is y."""
    crank = rg.load("slider_crank").with_independent([y])
    q = rg.load("slider_crank").home
    v = crank.lift(q, [1.0])
    v *= np.sign(-v[2])
    found = crank.impact(q, v, [rg.Stop("q3", lower=float(q[2]), restitution=e)])
    G = crank.G(q)
    reduced, u = float((G.T @ mass(crank, q) @ G)[0, 0]), float(v[crank.iv_independent][0])
    assert found.v == pytest.approx(-e * v, abs=1e-12)
    assert found.impulses["stop.q3"] == pytest.approx((1.0 + e) * reduced * abs(u / G[2, 0]), rel=1e-11)
    assert found.loss == pytest.approx(0.5 * reduced * u**2 * (1.0 - e**2), abs=1e-11)


@pytest.mark.parametrize("seed", range(6))
def test_momentum_and_energy_of_several_at_once(seed: int) -> None:
    """Gᵀ (M Δv − Eᵀ P) = 0, P ⊥ E v⁺ + e E v⁻ ≥ 0, and T falls by ½ Σ (1 − e) |ċ| P."""
    rng = np.random.default_rng(seed)
    bar = rg.load("five_bar")
    q = bar.home
    v = bar.lift(q, rng.normal(size=2))
    names, e = ("q1", "q2", "q4"), rng.uniform(size=3)
    at = [list(bar.joint_names).index(name) for name in names]
    side = -np.sign(v[at])  # all are approached
    stops = [
        rg.Stop(name, restitution=float(x), **{"lower" if s > 0.0 else "upper": float(q[i])})
        for name, x, s, i in zip(names, e, side, at, strict=True)
    ]
    found = bar.impact(q, v, stops)
    E, P = np.zeros((3, 4)), np.array([found.impulses[f"stop.{name}"] for name in names])
    E[range(3), at] = side
    push, before, after = side * P, E @ v, E @ found.v
    M, G = mass(bar, q), bar.G(q)
    assert np.abs(G.T @ (M @ (found.v - v) - E.T @ push)).max() < 1e-11
    assert np.abs(bar.K(q) @ found.v).max() < 1e-11
    first = -0.5 * push @ (after + before)
    assert found.loss == pytest.approx(first, rel=1e-10)
    assert push.min() >= 0.0 and after.min() > -1e-11
    if np.abs(push * (after + e * before)).max() < 1e-11:  # one impulse was enough
        assert found.loss == pytest.approx(0.5 * np.sum((1.0 - e) * np.abs(before) * push), rel=1e-10)


def test_a_lock_takes_the_part_of_what_it_stops() -> None:
    """Two masses that are coupled by nothing: the lock of one takes m v; the clutch keeps the sum."""
    pair = sliders(2.0, 3.0)
    one = pair.impact([0.0, 0.0], [4.0, 5.0], [rg.Lock("q1")])
    assert one.v == pytest.approx([0.0, 5.0]) and one.impulses["lock.q1"] == pytest.approx(-8.0)
    both = pair.impact([0.0, 0.0], [4.0, 5.0], [rg.Lock("q1", other="q2", ratio=1.0)])
    assert both.v == pytest.approx([4.6, 4.6]) and both.loss == pytest.approx(0.5 * 1.2, rel=1e-12)


def test_what_is_no_impact() -> None:
    with pytest.raises(rg.StateError, match="beyond Stop"):
        pendulum().impact([-0.8], [1.0], [rg.Stop("q1", lower=-0.7)])
    crank = rg.load("slider_crank")
    with pytest.raises(rg.StateError):
        crank.impact(crank.home, [1.0, 1.0, 1.0], [rg.Stop("q3", lower=0.0)])
    with pytest.raises(rg.ModelError, match="q9"):
        pendulum().impact([0.0], [1.0], [rg.Stop("q9", lower=0.0)])
