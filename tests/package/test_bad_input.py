"""Mistakes as a new user makes them: each a typed error that names the culprit and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.io.loader import models_folder

Array = NDArray[np.float64]
Case = tuple[Callable[[], Any], type[rg.RobustGcpError], tuple[str, ...]]
PI = np.pi
NAN = float("nan")
Q = [0.2, -0.2, 0.2]
"""A closed configuration of the rhombus."""

RHOMBUS = rg.load("rhombus")
TIPS = rg.PointClosure("coupler_tip", "rocker_tip")


def refused(case: Case) -> rg.RobustGcpError:
    """The error, which belongs to this package and has all the words in its message."""
    call, kind, words = case
    with pytest.raises(kind) as caught:
        call()
    assert isinstance(caught.value, rg.RobustGcpError)
    message = str(caught.value)
    for word in words:
        assert word in message, message
    return caught.value


def cases(table: dict[str, Case]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("case", [pytest.param(c, id=name) for name, c in table.items()])


def build(closures: Any = (TIPS,), independent: Any = ("q1",), **more: Any) -> rg.Mechanism:
    return rg.Mechanism.from_pinocchio(RHOMBUS.model, closures, independent, **more)


def run(q0: Any = Q, v0: Any = None, **more: Any) -> rg.Trajectory:
    return rg.simulate(RHOMBUS, q0, v0, **({"duration": 0.01, "step": 0.01} | more))


# --------------------------------------------------------------------------- describing a mechanism


def two_frames_of_one_name() -> pin.Model:
    model: pin.Model = linkages.four_bar(1.0, 1.0, 1.0, 1.0).model.copy()
    elsewhere = pin.SE3(np.eye(3), np.array([0.0, 0.3, 0.0]))
    model.addFrame(pin.Frame("q2_tip", 1, elsewhere, pin.FrameType.BODY))
    return model


def with_pendulum() -> pin.Model:
    """A rhombus and, in no loop, a pendulum."""
    model: pin.Model = RHOMBUS.model.copy()
    linkages.add_link(model, 0, -2.0, "pendulum", 1.0)
    return model


def endless() -> pin.Model:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRUBX(), pin.SE3.Identity(), "wheel")
    model.appendBodyToJoint(joint, linkages.rod(1.0), pin.SE3.Identity())
    return model


JOINTS: dict[str, Case] = {
    "misspelt": (
        lambda: build(independent=["q11"]),
        rg.ModelError,
        ("no joint 'q11'", "did you mean 'q1'", "q1, q2, q3"),
    ),
    "of another model": (
        lambda: build(independent=["shoulder"]),
        rg.ModelError,
        ("no joint 'shoulder'", "q1, q2, q3"),
    ),
    "the root": (
        lambda: build(independent=["universe"]),
        rg.ModelError,
        ("'universe'", "q1, q2, q3"),
    ),
    "an index": (lambda: build(independent=[1]), rg.ModelError, ("no joint 1", "q1, q2, q3")),
    "twice": (lambda: build(independent=["q1", "q1"]), rg.ModelError, ("'q1', 'q1'", "twice")),
    "a name, not a list": (lambda: build(independent="q1"), rg.ModelError, ("'q1'", "list")),
    "of two numbers": (
        lambda: rg.simulate(rg.Mechanism.from_pinocchio(endless(), [], ["wheel"])).y,
        rg.PartitionError,
        ("'wheel'", "not all rates of numbers in q", "no coordinates y", "read q and v"),
    ),
    "held in assemble": (
        lambda: RHOMBUS.assemble(Q, hold=["q9"]),
        rg.ModelError,
        ("no joint 'q9'", "q1, q2, q3"),
    ),
    "asked for": (
        lambda: RHOMBUS.velocity_slice("q9"),
        rg.ModelError,
        ("'q9'", "q1, q2, q3"),
    ),
}


@cases(JOINTS)
def test_joint_names(case: Case) -> None:
    refused(case)


PARTITIONS: dict[str, Case] = {
    "too few": (
        lambda: build(independent=[]),
        rg.PartitionError,
        ("structurally singular", "rank 2 for 3", "sets that would serve"),
    ),
    "a joint that no loop holds left dependent": (
        lambda: rg.Mechanism.from_pinocchio(with_pendulum(), [TIPS], ["q1"]),
        rg.PartitionError,
        ("structurally singular", "do not determine 'pendulum'", "sets that would serve"),
    ),
    "two in the loop, the other one free": (
        lambda: rg.Mechanism.from_pinocchio(with_pendulum(), [TIPS], ["q1", "q2"]),
        rg.PartitionError,
        ("'q1', 'q2'", "do not determine 'pendulum'", "sets that would serve"),
    ),
    "too many": (
        lambda: rg.simulate(build(independent=["q1", "q2"]), Q, duration=0.01, step=0.01),
        rg.PartitionError,
        ("2 independent joints", "mobility at q0 is 1", "sets that serve"),
    ),
    "all": (
        lambda: rg.simulate(build(independent=["q1", "q2", "q3"]), Q, duration=0.01, step=0.01),
        rg.PartitionError,
        ("3 independent joints", "mobility at q0 is 1", "sets that serve"),
    ),
}


@cases(PARTITIONS)
def test_partitions(case: Case) -> None:
    """Whatever the error offers is a way out."""
    error = refused(case)
    assert isinstance(error, rg.PartitionError)
    assert error.choices
    model = with_pendulum() if "pendulum" in str(error) else RHOMBUS.model
    for names in error.choices:
        assert " + ".join(names) in str(error)
        mech = rg.Mechanism.from_pinocchio(model, [TIPS], names)
        home = np.array([*Q, *[0.0] * (mech.nq - 3)])
        rg.simulate(mech, home, duration=0.01, step=0.01)


def test_a_structure() -> None:
    """A triangle of two hinged rods has no freedom: there is no set of joints to offer."""
    model = pin.Model()
    first = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, first, 1.0, "q2", 1.0)
    base = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    model.addFrame(pin.Frame("base", 0, base, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(model, [rg.PointClosure("q2_tip", "base")], ["q1"])
    error = refused(
        (
            lambda: rg.simulate(mech, [PI / 3, -2 * PI / 3], duration=0.01, step=0.01),
            rg.PartitionError,
            ("rigid at q0", "leave no joint any freedom", "check the link lengths"),
        )
    )
    assert isinstance(error, rg.PartitionError)
    assert error.choices == []


def test_a_base_that_the_loop_does_not_see() -> None:
    """A four-bar on a swinging base with the base dependent: K_d has full rank while the loop is
    open, and none once it is closed. A start that keeps to its coordinates says so, and names q0; one that
    may change them begins in q0 and q1, and moves as in these from the outset."""
    good = linkages.swinging_four_bar(4.0, 1.0, 3.5, 3.0, swing=0.3, y=1.0)
    bad = good.with_independent(["q1", "q2"])
    with pytest.raises(rg.ToggleError) as caught:
        rg.simulate(bad, duration=0.01, step=0.01, on_toggle="error")
    assert {frozenset(c) for c in caught.value.choices} == {frozenset({"q0", q}) for q in ("q1", "q2", "q3")}
    assert "q1, q2" in str(caught.value).replace("'", "")
    assert "q0 + q1" in str(caught.value)
    begun_better(bad, good)


CLOSURES: dict[str, Case] = {
    "misspelt frame": (
        lambda: build([rg.PointClosure("coupler_tipp", "rocker_tip")]),
        rg.ModelError,
        ("coupler_tipp – rocker_tip", "no frame 'coupler_tipp'", "did you mean 'coupler_tip'"),
    ),
    "second frame of another model": (
        lambda: build([rg.FrameClosure("coupler_tip", "hand")]),
        rg.ModelError,
        ("coupler_tip – hand", "no frame 'hand'"),
    ),
    "two frames of that name": (
        lambda: rg.Mechanism.from_pinocchio(
            two_frames_of_one_name(), [rg.PointClosure("q2_tip", "q3_tip")], ["q1"]
        ),
        rg.ModelError,
        ("'q2_tip'", "q2_tip – q3_tip"),
    ),
    "a frame with itself": (
        lambda: build([rg.PointClosure("rocker_tip", "rocker_tip")]),
        rg.ModelError,
        ("rocker_tip – rocker_tip",),
    ),
    "two frames of one body": (
        lambda: build([rg.PointClosure("coupler", "coupler_tip")]),
        rg.ModelError,
        ("coupler – coupler_tip",),
    ),
    "a pair of names": (
        lambda: build([("coupler_tip", "rocker_tip")]),
        rg.ModelError,
        ("closures[0]", "tuple", "PointClosure"),
    ),
    "not in a list": (lambda: build(TIPS), rg.ModelError, ("closures", "list")),
    "axis zero": (
        lambda: build([rg.RevoluteClosure("coupler_tip", "rocker_tip", axis=(0, 0, 0))]),
        rg.ModelError,
        ("RevoluteClosure", "(0, 0, 0)", "not a direction"),
    ),
    "axis not finite": (
        lambda: build([rg.RevoluteClosure("coupler_tip", "rocker_tip", axis=(NAN, 0, 0))]),
        rg.ModelError,
        ("RevoluteClosure", "nan", "not a direction"),
    ),
    "axis of two numbers": (
        lambda: build([rg.RevoluteClosure("coupler_tip", "rocker_tip", axis=(1, 0))]),  # type: ignore[arg-type]
        rg.ModelError,
        ("RevoluteClosure", "(1, 0)", "not a direction"),
    ),
    "axis by name": (
        lambda: build([rg.RevoluteClosure("coupler_tip", "rocker_tip", axis="x")]),  # type: ignore[arg-type]
        rg.ModelError,
        ("RevoluteClosure", "'x'", "not a direction"),
    ),
}


@cases(CLOSURES)
def test_closures(case: Case) -> None:
    refused(case)


MODELS: dict[str, Case] = {
    "a name for a model": (
        lambda: rg.Mechanism.from_pinocchio("rhombus", [TIPS], ["q1"]),
        rg.ModelError,
        ("'rhombus'", "pin.Model"),
    ),
    "nothing for a model": (
        lambda: rg.Mechanism.from_pinocchio(None, [TIPS], ["q1"]),
        rg.ModelError,
        ("None", "pin.Model"),
    ),
    "home too short": (lambda: build(home=[0.2, -0.2]), rg.StateError, ("home", "(2,)", "(3,)")),
    "home not finite": (lambda: build(home=[0.2, -0.2, NAN]), rg.StateError, ("home[2]", "nan")),
    "home in words": (lambda: build(home="rest"), rg.StateError, ("home", "'rest'", "3 numbers")),
    "a name for a mechanism": (
        lambda: rg.simulate("rhombus", Q),  # type: ignore[arg-type]
        rg.OptionError,
        ("'rhombus'", "load"),
    ),
    "a model for a mechanism": (
        lambda: rg.simulate(RHOMBUS.model, Q),
        rg.OptionError,
        ("Model", "Mechanism"),
    ),
    "a name to analyse": (
        lambda: rg.analyse("rhombus", Q),  # type: ignore[arg-type]
        rg.OptionError,
        ("'rhombus'", "load"),
    ),
}


@cases(MODELS)
def test_models(case: Case) -> None:
    refused(case)


def test_links_without_mass() -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "a")
    model.addJoint(joint, pin.JointModelRX(), pin.SE3.Identity(), "b")
    mech = rg.Mechanism.from_pinocchio(model, name="ghost")
    refused(
        (
            lambda: rg.simulate(mech, duration=0.01, step=0.01),
            rg.SimulationError,
            ("'ghost'", "a, b", "moves no mass", "give its links inertia"),
        )
    )


# --------------------------------------------------------------------------- states


STATES: dict[str, Case] = {
    "q0 too short": (lambda: run([0.2, -0.2]), rg.StateError, ("q0", "(2,)", "(nq,) = (3,)")),
    "q0 a row": (lambda: run([Q]), rg.StateError, ("q0", "(1, 3)", "(nq,) = (3,)")),
    "q0 not a number": (lambda: run([0.2, NAN, 0.2]), rg.StateError, ("q0[1]", "nan", "finite")),
    "q0 infinite": (lambda: run([0.2, -0.2, np.inf]), rg.StateError, ("q0[2]", "inf", "finite")),
    "q0 in words": (lambda: run("rest"), rg.StateError, ("q0", "'rest'", "3 numbers")),
    "q0 of no joint": (lambda: run({"q7": 0.2}), rg.StateError, ("q0", "no joint 'q7'", "q1, q2, q3")),
    "q0 of two numbers": (lambda: run({"q1": [0.2, 1.0]}), rg.StateError, ("q0['q1']", "(1,)")),
    "q0 open": (
        lambda: run([0.2, -0.1, 0.2]),
        rg.ClosureError,
        # the coupler is turned by 0.1 rad: its tip is off by 2 sin 0.05 = 0.1 m, 0.0995 of it up
        ("configuration", "coupler_tip – rocker_tip", "open by 0.0998 m", "mech.assemble"),
    ),
    "q0 typed in degrees": (
        lambda: run([20.0, -20.0, 25.0]),
        rg.ClosureError,
        ("configuration", "coupler_tip – rocker_tip", "mech.assemble"),
    ),
    "v0 too short": (lambda: run(Q, [1.0]), rg.StateError, ("v0", "(1,)", "(nv,) = (3,)")),
    "v0 not a number": (lambda: run(Q, [NAN, 0, 0]), rg.StateError, ("v0[0]", "nan", "finite")),
    "v0 tears the loop": (
        lambda: run(Q, [1.0, 0.0, 0.0]),
        rg.StateError,
        ("velocity", "coupler_tip – rocker_tip", "lift"),
    ),
    "v0 immense": (
        lambda: run(Q, [1e200, -1e200, 1e200]),
        rg.NonFiniteError,
        ("finite",),
    ),
    "analyse open": (
        lambda: rg.analyse(RHOMBUS, [0.2, -0.1, 0.2]),
        rg.ClosureError,
        ("analyse", "coupler_tip – rocker_tip", "mech.assemble"),
    ),
    "analyse not finite": (lambda: rg.analyse(RHOMBUS, [NAN, 0, 0]), rg.StateError, ("q[0]", "nan")),
    "assemble not finite": (
        lambda: RHOMBUS.assemble([0, np.inf, 0]),
        rg.StateError,
        ("q_guess[1]", "inf"),
    ),
    "assemble impossible": (
        lambda: rg.load("crank_rocker").assemble([-0.6, 0.0, -PI / 2], hold=["q3"]),
        rg.ClosureError,
        ("coupler_tip – rocker_tip", "another guess", "hold fewer joints", "link lengths"),
    ),
    "phi": (lambda: RHOMBUS.phi([1.0]), rg.StateError, ("q", "(1,)", "(3,)")),
    "K": (lambda: RHOMBUS.K([1.0, NAN, 0.0]), rg.StateError, ("q[1]", "nan")),
    "k": (lambda: RHOMBUS.k(Q, [1.0]), rg.StateError, ("v", "(1,)", "(3,)")),
    "lift": (lambda: RHOMBUS.lift(Q, [1.0, 2.0]), rg.StateError, ("ydot", "(2,)", "(1,)")),
    "implicit dynamics": (
        lambda: rg.implicit_dynamics(RHOMBUS, Q, [0, 0, 0], [1.0]),
        rg.StateError,
        ("tau", "(1,)", "(3,)"),
    ),
}


@cases(STATES)
def test_states(case: Case) -> None:
    refused(case)


def test_a_closure_error_carries_its_figures() -> None:
    with pytest.raises(rg.ClosureError) as caught:
        run([0.2, -0.1, 0.2])
    assert caught.value.loop == "coupler_tip – rocker_tip"
    # the coupler, level before, now points up by 0.1 rad
    assert caught.value.residual == pytest.approx(np.sin(0.1), abs=1e-12)


def test_a_start_that_rounding_leaves_open_is_polished() -> None:
    """1e-7 m is a start typed to seven digits, not an open loop."""
    traj = run([0.2, -0.2, 0.2 + 1e-7])
    assert traj.closure_error()[0] < 1e-14
    assert traj.q[0, 0] == 0.2


# --------------------------------------------------------------------------- singular starts


AT_ZERO = [0.0, 0.0, 0.0]
STARTS: dict[str, Case] = {
    "at rest, no mode": (
        lambda: run(AT_ZERO),
        rg.SingularStartError,
        ("2 modes meet", "at rest", "mode=", "[1.0, -1.0, 1.0]", "[0.0, 1.0, 1.0]"),
    ),
    "between the modes": (
        lambda: run(AT_ZERO, [1.0, 0.0, 2.0]),  # (1, −1, 1) + (0, 1, 1)
        rg.SingularStartError,
        ("2 modes meet", "none of them", "mode="),
    ),
    "no mode of it": (
        lambda: run(AT_ZERO, mode=[1.0, 0.0, 0.0]),
        rg.OptionError,
        ("mode", "[1.0, -1.0, 1.0]", "[0.0, 1.0, 1.0]"),
    ),
    "mode zero": (lambda: run(AT_ZERO, mode=[0.0, 0.0, 0.0]), rg.OptionError, ("mode", "modes[0]")),
    "mode too short": (lambda: run(AT_ZERO, mode=[1.0, 0.0]), rg.OptionError, ("mode", "(nv,)", "(2,)")),
    "mode by a number of none": (lambda: run(AT_ZERO, mode=7), rg.OptionError, ("mode", "numbered from 0")),
    "mode by letter": (lambda: run(AT_ZERO, mode="a"), rg.OptionError, ("mode", "'a'")),
    "mode not finite": (lambda: run(AT_ZERO, mode=[NAN, -1.0, 1.0]), rg.OptionError, ("mode", "finite")),
    "velocity of another mode": (
        lambda: run(AT_ZERO, [0.0, 1.0, 1.0], mode=[1.0, -1.0, 1.0]),
        rg.StateError,
        ("v0", "mode"),
    ),
    "y rests on the mode": (
        lambda: run(AT_ZERO, mode=[0.0, 1.0, 1.0], on_toggle="error"),
        rg.ToggleError,
        ("q1 stays at rest", "choose independent joints among q2, q3"),
    ),
    "an isolated point": (
        lambda: rg.simulate(stretched(), [0.0, 0.0, PI], duration=0.01, step=0.01),
        rg.NotCertifiedError,
        ("singularity", "isolated"),
    ),
    "a toggle": (
        lambda: rg.simulate(dead_point(), duration=0.01, step=0.01, on_toggle="error"),
        rg.ToggleError,
        ("toggle", "q3 cannot parametrise", "joints that can: ", "q1", "q2"),
    ),
}


def stretched() -> rg.Mechanism:
    """Links 1, 1 and 1 on a ground of 3: assembled in one configuration only."""
    model = pin.Model()
    crank = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, crank, 1.0, "q2", 1.0)
    linkages.add_link(model, 0, 3.0, "q3", 1.0)
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("q2_tip", "q3_tip")], ["q1"])


def dead_point() -> rg.Mechanism:
    """The crank-rocker 4, 1, 3.5, 3 with crank and coupler in line, 4.5 m from pivot to tip."""
    crank = np.arccos((4.0**2 + 4.5**2 - 3.0**2) / (2.0 * 4.0 * 4.5))  # law of cosines
    rocker = PI - np.arccos((4.0**2 + 3.0**2 - 4.5**2) / (2.0 * 4.0 * 3.0))
    flat = rg.load("crank_rocker")
    return rg.Mechanism.from_pinocchio(flat.model, flat.closures, ["q3"], home=[crank, 0.0, rocker])


@cases(STARTS)
def test_singular_starts(case: Case) -> None:
    refused(case)


def begun_better(bad: rg.Mechanism, good: rg.Mechanism, **start: Any) -> rg.Trajectory:
    """The motion of coordinates that cannot begin: logged as changed at 0 s, and that of good ones."""
    changed, motion = (rg.simulate(mech, duration=0.2, step=0.002, **start) for mech in (bad, good))
    assert changed.stats.repartitions == [(0.0, good.independent)]
    np.testing.assert_allclose(changed.q, motion.q, rtol=0.0, atol=1e-10)
    assert np.ptp(motion.q, axis=0).max() > 1e-3
    assert changed.closure_error().max() < 1e-13
    return changed


def test_a_toggle_is_begun_in_better_coordinates() -> None:
    begun_better(dead_point(), dead_point().with_independent(["q2"]))


def test_a_mode_on_which_y_rests_is_begun_in_better_coordinates() -> None:
    """The crank lies folded on the ground and stays there: the coupler and the rocker swing as one."""
    folded = begun_better(RHOMBUS, RHOMBUS.with_independent(["q2"]), q0=AT_ZERO, mode=[0.0, 1.0, 1.0])
    np.testing.assert_allclose(folded["q1"], 0.0, atol=1e-13)
    np.testing.assert_allclose(folded["q2"], folded["q3"], atol=1e-13)


def test_a_mode_that_is_none_of_a_regular_start_is_refused() -> None:
    """Taken silently, the caller would believe to be on the folded mode."""
    refused((lambda: run(Q, mode=[1.0, 0.0, 0.0]), rg.OptionError, ("mode",)))
    run(Q, mode=[1.0, -1.0, 1.0])


# --------------------------------------------------------------------------- options


PULL, SPRING = rg.Wrench("q1", np.zeros(6)), rg.JointSpring("q1", 1.0)

OPTIONS: dict[str, Case] = {
    "step negative": (lambda: run(step=-1e-3), rg.OptionError, ("step = -0.001", "positive")),
    "step zero": (lambda: run(step=0), rg.OptionError, ("step = 0", "positive")),
    "step not a number": (lambda: run(step=NAN), rg.OptionError, ("step = nan", "positive and finite")),
    "step in words": (lambda: run(step="1 ms"), rg.OptionError, ("step = '1 ms'", "number")),
    "step not a value": (lambda: run(step=()), rg.OptionError, ("step = ()", "number")),
    "step beyond the end": (
        lambda: run(step=1.0),
        rg.OptionError,
        ("step = 1.0 s", "longer than the duration = 0.01 s"),
    ),
    "step for ever": (
        lambda: run(duration=1e6, step=1e-9),
        rg.OptionError,
        ("step", "duration"),
    ),
    "duration negative": (lambda: run(duration=-1.0), rg.OptionError, ("duration = -1.0", "positive")),
    "duration infinite": (lambda: run(duration=np.inf), rg.OptionError, ("duration = inf", "finite")),
    "duration a truth value": (lambda: run(duration=True), rg.OptionError, ("duration = True", "number")),
    "method": (
        lambda: run(method="bridges"),
        rg.OptionError,
        ("method = 'bridges'", "bridge, projection, classical, closed_form"),
    ),
    "stepper": (
        lambda: run(stepper="RK4"),
        rg.OptionError,
        ("'RK4'", "'rk4'", "RK23, RK45, DOP853, Radau, BDF, LSODA"),
    ),
    "record": (
        lambda: run(record=("energies",)),
        rg.OptionError,
        ("record = 'energies'", "a, energy, multipliers"),
    ),
    "on_toggle": (lambda: run(on_toggle="go on"), rg.OptionError, ("'go on'", "error, repartition")),
    "newton_start": (
        lambda: run(method="classical", newton_start="guess"),
        rg.OptionError,
        ("newton_start = 'guess'", "tangent, previous"),
    ),
    "rtol": (lambda: run(stepper="RK45", rtol=-1e-8), rg.OptionError, ("rtol = -1e-08", "positive")),
    "atol": (lambda: run(stepper="RK45", atol=NAN), rg.OptionError, ("atol = nan", "finite")),
    "threshold negative": (
        lambda: run(method="projection", threshold=-1.0),
        rg.OptionError,
        ("threshold = -1.0",),
    ),
    "threshold not a number": (
        lambda: run(method="projection", threshold=NAN),
        rg.OptionError,
        ("threshold = nan",),
    ),
    "threshold above one": (
        lambda: run(method="projection", threshold=2.0),
        rg.OptionError,
        ("threshold = 2.0",),
    ),
    "options as a dict": (
        lambda: run(options={"zone": 0.05}),
        rg.OptionError,
        ("options", "BridgeOptions"),
    ),
    "zone negative": (
        lambda: run(options=rg.BridgeOptions(zone=-0.05)),
        rg.OptionError,
        ("zone", "-0.05"),
    ),
    "zone not a number": (
        lambda: run(options=rg.BridgeOptions(zone=NAN)),
        rg.OptionError,
        ("zone", "nan"),
    ),
    "zone above one": (lambda: run(options=rg.BridgeOptions(zone=5.0)), rg.OptionError, ("zone", "5.0")),
    "nodes none": (lambda: run(options=rg.BridgeOptions(nodes=())), rg.OptionError, ("nodes",)),
    "nodes descending": (
        lambda: run(options=rg.BridgeOptions(nodes=(2.2, 1.0))),
        rg.OptionError,
        ("nodes", "ascending"),
    ),
    "closure tolerance zero": (
        lambda: run(options=rg.BridgeOptions(closure_tolerance=0.0)),
        rg.OptionError,
        ("closure_tolerance",),
    ),
    "closed form of two loops": (
        lambda: rg.simulate(linkages.n_four_bar(2), duration=0.01, step=0.01, method="closed_form"),
        rg.OptionError,
        ("closed_form", "planar four-bar", "'n_four_bar_2'"),
    ),
    "closed form in another coordinate": (
        lambda: rg.simulate(
            RHOMBUS.with_independent(["q3"]), Q, duration=0.01, step=0.01, method="closed_form"
        ),
        rg.OptionError,
        ("closed_form", "first joint independent", "'rhombus'"),
    ),
    "torque too short": (lambda: run(torque=[1.0]), rg.StateError, ("torque", "(1,)", "(nv,) = (3,)")),
    "torque not finite": (lambda: run(torque=[NAN, 0, 0]), rg.StateError, ("torque[0]", "nan")),
    "torque in words": (lambda: run(torque="motor"), rg.StateError, ("torque", "'motor'")),
    "torque callable, too short": (
        lambda: run(torque=lambda t, q, v: [1.0]),
        rg.OptionError,
        ("torque(t, q, v)", "(1,)", "(nv,) = (3,)"),
    ),
    "torque callable, nothing": (
        lambda: run(torque=lambda t, q, v: None),
        rg.OptionError,
        ("torque(t, q, v)", "(nv,) = (3,)"),
    ),
    "torque callable, not finite": (
        lambda: run(torque=lambda t, q, v: np.full(3, NAN)),
        rg.NonFiniteError,
        ("torque(t, q, v)", "nan", "t = 0 s"),
    ),
    "torque a wrench": (lambda: run(torque=[PULL]), rg.OptionError, ("torque", "wrench", "wrenches=[...]")),
    "torque a table": (
        lambda: run(torque=np.zeros((10, 3))),
        rg.StateError,
        ("(10, 3)", "(nv,) = (3,)", "a function (t, q, v)", "{joint: number or function}"),
    ),
    "torque by joint, in words": (
        lambda: run(torque={"q1": "x"}),
        rg.StateError,
        ("torque['q1'] = 'x'", "number"),
    ),
    "torque function for a step": (
        lambda: rg.Simulation(RHOMBUS, Q).step(lambda t, q, v: np.zeros(3)),  # type: ignore[arg-type]
        rg.OptionError,
        ("tau", "a step holds numbers", "f(sim.t, sim.q, sim.v)"),
    ),
    "torque function of a joint for a step": (
        lambda: rg.Simulation(RHOMBUS, Q).step({"q1": lambda t, q, v: 0.0}),
        rg.OptionError,
        ("tau", "a step holds numbers"),
    ),
    "frame of a wrench": (
        lambda: run(wrenches=[rg.Wrench(5, np.zeros(6))]),  # type: ignore[arg-type]
        rg.ModelError,
        ("Wrench: frame must be a name, not 5",),
    ),
    "events a number": (
        lambda: run(events=5),
        rg.OptionError,
        ("events must be a list of rg.Event or functions (t, q, v), or a single one, not 5",),
    ),
    "events of numbers": (
        lambda: run(events=[5]),
        rg.OptionError,
        ("events[0] = 5 must be an rg.Event or a function (t, q, v)",),
    ),
    "events a class": (lambda: run(events=rg.Event), rg.OptionError, ("events[0]", "an rg.Event")),
    "mode of a gradient": (
        lambda: rg.gradient(run(), rg.Cost(lambda q, v: q[0]), mode=5),
        rg.OptionError,
        ("mode = 5 names none of the 1 modes",),
    ),
    "four-bar that cannot close": (
        lambda: linkages.four_bar(10.0, 1.0, 1.0, 1.0),
        rg.OptionError,
        ("10.0", "below the others' sum"),
    ),
    "no loops in a row": (lambda: linkages.n_four_bar(0), rg.OptionError, ("n = 0", "at least 1")),
}


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize(
    ("call", "item"),
    [
        (lambda x: run(wrenches=x), PULL),
        (lambda x: run(record=x), {"a": 1}),
        (lambda x: rg.Mechanism.from_pinocchio(RHOMBUS.model, RHOMBUS.closures, ["q1"], forces=x), SPRING),
        (lambda x: rg.Mechanism.from_pinocchio(RHOMBUS.model, x, ["q1"]), RHOMBUS.closures[0]),
        (RHOMBUS.with_independent, "q1"),
        (lambda x: RHOMBUS.assemble(Q, hold=x), "q1"),
        (lambda x: rg.gradient(run(), rg.Cost(lambda q, v: q[0]), parameters=x), "q1.m"),
        (lambda x: rg.BridgeOptions(nodes=x), 1.5),
        (lambda x: rg.sweep(rg.load, x), {"name": "rhombus"}),
        (lambda x: rg.simulate_many(RHOMBUS, x, 0.01), None),
        (lambda x: run().plot(overlay=x), None),
    ],
)
def test_a_list_of_one_is_advised_where_that_one_would_do(call: Any, item: Any, right: bool) -> None:
    """A wrong thing in a list is still wrong."""
    given = item if right else object()
    advised = right and item is not None and item != {"a": 1}
    with pytest.raises(rg.RobustGcpError, match="must be a list of") as caught:
        call(5j if given is None else given)
    assert (f"; write [{given!r}]" in str(caught.value)) == advised
    assert ("write" in str(caught.value)) == advised


@cases(OPTIONS)
def test_options(case: Case) -> None:
    refused(case)


# --------------------------------------------------------------------------- model folders


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the crank-rocker to spoil."""
    for file in (models_folder() / "crank_rocker").iterdir():
        (tmp_path / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    return tmp_path


YAML: dict[str, tuple[dict[str, Any], type[rg.RobustGcpError], tuple[str, ...]]] = {
    "own key misspelt": ({"robust_gcp": {"hom": {}}}, rg.ModelError, ("'hom'", "did you mean 'home'")),
    "own key unknown": ({"robust_gcp": {"colour": 1}}, rg.ModelError, ("'colour'", "home")),
    "own block a list": ({"robust_gcp": ["home"]}, rg.ModelError, ("robust_gcp", "mapping")),
    "schema of the future": (
        {"robust_gcp": {"schema": 9}},
        rg.ModelError,
        ("schema is 9", "reads 1", "update"),
    ),
    "type unknown": ({"type": ["4d"]}, rg.ModelError, ("'4d'", "3d, 6d, revolute")),
    "types too many": ({"type": ["3d", "3d"]}, rg.ModelError, ("type", "1 loops")),
    "types missing": ({"type": None}, rg.ModelError, ("type", "3d, 6d, revolute", "1 loops")),
    "type a word": ({"type": "3d"}, rg.ModelError, ("type", "3d, 6d, revolute")),
    "loop not in pairs": (
        {"closed_loop": ["coupler_tip", "rocker_tip"]},
        rg.ModelError,
        ("closed_loop", "pairs", "'rocker_tip'"),
    ),
    "loop of three": ({"closed_loop": [["a", "b", "c"]]}, rg.ModelError, ("closed_loop", "pairs", "'c'")),
    "frame missing": (
        {"closed_loop": [["coupler_tip", "rocker_tp"]]},
        rg.ModelError,
        ("coupler_tip – rocker_tp", "no frame 'rocker_tp'", "did you mean 'rocker_tip'"),
    ),
    "motors a word": ({"name_mot": "q1"}, rg.ModelError, ("name_mot", "list", "'q1'")),
    "motor unknown": ({"name_mot": ["qq1"]}, rg.ModelError, ("'qq1'", "did you mean 'q1'")),
    "home a list": ({"robust_gcp": {"home": [1, 2, 3]}}, rg.ModelError, ("home", "joint names")),
    "home of no joint": ({"robust_gcp": {"home": {"q7": 1}}}, rg.ModelError, ("'q7'", "q1, q2, q3")),
    "home in words": (
        {"robust_gcp": {"home": {"q1": "1 rad"}}},
        rg.ModelError,
        ("home['q1']", "'1 rad'", "1 finite number"),
    ),
    "home not finite": (
        {"robust_gcp": {"home": {"q1": NAN}}},
        rg.ModelError,
        ("home['q1']", "nan", "finite"),
    ),
    "home of two numbers": (
        {"robust_gcp": {"home": {"q1": [1.0, 2.0]}}},
        rg.ModelError,
        ("home['q1']", "1 finite number"),
    ),
    "home open": (
        {"robust_gcp": {"home": {"q1": 1.0}}},
        rg.ClosureError,
        # q = (1, 0, 0): tips at (4.5 cos 1, 4.5 sin 1) and (7, 0), 4.57 m apart along the ground
        ("home", "coupler_tip – rocker_tip", "open by 4.57 m", "assemble"),
    ),
}


@pytest.mark.parametrize("name", YAML)
def test_yaml_files(folder: Path, name: str) -> None:
    """The file is named in every message, once, and so is what is wrong in it."""
    changes, kind, words = YAML[name]
    path = folder / "robot.yaml"
    settings = yaml.safe_load(path.read_text(encoding="utf-8")) | changes
    kept = {key: value for key, value in settings.items() if value is not None}
    path.write_text(yaml.safe_dump(kept), encoding="utf-8")
    error = refused((lambda: rg.load(folder), kind, words))
    assert str(error).startswith(f"{path}: ")
    assert str(error).count(str(path)) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        pytest.param(b"closed_loop: [[a, b\n", ("cannot be read as YAML", "line 1"), id="syntax"),
        pytest.param(b"- closed_loop\n", ("mapping with closed_loop",), id="a list"),
        pytest.param(b"", ("mapping with closed_loop",), id="empty"),
        pytest.param(b"# \xe9\n{}", ("cannot be read", "utf-8"), id="another encoding"),
    ],
)
def test_yaml_text(folder: Path, text: bytes, words: tuple[str, ...]) -> None:
    path = folder / "robot.yaml"
    path.write_bytes(text)
    refused((lambda: rg.load(folder), rg.ModelError, (str(path), *words)))


