"""Mechanisms at a configuration, at several over each other, and as files that play."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import robust_gcp as rg
from robust_gcp.drawing.figures.animation import DPI, frame_times
from robust_gcp.drawing.figures.mechanism import BODIES, face_on, pose


@pytest.fixture(scope="module")
def fall() -> rg.Trajectory:
    return rg.simulate(rg.load("rhombus"), duration=0.6, step=5e-3)


def bars(ax: Any) -> list[Any]:
    """What is drawn in the colour of a body."""
    return [line for line in ax.lines if line.get_color() in BODIES and len(line.get_xdata()) > 1]


def test_a_planar_mechanism_is_drawn_in_its_plane() -> None:
    mech = rg.load("rhombus")
    q = np.array([0.7, -0.7, 0.7])
    figure = rg.draw(mech, q)
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("y [m]", "z [m]")
    assert ax.get_aspect() == 1.0
    drawn = [np.array(line.get_data()).T for line in bars(ax)]
    for ends in ([[0, 0], [np.cos(0.7), np.sin(0.7)]], [[1, 0], [1 + np.cos(0.7), np.sin(0.7)]]):
        assert any(np.allclose(np.sort(line, axis=0), np.sort(ends, axis=0)) for line in drawn)
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    points = np.vstack(drawn)
    assert low < points[:, 0].min() and points[:, 0].max() < high
    assert bottom < points[:, 1].min() and points[:, 1].max() < top


def test_home_is_drawn_when_no_configuration_is_given() -> None:
    mech = rg.load("slider_crank")
    here, home = (rg.draw(mech, q).axes[0] for q in (None, mech.home))
    for a, b in zip(here.lines, home.lines, strict=True):
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())


@pytest.mark.parametrize("name", ["bricard", "stewart", "flyball"])
def test_a_spatial_mechanism_is_drawn_in_space_at_true_size(name: str) -> None:
    mech = rg.load(name)
    (ax,) = rg.draw(mech).axes
    assert ax.name == "3d"
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()) == ("x [m]", "y [m]", "z [m]")  # type: ignore
    spans = [np.ptp(getattr(ax, f"get_{c}lim")()) for c in "xyz"]
    box = ax.get_box_aspect()  # type: ignore[attr-defined]
    np.testing.assert_allclose(np.array(spans) / spans[0], np.array(box) / box[0], rtol=1e-9)
    at = pose(mech, mech.home, np.eye(3))
    drawn = np.vstack([np.array(line.get_data_3d()).T for line in ax.lines])  # type: ignore[attr-defined]
    for body in at.bodies:
        for point in body if len(body) < 4 else ():
            assert np.linalg.norm(drawn - point, axis=1).min() < 1e-9


def test_a_plate_is_the_hull_of_its_points() -> None:
    """The platform of a hexapod has its centre among its points: no corner of it."""
    mech = rg.load("stewart")
    (ax,) = rg.draw(mech).axes
    assert len(ax.collections) == 1
    (rim,) = [line for line in ax.lines if len(line.get_xdata()) > 2]
    corners = np.array(rim.get_data_3d()).T[:-1]  # type: ignore[attr-defined]
    radii = np.linalg.norm(corners - corners.mean(axis=0), axis=1)
    assert len(corners) == 6 and radii.min() > 0.9 * radii.max()


def test_axes_that_are_given_are_drawn_in_and_what_is_there_stays() -> None:
    mech = rg.load("rhombus")
    figure = Figure()
    ax = figure.subplots()
    assert rg.draw(mech, [0.2, -0.2, 0.2], ax) is figure
    first, limits = len(ax.lines), ax.get_ylim()
    rg.draw(mech, [-1.5, 1.5, -1.5], ax)
    assert len(ax.lines) == 2 * first
    assert ax.get_ylim()[0] < -1.0 < limits[0] and ax.get_ylim()[1] >= limits[1]
    space = Figure().add_subplot(projection="3d")
    rg.draw(mech, ax=space)
    assert len(space.lines) == first
    oblique = Figure().subplots()
    rg.draw(rg.load("bricard"), ax=oblique)
    assert oblique.get_xlabel().startswith("along (")
    with pytest.raises(rg.OptionError, match="must be Matplotlib's axes"):
        rg.draw(mech, ax=3)  # type: ignore[arg-type]
    with pytest.raises(rg.StateError, match="q has shape"):
        rg.draw(mech, [0.0])


def test_pictures_of_mechanisms_are_written(tmp_path: Path, fall: rg.Trajectory) -> None:
    rg.draw(fall.mechanism, path=tmp_path / "home.png")
    assert matplotlib.image.imread(tmp_path / "home.png").ndim == 3
    fall.strobe(3, tmp_path / "strobe.pdf")
    assert (tmp_path / "strobe.pdf").read_bytes().startswith(b"%PDF")
    for call in (rg.draw, lambda m, path: fall.strobe(path=path)):
        with pytest.raises(rg.OptionError, match=r"a figure is a \.png or a \.pdf file"):
            call(fall.mechanism, path=tmp_path / "home.gif")


# --------------------------------------------------------------------------- strobe


def test_a_strobe_shows_equal_times_over_each_other_the_last_in_full(fall: rg.Trajectory) -> None:
    (ax,) = fall.strobe(4).axes
    drawn = bars(ax)
    assert len(drawn) == 4 * 3
    alphas = [line.get_alpha() for line in drawn[::3]]
    assert alphas == sorted(alphas) and alphas[-1] == 1.0 and alphas[-2] < 0.5
    view = face_on(fall.mechanism)
    for k, t in enumerate(np.linspace(0.0, 0.6, 4)):
        wanted = {tuple(body.ravel().round(9)) for body in pose(fall.mechanism, fall.at(t).q, view).bodies}
        found = {tuple(np.array(line.get_data()).T.ravel().round(9)) for line in drawn[3 * k : 3 * k + 3]}
        turned = {
            tuple(np.array(line.get_data()).T[::-1].ravel().round(9)) for line in drawn[3 * k : 3 * k + 3]
        }
        assert wanted <= found | turned
    assert ax.get_title(loc="left") == "rhombus, t = 0 … 0.6 s"


def test_a_strobe_of_a_part_and_of_one(fall: rg.Trajectory) -> None:
    (ax,) = fall.strobe(2, between=(0.1, 0.3)).axes
    assert ax.get_title(loc="left") == "rhombus, t = 0.1 … 0.3 s"
    assert len(bars(fall.strobe(1).axes[0])) == 3
    mine: Axes = Figure().subplots()
    assert fall.strobe(2, ax=mine) is mine.figure
    for given in ({"n": 0}, {"between": (0.0, 9.0)}, {"between": 3}, {"n": 2.5}):
        with pytest.raises(rg.OptionError):
            fall.strobe(**given)  # type: ignore[arg-type]


# --------------------------------------------------------------------------- animations


def durations(path: Path) -> list[float]:
    """ms that each frame of a GIF is shown."""
    with Image.open(path) as file:
        found = []
        for k in range(file.n_frames):  # type: ignore[attr-defined]
            file.seek(k)
            found.append(file.info["duration"])
        return found


def test_frames_follow_the_time_of_the_motion_not_its_steps(tmp_path: Path) -> None:
    steps = np.array([0.0, 0.011, 0.05, 0.3, 0.31, 0.5])
    run = rg.simulate(rg.load("rhombus"), duration=0.5, step=1e-3, outputs=steps)
    path = run.animate(tmp_path / "new" / "run.gif", fps=4, speed=0.5)
    assert path == tmp_path / "new" / "run.gif"
    shown = durations(path)
    assert shown == [250.0] * 5  # 0.5 s at half speed, four a second, and the first
    np.testing.assert_allclose(frame_times(run.t, 4.0, 0.5), 0.125 * np.arange(5), atol=1e-12)
    assert frame_times(np.array([2.0, 2.35]), 10.0, 1.0).tolist() == pytest.approx([2.0, 2.1, 2.2, 2.3])
    assert frame_times(np.array([2.0]), 10.0, 1.0).tolist() == [2.0]


def test_frames_differ_and_axes_stand_still(fall: rg.Trajectory, tmp_path: Path) -> None:
    path = fall.animate(tmp_path / "run.gif", fps=5)
    with Image.open(path) as file:
        frames = []
        for k in range(file.n_frames):  # type: ignore[attr-defined]
            file.seek(k)
            frames.append(np.asarray(file.convert("L"), dtype=float))
    assert len(frames) == 4
    height, width = frames[0].shape
    changes = np.abs(frames[1] - frames[0]) > 60
    assert changes.any()
    assert not changes[int(0.9 * height) :, : width // 2].any()  # the labels below


def test_a_gif_takes_the_nearest_rate_that_it_can_hold(fall: rg.Trajectory, tmp_path: Path) -> None:
    for fps, each in ((30, 30.0), (1000, 20.0)):
        shown = durations(fall.animate(tmp_path / "run.gif", fps=fps, speed=10.0))
        assert set(shown) == {each} and len(shown) == int(0.06 / each * 1e3 + 1e-9) + 1


def test_a_spatial_motion_plays(tmp_path: Path) -> None:
    run = rg.simulate(rg.load("bricard"), duration=0.1, step=5e-3)
    assert len(durations(run.animate(tmp_path / "run.gif", fps=20))) == 3


def test_an_mp4_is_what_ffmpeg_makes_of_every_frame(
    fall: rg.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program in its place keeps what it is given."""
    program = tmp_path / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys, pathlib\ndata = sys.stdin.buffer.read()\n"
        "pathlib.Path(sys.argv[-1]).write_text(f'{len(data)} {sys.argv}')\n"
    )
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    path = fall.animate(tmp_path / "run.mp4", fps=5)
    size, words = path.read_text().split(" ", 1)
    width, height = map(int, words.split("'-s', '")[1].split("'")[0].split("x"))
    assert int(size) == 4 * 4 * width * height
    assert width > 3 * DPI and "'-framerate', '5" in words


def test_what_cannot_be_animated_is_refused(
    fall: rg.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(rg.OptionError, match=r"an animation is a \.gif or a \.mp4 file"):
        fall.animate(tmp_path / "run.avi")
    for given in ({"fps": 0.0}, {"speed": -1.0}, {"fps": float("nan")}, {"speed": "fast"}):
        with pytest.raises(rg.OptionError):
            fall.animate(tmp_path / "run.gif", **given)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match=r"frames, of at most 3000, .* take speed=0\.0055 or faster"):
        fall.animate(tmp_path / "run.gif", speed=1e-4)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(rg.MissingExtraError, match=r"needs the program ffmpeg.*or write a \.gif"):
        fall.animate(tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_remedy_is_told(
    fall: rg.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for call in (
        lambda: rg.draw(fall.mechanism),
        lambda: fall.strobe(2),
        lambda: fall.animate(tmp_path / "run.gif"),
        lambda: fall.plot("q1", x="q2"),
    ):
        with pytest.raises(rg.MissingExtraError, match="pip install matplotlib"):
            call()
