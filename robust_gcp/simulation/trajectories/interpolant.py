"""A motion between its outputs: the interpolant that q, v and a determine, on the group where q has turns.

On the step from t₀ to t₁ = t₀ + h the motion is q₀ ⊕ s(x), x = (t − t₀)/h, and s is the polynomial of degree
five that meets position, velocity and acceleration at both ends:

    s(x) = c(x) + x² (1 − x)² (A + B x)

c is the cubic through positions and velocities; A and B make up what its second derivative lacks at x = 0
and at x = 1. The error of q is O(h⁶), that of v O(h⁵), of a O(h⁴): at least RK4's. A torque that jumps at t₁
makes a jump there, and the acceleration recorded at t₁ is the one after it: B = 0 then, the polynomial of
degree four through the other five data, with errors O(h⁵), O(h⁴), O(h³). At a cusp, where the acceleration
is infinite, s is the cubic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ...checks import real_array, shown
from ...errors import OptionError
from ...mechanism.tree.tree import Array, Tree

# of sin ωt it is 0.004 at ωh = 0.5 and 0.075 at 2
JUMP = 0.25
"""Share of a step's change of acceleration that B makes up in a smooth motion at most; in a jump 2/3."""

NUDGE = 1e-3
"""Step, in radians or units of length, of the differences that turn rates on a group are taken by."""


def sampled_accelerations(tree: Tree, t: Array, q: Array, v: Array) -> Array:
    """Accelerations (N, nv) at the times t from q and v alone, error O(h⁴); NaN for a single time.

    The second derivative of the polynomial of degree five through q and v at three neighbouring times
    (at two times: of degree three, error O(h²)).
    """
    n = len(t)
    if n < 2:
        return np.full((n, tree.nv), np.nan)
    k = min(n, 3)
    near = np.clip(np.arange(n) - 1, 0, n - k)[:, None] + np.arange(k)
    if tree.vector_space:
        apart, rates = q[near] - q[:, None], v[near]
    else:  # at s = 0 the second derivative on the group is the acceleration itself
        apart = np.array([[tree.difference(q[i], q[j]) for j in js] for i, js in enumerate(near)])
        rates = np.array([[_log_rate(tree, q[i], q[j], v[j]) for j in js] for i, js in enumerate(near)])
    times = t[near] - t[:, None]
    h = np.ptp(times, axis=1)[:, None, None]
    x, power = times[:, :, None] / h, np.arange(2 * k)
    slopes = power * x ** np.maximum(power - 1, 0)
    equations = np.concatenate([x**power, slopes], axis=1)
    coefficients = np.linalg.solve(equations, np.concatenate([apart, h * rates], axis=1))
    second: Array = 2.0 * coefficients[:, 2] / h[:, 0] ** 2
    return second


class Interpolant:
    """q, v and a of a motion at any time between its first and its last output.

    Parameters
    ----------
    tree : Tree
    t : ndarray (N,)
        Increasing, s; at least one.
    q, v, a : ndarray (N, nq), (N, nv), (N, nv)
    """

    def __init__(self, tree: Tree, t: Array, q: Array, v: Array, a: Array) -> None:
        self._tree, self._t, self._q, self._v, self._a = tree, t, q, v, a

    def __call__(self, times: Array) -> tuple[Array, Array, Array]:
        """q (k, nq), v (k, nv) and a (k, nv) at k times, which must lie between the first and the last."""
        tree, last = self._tree, len(self._t) - 1
        if last == 0 or not len(times):
            same = np.zeros(len(times), dtype=np.int64)
            return self._q[same], self._v[same], self._a[same]
        # an output belongs to the step after it, whose acceleration there is the recorded one
        i = np.clip(np.searchsorted(self._t, times, side="right") - 1, 0, last - 1)
        h = (self._t[i + 1] - self._t[i])[:, None]
        x = (times - self._t[i])[:, None] / h
        if tree.vector_space:
            end = self._q[i + 1] - self._q[i], self._v[i + 1], self._a[i + 1]
            s, ds, dds = _quintic(x, h, self._v[i], self._a[i], *end)
            return self._q[i] + s, ds, dds
        moved = [self._on_group(int(k), xk, hk) for k, xk, hk in zip(i, x, h, strict=True)]
        q, v, a = (np.array(part) for part in zip(*moved, strict=True))
        return q, v, a

    def _on_group(self, i: int, x: Array, h: Array) -> tuple[Array, Array, Array]:
        """At one time x h after output i."""
        tree, q0, q1, v1 = self._tree, self._q[i], self._q[i + 1], self._v[i + 1]
        end = tree.difference(q0, q1)
        ds1 = _log_rate(tree, q0, q1, v1)
        # the rate of difference_rate along v₁: Pinocchio has no second derivatives on groups
        turning = _directional(lambda e: _log_rate(tree, q0, tree.integrate(q1, e * v1), v1), v1)
        dds1 = _log_rate(tree, q0, q1, self._a[i + 1]) + turning
        s, ds, dds = _quintic(x, h, self._v[i], self._a[i], end, ds1, dds1)
        v = tree.integrate_rate(q0, s) @ ds
        turning = _directional(lambda e: tree.integrate_rate(q0, s + e * ds) @ ds, ds)
        return tree.integrate(q0, s), v, tree.integrate_rate(q0, s) @ dds + turning


