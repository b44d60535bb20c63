"""Controls that are held, of actuators along paths that the compiled kernel does not know."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.actuation.site_paths import SiteForce
from tests.compiled import needs_kernel

CTRL = {"thrust": 0.7, "lag": 1.0}


def machine() -> rg.Mechanism:
    """The rhombus with a jet at the coupler's tip, and one whose thrust lags."""
    shipped = rg.load("rhombus")
    jets = [
        rg.Actuator("thrust", SiteForce("coupler_tip", (0.0, 3.0, 1.0, 0.2, 0.0, 0.0))),
        rg.Actuator(
            "lag", SiteForce("coupler_tip", (0.0, 0.0, 2.0, 0.0, 0.0, 0.0)), dynamics="filter", time=(0.05,)
        ),
    ]
    return rg.Mechanism.from_pinocchio(
        shipped.model, shipped.closures, shipped.independent, shipped.home, actuators=jets
    )


@needs_kernel
@pytest.mark.parametrize("joints", [[], [rg.Stop("q1", upper=0.25, restitution=0.5)]])
def test_they_act_as_they_do_where_nothing_is_held(joints: list[rg.Stop]) -> None:
    mech = machine()
    kept = {"duration": 0.2, "step": 1e-3, "joints": joints}
    plain = rg.simulate(mech, ctrl=CTRL, **kept)
    assert np.abs(plain.q[-1] - rg.simulate(mech, **kept).q[-1]).max() > 1e-2
    held = rg.simulate(mech, ctrl=CTRL, hold=True, **kept)
    np.testing.assert_allclose(held.q, plain.q, atol=1e-10)
    sim = rg.Simulation(mech, step=1e-3, joints=joints, ctrl=CTRL)
    sim.step(n=120)
    middle = sim.save()
    sim.step(n=80)
    np.testing.assert_allclose(sim.q, plain.q[-1], atol=1e-10)
    sim.restore(middle)
    for _ in range(80):
        sim.step()
    np.testing.assert_allclose(sim.q, plain.q[-1], atol=1e-10)


@needs_kernel
def test_controls_that_change_act_from_the_next_step_on() -> None:
    mech = machine()
    sims = [rg.Simulation(mech, step=1e-3, backend=backend) for backend in ("native", "python")]
    for k in range(60):
        for sim in sims:
            sim.step([0.1 * k, 0.0, 0.0], ctrl={"thrust": np.sin(k), "lag": float(k > 20)} if k > 5 else None)
    assert sims[0]["actuator.thrust"] == pytest.approx(np.sin(59), rel=1e-12)
    np.testing.assert_allclose(sims[0].q, sims[1].q, atol=1e-11)
    np.testing.assert_allclose(sims[0].v, sims[1].v, atol=1e-10)
