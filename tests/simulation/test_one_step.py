"""`rg.step`, `rg.motion_point` and functions of one state that take many."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.families import four_bars
from robust_gcp.examples.six_bars import CHANGE_POINT

from ..dynamics.test_derivatives import differences, moved, off

Array = NDArray[np.float64]

SCENES: dict[str, Callable[[], tuple[rg.Mechanism, list[float]]]] = {
    "crank-rocker": lambda: (rg.load("crank_rocker"), [2.0]),
    "rhombus": lambda: (rg.load("rhombus"), [-3.0]),
    "five-bar": lambda: (rg.load("five_bar"), [1.0, -0.5]),
    "delta": lambda: (rg.load("delta"), [0.4, -0.5, 0.3]),
    "stewart": lambda: (rg.load("stewart"), [0.1, 0.2, -0.1, 0.3, 0.1, -0.2]),
    "bricard": lambda: (rg.load("bricard"), [1.0]),
    "two on each other": lambda: (four_bars(2 * [CHANGE_POINT], [2.75, 2.8], (-1, 0)), [3.0, 3.0]),
}


def states(name: str, steps: int = 40) -> tuple[rg.Mechanism, rg.Trajectory]:
    """A run, every one of whose states is one to step from; the rhombus passes flat."""
    mech, u = SCENES[name]()
    q = mech.assemble([0.06, -0.06, 0.06]) if name == "rhombus" else mech.home
    return mech, rg.simulate(mech, q, mech.lift(q, u), duration=1e-3 * steps, step=1e-3)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("name", SCENES)
def test_many_steps_are_the_run_s(name: str, threads: int) -> None:
    """From each state of a run to its next one."""
    mech, run = states(name)
    found = rg.step(mech, run.q[:-1], run.v[:-1], h=1e-3, threads=threads)
    assert found.A is None and found.B is None
    np.testing.assert_allclose(found.q, run.q[1:], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.v, run.v[1:], rtol=0, atol=1e-12 * np.abs(run.v).max())


@pytest.mark.parametrize("name", ["crank-rocker", "rhombus", "delta"])
def test_what_acts(name: str) -> None:
    """Tables a row a state, one row for all, names and functions: each as the step of a run."""
    mech, run = states(name, 6)
    q, v, h = run.q[:-1], run.v[:-1], 2e-3
    joint = mech.independent[0]
    table = np.random.default_rng(2).normal(size=v.shape)

    def function(t: float, q: Array, v: Array) -> Array:
        return np.sin(3.0 * t) - 0.2 * v

    for tau in (None, table, table[0], {joint: 0.7}, function):
        found = rg.step(mech, q, v, tau, h, t=0.3)
        for i in range(len(q)):
            own: Any = tau[i] if tau is table else tau
            later: Any = own if not callable(own) else lambda s, q, v: function(0.3 + s, q, v)
            one = rg.simulate(mech, q[i], v[i], duration=h, step=h, torque=later)
            np.testing.assert_allclose(found.q[i], one.q[-1], rtol=0, atol=1e-13)
            # of runs that begin where a bridge is built: its rates hang on rounding by as much
            near = 1.5e-12 if name == "rhombus" else 1e-12
            np.testing.assert_allclose(found.v[i], one.v[-1], rtol=0, atol=near * np.abs(run.v).max())
            alone = rg.step(mech, q[i], v[i], own, h, t=0.3)
            assert alone.q.shape == (mech.nq,)
            np.testing.assert_array_equal(alone.q, found.q[i])


def test_functions_by_name_are_asked_at_the_time_of_the_step() -> None:
    """A force of one's own leaves the step to `simulate`: what acts from t = 2 s on lifts 1 kg."""

    class Nothing(rg.Force):
        def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
            return np.zeros(1)

        def energy(self, mechanism: rg.Mechanism, q: Array) -> float:
            return 0.0

    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, forces=[Nothing()])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rg.PerformanceWarning)
        found = rg.step(mech, [0.0], [0.0], {"z": lambda t, q, v: 9.81 + t}, 0.1, t=2.0)
    assert found.v == pytest.approx([2.0 * 0.1 + 0.1**2 / 2]) and found.q[0] == pytest.approx(0.01 + 1e-3 / 6)


