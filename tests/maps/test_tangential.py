"""Singularities that second order does not decide: the run stops and says what it knows."""

from collections.abc import Callable

import numpy as np
import pytest

import robust_gcp as rg


@pytest.mark.parametrize("theta", [np.pi / 2, 1.0], ids=["tangential", "cusp"])
def test_local_analysis_does_not_certify(trammel: Callable[..., rg.Mechanism], theta: float):
    mechanism = trammel(theta)
    here = rg.analyse(mechanism, mechanism.home)
    assert here.kind == "not certified"
    assert here.modes == ()
    assert here.rank == 3
    assert here.local_dof is None


@pytest.mark.parametrize("theta", [np.pi / 2, 1.0], ids=["tangential", "cusp"])
def test_simulation_stops_with_what_is_known(trammel: Callable[..., rg.Mechanism], theta: float):
    mechanism = trammel(theta)
    # the folded side: where |T − O| < ρ
    sides = []
    for delta in (0.3, -0.3):
        guess = mechanism.home + np.array([0.0, -delta, 0.0, 0.4, -0.8])
        guess[0], guess[2] = np.cos(theta + delta), np.sin(theta + delta)
        try:
            sides.append((delta, mechanism.assemble(guess)))
        except rg.ClosureError:
            continue
    assert len(sides) == (2 if theta == np.pi / 2 else 1)
    delta, q0 = sides[0]
    v0 = mechanism.lift(q0, [3.0 * np.sign(delta)])  # towards θ*: the ladder's angle is π − θ
    with pytest.raises((rg.NotCertifiedError, rg.ToggleError)) as caught:
        rg.simulate(mechanism, q0, v0=v0, duration=0.5, step=1e-3)
    stopped = caught.value.trajectory
    assert len(stopped.t) > 5
    assert stopped.closure_error().max() < 1e-12
    assert np.abs(stopped.energy_error()).max() < 1e-6
    if theta == np.pi / 2:
        assert isinstance(caught.value, rg.NotCertifiedError)


def test_start_at_an_uncertified_point_is_refused(trammel: Callable[..., rg.Mechanism]):
    mechanism = trammel(np.pi / 2)
    with pytest.raises(rg.NotCertifiedError, match="tangential or higher order"):
        rg.simulate(mechanism, mechanism.home)
