"""Derivatives through singular configurations: the kernel, told of modes, against the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.dynamics import discrete
from robust_gcp.dynamics.modes.taylor_series import circles_of
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.six_bars import CHANGE_POINT, lamp, parallel_legs
from robust_gcp.kernel.derivatives.derivations import derivation, own_derivation
from robust_gcp.reports.stability.truth import with_forces
from robust_gcp.reports.work_precision.scenes import floating
from robust_gcp.simulation.derivatives import reverse_sweep

from ..compiled import needs_kernel, stepped

pytestmark = needs_kernel

SAME = 1e-9
"""Relative: the reference is differentiated where it is as long as that is right to 2e-11."""


def _sprung() -> rg.Mechanism:
    """Springs and dampers across its hinges, rotors in its motors."""
    mech = rg.load("rhombus")
    model = pin.Model(mech.model)
    model.armature = np.array([0.1, 0.2, 0.05])
    made = rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, home=mech.home)
    return with_forces(made, [rg.JointSpring("q1", 2.0), rg.JointDamper("q3", 0.3)])


def _thrown(mech: rg.Mechanism, ydot: list[float], duration: float) -> rg.Trajectory:
    return rg.simulate(mech, v0=mech.lift(mech.home, ydot), duration=duration, step=1e-3)


def _floating() -> rg.Trajectory:
    scene = floating().scene
    return rg.simulate(scene.mechanism, scene.q0, scene.v0, duration=0.6, step=1e-3)


MOTIONS: dict[str, Callable[[], rg.Trajectory]] = {
    "rhombus": lambda: rg.simulate(rg.load("rhombus"), [0.2, -0.2, 0.2], duration=1.0, step=1e-3),
    "sprung": lambda: rg.simulate(_sprung(), [0.2, -0.2, 0.2], duration=0.4, step=1e-3),
    "four-bar": lambda: _thrown(four_bars([CHANGE_POINT], [2.6]), [3.0], 0.4),
    "on a floating base": lambda: _floating(),
    "two on each other": lambda: _thrown(
        four_bars(2 * [CHANGE_POINT], [2.75, 2.8], (-1, 0)), [3.0, 3.0], 0.3
    ),
    "lamp": lambda: _thrown(lamp(), [-2.0, -2.2], 0.2),
    "redundant legs": lambda: _thrown(parallel_legs(3, 0.4), [-3.0], 0.3),
    "scissor lift": lambda: _thrown(scissor_lift(3), [-2.0], 0.6),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_along_motions_through_singular_places(name: str) -> None:
    """All of a run's states are the kernel's once it was told of its modes, and are the reference's."""
    run = MOTIONS[name]()
    assert run.crossings
    mech, tau = run.mechanism, np.linspace(-1.0, 1.0, run.mechanism.nv)
    found = rg.derivatives(mech, run.q, run.v, tau)
    kernel = derivation(mech, run.q[0])
    assert kernel is not None
    again = kernel.slopes(run.q, run.v, np.tile(tau, (len(run.t), 1)))
    assert again.good.all()
    near = [int(np.argmin(np.abs(run.t - c.time))) for c in run.crossings]
    for i in [0, len(run.t) - 1, *(i + k for i in near for k in (-30, -1, 0, 1, 20))]:
        if not 0 <= i < len(run.t):
            continue
        exact = reference.derivatives(mech, run.q[i], run.v[i], tau)
        for each in (found, again.of_state(slice(None))):
            for field in fields(exact):
                one, other = getattr(each, field.name)[i], getattr(exact, field.name)
                np.testing.assert_allclose(one, other, rtol=0.0, atol=SAME * max(1.0, np.abs(other).max()))


