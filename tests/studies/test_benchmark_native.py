"""The timing of the kernel: what it measures is the kernel's own work."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import n_four_bar
from robust_gcp.native.library import library
from robust_gcp.studies.benchmark import batches, native_seconds, thread_gain

pytestmark = pytest.mark.skipif(not rg.backends()["native"].available, reason="no compiled kernel")


def test_a_step_costs_microseconds() -> None:
    """Some 2 µs for one loop, which grows with the loops and stays far below Python's milliseconds."""
    one, ten = native_seconds(n_four_bar(1, 1.2)), native_seconds(n_four_bar(10, 1.2))
    assert 1e-7 < one["native_step"] < ten["native_step"] < 1e-4
    assert 1e-8 < one["pinocchio_rhs"] < ten["pinocchio_rhs"] < 1e-4
    assert one["native_newton"] == 0.0  # on the parallelogram mode G is constant: predictions are exact


def test_two_threads_run() -> None:
    """Two threads finish what two threads were given; how much faster depends on what else runs."""
    assert 0.3 < thread_gain(rg.load("crank_rocker"), steps=500) < 2.5


def test_a_batch_that_stops_early_is_no_measurement() -> None:
    """Falling into the zone of a singular configuration ends a batch."""
    found = library()
    assert found is not None
    _, run = batches(found, n_four_bar(1, 0.2), 500, 1e-3)
    with pytest.raises(RuntimeError, match="ZONE"):
        run()
    assert np.isfinite(batches(found, n_four_bar(1, 1.2), 5, 1e-3)[1]()[0])
