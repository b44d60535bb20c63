"""Derivatives at and beside singular configurations, on every mode, against many digits and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.linkages import four_bar, swinging_four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum

from ..exact import Exact, pi

Array = NDArray[np.float64]

SWING = 0.375

PLACES: dict[str, tuple[Callable[[], rg.Mechanism], list[float], list[float]]] = {
    "rhombus, stretched": (lambda: rg.load("rhombus"), [0, 0, 0], [0, 0, 0]),
    "rhombus, folded": (lambda: rg.load("rhombus"), [1, -1, 1], [0, 0, 0]),
    "parallelogram, stretched": (lambda: rg.load("parallelogram"), [0, 0, 0], [0, 0, 0]),
    "parallelogram, folded": (lambda: rg.load("parallelogram"), [1, -1, 1], [0, 0, 0]),
    "change point": (lambda: four_bar(4.0, 2.0, 3.5, 2.5, y=2.5), [1, 1, 1], [0, 0, 0]),
    "kite": (lambda: four_bar(2.0, 2.0, 1.0, 1.0, y=0.5), [0, 0, 0], [0, 0, 0]),
    "another change point": (lambda: four_bar(3.0, 2.0, 2.5, 2.5, y=1.0), [1, 1, 1], [0, 0, 0]),
    "scissor lift of two stages": (
        lambda: scissor_lift(2), [0, 1, 0, 1, -1], [0, 0, 1, 0, 0],
    ),
    "swinging four-bar": (
        lambda: swinging_four_bar(1.0, 1.0, 1.0, 1.0, SWING, 0.5), [0, 0, 0, 0], [SWING, 0, 0, 0],
    ),
    "two flat loops": (
        lambda: four_bars([(1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 1.0, 2.0)], [0.5, 0.4]), [0] * 6, [0] * 6,
    ),
}  # fmt: skip
"""Name: mechanism, q in units of π, and what is added to it."""


def placed(name: str) -> tuple[rg.Mechanism, list[Decimal]]:
    make, turns, shift = PLACES[name]
    return make(), [Decimal(a) * pi() + Decimal(b) for a, b in zip(turns, shift, strict=True)]


def modes(name: str) -> list[tuple[rg.Mechanism, Array]]:
    """All modes at the place, each in coordinates that move on it."""
    mech, q = placed(name)
    found = rg.analyse(mech, [float(x) for x in q])
    assert found.kind == "singular", found.message
    made = []
    for mode in found.modes:
        tangent = mode.reshape(mech.nv, -1)
        single = [j.name for j in mech.joints]
        names: list[str] = []
        rest = tangent / mech.column_scale[:, None]
        for _ in range(mech.m):  # the joints that move most, one after the other
            best = int(np.argmax(np.linalg.norm(rest, axis=1)))
            names.append(single[best])
            way = rest[best] / np.linalg.norm(rest[best])
            rest = rest - np.outer(rest @ way, way)
        made.append((mech.with_independent(sorted(names, key=single.index)), tangent))
    return made


def off(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("name", PLACES)
def test_at_ten_singular_configurations_on_every_mode(name: str) -> None:
    _, q = placed(name)
    there = modes(name)
    assert len(there) >= 2, name
    for mech, tangent in there:
        m = mech.m
        G = tangent @ np.linalg.inv(tangent[mech.iv_independent])
        u = np.array([1.25, -0.75])[:m]
        udot, by_y, by_u, by_tau = Exact(mech).at_singularity(q, tangent, u, np.array([1.0, 0.7])[:m])
        found = rg.derivatives(mech, [float(x) for x in q], G @ u, mode=tangent)
        size = max(np.abs(udot).max(), np.abs(by_y).max(), np.abs(by_u).max())
        label = f"{name}: {np.round(tangent.T, 3)}"
        assert off(found.da_dtau, by_tau) < 1e-12, label
        assert np.abs(found.udot - udot).max() < 1e-11 * size, label
        assert np.abs(found.da_dy - by_y).max() < 1e-11 * size, label
        assert np.abs(found.da_dv - by_u).max() < 1e-11 * size, label


@pytest.mark.parametrize("distance", (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.03, 0.06, 0.1, 0.2))
@pytest.mark.parametrize("y", (0.0, np.pi))
def test_beside_a_singular_configuration(y: float, distance: float) -> None:
    """The rhombus is a pendulum at any distance from flat: A ÿ = −B cos y."""
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    mech, mode, y = rg.load("rhombus"), np.array([1.0, -1.0, 1.0]), y + distance
    found = rg.derivatives(mech, y * mode, 1.3 * mode, mode=mode)
    assert abs(found.da_dy[0, 0] - B * np.sin(y) / A) < 1e-11 * B / A
    assert abs(found.da_dv[0, 0]) < 1e-11
    assert off(found.da_dtau, mode[None] / A) < 1e-12
