"""Motions where the mobility changes, and to the cusp of the double Watt linkage: orders, cuts, energy."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.kinematotropic import Mode, wunderlich
from robust_gcp.examples.meetings import double_watt
from tests.analysis.test_published_modes import BARS, turning
from tests.compiled import needs_kernel

BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]

CUTS = [
    ("a10b10", "c01b01", "a01b11", "a11b11", "c11b11"),
    ("c00b01", "a00b10", "a01b01", "c11b11", "a11b11"),
    ("a10", "c10b11", "c01b01", "a11b01", "c11b10"),
]


@pytest.mark.parametrize("backend", BACKENDS)
def test_full_order_where_the_mobility_changes(backend: str) -> None:
    """A mode of mobility 1 through two places where it meets one of mobility 2."""
    mechanism = wunderlich("2P4A", (0.0, 1.6))
    v0 = mechanism.lift(mechanism.home, [-6.0])

    def run(steps: int) -> rg.Trajectory:
        return rg.simulate(mechanism, v0=v0, duration=0.4, step=0.4 / steps, backend=backend)

    best = run(800)
    assert [(c.kind, c.corank, c.order) for c in best.crossings] == [("transversal", 2, 1)] * 2
    errors = [np.abs(run(n).q[-1] - best.q[-1]).max() for n in (50, 100, 200)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.1)
    assert np.abs(best.energy_error()).max() < 1e-9


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("mode", ["2P4A", "6P", "6A"])
def test_any_cut_where_the_mobility_changes(mode: Mode, backend: str) -> None:
    """The same motion and the same crossings, on modes of mobility 1 and 2."""
    told = []
    for cuts in CUTS:
        mechanism = wunderlich(mode, (0.4, 1.6), cuts=cuts)
        v0 = mechanism.lift(mechanism.home, [{"a00": 4.0, "c00": -6.0}[n] for n in mechanism.independent])
        run = rg.simulate(mechanism, v0=v0, duration=0.4, step=1e-3, backend=backend)
        turned = turning(mechanism, run.q[-1])
        told.append(([turned[b] for b in BARS], [(c.kind, c.corank) for c in run.crossings]))
        assert np.abs(run.energy_error()).max() < 2e-8
    for bars, crossings in told[1:]:
        assert bars == pytest.approx(told[0][0], abs=1e-8)
        assert crossings == told[0][1]
    assert len(told[0][1]) == {"2P4A": 2, "6P": 2, "6A": 0}[mode]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_mode_of_two_freedoms_through_the_place_where_one_of_one_meets_it(backend: str) -> None:
    """A point of its surface, through which its own motion goes there and back."""
    mechanism = wunderlich("2P4A", (0.0, 1.6))
    v0 = mechanism.lift(mechanism.home, [-6.0])
    place = rg.simulate(mechanism, v0=v0, duration=0.2, step=1e-3).crossings[0].q
    here = rg.analyse(mechanism, place)
    larger = next(mode for mode in here.modes if mode.ndim == 2)
    mechanism = rg.Mechanism(mechanism.own_model, mechanism.loops, ["a00", "c00"], home=place)
    way = larger @ np.array([1.0, -0.4])
    out = rg.simulate(mechanism, place, 3.0 * way, 0.1, 1e-3, mode=larger, backend=backend)
    back = rg.simulate(mechanism, out.q[-1], -out.v[-1], 0.2, 1e-3, backend=backend)
    assert back.q[100] == pytest.approx(place, abs=1e-10)
    assert [(round(c.time, 9), c.kind, c.corank) for c in back.crossings] == [(0.1, "transversal", 1)]
    assert mechanism.closure_residual(back.q[-1]) < 1e-14
    with pytest.raises(rg.NotCertifiedError, match="dimension 1, not 2"):
        rg.simulate(mechanism, place, duration=0.1, step=1e-3, mode=[m.ndim for m in here.modes].index(1))


# --------------------------------------------------------------------------- the double Watt linkage


def before_the_cusp(mechanism: rg.Mechanism) -> np.ndarray:
    """Where the first crank is 0.4 rad below it."""
    own = rg.analyse(mechanism, mechanism.home).modes[0]
    return mechanism.assemble(mechanism.home - 0.4 * own / own[mechanism.iv_independent], hold=["low0"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_to_the_double_watt_linkages_cusp(backend: str) -> None:
    """When and how fast it arrives, in other coordinates; natively in another tree too."""
    arrivals = []
    for cuts in (("cut0", "cut1", "bar1"), ("low1", "cut0", "bar0"))[: 2 if backend == "native" else 1]:
        first = double_watt(cuts=cuts)
        q = before_the_cusp(first)
        for joint in ("low0", "coupler0"):
            mechanism = rg.Mechanism(first.own_model, first.loops, [joint], home=q)
            v = mechanism.lift(q, first.lift(q, [6.0])[mechanism.iv_independent])
            with pytest.raises(rg.CuspError) as caught:
                rg.simulate(mechanism, q, v, 0.2, 1e-3, backend=backend)
            error = caught.value
            assert error.q == pytest.approx(first.home, abs=1e-9)
            assert mechanism.energy(error.q, error.v) == pytest.approx(mechanism.energy(q, v), abs=1e-7)
            arrivals.append(error.time)
    assert arrivals == pytest.approx([arrivals[0]] * len(arrivals), abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_back_from_the_double_watt_linkages_cusp(backend: str) -> None:
    """On the other branch, on which the bar leans to the other side; energy kept."""
    mechanism = double_watt()
    q = before_the_cusp(mechanism)
    run = rg.simulate(mechanism, q, mechanism.lift(q, [6.0]), 0.2, 1e-3, on_cusp="turn", backend=backend)
    leaning = run.q[:, [mechanism.joint(name).idx_q for name in ("low0", "coupler0", "bar0")]].sum(axis=1)
    low = run.q[:, mechanism.joint("low0").idx_q]
    turned = int(np.argmax(low))
    assert leaning[0] * leaning[-1] < 0.0 and 40 < turned < 160
    near = slice(turned + 10, turned + 25)
    assert leaning[near] == pytest.approx(-np.interp(low[near], low[:turned], leaning[:turned]), rel=0.08)
    assert np.abs(run.energy_error()).max() < 1e-6
