"""Closing the loops from afar: Levenberg–Marquardt on points first, then on points and rotations.

The rotation rows of φ vanish for half a turn too, so that least squares on φ may end there. Here a frame
closure counts by the logarithm of its rotation, log₃(R₁ᵀ R₂), a revolute closure by the chord of its axes,
a₁ − a₂: both vanish at the aligned assembly alone. Points come first because their basin is wide.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...errors import ClosureError
from ..constraint.closed_check import require_proper
from ..constraint.separation import Separation
from ..coordinates.loop_graph import loop_groups
from ..loops import ClosedLoops
from ..tolerances import CLOSED
from ..tree.joints import Array, Index

Residual = Callable[[Array], tuple[Array, Array]]
"""Residual and its Jacobian by the dimensionless step of all velocities."""

POINT_STEPS, STEPS = 60, 200
"""Steps of Levenberg–Marquardt at most: on points, and on everything."""

LONGEST = 0.3
"""Largest entry of a step, rad or characteristic lengths: a linearisation reaches no farther."""

FEW_STARTS = (0.0, 0.1, 0.3, 0.3)
"""Spread of the starts about a guess that is meant, rad or characteristic lengths."""

MANY_STARTS = (0.0, *(0.3,) * 3, *(0.8,) * 4)
"""Spread of the starts about a guess that nobody made."""

CLOSE = 1e-8
"""Residual, dimensionless, from which Newton's method on φ takes over."""

UNMOVED = 0.02
"""A residual that the joints change by no more is one of axes that are not quite parallel; dimensionless."""

MOST = 30
"""Open loops that a message lists."""

STALLED, PATIENCE = 0.99, 8
"""A search ends where that many steps together do not lower the cost by this factor."""


def free_velocities(loops: ClosedLoops) -> NDArray[np.int64]:
    """Velocities of joints that are in no loop and no coupling."""
    tied = {j for group in loop_groups(loops.own_model, loops.closures) for j in group.joints}
    free = [i for joint in loops.joints if joint.index not in tied for i in joint.iv]
    return np.array(free, dtype=np.int64)


def assembled(
    loops: ClosedLoops,
    guess: Array,
    free: Index,
    what: str,
    spreads: tuple[float, ...] = FEW_STARTS,
    besides: Residual | None = None,
) -> Array:
    """The configuration near a guess that closes all loops by moving the velocities `free` only.

    Redundant rows are closed in the least-squares sense: no rank is asked of K.

    Parameters
    ----------
    loops : ClosedLoops
    guess : ndarray (nq,)
    free : ndarray of int
    what : str
        Whose loops they are, for errors.
    spreads : tuple of float
        Of the reproducible starts that are tried one after the other.
    besides : callable, optional
        What must vanish beside the loops' residual, with its Jacobian by v.

    Raises
    ------
    ClosureError
        With each loop that stays open from the best start, and by how much.
    """
    # φ is zero too where frames are turned by half a turn
    closed = loops.nc == 0 or (loops.closure_residual(guess) <= CLOSED and _aligned(loops, guess))
    if closed and (besides is None or not np.any(besides(guess)[0])):  # kept to the last bit
        return guess
    rng = np.random.default_rng(0)
    steps = [rng.normal(0.0, 1.0, len(free)) * spread * loops.units[free] for spread in spreads]
    if besides is None:
        found = _in_kernel(loops, guess, free, steps)
        if found is not None:
            return found
    separation = Separation(loops)
    residuals = [_both(r, besides) for r in (separation.points, separation.everything)]
    best, least = guess, np.inf
    for moved in steps:
        q = _moved(loops, guess, free, moved)
        for residual, most in zip(residuals, (POINT_STEPS, STEPS), strict=True):
            q, size = _descended(loops, q, free, residual, most)
        if size < CLOSE:
            q = loops.polish(q, free)  # φ itself, of which the descent has other forms
            size = loops.closure_residual(q)
            if size <= CLOSED:
                return q
        if size < least:
            best, least = q, size
    refusal = _refusal(loops, separation, best, what)
    refusal.nearest = best
    raise refusal


def _moved(loops: ClosedLoops, guess: Array, free: Index, by: Array) -> Array:
    step = np.zeros(loops.nv)
    step[free] = by
    return loops.tree.integrate(guess, step)


