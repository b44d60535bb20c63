"""A mechanism at a configuration, or at several over each other, in axes with units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_mechanism, check_whole, path_given, shown
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..skeleton import plane_normal, upward
from .mechanism import OBLIQUE, Pose, draw_pose, face_on, poses
from .style import new_figure, require_file, require_matplotlib, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...simulation.trajectories.trajectory import Trajectory

ROOM = 0.08
"""Around a picture, as a share of its larger side."""

THINNEST = 0.3
"""Least share of the larger side that the others have."""

BROAD, HIGH = 4.2, 4.2
"""Largest width and height of the axes of a picture, in."""

LABELS = 0.7
"""Room for ticks, labels and the title, in."""

ZOOM, SEEN = 0.9, 0.7
"""Largest size of axes in space, and height or breadth over the diagonal: labels stay in the picture."""

APART = 7.0
"""Distance of labels from the numbers of axes in space, pt."""

FAINT, CLEAR = 0.12, 0.4
"""Opacity of the first and of the last but one of several configurations."""


def draw(
    mechanism: Mechanism,
    q: ArrayLike | None = None,
    ax: Axes | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw a mechanism at a configuration; needs the extra `viz`.

    Bodies are bars, or plates, through their joints, the points where loops are cut and the frames of last
    links; circles are joints and cut points, triangles those on the ground, grey bars guides of sliding
    joints. A planar mechanism is seen face-on, gravity down, another in space.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like (nq,), optional
        When left out, its home. Loops that are open there are drawn open.
    ax : matplotlib Axes, optional
        To draw in; what is there stays. Axes in space (`projection="3d"`) take any mechanism, flat ones
        show one that is not planar obliquely. When left out, a figure of its own.
    path : str or Path, optional
        Also write this .png or .pdf file.

    Returns
    -------
    matplotlib.figure.Figure
        Outside pyplot, unless `ax` is in it.

    Raises
    ------
    OptionError
        For what are no axes, another kind of file.
    StateError
        For a q of another shape, or not finite.
    MissingExtraError
        When Matplotlib is not installed.
    """
    check_mechanism(mechanism, Mechanism, "draw")
    at = mechanism.home if q is None else mechanism.configuration(q)
    return over_each_other(mechanism, at[None], ax, path, mechanism.name)


