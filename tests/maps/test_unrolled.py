"""The generated path against the one with arrays, which is the reference."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar, n_four_bar
from robust_gcp.maps import start
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.point import Point
from robust_gcp.maps.regular_path import RegularPath
from robust_gcp.maps.unrolled import MAX_JOINTS, UnrolledPath, can_unroll, regular_path

Array = NDArray[np.float64]

PLANAR = [
    "andrews",
    "change_point",
    "crank_rocker",
    "five_bar",
    "kite",
    "parallelogram",
    "rhombus",
    "slider_crank",
    "strandbeest",
    "strandbeest_pair",
    "walker",
]


def _both(mechanism: rg.Mechanism) -> tuple[RegularPath, UnrolledPath]:
    """Two independent paths over the same rows."""
    rows = mechanism.select_rows(mechanism.K(mechanism.home))
    reference, unrolled = RegularPath(mechanism, rows), regular_path(mechanism, rows)
    assert isinstance(unrolled, UnrolledPath)
    return reference, unrolled


def _require_same(a: Point | None, b: Point | None, tolerance: float = 1e-13) -> None:
    """Equal up to rounding, which 1/conditioning amplifies once in q, twice in G, three times in g."""
    assert (a is None) == (b is None)
    if a is None or b is None:
        return
    loss = 1.0 / max(a.conditioning, 1e-300)
    for name, power in (("q", 1), ("G", 2), ("g", 3), ("curvature", 3), ("det", 1), ("rcond", 1)):
        x, y = getattr(a, name), getattr(b, name)
        if x is None or y is None:
            assert x is y
            continue
        assert x.shape == y.shape
        assert np.abs(x - y).max() <= tolerance * loss**power * max(1.0, np.abs(x).max()), name
    assert b.conditioning == pytest.approx(a.conditioning, rel=tolerance * loss)
    assert b.correction == pytest.approx(a.correction, rel=1e-9, abs=tolerance * loss)
    if min(a.correction, b.correction) > 0.0:  # else rounding alone decides whether there is a step
        assert b.distance == pytest.approx(a.distance, rel=1e-9)
    np.testing.assert_array_equal(a.y, b.y)
    np.testing.assert_array_equal(a.ydot, b.ydot)


def _require_same_on_a_walk(mechanism: rg.Mechanism, steps: int = 60, floor: float = 0.1) -> None:
    """Steps of all sizes from well-conditioned anchors, back and forth around home."""
    reference, unrolled = _both(mechanism)
    rng = np.random.default_rng(4)
    q = mechanism.polish(mechanism.home, mechanism.iv_dependent)
    y, ydot = q[mechanism.iq_independent], rng.uniform(-1.0, 1.0, mechanism.m)
    anchor = reference.settle(q, y, ydot)
    assert anchor is not None
    seen = 0
    for _ in range(steps):
        target = anchor.y + rng.uniform(-1.0, 1.0, mechanism.m) * 10.0 ** rng.uniform(-8.0, -0.5)
        rate = rng.uniform(-1.0, 1.0, mechanism.m)
        a, b = reference.step(anchor, target, rate), unrolled.step(anchor, target, rate)
        if a is not None and a.conditioning < floor:
            continue
        _require_same(a, b)
        if a is not None:
            anchor, seen = a, seen + 1
            _require_same(reference.settle(a.q + 0.0, a.y, rate), unrolled.settle(a.q + 0.0, a.y, rate))
    assert seen > steps // 3


@pytest.mark.parametrize("name", PLANAR)
def test_shipped_models(name: str) -> None:
    _require_same_on_a_walk(rg.load(name), floor=0.02)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_loops_in_a_row(n: int) -> None:
    _require_same_on_a_walk(n_four_bar(n, 1.2, length=0.7))


@pytest.mark.parametrize("seed", range(8))
def test_random_four_bars(seed: int) -> None:
    """Crank-rockers by Grashof's rule, shortest + longest < the other two; any joint independent."""
    rng = np.random.default_rng(seed)
    l0, l1, l2, l3 = 2.0, rng.uniform(0.3, 0.8), rng.uniform(1.5, 2.0), rng.uniform(1.4, 2.0)
    joint = f"q{1 + seed % 3}"
    _require_same_on_a_walk(four_bar(l0, l1, l2, l3, rng.uniform(-3, 3), independent=joint), floor=1e-3)


