"""Closed loops as functions of PyTorch: accelerations, steps and rollouts with exact gradients, in batches.

Functions of a state (q, v) and torques τ, with any axes before those of one state: a batch is one call to the
compiled kernel. The independent entries of q and v are their arguments; the others tell the assembly: loops
are closed from there with y held and v = G u, and slopes by them are zero. The states that a function gives
are closed and lead on, through singular configurations on their mode.

Derivatives are first ones, in reverse; `torch.func` does not take these functions. Tensors are of double
precision and on the CPU. Needs the extra `torch`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..errors import OptionError, missing_extra
from ..mechanism.mechanism import Mechanism
from .batched import Accelerations, Rollout
from .cotangents import Exact

try:
    import torch
    from torch.autograd.function import once_differentiable
except ImportError as missing:
    raise missing_extra("gradients in PyTorch need torch", "torch", "torch") from missing


def accelerations(mechanism: Mechanism, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """u̇ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3), as a function (q, v, tau) of PyTorch.

    Parameters
    ----------
    mechanism : Mechanism
    threads : int
        On which the states of a batch are shared out.

    Returns
    -------
    callable (q, v, tau) -> udot
        Of tensors (..., nq), (..., nv) and (..., nv), rad or m, per second, N m or N, which are broadcast
        against each other: (..., m), of the independent velocities.

    Raises
    ------
    OptionError
        For tensors that are not of torch.float64 and on the CPU.
    StateError
        For other shapes.
    StateError, SimulationError
        As `forward_dynamics`.
    ModelError
        For independent velocities of a spherical joint in a loop.
    """
    exact = Accelerations(mechanism, threads)
    return lambda q, v, tau: _applied(exact, q, v, tau)[0]


def step(mechanism: Mechanism, h: float, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """One step of RK4, torques held, as a function (q, v, tau) of PyTorch.

    Parameters
    ----------
    mechanism, threads
        As of `accelerations`.
    h : float
        s.

    Returns
    -------
    callable (q, v, tau) -> (q, v)
        Of tensors as `accelerations` takes them: the states after the step.

    Raises
    ------
    OptionError, StateError, SimulationError, ModelError
        As of `accelerations`.
    """
    exact = Rollout(mechanism, h, 1, threads, whole=False)
    return lambda q, v, tau: _applied(exact, q, v, tau)


def rollout(mechanism: Mechanism, h: float, steps: int, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """Steps of RK4, torques held over each, as a function (q, v, tau) of PyTorch.

    Backwards it multiplies the steps' derivatives, which are kept: (2m)² + 2m nv numbers a step.

    Parameters
    ----------
    mechanism, h, threads
        As of `step`.
    steps : int

    Returns
    -------
    callable (q, v, tau) -> (q, v)
        Of tensors (..., nq), (..., nv) and (..., steps, nv): the states at the start and after each step,
        (..., steps + 1, nq) and (..., steps + 1, nv).

    Raises
    ------
    OptionError, StateError, SimulationError, ModelError
        As of `accelerations`.
    """
    exact = Rollout(mechanism, h, steps, threads)
    return lambda q, v, tau: _applied(exact, q, v, tau)


class _Function(torch.autograd.Function):  # type: ignore[misc]
    """A function of PyTorch by what NumPy does to it."""

    @staticmethod
    def forward(ctx: Any, exact: Exact, *given: Any) -> Any:
        arrays = [x.detach().numpy() for x in given]
        if not any(ctx.needs_input_grad):
            return tuple(map(torch.from_numpy, exact.evaluated(*arrays)))
        found = exact.linearised(*arrays)
        ctx.exact, ctx.kept = exact, found[len(exact.results) :]
        return tuple(torch.tensor(x) for x in found[: len(exact.results)])  # its own: it may be written to

    @staticmethod
    @once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, *cotangents: Any) -> Any:
        pulled = ctx.exact.pulled(*ctx.kept, *(x.numpy() for x in cotangents))
        return None, *map(torch.from_numpy, pulled)


def _applied(exact: Exact, *given: Any) -> Any:
    """The function at tensors, checked and broadcast."""
    for name, x in zip(("q", "v", "tau"), given, strict=True):
        if not isinstance(x, torch.Tensor) or x.dtype != torch.float64 or x.device.type != "cpu":
            what = f"{x.dtype} on {x.device}" if isinstance(x, torch.Tensor) else type(x).__name__
            raise OptionError(
                f"{exact.name}: {name} is {what}, and must be a tensor of torch.float64 on the CPU: say "
                f'{name}.to("cpu", torch.float64)'
            )
    lead = exact.lead(tuple(tuple(x.shape) for x in given))
    full = (x.expand(*lead, *s) for x, s in zip(given, exact.arguments, strict=True))
    return _Function.apply(exact, *full)
