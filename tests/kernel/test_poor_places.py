"""Where K_d is poor and no series of the mode serves: q closed to its own rounding, by the kernel too."""

from __future__ import annotations

import warnings
from decimal import Decimal

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.modes.mode_rates import UNSTEADY
from robust_gcp.kernel.derivatives.derivations import derivation
from robust_gcp.reports.derivative_paths import five_bar_in_line
from tests.compiled import needs_kernel
from tests.dynamics.gradient_problems import differentiated
from tests.exact import Exact

Array = NDArray[np.float64]
pytestmark = needs_kernel


def beside_the_apex(apart: float, seed: int) -> tuple[rg.Mechanism, Array, Array]:
    """A five-bar about so far, rad, from where two surfaces end in a point, and independent velocities."""
    mech, rng = five_bar_in_line()[0], np.random.default_rng(seed)
    for _ in range(20):
        a, b = apart * rng.normal(size=2)
        try:
            return mech, mech.assemble([a, -2.0 * a, b, b], hold=["q1", "q3"]), rng.normal(size=2)
        except rg.RobustGcpError:  # the loop does not reach so far
            continue
    raise AssertionError("none found")


@pytest.mark.parametrize("apart", [1e-2, 1e-3, 4e-4])
def test_derivatives_beside_an_apex_are_those_of_seventy_digits(apart: float) -> None:
    served = 0
    for seed in range(4):
        mech, q, u = beside_the_apex(apart, seed)
        exact, tau = Exact(mech), np.random.default_rng(seed).normal(size=mech.nv)
        given = [Decimal(float(x)) for x in q]
        closed = exact.closed(given, [given[k] for k in exact.i])
        digits = differentiated(exact, closed, *([Decimal(float(x)) for x in part] for part in (u, tau)))
        q = np.array([float(x) for x in closed])
        kernel = derivation(mech, q)
        assert kernel is not None
        found = kernel.slopes(q[None], mech.lift(q, u)[None], tau[None])
        if not found.good[0]:
            continue
        served += kernel.G_where_poor(q, mech.lift(q, u)) is not None
        told, accelerations = (
            found.of_state(0),
            kernel.forward_dynamics(q[None], mech.lift(q, u)[None], tau[None]),
        )
        parts = [np.array([[float(x) for x in row] for row in part]) for part in digits]
        pairs = zip((told.udot[None], told.da_dy, told.da_dv, told.da_dtau), parts, strict=True)
        for ours, theirs in [*pairs, (accelerations[1], parts[0])]:
            np.testing.assert_allclose(ours, theirs, atol=UNSTEADY * np.abs(theirs).max())
    assert served > 0


def test_what_hangs_on_rounding_is_left_to_the_reference() -> None:
    mech, q, v = five_bar_in_line()
    kernel = derivation(mech, q)
    assert kernel is not None
    near = mech.assemble(0.01 * q, hold=["q1", "q3"])
    assert not kernel.slopes(near[None], mech.lift(near, [1.0, -0.5])[None], None).good[0]
    off = q + 1e-5 * np.eye(len(q))[mech.iv_dependent[0]]
    assert not kernel.slopes(off[None], v[None], None).good[0]  # it is not closed


def test_steps_beside_an_apex_are_followed_by_parts_as_runs_are() -> None:
    """The end of simulate's step, and A by differences of runs with error control, to the fourth order."""
    mech, q, v = five_bar_in_line()
    own, h, d = mech.iv_independent, 1e-3, 4e-6
    options = {"stepper": "DOP853", "rtol": 1e-13, "atol": 1e-14}

    def end(x: Array) -> Array:
        at = q.copy()
        at[own] = x[:2]
        at = mech.assemble(at, hold=list(mech.independent))
        run = rg.simulate(mech, at, mech.lift(at, x[2:]), h, h, **options)
        return np.concatenate([run.q[-1][own], run.v[-1][own]])

    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.PerformanceWarning)
        found = rg.step(mech, q, v, h=h, jacobians=True)
        alone = rg.step(mech, q, v, h=h)
    run = rg.simulate(mech, q, v, h, h)
    for one in (found, alone):
        np.testing.assert_allclose(one.q, run.q[-1], atol=1e-12)
        np.testing.assert_allclose(one.v, run.v[-1], atol=1e-10)
    x, A = np.concatenate([q[own], v[own]]), np.empty((4, 4))
    for k, way in enumerate(d * np.eye(4)):
        near, far = ((end(x + s * way) - end(x - s * way)) / (2.0 * s * d) for s in (1.0, 2.0))
        A[:, k] = (4.0 * near - far) / 3.0
    assert found.A is not None
    np.testing.assert_allclose(found.A, A, atol=1e-7 * np.abs(A).max())


def test_gradients_of_runs_that_begin_beside_an_apex_are_those_of_differences() -> None:
    mech, q, v = five_bar_in_line()
    own, h, d = mech.iv_independent, 5e-3, 2e-6
    cost = rg.Cost(terminal=lambda q, v: q[0] + v[0])

    def value(y: Array) -> float:
        at = q.copy()
        at[own] = y
        at = mech.assemble(at, hold=list(mech.independent))
        run = rg.simulate(mech, at, mech.lift(at, v[own]), h, h, stepper="DOP853", rtol=1e-13, atol=1e-14)
        return float(run.q[-1][0] + run.v[-1][0])

    found, dy = rg.gradient(rg.simulate(mech, q, v, h, 1e-3), cost), np.empty(2)
    for k, way in enumerate(d * np.eye(2)):
        near, far = ((value(q[own] + s * way) - value(q[own] - s * way)) / (2.0 * s * d) for s in (1.0, 2.0))
        dy[k] = (4.0 * near - far) / 3.0
    np.testing.assert_allclose(found.dy, dy, rtol=1e-8)
