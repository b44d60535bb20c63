"""What is told of a mechanism does not hang on a machine's LAPACK: no sign, no basis of an equal space."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages, meetings, six_bars

from ..decompositions import Array, turn_decompositions

FLAT = {
    "rhombus": lambda: linkages.four_bar(1.0, 1.0, 1.0, 1.0, y=0.0),
    "parallelogram": lambda: linkages.four_bar(2.0, 1.0, 2.0, 1.0, y=0.0),
    "three rhombi": lambda: linkages.n_four_bar(3, angle=0.0),
    "on a swing": lambda: linkages.swinging_four_bar(1.0, 1.0, 1.0, 1.0, swing=0.3, y=0.0),
    "lamp": lambda: six_bars.lamp((0.0, 0.0)),
}
TRACED = {
    "kite": lambda: rg.load("kite"),
    "two rhombi": lambda: linkages.n_four_bar(2, angle=0.0),
    "stretched dyad": meetings.stretched_dyad,
}


def modes_of(make: Callable[[], rg.Mechanism]) -> tuple[Any, ...]:
    """The picture at home, modes as projectors, and the independent joints."""
    mech = make()
    found = rg.analyse(mech, mech.home)
    bases = [np.linalg.qr(mode.reshape(mech.nv, -1))[0] for mode in found.modes]
    return (mech.independent, found.kind, found.contacts), [T @ T.T for T in bases]


def curves_of(make: Callable[[], rg.Mechanism]) -> tuple[Any, ...]:
    """What is traced: modes by name with the points that they visit, and these points."""
    space = rg.trace_modes(make(), seeds=6)
    visits = [
        (mode.name, mode.closed, [(at.point, at.tangent) for at in mode.visits]) for mode in space.modes
    ]
    return visits, [point.q for point in space.singular_points]


@functools.cache
def usual(told: Callable[..., tuple[Any, ...]], make: Callable[[], rg.Mechanism]) -> tuple[Any, ...]:
    return told(make)


def told_again(
    told: Callable[..., tuple[Any, ...]],
    make: Callable[[], rg.Mechanism],
    seed: int,
    patch: pytest.MonkeyPatch,
) -> list[Array]:
    """The same words and numbers from decompositions that are turned; the numbers."""
    words, arrays = usual(told, make)
    turn_decompositions(patch, seed)
    words_again, arrays_again = told(make)
    assert words_again == words
    for one, other in zip(arrays_again, arrays, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    return list(arrays)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", FLAT)
def test_modes_keep_their_numbers(name: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(told_again(modes_of, FLAT[name], seed, monkeypatch)) > 1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", TRACED)
def test_traced_modes_are_the_same(name: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    told_again(curves_of, TRACED[name], seed, monkeypatch)