def test_missing_files(folder: Path, tmp_path: Path) -> None:
    (folder / "robot.urdf").unlink()
    refused(
        (lambda: rg.load(folder), rg.ModelError, (str(folder), "robot.yaml needs robot.urdf or robot.xml"))
    )
    (folder / "robot.yaml").unlink()
    refused((lambda: rg.load(folder), rg.ModelError, (str(folder), "robot.yaml", "rhombus")))
    refused((lambda: rg.load("rombus"), rg.ModelError, ("'rombus'", "did you mean 'rhombus'", "kite")))
    refused((lambda: rg.load(""), rg.ModelError, ("''", "shipped models")))


# --------------------------------------------------------------------------- URDF


def spoilt(old: str, new: str, count: int = 1) -> str:
    """The crank-rocker's URDF with something replaced."""
    text = (models_folder() / "crank_rocker" / "robot.urdf").read_text(encoding="utf-8")
    assert old in text
    return text.replace(old, new, count)


LIMIT = '<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/>'
URDF: dict[str, tuple[str, tuple[str, ...]]] = {
    "two parents": (
        spoilt(
            "</robot>",
            '<joint name="extra" type="fixed"><parent link="rocker"/><child link="coupler"/></joint></robot>',
        ),
        ("link 'coupler' has two parent joints, 'q2' and 'extra'", "cut the loop", "pair of frames"),
    ),
    "limits in words": (
        spoilt(LIMIT, '<limit lower="low" upper="1" effort="1" velocity="1"/>'),
        ("joint 'q1'", "lower='low'", "write a number"),
    ),
    "parent misspelt": (
        spoilt('<parent link="ground"/>', '<parent link="grund"/>'),
        ("joint 'q1'", "parent link 'grund'"),
    ),
    "parent missing": (spoilt('<parent link="ground"/>', ""), ("joint 'q1'", "parent")),
    "child misspelt": (
        spoilt('<child link="crank"/>', '<child link="cranck"/>'),
        ("joint 'q1'", "child link 'cranck'"),
    ),
    "joint type unknown": (spoilt('type="revolute"', 'type="rotary"'), ("'q1'", "rotary")),
    "two joints of one name": (spoilt('name="q3"', 'name="q2"'), ("'q2'",)),
    "two links of one name": (
        spoilt('<link name="coupler_tip"/>', '<link name="coupler_tip"/>' * 2),
        ("'coupler_tip'",),
    ),
    "a cycle": (
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="x" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="y" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
        ("root",),
    ),
    "two trees": (
        '<robot name="r"><link name="a"/><link name="b"/></robot>',
        ("'a'", "'b'", "root"),
    ),
    "no links": ('<robot name="r"/>', ("link",)),
    "a place in words": (
        spoilt(
            '<child link="rocker"/>\n    <origin xyz="0 4 0"',
            '<child link="rocker"/>\n    <origin xyz="0 four 0"',
        ),
        ("'q3'", "0 four 0"),
    ),
    "a mass in words": (spoilt('<mass value="1"/>', '<mass value="one"/>'), ("'crank'", "one")),
    "an axis of no length": (spoilt('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>'), ("'q1'", "axis")),
    "not XML": ("<robot", ("not well-formed XML",)),
    "another format": ("<mujoco/>", ("<mujoco>", "<robot>")),
}


