"""What tests of the compiled kernel need."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

import robust_gcp as rg
from robust_gcp.kernel.derivatives.step_derivatives import Derivation
from robust_gcp.mechanism.tree.tree import Array

KERNEL = rg.backends()["native"]

needs_kernel = pytest.mark.skipif(not KERNEL.available, reason=f"no compiled kernel: {KERNEL.reason}")


def some(seeds: Iterable[int], count: int) -> list[Any]:
    """The seeds, of which `count` evenly chosen ones run always and the others in a campaign."""
    each = list(seeds)
    usual = {each[i * len(each) // count] for i in range(count)}
    return [seed if seed in usual else pytest.param(seed, marks=pytest.mark.campaign) for seed in each]


def stepped(
    kernel: Derivation, q: Array, v: Array, tau: Array | None, h: float
) -> tuple[Array, Array] | None:
    """A (2m, 2m) and B (2m, nv) of one step from a state, given as rows of one; None where it is not good."""
    good, _, _, A, B = kernel.step_each(q, v, tau, h, True)
    if not good[0]:
        return None
    assert A is not None and B is not None  # they were asked for
    return A[0], B[0]
