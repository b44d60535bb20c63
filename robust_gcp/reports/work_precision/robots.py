"""Robots without a closed form: all their points in space, against Pinocchio's constrained dynamics.

The first formulation has no joints, no angles and no rotations: rods and point masses between points
X (N, 3), whose mass matrix is constant, and products of distances that stay constant. The second is
`pin.constraintDynamics` on the joints. Both are integrated by DOP853, on motions that meet no singular
configuration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ... import JointSpring, Mechanism, load
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..contender import Scene
from ..peers.parts import rigid_constraints
from . import references
from .reduced import GRAVITY, Reduced
from .references import SLOW_CAP, SLOW_STEPS, Motion, Reference, times_of

DURATION = 1.0
"""s"""


class Spot:
    """A place that moves with the points: weights @ X + offset; spots are added, subtracted and scaled."""

    def __init__(self, weights: Array, offset: Array) -> None:
        self.weights, self.offset = weights, offset

    def __add__(self, other: Spot) -> Spot:
        return Spot(self.weights + other.weights, self.offset + other.offset)

    def __sub__(self, other: Spot) -> Spot:
        return self + (-1.0) * other

    def __rmul__(self, scale: float) -> Spot:
        return Spot(scale * self.weights, scale * self.offset)

    def place_at(self, X: Array) -> Array:
        """Where it is, (3,); of velocities, `weights @ V`."""
        return self.weights @ X + self.offset


@dataclass
class Points:
    """Rods and masses between spots, and pairs of differences of spots whose product stays as it is."""

    count: int
    rods: list[tuple[float, Spot, Spot]]  # mass, kg, evenly spread from one spot to the other
    masses: list[tuple[float, Spot]]  # kg
    constant: list[tuple[Spot, Spot]]  # of two differences (a, b), whose a · b does not change
    # (X) -> (N, 3): what the springs pull with, N
    pull: Callable[[Array], Array]
    markers: dict[str, Spot]  # frames of the mechanism, and where they are

    def spots(self) -> list[Spot]:
        """The points themselves."""
        return [Spot(row, np.zeros(3)) for row in np.eye(self.count)]

    def motion(self, X: Array, V: Array, read: Callable[[Array], tuple[Array, Array]]) -> Reduced:
        """ẍ of M ẍ = F + Kᵀ λ, K ẍ = −K̇ ẋ."""
        n, c = 3 * self.count, len(self.constant)
        inertia, weight = np.zeros((self.count, self.count)), np.zeros(self.count)
        for mass, a, b in self.rods:
            ends = np.array([a.weights, b.weights])
            inertia += mass / 6.0 * ends.T @ np.array([[2.0, 1.0], [1.0, 2.0]]) @ ends
            weight += 0.5 * mass * (a.weights + b.weights)
        for mass, spot in self.masses:
            inertia += mass * np.outer(spot.weights, spot.weights)
            weight += mass * spot.weights
        matrix, right = np.zeros((n + c, n + c)), np.zeros(n + c)
        matrix[:n, :n] = np.kron(inertia, np.eye(3))
        down = np.outer(weight, [0.0, 0.0, -GRAVITY])

        def rate(t: float, x: Array) -> Array:
            X, V = x.reshape(2, self.count, 3)
            right[:n] = (down + self.pull(X)).ravel()
            for i, (a, b) in enumerate(self.constant):
                row = np.outer(a.weights, b.place_at(X)) + np.outer(b.weights, a.place_at(X))
                matrix[n + i, :n] = matrix[:n, n + i] = row.ravel()
                right[n + i] = -2.0 * (a.weights @ V) @ (b.weights @ V)
            return np.concatenate([V.ravel(), np.linalg.solve(matrix, right)[:n]])

        return Reduced(np.concatenate([X.ravel(), V.ravel()]), rate, read)


class Reader:
    """Joints from the places of frames: Pinocchio's forward kinematics, inverted by Gauss and Newton."""

    def __init__(self, mechanism: Mechanism, points: Points) -> None:
        self._model, self._data = mechanism.own_model, mechanism.own_model.createData()
        self._frames = [self._model.getFrameId(name) for name in points.markers]
        self._spots, self._q, self._count = list(points.markers.values()), mechanism.home, points.count

    def places(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Of the frames, and their velocities."""
        pin.forwardKinematics(self._model, self._data, q, v)
        pin.updateFramePlacements(self._model, self._data)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        moving = [pin.getFrameVelocity(self._model, self._data, f, axes).linear for f in self._frames]
        return np.array([self._data.oMf[f].translation for f in self._frames]), np.array(moving)

    def points(self, q: Array, v: Array) -> tuple[Array, Array]:
        """X and V of the points that are markers or follow from them, by least squares."""
        weights = np.array([spot.weights for spot in self._spots])
        found, moving = self.places(q, v)
        offsets = np.array([spot.offset for spot in self._spots])
        solve = np.linalg.pinv(weights)
        return solve @ (found - offsets), solve @ moving

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """q and v of the points' x = (X, V), from the last ones."""
        X, V = x.reshape(2, self._count, 3)
        wanted = np.array([spot.place_at(X) for spot in self._spots])
        for _ in range(12):
            found, _ = self.places(self._q, np.zeros(self._model.nv))
            J = self._jacobian(self._q)
            step = np.linalg.lstsq(J, (wanted - found).ravel(), rcond=None)[0]
            self._q = pin.integrate(self._model, self._q, step)
            if np.abs(step).max() < 1e-13:
                break
        moving = np.array([spot.weights @ V for spot in self._spots])
        return self._q, np.linalg.lstsq(self._jacobian(self._q), moving.ravel(), rcond=None)[0]

    def _jacobian(self, q: Array) -> Array:
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        parts = [pin.computeFrameJacobian(self._model, self._data, q, f, axes)[:3] for f in self._frames]
        return np.vstack(parts)


def constrained(mechanism: Mechanism, q0: Array, v0: Array) -> Reduced:
    """(q, v) by `pin.constraintDynamics`; quaternions by their rates, normalised when they are read."""
    model, data = mechanism.own_model, mechanism.own_model.createData()
    models, datas = rigid_constraints(mechanism)
    pin.initConstraintDynamics(model, data, models, datas)
    settings, nq = pin.ProximalSettings(1e-15, 1e-10, 20), model.nq
    free = [joint for joint in mechanism.joints if joint.kind is JointKind.FREE_FLYER]
    single = np.array([[joint.idx_q, joint.idx_v] for joint in mechanism.joints if joint.single]).T

    def read(x: Array) -> tuple[Array, Array]:
        return pin.normalize(model, x[:nq]), x[nq:]

    def rate(t: float, x: Array) -> Array:
        q, v = read(x)
        rates = np.zeros(nq)
        rates[single[0]] = v[single[1]]
        for joint in free:
            at, linear, spin = joint.idx_q, v[joint.v][:3], v[joint.v][3:]
            turn = pin.Quaternion(q[at + 3 : at + 7])
            rates[at : at + 3] = turn.matrix() @ linear
            rates[at + 3 : at + 7] = 0.5 * (turn * pin.Quaternion(np.append(spin, 0.0))).coeffs()
        tau = np.zeros(model.nv) if mechanism.applied is None else mechanism.applied.tau(q, v)
        a = pin.constraintDynamics(model, data, q, v, tau, models, datas, settings)
        return np.concatenate([rates, a])

    return Reduced(np.concatenate([q0, v0]), rate, read)


def _motion(name: str, title: str, mechanism: Mechanism, v0: Array, points: Points) -> Motion:
    """From home, v0 (nv,)."""
    q0, read = mechanism.home, Reader(mechanism, points)
    first = points.motion(*read.points(q0, v0), read)
    scene = Scene(name, mechanism, q0, v0, times_of(DURATION))
    what = "points with a constant mass matrix", "pin.constraintDynamics"

    def solve() -> Reference:
        return references.from_two(scene.times, first, constrained(mechanism, q0, v0), what)

    return Motion(scene, title, None, solve, SLOW_STEPS, SLOW_CAP)


def _spring(mechanism: Mechanism, joint: str) -> tuple[float, float]:
    found = next(f for f in mechanism.forces if isinstance(f, JointSpring) and f.joint == joint)
    return found.stiffness, found.rest


# --------------------------------------------------------------------------- the two robots


def delta() -> Motion:
    """Elbows 0 … 2 and corners of the platform 3 … 5; numbers of models/delta typed once more."""
    base, corner, half = 0.2, 0.08, 0.04
    mechanism = load("delta")
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    out = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    along = np.stack([-np.sin(angles), np.cos(angles), np.zeros(3)], axis=1)
    up, none = np.array([0.0, 0.0, 1.0]), np.zeros(6)
    springs = [_spring(mechanism, f"arm{i + 1}") for i in range(3)]

    def pull(X: Array) -> Array:
        force = np.zeros((6, 3))
        for i, (stiffness, rest) in enumerate(springs):
            reach = X[i] - base * out[i]
            turn = np.arctan2(-reach @ up, reach @ out[i])  # about the tangent, down
            force[i] = -stiffness * (turn - rest) * np.cross(along[i], reach) / (reach @ reach)
        return force

    made = Points(6, [], [], [], pull, {})
    spots = made.spots()
    for i in range(3):
        hip, elbow, plate = Spot(none, base * out[i]), spots[i], spots[3 + i]
        made.rods.append((0.4, hip, elbow))
        made.masses.append((0.1, plate))
        edge = spots[3 + (i + 2) % 3] - spots[3 + (i + 1) % 3]  # against the tangent at the corner
        made.constant += [(elbow - hip, elbow - hip), (elbow - hip, Spot(none, along[i])), (edge, edge)]
        for side, shift in (("a", half), ("b", -half)):
            top = elbow + Spot(none, shift * along[i])
            tip = plate + (-shift / (np.sqrt(3.0) * corner)) * edge
            made.rods.append((0.06, top, tip))
            made.constant.append((top - tip, top - tip))
            made.markers |= {f"rod{i + 1}{side}_tip": tip, f"plate{i + 1}{side}": tip}
            made.markers[f"rod{i + 1}{side}_x"] = top
    assert mechanism.recommended.v0 is not None
    title = "delta robot (m = 3)"
    return _motion("delta", title, mechanism, np.asarray(mechanism.recommended.v0), made)


def walker() -> Motion:
    """Hips 0 … 2, knees 3 … 6, feet 7 and 8; numbers of models/walker typed once more."""
    mechanism, names = load("walker", base="free"), ("left_front", "left_rear", "right_front", "right_rear")
    springs = [_spring(mechanism, f"hip_{name}") for name in names]
    made = Points(9, [], [], [], lambda X: np.zeros((9, 3)), {})
    spots = made.spots()
    first, behind, right = spots[:3]
    hips = [first, behind, right, behind + right - first]
    ahead, across = first - behind, first - right

    def pull(X: Array) -> Array:
        force = np.zeros((9, 3))
        forward, left = ahead.place_at(X), across.place_at(X)
        axis = left / np.linalg.norm(left)
        up = np.cross(forward, axis)
        for i, (stiffness, rest) in enumerate(springs):
            leg = (spots[3 + i] - hips[i]).place_at(X)
            torque = -stiffness * (np.arctan2(-leg @ forward, -leg @ up) - rest)
            # a couple at the leg, and the opposite one at the trunk
            pair = torque * np.cross(axis, leg) / (leg @ leg)
            force += np.outer((spots[3 + i] - hips[i]).weights, pair)
            force -= np.outer(ahead.weights, torque * np.cross(axis, forward) / (forward @ forward))
        return force

    made.pull = pull
    made.masses += [(1.0, hip) for hip in hips]
    made.constant += [(ahead, ahead), (across, across), (ahead, across)]
    for i, name in enumerate(names):
        knee, foot = spots[3 + i], spots[7 + i // 2]
        made.rods += [(0.3, hips[i], knee), (0.2, knee, foot)]
        made.constant += [(knee - hips[i],) * 2, (knee - hips[i], across), (foot - knee,) * 2]
        made.markers |= {f"hip_{name}": hips[i], f"upper_{name}_tip": knee, f"lower_{name}_tip": foot}
    made.constant += [(spots[7 + i] - hips[2 * i], across) for i in range(2)]
    v0 = mechanism.lift(mechanism.home, WALKER_SPEED)
    return _motion("walker", "walker, floating (m = 10)", mechanism, v0, made)


WALKER_SPEED: Sequence[float] = (1.5, -0.5, -1.0, 1.0, 0.4, -0.2, 1.0, 0.8, -0.6, 0.5)
"""Of the hips, rad/s, and of the trunk, m/s and rad/s in its own axes."""
