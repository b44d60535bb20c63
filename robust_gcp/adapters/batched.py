"""Functions of many states that frameworks differentiate by cotangents: NumPy alone, no framework.

A state is (q, v). Its independent entries y of q and u of v are the arguments of these functions; the others
say which assembly is meant: loops are closed from there with y held, and v = G u. So slopes by dependent
entries are zero, and what a framework sends back along dependent entries of a result goes to the independent
ones by q = γ(y), v = G(y) u.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from ..checks import check_mechanism, check_positive, check_whole
from ..errors import ModelError, StateError
from ..kernel.assembling import closed, lifted
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..simulation.derivatives import derivatives, forward_dynamics
from ..simulation.one_step import step
from .turning import normalised, rates

Shapes = tuple[tuple[int, ...], ...]


class Exact(ABC):
    """A function of q (..., nq), v (..., nv) and τ, the last axes those of one state, with its derivatives.

    Attributes
    ----------
    arguments, results, kept : tuple of tuple of int
        Shapes at one state: of the arguments, the results, and what `pulled` needs besides cotangents.
    """

    arguments: Shapes
    results: Shapes
    kept: Shapes

    def __init__(self, mechanism: Mechanism, threads: int, name: str) -> None:
        check_mechanism(mechanism, Mechanism, name)
        if mechanism.chart_joints:
            raise ModelError(
                f"{name}: joint {mechanism.chart_joints[0].name!r} has independent velocities that are the "
                "rates of no numbers in q; choose other independent joints"
            )
        self.mechanism, self.threads, self.name = mechanism, threads, name

    def evaluated(self, *given: Array) -> tuple[Array, ...]:
        """The results."""
        return _by_rows(self._evaluated, self.arguments, given)

    def linearised(self, *given: Array) -> tuple[Array, ...]:
        """The results, and what is kept for `pulled`."""
        return _by_rows(self._linearised, self.arguments, given)

    def pulled(self, *given: Array) -> tuple[Array, ...]:
        """Cotangents of the arguments by what was kept and cotangents of the results."""
        return _by_rows(self._pulled, self.kept + self.results, given)

    def lead(self, shapes: Shapes) -> tuple[tuple[int, ...], ...]:
        """What stands before the axes of one state in each of the arguments, given their shapes.

        Raises
        ------
        StateError
            Where they end otherwise.
        """
        for name, wanted, found in zip(("q", "v", "tau"), self.arguments, shapes, strict=True):
            if found[len(found) - len(wanted) :] != wanted:
                raise StateError(f"{self.name}: {name} is {found}, and must be {('...', *wanted)}")
        return tuple(s[: len(s) - len(w)] for s, w in zip(shapes, self.arguments, strict=True))

    @abstractmethod
    def _evaluated(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]: ...

    @abstractmethod
    def _linearised(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]: ...

    @abstractmethod
    def _pulled(self, *given: Array) -> tuple[Array, ...]: ...

    def _closed(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Loops closed with y held, and v = G u; v as given where K_d is singular: u does not tell it."""
        mechanism = self.mechanism
        if mechanism.nq != mechanism.nv:
            q = normalised(mechanism, q)
        q, done = closed(mechanism, q, mechanism.iv_dependent)
        if not np.all(done):
            q[~done] = mechanism.assemble(q[~done])
        fast = np.array(v)
        known = lifted(mechanism, q, fast, mechanism.iv_dependent)
        if known is None:
            return q, mechanism.lift(q, v[:, mechanism.iv_independent])
        return q, np.where(known[:, None], fast, v)

    def _to_independent(self, q: Array, v: Array, on_q: Array, on_v: Array) -> Array:
        """Cotangents (N, 2m) of (y, u) by those of q and v."""
        mechanism = self.mechanism
        own, others = mechanism.iv_independent, mechanism.iv_dependent
        along = on_q if mechanism.nq == mechanism.nv else _times(on_q, rates(mechanism, q))
        found = np.concatenate([along[:, own], on_v[:, own]], axis=1)
        some = np.flatnonzero(np.any(along[:, others], axis=1) | np.any(on_v[:, others], axis=1))
        if len(some):
            at = derivatives(mechanism, q[some], v[some])
            on_y = _times(along[some], at.G) + _times(on_v[some], at.dv_dy)
            found[some] = np.concatenate([on_y, _times(on_v[some], at.G)], axis=1)
        return found

    def _to_state(self, q: Array, rows: Array) -> tuple[Array, Array]:
        """Cotangents of q and v by those of (y, u)."""
        mechanism, m = self.mechanism, self.mechanism.m
        along, on_v = np.zeros((2, len(rows), mechanism.nv))
        along[:, mechanism.iv_independent], on_v[:, mechanism.iv_independent] = rows[:, :m], rows[:, m:]
        if mechanism.nq == mechanism.nv:
            return along, on_v
        by = rates(mechanism, q)
        return _times(along / np.sum(by * by, axis=1), by.transpose(0, 2, 1)), on_v


