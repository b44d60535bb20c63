"""Pictures of motions, mechanisms and modes show the numbers they are made from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pinocchio as pin
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.drawing.figures import style
from robust_gcp.drawing.figures.mechanism import face_on, pose
from robust_gcp.drawing.figures.style import BLACK
from robust_gcp.examples.linkages import n_four_bar

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def fall() -> rg.Trajectory:
    """The rhombus from rest, through q = 0 at 0.1857 s and (−π, π, −π) at 0.9503 s."""
    return rg.simulate(rg.load("rhombus"), duration=1.0, step=5e-3, record=("a", "energy"))


@pytest.fixture(scope="module")
def rhombus_modes() -> rg.ConfigurationSpace:
    return rg.trace_modes(rg.load("rhombus"), seeds=0)


def labels(axes: list[Axes]) -> list[str]:
    return [ax.get_ylabel() for ax in axes]


def plane(figure: Figure, joint: str) -> Axes:
    """The flat panel whose vertical axis is the joint's."""
    return next(ax for ax in figure.axes if ax.name == "rectilinear" and ax.get_ylabel().startswith(joint))


def curves(ax: Axes) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in ax.lines if not line.get_label().startswith("_")}


# --------------------------------------------------------------------------- motions


def test_panels_are_those_for_which_there_is_data(fall: rg.Trajectory) -> None:
    full = ["q [rad]", "v [rad/s]", "a [rad/s²]", "energy error [J]", "max |φ| [m]"]
    assert labels(fall.plot().axes) == full
    bare = rg.Trajectory(fall.mechanism, fall.t, fall.q, fall.v)
    assert labels(bare.plot().axes) == [full[0], full[1], full[4]]
    tree = rg.simulate(rg.load("flyball"), duration=1e-4, step=1e-5)
    assert not any("φ" in label for label in labels(tree.plot().axes))


def test_panels_asked_for_come_in_the_usual_order(fall: rg.Trajectory) -> None:
    assert labels(fall.plot(("closure", "v")).axes) == ["v [rad/s]", "max |φ| [m]"]
    assert labels(fall.plot("energy").axes) == ["energy error [J]"]


def test_lines_are_the_trajectory(fall: rg.Trajectory) -> None:
    figure = fall.plot()
    q, v, a, energy, closure = figure.axes
    for ax, values in ((q, fall.q), (v, fall.v), (a, fall.a)):
        drawn = curves(ax)
        np.testing.assert_array_equal(np.array([drawn[f"q{i}"] for i in (1, 2, 3)]).T, values)
    np.testing.assert_array_equal(energy.lines[0].get_ydata(), fall.energy_error())
    np.testing.assert_allclose(closure.lines[0].get_ydata(), fall.closure_error(), atol=1e-16)
    assert closure.get_yscale() == "log"
    assert figure.axes[-1].get_xlabel() == "t [s]"


def test_crossings_are_marked_in_every_panel_and_named_once(fall: rg.Trajectory) -> None:
    figure = fall.plot()
    times = [crossing.time for crossing in fall.crossings]
    assert len(times) == 2
    for ax in figure.axes:
        marks = [
            line.get_xdata()[0]
            for line in ax.lines
            if line.get_linestyle() == "--" or len(line.get_xdata()) == 2
        ]
        assert sorted(marks) == times
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.texts] == ["q1", "q2", "q3", "crossing"]


def test_events_are_marked_as_crossings_are() -> None:
    """In every panel at the times of `t_events`, named as numbered there; one that never was is not."""

    def level(t: float, q: Array, v: Array) -> float:
        return float(q[0] + np.pi / 2)

    def turning(t: float, q: Array, v: Array) -> float:
        return float(v[0])

    def never(t: float, q: Array, v: Array) -> float:
        return 1.0

    rhombus = rg.load("rhombus")
    run = rg.simulate(rhombus, duration=1.2, step=5e-3, events=[level, turning, never])
    assert len(run.t_events[0]) > 0 < len(run.t_events[1])
    figure = run.plot()
    for ax in figure.axes:
        marks: dict[str, list[float]] = {}
        for line in ax.lines:
            if len(line.get_xdata()) == 2:
                marks.setdefault(line.get_label(), []).append(line.get_xdata()[0])
        wanted = [c.time for c in run.crossings], *run.t_events[:2]
        assert marks == dict(zip(("crossing", "event 0", "event 1"), map(list, wanted), strict=True))
    names = [text.get_text() for text in figure.legends[0].texts]
    assert names == ["q1", "q2", "q3", "crossing", "event 0", "event 1"]
    alone = rg.simulate(rhombus, duration=0.6, step=5e-3, events=level)
    named = [text.get_text() for text in run.plot("q", overlay=alone).legends[0].texts]
    assert named[-2:] == ["event 0", "event 1"]
    assert [text.get_text() for text in alone.plot("q").legends[0].texts][-1] == "event"


