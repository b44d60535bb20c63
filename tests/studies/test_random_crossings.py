"""Random crossings: a dozen of what `robust-gcp reports crossings` does by the thousand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robust_gcp.studies.crossings import random_crossings
from robust_gcp.studies.random_cases import passed


def test_a_dozen_crossings_are_followed_and_counted() -> None:
    cases, _ = random_crossings(12, 4)
    assert [case for case in cases if not case.good] == []
    assert sum(case.expected for case in cases) > 8
    (case, *_) = (case for case in cases if case.expected)
    assert not replace(case, crossings=case.expected - 1).good
    assert not replace(case, crossings=case.expected + 1).good


def test_passages_are_counted_by_turns() -> None:
    """Forth and back, over a whole turn, beside the place, and one that ends on it: it may count or not."""
    t = np.linspace(0.0, 1.0, 101)[:, None]
    cranks = np.hstack([np.sin(2.0 * np.pi * t) + 0.5, 7.0 * t + 0.1, 0.3 * t + 0.1, t - 1.0])
    expected, logged = passed(cranks, np.zeros(4), np.array([2, 1, 0, 0]))
    assert expected.tolist()[:3] == [2, 1, 0]
    assert logged.tolist() == [2, 1, 0, expected[3]]
