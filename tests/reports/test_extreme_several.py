"""Clusters in their zones at once, floating bases and couplings keep to their exact equations."""

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.reports.stability import extreme_several
from robust_gcp.reports.stability.judge import judge_all


@pytest.mark.parametrize("family", extreme_several.FAMILIES)
def test_every_cell_is_right(family: str) -> None:
    cells = judge_all(extreme_several.FAMILIES[family](True))
    assert [(c.case.name, c.setting.label, c.reason) for c in cells if c.verdict != "right"] == []
    assert all(c.crossings >= 1 for c in cells)


def test_two_clusters_cross_together_and_at_order_four() -> None:
    """1e-8 rad apart, both zones are entered in one step, and the error falls with the fourth power."""
    case = next(c for c in extreme_several.clusters(False) if c.name == "side by side, 1e-08 rad apart")
    assert case.reference is not None
    errors = []
    for n in (50, 100):
        run = rg.simulate(*case.build(), case.duration, case.duration / n)
        errors.append(np.abs(run.q - case.reference(run.t)).max())
    assert abs(run.crossings[0].time - run.crossings[1].time) < 1e-6
    assert {crossing.cluster for crossing in run.crossings} == {0, 1}
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)