@pytest.mark.parametrize("name", ["crank-rocker", "five-bar", "delta", "rhombus"])
def test_derivatives_of_a_step(name: str) -> None:
    """A and B by differences of order 10 of steps, and the same from one state as from many."""
    mech, run = states(name, 30)
    m, h = mech.m, 1e-3
    tau = np.random.default_rng(3).normal(size=run.v.shape)
    found = rg.step(mech, run.q, run.v, tau, h, jacobians=True)
    assert found.A is not None and found.B is not None
    plain = rg.step(mech, run.q, run.v, tau, h)
    np.testing.assert_allclose(found.q, plain.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.v, plain.v, rtol=0, atol=1e-12 * np.abs(run.v).max())
    for i in (0, 29):  # away from flat, where an independent velocity is a difference's step
        q, u = run.q[i], run.v[i][mech.iv_independent]

        def after(z: Array, by: Array, i: int = i, q: Array = q, u: Array = u) -> Array:
            at = moved(mech, q, z[:m])
            end = rg.step(mech, at, mech.lift(at, u + z[m:]), tau[i] + by, h)
            whole = np.concatenate([mech.tree.difference(found.q[i], end.q), end.v])
            own = mech.iv_independent
            return np.concatenate([whole[own], whole[own + mech.nv]])

        by_state = differences(partial(after, by=np.zeros(mech.nv)), 2 * m, 1e-3)
        assert off(found.A[i], by_state) < 1e-9
        assert off(found.B[i], differences(partial(after, np.zeros(2 * m)), mech.nv, 1.0)) < 1e-9
        alone = rg.step(mech, q, run.v[i], tau[i], h, jacobians=True)
        np.testing.assert_allclose(alone.A, found.A[i], rtol=0, atol=1e-12 * np.abs(found.A[i]).max())
        np.testing.assert_allclose(alone.B, found.B[i], rtol=0, atol=1e-12 * np.abs(found.B[i]).max())
        A, B = rg.step_jacobians(mech, q, run.v[i], tau[i], h)
        np.testing.assert_array_equal(A, alone.A)
        np.testing.assert_array_equal(B, alone.B)


