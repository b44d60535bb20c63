"""Modes of linkages of the literature, as published or as their geometry has them.

On a linkage laid flat, with ω the turning rates of its bars and l their signed lengths, a loop asks for
Σ l ω = 0 and, to second order, Σ l ω² = 0. For a quadrilateral whose opposite sides are equal that factors:
a parallelogram's opposite sides turn alike, a (x − x') = b (y − y') and x + x' = y + y' is the other one.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
import scipy

import robust_gcp as rg
from robust_gcp.examples.kinematotropic import Mode, wunderlich
from robust_gcp.examples.meetings import double_watt
from robust_gcp.examples.six_bars import with_dyad

Faces = dict[str, tuple[str, str, str, str]]
LENGTHS = {"a": 0.9, "b": 0.3, "c": 0.6}
FACES: Faces = {
    **{f"ab{k}": (f"a0{k}", f"a1{k}", f"b0{k}", f"b1{k}") for k in "01"},
    **{f"bc{i}": (f"b{i}0", f"b{i}1", f"c{i}0", f"c{i}1") for i in "01"},
    **{f"ac{j}": (f"a{j}0", f"a{j}1", f"c0{j}", f"c1{j}") for j in "01"},
}
BARS = sorted({bar for face in FACES.values() for bar in face})


def turning(mechanism: rg.Mechanism, q: np.ndarray) -> dict[str, float]:
    """The angle of each bar of Wunderlich's linkage, from home, rad."""
    model = mechanism.own_model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    angles = {"b00": 0.0}
    for name, placement in zip(model.names[1:], data.oMi[1:], strict=True):
        bar = next(b for b in (name[:3], name[3:]) if b not in angles and b)
        angles[bar] = float(np.arctan2(placement.rotation[2, 1], placement.rotation[1, 1]))
    return angles


def moved_bar_rates(mechanism: rg.Mechanism, way: np.ndarray) -> np.ndarray:
    """Turning rates of the bars at home, in the order of BARS, of motions (nv, m)."""
    step = 1e-4
    rows = []
    for t in way.T:
        ahead, behind = (turning(mechanism, mechanism.home + s * step * t) for s in (1.0, -1.0))
        rows.append([(ahead[b] - behind[b]) / (2.0 * step) for b in BARS])
    return np.array(rows).T


def flat_modes(lengths: dict[str, float], faces: Faces, fixed: str) -> list[np.ndarray]:
    """The largest spaces of rates on which each face is a parallelogram or an antiparallelogram."""
    at = {bar: i for i, bar in enumerate(BARS)}

    def row(**entries: float) -> np.ndarray:
        r = np.zeros(len(BARS))
        for bar, x in entries.items():
            r[at[bar]] += x
        return r

    spaces = []
    for crossed in product((False, True), repeat=len(faces)):
        rows = [row(**{fixed: 1.0})]
        for (x, x2, y, y2), other in zip(faces.values(), crossed, strict=True):
            a, b = lengths[x[0]], lengths[y[0]]
            rows += (
                [row(**{x: a, x2: -a}) + row(**{y: -b, y2: b}), row(**{x: 1, x2: 1}) - row(**{y: 1, y2: 1})]
                if other
                else [row(**{x: 1, x2: -1}), row(**{y: 1, y2: -1})]
            )
        spaces.append(scipy.linalg.null_space(np.array(rows), rcond=1e-12))
    found: list[np.ndarray] = []
    for space in sorted((s for s in spaces if s.shape[1]), key=lambda s: -s.shape[1]):
        if not any(np.linalg.norm(space - known @ (known.T @ space)) < 1e-9 for known in found):
            found.append(space)
    return found


def same_space(one: np.ndarray, two: np.ndarray) -> bool:
    return one.shape[1] == two.shape[1] and bool(np.sin(scipy.linalg.subspace_angles(one, two)).max() < 1e-7)


