"""Single velocities of balls as coordinates in loops: idle spins, jointed rods, crossings, floating bases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]

AXIS = np.array([0.6, 0.48, 0.64])
"""Of the rod between its balls, in the axes of the first."""

COMPONENTS = ("ball.rx", "ball.ry", "ball.rz")
STILL = pin.SE3.Identity()


def at(*p: float, turned: Array | None = None) -> pin.SE3:
    return pin.SE3(np.eye(3) if turned is None else turned, np.array(p))


def tip(m: pin.Model, name: str, joint: int, place: Array) -> None:
    m.addFrame(pin.Frame(name, joint, at(*place), pin.FrameType.OP_FRAME))


def rssr(*own: str, floating: bool = False, elbow: bool = False, ball: bool = True) -> rg.Mechanism:
    """Crank, a rod between two balls (one of them cut), rocker: mobility 2, the rod spins idly."""
    m, root = pin.Model(), 0
    if floating:
        m.gravity.linear[:] = 0.0
        root = m.addJoint(0, pin.JointModelFreeFlyer(), STILL, "base")
        m.appendBodyToJoint(
            root, pin.Inertia(3.0, np.array([0.1, 0.2, -0.1]), np.diag([0.3, 0.4, 0.5])), STILL
        )
    crank = m.addJoint(root, pin.JointModelRX(), STILL, "crank")
    m.appendBodyToJoint(crank, pin.Inertia(1.0, np.array([0.0, 0.15, 0.0]), np.diag([0.01] * 3)), STILL)
    if ball:
        rod = m.addJoint(crank, pin.JointModelSpherical(), at(0.0, 0.3, 0.0), "ball")
    else:  # the last of three hinges about the rod's axis
        n1 = np.cross(AXIS, [1.0, 0.0, 0.0])
        n1 /= np.linalg.norm(n1)
        rod = crank
        for name, axis, p in (("b1", n1, 0.3), ("b2", np.cross(AXIS, n1), 0.0), ("spin", AXIS, 0.0)):
            rod = m.addJoint(rod, pin.JointModelRevoluteUnaligned(axis), at(0.0, p, 0.0), name)
    about = pin.Inertia(0.8, 0.5 * AXIS + np.array([0.03, 0.05, -0.06]), np.diag([0.03, 0.05, 0.06]))
    m.appendBodyToJoint(rod, about, STILL)
    end, place = rod, AXIS
    if elbow:
        hinge = pin.JointModelRevoluteUnaligned(np.array([0.0, -0.8, 0.6]))
        end, place = m.addJoint(rod, hinge, at(*(0.6 * AXIS)), "elbow"), np.array([0.5, 0.1, 0.1])
        m.appendBodyToJoint(
            end, pin.Inertia(0.5, np.array([0.15, 0.1, 0.05]), np.diag([0.02, 0.015, 0.01])), STILL
        )
    tip(m, "rod_tip", end, place)
    rocker = m.addJoint(root, pin.JointModelRY(), at(0.5, 0.5, -0.2), "rocker")
    m.appendBodyToJoint(
        rocker, pin.Inertia(1.0, np.array([0.0, 0.0, 0.3]), np.diag([0.02, 0.02, 0.01])), STILL
    )
    tip(m, "rocker_tip", rocker, np.array([0.1, 0.0, 0.6]))
    mech = rg.Mechanism.from_pinocchio(m, [rg.PointClosure("rod_tip", "rocker_tip")], own)
    mech.home = mech.assemble({"crank": 0.4}, hold=["crank"])
    return mech


def spinning(mech: rg.Mechanism, u: list[float], spin: float, axis: Array = AXIS) -> Array:
    """v for these independent velocities, and the rod's rate about its axis made `spin`."""
    v = mech.lift(mech.home, u)
    w = v[mech.velocity_slice("ball")]
    w += (spin - w @ axis) * axis
    return v


def apart(mech: rg.Mechanism, one: rg.Trajectory, other: rg.Trajectory) -> float:
    """Largest difference of two motions at their end."""
    moved = np.abs(mech.tree.difference(one.q[-1], other.q[-1])).max()
    return float(max(moved, np.abs(one.v[-1] - other.v[-1]).max()))


def orders(errors: list[float]) -> Array:
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


EXACT: dict[str, Any] = {"stepper": "DOP853", "rtol": 1e-13, "atol": 1e-13}


T = 0.5


@pytest.fixture(scope="module")
def exact() -> rg.Trajectory:
    mech = rssr("crank", "ball.rx")
    return rg.simulate(mech, mech.home, spinning(mech, [2.0, 0.0], 5.0), T, 0.5 * T, **EXACT)


