"""Extreme motions: the library keeps to the closed form, or says why not."""

import tracemalloc
import warnings

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.reports.stability import extreme_motion
from robust_gcp.reports.stability.extreme_tools import RHOMBUS, Motion
from robust_gcp.reports.stability.judge import judge_all


@pytest.mark.parametrize(
    ("family", "right", "stopped"),
    [
        ("speeds", 2, 1),
        ("gravity", 8, 0),
        ("steps", 3, 2),
        pytest.param("energies", 6, 0, marks=pytest.mark.slow),
        pytest.param("long runs", 1, 0, marks=pytest.mark.slow),
    ],
)
def test_no_cell_is_wrong_without_saying_so(family, right, stopped):
    cells = judge_all(extreme_motion.FAMILIES[family](True))
    assert [(c.case.name, c.reason) for c in cells if c.verdict == "wrong"] == []
    assert sum(c.verdict in ("right", "coarse") for c in cells) >= right
    assert sum(c.verdict == "stopped" for c in cells) <= stopped


def test_thrown_motions_have_the_energy_that_they_are_named_for():
    # the kinetic energy at the start against the height to the top, the highest place on the way
    for case in extreme_motion.energies(True)[:2]:
        mechanism, q0, v0 = case.build()
        linkage = Motion((4.0, 2.0, 3.0, 3.0), 2.5).linkage
        heights = [
            mechanism.energy(linkage.evaluate(y)[0], np.zeros(3)) for y in np.pi + np.linspace(-0.2, 0.2, 41)
        ]
        assert int(np.argmax(heights)) == 20
        share = (mechanism.energy(q0, v0) - mechanism.energy(q0, np.zeros(3))) / (
            heights[20] - mechanism.energy(q0, np.zeros(3))
        )
        assert abs(share - 1.0) == pytest.approx(1e-2, rel=1e-6)


def test_memory_does_not_grow_beyond_what_is_recorded():
    mechanism, q0, v0 = Motion(RHOMBUS, 0.2).build()
    peaks = []
    for count in (200, 800):
        tracemalloc.start()
        rg.simulate(mechanism, q0, v0, duration=count * 5e-3, step=5e-3, backend="python")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    recorded = 600 * (3 + 3 + 1) * 8
    # times are counted a few times over, and each crossing (one a tenth of a second or so) has its record
    assert peaks[1] - peaks[0] < 6 * recorded


@pytest.mark.parametrize("speed", [1e60, 1e100, 1e153, 1e200])
def test_speeds_whose_products_overflow_are_refused_at_the_start(speed):
    mechanism, q0, v0 = Motion(RHOMBUS, 0.2, speed).build()
    for stepper in ("rk4", "DOP853"):
        with pytest.raises(rg.NonFiniteError, match="velocity is too large"):
            rg.simulate(mechanism, q0, v0, duration=1e-3, stepper=stepper)


def test_fast_motions_stop_with_a_reason_and_soon():
    mechanism, q0, v0 = Motion(RHOMBUS, 0.2, 1e40).build()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rg.StabilityWarning)
        with pytest.raises(rg.BranchError, match="use a smaller step"):
            rg.simulate(mechanism, q0, v0, duration=1e-2, step=1e-3)
