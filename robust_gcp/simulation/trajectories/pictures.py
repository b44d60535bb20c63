"""Pictures of a motion, which need the extra `viz`: Matplotlib is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...checks import listed, shown
from ...errors import OptionError, StateError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Pictures:
    """What a `Trajectory` can draw of itself."""

    def plot(
        self,
        what: Sequence[str] | str | None = None,
        path: str | Path | None = None,
        *,
        joints: Sequence[str] | str | None = None,
        overlay: Pictures | Sequence[Pictures] | Mapping[str, Pictures] | None = None,
        x: str | None = None,
    ) -> Figure:
        """Draw the motion over time, or over one of its columns (extra `viz`).

        Over time, dotted lines mark crossings, dashed ones events, and thin ones, coloured by their kind,
        `happenings`: impacts, holds, releases; over a column, circles and other markers on the curves. Each
        quantity has one panel for each unit.

        Parameters
        ----------
        what : str or sequence of str, optional
            Quantities, "q", "v", "a", "tau", "drive", "multipliers" (constraint forces, see
            `reactions.row_names`), "energy" (`energy_error`, J), "closure" (`closure_error`, on a
            logarithmic scale); or whatever `traj[...]` answers, such as "q1", "v.q1", "drive.q1", "work".
            Beside such columns, or over one, "energy" is the energy itself. When left out: q, v, what
            drives take, closure where there are loops, and a, tau and energy if recorded.
        path : str or Path, optional
            Also write this .png or .pdf file.
        joints : sequence of str or "all", optional
            Joints, or single numbers such as "ball.rx", whose quantities are drawn. When left out: all, or
            the independent ones of a mechanism with more than twenty numbers.
        overlay : Trajectory, sequence or mapping {label: Trajectory}, optional
            Other runs of the same joints, drawn in the same colours with dashes.
        x : str, optional
            The column to draw over, such as "q1"; when left out, time.

        Returns
        -------
        matplotlib.figure.Figure
            Outside pyplot: nothing needs to be closed, and a notebook shows it by itself.

        Raises
        ------
        OptionError
            For names that are no column, what was not recorded, joints that are none, another kind of file.
        MissingExtraError
            When Matplotlib is not installed.
        """
        from ...drawing.figures.motion import plot_motion

        runs: dict[str, Any]
        if isinstance(overlay, Mapping):
            runs = {"this run": self, **overlay}
        else:
            given = () if overlay is None else overlay
            given = [given] if isinstance(given, Pictures) else given
            more = listed(given, "overlay", "runs", OptionError, ())
            runs = {f"run {i}": run for i, run in enumerate((self, *more), start=1)}
        if not all(isinstance(run, Pictures) for run in runs.values()):
            raise OptionError(f"overlay = {shown(overlay)} must hold what simulate returns")
        for run in runs.values():
            _with_outputs(run)
        return plot_motion(runs, what, path, joints, x)

    def strobe(
        self,
        n: int = 8,
        path: str | Path | None = None,
        *,
        between: Sequence[float] | None = None,
        ax: Axes | None = None,
    ) -> Figure:
        """Draw the mechanism at n times over each other, the earlier the fainter (extra `viz`).

        Parameters
        ----------
        n : int
            Configurations, at equal times; the last is drawn in full.
        path : str or Path, optional
            Also write this .png or .pdf file.
        between : (float, float), optional
            The first and the last time, s; when left out, those of the motion.
        ax : matplotlib Axes, optional
            To draw in, as in `draw`.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        OptionError
            For times outside the motion, less than one configuration, no axes, another kind of file.
        MissingExtraError
            When Matplotlib is not installed.
        """
        from ...drawing.figures.draw import strobe

        run = _with_outputs(self)
        return strobe(run, n, path, between, ax)

    def animate(self, path: str | Path, *, fps: float = 25.0, speed: float = 1.0) -> Path:
        """Write the motion as a .gif file, or as a .mp4 file where ffmpeg is installed (extra `viz`).

        Parameters
        ----------
        path : str or Path
        fps : float
            Frames a second. A GIF counts hundredths of a second: it takes the nearest number that it can
            hold, at most 50.
        speed : float
            Seconds of the motion in a second of the animation; 0.1 is slow motion. Frames are at equal
            times of the motion, interpolated as by `at`, however it was stepped.

        Returns
        -------
        Path

        Raises
        ------
        OptionError
            For another kind of file, numbers that are not positive, more than 3000 frames.
        MissingExtraError
            When Matplotlib, or ffmpeg for a .mp4 file, is not installed.
        """
        from ...drawing.figures.animation import animate

        run = _with_outputs(self)
        return animate(run, path, fps, speed)


def _with_outputs(run: Any) -> Any:
    """The run, or a StateError where it has no outputs."""
    if not len(run.t):
        raise StateError("the trajectory is empty: there is nothing to draw")
    return run
