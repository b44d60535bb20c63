"""The table of memory against velocities."""

from __future__ import annotations

import sys

import pytest

from robust_gcp.reports.memory import rows


@pytest.mark.skipif(sys.platform != "linux", reason="measured where the system tells")
def test_a_mechanism_of_many_joints_takes_far_less_than_a_whole_workspace() -> None:
    ((count, computed, taken, whole, _),) = rows((300,))
    assert count == "300"
    assert float(computed) < float(taken) + 5.0
    assert float(taken) < 0.1 * float(whole)
