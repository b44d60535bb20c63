"""Motions drawn by the names of their columns, over time and over each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.axes import Axes

import robust_gcp as rg
from robust_gcp.drawing.figures.motion import COLORS
from robust_gcp.drawing.figures.panels import known_names, units


@pytest.fixture(scope="module")
def driven() -> rg.Trajectory:
    """A slider crank whose crank turns at 5 rad/s from 1 rad."""
    turn = {"q1": rg.Motion(lambda t: 1.0 + 5.0 * t)}
    record = ("a", "energy", "tau", "multipliers")
    return rg.simulate(rg.load("slider_crank"), duration=0.4, step=5e-3, drive=turn, record=record)


def lines(ax: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        str(line.get_label()): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in ax.lines
        if line.get_linestyle() != "None" and len(np.asarray(line.get_xdata())) > 2
    }


def test_every_column_is_drawn_over_time_with_its_unit(driven: rg.Trajectory) -> None:
    units = {"q1": "q [rad]", "q3": "q [m]", "v.q1": "v [rad/s]", "v.q3": "v [m/s]", "a.q3": "a [m/s²]"}
    units |= {"tau.q1": "τ [N m]", "tau.q3": "τ [N]", "drive.q1": "drive [N m]", "work": "work [J]"}
    units |= {name: "λ [N]" for name in driven.columns() if name.startswith("lambda.")}
    assert len(units) > 10
    for name, label in units.items():
        (ax,) = driven.plot(name).axes
        assert ax.get_ylabel() == label
        ((x, y),) = lines(ax).values()
        np.testing.assert_array_equal(x, driven.t)
        np.testing.assert_array_equal(y, driven[name])


def test_so_are_those_of_stops_friction_actuators_and_tendons() -> None:
    plain = rg.load("slider_crank")
    cord = rg.SpatialTendon(["ground", plain.closures[0].frame1])
    belt = rg.FixedTendon({"q1": 0.02})
    mech = rg.Mechanism.from_pinocchio(
        plain.model,
        plain.closures,
        plain.independent,
        plain.home,
        tendons={"cord": cord, "belt": belt},
        actuators=[
            rg.Actuator.motor("motor", "q1"),
            rg.Actuator.motor("winch", cord),
            rg.Actuator("valve", "q3", dynamics="filter", time=(0.1,)),
            rg.Actuator.motor("jet", rg.SiteForce(plain.closures[0].frame1, (0, 0, 0, 1, 0, 0))),
        ],
    )
    parts = [
        rg.Stop("q3", lower=2.6),
        rg.JointFriction("q1", 2.0),
        rg.Lock("q1", other="q2", ratio=2.0, start=0.2),
        rg.Lock("q1", start=0.3),
    ]
    run = rg.simulate(mech, duration=0.1, step=5e-3, joints=parts, ctrl={"motor": 1.0})
    labels = {
        "stop.q3": "stop [N]",
        "friction.q1": "friction [N m]",
        "lock.q1-q2": "lock [N m]",
        "lock.q1": "lock [N m]",
        "dissipated": "dissipated [J]",
        "actuator.motor": "actuator [N m]",
        "actuator.winch": "actuator [N]",
        "actuator.valve": "actuator [N]",
        "activation.valve": "activation [1]",
        "actuator.jet": "actuator [N m]",
        "tendon.cord": "tendon [m]",
        "tendon.belt": "tendon [m or rad]",
    }
    for name, label in labels.items():
        (ax,) = run.plot(name).axes
        assert ax.get_ylabel() == label
    assert set(labels) <= set(run.columns())
    assert run.plot("q3", x="tendon.cord").axes[0].get_xlabel() == "tendon.cord [m]"


def test_several_columns_share_a_panel_where_they_share_quantity_and_unit(driven: rg.Trajectory) -> None:
    figure = driven.plot(["v.q3", "q1", "q2", "energy", "drive.q1"])
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "v [m/s]", "q [rad]", "energy [J]", "drive [N m]",
    ]  # fmt: skip
    assert sorted(lines(figure.axes[1])) == ["q1", "q2"]
    np.testing.assert_array_equal(lines(figure.axes[2])["energy"][1], driven.energy)
    assert driven.plot("energy").axes[0].get_ylabel() == "energy error [J]"


def test_columns_are_drawn_over_another(driven: rg.Trajectory) -> None:
    figure = driven.plot(["drive.q1", "energy"], x="q1")
    torque, energy = figure.axes
    assert energy.get_xlabel() == "q1 [rad]"
    for ax, name in ((torque, "drive.q1"), (energy, "energy")):
        ((x, y),) = lines(ax).values()
        np.testing.assert_array_equal(x, driven["q1"])
        np.testing.assert_array_equal(y, driven[name])
    assert driven.plot("v", x="v.q1").axes[-1].get_xlabel() == "v.q1 [rad/s]"


def test_crossings_and_events_are_marked_on_a_curve_over_another_column() -> None:
    turning = rg.Event(lambda t, q, v: float(v[0]))
    run = rg.simulate(rg.load("rhombus"), duration=1.2, step=5e-3, events=turning)
    (ax,) = run.plot("v.q1", x="q1").axes
    marks = {str(mark.get_label()): mark for mark in ax.lines if mark.get_linestyle() == "None"}
    assert set(marks) == {"crossing", "event"}
    found = np.array(marks["crossing"].get_data()).T
    np.testing.assert_allclose(found[:, 0], [c.q[0] for c in run.crossings], atol=1e-3)
    np.testing.assert_allclose(np.asarray(marks["event"].get_ydata()), 0.0, atol=1e-3)
    assert [text.get_text() for text in ax.figure.legends[0].texts] == ["q1", "crossing", "event"]


def test_what_drives_take_is_in_the_usual_picture(driven: rg.Trajectory) -> None:
    axes = {ax.get_ylabel(): ax for ax in driven.plot().axes}
    np.testing.assert_array_equal(lines(axes["drive [N m]"])["q1"][1], driven["drive.q1"])
    assert list(lines(axes["drive [N m]"])) == ["q1"]
    assert list(lines(axes["τ [N m]"])) == ["q1"]  # nothing acts on the others
    assert "τ [N]" not in axes


def test_a_joint_of_several_numbers_is_drawn_number_by_number() -> None:
    run = rg.simulate(rg.load("stewart"), duration=0.01, step=5e-3)
    axes = run.plot(["platform", "v.platform", "platform.qw"]).axes
    drawn = {ax.get_ylabel(): sorted(lines(ax)) for ax in axes}
    assert drawn["q [m]"] == [f"platform.{c}" for c in "xyz"]
    assert drawn["v [rad/s]"] == [f"platform.r{c}" for c in "xyz"]
    with pytest.raises(
        rg.OptionError, match=r"x = 'platform' has several numbers; use one of q\.platform\.x"
    ):
        run.plot("q", x="platform")


def test_numbers_of_a_floating_base_have_colours_of_their_own() -> None:
    """Beside few joints, and beside so many that the others are told apart by shade alone."""
    few = rg.simulate(rg.load("stewart"), duration=0.01, step=5e-3)
    for joints in (["platform"], ["platform", "leg1", "leg2", "leg1_x"], "all"):
        figure = few.plot(("q", "v"), joints=joints)
        colors = {
            str(line.get_label()): line.get_color()
            for ax in figure.axes
            for line in ax.lines
            if str(line.get_label()).startswith("platform")
        }
        assert len(colors) == 10 == len(set(map(str, colors.values())))
    assert {text.get_text() for text in figure.legends[0].texts} >= set(colors)
    assert len(set(COLORS)) == len(COLORS) == 20


def test_names_that_are_no_column_are_refused_with_what_there_is(driven: rg.Trajectory) -> None:
    bare = rg.simulate(rg.load("slider_crank"), duration=0.02, step=5e-3)
    for name, words in (
        ("q9", "what = 'q9' is unknown; quantities are q, v, .*; 'q9' is not in this motion; its joints"),
        ("a.q1", r'accelerations were not recorded: simulate with record=\("a",\)'),
        ("tau.q1", r'simulate with record=\("tau",\)'),
        ("lambda.x", r'simulate with record=\("multipliers",\)'),
        ("drive.q1", "no joint is driven"),
        ("drive", r"no joint that is drawn is driven; simulate with drive=\{joint: Motion\}"),
    ):
        with pytest.raises(rg.OptionError, match=words):
            bare.plot(name)
        if name != "drive":
            with pytest.raises(rg.OptionError, match=words.rpartition("; ")[2]):
                bare.plot("q", x=name)
    with pytest.raises(rg.OptionError, match=r'simulate with record=\("energy",\)'):
        bare.plot(["energy", "q1"])
    with pytest.raises(rg.OptionError, match=r"overlay = 'drive\.q1' is unknown"):
        driven.plot("drive.q1", overlay=bare)
    with pytest.raises(rg.OptionError, match="x = 3 must be the name of a column"):
        driven.plot("q1", x=3)  # type: ignore[arg-type]


def test_known_names_are_those_that_can_be_drawn(driven: rg.Trajectory, tmp_path: Path) -> None:
    names = known_names(driven.mechanism)
    assert set(names) >= {*driven.columns(), *driven.mechanism.joint_names}
    drawable = [name for name in names if not name.startswith(("drive.q2", "drive.q3"))]
    assert all(driven.plot(name).axes for name in drawable[::4])
    (tmp_path / "arm.xml").write_text(
        """<mujoco><option><flag contact="disable"/></option><worldbody><body>
        <joint name="q" axis="0 1 0" range="-40 20"/><geom size="0.1" pos="1 0 0"/>
        </body></worldbody><actuator><motor name="m" joint="q"/></actuator></mujoco>"""
    )
    arm = rg.load(tmp_path / "arm.xml", limits=True)
    assert set(known_names(arm)) >= {"stop.q", "dissipated", "actuator.m"}


def test_a_column_picture_is_written(driven: rg.Trajectory, tmp_path: Path) -> None:
    driven.plot("drive.q1", tmp_path / "torque.pdf", x="q1")
    assert (tmp_path / "torque.pdf").read_bytes().startswith(b"%PDF")


def test_the_title_stands_above_the_names_of_constraint_forces(driven: rg.Trajectory) -> None:
    figure = driven.plot("multipliers")
    figure.draw_without_rendering()
    ax = figure.axes[0]
    names, title = ax.get_legend(), ax._left_title  # type: ignore[attr-defined]
    assert names is not None and not names.get_window_extent().overlaps(title.get_window_extent())
    assert title.get_window_extent().y1 <= figure.bbox.height


def test_the_unit_of_a_stop_is_that_of_the_joint_whose_whole_name_it_has() -> None:
    model = pin.Model()
    for name, joint in (("a", pin.JointModelPX()), ("a-b", pin.JointModelRX())):
        at = model.addJoint(0, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, [], ["a", "a-b"])
    known = units(mech, ["stop.a", "stop.a-b", "friction.a-a-b"])
    assert [known[name][1] for name in ("stop.a", "stop.a-b", "friction.a-a-b")] == ["N", "N m", "N"]
