"""Crossings: random change-point linkages against the closed form, and how they are judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from .conftest import Block
from .crossings import crossing
from .random_cases import bad, figures, passed

SEED, COUNT = 20, 1000


@pytest.mark.campaign
def test_crossings_are_followed_and_counted(block: Block, record_property: Callable[..., None]) -> None:
    cases = [crossing(block.seed, index) for index in block.indices]
    landed = {"landed within 1e-12 rad of the crossing": sum(case.nearest <= 1e-12 for case in cases)}
    record_property(f"crossings, seed {block.seed}", figures(cases) | landed)
    assert not bad(cases)


def test_some_crossings_are_followed_and_counted() -> None:
    cases = [crossing(4, index) for index in range(6)]
    assert not bad(cases)
    assert sum(case.expected for case in cases) > 4
    assert any(case.nearest < 1e-12 for case in cases)
    case = next(case for case in cases if case.expected)
    assert not replace(case, crossings=case.expected - 1).good
    assert not replace(case, crossings=case.expected + 1).good


def test_passages_are_counted_by_turns() -> None:
    """Forth and back, over a whole turn, beside the place, and one that ends on it: it may count or not."""
    t = np.linspace(0.0, 1.0, 101)[:, None]
    cranks = np.hstack([np.sin(2.0 * np.pi * t) + 0.5, 7.0 * t + 0.1, 0.3 * t + 0.1, t - 1.0])
    expected, logged = passed(cranks, np.zeros(4), np.array([2, 1, 0, 0]))
    assert expected.tolist()[:3] == [2, 1, 0]
    assert logged.tolist() == [2, 1, 0, expected[3]]