def _mass_and_bias(mech: rg.Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    data = mech.model.createData()
    M = np.triu(pin.crba(mech.model, data, q))
    C = np.array(pin.nonLinearEffects(mech.model, data, q, v))
    own = 0.0 if mech.applied is None else mech.applied.tau(q, v)
    return M + np.triu(M, 1).T, C - own


@pytest.mark.parametrize("name", SCENES)
def test_all_of_the_equations_at_once(name: str) -> None:
    """M_r u̇ + b = Gᵀ τ with M_r and b by Pinocchio's M and C, v = G u and a = G u̇ + g."""
    mech, run = states(name, 12)
    tau = np.random.default_rng(4).normal(size=run.v.shape)
    point = rg.motion_point(mech, run.q, run.v, tau)
    own = mech.iv_independent
    for i in range(0, 13, 4):
        G, g = point.G[i], point.g[i]
        u = run.v[i][own]
        np.testing.assert_allclose(G @ u, run.v[i], rtol=0, atol=1e-9)
        np.testing.assert_allclose(G[own], np.eye(mech.m), rtol=0, atol=1e-12)
        a = G @ point.udot[i] + g
        left = mech.K(run.q[i]) @ a - mech.k(run.q[i], run.v[i])
        assert np.abs(left).max() < 1e-7 * (1.0 + np.abs(a).max())
        M, C = _mass_and_bias(mech, run.q[i], run.v[i])
        M_r, b = G.T @ M @ G, G.T @ (M @ g + C)
        np.testing.assert_allclose(point.M_r[i], M_r, rtol=0, atol=1e-9 * np.abs(M_r).max())
        np.testing.assert_allclose(point.b[i], b, rtol=0, atol=1e-8 * (np.abs(M_r).max() + np.abs(b).max()))
        np.testing.assert_allclose(M_r @ point.by_tau[i], G.T, rtol=0, atol=1e-9 * np.abs(G).max())
        left = M_r @ point.udot[i] + b - G.T @ tau[i]
        assert np.abs(left).max() < 1e-8 * (1.0 + np.abs(G.T @ tau[i]).max() + np.abs(b).max())
        alone = rg.motion_point(mech, run.q[i], run.v[i], tau[i])
        np.testing.assert_allclose(alone.udot, point.udot[i], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", ["crank_rocker", "delta", "stewart"])
def test_of_no_states_and_velocities_by_name(name: str) -> None:
    mech = rg.load(name)
    v = mech.lift(mech.home, np.full(mech.m, 0.3))
    joints = [mech.joint(joint) for joint in mech.joint_names]
    if all(joint.single for joint in joints):
        named = {joint.name: float(v[joint.idx_v]) for joint in joints}
        alike = rg.motion_point(mech, mech.home, named), rg.motion_point(mech, mech.home, v)
        np.testing.assert_array_equal(alike[0].g, alike[1].g)
    none = np.zeros((0, mech.nq)), np.zeros((0, mech.nv))
    assert rg.motion_point(mech, *none).g.shape == (0, mech.nv)
    for h, size in ((None, mech.m), (1e-3, 2 * mech.m)):
        found = rg.by_parameters(mech, *none, parameters=["gravity.z", "gravity.x"], h=h)
        assert found.shape == (0, size, 2)
        second = rg.second_derivatives(mech, *none, dy=np.ones(mech.m), h=h)
        assert second.shape == (0, size, 2 * mech.m + mech.nv)


def test_rows_of_different_lengths_are_refused_by_name() -> None:
    mech, ragged = rg.load("crank_rocker"), [[1.0], [1.0, 2.0]]
    q, v = mech.home, mech.lift(mech.home, [1.0])
    run, cost = rg.simulate(mech, q, v, 2e-3, 1e-3), rg.Cost(terminal=lambda q, v: q[0])
    with pytest.raises(rg.StateError, match="tau"):
        rg.step_jacobians(mech, q, v, ragged, 1e-3)
    with pytest.raises(rg.StateError, match="dy"):
        rg.second_derivatives(mech, q, v, dy=ragged)
    with pytest.raises(rg.StateError, match="torque"):
        rg.gradient(run, cost, torque=ragged)
    with pytest.raises(rg.OptionError, match="one length"):
        rg.Motion(([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0]))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["crank-rocker", "delta", "stewart"])
def test_many_states_are_each_as_one(name: str) -> None:
    mech, run = states(name, 5)
    q, v = run.q, run.v
    tau = np.random.default_rng(5).normal(size=v.shape)
    u = v[:, mech.iv_independent]
    calls: dict[str, tuple[Callable[..., Any], tuple[Array, ...]]] = {
        "phi": (mech.phi, (q,)),
        "K": (mech.K, (q,)),
        "k": (mech.k, (q, v)),
        "K_rate": (mech.K_rate, (q, v)),
        "G": (mech.G, (q,)),
        "g": (mech.g, (q, v)),
        "forward": (lambda *a: rg.forward_dynamics(mech, *a), (q, v, tau)),
        "inverse": (lambda *a: rg.inverse_dynamics(mech, *a), (q, v, u)),
        "regressor": (lambda *a: rg.regressor(mech, *a).matrix, (q, v, u)),
        "slopes": (lambda *a: rg.derivatives(mech, *a).da_dtau, (q, v, tau)),
    }
    for what, (call, rows) in calls.items():
        many = call(*rows)
        for i in range(len(q)):
            one = call(*(part[i] for part in rows))
            np.testing.assert_allclose(many[i], one, rtol=1e-10, atol=1e-10, err_msg=what)
        assert call(*(part[:0] for part in rows)).shape == (0, *many.shape[1:]), what


class TestRefused:
    MECH = rg.load("crank_rocker")
    ROWS = np.tile(MECH.home, (3, 1))

    def test_functions_with_derivatives(self) -> None:
        with pytest.raises(rg.OptionError, match=r"jacobians=True goes with torques that are held"):
            rg.step(self.MECH, self.MECH.home, tau=lambda t, q, v: np.zeros(3), jacobians=True)

    def test_a_row_that_is_open(self) -> None:
        rows = self.ROWS.copy()
        rows[1, 0] += 0.2
        with pytest.raises(rg.StateError, match=r"q\[1\]"):
            rg.step(self.MECH, rows)
        with pytest.raises(rg.StateError, match=r"q\[1\]"):
            rg.forward_dynamics(self.MECH, rows)

    def test_rows_of_other_numbers(self) -> None:
        for call in (
            lambda: rg.step(self.MECH, self.ROWS, np.zeros((2, 3))),
            lambda: rg.step(self.MECH, self.ROWS, tau=np.zeros((4, 3))),
            lambda: self.MECH.k(self.ROWS, np.zeros((2, 3))),
            lambda: self.MECH.k(self.ROWS, v=np.zeros(3)),
        ):
            with pytest.raises(rg.RobustGcpError, match=r"row|shape"):
                call()

    @pytest.mark.parametrize("threads", [0, -1, 1.5, True, "two"])
    def test_numbers_of_threads(self, threads: Any) -> None:
        with pytest.raises(rg.OptionError, match="threads = "):
            rg.step(self.MECH, self.ROWS, threads=threads)

    @pytest.mark.parametrize("h", [0.0, -1e-3, np.nan, "fast"])
    def test_steps(self, h: Any) -> None:
        with pytest.raises(rg.OptionError, match="h"):
            rg.step(self.MECH, self.ROWS, h=h)

    @pytest.mark.parametrize("jacobians", [False, True])
    @pytest.mark.parametrize("h", [1e12, 1e300])
    def test_steps_too_long_for_any_map(self, h: float, jacobians: bool) -> None:
        q, v = [0.4, -0.4, 0.4], [1.0, -1.0, 1.0]
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.StabilityWarning)
            with pytest.raises(rg.SimulationError, match="at once"):
                rg.step(rg.load("rhombus"), [q, q], [v, v], None, h, jacobians)
