"""Several loops at singular places together: each crossing is logged, whatever the stepper."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import families, linkages
from robust_gcp.examples.six_bars import CHANGE_POINT, joined_by_dyad
from robust_gcp.mechanism.tree.tree import Array

TRIPLE_ROCKER = (1.0, 1.2, 1.4, 0.7)
TIGHT = {"stepper": "DOP853", "rtol": 1e-12, "atol": 1e-12}
TURN = 0.325
"""s; soon after it the links of the triple rocker fly by, within steps with error control."""


@pytest.fixture(scope="module")
def flying_by() -> tuple[Array, Array]:
    linkage = linkages.four_bar(*TRIPLE_ROCKER, y=1.5)
    run = rg.simulate(linkage, v0=linkage.lift(linkage.home, [3.0]), duration=TURN, step=TURN / 50, **TIGHT)
    return run.q[-1], run.v[-1]


@pytest.mark.parametrize(
    ("backend", "stepper"),
    [*((b, "rk4") for b in ("python", "native")), ("auto", "DOP853"), ("auto", "Radau")],
)
@pytest.mark.parametrize("after", [0.006, 0.009, 0.018, 0.023])
def test_a_loop_crosses_in_the_step_in_which_another_changes_coordinates(
    flying_by: tuple[Array, Array], backend: Any, stepper: str, after: float
) -> None:
    """A crank of 40 rad/s passes its zone within a step of 10 ms; the other loop is of another cluster."""
    if backend == "native" and not rg.backends()["native"].available:
        pytest.skip("no compiled kernel")
    angle = np.pi - 40.0 * after
    alone = linkages.four_bar(*CHANGE_POINT, y=angle)
    reference = rg.simulate(alone, v0=alone.lift(alone.home, [40.0]), duration=0.03, step=1e-2, **TIGHT)
    both = families.four_bars([TRIPLE_ROCKER, CHANGE_POINT], (1.5, angle))
    q = np.concatenate([flying_by[0], both.home[3:]])
    v = both.lift(q, [flying_by[1][0], 40.0])
    tight = {} if stepper == "rk4" else {"rtol": 1e-10, "atol": 1e-12}
    run = rg.simulate(both, q, v, duration=0.03, step=1e-2, backend=backend, stepper=stepper, **tight)
    other = rg.simulate(
        both.with_independent(["coupler0", "crank1"]), q, v, duration=0.03, step=1e-2, **TIGHT
    )
    changed = [t for t, _ in run.stats.repartitions]
    if stepper == "rk4":
        assert any(t % 0.01 > 1e-6 for t in changed)  # within a step
        sim = rg.Simulation(both, q, v, step=1e-2, backend=backend).step(n=3)
        assert [c.time for c in sim.crossings] == pytest.approx([c.time for c in run.crossings], abs=1e-10)
    for found in (run, other):
        assert [c.cluster for c in found.crossings] == [1]
        assert found.crossings[0].time == pytest.approx(reference.crossings[0].time, abs=1e-8)
        np.testing.assert_allclose(found.crossings[0].q[3:], reference.crossings[0].q, atol=1e-12)


LOOPS = (((2.8, 2.5), (3.0, 0.5), 0.2), ((2.9, 2.95), (3.0, 3.0), 0.12))
"""Cranks, their rates and a duration: one loop crosses, or both in each other's zones."""


@pytest.mark.parametrize(
    ("stepper", "cranks", "rates", "duration"),
    [
        *((s, *LOOPS[0]) for s in ("RK45", "DOP853", "Radau", "BDF")),
        ("RK45", *LOOPS[1]),
        ("DOP853", *LOOPS[1]),
    ],
)
def test_solvers_cross_in_a_cluster_of_several_coordinates(
    stepper: str, cranks: tuple[float, float], rates: tuple[float, float], duration: float
) -> None:
    """Two loops joined by a dyad, as fixed steps cross there."""
    mechanism = joined_by_dyad(cranks)
    v0 = mechanism.lift(mechanism.home, rates)
    fixed = rg.simulate(mechanism, v0=v0, duration=duration, step=2.5e-4)
    options: dict[str, Any] = {"stepper": stepper, "rtol": 1e-9, "atol": 1e-11}
    run = rg.simulate(mechanism, v0=v0, duration=duration, step=1e-3, **options)
    assert len(run.crossings) == len(fixed.crossings) == 1 + (rates[1] > 1.0)
    for found, wanted in zip(run.crossings, fixed.crossings, strict=True):
        assert found.time == pytest.approx(wanted.time, abs=1e-8)
        np.testing.assert_allclose(found.q, wanted.q, atol=1e-6)
    assert np.abs(run.q - fixed.q[::4]).max() < 1e-7
    assert np.abs(run.energy_error()).max() < 1e-4