@pytest.mark.parametrize("name", URDF)
def test_urdf_text(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    text, words = URDF[name]
    refused((lambda: rg.Mechanism.from_urdf(text), rg.ModelError, ("URDF text: ", *words)))


def test_urdf_files(tmp_path: Path) -> None:
    """The file is named."""
    missing, bad = tmp_path / "none.urdf", tmp_path / "bad.urdf"
    bad.write_text(spoilt(LIMIT, "<limit effort='x'/>"), encoding="utf-8")
    refused((lambda: rg.Mechanism.from_urdf(missing), rg.ModelError, (str(missing), "cannot be read")))
    refused((lambda: rg.Mechanism.from_urdf(str(bad)), rg.ModelError, (str(bad), "joint 'q1'")))
    refused((lambda: rg.Mechanism.from_urdf(tmp_path), rg.ModelError, (str(tmp_path), "cannot be read")))


# --------------------------------------------------------------------------- the types themselves


def test_errors_can_be_caught_as_python_means_them() -> None:
    """Under one base, and as ValueError, RuntimeError or ImportError where these are meant."""
    bases = {
        rg.OptionError: ValueError,
        rg.ModelError: ValueError,
        rg.PartitionError: ValueError,
        rg.StateError: ValueError,
        rg.ClosureError: ValueError,
        rg.SimulationError: RuntimeError,
        rg.NonFiniteError: RuntimeError,
        rg.ToggleError: RuntimeError,
        rg.MissingExtraError: ImportError,
    }
    for error, base in bases.items():
        assert issubclass(error, rg.RobustGcpError)
        assert issubclass(error, base)


def test_arrays_and_single_things_where_lists_are_meant() -> None:
    with pytest.raises(rg.ModelError, match="the model has no joint"):
        rg.load("rhombus", independent=np.zeros((2, 2)))  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="wrenches must be a list"):
        rg.Simulation(rg.load("rhombus"), wrenches=3)  # type: ignore[arg-type]
