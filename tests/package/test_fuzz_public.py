"""Every public function and method with anything in place of its arguments: an answer, or an error of ours.

FUZZ_EXAMPLES=5000 pytest tests/package/test_fuzz_public.py searches longer than CI does.
"""

from __future__ import annotations

import inspect
import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

COUNT = int(os.environ.get("FUZZ_EXAMPLES", "0")) or 400
PARTS = 4

MECHANISMS = [rg.load("rhombus"), rg.load("kite"), rg.load("stewart")]
RHOMBUS = MECHANISMS[0]
RUN = rg.simulate(RHOMBUS, duration=0.05, step=5e-3, record=("a", "energy", "multipliers"))

HOLDERS = (
    *(
        "Records",
        "RunRecord",
        "Failure",
        "Stats",
        "Crossing",
        "Backend",
        "LocalAnalysis",
        "Linearisation",
        "ModeCurve",
    ),
    *("ConfigurationSpace", "Trajectory", "ReplayPage", "FrameMotion", "Reaction", "Sample", "Recommended"),
    *("Acted", "Derivatives", "Gradient", "Regressor"),
)
"""They hold what they are given, and are made by this package alone."""

ABSTRACT = ("Force",)
"""Nobody makes one: Python itself says what a class derived from it lacks."""

INNER = (
    *("scaled", "select_rows", "close_loops", "polish", "require_closed"),
    *(
        "generic_configurations",
        "state",
        "of",
        "joint_at",
        "from_contents",
        "velocities_of",
        "choose",
        "velocities_named",
    ),
)
"""Methods for the package's own solvers, which hand over what has been checked."""


class BadRepr:
    def __repr__(self) -> str:
        raise ZeroDivisionError


class BadArray:
    def __array__(self, *args: object, **kwargs: object) -> Any:
        raise RuntimeError("another device")


class BadEqual:
    def __eq__(self, other: object) -> bool:
        raise RuntimeError("equal to what?")

    __hash__ = object.__hash__


class BadIterator:
    def __iter__(self) -> Iterator[int]:
        raise RuntimeError("no first")


def anything() -> tuple[Any, ...]:
    """Made anew each time: some are used up."""
    return (
        *(None, True, False, 0, 1, -1, 3, 10**400, 10**5000, 0.5, 1e-300, 1e308, np.nan, np.inf, -0.0, 1j),
        *(
            "",
            "q1",
            "rhombus",
            "a\0b",
            "\ud800",
            "x" * 5000,
            "native",
            "python",
            "auto",
            "energy",
            b"",
            b"q1",
        ),
        *([], [1], [1, 2, 3], [[1, 2], [3]], ["q1"], ["q1", "q1"], [None], (), ("q1", "q2"), {}, {"q1": 1}),
        *({1, 2}, object(), BadRepr(), BadArray(), BadEqual(), BadIterator(), iter([1, 2]), range(3)),
        *(np.array(1.0), np.zeros(3), np.zeros((3, 3)), np.zeros(0), np.array(["a"]), np.array([1j, 2, 3])),
        *(np.ma.masked_array([1, 2, 3], [0, 1, 0]), np.array([1, None], object), np.datetime64("2001-01-01")),
        *(np.float32(2), np.int8(3), [np.nan] * 3, [1e308] * 3, [1e-320] * 3, slice(1), ..., NotImplemented),
        *(lambda *a, **k: None, len, int, type, rg, Path("/nope"), pin.SE3.Identity(), RHOMBUS.model),
        *(*MECHANISMS[:2], RUN, RHOMBUS.closures[0], rg.JointSpring("q1", 1.0), rg.BridgeOptions()),
    )


def sound(name: str) -> tuple[Any, ...]:
    """Good values of the usual parameters, so that what lies behind the first check is reached."""
    values: dict[str, tuple[Any, ...]] = {
        "mechanism": tuple(MECHANISMS),
        **dict.fromkeys(("q", "q0"), (RHOMBUS.home, [0.3, -0.3, 0.3])),
        **dict.fromkeys(("v", "v0"), (np.zeros(3),)),
        "trajectories": (RUN, [RUN, RUN]),
        "build": ("rhombus", RHOMBUS),
        "runs": ([{}], [{"step": 5e-3}]),
        "name_or_folder": ("rhombus",),
        "model": (RHOMBUS.model,),
        **dict.fromkeys(("ydot", "ydd"), ([0.5],)),
        "names": (["q1"],),
    }
    return values.get(name, ())


def offered() -> dict[str, list[Callable[..., Any]]]:
    """By name, each with the objects it is bound to."""
    found: dict[str, list[Callable[..., Any]]] = {}
    for name in rg.__all__:
        value = getattr(rg, name)
        error = isinstance(value, type) and issubclass(value, BaseException)
        if callable(value) and not error and name not in (*HOLDERS, *ABSTRACT, "live"):
            found[name] = [value]
    objects = [
        *MECHANISMS,
        RUN,
        rg.analyse(RHOMBUS, [0.0, 0.0, 0.0]),
        rg.linearise(RHOMBUS, [0.5, -0.5, 0.5]),
    ]
    for owner in objects:
        for name in dir(type(owner)):
            if not name.startswith("_") and name not in INNER and inspect.isroutine(getattr(owner, name)):
                found.setdefault(f"{type(owner).__name__}.{name}", []).append(getattr(owner, name))
    return found


OFFERED = offered()


def drawn(function: Callable[..., Any], name: str, rng: random.Random) -> dict[str, Any]:
    """Arguments that fit the signature, most of them not what they should be."""
    given: dict[str, Any] = {}
    for parameter in inspect.signature(function).parameters.values():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        if parameter.default is not parameter.empty and rng.random() < 0.75:
            continue
        good = sound(parameter.name)
        given[parameter.name] = rng.choice(good if good and rng.random() < 0.7 else anything())
    if name == "simulate":
        given.setdefault("duration", 0.01)
    if name.startswith("sweep"):
        given = {"duration": 0.01, **given, "workers": 0}
    return given


@pytest.mark.parametrize("part", range(PARTS))
def test_anything_is_answered_or_refused(
    part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, accepted: Callable[..., object]
) -> None:
    monkeypatch.chdir(tmp_path)
    for i in range(part, COUNT, PARTS):
        rng = random.Random(f"public {i}")
        name = rng.choice(sorted(OFFERED))
        function = rng.choice(OFFERED[name])
        given = drawn(function, name, rng)

        def call(function: Callable[..., Any] = function, given: dict[str, Any] = given) -> object:
            made = function(**given)
            return list(made) if inspect.isgenerator(made) else made

        try:
            accepted(call)
        except OSError as error:  # Python's own, for files that are missing or not to be written
            assert "path" in given or "file" in given, (i, name, error)
        except BaseException as error:
            raise AssertionError(f"case {i}: {name} with {sorted(given)} raised {error!r}") from error
