"""What a torque function may do and return: the same by every backend, stepper and map."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]
Torque = Callable[[float, Array, Array], Any]

WAYS = {
    "rk4": {"backend": "python"},
    "kernel": {"backend": "native"},
    "kernel, classical": {"backend": "native", "method": "classical"},
    "DOP853": {"stepper": "DOP853"},
    "Radau, whose Jacobian asks for torques": {"stepper": "Radau"},
    "LSODA, projection": {"stepper": "LSODA", "method": "projection"},
    "closed form": {"method": "closed_form"},
}


@pytest.fixture(params=WAYS)
def way(request: pytest.FixtureRequest) -> dict[str, Any]:
    options: dict[str, Any] = WAYS[request.param]
    if options.get("backend") == "native" and not rg.backends()["native"].available:
        pytest.skip(f"no compiled kernel: {rg.backends()['native'].reason}")
    return options


def run(torque: Torque, way: dict[str, Any], mechanism: rg.Mechanism | None = None) -> rg.Trajectory:
    """A start at the singular configuration's side, through it at some 0.1 s."""
    record = ("a", "energy", "multipliers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rg.SingularityWarning)  # classical GCP says so itself
        return rg.simulate(
            mechanism or rg.load("rhombus"), [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], 0.2, 4e-3,
            torque=torque, record=record, **way,
        )  # fmt: skip


def pure(t: float, q: Array, v: Array) -> Array:
    return np.array([0.3 * np.sin(20.0 * t) - 0.1 * v[0], 0.2 * q[1], 0.0])


SHARED = np.zeros(3)


def spoils_its_arguments(t: float, q: Array, v: Array) -> Array:
    tau = pure(t, q, v)
    q[:], v[:] = np.nan, 1e9
    return tau


def returns_its_argument(t: float, q: Array, v: Array) -> Array:
    v[:] = pure(t, q, v)
    return v


def uses_one_array(t: float, q: Array, v: Array) -> Array:
    SHARED[:] = pure(t, q, v)
    return SHARED


def cannot_be_written(t: float, q: Array, v: Array) -> Array:
    tau = pure(t, q, v)
    tau.flags.writeable = False
    return tau


class SpoilsItsLastResult:
    """What was returned belongs to the function, which writes to it later."""

    def __init__(self) -> None:
        self.last = np.zeros(3)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        self.last[:] = 1e5
        self.last = pure(t, q, v)
        return self.last


class KeepsItsArguments:
    """States that were handed over stay what they were."""

    def __init__(self) -> None:
        self.kept: list[tuple[Array, Array]] = []

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        assert all(q is not a and v is not b for a, b in self.kept)
        self.kept.append((q, v))
        return pure(t, q, v)


class UsesTheMechanism:
    """As a controller does, which asks for the mechanism's matrices and simulates ahead."""

    def __init__(self, mechanism: rg.Mechanism) -> None:
        self.mechanism, self.calls, self.rng = mechanism, 0, np.random.default_rng(5)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        m, elsewhere = self.mechanism, self.rng.uniform(-1.0, 1.0, 3)
        m.K(elsewhere), m.phi(elsewhere), m.k(elsewhere, v + 1.0), m.energy(elsewhere, v)
        m.tree.crba(elsewhere), m.tree.rnea(elsewhere, v, v), m.assemble([0.3, -0.3, 0.3])
        self.calls += 1
        if self.calls % 60 == 0:
            rg.simulate(m, [0.3, -0.3, 0.3], duration=0.01, step=2e-3)
        return pure(t, q, v)


@pytest.mark.parametrize(
    "torque",
    [
        spoils_its_arguments,
        returns_its_argument,
        uses_one_array,
        cannot_be_written,
        SpoilsItsLastResult(),
        KeepsItsArguments(),
        lambda t, q, v: pure(t, q, v).tolist(),
        lambda t, q, v: np.asfortranarray(np.array([pure(t, q, v)] * 2).T)[:, 0],
        UsesTheMechanism,
    ],
)
def test_what_a_function_does_with_its_arrays_is_its_own_affair(
    torque: Torque | type[UsesTheMechanism], way: dict[str, Any]
) -> None:
    mechanism = rg.load("rhombus")
    function = torque(mechanism) if isinstance(torque, type) else torque
    found, wanted = run(function, way, mechanism), run(pure, way)
    for name in ("q", "v", "a", "energy", "multipliers", "work"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)


class NoArray:
    def __array__(self, *args: object, **kwargs: object) -> Array:
        raise RuntimeError("the tensor is on another device")


RETURNED = {
    "complex numbers": np.array([1.0 + 0j, 0.0, 0.0]),
    "a list of complex numbers": [1j, 0.0, 0.0],
    "masked values": np.ma.masked_array([1.0, 2.0, 3.0], [False, True, False]),
    "an array that may be masked": np.ma.masked_array([1.0, 2.0, 3.0]),
    "words": ["1", "2", "3"],
    "an array of words": np.array(["1", "2", "3"]),
    "bytes": b"123",
    "truths": [True, False, True],
    "times": np.array(["2001-01-01"] * 3, dtype="M8[D]"),
    "durations": np.array([1, 2, 3], dtype="m8[s]"),
    "records": np.zeros(3, dtype=[("a", float)]),
    "nothing": None,
    "nothing inside": [1.0, None, 2.0],
    "a matrix": np.zeros((3, 1)),
    "one number": 1.0,
    "too few": [1.0, 2.0],
    "ragged": [1.0, [2.0], 3.0],
    "a generator": (x for x in (1.0, 2.0, 3.0)),
    "a set": {1.0, 2.0, 3.0},
    "a mapping": {"q1": 1.0},
    "integers too large": [10**400, 0, 0],
    "no array": NoArray(),
}


@pytest.mark.parametrize("name", RETURNED)
def test_what_is_no_list_of_torques_is_refused(name: str, way: dict[str, Any]) -> None:
    with pytest.raises(rg.OptionError, match=r"torque\(t, q, v\) returned"):
        run(lambda t, q, v: RETURNED[name], way)


@pytest.mark.parametrize("name", RETURNED)
def test_constant_torques_are_held_to_the_same(name: str, way: dict[str, Any]) -> None:
    if RETURNED[name] is not None and name != "a mapping":  # which gives joints by name
        with pytest.raises(rg.StateError, match="torque"):
            run(RETURNED[name], way)  # type: ignore[arg-type]


@pytest.mark.parametrize("late", [0.0, 0.05])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_torques_without_a_value_stop_the_run(value: float, late: float, way: dict[str, Any]) -> None:
    """With the motion until then, whatever takes the steps."""
    with pytest.raises(rg.SimulationError, match=r"returned|no headway") as caught:
        run(lambda t, q, v: [value if t >= late else 0.0, 0.0, 0.0], way)
    assert len(caught.value.trajectory.t) <= 1 + late / 4e-3 + 1


@pytest.mark.parametrize("error", [ZeroDivisionError("mine"), KeyboardInterrupt(), SystemExit(3)])
def test_errors_of_the_function_are_passed_on(error: BaseException, way: dict[str, Any]) -> None:
    def fails(t: float, q: Array, v: Array) -> Array:
        if t > 0.05:
            raise error
        return pure(t, q, v)

    with pytest.raises(type(error)) as caught:
        run(fails, way)
    assert caught.value is error


@pytest.mark.parametrize("error", [ZeroDivisionError("mine"), KeyboardInterrupt(), SystemExit(3)])
def test_errors_of_progress_are_passed_on(error: BaseException, way: dict[str, Any]) -> None:
    def fails(fraction: float) -> None:
        if fraction > 0.5:
            raise error

    with pytest.raises(type(error)) as caught:
        rg.simulate(rg.load("rhombus"), [0.5, -0.5, 0.5], duration=0.1, progress=fails, **way)
    assert caught.value is error


def test_linearise_holds_torques_to_the_same() -> None:
    mechanism = rg.load("rhombus")
    for name, value in RETURNED.items():
        with pytest.raises(rg.OptionError, match=r"torque\(t, q, v\) returned"):
            rg.linearise(mechanism, [0.5, -0.5, 0.5], torque=lambda t, q, v, value=value: value)
        if value is not None and name != "a mapping":  # which gives joints by name
            if isinstance(value, dict):
                continue  # by joint name
            with pytest.raises(rg.StateError, match="torque"):
                rg.linearise(mechanism, [0.5, -0.5, 0.5], torque=value)
    plain = rg.linearise(mechanism, [0.5, -0.5, 0.5], torque=pure).A
    for torque in (spoils_its_arguments, returns_its_argument, UsesTheMechanism(mechanism)):
        np.testing.assert_array_equal(rg.linearise(mechanism, [0.5, -0.5, 0.5], torque=torque).A, plain)


def test_derivatives_under_one_say_what_is_wrong_where_the_kernel_answers_no_state() -> None:
    mech = rg.load("rhombus")
    rg.derivatives(mech, np.zeros(3), [1.0, -1.0, 1.0])  # the kernel knows the place from here on
    with pytest.raises(rg.ToggleError, match="choose independent joints among q2, q3"):
        rg.derivatives(mech, [0.0, 1e-5, 1e-5], [0.0, 1.0, 1.0], lambda t, q, v: -v)
