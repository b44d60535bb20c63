"""Gᵀ M G: what it is, what cancels in it, and when it is refused."""

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics.reduced_inertia import ReducedInertia
from robust_gcp.examples.linkages import four_bar, swinging_four_bar


def without_gravity(mechanism: rg.Mechanism) -> pin.Model:
    model = mechanism.model.copy()
    model.gravity.linear = np.zeros(3)
    return model


@pytest.mark.parametrize("ratio", [1.0, 1e-3, 1e-6])
def test_reduced_inertia_of_a_parallelogram_of_any_size(ratio):
    # rods of 1 kg: m1 l1²/3 + m2 l1² + m3 l3²/3; in the products of G and M it cancels from 1 to l1²
    mechanism = four_bar(1.0, ratio, 1.0, ratio)
    G = np.array([[1.0], [-1.0], [1.0]])
    ydd = ReducedInertia(mechanism).solve(mechanism.home, G, np.ones(1))
    assert ydd[0] * 5.0 / 3.0 * ratio**2 == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 1e-4, 1e-6])
def test_solution_balances_the_inertia_forces(ratio):
    # Gᵀ RNEA(q, 0, G ÿ) = f without gravity, for mobility 2 and for links that hardly move
    plain = swinging_four_bar(1.0, ratio, 1.0, ratio, swing=0.3, y=0.5)
    model = without_gravity(plain)
    q = plain.home
    G = np.array([plain.lift(q, e) for e in np.eye(2)]).T
    force = np.array([0.3, -0.2 * ratio**2])
    ydd = ReducedInertia(plain).solve(q, G, force)
    balance = G.T @ pin.rnea(model, model.createData(), q, np.zeros(4), G @ ydd)
    assert balance == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize("masses", [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
def test_motion_that_moves_no_mass_is_refused(masses):
    # on this mode of the rhombus the rocker rests; rounding moves it by 1e-16
    mechanism = four_bar(1.0, 1.0, 1.0, 1.0, y=0.5, assembly=-1, masses=masses)
    with pytest.raises(rg.SimulationError, match="moves no mass"):
        rg.simulate(mechanism, duration=0.1, step=1e-2)


@pytest.mark.parametrize("massless", [(1, 2, 3, 4), (2, 3, 4)])
def test_massless_links_of_mobility_two_are_refused(massless):
    plain = swinging_four_bar(4.0, 2.0, 3.0, 3.0, swing=-0.5, y=2.5)
    model = plain.model.copy()
    for joint in massless:
        model.inertias[joint] = pin.Inertia.Zero()
    mechanism = rg.Mechanism(model, plain.closures, plain.independent, plain.home)
    with pytest.raises(rg.SimulationError, match="moves no mass"):
        rg.simulate(mechanism, duration=0.1, step=1e-2)


def test_one_link_with_mass_is_enough():
    mechanism = four_bar(4.0, 1.0, 3.0, 3.5, masses=(0.0, 0.0, 1.0))
    run = rg.simulate(mechanism, duration=0.5, step=2e-3)
    assert np.abs(run.energy_error()).max() < 1e-8
