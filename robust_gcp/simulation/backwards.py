"""Stretches of a run that the compiled kernel takes again, and goes through backwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import RobustGcpError
from ..kernel.derivation import Derivation, own_derivation
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .trajectory import Trajectory

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

    def reduced(self, by_q: Array, by_v: Array, later: int) -> Array:
        """By (η, u), (steps, 2m), of slopes by q and v (steps, nv), `later` steps on from each begin."""
        there = slice(later, later + len(by_q))
        G, dv_dy = self.G[there], self.dv_dy[there]
        by_y = np.einsum("sn,snm->sm", by_q, G) + np.einsum("sn,snm->sm", by_v, dv_dy)
        return np.hstack([by_y, np.einsum("sn,snm->sm", by_v, G)])

    def sweep(self, adjoint: Array, after: Array | None, before: Array | None) -> tuple[Array, Array]:
        """The adjoint (2m,) before the stretch from that after it, and the slopes by torques (steps, nv).

        `after` and `before` (steps, 2m) are added to it at either end of each step.
        """
        own = [
            None if part is None else np.vstack([np.zeros((self.begin - self.taken, part.shape[1])), part])
            for part in (after, before)
        ]
        first, last = self.begin - self.taken, self.end - self.taken
        rows, by_torque = self.kernel.pull(first, last, adjoint[None], *own)
        return rows[0], by_torque[:, 0]


def kernel_of(mechanism: Mechanism, run: Trajectory) -> Derivation | None:
    """A run's compiled derivatives in these coordinates; None where the reference is to do the work.

    They are the sweep's own: a cost may ask for derivatives of steps itself while a stretch is kept.
    """
    for q in (run.q[-1], run.q[0], run.q[len(run.q) // 2]):
        try:
            return own_derivation(mechanism, q)
        except RobustGcpError:  # no regular state: another one may serve
            continue
    return None


def backwards(kernel: Derivation, run: Trajectory, table: Array, first: int, end: int) -> Backwards | None:
    """The longest stretch that ends at output `end` and that the kernel takes; None where it takes no step.

    Parameters
    ----------
    first : int
        Output that it does not go beyond.
    table : ndarray (N, nv)
        The torques held over each step.
    """
    m, nv = kernel.m, kernel.nv
    length = max(1, min(LONGEST, ROOM // (4 * m * (2 * m + nv))))
    taken = max(first, end - length)
    if taken == end:
        return None
    good, G, dv_dy = kernel.take(
        run.t[taken : end + 1], run.q[taken : end + 1], run.v[taken : end + 1], table[taken:end]
    )
    bad = np.flatnonzero(~good)
    begin = taken + (int(bad[-1]) + 1 if len(bad) else 0)
    if begin >= end:
        return None
    return Backwards(kernel, taken, begin, end, G[begin - taken :], dv_dy[begin - taken :])
