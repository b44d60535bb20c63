"""Closed loops as Crocoddyl's action models: steps as `simulate` does them, their derivatives, solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

crocoddyl = pytest.importorskip("crocoddyl", exc_type=ImportError)

from robust_gcp.adapters.crocoddyl import ClosedLoopAction, state_model  # noqa: E402 - needs Crocoddyl

Array = NDArray[np.float64]
STEP = 0.02


def costs(state: Any, nu: int, goal: Array, weights: Array, torque: float) -> Any:
    """½ |W (x ⊖ goal)|² + ½ r |c|²."""
    total = crocoddyl.CostModelSum(state, nu)
    weighted = crocoddyl.ActivationModelWeightedQuad(weights**2)
    distance = crocoddyl.ResidualModelState(state, goal, nu)
    total.addCost("state", crocoddyl.CostModelResidual(state, weighted, distance), 1.0)
    total.addCost(
        "torque", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, nu)), torque
    )
    return total


def action(mech: rg.Mechanism, step: float = STEP, **options: Any) -> ClosedLoopAction:
    state = state_model(mech)
    nu = len(options.get("motors", mech.independent))
    weights = np.linspace(0.5, 1.0, state.ndx)
    return ClosedLoopAction(mech, costs(state, nu, state.zero(), weights, 1e-2), step, **options)


def floating_crank_rocker() -> rg.Mechanism:
    """A free body that carries a four-bar; the base is no part of the loop and has no motor."""
    m = pin.Model()
    base = m.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    m.appendBodyToJoint(base, pin.Inertia(3.0, np.zeros(3), np.diag([0.2, 0.3, 0.4])), pin.SE3.Identity())

    def link(parent: int, y: float, name: str, size: float) -> int:
        j = m.addJoint(parent, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), name)
        inertia = pin.Inertia(0.8, np.array([0.02, size / 2.0, 0.01]), 0.05 * np.eye(3))
        m.appendBodyToJoint(j, inertia, pin.SE3.Identity())
        return int(j)

    q1 = link(base, 0.0, "q1", 0.5)
    q2, q3 = link(q1, 0.5, "q2", 1.0), link(base, 0.9, "q3", 0.8)
    for name, at, y in (("e2", q2, 1.0), ("e3", q3, 0.8)):
        m.addFrame(pin.Frame(name, at, pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), pin.FrameType.OP_FRAME))
    home = pin.neutral(m)
    home[-3:] = (1.2, -0.9, 1.27)
    mech = rg.Mechanism.from_pinocchio(m, [rg.PointClosure("e2", "e3")], ["base", "q1"], home=home)
    mech.home = mech.assemble(home)
    return mech


def at_home(mech: rg.Mechanism, model: ClosedLoopAction) -> Array:
    """x of the home pose, moving."""
    carrier, x = model.state.pinocchio, model.state.zero()
    for name in mech.independent:
        joint = carrier.joints[carrier.getJointId(name)]
        own = mech.model.joints[mech.model.getJointId(name)]
        x[joint.idx_q : joint.idx_q + joint.nq] = mech.home[own.idx_q : own.idx_q + own.nq]
    x[carrier.nq :] = np.linspace(0.4, -0.7, mech.m) if mech.m > 1 else 0.8
    return np.asarray(x)


SCENES = {
    "crank_rocker": lambda: rg.load("crank_rocker"),
    "stewart": lambda: rg.load("stewart"),
    "floating": floating_crank_rocker,
}


@pytest.mark.parametrize("scene", SCENES)
def test_a_node_is_one_step_of_simulate(scene: str) -> None:
    mech = SCENES[scene]()
    motors = [name for name in mech.independent if name != "base"]
    model = action(mech, motors=motors)
    data, x, c = model.createData(), at_home(mech, model), np.linspace(3.0, 2.0, len(motors))
    model.calc(data, x, c)
    q, G = mech.home, rg.derivatives(mech, mech.home).G
    u = x[model.state.pinocchio.nq :]
    run = rg.simulate(mech, q, G @ u, duration=STEP, step=STEP, torque=model.B @ c)
    moved = model.state.diff(at_home(mech, model), data.xnext)[: mech.m]
    along = mech.tree.difference(q, run.q[-1])[mech.iv_independent]
    np.testing.assert_allclose(moved, along, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(data.xnext[-mech.m :], run.v[-1][mech.iv_independent], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("scene", SCENES)
def test_derivatives_are_those_of_central_differences(scene: str) -> None:
    mech = SCENES[scene]()
    motors = [name for name in mech.independent if name != "base"]
    model = action(mech, motors=motors)
    state, data, x, c = (
        model.state,
        model.createData(),
        at_home(mech, model),
        np.linspace(3.0, 2.0, len(motors)),
    )
    x = state.integrate(x, 0.05 * np.sin(np.arange(1.0, state.ndx + 1.0)))
    model.calc(data, x, c)
    model.calcDiff(data, x, c)
    Fx, Fu, Lx, Lu = (np.atleast_1d(part).copy() for part in (data.Fx, data.Fu, data.Lx, data.Lu))
    Fx, Fu = Fx.reshape(state.ndx, -1), Fu.reshape(state.ndx, -1)
    centre = data.xnext.copy()

    def slope(at: Any, h: float) -> tuple[Array, float]:
        ends = []
        for sign in (1.0, -1.0):
            model.calc(data, *at(sign * h))
            ends.append((state.diff(centre, data.xnext), data.cost))
        return (ends[0][0] - ends[1][0]) / (2.0 * h), (ends[0][1] - ends[1][1]) / (2.0 * h)

    def richardson(at: Any) -> tuple[Array, float]:
        h = 2e-3
        (coarse, l1), (fine, l2) = slope(at, h), slope(at, h / 2.0)
        return (4.0 * fine - coarse) / 3.0, (4.0 * l2 - l1) / 3.0

    size = np.abs(Fx).max()
    for j, e in enumerate(np.eye(state.ndx)):
        step, cost = richardson(lambda h, e=e: (state.integrate(x, h * e), c))
        np.testing.assert_allclose(Fx[:, j], step, rtol=0.0, atol=1e-8 * size)
        assert cost == pytest.approx(Lx[j], abs=1e-9)
    for j, e in enumerate(np.eye(len(c))):
        step, cost = richardson(lambda h, e=e: (x, c + h * e))
        np.testing.assert_allclose(Fu[:, j], step, rtol=0.0, atol=1e-9 * size)
        assert cost == pytest.approx(Lu[j], abs=1e-9)


def test_a_joint_of_several_numbers_has_all_of_them_in_the_state() -> None:
    model = pin.Model()
    carriage = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "carriage")
    model.appendBodyToJoint(carriage, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    arm = model.addJoint(carriage, pin.JointModelRX(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, pin.Inertia(1.0, np.array([0.0, 0.3, 0.0]), np.eye(3)), pin.SE3.Identity())
    for names in (["arm", "carriage"], ["carriage.z", "arm", "carriage.x", "carriage.y"]):
        mech = rg.Mechanism.from_pinocchio(model, [], names)
        state = state_model(mech)
        assert state.nv == mech.m == 4
        node = ClosedLoopAction(mech, costs(state, 1, state.zero(), np.ones(8), 1.0), STEP, motors=["arm"])
        q, v = np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, -1.0, 0.5, 2.0])
        data, own = node.createData(), mech.iv_independent
        node.calc(data, np.concatenate([q[own], v[own]]), np.array([3.0]))
        after = rg.step(mech, q, v, {"arm": 3.0}, STEP)
        np.testing.assert_allclose(data.xnext, np.concatenate([after.q[own], after.v[own]]), rtol=1e-13)


def test_a_crank_is_brought_to_rest_where_it_was_asked_to() -> None:
    mech = rg.load("crank_rocker")
    model = action(mech)
    x0 = at_home(mech, model)
    goal, state = np.array([x0[0] + 1.0, 0.0]), model.state
    run = ClosedLoopAction(mech, costs(state, 1, goal, np.array([0.3, 0.05]), 1e-4), STEP)
    end = ClosedLoopAction(mech, costs(state, 1, goal, np.array([60.0, 12.0]), 1e-9), 0.0)
    problem = crocoddyl.ShootingProblem(x0, [run] * 30, end)
    solver = crocoddyl.SolverFDDP(problem)
    assert solver.solve([x0] * 31, [np.zeros(1)] * 30, 60)
    np.testing.assert_allclose(solver.xs[-1], goal, rtol=0.0, atol=5e-3)
    sim = rg.Simulation(mech, v0=rg.derivatives(mech, mech.home).G @ x0[1:], step=STEP)
    for c in solver.us:
        sim.step(run.B @ c)
    np.testing.assert_allclose([sim.y[0], sim.v[mech.iv_independent[0]]], solver.xs[-1], rtol=0.0, atol=1e-8)


def test_where_a_knot_has_no_step_solvers_are_told_by_nan() -> None:
    model = action(rg.load("crank_rocker").with_independent(["q3"]))  # a rocker turns back at its dead points
    data = model.createData()
    model.calc(data, np.array([9.0, 0.0]), np.zeros(1))
    assert np.isnan(data.cost)
    assert isinstance(data.stopped, rg.SimulationError)


def test_motors_and_costs_must_fit() -> None:
    mech = rg.load("crank_rocker")
    with pytest.raises(rg.ModelError, match="spin"):
        action(mech, motors=["spin"])
    state = state_model(mech)
    with pytest.raises(rg.OptionError, match=r"2 torques.*1 motor"):
        ClosedLoopAction(mech, costs(state, 2, state.zero(), np.ones(2), 1.0), STEP)
    with pytest.raises(rg.OptionError, match="step"):
        action(mech, step=-1.0)
