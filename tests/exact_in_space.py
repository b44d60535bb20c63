"""Linkages in space in seventy decimal digits: see `exact`."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pinocchio as pin

from .exact import ZERO, Exact, Matrix, Vector, turned

AXES = {"X": 0, "Y": 1, "Z": 2}


class ExactInSpace(Exact):
    """A mechanism's reduced equations in `DIGITS` digits.

    Parameters
    ----------
    mech : Mechanism
        Of hinges and slides about and along its joints' axes x, y or z, with point closures alone.
    """

    def _read(self, model: pin.Model, frames: list[tuple[int, pin.SE3]]) -> None:
        assert all(name[0] in "RP" and name[1:] in AXES for name in self.slides), self.slides
        self.kinds = [(name[0], AXES[name[1]]) for name in self.slides]
        placements = [model.jointPlacements[j] for j in range(1, model.njoints)]
        self.frames = [(_exactly(p.rotation), _exactly(p.translation)) for p in placements]
        self.bodies = [
            (Decimal(b.mass), _exactly(b.lever), _exactly(b.inertia)) for b in list(model.inertias)[1:]
        ]
        self.ends = [(joint - 1, _exactly(place.translation)) for joint, place in frames]
        self.g = _exactly(model.gravity.linear)

    def poses(self, q: Vector) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Rotation, origin and joint axis of each body, in the world."""
        found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for (kind, axis), parent, (R, p), value in zip(self.kinds, self.parent, self.frames, q, strict=True):
            above, origin = found[parent][:2] if parent >= 0 else (_exactly(np.eye(3)), _exactly(np.zeros(3)))
            origin, here = origin + above @ p, above @ R
            way = here[:, axis]
            if kind == "P":
                origin = origin + way * value
            else:
                c, s = turned(value)
                one, two = (axis + 1) % 3, (axis + 2) % 3
                own = _exactly(np.eye(3))
                own[one, one], own[two, two], own[two, one], own[one, two] = c, c, s, -s
                here = here @ own
            found.append((here, origin, way))
        return found

    def _point(self, poses: list[tuple[np.ndarray, ...]], body: int, at: np.ndarray) -> np.ndarray:
        """A point in the world, and what it and its body turn by with each joint: (1 + nv, 2, 3)."""
        found = np.full((1 + self.nv, 2, 3), ZERO)
        found[0, 0] = at if body < 0 else poses[body][1] + poses[body][0] @ at
        while body >= 0:
            _, origin, way = poses[body]
            if self.kinds[body][0] == "P":
                found[1 + body, 0] = way
            else:
                found[1 + body] = _cross(way, found[0, 0] - origin), way
            body = self.parent[body]
        return found

    def loops(self, q: Vector) -> tuple[Vector, Matrix]:
        """φ and K."""
        poses, half = self.poses(q), len(self.ends) // 2
        apart = [
            (self._point(poses, *one) - self._point(poses, *two))[:, 0]
            for one, two in zip(self.ends[:half], self.ends[half:], strict=True)
        ]
        rows = np.concatenate(apart, axis=1)
        return rows[0].tolist(), rows[1:].T.tolist()

    def inertia(self, q: Vector) -> tuple[Matrix, Decimal]:
        """M and the potential energy."""
        poses, M, energy = self.poses(q), np.full((self.nv, self.nv), ZERO), ZERO
        for body, (mass, centre, about) in enumerate(self.bodies):
            told, turn = self._point(poses, body, centre), poses[body][0]
            energy -= mass * (self.g @ told[0, 0])
            moving, turning = told[1:, 0], told[1:, 1]
            M = M + mass * (moving @ moving.T) + turning @ (turn @ about @ turn.T) @ turning.T
        return M.tolist(), energy


def _exactly(values: np.ndarray) -> np.ndarray:
    return np.vectorize(lambda x: Decimal(float(x)), otypes=[object])(values)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
