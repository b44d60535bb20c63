"""The kernel's memory of a mechanism: handed on to the next run, freed once, never while it is read."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

import pytest

import robust_gcp as rg
from robust_gcp.kernel.library import library


@pytest.fixture
def living(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """How many that were made in this test live; one that is freed twice, or unknown, is an error."""
    kernel = library()
    if kernel is None:
        pytest.skip("the kernel is not built")
    create, destroy = kernel.create, kernel.destroy
    gc.collect()
    addresses: set[int] = set()

    def created(*args: Any) -> int:
        address = int(create(*args))
        addresses.add(address)
        return address

    def destroyed(address: int) -> None:
        addresses.remove(address)
        destroy(address)

    monkeypatch.setattr(kernel, "create", created)
    monkeypatch.setattr(kernel, "destroy", destroyed)
    return lambda: len(addresses)


def abandoned_in_a_cycle(mechanism: rg.Mechanism) -> None:
    """A simulation that only the collector of cycles finds."""
    cycle: dict[str, object] = {"sim": rg.Simulation(mechanism, step=1e-3).step(n=3)}
    cycle["itself"] = cycle


def test_what_a_dead_cycle_leaves_to_the_next_run_is_not_freed(living: Callable[[], int]) -> None:
    mechanism = rg.load("rhombus")
    reference = rg.simulate(mechanism, duration=0.1).q
    for _ in range(3):
        abandoned_in_a_cycle(mechanism)
        gc.collect()
        assert living() >= 1
        assert (rg.simulate(mechanism, duration=0.1).q == reference).all()


def test_memory_is_freed_with_its_mechanism(living: Callable[[], int]) -> None:
    mechanism = rg.load("crank_rocker")
    for _ in range(4):
        abandoned_in_a_cycle(mechanism)
    kept = [rg.Simulation(mechanism, step=1e-3).step() for _ in range(5)]
    assert living() >= 5
    del kept, mechanism
    gc.collect()
    assert living() == 0
