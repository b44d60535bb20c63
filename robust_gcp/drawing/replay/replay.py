"""A motion as one page that plays offline: `replay(trajectory, "file.html")`."""

from __future__ import annotations

import html
import importlib.util
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_choice, check_positive, check_text, check_whole, path_given, real_array, shown
from ...errors import MissingExtraError, OptionError, missing_extra
from ...simulation.trajectories.archive import write_whole
from ...simulation.trajectories.trajectory import Trajectory
from .data import run_data, scene_data
from .frames import playing_speed

LAYOUTS = ("overlay", "side by side")

MOST_RUNS = 4
"""Motions on one page: as many as there are colours that all readers can tell apart."""

PARTS = Path(__file__).parent / "page"

SCENE = ("trail", "mesh", "motion", "drawing", "scene", "surroundings", "labels")
"""Scripts of the scene, each using those before it."""


class ReplayPage:
    """A page in memory, shown inline by notebooks.

    Attributes
    ----------
    html : str
        The whole page; needs no network.
    height : int
        Of the frame in a notebook, px.
    """

    def __init__(self, html: str, height: int) -> None:
        self.html, self.height = html, height

    def save(self, path: str | Path) -> Path:
        """Write the page; returns the path."""
        return write_whole(path_given("path", path), lambda file: file.write(self.html.encode()))

    def _repr_html_(self) -> str:
        return (
            f'<iframe title="Replay" srcdoc="{html.escape(self.html)}" allow="fullscreen" '
            f'style="width: 100%; height: {self.height}px; border: 1px solid #ccc"></iframe>'
        )


Runs = Trajectory | Sequence[Trajectory] | Mapping[str, Trajectory]
"""One motion, or several, with their labels or without."""


@overload
def replay(
    trajectories: Runs,
    path: None = None,
    *,
    layout: Literal["overlay", "side by side"] = ...,
    labels: Sequence[str] | None = ...,
    trails: Sequence[str] | None = ...,
    speed: float | None = ...,
    view: ArrayLike | None = ...,
    visual: Any = ...,
    title: str | None = ...,
    height: int = ...,
) -> ReplayPage: ...


@overload
def replay(
    trajectories: Runs,
    path: str | Path,
    *,
    layout: Literal["overlay", "side by side"] = ...,
    labels: Sequence[str] | None = ...,
    trails: Sequence[str] | None = ...,
    speed: float | None = ...,
    view: ArrayLike | None = ...,
    visual: Any = ...,
    title: str | None = ...,
    height: int = ...,
) -> Path: ...


def replay(
    trajectories: Runs,
    path: str | Path | None = None,
    *,
    layout: Literal["overlay", "side by side"] = "overlay",
    labels: Sequence[str] | None = None,
    trails: Sequence[str] | None = None,
    speed: float | None = None,
    view: ArrayLike | None = None,
    visual: Any = None,
    title: str | None = None,
    height: int = 620,
) -> Path | ReplayPage:
    """One self-contained page that plays a motion offline; no server, no network.

    The motion is drawn 30 times a second of play whatever its steps, between the outputs as by
    `Trajectory.at`. A fragment in the page's address opens it at a time: `file.html#t=1.5&paused`.

    Parameters
    ----------
    trajectories : Trajectory, sequence of Trajectory or mapping {label: Trajectory}
        Up to four, on a common time line.
    path : str or Path, optional
        The file to write; without it the page is returned, and a notebook shows it inline.
    layout : {"overlay", "side by side"}
        Of several motions.
    labels : sequence of str, optional
        A name for each motion.
    trails : sequence of str, optional
        Frames whose paths are drawn, the first one carrying the marks of the crossings; the first
        closure's frame when left out, none for ().
    speed : float, optional
        Simulated seconds for one second of play. Left out: 1, unless that plays for less than 2 s or
        more than 300 s; the page says which it is.
    view : array_like (3,), optional
        Direction from the scene to the camera; face-on for planar motions when left out.
    visual : pin.GeometryModel, path or True, optional
        Shapes of the bodies: built from the mechanism's model, those of a URDF, or those of the file that the
        mechanism was loaded from. Meshes are then opened. Sticks when left out.
    title : str, optional
        The mechanism's name when left out.
    height : int
        In a notebook, px.

    Returns
    -------
    Path or ReplayPage

    Raises
    ------
    MissingExtraError
        When meshcat, whose viewer draws the scene, is not installed.
    OptionError, ModelError, StateError
        For arguments that cannot be drawn.
    """
    if path is not None:
        require_page(path_given("path", path))
    viewer = viewer_script()
    if isinstance(trajectories, Mapping):
        if labels is not None:
            raise OptionError("replay: the mapping names the motions already; leave labels out")
        labels, trajectories = list(trajectories), list(trajectories.values())
    runs = _runs(trajectories)
    names = _labels(labels, len(runs))
    check_choice("layout", layout, LAYOUTS)
    if title is not None:
        check_text("title", title)
    check_whole("height", height, 1)
    direction = _direction(view)
    times = [t for run in runs if len(run.t) for t in (float(run.t[0]), float(run.t[-1]))]
    start, end = min(times, default=0.0), max(times, default=0.0)
    if speed is None:
        speed = playing_speed(end - start)
    else:
        check_positive("speed", speed)
    made = [run_data(run, name, speed, trails, visual) for run, name in zip(runs, names, strict=True)]
    data = {
        "title": title or runs[0].mechanism.name or "mechanism",
        "layout": layout if len(runs) > 1 else "overlay",
        "start": start,
        "end": end,
        "speed": speed,
        "runs": [run for run, _ in made],
        **scene_data(runs[0].mechanism, [positions for _, positions in made], direction),
    }
    page = ReplayPage(_page(data, viewer), height)
    return page if path is None else page.save(path)


