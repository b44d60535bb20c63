"""What every picture of a mechanism shows: the points of its bodies, where joints hold them, its plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from ..mechanism.constraint.closures import closure_frames
from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array

PARALLEL = 1e-6
"""Sine of the angle between axes that still counts as parallel, and relative size of no distance."""

FLAT = 1e-4
"""Relative size of a distance across which a body is a stick or a plate."""

LYING = 0.7
"""Cosine of the angle between a plane's normal and up from which on the plane is seen as a table."""


@dataclass(frozen=True)
class Seat:
    """A joint that keeps its body at its place on the parent, or slides it from there.

    Attributes
    ----------
    joint, parent : int
        Bodies are numbered as joints; 0 is the ground.
    place : ndarray (3,)
        Of the joint on the parent, m.
    point : int
        Number of the joint's own origin.
    pinned : bool
        Whether it stays there.
    """

    joint: int
    parent: int
    place: Array
    point: int
    pinned: bool


@dataclass
class Skeleton:
    """Points fixed to bodies, and what holds the bodies together.

    Attributes
    ----------
    size : float
        Of the mechanism, m.
    points : list of (int, ndarray (3,))
        Body, and place in its frame, m.
    seats : list of Seat
        All joints but those that leave their bodies free to go anywhere.
    cuts : list of (int, int, bool)
        The two points of each closure, and whether it holds them together; else the first slides from
        the second.
    """

    size: float
    points: list[tuple[int, Array]] = field(default_factory=list)
    seats: list[Seat] = field(default_factory=list)
    cuts: list[tuple[int, int, bool]] = field(default_factory=list)

    def add(self, body: int, place: Array) -> int:
        """The number of that point; one that is already there serves again."""
        for i, (other, there) in enumerate(self.points):
            if other == body and np.linalg.norm(there - place) <= PARALLEL * self.size:
                return i
        self.points.append((body, np.array(place, dtype=float)))
        return len(self.points) - 1

    def positions(self, R: Array, p: Array) -> Array:
        """World positions (n, points, 3), m, from the joints' `placements`."""
        body = [b for b, _ in self.points]
        place = np.array([at for _, at in self.points]).reshape(-1, 3)
        moved: Array = p[:, body] + np.einsum("npij,pj->npi", R[:, body], place)
        return moved

    def fit(self, mechanism: ClosedLoops, R: Array, p: Array) -> None:
        """Add the points and seats of a mechanism that moves through these `placements`.

        A joint that moves away from its place on the parent slides if it has one degree of freedom, else
        it leaves its body free.
        """
        for joint in mechanism.joints:
            i = joint.index
            parent = int(mechanism.own_model.parents[i])
            place = mechanism.own_model.jointPlacements[i].translation
            away = np.linalg.norm(p[:, parent] + R[:, parent] @ place - p[:, i], axis=1).max()
            pinned = bool(away <= PARALLEL * self.size)
            if pinned or joint.nv == 1:
                self.seats.append(Seat(i, parent, place, self.add(i, np.zeros(3)), pinned))
                if pinned or parent:  # what slides on the ground leaves no point there
                    self.add(parent, place)
        ends = closure_frames(mechanism.own_model, mechanism.loops)
        points = [self.add(joint, at.translation) for joint, at in ends]
        half = len(points) // 2
        held = [closure.holds for closure in mechanism.loops]
        self.cuts += zip(points[:half], points[half:], held, strict=True)

    def reach(self, model: pin.Model) -> None:
        """Give a body that carries no joint an end: its frames, or its centre of mass."""
        kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
        for joint in range(1, model.njoints):
            if len(model.children[joint]) > 0:
                continue
            for frame in model.frames:
                if frame.parentJoint == joint and frame.type in kinds:
                    self.add(joint, frame.placement.translation)
            if sum(body == joint for body, _ in self.points) < 2:
                self.add(joint, model.inertias[joint].lever)


def outline(points: Array, size: float) -> tuple[list[int], list[tuple[int, int]]]:
    """What a body looks like: a stick, a plate (the flat hull of its points), or the edges of a solid one.

    Parameters
    ----------
    points : ndarray (n, 2) or (n, 3)
        At least two, m.
    size : float
        Of the mechanism, m.

    Returns
    -------
    rim : list of int
        Corners of a plate, in order; else none.
    edges : list of (int, int)
        Points to join.
    """
    centred = points - points.mean(axis=0)
    _, spread, directions = np.linalg.svd(centred)
    rank = int(np.sum(spread > FLAT * size))
    if rank < 2:
        along = centred @ directions[0]
        return [], [(int(np.argmin(along)), int(np.argmax(along)))]
    from scipy.spatial import ConvexHull

    hull = ConvexHull(centred @ directions[:rank].T)
    if rank == 2:
        rim = [int(i) for i in hull.vertices]
        return rim, list(zip(rim, [*rim[1:], rim[0]], strict=True))
    corners = [sorted(int(i) for i in simplex) for simplex in hull.simplices]
    return [], sorted({pair for a, b, c in corners for pair in ((a, b), (b, c), (a, c))})


def placements(mechanism: ClosedLoops, q: Array) -> tuple[Array, Array]:
    """World placements of all joints, R (n, njoints, 3, 3) and p (n, njoints, 3), at q (n, nq)."""
    tree = mechanism.tree
    R, p = np.empty((len(q), *tree.R.shape)), np.empty((len(q), *tree.p.shape))
    for i, configuration in enumerate(q):
        tree.jacobians(configuration)
        R[i], p[i] = tree.R, tree.p + mechanism.standpoint
    p[:, 0] = 0.0  # the ground
    return R, p


def plane_normal(mechanism: ClosedLoops) -> Array | None:
    """The common axis of a planar mechanism, (3,), or None: turning joints parallel, sliding ones normal."""
    tree = mechanism.tree
    tree.jacobians(mechanism.generic_configurations(1)[0])
    turning = tree.J[tree.rotates, 3:]
    if len(turning) == 0:
        return None
    normal: Array = turning[0] / np.linalg.norm(turning[0])
    carriers = [joint.index for joint in mechanism.joints for _ in range(joint.nv)]
    rising = tree.J[:, :3] + np.cross(tree.J[:, 3:], tree.p[carriers])  # at the joints' origins
    leaves = np.abs(np.cross(turning, normal)).max(), np.abs(rising @ normal).max(initial=0.0)
    return normal if max(leaves) <= PARALLEL else None


def on_page(normal: Array, gravity: Array) -> tuple[Array, Array]:
    """Directions to the right and up, (3,) each, that show a plane face-on.

    Up is against gravity (or z), and y or z where the plane lies; the largest component of what points
    to the right is positive.
    """
    up = upward(gravity)
    if abs(normal @ up) > LYING:  # a plane that lies: y is up on the page
        up = np.eye(3)[1] if abs(normal[1]) < LYING else np.eye(3)[2]
    up = up - normal * (normal @ up)
    up /= np.linalg.norm(up)
    right: Array = np.cross(up, normal)
    return right * np.sign(right[np.argmax(np.abs(right))]), up


def upward(gravity: Array) -> Array:
    """Against gravity, or z without any; a unit vector (3,)."""
    strength = np.linalg.norm(gravity)
    return -gravity / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])
