"""What frameworks call: functions of many states, and cotangents pulled back through them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.adapters.batched import Accelerations, Rollout
from robust_gcp.adapters.cotangents import Exact
from robust_gcp.adapters.states import normalised, rates

Array = NDArray[np.float64]


def floating() -> rg.Mechanism:
    """A four-bar on a floating base."""
    return rg.load("crank_rocker", base="free")


def states(mech: rg.Mechanism, count: int, seed: int = 0) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    moved = 0.1 * rng.uniform(-1.0, 1.0, (count, mech.nv))
    q = mech.assemble(np.array([mech.tree.integrate(mech.home, row) for row in moved]))
    return q, mech.lift(q, rng.uniform(-1.0, 1.0, (count, mech.m)))


def in_zone() -> tuple[rg.Mechanism, Array, Array]:
    """A rhombus 0.02 rad and nearer beside flat, where two modes meet."""
    mech, y = rg.load("rhombus"), np.array([0.02, -0.015, 0.004])
    q = np.stack([y, -y, y], axis=1)
    return mech, q, mech.lift(q, np.array([[-1.0], [2.0], [0.5]]))


def scene(name: str) -> tuple[rg.Mechanism, Array, Array]:
    if name == "in a zone":
        return in_zone()
    if name == "crossing":
        mech, q = rg.load("rhombus"), np.array([[0.05, -0.05, 0.05], [-0.03, 0.03, -0.03]])
        return mech, q, mech.lift(q, np.array([[-3.0], [2.0]]))
    mech = floating() if name == "floating" else rg.load(name)
    return mech, *states(mech, 3)


def differ(exact: Exact, given: tuple[Array, ...], derivative: Callable[..., Array], h: float) -> None:
    """Pulled cotangents are what differences along random directions of all arguments say."""
    rng = np.random.default_rng(1)
    found = exact.linearised(*given)
    count = len(exact.results)
    for one, other in zip(found[:count], exact.evaluated(*given), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)
    weights = [rng.normal(size=part.shape) for part in found[:count]]
    pulled = exact.pulled(*found[count:], *weights)
    for number, part in enumerate(given):
        direction = rng.normal(size=part.shape)

        def along(s: float, number: int = number, direction: Array = direction) -> Array:
            moved = [x + s * direction if i == number else x for i, x in enumerate(given)]
            return np.array(sum(np.sum(w * x) for w, x in zip(weights, exact.evaluated(*moved), strict=True)))

        size = 1.0 + float(np.abs(pulled[number]).max())
        expected = float(derivative(along, h))
        assert float(np.sum(pulled[number] * direction)) == pytest.approx(expected, abs=1e-8 * size)


@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "stewart", "floating", "in a zone"])
def test_accelerations_are_pulled_back_as_differences_say(
    name: str, derivative: Callable[..., Array]
) -> None:
    mech, q, v = scene(name)
    tau = np.random.default_rng(2).normal(size=v.shape)
    differ(Accelerations(mech), (q, v, tau), derivative, 1e-3)


@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "stewart", "floating", "crossing"])
def test_rollouts_are_pulled_back_as_differences_say(name: str, derivative: Callable[..., Array]) -> None:
    mech, q, v = scene(name)
    tau = np.random.default_rng(2).normal(size=(len(q), 20, mech.nv))
    run = Rollout(mech, 2e-3, 20)
    if name == "crossing":
        Q, _ = run.evaluated(q, v, tau)
        assert np.all(Q[:, -1, 0] * Q[:, 0, 0] < 0.0)
    differ(run, (q, v, tau), derivative, 1e-3)


def test_a_rollout_is_the_run_of_simulate_and_takes_any_leading_axes() -> None:
    mech, q, v = scene("five_bar")
    tau = np.ones((2, 3, 50, mech.nv))
    Q, V = Rollout(mech, 1e-3, 50).evaluated(*(np.tile(x, (2, 1, 1)) for x in (q, v)), tau)
    assert Q.shape == (2, 3, 51, mech.nq)
    run = rg.simulate(mech, q[1], v[1], duration=0.05, step=1e-3, torque=tau[0, 0, 0])
    np.testing.assert_allclose(Q[1, 1], run.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(V[0, 1], run.v, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("name", ["crank_rocker", "rhombus"])
def test_many_long_rollouts_are_those_of_single_steps(name: str) -> None:
    """As motions of a batch, through singular places too, and as steps that know their state alone."""
    mech, count, steps = rg.load(name), 520, 200
    rng = np.random.default_rng(4)
    tau = np.zeros((count, steps, mech.nv))
    tau[:, :, mech.iv_independent] = 0.02 * rng.normal(size=(count, steps, mech.m))
    q = np.tile(mech.home, (count, 1))
    v = np.array([mech.lift(mech.home, 0.8 * rng.normal(size=mech.m)) for _ in range(count)])
    Q, V = Rollout(mech, 1e-3, steps).evaluated(q, v, tau)
    for i in (0, 7, 519):
        alone, fast = Rollout(mech, 1e-3, steps).evaluated(q[i : i + 1], v[i : i + 1], tau[i : i + 1])
        np.testing.assert_allclose(Q[i], alone[0], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(V[i], fast[0], rtol=0.0, atol=1e-11)
    lost = np.array(tau)
    lost[3, 150] = np.nan
    with pytest.raises(rg.RobustGcpError):
        Rollout(mech, 1e-3, steps).evaluated(q, v, lost)


def test_the_gradient_of_a_rollout_is_that_of_a_run() -> None:
    mech, q, v = scene("crossing")
    exact = Rollout(mech, 2e-3, 40)
    found = exact.linearised(q[0], v[0], np.zeros((40, mech.nv)))
    weights = np.zeros((41, mech.nq)), np.zeros((41, mech.nv))
    weights[0][-1] = (0.0, 1.0, 0.5)
    on_q, on_v, on_tau = exact.pulled(*found[2:], *weights)
    run = rg.simulate(mech, q[0], v[0], duration=0.08, step=2e-3)
    assert len(run.crossings) == 1
    known = rg.gradient(run, rg.Cost(terminal=lambda q, v: q[1] + 0.5 * q[2]))
    own = mech.iv_independent
    np.testing.assert_allclose(on_q[own], known.dy, rtol=1e-9)
    np.testing.assert_allclose(on_v[own], known.dv, rtol=1e-9)
    np.testing.assert_allclose(on_tau, known.dtau, rtol=1e-8, atol=1e-12)


def test_numbers_that_are_no_rates_change_as_pinocchio_has_them(derivative: Callable[..., Array]) -> None:
    model = pin.Model()
    kinds = ("FreeFlyer", "RUBX", "PY", "Planar", "Spherical", "RZ", "Translation")
    for kind in kinds:
        index = model.addJoint(0, getattr(pin, f"JointModel{kind}")(), pin.SE3.Identity(), kind)
        inertia = pin.Inertia(1.0, np.zeros(3), np.eye(3))
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, [], list(kinds))
    rng = np.random.default_rng(0)
    q = np.array([mech.tree.integrate(mech.home, rng.normal(size=mech.nv)) for _ in range(3)])
    found = rates(mech, q)
    for n, row in enumerate(q):
        for j, e in enumerate(np.eye(mech.nv)):
            expected = derivative(lambda s, row=row, e=e: mech.tree.integrate(row, s * e))
            np.testing.assert_allclose(found[n, :, j], expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(normalised(mech, q), q, rtol=0.0, atol=1e-14)
    across = found.transpose(0, 2, 1) @ found
    assert np.abs(across - across * np.eye(mech.nv)).max() < 1e-14


def test_what_does_not_fit_is_told() -> None:
    mech = rg.load("rhombus")
    with pytest.raises(rg.OptionError, match="steps"):
        Rollout(mech, 1e-3, 0)
    with pytest.raises(rg.OptionError, match="h "):
        Rollout(mech, -1e-3, 2)
    with pytest.raises(rg.StateError, match=r"rollout: tau is \(4, 3\)"):
        Rollout(mech, 1e-3, 5).lead(((3,), (3,), (4, 3)))
    with pytest.raises(rg.StateError, match="do not go together"):
        Accelerations(mech).lead(((2, 3), (4, 3), (3,)))
    with pytest.raises(rg.OptionError, match="threads"):
        Accelerations(mech, threads=0)


def test_threads_and_the_order_of_memory_change_nothing() -> None:
    mech, q, v = scene("five_bar")
    given = (*(np.repeat(x, 3, axis=0) for x in (q, v)), np.zeros((9, 10, mech.nv)))
    for found in zip(
        Rollout(mech, 1e-3, 10).linearised(*given),
        Rollout(mech, 1e-3, 10, 3).linearised(*given),
        Rollout(mech, 1e-3, 10).linearised(*map(np.asfortranarray, given)),
        strict=True,
    ):
        np.testing.assert_array_equal(found[0], found[1])
        np.testing.assert_array_equal(found[0], found[2])