class TestIdleSpin:
    @pytest.mark.parametrize("own", COMPONENTS)
    def test_every_component_serves_at_order_4(self, own: str, exact: rg.Trajectory) -> None:
        mech, errors, drifts = rssr("crank", own), [], []
        for k in range(7, 10):
            motion = rg.simulate(mech, exact.q[0], exact.v[0], T, T * 2.0**-k, record="energy")
            errors.append(apart(mech, exact, motion))
            drifts.append(float(np.abs(motion.energy_error()).max()))
            assert motion.closure_error().max() < 1e-13
        assert orders(errors)[-1] == pytest.approx(4.0, abs=0.1)
        assert orders(drifts)[-1] == pytest.approx(4.0, abs=0.2)
        one = rg.simulate(mech, exact.q[0], exact.v[0], T, T, **EXACT)
        assert apart(mech, exact, one) < 1e-11

    def test_against_three_hinges(self, exact: rg.Trajectory) -> None:
        """The same rod on three hinges, whose spin is a number in q."""
        hinged, mech = rssr("crank", "spin", ball=False), exact.mechanism
        turn = exact.at(0.0).frame("rod_tip").rotation
        data = hinged.model.createData()
        spin = hinged.model.getJointId("spin")

        def off(x: Array) -> Array:
            pin.forwardKinematics(hinged.model, data, np.concatenate([[0.4], x, [0.0]]))
            return np.asarray(pin.log3(turn.T @ data.oMi[spin].rotation))

        x = np.zeros(3)
        for _ in range(60):
            slope = np.array([(off(x + 1e-6 * e) - off(x - 1e-6 * e)) / 2e-6 for e in np.eye(3)]).T
            move = np.linalg.solve(slope, off(x))
            x = x - move * min(1.0, 0.3 / np.abs(move).max())
        q = hinged.assemble(np.concatenate([[0.4], x, mech.home[-1:]]))
        w = pin.computeJointJacobian(hinged.model, data, q, spin)[3:, 1:4]
        v = np.concatenate([exact.v[0, :1], np.linalg.solve(w, exact.v[0, 1:4]), exact.v[0, 4:]])
        other = rg.simulate(hinged, q, v, T, 0.5 * T, **EXACT)
        np.testing.assert_allclose(other["crank"], exact["crank"], atol=1e-9)
        np.testing.assert_allclose(other["rocker"], exact["rocker"], atol=1e-9)
        frames = other.frame("rod_tip").rotation, exact.frame("rod_tip").rotation
        np.testing.assert_allclose(*frames, atol=1e-8)

    @pytest.mark.parametrize("method", ["classical", "bridge"])
    def test_turns_of_the_rod_do_not_matter(self, method: Any) -> None:
        """Two turns: charts are renewed on the way, by solvers too."""
        mech = rssr("crank", "ball.ry")
        v = spinning(mech, [0.5, 0.0], 60.0)
        one = rg.simulate(mech, mech.home, v, 0.2, 5e-4, method=method)
        other = rg.simulate(
            mech, mech.home, v, 0.2, 0.1, stepper="DOP853", method=method, rtol=1e-9, atol=1e-9
        )
        assert apart(mech, one, other) < 1e-4
        assert one.closure_error().max() < 1e-13

    @pytest.mark.parametrize("stepper", ["RK45", "Radau", "LSODA"])
    def test_solvers(self, stepper: str, exact: rg.Trajectory) -> None:
        mech = exact.mechanism
        motion = rg.simulate(mech, exact.q[0], exact.v[0], T, T, stepper=stepper, rtol=1e-8, atol=1e-9)
        assert apart(mech, exact, motion) < 1e-5

    def test_step_by_step_gives_the_same_digits_and_goes_back_to_them(self) -> None:
        mech = rssr("crank", "ball.rx")
        v = spinning(mech, [2.0, 0.0], 5.0)
        whole = rg.simulate(mech, mech.home, v, 0.2, 0.01)
        simulation = rg.Simulation(mech, mech.home, v, 0.01).step(n=10)
        state = simulation.save()
        for _ in range(2):
            simulation.step(n=10)
            np.testing.assert_array_equal(simulation.q, whole.q[-1])
            np.testing.assert_array_equal(simulation.v, whole.v[-1])
            simulation.restore(state)

    def test_forward_dynamics_is_that_of_the_implicit_equations(self) -> None:
        mech = rssr("crank", "ball.rz")
        v = spinning(mech, [2.0, 0.0], 5.0)
        motion = rg.simulate(mech, mech.home, v, 0.01, 0.01, record="a")
        a, _ = rg.implicit_dynamics(mech, mech.home, v)
        assert motion.a is not None
        np.testing.assert_allclose(motion.a[0], a, atol=1e-10)

    def test_methods_without_charts_are_refused_by_name(self) -> None:
        mech = rssr("crank", "ball.rx")
        with pytest.raises(rg.OptionError, match=r"projection.*'ball'"):
            rg.simulate(mech, duration=0.1, step=0.01, method="projection")

    def test_y_is_refused_by_name(self) -> None:
        motion = rg.simulate(rssr("crank", "ball.rx"), duration=0.02, step=0.01)
        with pytest.raises(rg.PartitionError, match=r"'ball'.*have no coordinates y"):
            _ = motion.y


