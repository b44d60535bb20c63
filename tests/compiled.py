"""What tests of the compiled kernel need."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

import robust_gcp as rg

KERNEL = rg.backends()["native"]

needs_kernel = pytest.mark.skipif(not KERNEL.available, reason=f"no compiled kernel: {KERNEL.reason}")


def some(seeds: Iterable[int], count: int) -> list[Any]:
    """The seeds, of which `count` evenly chosen ones run always and the others in a campaign."""
    each = list(seeds)
    usual = {each[i * len(each) // count] for i in range(count)}
    return [seed if seed in usual else pytest.param(seed, marks=pytest.mark.campaign) for seed in each]
