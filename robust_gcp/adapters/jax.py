"""Closed loops as functions of JAX: accelerations, steps and rollouts with exact cotangents, also in batches.

Functions of a state (q, v) and torques τ under `jit`, `grad` and `vmap`, where a batch is one call to the
compiled kernel. The independent entries of q and v are their arguments; the others tell the assembly: loops
are closed from there with y held and v = G u, and slopes by them are zero. The states that a function gives
are closed and lead on, through singular configurations on their mode.

What goes wrong within a function is told in an error of JAX's own, with the words of ours in it.
Derivatives are first ones, in reverse: `jax.jvp` and derivatives of derivatives end with JAX's TypeError.
Needs the extra `jax`, and double precision: `jax.config.update("jax_enable_x64", True)`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import OptionError, missing_extra
from ..mechanism.mechanism import Mechanism
from .batched import Accelerations, Rollout
from .cotangents import Exact, Shapes

try:
    import jax
    import jax.numpy as jnp
except ImportError as missing:
    raise missing_extra("gradients in JAX need jax", "jax", "jax") from missing


def accelerations(mechanism: Mechanism, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """u̇ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3), as a function (q, v, tau) of JAX.

    Parameters
    ----------
    mechanism : Mechanism
    threads : int
        On which the states of a batch are shared out.

    Returns
    -------
    callable (q, v, tau) -> udot
        Of arrays (..., nq), (..., nv) and (..., nv), rad or m, per second, N m or N, which are broadcast
        against each other: (..., m), of the independent velocities.

    Raises
    ------
    OptionError
        When called without double precision.
    StateError
        For other shapes.
    ModelError
        For independent velocities of a spherical joint in a loop.
    """
    function = _function(Accelerations(mechanism, threads))
    return lambda q, v, tau: function(q, v, tau)[0]


def step(mechanism: Mechanism, h: float, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """One step of RK4, torques held, as a function (q, v, tau) of JAX.

    Parameters
    ----------
    mechanism, threads
        As of `accelerations`.
    h : float
        s.

    Returns
    -------
    callable (q, v, tau) -> (q, v)
        Of arrays as `accelerations` takes them: the states after the step.

    Raises
    ------
    OptionError, StateError, ModelError
        As of `accelerations`.
    """
    return _function(Rollout(mechanism, h, 1, threads, whole=False))


def rollout(mechanism: Mechanism, h: float, steps: int, threads: int = 1) -> Callable[[Any, Any, Any], Any]:
    """Steps of RK4, torques held over each, as a function (q, v, tau) of JAX.

    Backwards it multiplies the steps' derivatives, which are kept: (2m)² + 2m nv numbers a step.

    Parameters
    ----------
    mechanism, h, threads
        As of `step`.
    steps : int

    Returns
    -------
    callable (q, v, tau) -> (q, v)
        Of arrays (..., nq), (..., nv) and (..., steps, nv): the states at the start and after each step,
        (..., steps + 1, nq) and (..., steps + 1, nv).

    Raises
    ------
    OptionError, StateError, ModelError
        As of `accelerations`.
    """
    return _function(Rollout(mechanism, h, steps, threads))


def _function(exact: Exact) -> Callable[[Any, Any, Any], Any]:
    """A function of JAX by what NumPy does to it."""

    def ask(call: Callable[..., tuple[Any, ...]], given: Shapes, wanted: Shapes, *arrays: Any) -> Any:
        lead = arrays[0].shape[: arrays[0].ndim - len(given[0])]
        found = tuple(jax.ShapeDtypeStruct((*lead, *shape), np.float64) for shape in wanted)
        return jax.pure_callback(call, found, *arrays, vmap_method="broadcast_all")

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def function(q: Any, v: Any, tau: Any) -> Any:
        return ask(exact.evaluated, exact.arguments, exact.results, q, v, tau)

    def forward(q: Any, v: Any, tau: Any) -> Any:
        found = ask(exact.linearised, exact.arguments, exact.results + exact.kept, q, v, tau)
        return found[: len(exact.results)], found[len(exact.results) :]

    def backward(kept: Any, cotangents: Any) -> Any:
        return ask(exact.pulled, exact.kept + exact.results, exact.arguments, *kept, *cotangents)

    function.defvjp(forward, backward)
    compiled = jax.jit(function)  # also where the caller does not: tracing takes longer than a step

    def of_any(q: Any, v: Any, tau: Any) -> Any:
        if not jax.config.jax_enable_x64:
            raise OptionError(
                f"{exact.name}: JAX counts in single precision; say "
                'jax.config.update("jax_enable_x64", True) before the first array is made'
            )
        arrays = [jnp.asarray(x, dtype=np.float64) for x in (q, v, tau)]
        lead = exact.lead(tuple(x.shape for x in arrays))
        full = (jnp.broadcast_to(x, (*lead, *s)) for x, s in zip(arrays, exact.arguments, strict=True))
        return compiled(*full)

    return of_any