@pytest.fixture(scope="module")
def bouncing() -> rg.Trajectory:
    """A slider-crank whose slide falls on a stop, and rubs at its crank until it rests there."""
    mech = rg.load("slider_crank")
    stop = rg.Stop("q3", lower=float(mech.home[2]) - 0.25, restitution=0.5)
    return rg.simulate(mech, duration=4.0, step=2e-3, joints=[stop, rg.JointFriction("q1", 2.0)])


def test_happenings_are_marked_by_their_kind(bouncing: rg.Trajectory) -> None:
    """One thin line in every panel at each time, over a column one marker; kinds named once."""
    kinds: dict[str, list[float]] = {}
    for happening in bouncing.happenings:
        kinds.setdefault(happening.kind, []).append(happening.time)
    assert set(kinds) >= {"impact", "hold", "at rest"}
    figure = bouncing.plot(("q", "energy"))
    for ax in figure.axes:
        marks: dict[str, list[float]] = {}
        for line in ax.lines:
            if line.get_label() in kinds:
                marks.setdefault(line.get_label(), []).append(line.get_xdata()[0])
        assert marks == kinds
    names = [text.get_text() for text in figure.legends[0].texts]
    assert names == ["q1", "q2", "q3", "impact", "hold", "at rest"]
    over = bouncing.plot("q3", x="q1")
    impacts = next(line for line in over.axes[0].lines if line.get_label() == "impact")
    np.testing.assert_allclose(impacts.get_ydata(), bouncing.mechanism.home[2] - 0.25, atol=1e-6)


def test_joints_with_other_units_have_panels_of_their_own() -> None:
    run = rg.simulate(rg.load("slider_crank"), duration=0.05, step=5e-3)
    axes = run.plot(("q", "v")).axes
    assert labels(axes) == ["q [rad]", "q [m]", "v [rad/s]", "v [m/s]"]
    assert [sorted(curves(ax)) for ax in axes] == [["q1", "q2"], ["q3"]] * 2
    colors = [line.get_color() for ax in axes[:2] for line in ax.lines]
    assert len(set(colors)) == 3


def test_a_joint_with_many_numbers_is_drawn_number_by_number() -> None:
    run = rg.simulate(rg.load("stewart"), duration=0.01, step=5e-3)
    panels = {
        ax.get_ylabel(): {
            name.removeprefix("platform.") for name in curves(ax) if name.startswith("platform")
        }
        for what in "qv"
        for ax in run.plot(what, joints="all").axes
    }
    assert panels == {
        "q [rad]": set(),
        "q [m]": set("xyz"),
        "q [1]": {"qx", "qy", "qz", "qw"},
        "v [rad/s]": {"rx", "ry", "rz"},
        "v [m/s]": set("xyz"),
    }


def test_the_legend_of_many_joints_stays_short() -> None:
    run = rg.simulate(n_four_bar(20), duration=0.02, step=1e-2)
    figure = run.plot("q", joints="all")
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.texts]
    joints = run.mechanism.joint_names
    assert legend.get_title().get_text() == f"{len(joints)} numbers, such as"
    assert len(names) <= 10 and {names[0], names[-1]} == {joints[0], joints[-1]}
    figure.draw_without_rendering()
    inside = legend.get_window_extent()
    assert inside.y0 >= 0.0 and inside.x1 <= figure.bbox.width + 1.0


def test_of_many_joints_the_independent_ones_are_drawn_unless_others_are_named() -> None:
    run = rg.simulate(rg.load("stewart"), duration=0.01, step=5e-3)
    (ax,) = run.plot("q").axes
    assert set(curves(ax)) == set(run.mechanism.independent)
    (legend,) = ax.figure.legends
    assert legend.get_title().get_text() == "independent of 19 joints"
    axes = run.plot(("q", "v"), joints=["leg1", "platform.rx", "leg1_x"]).axes
    drawn = {ax.get_ylabel(): set(curves(ax)) for ax in axes}
    assert drawn == {
        "q [rad]": {"leg1_x"},
        "q [m]": {"leg1"},
        "v [rad/s]": {"leg1_x", "platform.rx"},
        "v [m/s]": {"leg1"},
    }
    assert set(curves(run.plot("v", joints="leg2").axes[0])) == {"leg2"}