def _in_kernel(loops: ClosedLoops, guess: Array, free: Index, steps: Sequence[Array]) -> Array | None:
    """The same by the compiled kernel, from the first of the starts that leads there, if any."""
    from ...kernel.constraint.assembling import closed  # it stands above what it is made of

    # the guess by itself first: as a rule that is enough, and it leads to the nearest assembly
    for some in (steps[:1], steps[1:]):
        starts = np.array([_moved(loops, guess, free, by) for by in some]).reshape(-1, loops.nq)
        q, done = closed(loops, starts, free)
        if np.any(done):
            return q[int(np.argmax(done))]
    return None


def _both(first: Residual, second: Residual | None) -> Residual:
    """The rows of two residuals."""
    if second is None:
        return first

    def stacked(q: Array) -> tuple[Array, Array]:
        (r, J), (more, by_v) = first(q), second(q)
        return np.concatenate([r, more]), np.vstack([J, by_v])

    return stacked


def _descended(
    loops: ClosedLoops, q: Array, free: Index, residual: Residual, steps: int
) -> tuple[Array, float]:
    """Where Levenberg–Marquardt ends, and the residual there."""
    damping, units = 1e-2, loops.units[free]
    r, J = residual(q)
    J = J[:, free] * units
    cost, history = float(r @ r), [np.inf]
    for _ in range(steps):
        # regular whatever J's rank is
        step = -np.linalg.solve(J.T @ J + damping * np.eye(len(free)), J.T @ r)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        dv = np.zeros(loops.nv)
        dv[free] = step * units
        trial = loops.tree.integrate(q, dv)
        r_trial, J_trial = residual(trial)
        if r_trial @ r_trial < cost:
            q, r, J, cost = trial, r_trial, J_trial[:, free] * units, float(r_trial @ r_trial)
            damping = max(0.3 * damping, 1e-14)  # never 0: of redundant rows JᵀJ is singular
        else:
            damping = min(4.0 * damping, 1e3)
        history.append(cost)
        stalled = len(history) > PATIENCE and cost > STALLED * history[-PATIENCE]
        # |r| two digits below `CLOSE`; stalled counts where damping does not make the steps short
        if cost < CLOSE**2 * 1e-4 or (stalled and damping < 1e2) or damping >= 1e3:
            break
    return q, float(np.abs(r).max(initial=0.0))


def _aligned(loops: ClosedLoops, q: Array) -> bool:
    try:
        require_proper(loops, q)
    except ClosureError:
        return False
    return True


def _moved_that_way(loops: ClosedLoops, q: Array) -> float:
    """How much of what φ is at q the joints change, in any configuration; dimensionless."""
    way = loops.phi(q) / loops.row_scale
    way /= max(float(np.linalg.norm(way)), 1e-300)
    way /= loops.row_scale
    places = [q, *loops.generic_configurations()]  # at q alone K may have lost rank
    return max(float(np.abs(way @ loops.K(p) * loops.units).max()) for p in places)


def _refusal(loops: ClosedLoops, separation: Separation, q: Array, what: str) -> ClosureError:
    """Every loop that stays open, the worst first."""
    sizes = [(s / (loops.length if u == "m" else 1.0), name, s, u) for name, s, u in separation.sizes(q)]
    sizes.sort(key=lambda item: -item[0])
    others = [f"{name} by {size:.3g} {unit}" for part, name, size, unit in sizes[1:] if part > CLOSED]
    listed = ", ".join(others[:MOST]) + (f" and {len(others) - MOST} more" if len(others) > MOST else "")
    _, worst, size, unit = sizes[0]
    remedy = (
        "no configuration near the guess closes it with the held joints: try another guess, hold fewer "
        "joints, or check the link lengths"
    )
    moved = _moved_that_way(loops, q)
    if moved < UNMOVED:
        remedy = (
            f"in no configuration do the joints move it that way by more than {moved:.1e} of their own motion"
            ", as where the axes of a planar loop are parallel but for such an angle: make them parallel (to "
            "2e-5, where such rows are left out), or close the loop with fewer rows"
        )
    return ClosureError(
        f"{what}: the loop {worst} is open by {size:.3g} {unit}{f' ({listed})' if others else ''}; {remedy}",
        sizes[0][2],
        sizes[0][1],
    )
