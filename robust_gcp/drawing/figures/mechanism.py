"""A mechanism drawn as lines: each body through its joints and cut points, seen face-on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...mechanism.loops import ClosedLoops
from ...mechanism.tree import Array
from ..skeleton import Skeleton, on_page, placements, plane_normal
from .style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

BODIES = (ORANGE, BLUE, GREEN, VERMILLION, PURPLE, SKY, BLACK)
"""Colours of the bodies in the order of their joints, as in the shipped models."""

WIDTHS = (5.0, 1.5)
"""Widths of the first and the last body drawn, pt: falling, so that folded ones stay visible."""

OBLIQUE = np.array([[-0.6, 0.8, 0.0], [-0.24, -0.18, np.sqrt(0.91)]])
"""View of mechanisms that move in space: x to the left front, y to the right, z up."""

PIN: dict[str, Any] = {
    "marker": "o",
    "markersize": 3.2,
    "color": "white",
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.7,
    "linestyle": "none",
}
PIVOT: dict[str, Any] = {
    "marker": [(-0.9, -1.5), (0.0, 0.0), (0.9, -1.5), (-0.9, -1.5)],
    "markersize": 11,
    "color": "0.55",
    "markeredgewidth": 0.0,
    "linestyle": "none",
}
GUIDE: dict[str, Any] = {"color": "0.7", "linewidth": 3.0, "solid_capstyle": "butt"}


@dataclass(frozen=True)
class Pose:
    """A mechanism at one configuration, projected to a plane; all points (n, 2), m.

    Attributes
    ----------
    bodies : tuple of ndarray
        Joints and cut points of each moving body.
    order : tuple of int
        The bodies in the order of drawing: from the ground outwards.
    guides : tuple of ndarray (2, 2)
        From where each sliding joint starts to where it is.
    pivots, pins : ndarray
        Hinges on the ground, and all others and the cut points.
    """

    bodies: tuple[Array, ...]
    order: tuple[int, ...]
    guides: tuple[Array, ...]
    pivots: Array
    pins: Array

    @property
    def points(self) -> Array:
        """Everything that must fit in the picture, (n, 2)."""
        return np.vstack([*self.bodies, self.pivots, self.pins])


def face_on(mechanism: ClosedLoops) -> Array:
    """The directions to the right and up, (2, 3), that show a planar mechanism face-on, gravity down.

    One that is not planar is seen obliquely.
    """
    normal = plane_normal(mechanism)
    return OBLIQUE if normal is None else np.array(on_page(normal, mechanism.own_model.gravity.linear))


def pose(mechanism: ClosedLoops, q: ArrayLike, view: Array) -> Pose:
    """Place the bodies at q (nq,) and project them by `view` (2, 3)."""
    model = mechanism.own_model
    R, p = placements(mechanism, mechanism.configuration(q)[None])
    bones = Skeleton(mechanism.length)
    bones.fit(mechanism, R, p)
    at = bones.positions(R, p)[0] @ view.T
    seats = {s.joint: view @ (p[0, s.parent] + R[0, s.parent] @ s.place) for s in bones.seats}
    bodies: list[list[Array]] = [[] for _ in range(model.njoints)]
    for (body, _), point in zip(bones.points, at, strict=True):
        bodies[body].append(point)
    pinned = [(seat.point, seat.parent == 0) for seat in bones.seats if seat.pinned]
    pinned += [(i, bones.points[i][0] == 0) for a, b, held in bones.cuts if held for i in (a, b)]
    slides = [(seats[s.joint], at[s.point]) for s in bones.seats if not s.pinned]
    slides += [(at[b], at[a]) for a, b, held in bones.cuts if not held]
    guides = tuple(np.array(ends) for ends in slides)
    depth = [len(model.supports[i]) for i in range(1, model.njoints)]
    order = sorted(range(model.njoints - 1), key=lambda i: depth[i])
    moving = tuple(_distinct(points, mechanism.length) for points in bodies[1:])
    pivots, pins = ([at[i] for i, ground in pinned if ground == on] for on in (True, False))
    return Pose(moving, tuple(order), guides, _points(pivots), _points(pins))


def draw_pose(
    ax: Axes, at: Pose, alpha: float = 1.0, pins: bool = True, scale: float = 1.0, color: str = ""
) -> None:
    """Draw bodies as bars or plates, hinges as circles, hinges on the ground as triangles.

    Parameters
    ----------
    alpha : float
        Opacity of the bodies.
    pins : bool
        False leaves hinges out, as for a fading earlier pose.
    scale : float
        Factor on all widths.
    color : str
        Draw all bodies in shades of this colour instead of `BODIES`.
    """
    shades = _shades(color, len(at.order)) if color else None
    for guide in at.guides:
        ax.plot(*guide.T, zorder=1.8, alpha=alpha, clip_on=False, **GUIDE)
    for k, (width, i) in enumerate(zip(np.linspace(*WIDTHS, len(at.order)), at.order, strict=True)):
        points, paint = at.bodies[i], BODIES[i % len(BODIES)] if shades is None else shades[k]
        looks: dict[str, Any] = {"color": paint, "alpha": alpha, "zorder": 2, "clip_on": False}
        if len(points) == 1:  # a slider, or a body that only carries the next joint's axis
            ax.plot(*points.T, marker="s", markersize=7 * scale, markeredgewidth=0.0, **looks)
            continue
        if len(points) > 2:
            points = _around(points)
            ax.fill(*points.T, facecolor=paint, alpha=0.35 * alpha, edgecolor="none", zorder=1.9)
            points = np.vstack([points, points[:1]])
        ax.plot(*points.T, linewidth=scale * width, solid_joinstyle="round", **looks)
    if not pins:
        return
    drop = 0.01 * float(np.ptp(at.points, axis=0).max())
    for x, z in at.pivots:
        ax.plot(x, z - drop, zorder=1.5, clip_on=False, **{**PIVOT, "markersize": 11 * scale})
    for point in np.vstack([at.pivots, at.pins]):
        ax.plot(*point, zorder=3, clip_on=False, **{**PIN, "markersize": 3.2 * scale})


def body_legend(figure: Figure | SubFigure, mechanism: ClosedLoops) -> None:
    """Name the bodies in one line across the figure, by their links' names."""
    from matplotlib.lines import Line2D

    at = pose(mechanism, pin.neutral(mechanism.own_model), face_on(mechanism))
    widths = dict(zip(at.order, np.linspace(*WIDTHS, len(at.order)), strict=True))
    names = _body_names(mechanism)
    handles = [
        Line2D([], [], color=BODIES[i % len(BODIES)], linewidth=widths[i], label=names[i]) for i in at.order
    ]
    handles.append(Line2D([], [], label="pin", **PIN))
    handles.append(Line2D([], [], label="ground pivot", **{**PIVOT, "markersize": 8}))
    figure.legend(handles=handles, loc="center", ncols=len(handles))


