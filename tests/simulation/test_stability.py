"""The check of RK4's step at the start: it spares the run, and never asks a torque function itself."""

import contextlib
import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.maps.closed_form import parallelogram_pendulum

A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)


def warned(run: Callable[[], object]) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run()
    return [str(w.message) for w in caught if issubclass(w.category, rg.StabilityWarning)]


class Controller:
    """Notes each call; a PD law about the start."""

    def __init__(self, k: float, c: float) -> None:
        self.k, self.c = k, c
        self.calls: list[tuple[float, float]] = []

    def __call__(self, t: float, q: Any, v: Any) -> Any:
        self.calls.append((t, float(q[0])))
        return np.array([-self.k * (q[0] - 0.2) - self.c * v[0], 0.0, 0.0])


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_a_controller_sees_the_stages_of_the_run_and_nothing_else(backend: str) -> None:
    mech, law = rg.load("rhombus"), Controller(5.0, 1.0)
    run = rg.simulate(mech, duration=0.1, step=0.01, torque=law, backend=backend)
    h = 0.01
    stages = [0.0] + [h * i + part for i in range(10) for part in (0.5 * h, 0.5 * h, h, h)]
    assert [t for t, _ in law.calls] == pytest.approx(stages, abs=1e-12)
    assert run.stats.force_evaluations == len(law.calls) == run.stats.rhs


@pytest.mark.parametrize("k, c", ((1e6, 0.0), (0.0, 1e4), (1e5, 3e3), (1e6, 2e2)))
def test_a_stiff_drive_is_found_out_from_the_calls_of_the_run(k: float, c: float) -> None:
    """A ÿ = −k (y − 0.2) − c ẏ − B cos y: λ² + (c/A) λ + k/A ≈ 0."""
    mech, eigenvalues = rg.load("rhombus"), np.roots([1.0, c / A, k / A])
    bound = rg.linearise(mech, mech.home, torque=Controller(k, c)).largest_stable_step
    fastest = eigenvalues[np.argmax(np.abs(eigenvalues))]

    def run(step: float) -> Callable[[], object]:
        def runs() -> None:
            with contextlib.suppress(rg.SimulationError):  # it blew up, which the warning explains
                rg.simulate(mech, duration=8.0 * step, step=step, torque=Controller(k, c))

        return runs

    (message,) = warned(run(1.05 * bound))
    told = re.search(r"eigenvalue (-?[\d.]+).* steps up to ([\d.]+) s", message)
    assert told is not None
    assert float(told[2]) == pytest.approx(bound, rel=2e-3)
    assert float(told[1]) == pytest.approx(fastest.real, rel=2e-2, abs=1e-2 * abs(fastest))
    assert not warned(run(0.95 * bound))


def test_a_torque_of_time_alone_says_nothing_of_stability() -> None:
    mech = rg.load("rhombus")
    assert not warned(
        lambda: rg.simulate(
            mech, duration=0.5, step=0.01, torque=lambda t, q, v: [50.0 * np.sin(300.0 * t), 0.0, 0.0]
        )
    )


def test_the_check_counts_nothing_as_the_runs() -> None:
    """K is evaluated once a right-hand side and Newton step; the check's evaluations are not among them."""
    mech = rg.load("crank_rocker")
    springs = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home, forces=[rg.JointSpring("q1", 1.0)]
    )
    stats = rg.simulate(springs, duration=0.01, backend="python").stats
    assert stats.force_evaluations == stats.rhs == 41