def require_page(path: Path) -> None:
    """Refuse a file that no replay can be written to, before anything is computed.

    Raises
    ------
    OptionError
        For another ending than .html.
    MissingExtraError
        When meshcat is not installed.
    """
    if path.suffix not in (".html", ".htm"):
        raise OptionError(f"{path}: a replay is a web page; end its name in .html")
    meshcat_folder()


def meshcat_folder() -> Path:
    """Where meshcat is installed; it is not imported.

    Raises
    ------
    MissingExtraError
    """
    found = importlib.util.find_spec("meshcat")
    if found is None or found.origin is None:
        raise missing_extra("replay and live draw with meshcat", "meshcat", "viz")
    return Path(found.origin).parent


def viewer_script() -> str:
    """meshcat's viewer with three.js inside, as one script with its licences in front."""
    return _viewer_script(meshcat_folder() / "viewer")


@cache
def _viewer_script(folder: Path) -> str:
    try:
        licences = [(folder / "dist" / "main.min.js.LICENSE.txt"), folder / "LICENSE"]
        notes = "\n".join(file.read_text(encoding="utf-8") for file in licences if file.is_file())
        script = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
    except OSError as error:
        raise MissingExtraError(
            f'meshcat\'s viewer cannot be read ({error}): pip install --force-reinstall "meshcat>=0.3.2"'
        ) from error
    return "/*\n" + notes.replace("*/", "* /") + "\n*/\n" + script.replace("</script", "<\\/script")


def _page(data: dict[str, Any], viewer: str) -> str:
    """Fill the template; every part is put in once, so that no part can ask for another."""
    parts = {
        "TITLE": html.escape(str(data["title"])),
        "STYLE": (PARTS / "page.css").read_text(encoding="utf-8"),
        "DATA": json.dumps(data, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"),
        "VIEWER": viewer,
        "SCENE": "\n".join((PARTS / f"{name}.js").read_text(encoding="utf-8") for name in SCENE),
        "PLAYER": (PARTS / "player.js").read_text(encoding="utf-8"),
    }
    pieces = (PARTS / "page.html").read_text(encoding="utf-8").split("@@")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))


def _runs(trajectories: Any) -> list[Trajectory]:
    runs = list(trajectories) if isinstance(trajectories, Sequence) else [trajectories]
    if not all(isinstance(run, Trajectory) for run in runs) or not 1 <= len(runs) <= MOST_RUNS:
        kinds = ", ".join(type(run).__name__ for run in runs[:6])
        raise OptionError(
            f"replay takes a trajectory, a list of 1 to {MOST_RUNS}, or {{label: trajectory}}; got [{kinds}]"
        )
    return runs


def _labels(labels: Any, count: int) -> list[str]:
    if labels is None:
        return [""] if count == 1 else [f"motion {i + 1}" for i in range(count)]
    if (
        not isinstance(labels, list | tuple)
        or len(labels) != count
        or not all(isinstance(n, str) for n in labels)
    ):
        raise OptionError(f"labels = {shown(labels)}: give {count} names, one for each trajectory")
    return list(labels)


def _direction(view: ArrayLike | None) -> Any:
    if view is None:
        return None
    try:
        direction = real_array(view)
    except TypeError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise OptionError(f"view = {shown(view)} is not a direction in space, (x, y, z)")
    return direction