def _body_names(mechanism: ClosedLoops) -> list[str]:
    """The link that each joint carries, or the joint where links have no names."""
    links: dict[int, str] = {}
    for frame in mechanism.own_model.frames:
        if frame.type == pin.FrameType.BODY:
            links.setdefault(int(frame.parentJoint), str(frame.name))
    return [links.get(i + 1, name) for i, name in enumerate(mechanism.joint_names)]


def _shades(color: str, count: int) -> list[Any]:
    """From a light to a dark shade of a colour, for bars that lie on each other from wide to narrow."""
    from matplotlib.colors import to_rgb

    rgb = np.array(to_rgb(color))
    mixed = [(1.0 - w) * rgb + w if w > 0.0 else (1.0 + w) * rgb for w in np.linspace(0.45, -0.45, count)]
    return [tuple(c.tolist()) for c in mixed]


def _points(points: Sequence[Array]) -> Array:
    return np.array(points).reshape(-1, 2)


def _distinct(points: Sequence[Array], length: float) -> Array:
    """Points that are no repetition of an earlier one."""
    kept: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 1e-9 * length for other in kept):
            kept.append(point)
    return np.array(kept)


def _around(points: Array) -> Array:
    """Corners of a plate in the order around its middle."""
    way = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(way[:, 1], way[:, 0]))]
