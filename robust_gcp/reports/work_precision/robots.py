"""Robots without a closed form: all their points in space, against Pinocchio's constrained dynamics.

The first formulation has no joints, no angles and no rotations: rods and point masses between points
X (N, 3), whose mass matrix is constant, and products of distances that stay constant. The second is
`pin.constraintDynamics` on the joints. Both are integrated by DOP853, on motions that meet no singular
configuration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from ... import JointSpring, Mechanism, load
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..contender import Scene
from ..peers.parts import rigid_constraints
from .reduced import GRAVITY, Reduced
from .references import SLOW_CAP, SLOW_STEPS, Motion, of_two, times_of

DURATION = 1.0
"""s"""


Spot = Array
"""A place that moves with the points: weights of the points and of the ends of x, y and z, (N + 3,)."""


def placed(X: Array) -> Array:
    """Points and then x, y and z, (N + 3, 3), so that `spot @ placed(X)` is where a spot is."""
    return np.vstack([X, np.eye(3)])


@dataclass
class Points:
    """Rods and masses between spots, and pairs of differences of spots whose product stays as it is."""

    count: int
    # (X) -> (N, 3): what the springs pull with, N
    pull: Callable[[Array], Array]
    rods: list[tuple[float, Spot, Spot]] = field(default_factory=list)  # kg, evenly spread between both
    masses: list[tuple[float, Spot]] = field(default_factory=list)  # kg
    constant: list[tuple[Spot, Spot]] = field(
        default_factory=list
    )  # differences (a, b); a · b does not change
    markers: dict[str, Spot] = field(default_factory=dict)  # frames of the mechanism, and where they are

    def motion(self, X: Array, V: Array, read: Callable[[Array], tuple[Array, Array]]) -> Reduced:
        """ẍ of M ẍ = F + Kᵀ λ, K ẍ = −K̇ ẋ."""
        N, n, c = self.count, 3 * self.count, len(self.constant)
        inertia, weight = np.zeros((N, N)), np.zeros(N)
        for mass, *spots in self.rods:
            ends = np.array(spots)[:, :N]
            inertia += mass / 6.0 * ends.T @ np.array([[2.0, 1.0], [1.0, 2.0]]) @ ends
            weight += 0.5 * mass * ends.sum(axis=0)
        for mass, spot in self.masses:
            inertia += mass * np.outer(spot[:N], spot[:N])
            weight += mass * spot[:N]
        matrix, right = np.zeros((n + c, n + c)), np.zeros(n + c)
        matrix[:n, :n] = np.kron(inertia, np.eye(3))
        down = np.outer(weight, [0.0, 0.0, -GRAVITY])

        def rate(t: float, x: Array) -> Array:
            X, V = x.reshape(2, N, 3)
            right[:n] = (down + self.pull(X)).ravel()
            places = placed(X)
            for i, (a, b) in enumerate(self.constant):
                row = np.outer(a[:N], b @ places) + np.outer(b[:N], a @ places)
                matrix[n + i, :n] = matrix[:n, n + i] = row.ravel()
                right[n + i] = -2.0 * (a[:N] @ V) @ (b[:N] @ V)
            return np.concatenate([V.ravel(), np.linalg.solve(matrix, right)[:n]])

        return Reduced(np.concatenate([X.ravel(), V.ravel()]), rate, read)


class Reader:
    """Joints from the places of frames: Pinocchio's forward kinematics, inverted by Gauss and Newton."""

    def __init__(self, mechanism: Mechanism, points: Points) -> None:
        self._model, self._data = mechanism.own_model, mechanism.own_model.createData()
        self._frames = [self._model.getFrameId(name) for name in points.markers]
        self._spots, self._q = np.array(list(points.markers.values())), mechanism.home
        self._weights = self._spots[:, : points.count]

    def places(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Of the frames, and their velocities."""
        pin.forwardKinematics(self._model, self._data, q, v)
        pin.updateFramePlacements(self._model, self._data)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        moving = [pin.getFrameVelocity(self._model, self._data, f, axes).linear for f in self._frames]
        return np.array([self._data.oMf[f].translation for f in self._frames]), np.array(moving)

    def points(self, q: Array, v: Array) -> tuple[Array, Array]:
        """X and V of the points that are markers or follow from them, by least squares."""
        found, moving = self.places(q, v)
        solve = np.linalg.pinv(self._weights)
        return solve @ (found - self._spots[:, -3:]), solve @ moving

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """q and v of the points' x = (X, V), from the last ones."""
        X, V = x.reshape(2, -1, 3)
        wanted = self._spots @ placed(X)
        for _ in range(12):
            found, _ = self.places(self._q, np.zeros(self._model.nv))
            J = self._jacobian(self._q)
            step = np.linalg.lstsq(J, (wanted - found).ravel(), rcond=None)[0]
            self._q = pin.integrate(self._model, self._q, step)
            if np.abs(step).max() < 1e-13:
                break
        moving = (self._weights @ V).ravel()
        return self._q, np.linalg.lstsq(self._jacobian(self._q), moving, rcond=None)[0]

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
    second = constrained(mechanism, q0, v0)
    return of_two(title, scene, first, second, what, None, steps=SLOW_STEPS, cap=SLOW_CAP)


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
    up = np.array([0.0, 0.0, 1.0])
    springs = [_spring(mechanism, f"arm{i + 1}") for i in range(3)]

    def pull(X: Array) -> Array:
        force = np.zeros((6, 3))
        for i, (stiffness, rest) in enumerate(springs):
            reach = X[i] - base * out[i]
            turn = np.arctan2(-reach @ up, reach @ out[i])  # about the tangent, down
            force[i] = -stiffness * (turn - rest) * np.cross(along[i], reach) / (reach @ reach)
        return force

    made, spots = Points(6, pull), np.eye(9)
    for i in range(3):
        tangent, elbow, plate = along[i] @ spots[6:], spots[i], spots[3 + i]
        hip = base * out[i] @ spots[6:]
        made.rods.append((0.4, hip, elbow))
        made.masses.append((0.1, plate))
        edge = spots[3 + (i + 2) % 3] - spots[3 + (i + 1) % 3]  # against the tangent at the corner
        made.constant += [(elbow - hip, elbow - hip), (elbow - hip, tangent), (edge, edge)]
        for side, shift in (("a", half), ("b", -half)):
            top = elbow + shift * tangent
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
    spots = np.eye(12)
    first, behind, right = spots[:3]
    hips = [first, behind, right, behind + right - first]
    ahead, across = first - behind, first - right

    def pull(X: Array) -> Array:
        places, force = placed(X), np.zeros((9, 3))
        forward, left = ahead @ places, across @ places
        axis = left / np.linalg.norm(left)
        up = np.cross(forward, axis)
        for i, (stiffness, rest) in enumerate(springs):
            below = spots[3 + i] - hips[i]
            leg = below @ places
            torque = -stiffness * (np.arctan2(-leg @ forward, -leg @ up) - rest)
            # a couple at the leg, and the opposite one at the trunk
            pair = torque * np.cross(axis, leg) / (leg @ leg)
            force += np.outer(below[:9], pair)
            force -= np.outer(ahead[:9], torque * np.cross(axis, forward) / (forward @ forward))
        return force

    made = Points(9, pull)
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
