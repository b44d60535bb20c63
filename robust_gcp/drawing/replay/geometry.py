"""A mechanism as points and sticks, read from its joints and closures alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.closures import closure_frames, frame_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array

PARALLEL = 1e-6
"""Sine of the angle between axes that still counts as parallel, and relative size of no distance."""


@dataclass
class Skeleton:
    """What to draw: points fixed to bodies, and what joins them. Bodies are numbered as joints, 0 the ground.

    Attributes
    ----------
    points : list of (int, ndarray (3,))
        Body, and place in its frame, m.
    links : list of (int, int, int)
        Two points of one body, and the body.
    slides : list of (int, int, int)
        Where a telescope starts, where it ends, and the body that slides.
    rails : list of (int, int, int, int)
        Ends of a rail on the ground, the point that slides along it, and its body.
    faces : list of (list of int, int)
        Corners of a body's flat outline, and the body.
    pins : list of (int, int, bool)
        A joint's point, a second one on its axis (the same: no axis), and whether it is on the ground.
    frames : dict of int to int
        The first of three points that carry the pose of a body, see `replay_meshes`.
    trails : dict of str to int
        Points to follow, by name of frame.
    mark : int
        The point where crossings are marked.
    """

    points: list[tuple[int, Array]] = field(default_factory=list)
    links: list[tuple[int, int, int]] = field(default_factory=list)
    slides: list[tuple[int, int, int]] = field(default_factory=list)
    rails: list[tuple[int, int, int, int]] = field(default_factory=list)
    faces: list[tuple[list[int], int]] = field(default_factory=list)
    pins: list[tuple[int, int, bool]] = field(default_factory=list)
    frames: dict[int, int] = field(default_factory=dict)
    trails: dict[str, int] = field(default_factory=dict)
    mark: int = 0

    def add(self, body: int, place: Array, size: float) -> int:
        """The number of that point; one that is already there serves again."""
        for i, (other, there) in enumerate(self.points):
            if other == body and np.linalg.norm(there - place) <= PARALLEL * size:
                return i
        self.points.append((body, np.array(place, dtype=float)))
        return len(self.points) - 1

    def ends(self) -> list[int]:
        """The points that links may join: all but those that only show a joint's axis or a rail."""
        on_axes = {tip for origin, tip, _ in self.pins if tip != origin}
        on_axes |= {end for rail in self.rails for end in rail[:2]}
        return [i for i in range(len(self.points)) if i not in on_axes]

    def positions(self, R: Array, p: Array) -> Array:
        """World positions (n, points, 3), m, from the joints' `placements`."""
        body = [b for b, _ in self.points]
        place = np.array([at for _, at in self.points])
        moved: Array = p[:, body] + np.einsum("npij,pj->npi", R[:, body], place)
        return moved


