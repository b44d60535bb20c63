"""Closed loops as functions of JAX: values, exact cotangents, batches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

jax = pytest.importorskip("jax", exc_type=ImportError)

import jax.numpy as jnp  # noqa: E402 - needs JAX
from jax.test_util import check_grads  # noqa: E402

from robust_gcp.adapters import jax as adapter  # noqa: E402

Array = NDArray[np.float64]
H = 2e-3


@pytest.fixture(autouse=True)
def double() -> Any:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def state(name: str) -> tuple[rg.Mechanism, Array, Array]:
    if name.startswith("rhombus"):
        mech, y = rg.load("rhombus"), 0.02 if name.endswith("zone") else 0.05
        q = np.array([y, -y, y])
        return mech, q, mech.lift(q, [-3.0])
    mech = rg.load("crank_rocker", base="free") if name == "floating" else rg.load(name)
    rng = np.random.default_rng(0)
    q = mech.assemble(mech.tree.integrate(mech.home, 0.05 * rng.normal(size=mech.nv)))
    return mech, q, mech.lift(q, rng.normal(size=mech.m))


SCENES = ("crank_rocker", "five_bar", "stewart", "floating", "rhombus in its zone")


@pytest.mark.parametrize("name", SCENES)
def test_accelerations_and_steps_have_the_slopes_of_differences(name: str) -> None:
    mech, q, v = state(name)
    tau = np.linspace(-1.0, 2.0, mech.nv)
    for function in (adapter.accelerations(mech), adapter.step(mech, H)):
        check_grads(function, (q, v, tau), order=1, modes=["rev"], eps=1e-5, atol=1e-6, rtol=1e-6)
    np.testing.assert_allclose(
        adapter.accelerations(mech)(q, v, tau), rg.forward_dynamics(mech, q, v, tau), rtol=1e-10
    )


@pytest.mark.parametrize("name", ["five_bar", "floating", "rhombus through flat"])
def test_rollouts_have_the_slopes_of_differences(name: str) -> None:
    mech, q, v = state(name)
    tau = np.tile(np.linspace(-1.0, 2.0, mech.nv), (25, 1))
    roll = adapter.rollout(mech, H, 25)
    Q, V = roll(q, v, tau)
    run = rg.simulate(mech, q, v, duration=25 * H, step=H, torque=tau[0])
    np.testing.assert_allclose(Q, run.q, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(V, run.v, rtol=0.0, atol=1e-10)
    assert len(run.crossings) == ("flat" in name)
    check_grads(roll, (q, v, tau), order=1, modes=["rev"], eps=1e-5, atol=1e-6, rtol=1e-6)


def cost(roll: Any, q: Any, v: Any, tau: Any) -> Any:
    Q, V = roll(q, v, tau)
    return jnp.sum(Q[-1] ** 2) + jnp.sum(V[-1]) + 1e-2 * jnp.sum(tau**2)


def test_a_batch_is_one_call_and_row_by_row_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    mech, q, _ = state("five_bar")
    rng = np.random.default_rng(3)
    Q = mech.assemble(q + 0.05 * rng.normal(size=(6, mech.nq)))
    V = mech.lift(Q, rng.normal(size=(6, mech.m)))
    tau = rng.normal(size=(6, 10, mech.nv))
    gradient = jax.grad(lambda *x: cost(adapter.rollout(mech, H, 10), *x), argnums=(0, 1, 2))
    rows = [gradient(*each) for each in zip(Q, V, tau, strict=True)]
    asked: list[int] = []
    from robust_gcp.adapters import batched

    def counted(mechanism: Any, q: Any, *more: Any, **named: Any) -> Any:
        asked.append(len(q))
        return rg.step(mechanism, q, *more, **named)

    monkeypatch.setattr(batched, "step", counted)
    together = jax.jit(jax.vmap(gradient))(Q, V, tau)
    assert asked == [6] * 10
    for k, part in enumerate(together):
        np.testing.assert_allclose(part, [row[k] for row in rows], rtol=1e-12, atol=1e-14)
    nested = jax.vmap(jax.vmap(gradient, in_axes=(None, None, 0)), in_axes=(0, 0, None))(Q[:2], V[:2], tau)
    np.testing.assert_allclose(nested[0][1, 1], rows[1][0], rtol=1e-12)
    shared = jax.vmap(gradient, in_axes=(0, 0, None))(Q, V, tau[0])
    np.testing.assert_allclose(shared[2][0], rows[0][2], rtol=1e-12)


def test_steps_in_a_scan_are_a_rollout() -> None:
    mech, q, v = state("rhombus through flat")
    tau = np.full((25, mech.nv), 0.3)
    one = adapter.step(mech, H)

    def scanned(q: Any, v: Any, tau: Any) -> Any:
        def next_state(x: Any, c: Any) -> Any:
            after = one(*x, c)
            return after, after

        _, (Q, V) = jax.lax.scan(next_state, (q, v), tau)
        return jnp.concatenate([q[None], Q]), jnp.concatenate([v[None], V])

    def gradient(roll: Any) -> Any:
        return jax.jit(jax.grad(lambda *x: cost(roll, *x), argnums=(0, 1, 2)))(q, v, tau)

    for one_by_one, whole in zip(gradient(scanned), gradient(adapter.rollout(mech, H, 25)), strict=True):
        np.testing.assert_allclose(one_by_one, whole, rtol=1e-8, atol=1e-11)


def test_single_precision_and_other_shapes_are_refused() -> None:
    mech, q, v = state("five_bar")
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(rg.OptionError, match="jax_enable_x64"):
        adapter.step(mech, H)(q, v, np.zeros(mech.nv))
    jax.config.update("jax_enable_x64", True)
    with pytest.raises(rg.StateError, match="step: v is"):
        adapter.step(mech, H)(q, v[:2], np.zeros(mech.nv))
    with pytest.raises(rg.StateError, match=rf"step: tau is .*, and must be \('...', {mech.nv}\)"):
        adapter.step(mech, H)(q, v, 1.0)
    with pytest.raises(rg.StateError, match="rollout: tau is"):
        adapter.rollout(mech, H, 5)(q, v, np.zeros((4, mech.nv)))


def test_where_there_is_no_motion_jax_tells_the_reason() -> None:
    mech = rg.load("crank_rocker").with_independent(["q3"])  # a rocker that does not turn through
    far = mech.home + np.array([0.0, 0.0, 3.0])
    for function in (adapter.step(mech, H), jax.jit(adapter.step(mech, H))):
        with pytest.raises(Exception, match=r"ClosureError.*open by"):  # of a kind of JAX's own
            jax.block_until_ready(function(far, np.zeros(mech.nv), np.zeros(mech.nv)))
