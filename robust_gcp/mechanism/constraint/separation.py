"""How far loops are open, from afar too: points apart, logarithms of rotations, chords of axes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..loops import ClosedLoops
from ..tree.joints import carrying
from ..tree.tree import Array
from ..tree.vectors import skew
from .closures import WELDED, Closure, RevoluteClosure
from .rows import ROTATION, rows_of


class Separation:
    """How far the loops are open, and how that changes with v; dimensionless rows."""

    def __init__(self, loops: ClosedLoops) -> None:
        self._loops, tree = loops, loops.tree
        count = len(loops.loops)
        model = tree.model
        frames = [model.frames[i] for i in range(model.nframes - 2 * count, model.nframes)]
        joints = [int(frame.parentJoint) for frame in frames]
        self._carried = np.array([carrying(model, joint) for joint in joints]).reshape(2 * count, loops.nv)
        both = (
            self._carried[:count] * self._carried[count:]
        )  # what carries the loop as a whole closes nothing
        self._carried -= np.vstack([both, both])
        layout = rows_of(loops.loops)
        used = loops.implicit.rows.tolist()
        self._beyond = np.flatnonzero(loops.implicit.rows >= len(layout))
        """Rows of φ that belong to couplings."""
        self.in_points: list[int] = [int(row) for row in self._beyond]
        """Rows of φ that count as they are while points are closed, and later too."""
        self.in_turns: list[int] = []
        """Those that count as they are later only."""
        for at, full in enumerate(used[: len(used) - len(self._beyond)]):
            closure = loops.loops[layout[full].closure]
            if layout[full].axis == ROTATION:
                if not _turns(closure):
                    self.in_turns.append(at)
            elif not closure.holds:
                self.in_points.append(at)

    def points(self, q: Array) -> tuple[Array, Array]:
        """p₁ − p₂ of loops that hold their points together, else their position rows; the couplings."""
        loops = self._loops
        phi, K = loops.phi(q), loops.K(q)
        tree, n = loops.tree, len(loops.loops)
        rows, slopes = [], []
        for i in (i for i in range(n) if loops.loops[i].holds):
            rows.append((tree.frame_p[i] - tree.frame_p[n + i]) / loops.length)
            slopes.append((self._velocity(i) - self._velocity(n + i)) / loops.length)
        scale = loops.row_scale[self.in_points]
        return (
            np.concatenate([*rows, phi[self.in_points] / scale]),
            np.vstack([*slopes, K[self.in_points] / scale[:, None]]),
        )

    def everything(self, q: Array) -> tuple[Array, Array]:
        """The same and the rotations."""
        points, by_v = self.points(q)
        rows, slopes = [points], [by_v]
        tree, n = self._loops.tree, len(self._loops.loops)
        if self.in_turns:
            rows.append(self._loops.phi(q)[self.in_turns])
            slopes.append(self._loops.K(q)[self.in_turns])
        for i, closure in enumerate(self._loops.loops):
            R1, R2 = tree.frame_R[i], tree.frame_R[n + i]
            if closure.rotation_terms() == WELDED:
                turn = R1.T @ R2
                # zero at no rotation alone; rows of φ are zero at half a turn too
                rows.append(pin.log3(turn))
                slopes.append(pin.Jlog3(turn) @ R2.T @ (self._turning(n + i) - self._turning(i)))
            elif isinstance(closure, RevoluteClosure):
                axis = np.array(closure.across()[0])
                a1, a2 = R1 @ axis, R2 @ axis
                # longest, 2, where they point against each other, where rows of φ are zero
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
                angle = float(np.arccos(np.clip(axis @ turn @ axis, -1.0, 1.0)))  # rounding may lead beyond 1
            found.append((label, angle, "rad"))
        for row in (*self.in_points, *self.in_turns):
            unit = "m" if self._loops.implicit.is_length[row] else "rad"
            found.append((self._loops.implicit.labels[row], float(abs(phi[row])), unit))
        return found

    def _velocity(self, point: int) -> Array:
        """∂p/∂v of a followed point, (3, nv), world axes."""
        J = self._loops.tree.J
        moved: Array = J[:, :3] + J[:, 3:] @ skew(self._loops.tree.frame_p[point])  # v + ω × p
        return np.asarray(moved.T * self._carried[point])

    def _turning(self, point: int) -> Array:
        """∂ω/∂v of a followed point's body, (3, nv), world axes."""
        return np.asarray(self._loops.tree.J[:, 3:].T * self._carried[point])


def _turns(closure: Closure) -> bool:
    """Whether its rotation has a residual of its own here; rows of φ serve else."""
    return closure.rotation_terms() == WELDED or isinstance(closure, RevoluteClosure)
