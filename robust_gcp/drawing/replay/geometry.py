"""A mechanism as points and sticks, read from its joints and closures alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...checks import listed
from ...mechanism.constraint.closures import frame_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..skeleton import PARALLEL, Seat, Skeleton, on_page, outline, upward


@dataclass
class Sticks(Skeleton):
    """What to draw: a mechanism's skeleton, and what joins its points.

    Attributes
    ----------
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
        The first of three points that carry the pose of a body, see `meshes`.
    trails : dict of str to int
        Points to follow, by name of frame.
    mark : int
        The point where crossings are marked.
    """

    links: list[tuple[int, int, int]] = field(default_factory=list)
    slides: list[tuple[int, int, int]] = field(default_factory=list)
    rails: list[tuple[int, int, int, int]] = field(default_factory=list)
    faces: list[tuple[list[int], int]] = field(default_factory=list)
    pins: list[tuple[int, int, bool]] = field(default_factory=list)
    frames: dict[int, int] = field(default_factory=dict)
    trails: dict[str, int] = field(default_factory=dict)
    mark: int = 0

    def ends(self) -> list[int]:
        """The points that links may join: all but those that only show a joint's axis or a rail."""
        on_axes = {tip for origin, tip, _ in self.pins if tip != origin}
        on_axes |= {end for rail in self.rails for end in rail[:2]}
        return [i for i in range(len(self.points)) if i not in on_axes]


def sticks(mechanism: Mechanism, R: Array, p: Array, trails: Sequence[str] | None) -> Sticks:
    """Points and sticks of a mechanism.

    A body is drawn between its joint, its children's joints, its closure frames and its trails; where
    it carries nothing further, also its other frames, or else its centre of mass.

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
    model = mechanism.own_model
    made = Sticks(mechanism.length)
    made.fit(mechanism, R, p)
    if trails is None:
        trails = [mechanism.loops[0].frame1] if mechanism.loops else []
    for name in listed(trails, "trails", "frames"):
        frame = frame_of(model, name, "trails")
        made.trails[name] = made.add(frame.parentJoint, frame.placement.translation)
    made.reach(model)
    outlined = [[i for i, (b, _) in enumerate(made.points) if b == body] for body in range(model.njoints)]
    for seat in made.seats:
        if seat.pinned:
            made.pins.append((seat.point, _tip(made, mechanism, seat), seat.parent == 0))
        elif seat.parent:
            made.slides.append((made.add(seat.parent, seat.place), seat.point, seat.joint))
        else:
            made.rails.append((*_rail(made, p[:, seat.joint]), seat.point, seat.joint))
    made.pins += [(a, a, 0 in (made.points[a][0], made.points[b][0])) for a, b, held in made.cuts if held]
    made.slides += [(b, a, made.points[a][0]) for a, b, held in made.cuts if not held]
    for body, ends in enumerate(outlined):
        _outline(made, body, ends)
    made.mark = next(iter(made.trails.values()), made.cuts[0][0] if made.cuts else len(made.points) - 1)
    return made


def _tip(made: Sticks, mechanism: Mechanism, seat: Seat) -> int:
    """A second point on a hinge's axis; the first where it has none."""
    joint = mechanism.joints[seat.joint - 1]
    if joint.axis is None or joint.kind is JointKind.PRISMATIC:
        return seat.point
    made.points.append((seat.joint, 0.04 * made.size * joint.axis))  # never shared: it is no end of a link
    return len(made.points) - 1


def _rail(made: Sticks, path: Array) -> tuple[int, int]:
    """Ends of the straight path of a point, with some rail to spare."""
    _, _, directions = np.linalg.svd(path - path[0], full_matrices=False)
    along = (path - path[0]) @ directions[0]
    spare = 0.1 * made.size
    low, high = (path[0] + s * directions[0] for s in (along.min() - spare, along.max() + spare))
    made.points += [(0, low), (0, high)]  # never shared: a rail is no end of a link
    return len(made.points) - 2, len(made.points) - 1


def _outline(made: Sticks, body: int, ends: list[int]) -> None:
    """Join a body's points: a stick, the rim of a flat hull, or the edges of a solid one."""
    if len(ends) < 2:
        return
    rim, edges = outline(np.array([made.points[i][1] for i in ends]), made.size)
    if rim:
        made.faces.append(([ends[i] for i in rim], body))
    made.links += sorted((min(ends[a], ends[b]), max(ends[a], ends[b]), body) for a, b in edges)


def layers(made: Sticks, positions: Array) -> list[int]:
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
    some = positions[:: max(1, len(positions) // 20)]  # points in one place twenty times are one joint
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
    cloud = positions.reshape(-1, 3) - positions.reshape(-1, 3).mean(axis=0)
    spread, directions = np.linalg.eigh(cloud.T @ cloud / len(cloud))
    if normal is None and spread[0] < 4e-4 * spread[1]:  # thinner than 2 % of its breadth
        normal = directions[:, 0]
    if normal is not None:
        right, up = on_page(normal, gravity)
        return {"view": np.cross(right, up).tolist(), "up": up.tolist(), "flat": True}
    up = upward(gravity)
    level = cloud - np.outer(cloud @ up, up)
    # up itself, along which nothing is left, must not come out as the thinnest direction
    _, across = np.linalg.eigh(level.T @ level + 1e3 * (level**2).sum() * np.outer(up, up))
    # the sign of an eigenvector is the machine's; pages are to look from the same side everywhere
    depth = across[:, 0] * np.sign(across[np.argmax(np.abs(across[:, 0])), 0])
    side = np.cross(up, depth)
    azimuth, elevation = np.radians(35.0), np.radians(22.0)
    view = np.cos(elevation) * (np.cos(azimuth) * depth - np.sin(azimuth) * side) + np.sin(elevation) * up
    return {"view": view.tolist(), "up": up.tolist(), "flat": False}
