"""Stops, actuators, tendons, sensors and steps from anything: an answer, or an error of ours.

FUZZ_EXAMPLES=5000 pytest tests/package/test_fuzz_parts.py searches longer than CI does.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robust_gcp as rg

from .test_fuzz_calls import ANY, FUZZ, NUMBERS, vectors

Accepted = Callable[[Callable[[], object]], object]
SHARE = settings(FUZZ, max_examples=max(1, FUZZ.max_examples // 2))
"""For what takes steps."""

RHOMBUS = rg.load("rhombus")
NAMES = st.sampled_from(("q1", "q2", "q3", "coupler_tip", "rocker_tip", "universe", "crank"))
WORDS = NAMES | NAMES | ANY
SMALL = st.floats(-2.0, 2.0) | st.integers(-2, 2)
NUMBER = SMALL | SMALL | NUMBERS | ANY
PAIR = st.tuples(SMALL, SMALL) | st.tuples(NUMBER, NUMBER) | st.lists(NUMBER, max_size=3) | st.none() | ANY
PAIRS = st.lists(st.tuples(WORDS, NUMBER), max_size=2).map(tuple) | st.dictionaries(NAMES, SMALL, max_size=2)
POINT = st.lists(SMALL, min_size=3, max_size=3) | vectors((3, 4, 6))
FUNCTIONS = st.sampled_from(
    (
        lambda t, q, v: q[0] - 0.1,
        lambda t, q, v: np.sin(100.0 * t),
        lambda t, q, v: None,
        lambda t, q, v: np.nan,
        lambda t, q, v: np.zeros(3),
    )
)
TABLES = st.tuples(st.lists(NUMBER, max_size=3), st.lists(NUMBER, max_size=3)) | st.just(([0.0, 1.0], [0, 2]))

ARGUMENTS: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("joint", "other", "frame", "frame1", "frame2", "site", "name"), WORDS),
    **dict.fromkeys(("crank", "slider", "reference", "reaction", "side"), WORDS | st.none()),
    **dict.fromkeys(("more", "coefficients"), PAIRS | ANY),
    **dict.fromkeys(
        ("ctrl_range", "force_range", "activation_range", "shared_range", "length_range", "range"), PAIR
    ),
    "dynamics": st.sampled_from(("none", "integrator", "filter", "muscle")) | ANY,
    "shape": st.sampled_from(("sphere", "cylinder")) | ANY,
    "time": st.lists(st.floats(0.0, 1.0), max_size=3) | NUMBER | vectors((1, 2, 3)),
    **dict.fromkeys(("gain", "bias"), st.lists(NUMBER, max_size=4) | NUMBER),
    "when": FUNCTIONS | st.none() | ANY,
    "position": POINT,
    "rotation": st.just(np.eye(3).tolist()) | vectors((3, 9)) | ANY,
    "rest": st.just((0.0, 0.0, 0.0, 1.0)) | vectors((4, 3)) | SMALL,
    "gear": vectors((3, 6)) | NUMBER,
    "elements": st.lists(NAMES, max_size=4) | st.lists(WORDS, max_size=4) | ANY,
    "weights": st.dictionaries(NAMES, st.tuples(NUMBER, POINT), max_size=2)
    | st.lists(st.tuples(WORDS, NUMBER, POINT), max_size=2)
    | ANY,
    "in_parent": st.booleans() | ANY,
    "wrench": vectors((6,)) | FUNCTIONS,
    "muscle": st.none() | ANY,
    "path": WORDS,
}
"""By the name of the parameter; all others are numbers."""

JOINTS = st.sampled_from(("q1", "q2", "q3"))
FRAMES = st.sampled_from(("coupler_tip", "rocker_tip", "universe"))
RANGE = st.none() | st.tuples(st.floats(-3.0, 0.0), st.floats(0.1, 3.0))
TAME: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("joint", "other", "path"), JOINTS),
    **dict.fromkeys(("frame", "frame1", "frame2", "site", "crank", "slider"), FRAMES),
    **dict.fromkeys(("reference", "side"), st.none() | FRAMES),
    "reaction": st.none(),
    "name": st.sampled_from(("a", "b", "c", "d")),
    "more": st.just(()) | st.tuples(st.tuples(JOINTS, SMALL)),
    "coefficients": st.dictionaries(JOINTS, SMALL, min_size=1, max_size=3),
    **dict.fromkeys(("ctrl_range", "force_range", "activation_range", "shared_range"), RANGE),
    **dict.fromkeys(("length_range", "range"), st.just((0.1, 2.0))),
    "dynamics": st.just("none"),
    "time": st.just(()),
    "shape": st.sampled_from(("sphere", "cylinder")),
    **dict.fromkeys(("gain", "bias"), st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=3)),
    "when": FUNCTIONS,
    "upper": st.floats(0.5, 2.0),
    "lower": st.floats(-2.0, 0.3),
    "elements": st.lists(FRAMES, min_size=2, max_size=3),
    "weights": st.dictionaries(FRAMES, st.tuples(st.floats(0.0, 1.0), st.just([0.0, 0.1, 0.2])), min_size=1),
    "muscle": st.none(),
    "gear": st.floats(-2.0, 2.0),
}
"""The same, as they may well be; all others are between 0 and 1."""

PATHS: dict[str, Callable[..., Any]] = {
    kind.__name__: kind
    for kind in (rg.FixedTendon, rg.TurningJoint, rg.SpatialTendon, rg.SiteForce, rg.SliderCrank)
}
PARTS: dict[str, Callable[..., Any]] = {
    "Stop": rg.Stop,
    "JointFriction": rg.JointFriction,
    "Lock": rg.Lock,
}
FORCES: dict[str, Callable[..., Any]] = {
    kind.__name__: kind
    for kind in (rg.JointSpring, rg.TendonSpring, rg.BallSpring, rg.GravityCompensation, rg.JointDamper)
}
ACTUATORS: dict[str, Callable[..., Any]] = {
    "Actuator": rg.Actuator,
    "motor": rg.Actuator.motor,
    "position": rg.Actuator.position,
    "velocity": rg.Actuator.velocity,
}
OTHERS: dict[str, Callable[..., Any]] = {
    "Muscle": rg.Muscle,
    "Pulley": rg.Pulley,
    "Wrap": rg.Wrap,
    "Wrench": rg.Wrench,
    "Event": rg.Event,
}


def arguments(data: st.DataObject, make: Callable[..., Any], tame: bool = False) -> dict[str, Any]:
    """What a constructor is given; tame: most of it as it may well be."""
    found: dict[str, Any] = {}
    for parameter in inspect.signature(make).parameters.values():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        if parameter.default is not parameter.empty and data.draw(st.integers(0, 2)):
            continue
        strategy = ARGUMENTS.get(parameter.name, NUMBER)
        if tame and data.draw(st.integers(0, 9)):
            strategy = TAME.get(parameter.name, st.floats(0.0, 1.0))
        found[parameter.name] = data.draw(strategy, parameter.name)
    return found


def made(data: st.DataObject, kinds: dict[str, Callable[..., Any]], accepted: Accepted) -> Any:
    """One of some kinds, or None where it was refused."""
    make = kinds[data.draw(st.sampled_from(sorted(kinds)))]
    given_ = arguments(data, make, bool(data.draw(st.integers(0, 3))))
    if "path" in given_ and data.draw(st.booleans()):
        path = made(data, PATHS, accepted)
        given_["path"] = given_["path"] if path is None else path
    if given_.get("muscle", 0) is None:
        given_["muscle"] = made(data, {"Muscle": rg.Muscle}, accepted)
    if "elements" in given_ and isinstance(given_["elements"], list):
        kinds = {"Pulley": rg.Pulley, "Wrap": rg.Wrap}
        between = [made(data, kinds, accepted) for _ in range(data.draw(st.integers(0, 2)))]
        given_["elements"][1:1] = [x for x in between if x is not None]
    return accepted(lambda: make(**given_))


def several(data: st.DataObject, kinds: dict[str, Callable[..., Any]], accepted: Accepted) -> Any:
    """A few of them; now and then something else among them, or in their place."""
    found = [made(data, kinds, accepted) for _ in range(data.draw(st.integers(0, 3)))]
    found = [x for x in found if x is not None]
    if not data.draw(st.integers(0, 19)):
        return data.draw(ANY | st.just([*found, object()]))
    return found


@pytest.mark.parametrize("kind", sorted(PARTS | PATHS | FORCES | ACTUATORS | OTHERS))
@SHARE
@given(data=st.data())
def test_constructors(kind: str, data: st.DataObject, accepted: Accepted) -> None:
    """What is accepted is shown and compared with itself."""
    one = made(data, {kind: (PARTS | PATHS | FORCES | ACTUATORS | OTHERS)[kind]}, accepted)
    if one is not None:
        repr(one), hash(one) if type(one).__hash__ else None
        assert one == one


def machine(data: st.DataObject, accepted: Accepted) -> Any:
    """The rhombus with actuators, tendons and forces of any kind."""
    tendons: Any = {name: made(data, PATHS, accepted) for name in data.draw(st.sets(NAMES, max_size=2))}
    if data.draw(st.integers(0, 9)):
        tendons = {name: path for name, path in tendons.items() if path is not None}
    more = {
        "actuators": several(data, ACTUATORS, accepted),
        "forces": several(data, FORCES, accepted),
        "tendons": tendons if data.draw(st.integers(0, 9)) else data.draw(ANY),
    }
    return accepted(
        lambda: rg.Mechanism.from_pinocchio(RHOMBUS.model, RHOMBUS.closures, ["q1"], [0.4, -0.4, 0.4], **more)
    )


def controls(data: st.DataObject, mechanism: rg.Mechanism) -> Any:
    names = [actuator.name for actuator in mechanism.actuators]
    values = SMALL | NUMBER | FUNCTIONS | TABLES
    if names and data.draw(st.integers(0, 2)):
        return data.draw(st.dictionaries(st.sampled_from(names), SMALL | FUNCTIONS, max_size=3))
    by_name = st.dictionaries(st.sampled_from([*names, "q9"]), values, max_size=3)
    return data.draw(by_name | st.lists(SMALL, min_size=len(names), max_size=len(names)) | st.none() | ANY)


@SHARE
@given(data=st.data())
def test_runs_of_anything(data: st.DataObject, accepted: Accepted) -> None:
    """A mechanism that was accepted moves with its loops closed, or says why not."""
    mechanism = machine(data, accepted)
    if not isinstance(mechanism, rg.Mechanism):
        return
    more = {
        "ctrl": controls(data, mechanism),
        "joints": several(data, PARTS, accepted) if data.draw(st.booleans()) else None,
        "hold": data.draw(st.booleans()),
        "backend": data.draw(st.sampled_from(("auto", "python"))),
    }
    run = accepted(lambda: rg.simulate(mechanism, duration=4e-3, step=1e-3, **more))
    if isinstance(run, rg.Trajectory):
        assert np.all(np.isfinite(run.q)) and run.closure_error().max() < 1e-9
        accepted(run.columns)
        accepted(run.energy_error)


@SHARE
@given(data=st.data())
def test_steps_of_anything(data: st.DataObject, accepted: Accepted) -> None:
    mechanism = RHOMBUS if data.draw(st.booleans()) else machine(data, accepted)
    if not isinstance(mechanism, rg.Mechanism):
        return
    joints = several(data, PARTS, accepted) if data.draw(st.booleans()) else None
    sim = accepted(lambda: rg.Simulation(mechanism, step=1e-3, joints=joints, ctrl=controls(data, mechanism)))
    for _ in range(3 if isinstance(sim, rg.Simulation) else 0):
        tau = data.draw(vectors((3,)) | st.none() | st.dictionaries(NAMES, NUMBER, max_size=2))
        n, ctrl = data.draw(st.integers(1, 3) | ANY), controls(data, mechanism)
        if isinstance(n, int) and n > 10:
            n = 10
        accepted(lambda tau=tau, n=n, ctrl=ctrl: sim.step(tau, n, ctrl=ctrl))  # type: ignore[union-attr]
        accepted(lambda: sim.now)  # type: ignore[union-attr]
        accepted(lambda: sim[data.draw(WORDS)])  # type: ignore[index]


@FUZZ
@given(data=st.data())
def test_single_steps_and_points(data: st.DataObject, accepted: Accepted) -> None:
    def mostly(sound: st.SearchStrategy[Any], other: st.SearchStrategy[Any]) -> Any:
        return data.draw(sound if data.draw(st.integers(0, 7)) else other)

    q = mostly(st.sampled_from(([0.4, -0.4, 0.4], [[0.4, -0.4, 0.4]] * 2, [0.0, 0.0, 0.0])), vectors((3,)))
    v = mostly(st.sampled_from((None, [1.0, -1.0, 1.0], [[1.0, -1.0, 1.0]] * 2)), vectors((3,)))
    tau = mostly(st.none() | st.lists(SMALL, min_size=3, max_size=3), vectors((3,)) | FUNCTIONS)
    h, t = mostly(st.floats(1e-4, 1e-2), NUMBER), mostly(SMALL, ANY)
    mode = mostly(st.none() | st.just([1.0, -1.0, 1.0]), vectors((3,)))
    jacobians, threads = mostly(st.booleans(), ANY), mostly(st.integers(1, 2), st.integers(-1, 2) | ANY)
    accepted(lambda: rg.step(RHOMBUS, q, v, tau, h, jacobians, mode, t, threads))
    given_ = arguments(data, rg.motion_point) | {"mechanism": RHOMBUS, "q": q}
    accepted(lambda: rg.motion_point(**given_))
    parts = several(data, PARTS, accepted)
    accepted(lambda: RHOMBUS.impact(q, RHOMBUS.home if v is None else v, parts))


SENSED = rg.Mechanism.from_mjcf(
    """<mujoco><option><flag contact="disable"/></option><worldbody><site name="post"/>
    <body><joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="1 0 0"/><site name="tip" pos="1 0 0"/>
    </body>
    <body><joint name="ball" type="ball"/><geom size="0.1"/></body></worldbody>
    <tendon><spatial name="rope"><site site="post"/><site site="tip"/></spatial></tendon>
    <actuator><motor name="spin" joint="hinge"/><motor name="turn" joint="ball" gear="1 0 0"/>
    <general name="lag" tendon="rope" dyntype="filter" dynprm="0.1"/></actuator>
    <sensor><gyro name="gyro" site="tip"/><force name="force" site="tip"/>
    <tendonpos name="length" tendon="rope"/><actuatorfrc name="pull" actuator="lag"/>
    <jointactuatorfrc name="drive" joint="hinge"/></sensor></mujoco>"""
)


@SHARE
@given(data=st.data())
def test_sensors(data: st.DataObject, accepted: Accepted) -> None:
    tame = bool(data.draw(st.integers(0, 2)))
    known = st.sampled_from(sorted(SENSED.sensors))
    name = data.draw(known if tame else known | WORDS)
    q = data.draw(st.just(SENSED.home) if tame else st.just(SENSED.home) | vectors((SENSED.nq,)))
    rates = st.none() | st.lists(SMALL, min_size=SENSED.nv, max_size=SENSED.nv)
    v, a, tau = (data.draw(rates if tame else rates | vectors((SENSED.nv,))) for _ in range(3))
    ctrl, t = controls(data, SENSED), data.draw(SMALL if tame else SMALL | ANY)
    read = accepted(lambda: SENSED.sense(name, q, v, a, tau, t, ctrl))
    assert read is None or isinstance(read, np.ndarray)