def placements(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """World placements of all joints, R (n, njoints, 3, 3) and p (n, njoints, 3), at q (n, nq)."""
    tree = mechanism.tree
    R, p = np.empty((len(q), *tree.R.shape)), np.empty((len(q), *tree.p.shape))
    for i, configuration in enumerate(q):
        tree.jacobians(configuration)
        R[i], p[i] = tree.R, tree.p
    return R, p


def skeleton(mechanism: Mechanism, R: Array, p: Array, trails: Sequence[str] | None) -> Skeleton:
    """Points and sticks of a mechanism.

    A body is drawn between its joint, its children's joints, its closure frames and its trails; where
    it carries nothing further, also its other frames, or else its centre of mass. A joint that moves
    away from its place on the parent is a slide if it has one degree of freedom, else it is free.

    Parameters
    ----------
    mechanism : Mechanism
    R, p : ndarray
        Joint placements over the motion, see `placements`.
    trails : sequence of str or None
        Frames to follow; None: the first closure's.

    Raises
    ------
    ModelError
        For a trail that is no frame of the model.
    """
    model, size = mechanism.model, mechanism.length
    made = Skeleton()
    cuts = closure_frames(model, mechanism.loops)
    firsts = [made.add(joint, at.translation, size) for joint, at in cuts][: len(cuts) // 2]
    if trails is None:
        trails = [mechanism.loops[0].frame1] if mechanism.loops else []
    for name in trails:
        frame = frame_of(model, name, "trails")
        made.trails[name] = made.add(frame.parentJoint, frame.placement.translation, size)
    axes = _axes(mechanism)
    for joint in range(1, model.njoints):
        parent, at = model.parents[joint], model.jointPlacements[joint].translation
        away = np.linalg.norm(p[:, parent] + R[:, parent] @ at - p[:, joint], axis=1).max()
        pinned = away <= PARALLEL * size
        if pinned or model.joints[joint].nv == 1:
            origin = made.add(joint, np.zeros(3), size)
            if pinned or parent != 0:
                base = made.add(parent, at, size)
            if pinned:
                axis = axes.get(joint)
                tip = origin if axis is None else made.add(joint, 0.04 * size * axis, size)
                made.pins.append((origin, tip, parent == 0))
            elif parent != 0:
                made.slides.append((base, origin, joint))
            else:
                made.rails.append((*_rail(made, p[:, joint], size), origin, joint))
        _far_end(made, model, joint, size)
    made.pins += [(i, i, _on_ground(cuts, k)) for k, i in enumerate(firsts)]
    on_axes = {tip for origin, tip, _ in made.pins if tip != origin}
    for body in range(model.njoints):
        _outline(
            made, body, [i for i, (b, _) in enumerate(made.points) if b == body and i not in on_axes], size
        )
    made.mark = next(iter(made.trails.values()), firsts[0] if firsts else len(made.points) - 1)
    return made


def _rail(made: Skeleton, path: Array, size: float) -> tuple[int, int]:
    """Ends of the straight path of a point, with some rail to spare."""
    _, _, directions = np.linalg.svd(path - path[0], full_matrices=False)
    along = (path - path[0]) @ directions[0]
    spare = 0.1 * size
    low, high = (path[0] + s * directions[0] for s in (along.min() - spare, along.max() + spare))
    made.points += [(0, low), (0, high)]  # never shared: a rail is no end of a link
    return len(made.points) - 2, len(made.points) - 1


def _on_ground(cuts: Sequence[tuple[int, pin.SE3]], k: int) -> bool:
    return 0 in (cuts[k][0], cuts[k + len(cuts) // 2][0])


def _axes(mechanism: Mechanism) -> dict[int, Array]:
    """Axis of each revolute joint in its own frame."""
    tree, model = mechanism.tree, mechanism.model
    tree.jacobians(mechanism.home)
    found = {}
    for joint in range(1, model.njoints):
        turning = tree.J[model.joints[joint].idx_v, 3:]
        if model.joints[joint].nv == 1 and np.linalg.norm(turning) > 0.5:
            found[joint] = tree.R[joint].T @ turning
    return found


def _far_end(made: Skeleton, model: pin.Model, joint: int, size: float) -> None:
    """Give a body that carries no joint an end: its frames, or its centre of mass."""
    if len(model.children[joint]) > 0:
        return
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    for frame in model.frames:
        if frame.parentJoint == joint and frame.type in kinds:
            made.add(joint, frame.placement.translation, size)
    if sum(body == joint for body, _ in made.points) < 2:
        made.add(joint, model.inertias[joint].lever, size)


def _outline(made: Skeleton, body: int, ends: list[int], size: float) -> None:
    """Join a body's points: a stick, the rim of a flat hull, or the edges of a solid one."""
    if len(ends) < 2:
        return
    places = np.array([made.points[i][1] for i in ends])
    centred = places - places.mean(axis=0)
    _, spread, directions = np.linalg.svd(centred)
    rank = int(np.sum(spread > 1e-4 * size))
    if rank < 2:
        along = centred @ directions[0]
        made.links.append((ends[int(np.argmin(along))], ends[int(np.argmax(along))], body))
        return
    from scipy.spatial import ConvexHull

    hull = ConvexHull(centred @ directions[:rank].T)
    if rank == 2:
        rim = [ends[i] for i in hull.vertices]
        made.faces.append((rim, body))
        edges = {(a, b) for a, b in zip(rim, [*rim[1:], rim[0]], strict=True)}
    else:
        edges = {
            (min(ends[a], ends[b]), max(ends[a], ends[b]))
            for s in hull.simplices
            for a, b in ((s[0], s[1]), (s[1], s[2]), (s[2], s[0]))
        }
    made.links += [(a, b, body) for a, b in sorted(edges)]


def layers(made: Skeleton, positions: Array) -> list[int]:
    """A layer for each body such that bodies that share a joint lie in different ones.

    Bodies of a planar linkage pass over each other; a drawing shows them so. Greedy colouring, in the
    order of the bodies.

    Parameters
    ----------
    made : Skeleton
    positions : ndarray (n, points, 3)
        Of its points over the motion, m.
    """
    bodies = np.array([body for body, _ in made.points])
    found = [0] * (int(bodies.max(initial=0)) + 1)
    some = positions[:: max(1, len(positions) // 20)]
    gap = PARALLEL * float(np.ptp(some, axis=(0, 1)).max())
    for body in range(1, len(found)):
        own = some[:, bodies == body, None]
        taken = set()
        for other in range(1, body):
            apart = np.linalg.norm(own - some[:, None, bodies == other], axis=3).max(axis=0)
            if apart.min(initial=np.inf) <= gap:
                taken.add(found[other])
        found[body] = next(k for k in range(len(found)) if k not in taken)
    return found


def plane_normal(mechanism: Mechanism) -> Array | None:
    """The common axis of a planar mechanism, (3,), or None: turning joints parallel, sliding ones normal."""
    tree, model = mechanism.tree, mechanism.model
    if any(model.joints[joint].nv != 1 for joint in range(1, model.njoints)):
        return None
    tree.jacobians(mechanism.home)
    turning = np.linalg.norm(tree.J[:, 3:], axis=1) > 0.5
    if not turning.any():
        return None
    normal: Array = tree.J[turning, 3:][0].copy()
    parallel = np.abs(np.cross(tree.J[turning, 3:], normal)).max() <= PARALLEL
    normal_to = np.abs(tree.J[~turning, :3] @ normal).max(initial=0.0) <= PARALLEL
    return normal / np.linalg.norm(normal) if parallel and normal_to else None


def face_on(normal: Array | None, gravity: Array, positions: Array) -> dict[str, Any]:
    """Where to look from: onto the plane of a planar motion, from a raised corner of a spatial one.

    Parameters
    ----------
    normal : ndarray (3,) or None
        Of a planar mechanism; else the plane is sought in the principal components of the points.
    gravity : ndarray (3,)
        m/s²; up is against it, or z.
    positions : ndarray (n, points, 3)
        m.

    Returns
    -------
    dict
        `view` (from the middle of the scene to the camera), `up`, and whether the motion is `flat`.
    """
    up = -gravity / np.linalg.norm(gravity) if np.linalg.norm(gravity) > 0.0 else np.array([0.0, 0.0, 1.0])
    cloud = positions.reshape(-1, 3) - positions.reshape(-1, 3).mean(axis=0)
    spread, directions = np.linalg.eigh(cloud.T @ cloud / len(cloud))
    if normal is None and spread[0] < 4e-4 * spread[1]:  # thinner than 2 % of its breadth
        normal = directions[:, 0]
    if normal is not None:
        if abs(normal @ up) > 0.7:  # a plane that lies: y is up on the page
            up = np.eye(3)[1] if abs(normal[1]) < 0.7 else np.eye(3)[2]
        up = up - normal * (normal @ up)
        up /= np.linalg.norm(up)
        right = np.cross(up, normal)
        view = normal * np.sign(right[np.argmax(np.abs(right))])
        return {"view": view.tolist(), "up": up.tolist(), "flat": True}
    level = cloud - np.outer(cloud @ up, up)
    _, across = np.linalg.eigh(level.T @ level + 1e3 * (level**2).sum() * np.outer(up, up))
    depth = across[:, 0] * np.sign(across[np.argmax(np.abs(across[:, 0])), 0])
    side = np.cross(up, depth)
    azimuth, elevation = np.radians(35.0), np.radians(22.0)
    view = np.cos(elevation) * (np.cos(azimuth) * depth - np.sin(azimuth) * side) + np.sin(elevation) * up
    return {"view": view.tolist(), "up": up.tolist(), "flat": False}
