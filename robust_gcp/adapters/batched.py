"""Accelerations, and rollouts of steps, of many states at once with their derivatives: NumPy alone."""

from __future__ import annotations

import numpy as np

from ..checks import check_positive, check_whole
from ..kernel.simulation.rows import MANY
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..simulation.batches.batch import Batch
from ..simulation.derivatives.accelerations import derivatives, forward_dynamics
from ..simulation.derivatives.one_step import step
from .cotangents import Arrays, Exact
from .states import closed_states, times, to_independent, to_state


class Accelerations(Exact):
    """u̇ (m,) of (q, v, τ), Eq. (3)."""

    def __init__(self, mechanism: Mechanism, threads: int = 1) -> None:
        super().__init__(mechanism, threads, "accelerations")
        nq, nv, m = mechanism.nq, mechanism.nv, mechanism.m
        self.arguments, self.results = ((nq,), (nv,), (nv,)), ((m,),)
        self.kept = ((nq,), (m, 2 * m + nv))

    def _evaluated(self, q: Array, v: Array, tau: Array) -> Arrays:
        return (forward_dynamics(self.mechanism, *closed_states(self.mechanism, q, v), tau),)

    def _linearised(self, q: Array, v: Array, tau: Array) -> Arrays:
        q, v = closed_states(self.mechanism, q, v)
        at = derivatives(self.mechanism, q, v, tau)
        return at.udot, q, np.concatenate([at.da_dy, at.da_dv, at.da_dtau], axis=2)

    def _pulled(self, *given: Array) -> Arrays:
        q, slopes, on_udot = given
        rows, m = times(on_udot, slopes), self.mechanism.m
        return *to_state(self.mechanism, q, rows[:, : 2 * m]), rows[:, 2 * m :]


class Rollout(Exact):
    """States at the start and after each step of RK4, torques τ (steps, nv) held over each.

    With `whole` False the state after one step alone, under τ (nv,).
    """

    def __init__(
        self, mechanism: Mechanism, h: float, steps: int, threads: int = 1, whole: bool = True
    ) -> None:
        super().__init__(mechanism, threads, "rollout" if whole else "step")
        check_positive("h", h)
        check_whole("steps", steps, 1)
        nq, nv, m = mechanism.nq, mechanism.nv, mechanism.m
        self.h, self.steps, self._whole = h, steps, whole
        states = (steps + 1, nq), (steps + 1, nv)
        self.arguments = (nq,), (nv,), (steps, nv) if whole else (nv,)
        self.results = states if whole else ((nq,), (nv,))
        self.kept = (*states, (steps, 2 * m, 2 * m), (steps, 2 * m, nv))

    def _evaluated(self, q: Array, v: Array, tau: Array) -> Arrays:
        tau = tau.reshape(len(q), self.steps, -1)
        Q, V = (self._run if len(q) * self.steps < MANY else self._run_batch)(q, v, tau)
        return (Q, V) if self._whole else (Q[:, -1], V[:, -1])

    def _run_batch(self, q: Array, v: Array, tau: Array) -> Arrays:
        """The states, all rows stepped together."""
        q, v = closed_states(self.mechanism, q, v)
        batch = Batch(self.mechanism, len(q), q, v, self.h, joints=[])
        found = [np.empty((len(q), *shape)) for shape in self.kept[:2]]
        found[0][:, 0], found[1][:, 0] = q, v
        for k in range(self.steps):
            found[0][:, k + 1], found[1][:, k + 1], *_ = batch.step(tau[:, k])
            # a row that stopped is no state to lead on from: the whole call fails, as one by one
            for error in batch.errors.values():
                raise error
        return tuple(found)

    def _linearised(self, q: Array, v: Array, tau: Array) -> Arrays:
        Q, V, A, B = self._run(q, v, tau.reshape(len(q), self.steps, -1), True)
        return *((Q, V) if self._whole else (Q[:, -1], V[:, -1])), Q, V, A, B

    def _run(self, q: Array, v: Array, tau: Array, jacobians: bool = False) -> Arrays:
        """The states, and A and B of each step where they are wanted."""
        q, v = closed_states(self.mechanism, q, v)
        found = [np.empty((len(q), *shape)) for shape in self.kept[: 4 if jacobians else 2]]
        found[0][:, 0], found[1][:, 0] = q, v
        for k in range(self.steps):
            after = step(self.mechanism, q, v, tau[:, k], self.h, jacobians)
            q, v = found[0][:, k + 1], found[1][:, k + 1] = after.q, after.v
            if after.A is not None and after.B is not None:
                found[2][:, k], found[3][:, k] = after.A, after.B
        return tuple(found)

    def _pulled(self, *given: Array) -> Arrays:
        Q, V, A, B, on_q, on_v = given
        if not self._whole:
            on_q, on_v = (np.stack([np.zeros_like(part), part], axis=1) for part in (on_q, on_v))
        flat = [part.reshape(-1, part.shape[2]) for part in (Q, V, on_q, on_v)]
        here = to_independent(self.mechanism, *flat).reshape(len(Q), self.steps + 1, -1)
        on_tau = np.empty((len(Q), self.steps, self.mechanism.nv))
        rows = here[:, -1]
        for k in reversed(range(self.steps)):
            on_tau[:, k] = times(rows, B[:, k])  # rows are still those after the step
            rows = times(rows, A[:, k]) + here[:, k]
        return *to_state(self.mechanism, Q[:, 0], rows), on_tau if self._whole else on_tau[:, 0]