@pytest.mark.parametrize("joints", (["leg9"], [], "platform.w"))
def test_joints_that_are_none_are_refused(joints: object) -> None:
    run = rg.simulate(rg.load("stewart"), duration=0.01, step=5e-3)
    with pytest.raises(rg.OptionError, match=r"joints = .*leg1_x, .*or \"all\""):
        run.plot(joints=joints)


def test_runs_are_overlaid_in_the_same_colours(fall: rg.Trajectory) -> None:
    other = rg.simulate(fall.mechanism, [0.3, -0.3, 0.3], duration=0.5, step=5e-3)
    figure = fall.plot(("q", "closure"), overlay=other)
    ax = figure.axes[0]
    lines = [line for line in ax.lines if line.get_label() == "q2"]
    assert [line.get_linestyle() for line in lines] == ["-", "--"]
    assert lines[0].get_color() == lines[1].get_color()
    np.testing.assert_array_equal(lines[1].get_ydata(), other.q[:, 1])
    names = [text.get_text() for text in figure.legends[0].texts]
    assert names == ["q1", "q2", "q3", "run 1", "run 2", "crossing"]
    named = fall.plot("q", overlay={"from 0.3 rad": other}).legends[0]
    assert [text.get_text() for text in named.texts][3:5] == ["this run", "from 0.3 rad"]
    with pytest.raises(rg.OptionError, match="mechanism with other joints"):
        fall.plot(overlay=rg.simulate(rg.load("andrews"), duration=1e-3, step=1e-3))


def test_constraint_forces_are_drawn_by_their_rows(fall: rg.Trajectory) -> None:
    run = rg.simulate(rg.load("bricard"), duration=0.02, step=1e-2, record="multipliers")
    axes = run.plot("multipliers").axes
    assert labels(axes) == ["λ [N]", "λ [N m]"]
    drawn = curves(axes[0]) | curves(axes[1])
    assert {f"lambda.{name}" for name in drawn} == {n for n in run.columns() if n.startswith("lambda")}
    for name, values in drawn.items():
        np.testing.assert_array_equal(values, run[f"lambda.{name}"])
    with pytest.raises(rg.OptionError, match=r'simulate with record=\("multipliers",\)'):
        fall.plot("multipliers")
    tree = rg.simulate(rg.load("flyball"), duration=1e-4, step=1e-5, record="multipliers")
    with pytest.raises(rg.OptionError, match="no constraint forces"):
        tree.plot("multipliers")


@pytest.mark.parametrize(
    ("what", "words"),
    [("speed", "what = 'speed' is unknown"), ((), "what is empty"), (("q", "lambda"), "'lambda' is unknown")],
)
def test_other_panels_are_refused(fall: rg.Trajectory, what: object, words: str) -> None:
    with pytest.raises(rg.OptionError, match=words):
        fall.plot(what)  # type: ignore[arg-type]


def test_accelerations_that_were_not_recorded_are_asked_for(fall: rg.Trajectory) -> None:
    bare = rg.Trajectory(fall.mechanism, fall.t, fall.q, fall.v)
    with pytest.raises(rg.OptionError, match=r'simulate with record=\("a",\)'):
        bare.plot("a")


def test_figures_are_written_and_shown(fall: rg.Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "new" / "motion.png"
    figure = fall.plot("q", path)
    assert matplotlib.image.imread(path).shape[1] == round(style.WIDTH * style.DPI)
    assert figure._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(rg.OptionError, match=r"a figure is a \.png or a \.pdf file"):
        fall.plot("q", tmp_path / "motion.jpg")


# --------------------------------------------------------------------------- mechanisms


@pytest.mark.parametrize("name", ["rhombus", "kite", "slider_crank", "strandbeest", "andrews"])
def test_planar_mechanisms_are_seen_in_true_length(name: str) -> None:
    m = rg.load(name)
    view = face_on(m)
    np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-12)
    run = rg.simulate(m, duration=2e-3, step=1e-4)
    first, last = (pose(m, run.q[i], view) for i in (0, -1))
    for a, b in zip(first.bodies, last.bodies, strict=True):
        for p in (a, b):
            assert p.shape == a.shape
        gaps = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (a, b)]
        np.testing.assert_allclose(gaps[0], gaps[1], atol=1e-10)


