"""What is watched in the kernel's batch: nothing is missed, and nothing is taken for nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import families
from robust_gcp.kernel.simulation.guard import Bounds, Guard

from .machines import BACKENDS, require_backend, sliders, times_of


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def test_limits_that_are_not_met_cost_no_step(backend: Any) -> None:
    """24 limits on four loops: the digits of the run without them, and as many right-hand sides."""
    mech = families.four_bars([(4.0, 1.0, 3.5, 3.0)] * 4, (1.0, 1.1, 1.2, 1.3))
    limits = [rg.Stop(name, lower=-100.0, upper=100.0) for name in mech.joint_names]
    assert len(limits) == 12
    ask: dict[str, Any] = dict(duration=0.4, step=0.005, backend=backend)
    run, plain = rg.simulate(mech, joints=limits, **ask), rg.simulate(mech, **ask)
    assert np.abs(run.q - plain.q).max() < 1e-13 and np.array_equal(run.t, plain.t)
    assert run.stats.rhs == plain.stats.rhs and run.stats.native_steps == plain.stats.native_steps


def test_an_event_takes_one_step_for_nothing() -> None:
    """A long run after an impact: the batch ends where it is, however far the next is."""
    stop, ask = [rg.Stop("q1", lower=0.0, restitution=0.5)], dict(duration=5.0, step=1e-3)
    require_backend("native")
    run = rg.simulate(sliders(1.0), [1.0], [0.0], joints=stop, **ask)  # type: ignore[arg-type]
    impacts = len(times_of(run, "impact"))
    before_rest = int(np.sum(np.diff(run.t[run.t < times_of(run, "hold")[0]]) > 1e-12))
    assert run.stats.native_steps <= before_rest + impacts + 1


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, -1e-9, -1e-3])
def test_a_limit_that_is_passed_between_two_ends(backend: Any, depth: float) -> None:
    """The top of a throw lies within a step; a limit below it by `depth` is met, one above is not."""
    top, v0 = 0.05, np.sqrt(2.0 * 9.81 * 0.05)
    stop = rg.Stop("q1", upper=top - depth, restitution=0.3)
    run = rg.simulate(sliders(1.0), [0.0], [v0], 0.2, 0.04, joints=[stop], backend=backend)
    assert (len(times_of(run, "impact")) > 0) is (depth > 0.0)
    assert run.q.max() <= top - depth + 1e-12 or depth < 0.0


def test_what_the_guard_says() -> None:
    """Out of bounds; turned inside near one; on rates; sums; both limits of a sum are one row."""
    rows = [
        Bounds((0,), (0,), (1.0,), False, -1.0, np.inf),
        Bounds((0,), (0,), (1.0,), False, -np.inf, 2.0),
        Bounds((0, 1), (0, 1), (1.0, -2.0), False, -5.0, 5.0),
        Bounds((1,), (1,), (1.0,), True, 0.0, np.inf),
    ]
    guard, h = Guard(rows), 0.1
    assert guard.structure.structure.values == 2 and guard.structure.structure.rates == 1

    def met(q: Any, v: Any, v0: Any = (1.0, 1.0), a0: Any = (0.0, 0.0), a: Any = (0.0, 0.0)) -> bool:
        return guard.met(h, *map(np.array, (v0, a0, q, v, a)))

    assert not met([0.0, 0.0], [1.0, 1.0])
    assert met([-1.0, 0.0], [1.0, 1.0]) and met([2.1, 0.0], [1.0, 1.0])  # a limit
    assert met([0.0, 2.6], [1.0, 1.0]) and not met([1.9, 3.4], [1.0, 1.0])  # the sum
    assert met([0.0, 0.0], [1.0, 0.0]) and met([0.0, 0.0], [1.0, -0.1])  # the rate
    assert met([-0.9, 0.0], [1.0, 1.0], v0=[-1.0, 1.0]) and not met([0.5, 0.0], [0.1, 1.0], v0=[-0.1, 1.0])
    assert met([0.0, 0.0], [1.0, 0.5], a0=[0.0, -1.0], a=[0.0, 1.0])
    assert not met([0.0, 0.0], [1.0, 5.0], a0=[0.0, -1.0], a=[0.0, 1.0])
    assert met([np.nan, 0.0], [1.0, 1.0])


def test_forces_of_what_is_held_are_the_same_all_at_once() -> None:
    """λ of the phase's mechanism, and what admissible motions need, row by row, on a five-bar."""
    require_backend("native")
    bar = rg.load("five_bar")
    for part, name in ((rg.Lock("q1"), "lock.q1"), (rg.JointFriction("q1", 1e3), "friction.q1")):
        one, two = (
            rg.simulate(bar, bar.home, [0.0] * 4, 0.3, 0.01, joints=[part], backend=b)  # type: ignore[arg-type]
            for b in BACKENDS
        )
        assert np.abs(one[name] - two[name]).max() < 1e-9 * np.abs(one[name]).max()
    stop = [rg.Stop("q1", lower=float(bar.home[0]))]
    pull = {"q1": lambda t, q, v: 60.0 * t}
    ask: dict[str, Any] = dict(q0=bar.home, v0=[0.0] * 4, duration=0.5, step=0.01, torque=pull, joints=stop)
    one, two = (rg.simulate(bar, backend=b, **ask) for b in BACKENDS)
    assert [x.kind for x in one.happenings] == [x.kind for x in two.happenings]
    assert np.abs(one["stop.q1"] - two["stop.q1"]).max() < 1e-8
    assert np.abs(times_of(one, "release") - times_of(two, "release")).max(initial=0.0) < 1e-11
