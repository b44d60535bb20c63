"""Motions as files that play: GIF by Pillow, MP4 by ffmpeg."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...checks import check_positive, path_given
from ...errors import MissingExtraError, OptionError
from ...mechanism.tree.tree import Array
from .draw import prepared, view_of
from .mechanism import draw_pose, poses
from .style import require_matplotlib, style

if TYPE_CHECKING:
    from matplotlib.animation import AbstractMovieWriter

    from ...simulation.trajectories.trajectory import Trajectory

ENDINGS = (".gif", ".mp4")

DPI = 100

MOST = 3000
"""Frames: two minutes. A GIF is kept in memory until it is written, some 0.7 MB each."""

TICK = 100.0
"""A GIF counts hundredths of a second ..."""

SHORTEST = 2
"""... and viewers show a frame for at least two of them."""


def animate(run: Trajectory, path: str | Path, fps: float = 25.0, speed: float = 1.0) -> Path:
    """Write a motion as a file that plays; see `Trajectory.animate`."""
    place = path_given("path", path)
    require_writer(place)
    check_positive("fps", fps)
    check_positive("speed", speed)
    if place.suffix == ".gif":
        fps = TICK / max(SHORTEST, round(TICK / fps))
    times = frame_times(run.t, fps, speed)
    writer = _writer(place.suffix, fps)
    view, _ = view_of(run.mechanism, None)
    at = poses(run.mechanism, run.at(times).q, view)
    digits = min(max(2, int(np.ceil(-np.log10(speed / fps)))), 6)  # frames differ in the last one
    place.parent.mkdir(parents=True, exist_ok=True)
    with style():
        ax: Any = prepared(run.mechanism, at, view, None)
        figure = ax.figure
        ax.set_title(run.mechanism.name, loc="left", y=1.0)  # to look for a place takes long
        bare = set(ax.get_children())
        with writer.saving(figure, str(place), DPI):
            for t, pose in zip(times, at, strict=True):
                for artist in set(ax.get_children()) - bare:
                    artist.remove()
                draw_pose(ax, pose)
                ax.set_title(f"t = {t:.{digits}f} s", loc="right", y=1.0)
                if pose is at[0]:
                    figure.draw_without_rendering()
                    figure.set_layout_engine("none")  # or axes would move with what they show
                writer.grab_frame()
    return place


def frame_times(t: Array, fps: float, speed: float) -> Array:
    """Times of the frames, s, evenly from the first to the last of the motion, however it was stepped."""
    frames = (t[-1] - t[0]) * fps / speed
    if frames >= MOST:
        raise OptionError(
            f"{frames:.3g} frames, of at most {MOST}, for {t[-1] - t[0]:.4g} s at {fps:.4g} frames a second; "
            f"take speed={1.1 * speed * frames / MOST:.2g} or faster"
        )
    # minimum: a motion is known nowhere beyond its end, not by a rounding either
    return np.minimum(t[0] + np.arange(int(frames + 1e-6) + 1) * speed / fps, t[-1])


def require_writer(path: Path) -> None:
    """Refuse, before anything is computed, a file that could not be written."""
    require_matplotlib()
    if path.suffix not in ENDINGS:
        raise OptionError(f"{path}: an animation is a {' or a '.join(ENDINGS)} file")
    from matplotlib.animation import FFMpegWriter

    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise MissingExtraError(
            "a .mp4 file needs the program ffmpeg, which is not found: install it (apt install ffmpeg, "
            "brew install ffmpeg, conda install ffmpeg), or write a .gif file"
        )


def _writer(ending: str, fps: Any) -> AbstractMovieWriter:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if ending == ".gif":
        return PillowWriter(fps=fps * (1.0 - 1e-9))  # it cuts the duration of a frame to whole milliseconds
    return FFMpegWriter(fps=fps)
