"""The regular path: steps from anchor to anchor, what it says near singular places, and where it gives up."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.explicit import Point
from robust_gcp.maps.regular_path import RegularPath

Array = NDArray[np.float64]


def at_home(mechanism: rg.Mechanism) -> tuple[RegularPath, Point]:
    """A path and its point at home, ẏ = 1."""
    path = RegularPath(mechanism, mechanism.select_rows(mechanism.K(mechanism.home)))
    q = mechanism.home.copy()
    point = path.settle(q, q[mechanism.iq_independent], np.ones(mechanism.m))
    assert point is not None
    return path, point


def tilted(slider: bool) -> rg.Mechanism:
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
def test_steps_along_oblique_axes_in_space(slider: bool) -> None:
    """Nothing vanishes by alignment here: loops close, and γ, G and g are each other's derivatives."""
    mechanism = tilted(slider)
    path, anchor = at_home(mechanism)
    rng = np.random.default_rng(4)
    taken = 0
    for _ in range(40):
        rate = rng.uniform(-1.0, 1.0, mechanism.m)
        y = anchor.y + rng.uniform(-1.0, 1.0, mechanism.m) * 10.0 ** rng.uniform(-8.0, -0.5)
        point = path.step(anchor, y, rate)
        if point is None or point.conditioning < 0.05:
            continue
        taken += 1
        np.testing.assert_array_equal(point.q[mechanism.iq_independent], y)
        assert np.abs(mechanism.phi(point.q)).max() < 1e-13
        K, v = mechanism.K(point.q), point.G @ rate
        assert np.abs(K @ point.G).max() < 1e-12 * np.abs(point.G).max()
        assert np.abs(K @ point.g - mechanism.k(point.q, v)).max() < 1e-11 * max(1.0, np.abs(point.g).max())
        h = 1e-5
        sides = [path.settle(point.q + s * h * v, y + s * h * rate, rate) for s in (1.0, -1.0)]
        ahead, behind = sides
        assert ahead is not None
        assert behind is not None
        scale = max(1.0, np.abs(point.g).max()) / point.conditioning**2
        assert np.abs((ahead.q - behind.q) / (2.0 * h) - v).max() < 1e-8 * scale
        assert np.abs((ahead.G - behind.G) @ rate / (2.0 * h) - point.g).max() < 1e-8 * scale
        anchor = point
    assert taken > 15


@pytest.mark.parametrize("angle", [1.2, 0.3, 0.03, 3e-3, 3e-4, -3e-4])
def test_determinant_and_conditioning_beside_a_singular_place(angle: float) -> None:
    """Unit links: det K_d is the sine between coupler and rocker, and changes sign at q1 = 0."""
    linkage = four_bar(1.0, 1.0, 1.0, 1.0, 0.5)
    path, home = at_home(linkage)
    q, G, g = FourBar(1.0, 1.0, 1.0, 1.0, 1).evaluate(angle)
    point = path.settle(q.copy(), q[:1], np.array([1.3]))
    assert point is not None
    assert point.det[0] / np.sin(angle) == pytest.approx(home.det[0] / np.sin(home.y[0]), rel=1e-12)
    # ε/sin is lost in q and G each, once more in g
    assert point.G[:, 0] == pytest.approx(G, abs=1e-15 / angle**2)
    assert point.g == pytest.approx(1.69 * g, abs=1e-15 / abs(angle) ** 3)
    assert 0.2 * abs(np.sin(angle)) < point.conditioning <= 1.0


def test_exactly_singular() -> None:
    """At q = 0 the rhombus has K_d = [[0, 0], [1, −1]]: closed, so a point, whose det is 0 and G is lost."""
    path, _ = at_home(rg.load("rhombus"))
    point = path.settle(np.zeros(3), np.zeros(1), np.ones(1))
    assert point is not None
    assert point.det[0] == 0.0 == point.conditioning
    assert not np.any(np.isfinite(point.G[1:]))


@pytest.mark.parametrize("y", [2.0, np.nan, np.inf, 1e300])
def test_lost_out_of_reach(y: float) -> None:
    """A rocker as input reaches only so far: y = 2 rad ahead is out of its range or off the branch."""
    path, anchor = at_home(four_bar(4.0, 1.0, 3.0, 2.5, 0.7, independent="q3"))
    with np.errstate(all="ignore"):
        assert path.step(anchor, anchor.y + y, np.ones(1)) is None


@pytest.mark.parametrize("guess", [(0.0, 0.3, -0.4), (0.0, -0.6, 0.5)])
def test_newton_from_afar(guess: tuple[float, ...]) -> None:
    """Both find the loop, closed to rounding; iterations are counted, and each evaluates φ and K once."""
    path, home = at_home(rg.load("crank_rocker"))
    for contracting in (False, True):
        counts = path.counters.newton_iterations, path.counters.constraint_evaluations
        point = path.settle(home.q + np.array(guess), home.y, home.ydot, contracting)
        assert point is not None
        assert np.abs(path.mechanism.phi(point.q)).max() < 1e-14
        taken = path.counters.newton_iterations - counts[0]
        assert 3 <= taken <= 8
        assert path.counters.constraint_evaluations - counts[1] == taken + 1
