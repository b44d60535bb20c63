"""Where a mechanism stands does not matter: positions are seen from a point near its joints."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import rod

Array = NDArray[np.float64]

EXACT = 2.0**22
"""A distance to which quarters of these lengths, and `GAP`, are added without rounding."""

GAP = 2.0**-17

START = [3.05, -2.9, 3.1]
"""Near flat, rad."""


def four_bars(places: Sequence[Array], grounds: Sequence[Array], unit: float = 1.0) -> rg.Mechanism:
    """4, 2, 3, 3 units each, the cranks' pivots at `places` and the rockers' at `grounds`, in m."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81 * unit])

    def add(parent: int, at: Array, name: str, length: float) -> int:
        joint = model.addJoint(parent, pin.JointModelRX(), pin.SE3(np.eye(3), at), name)
        model.appendBodyToJoint(joint, rod(length), pin.SE3.Identity())
        tip = pin.SE3(np.eye(3), np.array([0.0, length, 0.0]))
        model.addFrame(pin.Frame(f"{name}_tip", joint, tip, pin.FrameType.OP_FRAME))
        return int(joint)

    for i, (place, ground) in enumerate(zip(places, grounds, strict=True)):
        crank = add(0, place, f"q1_{i}", 2.0 * unit)
        add(crank, np.array([0.0, 2.0 * unit, 0.0]), f"q2_{i}", 3.0 * unit)
        add(0, ground, f"q3_{i}", 3.0 * unit)
    loops = range(len(places))
    closures = [rg.PointClosure(f"q2_{i}_tip", f"q3_{i}_tip") for i in loops]
    return rg.Mechanism.from_pinocchio(model, closures, [f"q1_{i}" for i in loops])


def four_bar(place: Array, ground: Array, unit: float = 1.0) -> rg.Mechanism:
    """One of them."""
    return four_bars([place], [ground], unit)


def run_of(mechanism: rg.Mechanism, **options: Any) -> rg.Trajectory:
    """Through flat, or by it."""
    q0 = mechanism.assemble(mechanism.m * START)
    return rg.simulate(mechanism, q0, mechanism.lift(q0, mechanism.m * [4.0]), 0.06, 4e-3, **options)


@pytest.mark.parametrize("gap", [0.0, pytest.param(GAP, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("backend", ["python", "native"])
def test_far_away_the_same_linkage_moves_bit_by_bit_alike(backend: Any, gap: float) -> None:
    """A million lengths away, at numbers not rounded there: through a crossing, and by a near miss."""
    if not rg.backends()[backend].available:
        pytest.skip("no compiled kernel")
    reach = np.array([0.0, 4.0 - gap, 0.0])
    near = run_of(four_bar(np.zeros(3), reach), backend=backend)
    away = np.array([EXACT, -EXACT, 0.5 * EXACT])
    far = run_of(four_bar(away, away + reach), backend=backend)
    assert len(near.crossings) == int(gap == 0.0)
    np.testing.assert_array_equal(far.q, near.q)
    np.testing.assert_array_equal(far.v, near.v)
    assert [c.time for c in far.crossings] == [c.time for c in near.crossings]


@pytest.mark.parametrize("backend", ["python", "native"])
def test_linkages_side_by_side_move_bit_by_bit_alike_far_away(backend: Any) -> None:
    """Neither sees the other's place: each has the digits that it would have alone."""
    if not rg.backends()[backend].available:
        pytest.skip("no compiled kernel")
    reach, beside = np.array([0.0, 4.0, 0.0]), np.array([0.5, 8.25, -1.5])
    away = np.array([EXACT, -EXACT, 0.5 * EXACT])
    starts = [np.zeros(3), beside]
    near = run_of(four_bars(starts, [start + reach for start in starts]), backend=backend)
    far = run_of(four_bars([away + s for s in starts], [away + s + reach for s in starts]), backend=backend)
    assert len(near.crossings) == 2
    np.testing.assert_array_equal(far.q, near.q)
    np.testing.assert_array_equal(far.v, near.v)
    assert [c.time for c in far.crossings] == [c.time for c in near.crossings]


@pytest.mark.parametrize(("unit", "away"), [(1e-3, 1e3), (1.0, 6.4e6)])
@pytest.mark.parametrize("gap", [0.0, pytest.param(1e-5, marks=pytest.mark.campaign)])
def test_lengths_are_rounded_once(unit: float, away: float, gap: float) -> None:
    """4 mm at 1 km, 4 m at the earth's radius: as with the lengths so rounded at the origin."""
    place, ground = np.array([0.0, away, 0.0]), np.array([0.0, away + (4.0 - gap) * unit, 0.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rg.SingularityWarning)  # a gap that rounding leaves
        far = run_of(four_bar(place, ground, unit))
        near = run_of(four_bar(np.zeros(3), ground - place, unit))
    np.testing.assert_array_equal(far.q, near.q)


def test_the_users_model_stays_and_energies_are_its_own() -> None:
    place = np.array([300.0, -200.0, 5000.0])
    mechanism = four_bar(place, place + [0.0, 4.0, 0.0])
    np.testing.assert_array_equal(mechanism.model.jointPlacements[1].translation, place)
    q = mechanism.assemble(START)
    v = mechanism.lift(q, [1.5])
    data = mechanism.model.createData()
    energy = pin.computeKineticEnergy(mechanism.model, data, q, v)
    energy += pin.computePotentialEnergy(mechanism.model, data, q)
    assert mechanism.energy(q, v) == pytest.approx(energy, rel=1e-12)
    run = rg.simulate(mechanism, q, v, 0.1, 1e-3, record=["energy"])
    assert run.energy is not None
    assert run.energy[0] == pytest.approx(energy, rel=1e-12)
    pin.framesForwardKinematics(mechanism.model, data, run.q[-1])
    tip = data.oMf[mechanism.model.getFrameId("q2_0_tip")].translation
    assert run.frame("q2_0_tip").position[-1] == pytest.approx(tip, abs=1e-9)