@pytest.mark.parametrize("name", ("rhombus", "on a floating base", "two on each other"))
def test_gradients_over_crossings(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No step of a run through singular places is left to the reference, and the gradient is its."""
    run = MOTIONS[name]()
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, run.mechanism.nv))
    cost = rg.Cost(
        terminal=lambda q, v: a @ v,
        running=lambda t, q, v, tau: a @ v**2,
        terminal_slopes=lambda q, v: (b, a),
        running_slopes=lambda t, q, v, tau: (b, 2.0 * a * v, 0.0 * a),
    )
    with monkeypatch.context() as alone:
        alone.setattr(
            reverse_sweep.ReverseSweep, "_by_reference", lambda *_: pytest.fail("left to the reference")
        )
        found = rg.gradient(run, cost)
    monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
    exact = rg.gradient(run, cost)
    for part in ("dy", "dv", "dtau"):
        one, other = getattr(found, part), getattr(exact, part)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=SAME * np.abs(other).max())


class TestModesThatMeet:
    """The rhombus lies flat, where two modes meet; the kernel is told of the parallelogram's alone."""

    @pytest.fixture()
    def told(self) -> tuple[rg.Mechanism, Any, list[np.ndarray]]:
        mech = rg.load("rhombus").with_independent(["q1"])
        modes = sorted(rg.analyse(mech, np.zeros(3)).modes, key=lambda mode: -abs(mode[0]))
        kernel = own_derivation(mech, mech.home)
        assert kernel is not None
        begun = initial_value_problem(mech, [0.2, -0.2, 0.2]).start
        assert kernel.learn_beside(begun, [np.zeros(3)])
        assert not kernel.learn_beside(begun, [np.array([0.05, -0.05, 0.05])])  # the circle covers it
        return mech, kernel, list(modes)

    def test_velocity_tells_which(self, told: tuple[rg.Mechanism, Any, list[np.ndarray]]) -> None:
        mech, kernel, (own, other) = told
        flat = np.zeros((1, 3))
        found = kernel.slopes(flat, 2.0 * own[None], None)
        assert found.good[0]
        exact = reference.derivatives(mech, flat[0], 2.0 * own, mode=own)
        np.testing.assert_allclose(
            found.rows[0], np.hstack([exact.da_dy, exact.da_dv, exact.da_dtau]), atol=1e-11
        )
        assert not kernel.slopes(flat, 2.0 * other[None], None).good[0]

    def test_rest_does_not(self, told: tuple[rg.Mechanism, Any, list[np.ndarray]]) -> None:
        """Nor do states that were asked for before change what becomes of one."""
        mech, kernel, _ = told
        assert circles_of(mech)
        for flat in (np.zeros(3), np.array([1e-9, -1e-9, 1e-9])):
            assert not kernel.slopes(flat[None], np.zeros((1, 3)), None).good[0]
            assert not kernel.forward_dynamics(flat[None], np.zeros((1, 3)), None)[0][0]
            with pytest.raises(rg.RobustGcpError):
                rg.derivatives(mech, flat)

    def test_beside_it_the_place_does(self, told: tuple[rg.Mechanism, Any, list[np.ndarray]]) -> None:
        mech, kernel, _ = told
        near = 1e-2 * np.array([[1.0, -1.0, 1.0]])
        found = kernel.slopes(near, np.zeros((1, 3)), None)
        assert found.good[0]
        exact = reference.derivatives(mech, near[0])
        np.testing.assert_allclose(
            found.rows[0], np.hstack([exact.da_dy, exact.da_dv, exact.da_dtau]), atol=SAME
        )
        folded = np.array([[1e-9, 1e-2, 1e-2]])
        assert not kernel.slopes(folded, np.array([[0.0, 1.0, 1.0]]), None).good[0]


@pytest.mark.parametrize("h", [1e-3, 1e-2, 0.05, 0.08])
def test_steps_without_a_known_end_stay_on_their_mode(h: float) -> None:
    """Long ones on the mode that the kernel was not told of are not taken over by the one that it was."""
    mech = rg.load("rhombus").with_independent(["q2"])
    own, other = np.array([[1.0, -1.0, 1.0], [0.0, 1.0, 1.0]])
    kernel = own_derivation(mech, 0.2 * own)
    assert kernel is not None
    assert kernel.learn_beside(initial_value_problem(mech, 0.2 * own).start, [np.zeros(3)])
    for mode in (own, other):
        for place in (0.2, 0.1, 0.02, 1e-3, -1e-3):
            for fast in (-2.0, -0.5, 2.0):
                q, v = place * mode, fast * mode
                taken = stepped(kernel, q[None], v[None], None, h)
                if mode is own and abs(place) < 0.05 and h < 0.05:  # within what the series covers
                    assert taken is not None
                if taken is None:
                    continue
                exact = discrete.step_jacobians(mech, q, v, None, h, mode=mode if abs(place) < 0.01 else None)
                for one, same in zip(taken, exact, strict=True):
                    np.testing.assert_allclose(one, same, rtol=0.0, atol=1e-9 * np.abs(same).max())
