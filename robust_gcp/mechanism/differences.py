"""Derivatives by differences, for functions that may be costly and may refuse an argument."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .tree.tree import Array, Tree

EPS = float(np.finfo(float).eps)
FORWARD, CENTRAL = EPS**0.5, EPS ** (1.0 / 3.0)
"""Steps, relative to the scale of the argument, at which truncation and rounding err alike."""


def differences(
    f: Callable[[Array], Array], x: Array, scale: Array, central: bool = False, base: Array | None = None
) -> Array:
    """∂f/∂x at x by forward or central differences.

    Parameters
    ----------
    f : callable (n,) -> (k,)
    x : ndarray (n,)
    scale : ndarray (n,)
        Change of each argument over which f bends noticeably; positive.
    central : bool
        Two evaluations for each argument instead of one: errors of ε^⅔ instead of ε^½.
    base : ndarray (k,), optional
        f(x), where the caller has it.

    Returns
    -------
    ndarray (k, n)
    """
    if not central and base is None:
        base = f(x.copy())
    columns = []
    for i, size in enumerate(scale):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += size * (CENTRAL if central else FORWARD)
        if central:
            behind[i] -= size * CENTRAL
        low = f(behind) if base is None or central else base
        columns.append((f(ahead) - low) / (ahead[i] - behind[i]))  # the step that x could be moved by
    return np.array(columns).T


def moved_along(tree: Tree, q: Array, steps: Array) -> Array:
    """Configurations (N, nq) moved along velocities' components (N, nv)."""
    if q.shape[1] == steps.shape[1]:  # all numbers of q are coordinates
        return q + steps
    return np.array([tree.integrate(*row) for row in zip(q, steps, strict=True)]).reshape(q.shape)


def torque_differences(
    tree: Tree, units: Array, torque: Callable[[Array, Array], Array], q: Array, v: Array
) -> tuple[Array, Array]:
    """∂τ/∂q, along the velocities' components, and ∂τ/∂v of τ(q, v) by central differences, (nv, nv) each.

    Parameters
    ----------
    units : ndarray (nv,)
        1 for angles, a length for lengths: over which τ bends noticeably.
    """
    by_q = differences(lambda dq: torque(tree.integrate(q, dq), v), np.zeros_like(v), units, central=True)
    # at high speed τ bends over that speed, and steps for 1 rad/s would be rounding
    by_v = differences(lambda w: torque(q, w), v, np.maximum(units, np.abs(v)), central=True)
    return by_q, by_v
