"""First derivatives of many steps of RK4 in the compiled kernel, forwards and backwards."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ...dynamics.equations import CheckedTorque, TorqueFunction
from ...dynamics.modes.mode_rates import ZONE
from ...dynamics.torque_feedback import TorqueSlopes, followed
from ...mechanism.tree.tree import Array
from ..dynamics.acting import asking
from .returned import Pulled, Stages, Taken
from .state_derivatives import StateDerivatives

SAME = 1e-7
"""How far a step that is taken again may end from the next state: dimensionless, and relative for v."""


class Derivation(StateDerivatives):
    """`StateDerivatives`, with steps."""

    _drives = 0  # how many inputs were prescribed when steps were taken last

    def take(
        self,
        times: Array,
        q: Array,
        v: Array,
        tau: Array | None,
        same: float = SAME,
        zone: float = ZONE,
        function: CheckedTorque | None = None,
        staged: bool = False,
        prescribed: Array | None = None,
        steady: float = 0.0,
    ) -> Taken:
        """Take the N steps between states again, for `pull`.

        Parameters
        ----------
        times : ndarray (N + 1,)
            s.
        q, v : ndarray (N + 1, nq), (N + 1, nv)
            NaN, but for the first, where they are not known.
        tau : ndarray (N, nv) or None
            Held over each step.
        same : float
            How far a step may end from the next state.
        zone : float
            Conditioning of K_d below which none is good: nearer, runs may take steps with error control.
        function : callable (t, q, v) -> (nv,), optional
            A torque besides, asked at each stage.
        staged : bool
            Whether what the stages are is wanted.
        prescribed : ndarray (N + 1, 4, 3, driven), optional
            y, ẏ and ÿ of the driven ones at each stage of the steps from each state.
        steady : float
            Change of G and its derivatives by rounding up to which a stage is good nearer than `zone` too.
        """
        n, nv, m, nq = len(times), self.nv, self.m, q.shape[1]
        G, v_y, status = np.empty((n, nv, m)), np.empty((n, nv, m)), np.empty(n, dtype=np.int32)
        times = np.ascontiguousarray(times, dtype=float)
        reached = np.empty((n, nq)), np.empty((n, nv))
        wanted: dict[str, Array] = {"G": G, "v_y": v_y, "q_out": reached[0], "v_out": reached[1]}
        stages = Stages.room(times, nq, nv, m) if staged else None
        if stages is not None:
            wanted |= stages.arrays()
        states = self._states(q, v, tau, status, wanted, 1.0, same, zone=zone, steady=steady)
        self._drives = 0
        if prescribed is not None:
            self._drives = states.structure.drives = prescribed.shape[3]
            states.reals(prescribed=prescribed)
        with asking(self._mechanism, states, function):
            self._library.take(self._handle, ctypes.byref(states.structure), times.ctypes.data)
        return Taken(status == 0, G, v_y, *reached, stages)

    def step_each(
        self,
        q: Array,
        v: Array,
        tau: Array | None,
        h: float,
        jacobians: bool = False,
        function: CheckedTorque | None = None,
        t: float = 0.0,
        mode: Array | None = None,
    ) -> tuple[NDArray[np.bool_], Array, Array, Array | None, Array | None]:
        """A step of RK4 from each of N states: which are good, their ends, and A and B where they are wanted.

        `tau` (N, nv) is held over the step of h s, besides a function; A is (N, 2m, 2m), B (N, 2m, nv).
        `mode` as in `slopes`.
        """
        n, m = len(q), self.m
        status, ends = np.empty(n, dtype=np.int32), (np.empty(q.shape), np.empty(v.shape))
        G = np.empty((n, self.nv, m))
        wanted: dict[str, Array] = {"q_out": ends[0], "v_out": ends[1], "G": G}
        if jacobians:
            wanted |= {"A": np.empty((n, 2 * m, 2 * m)), "B": np.empty((n, 2 * m, self.nv))}
        # ∞: no next state is known
        states = self._states(q, v, tau, status, wanted, 1.0, np.inf, mode, ZONE)
        with asking(self._mechanism, states, function):
            self._library.step_each(self._handle, ctypes.byref(states.structure), t, h)
        return self._sound(status, q, G, mode), *ends, wanted.get("A"), wanted.get("B")

    def follow(
        self, function: TorqueFunction, slopes: TorqueSlopes | None, stages: Stages, first: int = 0
    ) -> None:
        """Have a function's torque follow the state at the stages of steps from one on; see `followed`.

        It is asked beside these, and may not take other steps with this one meanwhile.
        """
        states = stages.t, stages.q, stages.v
        found = followed(self._mechanism, function, slopes, states, stages.G, stages.dv_dy)
        by_y, by_u = map(np.ascontiguousarray, found)
        self._library.feed(self._handle, 4 * first, len(by_y), by_y.ctypes.data, by_u.ctypes.data)  # 4 stages

    def pull(
        self,
        first: int,
        last: int,
        rows: Array,
        after: Array | None = None,
        before: Array | None = None,
        feedback: Array | None = None,
        staged: bool = False,
    ) -> Pulled:
        """What multiplies changes of (η, u) at the end of step last − 1 taken back to before step `first`.

        Parameters
        ----------
        first, last : int
            Steps that were taken, all of them good.
        rows : ndarray (k, 2m)
        after, before : ndarray (N, 2m), optional
            Added at the end and at the begin of each step.
        feedback : ndarray (last − first, nv, 2m), optional
            How torques held over each step follow the state before it.
        staged : bool
            Whether what multiplies the torques of each stage is wanted.

        Returns
        -------
        Pulled
        """
        rows = np.array(rows, dtype=float, order="C")
        by_tau = np.empty((last - first, len(rows), self.nv))
        by_stage = np.empty((last - first, len(rows), 4, self.nv)) if staged else None
        by_drive = np.empty((last - first, len(rows), 5, 3, self._drives)) if self._drives else None
        given = after, before, feedback, by_tau, by_stage, by_drive
        more = [None if part is None else np.ascontiguousarray(part) for part in given]
        places = [None if part is None else part.ctypes.data for part in more]
        self._library.pull(self._handle, first, last, len(rows), rows.ctypes.data, *places)
        return Pulled(rows, by_tau, by_stage, by_drive)
