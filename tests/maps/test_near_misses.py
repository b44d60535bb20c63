"""Modes that pass each other without a crossing: where no bridge leads through is found out once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.cluster.curve import Curve
from robust_gcp.maps.cluster.curve_builder import CurveBuilder


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[CurveBuilder]:
    """The bridges that were tried."""
    made, build = list[CurveBuilder](), CurveBuilder.build

    def counted(self: CurveBuilder) -> Curve:
        made.append(self)
        return build(self)

    monkeypatch.setattr(CurveBuilder, "build", counted)
    return made


def turned(mech: rg.Mechanism, duration: float, independent: str = "q1") -> NDArray[np.float64]:
    """q and v of a run that turns over, in a row each."""
    start = mech.home, mech.lift(mech.home, [3.0])
    run = rg.simulate(mech.with_independent([independent]), *start, duration, 1e-3)
    assert run.stats.refined_steps > 0 and not run.crossings
    return np.hstack([run.q, run.v])


@pytest.mark.parametrize("miss", [1e-3, 1e-5, -1e-4])
def test_a_near_miss_is_found_out_once_and_passed_alike(tried: list[CurveBuilder], miss: float) -> None:
    """A four-bar that is a change-point linkage but for this, whose modes pass each other twice a turn."""
    mech = four_bar(1.0, 2.0 + miss, 1.5, 1.5, y=1.0)
    first = turned(mech, 5.0)
    once = len(tried)
    assert 0 < once <= 6  # from afar and from near, in each mode that it takes
    again = turned(mech, 5.0)
    assert len(tried) == once
    assert np.array_equal(first, again)
    fresh = turned(four_bar(1.0, 2.0 + miss, 1.5, 1.5, y=1.0), 1.0)
    assert np.array_equal(fresh, first[: len(fresh)])


def test_it_is_known_whatever_joint_is_independent(tried: list[CurveBuilder]) -> None:
    """Runs in other coordinates try no bridge where those in the first found none."""
    mech = four_bar(1.0, 2.001, 1.5, 1.5, y=1.0)
    turned(mech, 1.0)
    assert tried
    tried.clear()
    turned(mech, 1.0, "q2")
    assert not tried
