"""Every exception and warning of the package travels: between processes, and by copy."""

from __future__ import annotations

import copy
import importlib
import importlib.util
import inspect
import pickle
import pkgutil
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from .refused import refused

WAYS: dict[str, Callable[[Any], Any]] = {
    **{f"pickle {i}": lambda e, i=i: pickle.loads(pickle.dumps(e, i)) for i in range(2, 6)},
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


def kinds() -> dict[str, type[BaseException]]:
    """All that the package's modules define, public or not, found by looking."""
    found = {}
    for module in pkgutil.walk_packages(rg.__path__, "robust_gcp."):
        spec = importlib.util.find_spec(module.name)
        if module.name.endswith("__main__") or spec is None or not str(spec.origin).endswith(".py"):
            continue  # a command, or the compiled kernel
        try:
            contents = vars(importlib.import_module(module.name))
        except ImportError as error:  # a study's peer that is not installed
            assert not (error.name or "").startswith("robust_gcp")
            continue
        for value in contents.values():
            raised = isinstance(value, type) and issubclass(value, BaseException)
            if raised and value.__module__.startswith("robust_gcp"):
                found[value.__qualname__] = value
    return found


KINDS = kinds()

ARGUMENTS: dict[str, Any] = {
    "message": "what was wrong",
    "reason": "why",
    "status": "no compiler",
    "args": ("what was wrong",),
    "residual": 0.25,
    "separation": 1e-3,
    "loop": "tip – base",
    "y": np.array([0.1, 0.2]),
    "choices": [("q1", "q2"), ("q3",)],
    "met": None,
    "details": {"conditioning": 1e-9, "table": np.arange(3.0)},
}
"""A value for each parameter that one of them takes; the test fails for one without a value here."""


def made(kind: type[BaseException]) -> BaseException:
    """One with every argument given."""
    from robust_gcp.maps.cluster.obstacles import Obstacle

    given: list[Any] = []
    named: dict[str, Any] = {}
    if not inspect.isfunction(kind.__init__):  # Python's own, whatever it derives from
        return kind("what was wrong")
    for name, parameter in inspect.signature(kind).parameters.items():
        value = Obstacle("toggle", np.ones(2), 0.1, 0.2, "why") if name == "obstacle" else ARGUMENTS[name]
        if parameter.kind is parameter.VAR_KEYWORD:
            named.update(value)
        elif parameter.kind is parameter.VAR_POSITIONAL:
            given.extend(value)
        else:
            given.append(value)
    return kind(*given, **named)


def same(a: Any, b: Any) -> bool:
    """Equal in type and content, arrays too."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dict__"):
        return same(vars(a), vars(b))
    return bool(a == b)


def test_all_are_found() -> None:
    public = {n for n in rg.__all__ if isinstance(getattr(rg, n), type)}
    public = {n for n in public if issubclass(getattr(rg, n), BaseException)}
    inner = {"NoBridgeError", "ObstacleError", "LostError", "NoProgressError", "NotNativeError", "BuildError"}
    assert public | inner <= set(KINDS)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", KINDS)
def test_type_message_and_attributes_are_kept(name: str, way: str) -> None:
    error = made(KINDS[name])
    error.told = {"by": "the caller"}  # type: ignore[attr-defined]
    if sys.version_info >= (3, 11):
        error.add_note("a note")
    twin = WAYS[way](error)
    assert type(twin) is type(error) and str(twin) == str(error) and repr(twin) == repr(error)
    assert same(twin.args, error.args) and same(vars(twin), vars(error))
    if isinstance(error, ImportError):
        assert (twin.msg, twin.name) == (error.msg, error.name)  # type: ignore[attr-defined]
    again = WAYS[way](twin)  # and once more, from one process to the next
    assert str(again) == str(error) and same(vars(again), vars(error))


def test_a_message_that_was_added_to_is_kept() -> None:
    """As `load` does, which puts the file's name before what was wrong."""
    error = rg.ClosureError("open", 0.5, "tip")
    error.args = ("robot.yaml: open", "more")
    twin = pickle.loads(pickle.dumps(error))
    assert twin.args == error.args and (twin.residual, twin.loop) == (0.5, "tip")


def test_what_had_been_simulated_travels_with_the_error() -> None:
    # the kite's crank turns back at −π/3, after some 0.76 s
    with pytest.raises(rg.ToggleError) as caught:
        rg.simulate(rg.load("kite"), duration=1.0, step=5e-3, on_toggle="error")
    for way in WAYS.values():
        twin = way(caught.value)
        np.testing.assert_array_equal(twin.trajectory.q, caught.value.trajectory.q)
        assert twin.trajectory.stats == caught.value.trajectory.stats
        np.testing.assert_array_equal(twin.y, caught.value.y)
        assert twin.choices == caught.value.choices == [("q2",), ("q3",)]
    assert copy.deepcopy(caught.value).trajectory.q is not caught.value.trajectory.q


def test_a_process_pool_hands_errors_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that cannot be unpickled breaks an executor's pool, and leaves multiprocessing's waiting."""
    # spawned workers take over sys.path and find the function from the checkout's root
    monkeypatch.setattr(sys, "path", [*sys.path, str(Path(__file__).parents[2])])
    context = get_context("spawn")
    with ProcessPoolExecutor(1, context) as executor:
        with pytest.raises(rg.ClosureError, match="is open by") as closure:
            executor.submit(refused, False).result(timeout=100)
        with pytest.raises(rg.ToggleError) as toggle:
            executor.submit(refused, True).result(timeout=100)
    assert closure.value.residual > 0.1 and closure.value.loop
    assert 0.7 < toggle.value.trajectory.t[-1] < 0.8
    with context.Pool(1) as pool, pytest.raises(rg.ClosureError, match="is open by"):
        pool.apply_async(refused, (False,)).get(timeout=100)
