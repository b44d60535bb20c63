"""A mechanism drawn as lines: each body through its joints and cut points, seen face-on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...mechanism.loops import ClosedLoops
from ...mechanism.tree.tree import Array
from ..skeleton import Skeleton, on_page, outline, placements, plane_normal, upward
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
    """A mechanism at one configuration, projected to a plane or in space; all points (n, 2) or (n, 3), m.

    Attributes
    ----------
    bodies : tuple of ndarray
        Joints, cut points and ends of each moving body; a single one of a slider, none of a body that only
        carries the next joint's axis.
    order : tuple of int
        The bodies in the order of drawing: from the ground outwards.
    guides : tuple of ndarray (2, 2) or (2, 3)
        From where each sliding joint starts to where it is.
    pivots, pins : ndarray
        Revolute joints on the ground, and all others and the cut points.
    up : ndarray (2,) or (3,)
        Away from the ground.
    size : float
        Of the mechanism.
    """

    bodies: tuple[Array, ...]
    order: tuple[int, ...]
    guides: tuple[Array, ...]
    pivots: Array
    pins: Array
    up: Array
    size: float

    @property
    def points(self) -> Array:
        """Everything that must fit in the picture, (n, 2) or (n, 3)."""
        return np.vstack([*self.bodies, *self.guides, self.pivots, self.pins])


def face_on(mechanism: ClosedLoops) -> Array:
    """The directions to the right and up, (2, 3), that show a planar mechanism face-on, gravity down.

    One that is not planar is seen obliquely.
    """
    normal = plane_normal(mechanism)
    return OBLIQUE if normal is None else np.array(on_page(normal, mechanism.own_model.gravity.linear))


def pose(mechanism: ClosedLoops, q: ArrayLike, view: Array) -> Pose:
    """Place the bodies at q (nq,) and project them by `view` (2, 3), or leave them in space: (3, 3)."""
    return poses(mechanism, mechanism.configuration(q)[None], view)[0]


def poses(mechanism: ClosedLoops, q: Array, view: Array) -> list[Pose]:
    """A `pose` for each row of q (n, nq)."""
    bones = Skeleton(mechanism.length)
    bones.fit(mechanism, *placements(mechanism, np.array(mechanism.generic_configurations(2))))
    bones.reach(mechanism.own_model)
    R, p = placements(mechanism, q)
    at = bones.positions(R, p) @ view.T
    return [_pose(mechanism, bones, at[i], R[i], p[i], view) for i in range(len(q))]


def _pose(mechanism: ClosedLoops, bones: Skeleton, at: Array, R: Array, p: Array, view: Array) -> Pose:
    """The bones at their points (n, 2) or (n, 3), the joints placed by R and p."""
    model, axes = mechanism.own_model, len(view)
    seats = {s.joint: view @ (p[s.parent] + R[s.parent] @ s.place) for s in bones.seats}
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
    moving = [_distinct(points, mechanism.length).reshape(-1, axes) for points in bodies[1:]]
    for seat in bones.seats:
        if seat.pinned and len(moving[seat.joint - 1]) == 1:
            moving[seat.joint - 1] = np.zeros((0, axes))
    pivots, pins = (
        np.array([at[i] for i, ground in pinned if ground == on]).reshape(-1, axes) for on in (True, False)
    )
    up = np.array([0.0, 1.0]) if axes == 2 else upward(model.gravity.linear)
    return Pose(tuple(moving), tuple(order), guides, pivots, pins, up, mechanism.length)


def draw_pose(
    ax: Axes, at: Pose, alpha: float = 1.0, pins: bool = True, scale: float = 1.0, color: str = ""
) -> None:
    """Draw bodies as bars or plates, revolute joints as circles, revolute joints on the ground as triangles.

    Parameters
    ----------
    alpha : float
        Opacity of the bodies.
    pins : bool
        False leaves revolute joints out, as for a fading earlier pose.
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
        if len(points) == 1:
            ax.plot(*points.T, marker="s", markersize=7 * scale, markeredgewidth=0.0, **looks)
        if len(points) < 2:
            continue
        rim, edges = outline(points, at.size)
        if rim:
            fill(ax, points[rim], facecolor=paint, alpha=0.35 * alpha, edgecolor="none", zorder=1.9)
        for line in [[*rim, rim[0]]] if rim else edges:
            ax.plot(*points[list(line)].T, linewidth=scale * width, solid_joinstyle="round", **looks)
    if not pins:
        return
    drop = 0.01 * float(np.ptp(at.points, axis=0).max()) * at.up
    for point in at.pivots:  # as lists of one, which axes in space need
        ax.plot(*(point - drop)[:, None], zorder=1.5, clip_on=False, **{**PIVOT, "markersize": 11 * scale})
    for point in np.vstack([at.pivots, at.pins]):
        ax.plot(*point[:, None], zorder=3, clip_on=False, **{**PIN, "markersize": 3.2 * scale})


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


def fill(ax: Axes, corners: Array, **looks: Any) -> None:
    """A plate (n, 2), or in space (n, 3)."""
    if corners.shape[1] == 2:
        ax.fill(*corners.T, **looks)
        return
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    ax.add_collection(Poly3DCollection([corners], **looks))


def _distinct(points: Sequence[Array], length: float) -> Array:
    """Points that are no repetition of an earlier one."""
    kept: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 1e-9 * length for other in kept):
            kept.append(point)
    return np.array(kept)
