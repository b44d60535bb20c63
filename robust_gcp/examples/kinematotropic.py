"""Linkages whose mobility changes from one mode to the next; planar, in the world y–z plane."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, Literal

import numpy as np

from ..checks import check_choice, check_positive, listed
from ..errors import OptionError
from ..mechanism.mechanism import Mechanism
from .families import planar_linkage

Mode = Literal["6P", "4P2A", "2P4A", "6A"]

CROSSED: dict[Mode, tuple[str, ...]] = {
    "6P": (),
    "4P2A": ("ab",),
    "2P4A": ("ab", "bc"),
    "6A": ("ab", "bc", "ac"),
}
"""The faces of Wunderlich's linkage that are antiparallelograms, by mode."""


def wunderlich(
    mode: Mode = "2P4A",
    angles: Sequence[float] = (0.7, 1.6),
    lengths: Sequence[float] = (0.9, 0.3, 0.6),
    **drawing: Any,
) -> Mechanism:
    """Wunderlich's twelve bars, the edges of a cube laid flat, which move with one or two freedoms.

    Edges of a class, a, b or c, are equally long, so that the six faces are parallelograms (P) or
    antiparallelograms (A). Opposite faces alike, all modes but "2P4A" (faces ab and bc crossed) have mobility
    2; on that one, with α and γ the angles of the bars a and c against the bar b that is fixed,
    k₁ = (a + b)/(a − b) and k₂ = (c + b)/(c − b),

        (1 − k₁ tan² α/2) (1 − k₂ tan² γ/2) + (1 + k₁) (1 + k₂) tan α/2 tan γ/2 = 0.

    It meets modes of mobility 2 where α or γ is 0 or π, and goes on smoothly. y = angles at joints a00 and
    c00, or at c00.

    Parameters
    ----------
    mode : {"6P", "4P2A", "2P4A", "6A"}
        How many faces of which kind there are at home.
    angles : (float, float)
        α and γ at home, rad; α is left out of account in "2P4A".
    lengths : (float, float, float)
        a, b and c, m, of which no two are equal.
    drawing
        Goes to `planar_linkage` (cuts, rotation, unit).

    References
    ----------
    Wunderlich, "Ein merkwürdiges Zwölfstabgetriebe", Österr. Ing.-Archiv 8 (1954); Wohlhart, "Kinematotropic
    linkages", Advances in Robot Kinematics (1996).
    """
    check_choice("wunderlich: mode", mode, tuple(CROSSED))
    a, b, c = _numbers("lengths", lengths, 3)
    for name, length in zip("abc", (a, b, c), strict=True):
        check_positive(f"wunderlich: lengths, {name}", length)
    if len({a, b, c}) < 3:
        raise OptionError(f"wunderlich: lengths = {a:g}, {b:g}, {c:g} m must be three different ones")
    alpha, gamma = _numbers("angles", angles, 2)
    if mode == "2P4A":
        alpha = _follows(gamma, (a + b) / (a - b), (c + b) / (c - b))
    sides = {"a00": a * np.exp(1j * alpha), "b00": b + 0j, "c00": c * np.exp(1j * gamma)}
    for face, one, two, far_one, far_two in (
        ("ab", "a00", "b00", "a10", "b10"), ("bc", "b00", "c00", "b01", "c01"),
        ("ac", "a00", "c00", "a01", "c10"), ("bc", "b10", "c10", "b11", "c11"),
        ("ac", "a10", "c01", "a11", "c11"),
    ):  # fmt: skip
        sides[far_one], sides[far_two] = _across(face in CROSSED[mode], sides[one], sides[two])
    places = {v: _corner(v, sides) for v in product("01", repeat=3)}
    points = {"".join(v): (float(p.real), float(p.imag)) for v, p in places.items()}
    drawing.setdefault("cuts", ("a10b10", "c01b01", "a01b11", "a11b11", "c11b11"))
    return planar_linkage(points, *_cube(), ["c00"] if mode == "2P4A" else ["a00", "c00"], **drawing)


def _numbers(name: str, given: Sequence[float], count: int) -> list[float]:
    """As many as are asked for."""
    found = listed(given, f"wunderlich: {name}", "numbers", OptionError, (int, float))
    if len(found) != count:
        raise OptionError(f"wunderlich: {name} has {len(found)} entries; give {count}")
    return [float(x) for x in found]


def _cube() -> tuple[dict[str, tuple[str, str]], list[tuple[str, str, str]]]:
    """The bars, by their vertices, and their joints: at each vertex a bar a and a bar c turn on a bar b."""
    edges = {f"a{j}{k}": (f"0{j}{k}", f"1{j}{k}") for j, k in product("01", repeat=2)}
    edges |= {f"b{i}{k}": (f"{i}0{k}", f"{i}1{k}") for i, k in product("01", repeat=2)}
    edges |= {f"c{i}{j}": (f"{i}{j}0", f"{i}{j}1") for i, j in product("01", repeat=2)}
    edges["ground"] = edges.pop("b00")
    joints = []
    for i, j, k in product("01", repeat=3):
        middle = "" if (i, k) == ("0", "0") else f"b{i}{k}"
        joints += [(bar + middle, middle or "ground", bar) for bar in (f"a{j}{k}", f"c{i}{j}")]
    return edges, joints


def _follows(gamma: float, k1: float, k2: float) -> float:
    """α of "2P4A", of two the one nearer to 0."""
    s = np.tan(0.5 * gamma)
    u, v = 1.0 - k2 * s * s, (1.0 + k1) * (1.0 + k2) * s
    square = v * v + 4.0 * k1 * u * u  # of k1 u t² − v t − u = 0, t = tan α/2
    if not square >= 0.0:
        raise OptionError(f"wunderlich: no mode 2P4A at γ = {gamma:g} rad for these lengths")
    # the product of the roots is −1/k₁: the smaller one by the larger, in which nothing cancels
    return float(-2.0 * np.arctan(2.0 * u / (v + np.copysign(np.sqrt(square), v))))


def _across(crossed: bool, x: complex, y: complex) -> tuple[complex, complex]:
    """The sides opposite to x and y, which leave one corner, of a parallelogram or an antiparallelogram."""
    if not crossed:
        return x, y
    d = y - x
    corner = x + d / np.conj(d) * np.conj(y)  # y mirrored in the direction of the diagonal
    return corner - y, corner - x


def _corner(v: tuple[str, ...], sides: dict[str, complex]) -> complex:
    """Where a vertex lies: along a, then b, then c."""
    bars = ["a00", f"b{v[0]}0", f"c{v[0]}{v[1]}"]
    return sum((sides[bar] for bar, on in zip(bars, v, strict=True) if on == "1"), 0j)