@pytest.mark.parametrize("gamma", [0.0, np.pi])
def test_wunderlich_flat(gamma: float) -> None:
    """Five modes of mobility 2, one for each closure type that Wunderlich found but 2P4A, and eight of 1."""
    mechanism = wunderlich("6P", (0.0, gamma))
    found = rg.analyse(mechanism, mechanism.home)
    sign = {"a": 1.0, "b": 1.0, "c": np.cos(gamma)}
    expected = flat_modes({x: sign[x] * LENGTHS[x] for x in "abc"}, FACES, "b00")
    rates = [moved_bar_rates(mechanism, mode.reshape(mechanism.nv, -1)) for mode in found.modes]
    assert found.kind == "singular" and found.local_dof == 2
    assert sorted(r.shape[1] for r in rates) == [1] * 8 + [2] * 5
    assert len(expected) == 13
    for space in expected:
        assert sum(same_space(space, mode) for mode in rates) == 1


@pytest.mark.parametrize(
    ("mode", "mobility", "closures"),
    [("6P", 2, "PPPPPP"), ("4P2A", 2, "AAPPPP"), ("2P4A", 1, "AAAAPP"), ("6A", 2, "AAAAAA")],
)
def test_wunderlich_mobility(mode: Mode, mobility: int, closures: str) -> None:
    """Four closure types, "all of them movable with either one or two degrees of freedom" (Wohlhart)."""
    mechanism = wunderlich(mode)
    assert mechanism.m == mobility
    here = rg.analyse(mechanism, mechanism.home)
    assert here.kind == ("regular" if mobility == 1 else "redundant") and here.local_dof == mobility
    v0 = mechanism.lift(mechanism.home, np.linspace(3.0, -2.0, mobility))
    end = rg.simulate(mechanism, v0=v0, duration=0.05, step=1e-3).q[-1]
    assert mechanism.closure_residual(end) < 1e-14
    turned = turning(mechanism, end)
    alike = [
        max(abs(turned[x] - turned[x2]), abs(turned[y] - turned[y2])) < 1e-9
        for x, x2, y, y2 in FACES.values()
    ]
    assert "".join("P" if same else "A" for same in alike) == closures


def off_the_relation(mechanism: rg.Mechanism, q: np.ndarray) -> float:
    """How far α and γ are from Wunderlich's relation, over rows of q; home is at γ = 1.6."""
    a, b, c = LENGTHS.values()
    k1, k2 = (a + b) / (a - b), (c + b) / (c - b)
    model = mechanism.own_model
    _, y, z = model.jointPlacements[model.getJointId("a00b10")].translation
    alpha = np.arctan2(z, y) + q[:, mechanism.joint("a00").idx_q]
    t, s = np.tan(0.5 * alpha), np.tan(0.5 * (1.6 + q[:, mechanism.joint("c00").idx_q]))
    off = (1.0 - k1 * t**2) * (1.0 - k2 * s**2) + (1.0 + k1) * (1.0 + k2) * t * s
    return float(np.abs(off / ((1.0 + t**2) * (1.0 + s**2))).max())


