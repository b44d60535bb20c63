"""Motions end where they did, with the crossings, bridges, changes of coordinates and warnings they had."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from ..compiled import needs_kernel
from .decisions import (
    CROSSINGS,
    CROSSINGS_IN_PYTHON,
    SCENES,
    TREES,
    TREES_IN_PYTHON,
    Case,
    decided,
    of_crossing,
    of_scene,
    of_tree,
    recorded,
)

BLOCK = 100
BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]
known = cache(recorded)


def require_as_recorded(case: Case, backend: str) -> None:
    """Times to the digits that a motion has; certificates as small as they were."""
    wanted, found = known(backend)[case.name], decided(case, backend)
    for name in ("refined", "warned", "stopped"):
        assert found.get(name) == wanted.get(name), (case.name, name)
    bridges = wanted.get("bridges", 0)
    assert found.get("bridges", 0) == bridges or bridges in bridges_beside(case, backend), case.name
    crossings, before = found.get("crossings", []), wanted.get("crossings", [])
    assert [each[1:3] for each in crossings] == [each[1:3] for each in before], case.name
    for here, there in zip(crossings, before, strict=True):
        assert here[0] == pytest.approx(there[0], abs=1e-9), case.name
        assert here[3] < max(1e3 * there[3], 1e-12), case.name
    changes, before = found.get("changes", []), wanted.get("changes", [])
    assert [each[1:] for each in changes] == [each[1:] for each in before], case.name
    assert [each[0] for each in changes] == pytest.approx([each[0] for each in before], abs=1e-9), case.name
    if "stopped" not in wanted:
        for name in ("q", "v"):
            size = 1.0 + np.abs(wanted[name]).max()
            np.testing.assert_allclose(found[name], wanted[name], rtol=0, atol=1e-9 * size, err_msg=case.name)


def bridges_beside(case: Case, backend: str) -> set[int]:
    """How many are built from velocities that differ by rounding alone.

    Of two loops that are singular almost at once the reach of a bridge hangs on the last bit: the dyad's
    between 9 and 14, the motion and its crossings alike.
    """
    rng, found = np.random.default_rng(1), set()
    for _ in range(40):
        v0 = np.asarray(case.v0) * (1.0 + 2e-15 * rng.uniform(-1.0, 1.0, len(case.v0)))
        found.add(decided(replace(case, v0=v0), backend).get("bridges", 0))
    return found


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scene", [scene.name for scene in SCENES])
def test_scenes(scene: str, backend: str) -> None:
    require_as_recorded(next(of_scene(scene, backend)), backend)


@pytest.mark.campaign
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scene", [scene.name for scene in SCENES])
def test_scenes_in_other_descriptions(scene: str, backend: str) -> None:
    for case in of_scene(scene, backend):
        require_as_recorded(case, backend)


def blocks(native: int, python: int) -> list[Any]:
    """Some of them always, all in a campaign."""
    found = []
    for backend, count in (("native", native), ("python", python)):
        marks = [needs_kernel] if backend == "native" else []
        for first in range(0, count, BLOCK):
            block = range(first, min(first + BLOCK, count))
            found.append(pytest.param(backend, block, marks=[*marks, pytest.mark.campaign]))
        found.append(pytest.param(backend, range(0, count, 1 + count // 5), marks=marks))
    return found


@pytest.mark.parametrize(("backend", "block"), blocks(CROSSINGS, CROSSINGS_IN_PYTHON))
def test_random_crossings(backend: str, block: range) -> None:
    for index in block:
        require_as_recorded(of_crossing(index), backend)


@pytest.mark.parametrize(("backend", "block"), blocks(TREES, TREES_IN_PYTHON))
def test_random_trees(backend: str, block: range) -> None:
    for index in block:
        require_as_recorded(of_tree(index), backend)