class Accelerations(Exact):
    """u̇ (m,) of (q, v, τ), Eq. (3)."""

    def __init__(self, mechanism: Mechanism, threads: int = 1) -> None:
        super().__init__(mechanism, threads, "accelerations")
        nq, nv, m = mechanism.nq, mechanism.nv, mechanism.m
        self.arguments, self.results = ((nq,), (nv,), (nv,)), ((m,),)
        self.kept = ((nq,), (m, 2 * m + nv))

    def _evaluated(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]:
        return (forward_dynamics(self.mechanism, *self._closed(q, v), tau),)

    def _linearised(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]:
        q, v = self._closed(q, v)
        at = derivatives(self.mechanism, q, v, tau)
        return at.udot, q, np.concatenate([at.da_dy, at.da_dv, at.da_dtau], axis=2)

    def _pulled(self, *given: Array) -> tuple[Array, ...]:
        q, slopes, on_udot = given
        rows, m = _times(on_udot, slopes), self.mechanism.m
        return *self._to_state(q, rows[:, : 2 * m]), rows[:, 2 * m :]


class Rollout(Exact):
    """States at the start and after each step of RK4, torques τ (steps, nv) held over each."""

    def __init__(
        self, mechanism: Mechanism, h: float, steps: int, threads: int = 1, name: str = "rollout"
    ) -> None:
        super().__init__(mechanism, threads, name)
        check_positive("h", h)
        check_whole("steps", steps, 1)
        nq, nv, m = mechanism.nq, mechanism.nv, mechanism.m
        self.h, self.steps = h, steps
        self.arguments, self.results = ((nq,), (nv,), (steps, nv)), ((steps + 1, nq), (steps + 1, nv))
        self.kept = (*self.results, (steps, 2 * m, 2 * m), (steps, 2 * m, nv))

    def _evaluated(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]:
        return self._run(q, v, tau, False)

    def _linearised(self, q: Array, v: Array, tau: Array) -> tuple[Array, ...]:
        Q, V, A, B = self._run(q, v, tau, True)
        return Q, V, Q, V, A, B

    def _run(self, q: Array, v: Array, tau: Array, jacobians: bool) -> tuple[Array, ...]:
        q, v = self._closed(q, v)
        found = [np.empty((len(q), *shape)) for shape in (self.kept if jacobians else self.results)]
        found[0][:, 0], found[1][:, 0] = q, v
        for k in range(self.steps):
            after = step(self.mechanism, q, v, tau[:, k], self.h, jacobians, threads=self.threads)
            q, v = found[0][:, k + 1], found[1][:, k + 1] = after.q, after.v
            if after.A is not None and after.B is not None:
                found[2][:, k], found[3][:, k] = after.A, after.B
        return tuple(found)

    def _pulled(self, *given: Array) -> tuple[Array, ...]:
        Q, V, A, B, on_q, on_v = given
        flat = [part.reshape(-1, part.shape[2]) for part in (Q, V, on_q, on_v)]
        along = self._to_independent(*flat).reshape(len(Q), self.steps + 1, 2 * self.mechanism.m)
        on_tau = np.empty((len(Q), self.steps, self.mechanism.nv))
        rows = along[:, -1]
        for k in reversed(range(self.steps)):
            on_tau[:, k] = _times(rows, B[:, k])
            rows = _times(rows, A[:, k]) + along[:, k]
        return *self._to_state(Q[:, 0], rows), on_tau


def _times(rows: Array, matrices: Array) -> Array:
    """Each row times its matrix."""
    product: Array = np.matmul(rows[:, None], matrices)[:, 0]
    return product


def _by_rows(
    function: Callable[..., tuple[Array, ...]], shapes: Shapes, given: tuple[Array, ...]
) -> tuple[Array, ...]:
    """A function of N rows at arrays with any axes before those of a row."""
    lead = given[0].shape[: np.ndim(given[0]) - len(shapes[0])]
    count = int(np.prod(lead))
    rows = [np.asarray(x, dtype=float).reshape(count, *s) for x, s in zip(given, shapes, strict=True)]
    return tuple(part.reshape(*lead, *part.shape[1:]) for part in function(*rows))