def dimensions(mechanism: rg.Mechanism, here: rg.LocalAnalysis) -> list[int]:
    return sorted(np.size(mode) // mechanism.nv for mode in here.modes)


def test_wunderlich_input_and_output() -> None:
    """The relation of α and γ on the mode of mobility 1, all along a motion across changes of mobility."""
    mechanism = wunderlich("2P4A", (0.0, 1.6))
    run = rg.simulate(mechanism, v0=mechanism.lift(mechanism.home, [-6.0]), duration=0.8, step=1e-3)
    assert [crossing.corank for crossing in run.crossings] == [2, 2, 2, 2]
    for crossing in run.crossings:
        assert dimensions(mechanism, rg.analyse(mechanism, crossing.q)) == [1, 2]
    assert off_the_relation(mechanism, run.q) < 1e-12


def test_wunderlichs_mode_of_mobility_one_traced() -> None:
    """One closed curve, which meets a mode of mobility 2 where α or γ is 0 or π."""
    mechanism = wunderlich("2P4A", (0.0, 1.6))
    space = rg.trace_modes(mechanism, seeds=4)
    (mode,) = space.modes
    assert mode.closed and len(space.singular_points) == 4
    assert all(dimensions(mechanism, point) == [1, 2] for point in space.singular_points)
    assert off_the_relation(mechanism, mode.q) < 1e-12


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mode": "5P1A"}, "6P, 4P2A"),
        ({"lengths": (1.0, 1.0, 0.5)}, "different"),
        ({"lengths": (0.9, 0.3)}, "give 3"),
        ({"angles": (0.1, 0.2, 0.3)}, "give 2"),
        ({"lengths": (0.3, 0.9, 0.6)}, "no mode 2P4A"),
    ],
)
def test_wunderlichs_linkage_refuses_what_it_cannot_be(given: dict[str, object], words: str) -> None:
    with pytest.raises(rg.OptionError, match=words):
        wunderlich(**given)  # type: ignore[arg-type]


# --------------------------------------------------------------------------- six-bars


def four_bar_rates(crank: float, coupler: float, rocker: float) -> list[tuple[float, float]]:
    """ω of coupler and rocker for ω = 1 of the crank, flat, lengths signed along the line.

    crank + coupler ω₂ = rocker ω₃ and crank + coupler ω₂² = rocker ω₃².
    """
    found = np.roots([coupler * (rocker - coupler), -2.0 * crank * coupler, crank * (rocker - crank)])
    assert np.abs(found.imag).max() == 0.0
    return [(float(w), float((crank + coupler * w) / rocker)) for w in found.real]


def dyad_rates(rod: float, arm: float, rate: float, form: float) -> list[float]:
    """ω of the arm: rate + rod ω₄ = arm ω₅ and form + rod ω₄² = arm ω₅²."""
    found = np.roots([rod * (arm - rod), -2.0 * rod * rate, arm * form - rate**2])
    assert np.abs(found.imag).max() == 0.0
    return [float((rod * w + rate) / arm) for w in found.real]


CRANK, COUPLER, ROCKER, ROD = -2.0, 3.0, -3.0, 2.5
SIX_BARS = {"watt": ("rocker", -1.0, -2.0), "stephenson": ("coupler", 1.2, -1.5)}
"""Which link carries the dyad, how far along it, and the dyad's arm, all flat on a line."""


@pytest.mark.parametrize("kind", SIX_BARS)
def test_six_bars_laid_flat(kind: str) -> None:
    """Two tangents of the four-bar, two of the dyad for each: four modes at corank 2."""
    carrier, at, arm = SIX_BARS[kind]
    start = {"rocker": CRANK + COUPLER - ROCKER, "coupler": CRANK}[carrier]
    line = {"O": 0.0, "P": CRANK, "Q": CRANK + COUPLER, "R": CRANK + COUPLER - ROCKER}
    line |= {"T": start + at, "U": start + at + ROD, "V": start + at + ROD - arm}
    points = {name: (x, 0.0) for name, x in line.items()}
    mechanism = with_dyad(points, carrier, ["A"], cuts=("C", "F"))
    expected = []
    for coupler, rocker in four_bar_rates(CRANK, COUPLER, ROCKER):
        turning, base = (rocker, 0.0) if carrier == "rocker" else (coupler, CRANK)
        rate, form = base + at * turning, base + at * turning**2
        expected += [np.array([1.0, rocker, w]) for w in dyad_rates(ROD, arm, rate, form)]
    found = rg.analyse(mechanism, mechanism.home)
    assert (found.kind, found.rank, found.generic_rank) == ("singular", 2, 4)
    iv = [mechanism.joint(name).idx_v for name in "ADG"]
    rates = [mode[iv] / mode[iv[0]] for mode in found.modes]
    assert len(expected) == len(rates) == 4
    for w in expected:
        assert sum(np.abs(r - w).max() < 1e-9 for r in rates) == 1