def test_jointed_rod_changes_its_component_where_another_serves_better() -> None:
    """The axis about which the rod spins moves in it: no component serves for good."""
    mech = rssr("crank", "elbow", "ball.rx", elbow=True)
    v = mech.lift(mech.home, [1.0, 3.0, 4.0])
    exact = rg.simulate(mech, mech.home, v, 0.6, 0.1, stepper="DOP853", rtol=1e-9, atol=1e-10)
    fine = rg.simulate(mech, mech.home, v, 0.6, 2e-3)
    assert apart(mech, exact, fine) < 1e-2
    assert fine.stats.repartitions
    assert fine.closure_error().max() < 1e-13
    here = rg.simulate(mech, mech.home, v, 0.25, 0.25, stepper="DOP853", rtol=1e-12, atol=1e-12)
    steps = [0.25 * 2.0**-k for k in range(5, 8)]
    errors = [apart(mech, here, rg.simulate(mech, mech.home, v, 0.25, h)) for h in steps]
    np.testing.assert_allclose(orders(errors), 4.0, atol=0.2)


def momentum(mech: rg.Mechanism, q: Array, v: Array) -> Array:
    """Linear momentum and angular momentum about the world's origin, (6,)."""
    data = mech.model.createData()
    h = pin.computeCentroidalMomentum(mech.model, data, q, v)
    return np.concatenate([h.linear, h.angular + np.cross(data.com[0], h.linear)])


def test_floating_robot_with_balls() -> None:
    """Order 4, closed loops, momentum to the stepper's error."""
    mech = rssr("base", "crank", "ball.rx", floating=True)
    v = mech.lift(mech.home, [0.3, -0.2, 0.1, 1.0, 2.0, -0.5, 3.0, 4.0])
    exact = rg.simulate(mech, mech.home, v, T, T, **EXACT)
    before, errors, drifts = momentum(mech, mech.home, v), [], []
    for k in range(6, 9):
        motion = rg.simulate(mech, mech.home, v, T, T * 2.0**-k)
        errors.append(apart(mech, exact, motion))
        drifts.append(float(np.abs(momentum(mech, motion.q[-1], motion.v[-1]) - before).max()))
        assert motion.closure_error().max() < 1e-13
    np.testing.assert_allclose(orders(errors), 4.0, atol=0.1)
    assert np.all(orders(drifts) > 3.8)
    assert drifts[-1] < errors[-1]


def change_point(own: tuple[str, ...], turned: Array, ball: bool = True) -> rg.Mechanism:
    """A change-point four-bar without gravity whose coupler is a rod between two balls, along their y."""
    m = pin.Model()
    m.gravity.linear[:] = 0.0

    def body(joint: int, length: float, axes: Array) -> None:
        about = np.diag([0.02 + length**2 / 12.0, 0.01, 0.02 + length**2 / 12.0])
        inertia = pin.Inertia(0.8, axes.T @ np.array([0.0, length / 2.0, 0.0]), axes.T @ about @ axes)
        m.appendBodyToJoint(joint, inertia, STILL)

    q1 = m.addJoint(0, pin.JointModelRX(), STILL, "q1")
    joint = pin.JointModelSpherical() if ball else pin.JointModelRX()
    q2 = m.addJoint(q1, joint, at(0.0, 0.5, 0.0, turned=turned if ball else None), "ball")
    q3 = m.addJoint(0, pin.JointModelRX(), at(0.0, 1.0, 0.0), "q3")
    body(q1, 0.5, np.eye(3))
    body(q2, 1.0, turned if ball else np.eye(3))
    body(q3, 0.5, np.eye(3))
    along = np.array([0.0, 1.0, 0.0])
    tip(m, "e2", q2, turned.T @ along if ball else along)
    tip(m, "e3", q3, 0.5 * along)
    mech = rg.Mechanism.from_pinocchio(m, [rg.PointClosure("e2", "e3")], own)
    q = pin.neutral(m)
    q[0] = q[-1] = 1.2
    back = pin.exp3(np.array([-1.2, 0.0, 0.0]))
    q[1:-1] = pin.Quaternion(turned.T @ back).coeffs() if ball else -1.2
    mech.home = mech.assemble(q)
    return mech


@pytest.mark.parametrize(
    ("own", "turned", "bound"),
    [("ball.ry", np.eye(3), 2e-8), ("ball.rz", pin.exp3(np.array([0.3, -0.7, 0.5])), 2e-5)],
)
def test_crossing_beside_an_idle_spin(own: str, turned: Array, bound: float) -> None:
    """The spin of the coupler about its own axis does not touch the motion of a plane four-bar."""
    plane = change_point(("q1",), np.eye(3), ball=False)
    exact = rg.simulate(plane, plane.home, plane.lift(plane.home, [4.5]), 1.0, 0.25, **EXACT)
    mech = change_point(("q1", own), turned)
    v = spinning(mech, [4.5, 0.0], 2.0, turned.T @ np.array([0.0, 1.0, 0.0]))
    with pytest.warns(rg.SingularityWarning, match="whatever the step"):
        motion = rg.simulate(mech, mech.home, v, 1.0, 2.0**-7)
    assert [c.kind for c in motion.crossings] == ["transversal"]
    assert abs(motion.crossings[0].time - exact.crossings[0].time) < bound
    assert abs(motion["q1"][-1] - exact["q1"][-1]) < bound
    assert motion.closure_error().max() < 1e-13
