"""Every public call with arguments by the thousand: a finite answer or an error of ours."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robust_gcp as rg
from robust_gcp.examples import linkages

FUZZ = settings.get_profile("fuzz")
SHARE = settings(FUZZ, max_examples=FUZZ.max_examples // 4)
"""For what is asked of nine functions each."""

Accepted = Callable[[Callable[[], object]], object]
Sane = Callable[[rg.Mechanism], None]

MECHANISMS = {name: rg.load(name) for name in ("rhombus", "five_bar", "flyball", "stewart", "bricard")}
ANY = st.one_of(
    *(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.binary(max_size=3)),
    st.sampled_from((10**400, 1j, np.array(1.0), np.array(["a"]), np.array([[1.0]]), {"q1": 1}, object())),
    st.sampled_from((np.float32(0.1), np.int8(3), np.datetime64("2020"), "bridge", "rk4", "q1")),
)
NUMBERS = st.floats() | st.floats(-4.0, 4.0) | st.sampled_from((0.0, np.pi, 1e-9, 1e300, 5e-324, 10**400))


def vectors(sizes: tuple[int, ...]) -> st.SearchStrategy[Any]:
    """Lists of numbers, arrays of other kinds and shapes, and anything else."""
    masked = st.just(np.ma.masked_array([1.0] * sizes[0], mask=True))
    lists = [st.lists(NUMBERS, min_size=n, max_size=n) for n in sizes]
    small = [st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n) for n in sizes]
    nested = st.lists(st.lists(NUMBERS), max_size=2)
    return st.one_of(*lists, *small, masked, st.lists(ANY, max_size=4), ANY, nested)


def finite(value: object) -> bool:
    """All numbers in arrays, tuples and results are finite."""
    if isinstance(value, tuple | list):
        return all(map(finite, value))
    if isinstance(value, rg.LocalAnalysis):
        return finite([value.singular_values, value.kernel, value.left_kernel, value.forms, value.modes])
    if isinstance(value, rg.Trajectory):
        return finite([value.t, value.q, value.v, value.a, value.energy, value.multipliers])
    return value is None or bool(np.all(np.isfinite(np.asarray(value, dtype=float))))


STATE = tuple(sorted({size for m in MECHANISMS.values() for size in (m.nq, m.nv, m.m)}))
QUESTIONS: dict[str, Callable[..., object]] = {
    "phi": lambda m, a, b, c: m.phi(a),
    "K": lambda m, a, b, c: m.K(a),
    "k": lambda m, a, b, c: m.k(a, b),
    "lift": lambda m, a, b, c: m.lift(a, b),
    "energy": lambda m, a, b, c: m.energy(a, b),
    "assemble": lambda m, a, b, c: m.assemble(a),
    "analyse": lambda m, a, b, c: rg.analyse(m, a),
    "implicit_dynamics": lambda m, a, b, c: rg.implicit_dynamics(m, a, b, c),
    "inverse_dynamics": lambda m, a, b, c: rg.inverse_dynamics(m, a, b, c),
}


@pytest.mark.parametrize("question", QUESTIONS)
@SHARE
@given(name=st.sampled_from(sorted(MECHANISMS)), data=st.data())
def test_states(question: str, name: str, data: st.DataObject, accepted: Accepted) -> None:
    """Sizes that fit this mechanism half the time, home and its neighbourhood in most of those."""
    m = MECHANISMS[name]
    q = st.just(m.home) | st.floats(-1e-3, 1e-3).map(lambda d: m.home + d) | vectors((m.nq,)) | vectors(STATE)
    v = st.just(np.zeros(m.nv)) | vectors((m.nv, m.m)) | vectors(STATE)
    a, b, c = data.draw(q), data.draw(v), data.draw(vectors((m.nv, m.m)) | vectors(STATE))
    assert finite(accepted(lambda: QUESTIONS[question](m, a, b, c)))


@pytest.mark.parametrize("question", QUESTIONS)
@SHARE
@given(scale=st.floats(-300.0, 308.0), name=st.sampled_from(sorted(MECHANISMS)), data=st.data())
def test_states_of_any_size(
    question: str, scale: float, name: str, data: st.DataObject, accepted: Accepted
) -> None:
    """Shapes are right and numbers run from 1e-300 to 1e308: the answer is finite, or there is none."""
    m = MECHANISMS[name]
    if m.nq != m.nv:
        return
    sized = st.floats(-1.0, 1.0).map(lambda x: x * 10.0**scale)
    q = data.draw(st.just(m.home) | st.lists(sized, min_size=m.nq, max_size=m.nq))
    v = data.draw(st.lists(sized, min_size=m.nv, max_size=m.nv))
    c = v if question == "implicit_dynamics" else v[: m.m]
    answer = accepted(lambda: QUESTIONS[question](m, q, c if question == "lift" else v, c))
    assert finite(answer)


ARGUMENTS: dict[str, st.SearchStrategy[Any]] = {
    "q0": vectors((3,)) | st.just([0.2, -0.2, 0.2]) | st.just([0.0, 0.0, 0.0]),
    "v0": vectors((3,)) | NUMBERS.map(lambda s: [s, -s, s] if isinstance(s, float) else s),
    "duration": NUMBERS | ANY,
    "step": NUMBERS | ANY,
    "method": st.sampled_from(("bridge", "projection", "classical", "closed_form")) | ANY,
    "stepper": st.sampled_from(("rk4", "RK23", "DOP853", "Radau", "BDF", "LSODA")) | ANY,
    "torque": vectors((3,)) | ANY | vectors((3,)).map(lambda tau: lambda t, q, v: tau),
    "record": st.lists(st.sampled_from(("a", "energy", "multipliers")) | ANY, max_size=3) | ANY,
    "mode": vectors((3,)) | st.just([1, -1, 1]),
    "rtol": NUMBERS | ANY,
    "atol": NUMBERS | ANY,
    "on_toggle": st.sampled_from(("error", "repartition")) | ANY,
    "newton_start": st.sampled_from(("previous", "tangent")) | ANY,
    "threshold": NUMBERS | ANY,
    "options": ANY,
    "progress": ANY | st.just(lambda fraction: None),
}


@FUZZ
@given(data=st.data(), names=st.lists(st.sampled_from(sorted(ARGUMENTS)), min_size=1, max_size=3))
def test_simulate(data: st.DataObject, names: list[str], accepted: Accepted) -> None:
    """Up to three arguments are anything, the others sound; at most some hundred steps are made."""
    given_ = {"duration": 2e-3, "step": 1e-3} | {name: data.draw(ARGUMENTS[name], name) for name in names}
    try:
        if float(given_["duration"]) / float(given_["step"]) > 300.0:
            given_["duration"] = 10.0 * float(given_["step"])
    except (TypeError, ValueError, ArithmeticError):
        pass  # to be refused
    run = accepted(lambda: rg.simulate(MECHANISMS["rhombus"], **given_))
    assert finite(run)
    if isinstance(run, rg.Trajectory):
        assert run.closure_error().max() < 1e-12
        assert run.velocity_error().max() <= 1e-9 * (1.0 + np.abs(run.v).max())


@FUZZ
@given(kind=st.sampled_from([f.name for f in dataclasses.fields(rg.BridgeOptions)]), data=st.data())
def test_bridge_options(kind: str, data: st.DataObject, accepted: Accepted) -> None:
    value = data.draw(NUMBERS | ANY | st.lists(NUMBERS | st.floats(1.0, 4.0), max_size=6))
    options = accepted(lambda: rg.BridgeOptions(**{kind: value}))
    if isinstance(options, rg.BridgeOptions):
        assert finite(
            accepted(
                lambda: rg.simulate(
                    MECHANISMS["rhombus"], [0.03, -0.03, 0.03], [-9, 9, -9], 0.02, 2e-3, options=options
                )
            )
        )


FORCES: tuple[Callable[..., object], ...] = (
    *(rg.JointSpring, rg.JointDamper, rg.JointTorque, rg.PointSpring),
    *(rg.PointClosure, rg.FrameClosure, rg.RevoluteClosure),
)
WORDS = st.sampled_from(("q1", "q2", "q3", "coupler_tip", "rocker_tip", "universe", "crank", "")) | ANY


@FUZZ
@given(
    kinds=st.lists(st.sampled_from(FORCES) | ANY, max_size=3),
    words=st.lists(WORDS, min_size=9, max_size=9),
    numbers=st.lists(NUMBERS | ANY, min_size=9, max_size=9),
    independent=st.just(["q1"]) | st.lists(WORDS, max_size=3) | WORDS,
    home=vectors((3,)) | st.none(),
    more=st.none() | ANY | st.lists(ANY, max_size=2),
)
def test_from_pinocchio(
    kinds: list[Any],
    words: list[Any],
    numbers: list[Any],
    independent: Any,
    home: Any,
    more: Any,
    accepted: Accepted,
    require_sane: Sane,
) -> None:
    """Closures and forces between anything and anything."""
    some = iter(words), iter(numbers)

    def made(kind: Any) -> object:
        if kind not in FORCES:
            return kind
        name_count = 1 if kind in FORCES[:3] else 2
        count = {rg.PointSpring: 2, rg.PointClosure: 0, rg.FrameClosure: 0}.get(kind, 1)
        return kind(*itertools.islice(some[0], name_count), *itertools.islice(some[1], count))

    parts = [part for kind in kinds if (part := accepted(lambda k=kind: made(k)) if callable(kind) else kind)]
    closures = [part for part in parts if not isinstance(part, FORCES[:4])]  # type: ignore[arg-type]
    forces = [part for part in parts if not any(part is other for other in closures)]
    mechanism = accepted(
        lambda: rg.Mechanism.from_pinocchio(
            MECHANISMS["rhombus"].model, closures, independent, home, forces=forces if more is None else more
        )
    )
    if isinstance(mechanism, rg.Mechanism):
        require_sane(mechanism)


@pytest.mark.filterwarnings("ignore:.*rows of loops that others imply up to rounding:robust_gcp.ModelWarning")
@FUZZ
@given(data=st.data())
def test_models(data: st.DataObject, accepted: Accepted, require_sane: Sane) -> None:
    """A model whose numbers are spoilt after it was made."""
    rhombus = MECHANISMS["rhombus"]
    model, number = rhombus.model.copy(), data.draw(NUMBERS.filter(lambda x: isinstance(x, float)))
    joint, along = data.draw(st.integers(1, 3)), np.zeros(3)
    along[data.draw(st.integers(0, 2))] = number
    places = ("mass", "lever", "inertia", "place", "turn", "gravity", "armature", "frame")
    what = data.draw(st.sampled_from(places))
    body, place = model.inertias[joint], model.jointPlacements[joint]
    if what == "mass":
        body.mass = number
    elif what == "lever":
        body.lever = along
    elif what == "inertia":
        model.inertias[joint] = pin.Inertia(body.mass, body.lever, np.diag(np.abs(along)))
    elif what == "place":
        place.translation = along
    elif what == "turn":
        place.rotation = np.diag(np.full(3, number))
    elif what == "gravity":
        model.gravity.linear = along
    elif what == "armature":
        model.armature = along
    else:
        model.frames[model.getFrameId("coupler_tip")].placement.translation = along
    home = data.draw(st.sampled_from((rhombus.home, None)))
    made = accepted(lambda: rg.Mechanism.from_pinocchio(model, rhombus.closures, ["q1"], home))
    if isinstance(made, rg.Mechanism):
        require_sane(made)


@FUZZ
@given(lengths=st.lists(NUMBERS, min_size=4, max_size=4), y=NUMBERS, data=st.data())
def test_scenes(
    lengths: list[Any], y: Any, data: st.DataObject, accepted: Accepted, require_sane: Sane
) -> None:
    masses = data.draw(st.just((1.0, 1.0, 1.0)) | st.lists(NUMBERS, max_size=4))
    made = accepted(lambda: linkages.four_bar(*lengths, y=y, masses=masses))
    if isinstance(made, rg.Mechanism):
        require_sane(made)