def test_stephensons_assemblies() -> None:
    """Six for a given arm of the dyad, and for a given crank two for each pose of the coupler that is near.

    A coupler curve is a tricircular sextic: six of its twelve intersections with a circle are real at most
    (Primrose, Freudenstein and Roth, 1967). Here all six are; counted on the curve itself, too.
    """
    l0, l1, l2, l3, t, n, center, rod = 4.0, 2.5, 3.0, 3.15, 1.82, 0.8, 2.83 + 4.43j, 2.44
    tip = l1 * np.exp(1j * np.linspace(-np.pi, np.pi, 4001))
    reach = np.abs(l0 - tip)
    cosine = (l2**2 + reach**2 - l3**2) / (2.0 * l2 * reach)
    bend = np.arccos(np.where(np.abs(cosine) < 1.0, cosine, np.nan))
    found, poses = [], []
    for side in (1.0, -1.0):
        along = (l0 - tip) / reach * np.exp(1j * side * bend)
        traced = tip + l2 * (t + 1j * n) * along
        poses.append(traced)
        off = np.abs(traced - center) - rod
        at = np.flatnonzero(off[:-1] * off[1:] < 0.0)
        found += list(zip(tip[at], (tip + l2 * along)[at], traced[at], strict=True))
    assert len(found) == 6
    P, Q, T = found[0]
    U = T + rod * (center - T) / abs(center - T)
    corners = zip("ORPQTUV", (0j, l0 + 0j, P, Q, T, U, center + 2.0), strict=True)
    points = {name: (float(z.real), float(z.imag)) for name, z in corners}
    mechanism = with_dyad(points, "coupler", ["G"], cuts=("C", "F"))
    ways = mechanism.assemblies(hold=["G"])
    assert ways.complete and len(ways.q) == 6
    assert len(mechanism.assemblies(hold=["A"]).q) == 2 * sum(
        abs(rod - 2.0) < abs(z - center - 2.0) < rod + 2.0 for z in (p[tip == P][0] for p in poses)
    )


# --------------------------------------------------------------------------- the double Watt linkage


def test_the_double_watt_linkage_has_a_cusp() -> None:
    """Connelly and Servatius' linkage: both branches leave to one side, the bar turning as s^(5/2)."""
    mechanism = double_watt()
    here = rg.analyse(mechanism, mechanism.home)
    assert (here.kind, len(here.modes)) == ("cusp", 1)
    own = here.modes[0] / here.modes[0][mechanism.iv_independent]
    bar = [mechanism.joint(name).idx_q for name in ("low0", "coupler0", "bar0")]
    turned = []
    for s in (-0.2, -0.1, -0.05):
        ways = mechanism.assemblies(mechanism.home + s * own, hold=["low0"]).q[:2]
        low, high = sorted(ways[:, bar].sum(axis=1))
        assert low < 0.0 < high
        turned.append(high - low)
    assert np.log2(np.array(turned[:-1]) / turned[1:]) == pytest.approx([2.5, 2.5], abs=0.1)
    with pytest.raises(rg.ClosureError):
        mechanism.assemble(mechanism.home + 0.2 * own, hold=["low0"])
    with pytest.raises(rg.NotCertifiedError, match="cusp"):
        rg.simulate(mechanism, v0=own, duration=0.1, step=1e-3)


def test_its_copy_has_modes_in_contact_of_order_four() -> None:
    for cuts in (("cut0", "cut1", "bar1"), ("low1", "cut0", "bar0"), ("up0", "low1", "bar1")):
        mechanism = double_watt(mirrored=False, cuts=cuts)
        here = rg.analyse(mechanism, mechanism.home)
        assert (here.kind, here.contacts) == ("singular", ((0, 1, 4),))