def _tilted(slider: bool) -> rg.Mechanism:
    """A four-bar, or a slider-crank, that moves in a plane askew to all axes."""
    rng = np.random.default_rng(7)
    model = pin.Model()
    plane = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-1.0, 1.0, 3))

    def link(parent: int, at: list[float], name: str, joint: object = None) -> int:
        """A body hinged about its own oblique axis n, turned so that n is the plane's normal."""
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        turn = pin.Quaternion.FromTwoVectors(axis, np.array([0.0, 0.0, 1.0])).matrix()
        placement = turns[parent].actInv(pin.SE3(turn, np.array(at)))
        joint = pin.JointModelRevoluteUnaligned(axis) if joint is None else joint
        index = int(model.addJoint(parent, joint, placement, name))
        turns[index] = pin.SE3(turn, np.zeros(3))
        model.appendBodyToJoint(index, pin.Inertia.Random(), pin.SE3.Identity())
        return index

    turns = {0: plane.inverse()}

    def tip(joint: int, at: list[float], name: str) -> None:
        placement = turns[joint].actInv(pin.SE3(np.eye(3), np.array(at)))
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    crank = link(0, [0.0, 0.0, 0.0], "q1")
    coupler = link(crank, [1.0, 0.0, 0.0], "q2")
    tip(coupler, [3.0, 0.0, 0.0], "a")
    if slider:
        slide = pin.JointModelPrismaticUnaligned(np.array([0.6, 0.8, 0.0]))
        model.addJoint(0, slide, plane, "q3")
        turns[3] = pin.SE3.Identity()
        model.appendBodyToJoint(3, pin.Inertia.Random(), pin.SE3.Identity())
        end = link(3, [0.3, 0.1, 0.0], "q4")
        tip(end, [0.2, 0.0, 0.0], "b")
        joints, guess = ["q1", "q4"], [0.4, -0.3, 2.5, 0.2]
    else:
        rocker = link(0, [2.5, 0.0, 0.0], "q3")
        tip(rocker, [2.0, 0.0, 0.0], "b")
        joints, guess = ["q1"], [0.9, -0.5, 1.2]
    mechanism = rg.Mechanism(model, [rg.PointClosure("a", "b")], joints, home=guess)
    mechanism.home = mechanism.assemble(guess)
    return mechanism


@pytest.mark.parametrize("slider", [False, True])
def test_oblique_axes_in_space(slider: bool) -> None:
    """Nothing vanishes by alignment here: the formulas in three dimensions are all at work."""
    _require_same_on_a_walk(_tilted(slider), floor=0.05)


@pytest.mark.parametrize("angle", [0.3, 0.03, 3e-3, 3e-4, -3e-4])
def test_near_a_singularity(angle: float) -> None:
    """K_d's conditioning falls with the angle; the digits lost are the same ones on both paths."""
    q = FourBar(1.0, 1.0, 1.0, 1.0, 1).evaluate(angle)[0]
    reference, unrolled = _both(four_bar(1.0, 1.0, 1.0, 1.0, 0.5))
    y, ydot = q[:1], np.array([1.3])
    _require_same(reference.settle(q.copy(), y, ydot), unrolled.settle(q.copy(), y, ydot), 1e-14)


def test_exactly_singular() -> None:
    """At q = 0 the rhombus has K_d = [[0, 0], [1, −1]]: closed, so a point, whose det is 0 and G is lost."""
    reference, unrolled = _both(rg.load("rhombus"))
    for path in (reference, unrolled):
        point = path.settle(np.zeros(3), np.zeros(1), np.ones(1))
        assert point is not None
        assert point.det[0] == 0.0 == point.conditioning
        assert not np.any(np.isfinite(point.G[1:]))


@pytest.mark.parametrize("y", [2.0, np.nan, np.inf, 1e300])
def test_lost_where_the_reference_is(y: float) -> None:
    """A rocker as input reaches only so far: y = 2 rad ahead is out of its range or off the branch."""
    reference, unrolled = _both(four_bar(4.0, 1.0, 3.0, 2.5, 0.7, independent="q3"))
    mechanism = reference.mechanism
    ydot, target = np.ones(1), np.array([y])
    anchor = reference.settle(mechanism.home.copy(), mechanism.home[2:], ydot)
    assert anchor is not None
    target = target + anchor.y
    with np.errstate(all="ignore"):
        a, b = reference.step(anchor, target, ydot), unrolled.step(anchor, target, ydot)
    assert a is None
    assert b is None


def test_newton_from_afar() -> None:
    """Without the demand that steps halve, both take the same iterations from a bad guess."""
    reference, unrolled = _both(rg.load("crank_rocker"))
    home, ydot = reference.mechanism.home, np.ones(1)
    for guess in ([0.0, 0.3, -0.4], [0.0, -0.6, 0.5]):
        q = home + np.array(guess)
        for contracting in (False, True):
            counts = [path.counters.newton_iterations for path in (reference, unrolled)]
            a = reference.settle(q.copy(), home[:1], ydot, contracting)
            b = unrolled.settle(q.copy(), home[:1], ydot, contracting)
            _require_same(a, b)
            counts = [
                path.counters.newton_iterations - count
                for path, count in zip((reference, unrolled), counts, strict=True)
            ]
            assert counts[0] == counts[1] > 0


@pytest.mark.parametrize(("name", "y"), [("rhombus", 0.2), ("change_point", 0.4)])
def test_whole_motion_with_crossings(monkeypatch: pytest.MonkeyPatch, name: str, y: float) -> None:
    """300 steps through a singular configuration, with and without generated code."""
    mechanism = rg.load(name)
    runs = []
    for make in (regular_path, RegularPath):
        monkeypatch.setattr(start, "regular_path", make)
        runs.append(rg.simulate(mechanism, duration=1.5, step=5e-3))
    unrolled, reference = runs
    assert len(unrolled.t) == 301
    assert len(unrolled.crossings) == len(reference.crossings) > 0
    np.testing.assert_allclose(unrolled.q, reference.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(unrolled.v, reference.v, rtol=0.0, atol=1e-11)


def test_where_it_is_used(mechanisms: dict[str, rg.Mechanism]) -> None:
    chosen = set()
    for name, mechanism in mechanisms.items():
        if can_unroll(RegularPath(mechanism, mechanism.select_rows(mechanism.K(mechanism.home)))):
            chosen.add(name)
    assert chosen == set(PLANAR)
    wide = n_four_bar(MAX_JOINTS // 2 + 1)
    assert not can_unroll(RegularPath(wide, wide.select_rows(wide.K(wide.home))))
