"""Hessians of accelerations and of steps times a direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

from ..dynamics.test_derivatives import floating, moved

Array = NDArray[np.float64]

SCENES = {
    "crank_rocker": [2.0],
    "five_bar": [1.0, -0.5],
    "delta": [0.4, -0.5, 0.3],
    "stewart": [0.1, 0.2, -0.1, 0.3, 0.1, -0.2],
}

CURVED = np.array([8 / 5, -1 / 5, 8 / 315, -1 / 560])
"""f''(0) of order 8: (Σ w_k (f(kh) + f(−kh)) − 2 Σ w_k f(0)) / h²."""


def at(name: str) -> tuple[rg.Mechanism, Array, Array, Array]:
    mech = rg.load(name)
    run = rg.simulate(mech, v0=mech.lift(mech.home, SCENES[name]), duration=0.03, step=1e-3)
    return mech, run.q[-1], run.v[-1], np.random.default_rng(0).normal(size=mech.nv)


def parts(mech: rg.Mechanism, z: Array) -> dict[str, Array]:
    m = mech.m
    return {"dy": z[:m], "du": z[m : 2 * m], "dtau": z[2 * m :]}


@pytest.mark.parametrize("h", [None, 2e-3])
@pytest.mark.parametrize("name", SCENES)
def test_second_derivatives_are_symmetric(name: str, h: float | None) -> None:
    """H[a] b = H[b] a, for accelerations and steps; many states as one by one."""
    mech, q, v, tau = at(name)
    a, b = np.random.default_rng(1).normal(size=(2, 2 * mech.m + mech.nv))
    one = rg.second_derivatives(mech, q, v, tau, **parts(mech, a), h=h)
    other = rg.second_derivatives(mech, q, v, tau, **parts(mech, b), h=h)
    np.testing.assert_allclose(one @ b, other @ a, rtol=0, atol=1e-9 * np.abs(one @ b).max())
    rows: Any = [np.tile(part, (3, 1)) for part in (q, v, tau)]
    many = rg.second_derivatives(mech, *rows, **parts(mech, a), h=h)
    np.testing.assert_allclose(many, [one] * 3, rtol=0, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("name", SCENES)
def test_along_a_curve(name: str) -> None:
    """aᵀ H a is the second derivative of u̇ itself along y + s dy, u + s du, τ + s dτ."""
    mech, q, v, tau = at(name)
    m, h = mech.m, 0.02
    a = np.random.default_rng(2).normal(size=2 * m + mech.nv) / 3.0
    found = rg.second_derivatives(mech, q, v, tau, **parts(mech, a)) @ a

    def value(s: float) -> Array:
        there = moved(mech, q, s * a[:m])
        fast = mech.lift(there, v[mech.iv_independent] + s * a[m : 2 * m])
        return rg.forward_dynamics(mech, there, fast, tau + s * a[2 * m :])

    sums = sum(w * (value(k * h) + value(-k * h)) for k, w in enumerate(CURVED, 1))
    exact = (sums - 2.0 * CURVED.sum() * value(0.0)) / h**2
    np.testing.assert_allclose(found, exact, rtol=0, atol=2e-8 * np.abs(exact).max())


def test_the_rhombus_is_a_pendulum() -> None:
    """A ÿ = −B cos y + τ₁ − τ₂ + τ₃, as a parallelogram: ∂²ÿ/∂y² = B cos y / A, all others 0."""
    mech = rg.load("rhombus")
    for y in (0.7, 0.2, 0.02):
        q = mech.assemble([y, -y, y])
        found = rg.second_derivatives(mech, q, dy=[1.0])
        down = rg.forward_dynamics(mech, q)[0]  # −B cos y / A
        assert found[0, 0] == pytest.approx(-down, rel=1e-9)
        np.testing.assert_allclose(found[0, 1:], 0.0, atol=1e-8 * abs(down))


def test_at_a_singular_configuration_it_is_of_the_mode_that_the_motion_is_on() -> None:
    """Symmetric as elsewhere, and the mean of those on both sides of it, of the curved mode too."""
    mech = rg.load("parallelogram")
    for mode in rg.analyse(mech, np.zeros(3)).modes:
        found = rg.second_derivatives(mech, np.zeros(3), 2.0 * mode, dy=[1.0])
        sides = []
        for y in (1e-3, -1e-3):
            q = mech.assemble(y * mode / mode[0])
            sides.append(rg.second_derivatives(mech, q, mech.lift(q, [2.0 * mode[0]]), dy=[1.0]))
        np.testing.assert_allclose(found, sum(sides) / 2, rtol=0, atol=1e-4 * np.abs(found).max())


def test_on_a_floating_base() -> None:
    """Along the velocities of the base: the slope of `derivatives` at states that are moved so."""
    mech = floating(pin.JointModelFreeFlyer())
    v = mech.lift(mech.home, [0.3] * 7)
    direction, h = np.random.default_rng(3).normal(size=7), 1e-3
    found = rg.second_derivatives(mech, mech.home, v, dy=direction)

    def first(s: float) -> Array:
        there = moved(mech, mech.home, s * direction)
        d = rg.derivatives(mech, there, mech.lift(there, [0.3] * 7))
        return np.hstack([d.da_dy, d.da_dv, d.da_dtau])

    exact = (8.0 * (first(h) - first(-h)) - first(2.0 * h) + first(-2.0 * h)) / (12.0 * h)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8 * np.abs(exact).max())


def test_refused() -> None:
    mech = rg.load("rhombus")
    with pytest.raises(rg.RobustGcpError):
        rg.second_derivatives(mech, np.zeros(3), dy=[1.0])  # flat
    with pytest.raises(rg.ClosureError, match=r"q\[1\].*open"):
        rg.second_derivatives(mech, [mech.home, mech.home + [0.0, 0.1, 0.0]], dy=[1.0])
    with pytest.raises(rg.StateError, match="breaks the loop"):
        rg.second_derivatives(mech, mech.home, [1.0, 2.0, 3.0], dy=[1.0])
    with pytest.raises(rg.StateError, match="tau is held"):
        rg.second_derivatives(mech, mech.home, tau=lambda t, q, v: np.zeros(3))  # type: ignore[arg-type]
    with pytest.raises(rg.StateError, match="dy"):
        rg.second_derivatives(mech, mech.home, dy=[1.0, 2.0])
