"""A term of a cost at many states of a motion, with its slopes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...checks import real_array, shown
from ...errors import OptionError
from ...mechanism.differences import moved_along
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...user_functions import returned

NUDGE = 1e-3
"""Step of differences of order 4 without units: they err by 1e-13 of smooth costs."""

ORDER_4 = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))
"""Places and weights of the central difference of order 4."""

LIKE = 1e-12
"""Relative difference that rounding makes between values one by one and at once."""

ROOM = 1_000_000
"""Numbers that are moved at once for differences: 8 MB."""

States = tuple[Array, Array, Array, Array]
"""t (N,), q (N, nq), v and τ (N, nv)."""


Slopes = tuple[Array, Array, Array]
"""By q (nv,), along the velocities' components, by v (nv,) and by the torques (nv,)."""


class Along(NamedTuple):
    """A term at N states: its values (N,), and slopes by y and u (N, m) and by τ (N, nv)."""

    values: Array
    by_y: Array
    by_u: Array
    by_tau: Array


class Term:
    """The "terminal" or the "running" term of a cost, and what the user gives of its slopes, if anything."""

    def __init__(
        self, name: str, function: Callable[..., Any] | None, slopes: Callable[..., Any] | None
    ) -> None:
        self.function, self.slopes = function, slopes
        words, self._parts = ("q, v", 2) if name == "terminal" else ("t, q, v, tau", 3)
        self._labels = f"Cost: {name}({words})", f"Cost: {name}_slopes({words})"

    def at(self, mechanism: Mechanism, t: float, q: Array, v: Array, tau: Array) -> tuple[float, Slopes]:
        """The term at one state, and its slopes by q, v and τ; zero where there is none."""
        if self.function is None:
            return 0.0, (mechanism.tree.zero,) * 3
        found = self.at_each(mechanism, (np.array([t]), q[None], v[None], tau[None]))
        return float(found.values[0]), (found.by_y[0], found.by_u[0], found.by_tau[0])

    def at_each(self, mechanism: Mechanism, states: States) -> Along:
        """The term at N states, and its slopes by all velocities' components in place of y and u."""
        n, nv = states[2].shape
        every, still = (np.broadcast_to(part, (n, nv, nv)) for part in (np.eye(nv), np.zeros((nv, nv))))
        return self.along(mechanism, states, every, still)

    def along(self, mechanism: Mechanism, states: States, G: Array, dv_dy: Array) -> Along:
        """The term and its slopes; without those of the user by differences of order 4.

        Where the user's function takes arrays (nq, N), (nv, N) and gives the same for them as one by one, all
        differences are one call.

        Parameters
        ----------
        states : (t, q, v, tau)
        G, dv_dy : ndarray (N, nv, m)
        """
        values, m, nv = self.values(*states), G.shape[2], mechanism.nv
        if self.slopes is not None:
            by = np.zeros((3, *states[2].shape))
            for i, (t, *state) in enumerate(zip(states[0].tolist(), *states[1:], strict=True)):
                handed = [t, *(part.copy() for part in state)]
                given = self.slopes(*(handed if self._parts == 3 else handed[1:3]))
                by[: self._parts, i] = vectors(given, self._parts, nv, self._labels[1])
            by_y = np.einsum("sn,snm->sm", by[0], G) + np.einsum("sn,snm->sm", by[1], dv_dy)
            return Along(values, by_y, np.einsum("sn,snm->sm", by[1], G), by[2])
        function = self.function
        assert function is not None  # asked only where there is one
        # a function of one state may take arrays and mean another thing: q @ q of all is the cost of none
        again = at_once(function, states)
        same = again is not None and np.abs(again - values).max() <= LIKE * np.abs(values).max()

        def many(*parts: Array) -> Array:
            found = at_once(function, parts) if same else None
            return self.values(*parts) if found is None else found

        found = np.zeros((2 * m + nv, len(values)))
        moving = 2 * m + (nv if self._parts == 3 else 0)
        count = max(1, ROOM // (len(found) * nv))
        for first in range(0, len(values), count):
            here = slice(first, first + count)
            some = (part[here] for part in (*states, G, dv_dy))
            found[:moving, here] = _differences(many, mechanism, moving, *some)
        return Along(values, found[:m].T, found[m : 2 * m].T, found[2 * m :].T)

    def values(self, t: Array, q: Array, v: Array, tau: Array) -> Array:
        """The term at N states, asked one by one, (N,)."""
        function, label = self.function, self._labels[0]
        assert function is not None  # asked only where there is one
        if self._parts == 2:
            return np.array([number(function(x.copy(), w.copy()), label) for x, w in zip(q, v, strict=True)])
        states = zip(t.tolist(), q, v, tau, strict=True)
        return np.array([number(function(s, x.copy(), w.copy(), f.copy()), label) for s, x, w, f in states])


def _differences(
    many: Callable[..., Array],
    mechanism: Mechanism,
    k: int,
    t: Array,
    q: Array,
    v: Array,
    tau: Array,
    G: Array,
    dv_dy: Array,
) -> Array:
    """The first k of the slopes by y, u and τ, (k, N), all moved to each of four places at once."""
    n, nv, m = G.shape
    dq, dv, dtau = np.zeros((3, k, n, nv))
    # η moves q along G, and v with it as u is held; u moves v alone
    dq[:m], dv[:m], dv[m : 2 * m] = (part.transpose(2, 0, 1) for part in (G, dv_dy, G))
    for j in range(k - 2 * m):
        dtau[2 * m + j, :, j] = 1.0
    # by which each is moved: far enough for the quickest of what moves along, or for a torque by its own size
    reach = np.maximum(np.abs(dq / mechanism.units), np.abs(dv / np.maximum(1.0, np.abs(v)))).max(axis=2)
    reach[2 * m :] = 1.0 / np.maximum(1.0, np.abs(tau.T))[: k - 2 * m]
    h = NUDGE / reach
    found, moved = np.zeros((k, n)), np.tile(q, (k, 1, 1))
    for place, weight in ORDER_4:
        step = (place * h)[:, :, None]
        steps = (step[:m] * dq[:m]).reshape(m * n, nv)
        moved[:m] = moved_along(mechanism.tree, np.tile(q, (m, 1)), steps).reshape(m, n, -1)
        states = np.tile(t, k), moved, v + step * dv, tau + step * dtau
        values = many(*(part.reshape(k * n, *part.shape[2:]) for part in states))
        found += weight / h * values.reshape(k, n)
    return found


def at_once(function: Callable[..., Any], states: tuple[Array, ...]) -> Array | None:
    """Values of a function at many states, the number of the state last in its arrays; None where it refuses.

    Whatever it raises it is asked one by one then, and raises it there.
    """
    t, *rest = states
    if len(t) <= max(part.shape[1] for part in rest):  # arrays that it could take for one state's
        return None
    try:
        with np.errstate(all="ignore"):
            found = real_array(function(t.copy(), *(part.T.copy() for part in rest)))
    except Exception:
        return None
    return found if found.shape == t.shape and np.all(np.isfinite(found)) else None


def number(value: Any, label: str) -> float:
    """What a cost returned, or an OptionError."""
    if isinstance(value, float) and math.isfinite(value):  # most are
        return float(value)
    return float(returned(value, (), label))


def vectors(given: Any, count: int, nv: int, label: str) -> list[Array]:
    """What slopes of a cost returned, (nv,) each, or an OptionError."""
    try:
        vectors: list[Array] = [real_array(part) for part in given]
    except TypeError as error:
        raise OptionError(f"{label} returned {shown(given)}, expected {count} arrays ({nv},)") from error
    if [part.shape for part in vectors] != [(nv,)] * count:
        shapes = ", ".join(str(part.shape) for part in vectors)
        raise OptionError(f"{label} returned shapes {shapes}, expected {count} arrays ({nv},)")
    return vectors
