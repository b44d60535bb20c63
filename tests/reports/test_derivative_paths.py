"""The list of all ways to derivatives: which of them warn."""

from __future__ import annotations

import pytest

from robust_gcp.reports import derivative_paths, path_accuracy
from robust_gcp.reports.derivative_paths import CALLS, ways, worst
from tests.compiled import needs_kernel

pytestmark = needs_kernel


def test_the_kernel_leaves_none_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is called twice, as before it is timed, which is no matter here."""
    monkeypatch.setattr(derivative_paths, "least", lambda call, rounds: 1.0)
    found = ways(1)
    assert {way.what for way in found} >= set(CALLS)
    assert not [way for way in found if way.warned]
    assert {way.what for way in worst(found)} == {way.what for way in found}
    assert {
        "beside an apex, two coordinates",
        "singular, moving",
        "singular, at rest with mode=",
        "beside a dead point",
    } <= {way.where for way in found}


def test_the_largest_errors_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a few cases: nine digits in each, and an error of 1e-6 would be the largest."""
    found = list(path_accuracy.errors(every=32))
    assert {row.what for row in found} >= {"derivatives", "simulate", "Batch", "step after step", "lift"}
    for row in found:
        assert 0.0 <= row.least[0] <= row.largest[0] < 1e-9
        assert not row.refused and row.cases
    lift = {"lift": lambda motion: 1e-6 if motion.name == "RSSR" else 0.0}
    monkeypatch.setattr(path_accuracy, "CLOSED", lift)
    for name in ("AT_STATES", "RUNS"):
        monkeypatch.setattr(path_accuracy, name, {})
    monkeypatch.setattr(path_accuracy, "SLOPED", ())
    (last,) = [row for row in path_accuracy.errors() if row.what == "lift"]
    assert last.largest == (1e-6, "RSSR") and last.least[0] == 0.0
