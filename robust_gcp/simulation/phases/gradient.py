"""Gradient of a cost along a run through phases: the chain of its steps and jumps, gone through backwards.

What multiplies changes of the state at a fixed time is λ (2nv,). At a turn, outputs just before and after it
move with it in time: J also changes by ∂J/∂t_k δt there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...dynamics.equations import torque_function
from ...dynamics.torque_feedback import AppliedSlopes, TorqueSlopes
from ...errors import OptionError
from ...mechanism.tree.tree import Array
from ..derivatives.cost import Cost, Gradient
from ..trajectories.trajectory import Trajectory
from .chain import Chain
from .links import Turned

LATER = 1e-4
"""Step of differences by time of a running cost, as a share of the run."""


class Running:
    """The running term of a cost, by the trapezoidal rule between outputs.

    Attributes
    ----------
    value : float
    by_state : ndarray (N + 1, 2nv)
        By each output's q and v.
    by_torque : ndarray (N, nv)
    """

    def __init__(self, run: Trajectory, cost: Cost, torque: Any, slopes: TorqueSlopes | None) -> None:
        self._run, self._cost = run, cost
        mechanism, nv = run.mechanism, run.mechanism.nv
        self._torque = torque_function(mechanism, torque)
        applied = AppliedSlopes(mechanism, torque if callable(torque) else None, slopes)
        n = len(run.t)
        self.value, self.by_state, self.by_torque = 0.0, np.zeros((n, 2 * nv)), np.zeros((n - 1, nv))
        self._rate: Array = np.zeros(n)
        self._half = 0.5 * np.diff(run.t)
        self._weight = np.append(self._half, 0.0) + np.append(0.0, self._half)
        if cost.running is None:
            return
        weight = self._weight
        tau = np.array([self._tau(*state) for state in zip(run.t.tolist(), run.q, run.v, strict=True)])
        found = cost.running_term.at_each(mechanism, (run.t, run.q, run.v, tau))
        self._rate = found.values
        for k, (by_q, by_v, by_tau) in enumerate(zip(*found[1:], strict=True)):
            t, q, v = float(run.t[k]), run.q[k], run.v[k]
            if applied.some and np.any(by_tau):
                tau_q, tau_v = applied(t, q, v)
                by_q, by_v = by_q + by_tau @ tau_q, by_v + by_tau @ tau_v
            self.by_state[k] = weight[k] * np.concatenate([by_q, by_v])
            for i in (k - 1, k):
                if 0 <= i < n - 1:
                    self.by_torque[i] += self._half[i] * by_tau
        self.value = float(self._half @ (self._rate[1:] + self._rate[:-1]))

    def by_time(self, k: int) -> float:
        """∂/∂t_k, the state of that output as it is."""
        if self._cost.running is None:
            return 0.0
        run, L = self._run, self._rate
        before = 0.5 * (L[k - 1] + L[k]) if k > 0 else 0.0
        after = 0.5 * (L[k] + L[k + 1]) if k + 1 < len(L) else 0.0
        h, t, q, v = LATER * float(run.t[-1] - run.t[0]), float(run.t[k]), run.q[k], run.v[k]
        times = t + h * np.array([1, -1, 2, -2])
        tau = np.array([self._tau(s, q, v) for s in times.tolist()])
        values = self._cost.running_term.values(times, np.tile(q, (4, 1)), np.tile(v, (4, 1)), tau)
        slope = (8.0 * (values[0] - values[1]) - values[2] + values[3]) / (12.0 * h)
        return float(before - after + self._weight[k] * slope)

    def _tau(self, t: float, q: Array, v: Array) -> Array:
        return np.zeros(self._run.mechanism.nv) if self._torque is None else self._torque(t, q, v)


def pulled(
    run: Trajectory,
    cost: Cost,
    torque: Any,
    parameters: Sequence[str],
    slopes: TorqueSlopes | None,
    mode: Any,
) -> Gradient:
    """The gradient along a run with stops, friction and locks; the arguments are those of `gradient`."""
    for name, given in (("torque=", torque is not None), ("parameters=", bool(len(parameters)))):
        if given:
            raise OptionError(f"gradient: {name} does not go with a run with joints=; leave it out")
    chain = Chain(run, slopes, mode)
    running = Running(run, cost, None if run.acted is None else run.acted.torque, slopes)
    value, (by_q, by_v, _) = cost.at_end(run.mechanism, run.q[-1], run.v[-1])
    row = np.concatenate([by_q, by_v]) + running.by_state[-1]
    by_torque = running.by_torque
    links = list(chain.links())
    # outputs beside a turn move with it: `_through` has their slopes
    turned = {k for link in links if isinstance(link, Turned) for k in (link.before, link.after)}
    if len(run.t) - 1 in turned:
        row = row - running.by_state[-1]  # it moves with its turn
    for link in reversed(links):
        if isinstance(link, Turned):
            row = _through(link, running, row)
            continue
        row, by = link.backward(row)
        by_torque[link.first] += by
        if link.first not in turned:
            row = row + running.by_state[link.first]
    by_start = np.where(chain.undefined, np.nan, row @ chain.start.whole)
    by_y, by_u = np.split(by_start, 2)
    return Gradient(value + running.value, by_y, by_u, by_torque, {})


def _through(link: Turned, running: Running, row: Array) -> Array:
    """λ before a turn, from λ after it."""
    jump, outputs = link.jump, [k for k in (link.before, link.after) if k is not None]
    moved = row if link.after is None else row + running.by_state[link.after]
    moved = moved @ jump.reset
    if link.before is not None:
        moved = moved + running.by_state[link.before]
    by_time = float(moved @ jump.before - row @ jump.after) + sum(map(running.by_time, outputs))
    return moved + by_time * jump.by_time
