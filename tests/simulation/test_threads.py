"""One mechanism in many threads at once: to the last digit what one thread gives.

`THREAD_RUNS=200 pytest tests/simulation/test_threads.py` makes 200 runs over 8 threads instead of 24.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]

THREADS = 8
RUNS = int(os.environ.get("THREAD_RUNS", "24"))


@pytest.fixture(autouse=True)
def impatient() -> Iterator[None]:
    """Threads change places a thousand times as often as usual."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(usual)


def together(work: Callable[[int], object], count: int) -> list[object]:
    """The work's results from threads that begin at one time."""
    gate = threading.Barrier(THREADS)

    def wait() -> None:
        gate.wait()

    with ThreadPoolExecutor(THREADS, initializer=wait) as pool:
        return list(pool.map(work, range(count)))


@pytest.mark.parametrize("backend", ["python", "native"])
@pytest.mark.parametrize("name", ["bricard", "rhombus", "stewart"])
def test_runs_do_not_depend_on_threads(name: str, backend: str) -> None:
    if backend == "native" and not rg.backends()["native"].available:
        pytest.skip("the compiled kernel is not built")
    mechanism = rg.load(name)
    count = RUNS if name == "bricard" else 16

    def run(i: int) -> Array:
        torque = (1e-3 * i) * np.ones(mechanism.nv)
        return rg.simulate(mechanism, duration=0.05, step=2e-3, torque=torque, backend=backend).v  # type: ignore[arg-type]

    serial = [run(i) for i in range(count)]
    for expected, found in zip(serial, together(run, count), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", ["bricard", "tripod", "seven hinges", "flyball"])
def test_evaluations_do_not_depend_on_threads(mechanisms: dict[str, rg.Mechanism], name: str) -> None:
    """φ, K, k, the energy with springs, the inertia, analyse and linearise of the same mechanism at once."""
    mechanism = mechanisms[name]

    def look(i: int) -> list[Array]:
        rng = np.random.default_rng(i)
        q = mechanism.tree.integrate(mechanism.home, rng.uniform(-0.5, 0.5, mechanism.nv))
        v = rng.uniform(-1.0, 1.0, mechanism.nv)
        found = [mechanism.phi(q), mechanism.K(q), mechanism.k(q, v), np.array(mechanism.energy(q, v))]
        found += [mechanism.tree.crba(q).copy(), mechanism.tree.rnea(q, v, v).copy()]
        found += list(rg.implicit_dynamics(mechanism, q, v))
        if i % 8 == 0:
            found.append(np.array(rg.analyse(mechanism, mechanism.home).singular_values))
        return found

    serial = [look(i) for i in range(64)]
    for expected, found in zip(serial, together(look, 64), strict=True):
        assert isinstance(found, list)
        for one, other in zip(expected, found, strict=True):
            np.testing.assert_array_equal(other, one)


def test_each_thread_has_a_workspace_and_all_share_the_model() -> None:
    mechanism = rg.load("rhombus")
    q = np.array([0.4, -0.4, 0.4])
    mechanism.tree.jacobians(q)
    mine = mechanism.tree.J.copy()
    models: list[object] = []

    def other() -> None:
        mechanism.tree.jacobians(2.0 * q)
        models.append(mechanism.tree.model)

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    np.testing.assert_array_equal(mechanism.tree.J, mine)
    assert models[0] is mechanism.tree.model
