"""Quadratic and linear programs of a few unknowns: forces within bounds."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr
from scipy.optimize import linprog, lsq_linear

from ...errors import SimulationError
from ...mechanism.tree.tree import Array

ZERO = 1e-9
"""Share of the accelerations at hand below which a row does not move."""

RANK = 1e-9
"""Relative singular value below which rows depend on each other."""

DEPENDENT = 1e-7
"""The same on the diagonal of a pivoted QR, whose columns have length 1."""

LARGEST_MARGIN = 1e6
"""Of what is held without limit."""

NO_LOAD = 1e-12
"""N m or N: what rounding leaves of no load; rows hold it whose friction is none as nothing presses them."""


def box(B: Array, b: Array, lower: Array, upper: Array, size: float) -> tuple[Array, Array]:
    """f and w = BᵀB f + b with lower ≤ f ≤ upper, w ≥ 0 at lower, w ≤ 0 at upper, w = 0 between.

    It is the minimum of ½ fᵀ BᵀB f + bᵀ f: bounded least squares where b is in the range of Bᵀ. Dependent
    rows that ask for different things, such as stops of different restitution, have b outside of it; then
    all sets are looked at, of which there are few.

    Parameters
    ----------
    size : float
        Of the rates or accelerations at hand, of which b has rounding.

    Raises
    ------
    SimulationError
        Where there is no solution: rows contradict each other.
    """
    n = len(b)
    if n == 0:
        return np.zeros(0), np.zeros(0)
    idle = ~B.any(axis=0)
    if idle.any():  # rows that this mode does not move, or a drive alone: friction acts against their way
        f, w = np.where(b > 0.0, lower, np.where(b < 0.0, upper, 0.0)), b.copy()
        f[~np.isfinite(f) | (np.abs(b) <= ZERO * size)] = 0.0
        f[~idle], w[~idle] = box(B[:, ~idle], b[~idle], lower[~idle], upper[~idle], size)
        return f, w
    if n == 1 and (size_of_row := float(B[:, 0] @ B[:, 0])) > 0.0:
        only = np.clip(-b / size_of_row, lower, upper)  # what BVLS would take 0.2 ms for
        return only, size_of_row * only + b
    d = np.linalg.lstsq(B.T, b, rcond=RANK)[0]
    if np.abs(B.T @ d - b).max() <= ZERO * size:
        found = lsq_linear(B, -d, (lower, upper), method="bvls", tol=1e-15, max_iter=1000)
        return found.x, B.T @ (B @ found.x) + b
    if n > 10:  # 3¹⁰ sets take some 3 s
        raise SimulationError(
            f"{n} stops, joints with friction and locks that depend on each other meet at once"
        )
    W = B.T @ B
    least, best = np.inf, (np.zeros(n), b)
    for index in np.ndindex(*(3,) * n):
        sets = np.array(index)
        inner, f = sets == 0, np.where(sets == 1, lower, np.where(sets == 2, upper, 0.0))
        if not np.all(np.isfinite(f)):
            continue
        f[inner] = np.linalg.lstsq(W[np.ix_(inner, inner)], -(W[inner] @ f + b[inner]), rcond=RANK)[0]
        w = W @ f + b
        parts = [lower - f, f - upper, np.abs(w[inner]), -w[sets == 1], w[sets == 2]]
        wrong = float(np.concatenate(parts).max())
        if wrong < least:
            least, best = wrong, (f, w)
    if least > 100.0 * ZERO * size:
        raise SimulationError("stops and locks that are closed contradict each other: the mechanism jams")
    return best


def independent_rows(B: Array) -> list[int]:
    """A largest set of independent columns of B."""
    size = np.linalg.norm(B, axis=0)
    keep = np.flatnonzero(size)
    if not len(keep):
        return []
    R, order = qr(B[:, keep] / size[keep], mode="r", pivoting=True)
    count = int(np.sum(np.abs(np.diag(R)) > DEPENDENT))
    return sorted(keep[order[:count]].tolist())


class Load:
    """What rows at rest carry: f with Aᵀ f = need, within bounds, A = E N.

    Parameters
    ----------
    A : ndarray (n, m)
    rank : int
        Of A; less than n where rows share the load as they can.
    bounds : ndarray (n,)
        |f| ≤ bound of dry friction; infinite for the others.
    pushes : ndarray (n,) of bool
        Stops: f ≥ 0.
    """

    def __init__(self, A: Array, rank: int, bounds: Array, pushes: Array) -> None:
        self._A, self._rank, self._bounds, self._pushes = A, rank, bounds, pushes
        self._dry = np.isfinite(bounds)

    def forces(self, need: Array) -> tuple[Array, float]:
        """f (n,), and its margin, ≥ 0 where what is held stays so: a share of bounds, or N m of a push."""
        weight = np.where(self._dry, self._bounds, 1.0)
        f = weight * np.linalg.lstsq(self._A.T * weight, need, rcond=RANK)[0]  # alike in shares of bounds
        shares = 1.0 - np.abs(f) / np.where(self._dry, self._bounds, 1.0)
        limits = np.where(self._pushes, f, np.where(self._dry, shares, np.inf))
        margin = float(limits.min(initial=np.inf))
        return (f, margin) if margin >= 0.0 or len(f) <= self._rank else self._shared(need)

    def margin(self, need: Array) -> float:
        """The best margin, continuous in `need`."""
        if len(self._A) <= self._rank or not self._rank:
            return self.forces(need)[1]
        return self._shared(need)[1]

    def _shared(self, need: Array) -> tuple[Array, float]:
        """Rows that depend on each other share the load for the largest margin, each group by itself."""
        f, margin, size = np.zeros(len(self._A)), LARGEST_MARGIN, np.linalg.norm(self._A, axis=1)
        unit = self._A / np.where(size > 0.0, size, 1.0)[:, None]
        basis = independent_rows(self._A.T)  # fewer than the rank at a dead point, where rows are 0
        if not basis:
            return f, margin
        # in independent rows as coordinates those of a joint in no loop have nothing to do with others
        C, load = np.split(np.linalg.lstsq(unit[basis].T, np.c_[unit.T, need], rcond=RANK)[0], [-1], axis=1)
        load[np.abs(load) <= NO_LOAD] = 0.0
        tied = np.abs(C.T) > DEPENDENT
        together = np.linalg.matrix_power(tied.T @ tied, len(basis))
        for k in range(len(basis)):
            if not together[k, :k].any():  # the first of its group
                axes = np.flatnonzero(together[k])
                own = np.flatnonzero(tied[:, axes].any(axis=1))
                A = C[np.ix_(axes, own)].T * size[own, None]
                f[own], most = _carried_by(A, load[axes, 0], self._bounds[own], self._pushes[own])
                margin = min(margin, most)
        return f, margin


def _carried_by(A: Array, need: Array, bounds: Array, pushes: Array) -> tuple[Array, float]:
    """f with Aᵀ f = need, of the largest margin s: |f| ≤ (1 − s) F of dry friction, f ≥ s of stops."""
    dry = np.isfinite(bounds) & (bounds > 0.0)  # what has no friction at all does not limit s
    locks, most = np.isinf(bounds) & np.logical_not(pushes), 1.0 if dry.any() else LARGEST_MARGIN
    f = np.zeros(len(A))
    if locks.any():  # where these can hold it all the others need do nothing
        f[locks], _, rank, _ = np.linalg.lstsq(A[locks].T, need, rcond=RANK)
        if rank == A.shape[1]:
            return f, most
        f[locks] = 0.0
    if A.shape[1] > 1:
        return _by_program(A, need, bounds, pushes)
    a, load = A[:, 0], float(need[0])
    way = np.sign(a[pushes])
    if np.any(way > 0.0) and np.any(way < 0.0):  # stops on both sides
        chosen = np.logical_and(pushes, a * load > 0.0)
        f[chosen] = load / a[chosen].sum()
        return f, most
    D, P = float(np.abs(a[dry]) @ bounds[dry]), float(np.abs(a[pushes]).sum())
    if not load and not len(way):
        return f, most
    if not len(way):
        s = 1.0 - abs(load) / D if D else -LARGEST_MARGIN
        f[dry] = np.sign(a[dry] * load) * bounds[dry] * (1.0 - s)
        return f, s
    # stops can take as much as one likes; friction helps where the load would lift off them
    s = min(most, (load * way[0] + D) / (D + P))
    f[dry] = -np.sign(a[dry]) * way[0] * bounds[dry] * (1.0 - s)
    f[pushes] = (load - float(a[dry] @ f[dry])) / a[pushes].sum()
    return f, s


def _by_program(A: Array, need: Array, bounds: Array, pushes: Array) -> tuple[Array, float]:
    """The same of any such rows, by a linear program."""
    n, m = A.shape
    # shares of the load by rows of length 1: the solver's tolerance of 1e-7 is of no unit
    unit = (np.abs(need).max() or 1.0) / np.linalg.norm(A, axis=1)
    dry = np.isfinite(bounds)
    F = bounds / unit
    slack = np.where(dry, F, np.where(pushes, 1.0 / unit, 0.0))[:, None]
    one_sided = dry | pushes
    above = np.hstack([np.eye(n), slack])[dry], F[dry]
    below = np.hstack([-np.eye(n), slack])[one_sided], np.where(pushes, 0.0, F)[one_sided]
    equal = np.hstack([(A * unit[:, None]).T, np.zeros((m, 1))])
    limits = np.vstack([above[0], below[0]]), np.concatenate([above[1], below[1]])
    free = [(None, None)] * n + [(None, LARGEST_MARGIN)]
    found = linprog(np.append(np.zeros(n), -1.0), *limits, equal, need, bounds=free)
    if found.x is None:
        raise SimulationError(f"the forces of what is held are not found: {found.message}")
    return unit * found.x[:-1], float(found.x[-1])
