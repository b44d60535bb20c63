"""Closed loops as functions of PyTorch: values, exact gradients, batches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

torch = pytest.importorskip("torch", exc_type=ImportError)

from torch.autograd import gradcheck  # noqa: E402 - needs PyTorch

from robust_gcp.adapters import torch as adapter  # noqa: E402

Array = NDArray[np.float64]
H = 2e-3


def states(name: str, count: int = 2) -> tuple[rg.Mechanism, Any, Any]:
    """Some states, as leaves."""
    rng = np.random.default_rng(0)
    if name.startswith("rhombus"):
        mech, y = rg.load("rhombus"), np.linspace(1.0, 0.8, count) * (0.02 if name.endswith("zone") else 0.05)
        q, u = np.stack([y, -y, y], axis=1), np.full((count, 1), -3.0)
    else:
        mech = rg.load("crank_rocker", base="free") if name == "floating" else rg.load(name)
        moved = 0.05 * rng.normal(size=(count, mech.nv))
        q = mech.assemble(np.array([mech.tree.integrate(mech.home, row) for row in moved]))
        u = rng.normal(size=(count, mech.m))
    return mech, leaf(q), leaf(mech.lift(q, u))


def leaf(x: Array) -> Any:
    return torch.tensor(x, dtype=torch.float64, requires_grad=True)


SCENES = ("crank_rocker", "five_bar", "stewart", "floating", "rhombus in its zone")


@pytest.mark.parametrize("name", SCENES)
def test_accelerations_and_steps_have_the_slopes_of_differences(name: str) -> None:
    mech, q, v = states(name)
    tau = leaf(np.linspace(-1.0, 2.0, mech.nv))  # of both states
    for function in (adapter.accelerations(mech), adapter.step(mech, H)):
        assert gradcheck(function, (q, v, tau), eps=1e-5, atol=1e-6, rtol=1e-6)
    np.testing.assert_allclose(
        adapter.accelerations(mech)(q, v, tau).detach(),
        rg.forward_dynamics(mech, q.detach().numpy(), v.detach().numpy(), np.tile(tau.detach(), (2, 1))),
        rtol=1e-10,
    )


@pytest.mark.parametrize("name", ["five_bar", "floating", "rhombus through flat"])
def test_rollouts_have_the_slopes_of_differences(name: str) -> None:
    mech, q, v = states(name)
    tau = leaf(np.tile(np.linspace(-1.0, 2.0, mech.nv), (12, 1)))
    roll = adapter.rollout(mech, 2.0 * H, 12)
    Q, V = roll(q, v, tau)
    at = q[0].detach().numpy(), v[0].detach().numpy()
    run = rg.simulate(mech, *at, duration=24 * H, step=2.0 * H, torque=tau[0].detach().numpy())
    np.testing.assert_allclose(Q[0].detach(), run.q, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(V[0].detach(), run.v, rtol=0.0, atol=1e-10)
    assert len(run.crossings) == ("flat" in name)
    assert gradcheck(roll, (q, v, tau), eps=1e-5, atol=1e-6, rtol=1e-6)


def test_an_optimiser_brings_a_batch_where_it_should_be() -> None:
    mech, q, v = states("five_bar", 3)
    own = [int(i) for i in mech.iq_independent]
    roll, goal = adapter.rollout(mech, 5e-3, 20), q.detach()[:, own] + 0.05
    tau = leaf(np.zeros((3, 20, mech.nv)))
    search = torch.optim.LBFGS([tau], max_iter=60, line_search_fn="strong_wolfe")

    def cost() -> Any:
        search.zero_grad()
        Q, _ = roll(q.detach(), v.detach(), tau)
        J = ((Q[:, -1, own] - goal) ** 2).sum() + 1e-8 * (tau**2).sum()
        J.backward()
        return J

    search.step(cost)
    assert float(cost().detach()) < 1e-3


def test_what_is_written_into_a_result_does_not_change_slopes() -> None:
    mech, q, v = states("five_bar")
    roll, slopes = adapter.rollout(mech, H, 5), []
    for written in (False, True):
        tau = leaf(np.ones((5, mech.nv)))
        Q, V = roll(q.detach(), v.detach(), tau)
        J = Q.sum() + V.sum()
        if written:
            with torch.no_grad():
                Q.mul_(2.0)
        J.backward()
        slopes.append(tau.grad.numpy())
    np.testing.assert_array_equal(*slopes)


def test_other_precisions_and_shapes_are_refused() -> None:
    mech, q, v = states("five_bar")
    tau = torch.zeros(mech.nv, dtype=torch.float64)
    with pytest.raises(rg.OptionError, match=r"step: q is torch.float32.*float64"):
        adapter.step(mech, H)(q.float(), v, tau)
    with pytest.raises(rg.StateError, match="step: v is"):
        adapter.step(mech, H)(q, v[:, :2], tau)
    with pytest.raises(rg.OptionError, match="step: tau is ndarray, and must be a tensor"):
        adapter.step(mech, H)(q, v, tau.numpy())
    for short in (tau[:2], torch.tensor(1.0, dtype=torch.float64)):
        with pytest.raises(rg.StateError, match=rf"step: tau is .*, and must be \('...', {mech.nv}\)"):
            adapter.step(mech, H)(q, v, short)
    with pytest.raises(rg.ClosureError, match="open by"):
        rocker = rg.load("crank_rocker").with_independent(["q3"])
        none = torch.zeros(3, dtype=torch.float64)
        adapter.step(rocker, H)(torch.tensor(rocker.home + [0.0, 0.0, 3.0]), none, none)
