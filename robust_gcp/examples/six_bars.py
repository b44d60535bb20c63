"""Planar linkages of several loops by their points: six-bars, lamps, parallel legs, a dyad."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import check_choice
from ..maps.closed_form import FourBar
from ..mechanism.mechanism import Mechanism
from .families import Lengths, planar_linkage

Point = tuple[float, float]

CHANGE_POINT: Lengths = (4.0, 2.0, 3.0, 3.0)
"""Ground, crank, coupler and rocker, m: its modes meet where the crank points away from the rocker."""


def four_bar_points(lengths: Lengths, crank: float, assembly: int = 1) -> tuple[Point, Point]:
    """Tips of the crank and of the rocker, the crank's pivot at (0, 0) and the rocker's at (l0, 0)."""
    l0, l1, l2, l3 = lengths
    q1, q2, _ = FourBar(l0, l1, l2, l3, assembly).evaluate(crank)[0].tolist()
    tip = np.array([l1 * np.cos(q1), l1 * np.sin(q1)])
    end = tip + l2 * np.array([np.cos(q1 + q2), np.sin(q1 + q2)])
    return (float(tip[0]), float(tip[1])), (float(end[0]), float(end[1]))


FOUR_BAR_JOINTS = [
    ("A", "ground", "crank"),
    ("B", "crank", "coupler"),
    ("C", "coupler", "rocker"),
    ("D", "ground", "rocker"),
]


def with_dyad(
    points: Mapping[str, Point], carrier: str, independent: Sequence[str], **drawing: Any
) -> Mechanism:
    """A four-bar O P Q R with a dyad T U V from its rocker (Watt's) or coupler (Stephenson's) to the ground.

    Joints A to D are the four-bar's, E to G at T, U and V.

    Parameters
    ----------
    points : mapping of str to (float, float)
        O, P, Q, R, T, U and V at home.
    carrier : {"rocker", "coupler"}
        The link with the point T.
    """
    check_choice("with_dyad: carrier", carrier, ("rocker", "coupler"))
    links: dict[str, tuple[str, ...]] = {
        "ground": ("O", "R", "V"), "crank": ("O", "P"), "coupler": ("P", "Q"), "rocker": ("R", "Q"),
        "rod": ("T", "U"), "arm": ("V", "U"),
    }  # fmt: skip
    links[carrier] += ("T",)
    joints = [*FOUR_BAR_JOINTS, ("E", carrier, "rod"), ("F", "rod", "arm"), ("G", "ground", "arm")]
    return planar_linkage(points, links, joints, independent, **drawing)


def watt(crank: float = 2.6, lengths: Lengths = CHANGE_POINT, **drawing: Any) -> Mechanism:
    """Watt's six-bar: the rocker of a four-bar is the crank of another one, y = the angle of joint A.

    `drawing` goes to `planar_linkage` (cuts, rotation, unit).
    """
    P, Q = four_bar_points(lengths, crank)
    l0 = lengths[0]
    R = (l0, 0.0)
    # a ternary rocker, whose third point stands off to the right
    arm = np.array([Q[0] - l0, Q[1]])
    T = (float(l0 + 0.5 * arm[0] + 0.6 * arm[1]), float(0.5 * arm[1] - 0.6 * arm[0]))
    U, V = (T[0] + 2.0, T[1] + 0.8), (l0 + 3.5, 0.0)
    points = {"O": (0.0, 0.0), "P": P, "Q": Q, "R": R, "T": T, "U": U, "V": V}
    return with_dyad(points, "rocker", ["A"], **drawing)


def stephenson(crank: float = 2.6, lengths: Lengths = CHANGE_POINT, **drawing: Any) -> Mechanism:
    """Stephenson's six-bar: a dyad from the ground to a point of a four-bar's coupler, y = joint A."""
    P, Q = four_bar_points(lengths, crank)
    along = np.array([Q[0] - P[0], Q[1] - P[1]])
    T = (float(P[0] + 0.5 * along[0] - 0.4 * along[1]), float(P[1] + 0.5 * along[1] + 0.4 * along[0]))
    U, V = (T[0] + 1.5, T[1] + 2.2), (lengths[0] + 2.5, 3.0)
    points = {"O": (0.0, 0.0), "P": P, "Q": Q, "R": (lengths[0], 0.0), "T": T, "U": U, "V": V}
    return with_dyad(points, "coupler", ["A"], **drawing)


def joined_by_dyad(cranks: tuple[float, float] = (2.6, 2.65), **drawing: Any) -> Mechanism:
    """Two change-point four-bars whose rockers are joined by two rods: one cluster of mobility 2.

    y = the angles of A1 and A2. Each four-bar has its own singular surface; where both cranks are near π
    the two cross.
    """
    points: dict[str, Point] = {}
    links: dict[str, Sequence[str]] = {}
    joints = []
    ground: list[str] = []
    for i, (crank, at) in enumerate(zip(cranks, (0.0, 12.0), strict=True), start=1):
        P, Q = four_bar_points(CHANGE_POINT, crank)
        new = {"O": (0.0, 0.0), "P": P, "Q": Q, "R": (CHANGE_POINT[0], 0.0)}
        points |= {f"{name}{i}": (x + at, z) for name, (x, z) in new.items()}
        ground += [f"O{i}", f"R{i}"]
        links |= {
            f"crank{i}": (f"O{i}", f"P{i}"),
            f"coupler{i}": (f"P{i}", f"Q{i}"),
            f"rocker{i}": (f"R{i}", f"Q{i}"),
        }
        ends = {name: name if name == "ground" else f"{name}{i}" for name in ("ground", *FOUR_BAR_LINKS)}
        joints += [
            (f"{name}{i}@{p}{i}", ends[a], ends[b])
            for (name, a, b), p in zip(FOUR_BAR_JOINTS, "OPQR", strict=True)
        ]
    one, two = points["Q1"], points["Q2"]
    points["T"] = (0.5 * (one[0] + two[0]), 0.5 * (one[1] + two[1]) + 3.0)
    links |= {"ground": tuple(ground), "rod1": ("Q1", "T"), "rod2": ("Q2", "T")}
    joints += [("E1@Q1", "rocker1", "rod1"), ("E2@Q2", "rocker2", "rod2"), ("F@T", "rod1", "rod2")]
    drawing.setdefault("cuts", ("D1@R1", "D2@R2", "F@T"))
    return planar_linkage(points, links, joints, ["A1@O1", "A2@O2"], **drawing)


FOUR_BAR_LINKS = ("crank", "coupler", "rocker")


def lamp(angles: Sequence[float] = (0.3, 0.25), parallel: bool = False, **drawing: Any) -> Mechanism:
    """Parallelograms, each on the plate of the one before: a desk lamp, y = the angle of each arm.

    Parameters
    ----------
    angles : sequence of float
        Of the arms of 1 m against the horizontal, rad; flat arms are singular.
    parallel : bool
        All of them on the ground, side by side, instead of one on the other.
    """
    points: dict[str, Point] = {}
    links: dict[str, Sequence[str]] = {}
    joints, below = [], "ground"
    foot = np.zeros(2)
    on: dict[str, list[str]] = {"ground": []}
    for i, angle in enumerate(angles, start=1):
        arm = np.array([np.cos(angle), np.sin(angle)])
        base = [foot, foot + np.array([0.3, 0.0])]
        corners = dict(
            zip((f"P{i}", f"R{i}", f"S{i}", f"T{i}"), [*base, base[0] + arm, base[1] + arm], strict=True)
        )
        points |= {name: (float(p[0]), float(p[1])) for name, p in corners.items()}
        plate = f"plate{i}"
        on[below] += [f"P{i}", f"R{i}"]
        on[plate] = [f"S{i}", f"T{i}"]
        links |= {f"arm{i}": (f"P{i}", f"S{i}"), f"stay{i}": (f"R{i}", f"T{i}")}
        joints += [
            (f"p{i}@P{i}", below, f"arm{i}"),
            (f"s{i}@S{i}", f"arm{i}", plate),
            (f"t{i}@T{i}", plate, f"stay{i}"),
            (f"r{i}@R{i}", below, f"stay{i}"),
        ]
        if parallel:
            foot = foot + np.array([3.0, 0.0])
        else:
            below, foot = plate, base[0] + arm + np.array([0.0, 0.1])
    links |= {name: tuple(corners) for name, corners in on.items()}
    independent = [f"p{i}@P{i}" for i in range(1, len(angles) + 1)]
    return planar_linkage(points, links, joints, independent, **drawing)


def parallel_legs(legs: int = 3, angle: float = 0.5 * np.pi, **drawing: Any) -> Mechanism:
    """A platform on parallel legs of 1 m, one more than needed where there are three; y = the first leg.

    The legs lie flat on the ground line at angle 0 or π, where all loops are singular.
    """
    arm = np.array([np.cos(angle), np.sin(angle)])
    points: dict[str, Point] = {}
    joints = []
    links: dict[str, Sequence[str]] = {}
    for i in range(legs):
        points[f"P{i}"] = (float(i), 0.0)
        points[f"S{i}"] = (float(i + arm[0]), float(arm[1]))
        links[f"leg{i}"] = (f"P{i}", f"S{i}")
        joints += [(f"p{i}@P{i}", "ground", f"leg{i}"), (f"s{i}@S{i}", f"leg{i}", "platform")]
    links |= {"ground": tuple(f"P{i}" for i in range(legs)), "platform": tuple(f"S{i}" for i in range(legs))}
    return planar_linkage(points, links, joints, ["p0@P0"], **drawing)
