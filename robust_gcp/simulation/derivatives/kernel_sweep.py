"""Stretches of a run that the compiled kernel takes again, and goes through backwards."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ...dynamics.discrete import STAGES
from ...dynamics.equations import CheckedTorque, TorqueFunction
from ...dynamics.prescribed.drive import Drive
from ...dynamics.torque_feedback import TorqueSlopes
from ...errors import RobustGcpError
from ...kernel.derivatives.derivations import own_derivation
from ...kernel.derivatives.returned import Stages
from ...kernel.derivatives.step_derivatives import Derivation
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.trajectory import Trajectory

ROOM = 4_000_000
"""Numbers that are kept at once: 32 MB."""

LONGEST = 512
"""Steps of a stretch, at most."""


@dataclass(frozen=True)
class Backwards:
    """Steps begin … end − 1 of a run, taken again.

    Attributes
    ----------
    begin, end : int
    G, dv_dy : ndarray (end − begin + 1, nv, m)
        At the states from `begin` to `end`.
    """

    kernel: Derivation
    taken: int
    begin: int
    end: int
    G: Array
    dv_dy: Array
    stages: Stages | None

    def follow(self, function: TorqueFunction, slopes: TorqueSlopes | None) -> None:
        """Have a function's torque follow the state within the steps."""
        assert self.stages is not None  # asked for with the function
        self.kernel.follow(function, slopes, self.stages, self.begin - self.taken)

    def sweep(
        self, adjoint: Array, after: Array | None, before: Array | None, feedback: Array | None
    ) -> tuple[Array, Array, Array | None, Array | None]:
        """The adjoint (2m,) before the stretch from that after it, and the slopes by torques (steps, nv).

        `after` and `before` (steps, 2m) are added to it at either end of each step; `feedback`
        (steps, nv, 2m) says how torques held over the steps follow the states before them. Third are the
        slopes by the torques at each stage (4 steps, nv), where the stages are known; fourth those by
        prescribed motions (steps, 5, 3, driven), where there are some.
        """
        # the kernel counts from the first step taken, skipped ones included
        later, earlier = (
            None if part is None else np.vstack([np.zeros((self.begin - self.taken, part.shape[1])), part])
            for part in (after, before)
        )
        first, last = self.begin - self.taken, self.end - self.taken
        staged = self.stages is not None
        found = self.kernel.pull(first, last, adjoint[None], later, earlier, feedback, staged)
        by_stage = None if found.by_stage is None else found.by_stage.reshape(-1, self.kernel.nv)
        by_drive = None if found.by_drive is None else found.by_drive[:, 0]
        return found.rows[0], found.by_tau[:, 0], by_stage, by_drive


def kernel_of(mechanism: Mechanism, run: Trajectory, driven: Sequence[int] = ()) -> Derivation | None:
    """A run's compiled derivatives in these coordinates; None where the reference is to do the work.

    They are the sweep's own: a cost may ask for derivatives of steps itself while a stretch is kept.
    """
    for q in (run.q[-1], run.q[0], run.q[len(run.q) // 2]):
        with suppress(RobustGcpError):  # no regular state: another one may serve
            return own_derivation(mechanism, q, driven=driven)
    return None


def backwards(
    kernel: Derivation,
    run: Trajectory,
    torque: tuple[Array | None, CheckedTorque | None],
    staged: bool,
    first: int,
    end: int,
    drive: Drive | None = None,
) -> Backwards | None:
    """The longest stretch that ends at output `end` and that the kernel takes; None where it takes no step.

    Parameters
    ----------
    torque : (ndarray (N, nv) or None, callable or None)
        The torques held over each step; and one that follows the state within the steps.
    staged : bool
        Whether what the stages are is wanted.
    first : int
        Output that it does not go beyond.
    drive : Drive, optional
        What the kernel's driven coordinates do.
    """
    m, nv = kernel.m, kernel.nv
    # of each of four stages ∂u̇ by y, u and τ is kept
    length = max(1, min(LONGEST, ROOM // (4 * m * (2 * m + nv))))
    taken = max(first, end - length)
    if taken == end:
        return None
    table, function = torque
    states = run.t[taken : end + 1], run.q[taken : end + 1], run.v[taken : end + 1]
    held = None if table is None else table[taken:end]
    told = None if drive is None else drive.stages(states[0], STAGES)
    found = kernel.take(*states, held, function=function, staged=staged, prescribed=told)
    bad = np.flatnonzero(~found.good)
    # backwards, only what lies behind the last refused step is ready; the rest waits until that is passed
    skipped = int(bad[-1]) + 1 if len(bad) else 0
    if taken + skipped >= end:
        return None
    stages = None if found.stages is None else found.stages.of(skipped, end - taken)
    return Backwards(kernel, taken, taken + skipped, end, found.G[skipped:], found.dv_dy[skipped:], stages)
