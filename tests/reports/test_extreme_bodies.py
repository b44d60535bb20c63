"""Extreme bodies: the library keeps to the closed form, or says why not."""

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.reports.stability import extreme_bodies
from robust_gcp.reports.stability.extreme_tools import CHANGE_POINT, Motion
from robust_gcp.reports.stability.judge import judge_all


@pytest.mark.parametrize(
    ("family", "right", "stopped"),
    [
        ("mass ratios", 3, 1),
        ("massless links", 7, 4),
        ("point masses", 2, 2),
        ("length ratios", 10, 4),
        ("units", 4, 0),
    ],
)
def test_no_cell_is_wrong_without_saying_so(family, right, stopped):
    cells = judge_all(extreme_bodies.FAMILIES[family](True))
    assert [(c.case.name, c.reason) for c in cells if c.verdict == "wrong"] == []
    assert sum(c.verdict == "right" for c in cells) >= right
    assert sum(c.verdict == "stopped" for c in cells) <= stopped


@pytest.mark.parametrize(("length", "mass", "time"), [(1e-6, 1e-9, 1e-3), (1e3, 1e9, 60.0)])
def test_crossings_do_not_depend_on_units(length, mass, time):
    def run(L: float, M: float, T: float) -> rg.Trajectory:
        lengths = tuple(L * x for x in CHANGE_POINT)
        motion = Motion(lengths, 2.5, masses=(M, M, M), gravity=(0.0, -9.81 * L / T**2))
        mechanism, q0, v0 = motion.build()
        return rg.simulate(mechanism, q0, v0, duration=2.5 * T, step=5e-3 * T)

    si, other = run(1.0, 1.0, 1.0), run(length, mass, time)
    assert np.abs(si.q - other.q).max() < 1e-10
    assert len(si.crossings) == len(other.crossings) == 2
    for a, b in zip(si.crossings, other.crossings, strict=True):
        assert b.time / time == pytest.approx(a.time, abs=1e-10)
        assert b.kind == a.kind
        assert b.transversality == pytest.approx(a.transversality, rel=1e-6)


@pytest.mark.parametrize("mass", [1e-16, 1e-18, 1e-300])
def test_bodies_that_pinocchio_misplaces_are_refused(mass):
    body = pin.Inertia(mass, np.array([0.0, 0.5, 0.0]), np.zeros((3, 3)))
    assert abs((body + pin.Inertia.Zero()).lever[1] - 0.5) > 0.1  # the reason
    with pytest.raises(rg.ModelError, match="larger unit of mass"):
        four_bar(4.0, 2.0, 3.0, 3.0, masses=(mass, mass, mass))
