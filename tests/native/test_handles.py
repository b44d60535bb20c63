"""The kernel's memory of a mechanism: handed on to the next run, freed once, never while it is read."""

from __future__ import annotations

import gc

import pytest

import robust_gcp as rg
from robust_gcp.native.library import library


@pytest.fixture
def freed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The addresses that were freed, in order."""
    kernel = library()
    if kernel is None:
        pytest.skip("the kernel is not built")
    addresses: list[int] = []
    destroy = kernel.destroy
    monkeypatch.setattr(kernel, "destroy", lambda address: (addresses.append(address), destroy(address)))
    return addresses


def abandoned_in_a_cycle(mechanism: rg.Mechanism) -> None:
    """A simulation that only the collector of cycles finds."""
    cycle: dict[str, object] = {"sim": rg.Simulation(mechanism, step=1e-3).step(n=3)}
    cycle["itself"] = cycle


def test_what_a_dead_cycle_leaves_to_the_next_run_is_not_freed(freed: list[int]) -> None:
    mechanism = rg.load("rhombus")
    reference = rg.simulate(rg.load("rhombus"), duration=0.1).q
    gc.collect()
    freed.clear()
    for _ in range(3):
        abandoned_in_a_cycle(mechanism)
        gc.collect()
        assert freed == []
        assert (rg.simulate(mechanism, duration=0.1).q == reference).all()


def test_memory_is_freed_with_its_mechanism_and_once(freed: list[int]) -> None:
    mechanism = rg.load("crank_rocker")
    gc.collect()
    freed.clear()
    for _ in range(4):
        abandoned_in_a_cycle(mechanism)
    kept = [rg.Simulation(mechanism, step=1e-3).step() for _ in range(5)]
    del kept, mechanism
    gc.collect()
    assert len(freed) == len(set(freed)) >= 5
