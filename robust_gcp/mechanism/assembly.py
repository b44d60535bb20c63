"""Closing the loops from afar: Levenberg–Marquardt on points first, then on points and rotations.

The rotation rows of φ vanish for half a turn too, so that least squares on φ may end there. Here a frame
closure counts by the logarithm of its rotation, log₃(R₁ᵀ R₂), and a hinge closure by the chord of its axes,
a₁ − a₂: both vanish at the aligned assembly alone. Points come first because their basin is wide.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError
from .closures import WELDED, Closure, RevoluteClosure
from .joints import support
from .loop_graph import loop_groups
from .loops import ClosedLoops
from .rows import ROTATION, rows_of
from .tolerances import CLOSED
from .tree import Array
from .vectors import skew

Index = NDArray[np.int64]
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
    free = [i for joint in loops.joints if joint.index not in tied for i in range(*joint.v.indices(loops.nv))]
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
    closed = loops.nc == 0 or (loops.closure_residual(guess) <= CLOSED and _aligned(loops, guess))
    if closed and (besides is None or not np.any(besides(guess)[0])):
        return guess
    separation = _Separation(loops)
    residuals = [_both(r, besides) for r in (separation.points, separation.everything)]
    rng = np.random.default_rng(0)
    best, least = guess, np.inf
    for spread in spreads:
        step = np.zeros(loops.nv)
        step[free] = rng.normal(0.0, 1.0, len(free)) * spread * loops.units[free]
        q = loops.tree.integrate(guess, step)
        for residual, steps in zip(residuals, (POINT_STEPS, STEPS), strict=True):
            q, size = _descended(loops, q, free, residual, steps)
        if size < CLOSE:
            q = loops.polish(q, free)
            size = loops.closure_residual(q)
            if size <= CLOSED:
                return q
        if size < least:
            best, least = q, size
    refusal = _refusal(loops, separation, best, what)
    refusal.nearest = best
    raise refusal


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
        step = -np.linalg.solve(J.T @ J + damping * np.eye(len(free)), J.T @ r)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        dv = np.zeros(loops.nv)
        dv[free] = step * units
        trial = loops.tree.integrate(q, dv)
        r_trial, J_trial = residual(trial)
        if r_trial @ r_trial < cost:
            q, r, J, cost = trial, r_trial, J_trial[:, free] * units, float(r_trial @ r_trial)
            damping = max(0.3 * damping, 1e-14)
        else:
            damping = min(4.0 * damping, 1e3)
        history.append(cost)
        stalled = len(history) > PATIENCE and cost > STALLED * history[-PATIENCE]
        if cost < CLOSE**2 * 1e-4 or (stalled and damping < 1e2) or damping >= 1e3:
            break
    return q, float(np.abs(r).max(initial=0.0))


class _Separation:
    """How far the loops are open, and how that changes with v; dimensionless rows."""

    def __init__(self, loops: ClosedLoops) -> None:
        self._loops, tree = loops, loops.tree
        count = len(loops.loops)
        model = tree.model
        frames = [model.frames[i] for i in range(model.nframes - 2 * count, model.nframes)]
        self._carried = np.zeros((2 * count, loops.nv))
        for point, frame in enumerate(frames):
            self._carried[point, support(model, int(frame.parentJoint))] = 1.0
        layout = rows_of(loops.loops)
        used = loops.implicit.rows.tolist()
        self._beyond = np.flatnonzero(loops.implicit.rows >= len(layout))
        """Rows of φ that belong to couplings."""
        self._in_points: list[int] = [int(row) for row in self._beyond]
        """Rows of φ that count as they are while points are closed, and later too."""
        self._in_turns: list[int] = []
        """Those that count as they are later only."""
        for at, full in enumerate(used[: len(used) - len(self._beyond)]):
            closure = loops.loops[layout[full].closure]
            if layout[full].axis == ROTATION:
                if not _turns(closure):
                    self._in_turns.append(at)
            elif not closure.holds:
                self._in_points.append(at)

    def points(self, q: Array) -> tuple[Array, Array]:
        """p₁ − p₂ of loops that hold their points together, else their position rows; the couplings."""
        loops = self._loops
        phi, K = loops.phi(q), loops.K(q)
        tree, n = loops.tree, len(loops.loops)
        rows, slopes = [], []
        for i in (i for i in range(n) if loops.loops[i].holds):
            rows.append((tree.frame_p[i] - tree.frame_p[n + i]) / loops.length)
            slopes.append((self._velocity(i) - self._velocity(n + i)) / loops.length)
        scale = loops.row_scale[self._in_points]
        return (
            np.concatenate([*rows, phi[self._in_points] / scale]),
            np.vstack([*slopes, K[self._in_points] / scale[:, None]]),
        )

    def everything(self, q: Array) -> tuple[Array, Array]:
        """The same and the rotations."""
        points, by_v = self.points(q)
        rows, slopes = [points], [by_v]
        tree, n = self._loops.tree, len(self._loops.loops)
        if self._in_turns:
            rows.append(self._loops.phi(q)[self._in_turns])
            slopes.append(self._loops.K(q)[self._in_turns])
        for i, closure in enumerate(self._loops.loops):
            R1, R2 = tree.frame_R[i], tree.frame_R[n + i]
            if closure.rotation_terms() == WELDED:
                turn = R1.T @ R2
                rows.append(pin.log3(turn))
                slopes.append(pin.Jlog3(turn) @ R2.T @ (self._turning(n + i) - self._turning(i)))
            elif isinstance(closure, RevoluteClosure):
                axis = np.array(closure.across()[0])
                a1, a2 = R1 @ axis, R2 @ axis
                rows.append(a1 - a2)
                slopes.append(-pin.skew(a1) @ self._turning(i) + pin.skew(a2) @ self._turning(n + i))
        return np.concatenate(rows), np.vstack(slopes)

    def sizes(self, q: Array) -> list[tuple[str, float, str]]:
        """What is left of each loop and coupling: its name, its size, its unit."""
        phi = self._loops.phi(q)
        found = []
        tree, n = self._loops.tree, len(self._loops.loops)
        for i, closure in enumerate(self._loops.loops):
            label = f"{closure.frame1} – {closure.frame2}"
            if closure.holds:
                found.append((label, float(np.abs(tree.frame_p[i] - tree.frame_p[n + i]).max()), "m"))
            if not _turns(closure):
                continue
            turn = tree.frame_R[i].T @ tree.frame_R[n + i]
            angle = float(np.linalg.norm(pin.log3(turn)))
            if isinstance(closure, RevoluteClosure):
                axis = np.array(closure.across()[0])
                angle = float(np.arccos(np.clip(axis @ turn @ axis, -1.0, 1.0)))
            found.append((label, angle, "rad"))
        for row in (*self._in_points, *self._in_turns):
            unit = "m" if self._loops.implicit.is_length[row] else "rad"
            found.append((self._loops.implicit.labels[row], float(abs(phi[row])), unit))
        return found

    def _velocity(self, point: int) -> Array:
        """∂p/∂v of a followed point, (3, nv), world axes."""
        J = self._loops.tree.J
        moved: Array = J[:, :3] + J[:, 3:] @ skew(self._loops.tree.frame_p[point])
        return np.asarray(moved.T * self._carried[point])

    def _turning(self, point: int) -> Array:
        """∂ω/∂v of a followed point's body, (3, nv), world axes."""
        return np.asarray(self._loops.tree.J[:, 3:].T * self._carried[point])


def _turns(closure: Closure) -> bool:
    """Whether its rotation has a residual of its own here; rows of φ serve else."""
    return closure.rotation_terms() == WELDED or isinstance(closure, RevoluteClosure)


def _aligned(loops: ClosedLoops, q: Array) -> bool:
    try:
        loops.require_proper(q)
    except ClosureError:
        return False
    return True


def _moved_that_way(loops: ClosedLoops, q: Array) -> float:
    """How much of what φ is at q the joints change, in any configuration; dimensionless."""
    way = loops.phi(q) / loops.row_scale
    way /= max(float(np.linalg.norm(way)), 1e-300)
    way /= loops.row_scale
    places = [q, *loops.generic_configurations()]
    return max(float(np.abs(way @ loops.K(p) * loops.units).max()) for p in places)


def _refusal(loops: ClosedLoops, separation: _Separation, q: Array, what: str) -> ClosureError:
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
