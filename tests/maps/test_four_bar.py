"""The closed form as an explicit map: continuous over long steps, no jump over a dead point."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.cluster.options import BridgeOptions
from robust_gcp.maps.explicit import Counters
from robust_gcp.maps.four_bar import FourBarMap, draw_four_bar
from robust_gcp.maps.start import initial_point

Array = NDArray[np.float64]


def map_of(lengths, y: float, assembly: int = 1, turns=(0, 0, 0)) -> FourBarMap:
    mechanism = four_bar(*lengths, y=y, assembly=assembly)
    q0 = mechanism.home + 2.0 * np.pi * np.array(turns)
    start = initial_point(mechanism, q0, None, None, BridgeOptions(), Counters())
    return FourBarMap(start.path, start.point)


@pytest.mark.parametrize("turns", [(0, 0, 0), (3, 1, -2)])
@pytest.mark.parametrize(
    ("lengths", "assembly"), [((4, 2, 3, 3), 1), ((1, 2, 1, 2), -1), ((4, 1, 3, 3.5), 1), ((2, 1, 2, 1), -1)]
)
def test_one_long_step_leads_where_many_short_ones_do(lengths, assembly, turns):
    short, long = (map_of(lengths, 1.0, assembly, turns) for _ in range(2))
    start = short.anchor.y[0]
    for y in np.linspace(start, start + 40.0, 400):
        q = short.point_at(np.array([y]), np.zeros(1)).q
    assert long.point_at(np.array([start + 40.0]), np.zeros(1)).q == pytest.approx(q, abs=1e-9)


def test_jump_over_a_dead_point_is_refused():
    lengths = (1.0, 1.0, 0.5, 0.5)  # |y| ≤ 60°
    explicit = map_of(lengths, 0.5)
    with pytest.raises(rg.ToggleError, match="beyond a dead point"):
        explicit.point_at(np.array([0.5 + 2.0 * np.pi]), np.zeros(1))


@pytest.mark.parametrize("r", [1e-2, 1e-4, 1e-6])
def test_closed_form_keeps_its_digits_beside_long_links(r):
    # l0 = l1 = 1, l2 = l3 = r: the tip's distance 2 sin(y/2) is at most 2 r
    linkage = FourBar(1.0, 1.0, r, r)
    high = 2.0 * np.arcsin(r)
    assert linkage.reach[1] == pytest.approx(high, rel=1e-12)
    y = 0.6 * high
    mechanism = four_bar(1.0, 1.0, r, r, y=y)
    q, G, _ = linkage.evaluate(y)
    assert np.abs(mechanism.K(q) @ G).max() < 1e-14 / r
    # tangent against the angle at the apex: cos β = sin(y/2)/r
    beta = np.arccos(np.sin(0.5 * y) / r)
    rate = 0.5 * np.cos(0.5 * y) / r / np.sin(beta)
    assert np.abs(np.abs(G[2] - 0.5) - rate) < 1e-9 * rate


@pytest.mark.parametrize("stepper", ["rk4", "RK45", "DOP853", "Radau"])
@pytest.mark.parametrize("step", [pytest.param(3e-4, marks=pytest.mark.campaign), 1e-3, 1e-2])
@pytest.mark.parametrize(("drive", "pace"), [(20.0, 7.0), (35.0, 3.0), (8.0, 11.0)])
def test_no_run_goes_through_a_dead_point(stepper: str, step: float, drive: float, pace: float) -> None:
    """The kite's crank turns back at ±π/3 rad: a run that reaches it stops there, energy kept until then."""
    kite = rg.load("kite")

    def torque(t: float, q: Array, v: Array) -> Array:
        return np.array([drive * np.sin(pace * t), 0.0, 0.0])

    with pytest.raises(rg.ToggleError, match=r"dead point|out of reach") as stop:
        rg.simulate(
            kite, duration=3.0, step=step, method="closed_form", stepper=stepper, torque=torque,
            record=("energy",), rtol=1e-9,
        )  # fmt: skip
    run = stop.value.trajectory
    assert abs(run.q[-1, 0]) < np.pi / 3
    assert np.abs(run.energy_error()).max() < (1e-2 if step == 1e-2 else 1e-3)  # of some 30 J


def test_a_screw_is_no_hinge():
    """It turns about the same axis, and moves along it as well."""
    known = four_bar(1.0, 1.0, 1.0, 1.0)
    model = pin.Model()
    for old in range(1, known.model.njoints):
        joint = pin.JointModelHX(0.1) if old == 3 else known.model.joints[old]
        at = known.model.jointPlacements[old]
        new = model.addJoint(known.model.parents[old], joint, at, known.model.names[old])
        model.appendBodyToJoint(new, known.model.inertias[old], pin.SE3.Identity())
    for frame in (frame for frame in known.model.frames if frame.name.endswith("_tip")):
        model.addFrame(pin.Frame(frame.name, frame.parentJoint, frame.placement, frame.type), False)
    assert draw_four_bar(known) is not None
    with pytest.raises(rg.OptionError, match="three parallel revolute joints"):
        draw_four_bar(rg.Mechanism.from_pinocchio(model, known.closures, ["q1"]))