def test_up_is_against_gravity_and_space_is_seen_obliquely() -> None:
    m = rg.load("rhombus")
    np.testing.assert_allclose(face_on(m), [[0, 1, 0], [0, 0, 1]], atol=1e-12)
    view = face_on(rg.load("bricard"))
    assert np.linalg.matrix_rank(view) == 2 and np.all(np.abs(view).max(axis=1) < 1.0)
    np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-12)


def test_links_of_the_rhombus_meet_where_they_should() -> None:
    m = rg.load("rhombus")
    for q1 in (0.2, 1.0, 2.5):
        at = pose(m, [q1, -q1, q1], face_on(m))
        A, B = np.array([np.cos(q1), np.sin(q1)]), np.array([1.0 + np.cos(q1), np.sin(q1)])
        crank, coupler, rocker = at.bodies
        np.testing.assert_allclose(crank, [[0, 0], A], atol=1e-12)
        np.testing.assert_allclose(coupler, [A, B], atol=1e-12)
        np.testing.assert_allclose(rocker, [[1, 0], B], atol=1e-12)
        np.testing.assert_allclose(at.pivots, [[0, 0], [1, 0]], atol=1e-12)
        assert at.order == (0, 2, 1)


def test_a_slider_has_a_guide() -> None:
    m = rg.load("slider_crank")
    (guide,) = pose(m, m.home, face_on(m)).guides
    assert np.linalg.norm(guide[1] - guide[0]) == pytest.approx(m.home[2], rel=1e-12)


# --------------------------------------------------------------------------- modes


def test_each_mode_and_each_singular_point_is_drawn(rhombus_modes: rg.ConfigurationSpace) -> None:
    figure = rg.plot_modes(rhombus_modes)
    panels = [ax for ax in figure.axes if ax.get_ylabel().endswith("[rad]") and ax.name == "rectilinear"]
    assert labels(panels) == ["q2 [rad]", "q3 [rad]"]
    for ax, joint in zip(panels, (1, 2), strict=True):
        markers = [line for line in ax.lines if line.get_marker() == "o"]
        drawn = {tuple(np.cos(np.ravel(line.get_data())).round(9)) for line in markers}
        assert drawn == {tuple(np.cos(p.q[[0, joint]]).round(9)) for p in rhombus_modes.singular_points}
        assert {text.get_text() for text in ax.texts} == {"a", "b", "c"}
    titles = [ax.get_title() for ax in figure.axes]
    assert [t for t in titles if t] == ["mode a", "mode b", "mode c"]
    assert figure.get_suptitle() == "rhombus: 3 modes, 3 singular points"


def test_tangents_at_singular_points_are_those_of_analyse(rhombus_modes: rg.ConfigurationSpace) -> None:
    ax = plane(rg.plot_modes(rhombus_modes), "q2")
    drawn = []
    for line in ax.lines:
        if line.get_alpha() is not None:
            x, y = line.get_data()
            drawn.append(
                tuple(np.round([np.cos(np.mean(x)), np.cos(np.mean(y)), x[1] - x[0], y[1] - y[0]], 6))
            )
    for point in rhombus_modes.singular_points:
        for t in point.modes:
            way = 0.6 * np.pi * t / np.abs(t).max()
            assert tuple(np.round([np.cos(point.q[0]), np.cos(point.q[1]), way[0], way[1]], 6)) in drawn
    assert len(drawn) == 6


@pytest.mark.parametrize("name", ["rhombus", "change_point", "slider_crank"])
def test_curves_stay_on_the_open_torus_and_lose_no_row(name: str) -> None:
    space = rg.trace_modes(rg.load(name), seeds=0)
    ax = plane(rg.plot_modes(space), "q2")
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for line in ax.lines:
        if line.get_alpha() is None and line.get_marker() == "None":
            x, y = line.get_data()
            assert np.abs(np.diff(x)).max() < 0.2 and np.abs(np.diff(y)).max() < 0.2  # no jump across
            inner = slice(1, -1)
            assert np.all((x[inner] >= left) & (x[inner] <= right) & (y[inner] >= low) & (y[inner] <= high))
    rows = sum(len(mode.q) for mode in space.modes)
    drawn = sum(len(line.get_xdata()) for line in ax.lines if line.get_alpha() is None)
    assert drawn >= rows