def strobe(
    run: Trajectory,
    n: int = 8,
    path: str | Path | None = None,
    between: Sequence[float] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw n configurations of a motion over each other; see `Trajectory.strobe`."""
    check_whole("n", n, 1)
    given = (run.t[0], run.t[-1]) if between is None else between
    try:
        first, last = (float(t) for t in given)
    except (TypeError, ValueError) as error:
        raise OptionError(f"between = {shown(between)} must be two times, s") from error
    times = np.linspace(first, last, n) if n > 1 else np.array([last])
    title = f"{run.mechanism.name}, t = {times[0]:.4g} … {times[-1]:.4g} s" if n > 1 else f"t = {last:.4g} s"
    return over_each_other(run.mechanism, run.at(times).q, ax, path, title)


def over_each_other(
    mechanism: Mechanism, q: Array, ax: Axes | None, path: str | Path | None, title: str
) -> Figure:
    """The configurations q (n, nq), earlier ones fading."""
    require_matplotlib()
    if path is not None:
        require_file(path_given("path", path))
    with style():
        view, room = view_of(mechanism, ax)
        at = poses(mechanism, q, view)
        ax = prepared(mechanism, at, view, room)
        if not ax.get_title(loc="left"):
            ax.set_title(title, loc="left")
        draw_faded(ax, at)
        figure = ax.get_figure(root=True)
        assert figure is not None
        if path is not None:
            save(figure, Path(path))
    return figure


def draw_faded(ax: Axes, at: Sequence[Pose], opacity: Sequence[float] | None = None) -> None:
    """Poses over each other, the last in full and with its pins."""
    opacity = [*np.linspace(FAINT, CLEAR, len(at) - 1), 1.0] if opacity is None else opacity
    for pose, alpha in zip(at, opacity, strict=True):
        draw_pose(ax, pose, alpha, pins=pose is at[-1])


def view_of(mechanism: Mechanism, ax: Any) -> tuple[Array, Any]:
    """How a mechanism is seen, (2, 3) or (3, 3), and the axes given, or None."""
    if ax is None:
        planar = plane_normal(mechanism) is not None
        return (face_on(mechanism) if planar else np.eye(3)), None
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise OptionError(f"ax = {shown(ax)} must be Matplotlib's axes, such as figure.subplots()")
    return (np.eye(3) if ax.name == "3d" else face_on(mechanism)), ax


def prepared(mechanism: Mechanism, at: Sequence[Pose], view: Array, ax: Any) -> Axes:
    """Axes, new ones where there are none, to one scale, with units, that these poses fit into."""
    points = np.vstack([pose.points for pose in at])
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max()) or mechanism.length
    spare = np.maximum(ROOM * size, 0.5 * (THINNEST * size - (high - low)))
    low, high = low - spare, high + spare
    names = "xyz"[: len(view)]
    if ax is None:
        ax = _new_axes(high - low)
    elif ax.has_data():
        there = np.array([getattr(ax, f"get_{name}lim")() for name in names])
        low, high = np.minimum(low, there[:, 0]), np.maximum(high, there[:, 1])
    for name, start, end, direction in zip(names, low, high, view, strict=True):
        getattr(ax, f"set_{name}lim")(start, end)
        getattr(ax, f"set_{name}label")(_label(direction))
    if len(view) == 3:
        _turn(ax, high - low, upward(mechanism.own_model.gravity.linear))
    else:
        ax.set_aspect("equal")
    drawn: Axes = ax
    return drawn


def _turn(ax: Any, sides: Array, up: Array) -> None:
    """Look at a box in space from where `OBLIQUE` does, so that its labels stay in the picture."""
    right, above = OBLIQUE
    normal = np.cross(right, above)
    vertical = int(np.argmax(np.abs(up)))
    ax.view_init(
        np.degrees(np.arcsin(normal[2])),
        np.degrees(np.arctan2(normal[1], normal[0])),
        vertical_axis="xyz"[vertical],
    )
    ax.set_proj_type("ortho")
    level = np.delete(sides, vertical)
    seen = sides[vertical] * above[2] + float(np.linalg.norm(level)) * normal[2], level.sum() * right[1]
    ax.set_box_aspect(sides, zoom=min(ZOOM, SEEN * float(np.linalg.norm(sides)) / max(seen)))
    for axis, side in zip((ax.xaxis, ax.yaxis, ax.zaxis), sides, strict=True):
        axis.labelpad = APART
        bins = max(1, round(4.0 * side / sides.max()))
        axis.get_major_locator().set_params(nbins=bins, min_n_ticks=1)


def _new_axes(sides: Array) -> Any:
    """In a figure of their own, as large as what they show needs."""
    if len(sides) == 3:
        figure = new_figure(HIGH, BROAD)
        figure.set_layout_engine("none")  # it takes what is drawn in space for larger than it is
        return figure.add_axes((0.02, 0.0, 0.96, 0.93), projection="3d")
    scale = min(BROAD / sides[0], HIGH / sides[1])
    return new_figure(scale * sides[1] + LABELS, scale * sides[0] + LABELS).add_subplot()


def _label(direction: Array) -> str:
    """Of the axis along a direction in the world."""
    largest = int(np.argmax(np.abs(direction)))
    if abs(direction[largest]) > 1.0 - 1e-9:
        return f"{'−' if direction[largest] < 0.0 else ''}{'xyz'[largest]} [m]"
    return f"along ({', '.join(f'{x:.2g}' for x in direction)}) [m]"