def _log_rate(tree: Tree, q0: Array, q1: Array, v1: Array) -> Array:
    """d/dt (q1 ⊖ q0) where q1 moves with the velocity v1."""
    return v1 if tree.vector_space else tree.difference_rate(q0, q1) @ v1


def _directional(f: Callable[[float], Array], along: Array) -> Array:
    """df/de at e = 0 by differences of fourth order; f moves by `along` for each unit of e."""
    e = NUDGE / max(float(np.abs(along).max(initial=0.0)), NUDGE)
    slope: Array = (8.0 * (f(e) - f(-e)) - (f(2.0 * e) - f(-2.0 * e))) / (12.0 * e)
    return slope


def _quintic(
    x: Array, h: Array, v0: Array, a0: Array, s1: Array, v1: Array, a1: Array
) -> tuple[Array, Array, Array]:
    """s, ds/dt and d²s/dt² at x, with s(0) = 0 and s(1) = s1; rates and accelerations by time."""
    b, c = 3.0 * s1 - h * (2.0 * v0 + v1), h * (v0 + v1) - 2.0 * s1  # cubic: h v0 x + b x² + c x³
    if not (np.isfinite(a0).all() and np.isfinite(a1).all()):
        known, by_t = np.isfinite(a0) & np.isfinite(a1), 2.0 / (h * h)  # of the cubic: A = B = 0
        a0, a1 = np.where(known, a0, by_t * b), np.where(known, a1, by_t * (b + 3.0 * c))
    A = 0.5 * (h * h * a0 - 2.0 * b)
    B = 0.5 * (h * h * a1 - (2.0 * b + 6.0 * c)) - A
    bend = 2.0 * b + 3.0 * c - A - 0.5 * h * h * (a0 + a1)  # of the acceleration, at mid-step
    smooth = 2.0 * np.abs(B) <= JUMP * (h * h * np.abs(a1 - a0) + np.abs(bend))
    B = np.where(smooth, B, 0.0)
    # x² (1 − x)² (A + B x) = A x² + (B − 2A) x³ + (A − 2B) x⁴ + B x⁵
    b, c, d = b + A, c + B - 2.0 * A, A - 2.0 * B
    s = x * (h * v0 + x * (b + x * (c + x * (d + x * B))))
    ds = h * v0 + x * (2.0 * b + x * (3.0 * c + x * (4.0 * d + x * 5.0 * B)))
    dds = 2.0 * b + x * (6.0 * c + x * (12.0 * d + x * 20.0 * B))
    return s, ds / h, dds / (h * h)


def times_within(t: ArrayLike, known: Array) -> Array:
    """Times (k,) or () as floats that lie within the motion, else an OptionError."""
    try:
        times = real_array(t)
    except TypeError:
        times = np.full(1, np.nan)
    if times.ndim > 1 or not len(known) or not np.all((known[0] <= times) & (times <= known[-1])):
        span = f"from {known[0]:g} to {known[-1]:g} s" if len(known) else "over no time"
        raise OptionError(f"t = {shown(t)}: give a time, or a list of times, within the motion, {span}")
    return times