def test_a_mode_that_crosses_itself_is_shown_in_its_two_parts() -> None:
    figure = rg.plot_modes(rg.load("change_point"))
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert titles == ["mode a, in part"] * 2
    assert figure.get_suptitle() == "change_point: 1 mode, 1 singular point"


def texts_apart(figure: Figure, texts: list[Text]) -> None:
    """No two of the texts, drawn, cover each other."""
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in texts if text.get_text()]
    for i, one in enumerate(boxes):
        assert all(not one.overlaps(other) for other in boxes[:i])


@pytest.mark.slow
def test_many_modes_stay_readable() -> None:
    """Captions beside each other, each letter in the colour of its curve, modes that look different."""
    space = rg.trace_modes(rg.load("andrews"))
    figure = rg.plot_modes(space)
    small = [ax for ax in figure.axes if ax.get_title().startswith("mode")]
    assert len(small) == 4
    texts_apart(figure, [ax.xaxis.label for ax in small])
    assert {ax.get_xlabel() for ax in small} == {"turns: beta\N{NO-BREAK SPACE}+1, theta\N{NO-BREAK SPACE}−1"}
    (cube,) = [ax for ax in figure.axes if ax.name == "3d"]
    assert [text.get_text() for text in cube.texts] == ["a", "b", "c", "d"]
    named = {text.get_text(): text.get_color() for text in cube.texts}
    assert set(named.values()) == {line.get_color() for line in cube.lines} and len(set(named.values())) == 4
    for ax in figure.axes:
        if ax.name == "rectilinear" and ax.get_ylabel().endswith("[rad]"):
            pairs = [text.get_text() for text in ax.texts]
            assert sorted(", ".join(pairs).split(", ")) == ["a", "b", "c", "d"]
            assert all(text.get_color() == BLACK for text in ax.texts)  # two curves each
            texts_apart(figure, list(ax.texts))
    assert figure.get_suptitle() == "andrews: 4 assembly modes, no singular points"


def test_two_coordinates_make_one_panel(rhombus_modes: rg.ConfigurationSpace, tmp_path: Path) -> None:
    figure = rg.plot_modes(rhombus_modes, tmp_path / "modes.png", coordinates=("q3", "q1"))
    (panel,) = [ax for ax in figure.axes if ax.get_xlabel().endswith("[rad]")]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("q3 [rad]", "q1 [rad]")
    assert matplotlib.image.imread(tmp_path / "modes.png").std() > 0.02


@pytest.mark.parametrize("names", [("q1",), ("q1", "q1"), ("q1", "q9"), ("q1", "q2", "q3", "q1")])
def test_other_coordinates_are_refused(rhombus_modes: rg.ConfigurationSpace, names: tuple[str, ...]) -> None:
    with pytest.raises(rg.OptionError, match="two or three different joints"):
        rg.plot_modes(rhombus_modes, coordinates=names)


def test_the_command_lists_and_draws_the_modes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "modes.png"
    assert main(["modes", "rhombus", "--seeds", "0", "--dpi", "60", "--out", str(path)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for words in ("a closed, turns (1, -1, 1)", "q = (3.14159, -3.14159, 3.14159)", "mode b along (0, 1, 1)"):
        assert words in out
    assert matplotlib.image.imread(path).shape[1] == round(60 * style.WIDTH)
    assert main(["modes", "five_bar"]) == 2
    assert "one degree of freedom" in capsys.readouterr().err


# --------------------------------------------------------------------------- Matplotlib


def test_missing_matplotlib_names_the_extra(fall: rg.Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for draw in (fall.plot, lambda: rg.plot_modes(rg.load("rhombus"))):
        with pytest.raises(rg.MissingExtraError, match=r'pip install "\.\[viz\]"'):
            draw()


def test_importing_the_package_loads_no_drawing_library() -> None:
    code = "import sys, robust_gcp; print([m for m in ('matplotlib', 'tqdm') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_mechanism_without_hinges_has_a_view() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    m = rg.Mechanism.from_pinocchio(model)
    assert face_on(m).shape == (2, 3)


def test_lines_are_wide_only_below_others() -> None:
    """A crank-rocker's joints move each in its own way; in a rhombus q1 and q3 are one line."""
    for name, wide in (("crank_rocker", 0), ("rhombus", 1)):
        figure = rg.simulate(rg.load(name), duration=0.5).plot("q")
        widths = [line.get_linewidth() for line in figure.axes[0].lines if len(line.get_xdata()) > 2]
        assert len(widths) == 3
        assert sum(width > min(widths) for width in widths) == wide
