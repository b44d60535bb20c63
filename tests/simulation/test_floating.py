"""Floating bases and other joints on groups: closed forms, order 4, conserved momentum, invariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import scipy
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]

BODY = pin.Inertia(1.3, np.array([0.1, 0.2, -0.05]), np.diag([0.05, 0.1, 0.13]))
PUSH = np.array([0.3, -0.2, 0.1, 1.0, 2.0, -0.5])
REGULAR, CHANGE_POINT = (0.5, 1.0, 0.8, 0.9), (0.5, 1.0, 0.5, 1.0)


def floating(
    joint: Any, lengths: tuple[float, ...] | None = None, gravity: bool = False, base: pin.Inertia = BODY
) -> rg.Mechanism:
    """A body on this joint, and a four-bar on the body that moves in its y-z plane."""
    m = pin.Model()
    if not gravity:
        m.gravity.linear[:] = 0.0
    i = m.addJoint(0, joint, pin.SE3.Identity(), "base")
    m.appendBodyToJoint(i, base, pin.SE3.Identity())
    return on(m, i, lengths, ["base"])


def on(m: pin.Model, body: int, lengths: tuple[float, ...] | None, own: list[str]) -> rg.Mechanism:
    if lengths is None:
        return rg.Mechanism.from_pinocchio(m, [], own)

    def link(parent: int, y: float, name: str, size: float) -> int:
        j = m.addJoint(parent, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), name)
        about = np.diag([0.02 + size**2 / 12.0, 0.01, 0.02 + size**2 / 12.0])
        inertia = pin.Inertia(0.8, np.array([0.02, size / 2.0, 0.01]), about)
        m.appendBodyToJoint(j, inertia, pin.SE3.Identity())
        return int(j)

    a, b, c, d = lengths
    q1 = link(body, 0.0, "q1", a)
    q2, q3 = link(q1, a, "q2", b), link(body, d, "q3", c)
    for name, at, y in (("e2", q2, b), ("e3", q3, c)):
        m.addFrame(pin.Frame(name, at, pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), pin.FrameType.OP_FRAME))
    home = pin.neutral(m)
    home[-3:] = (1.2, -1.2, 1.2) if lengths == CHANGE_POINT else (1.2, -0.9, 1.27)
    mech = rg.Mechanism.from_pinocchio(m, [rg.PointClosure("e2", "e3")], [*own, "q1"], home=home)
    mech.home = mech.assemble(home)
    return mech


def apart(mech: rg.Mechanism, one: rg.Trajectory, other: rg.Trajectory) -> float:
    """Largest difference of two motions at their end."""
    turned = np.abs(mech.tree.difference(one.q[-1], other.q[-1])).max()
    return float(max(turned, np.abs(one.v[-1] - other.v[-1]).max()))


def momentum(mech: rg.Mechanism, q: Array, v: Array) -> Array:
    """Linear momentum and angular momentum about the world's origin, (6,)."""
    data = mech.model.createData()
    h = pin.computeCentroidalMomentum(mech.model, data, q, v)
    return np.concatenate([h.linear, h.angular + np.cross(data.com[0], h.linear)])


def orders(errors: list[float]) -> Array:
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


class Jacobi:
    """A rigid body without forces: Landau, Lifshitz, Mechanics, section 37; L along z."""

    def __init__(self, inertia: Array, w1: float, w3: float) -> None:
        i1, i2, i3 = self._i = inertia
        two_e, l2 = i1 * w1**2 + i3 * w3**2, (i1 * w1) ** 2 + (i3 * w3) ** 2
        assert l2 > two_e * i2
        self._l = np.sqrt(l2)
        self._rate = np.sqrt((i3 - i2) * (l2 - two_e * i1) / (i1 * i2 * i3))
        self._m = (i2 - i1) * (two_e * i3 - l2) / ((i3 - i2) * (l2 - two_e * i1))
        self._size = np.sqrt(
            [(two_e * i3 - l2) / (i1 * (i3 - i1)), (two_e * i3 - l2) / (i2 * (i3 - i2)),
             (l2 - two_e * i1) / (i3 * (i3 - i1))]
        )  # fmt: skip

    def omega(self, t: float) -> Array:
        sn, cn, dn, _ = scipy.special.ellipj(self._rate * t, self._m)
        return self._size * np.array([cn, sn, dn])

    def rotation(self, t: float) -> Array:
        def precession(s: float) -> float:
            (i1, i2, _), (w1, w2, _) = self._i, self.omega(s)
            return float(self._l * (i1 * w1**2 + i2 * w2**2) / ((i1 * w1) ** 2 + (i2 * w2) ** 2))

        x, weights = np.polynomial.legendre.leggauss(120)
        phi = 0.5 * t * sum(w * precession(0.5 * t * (1.0 + s)) for s, w in zip(x, weights, strict=True))
        n = self._i * self.omega(t) / self._l
        theta, psi = np.arccos(n[2]), np.arctan2(n[0], n[1])
        ez, ex = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        return np.asarray(pin.exp3(phi * ez) @ pin.exp3(theta * ex) @ pin.exp3(psi * ez))


class TestRigidBody:
    """The frame of the base is beside the centre of mass, which flies straight."""

    T = 2.0
    CENTRE = BODY.lever
    MOTION = Jacobi(np.array([0.05, 0.1, 0.13]), 3.0, 4.0)
    DRIFT = np.array([0.3, -0.4, 0.5])

    def place(self, t: float) -> pin.SE3:
        R = self.MOTION.rotation(t)
        return pin.SE3(R, self.DRIFT * t - R @ self.CENTRE)

    def start(self) -> tuple[rg.Mechanism, Array, Array]:
        mech, X, w = floating(pin.JointModelFreeFlyer()), self.place(0.0), self.MOTION.omega(0.0)
        v = np.concatenate([X.rotation.T @ self.DRIFT - np.cross(w, self.CENTRE), w])
        return mech, pin.SE3ToXYZQUAT(X), v

    def error(self, motion: rg.Trajectory) -> float:
        X, w = self.place(self.T), self.MOTION.omega(self.T)
        off = pin.log6(X.inverse() * pin.XYZQUATToSE3(motion.q[-1])).vector
        return float(max(np.abs(off).max(), np.abs(motion.v[-1, 3:] - w).max()))

    def test_rk4_has_order_4(self) -> None:
        mech, q, v = self.start()
        errors = [self.error(rg.simulate(mech, q, v, self.T, 2.0**-k)) for k in range(6, 10)]
        np.testing.assert_allclose(orders(errors), 4.0, atol=0.1)
        assert errors[-1] < 1e-8

    @pytest.mark.parametrize(
        ("stepper", "bound"),
        [("DOP853", 1e-8), ("RK45", 1e-7), ("RK23", 1e-6), ("Radau", 1e-6), ("BDF", 2e-5), ("LSODA", 2e-6)],
    )
    def test_solvers_meet_their_tolerance_over_turns(self, stepper: str, bound: float) -> None:
        """Charts are renewed every radian or so on the way."""
        mech, q, v = self.start()
        motion = rg.simulate(mech, q, v, self.T, 0.5, stepper=stepper, rtol=1e-9, atol=1e-10)
        assert self.error(motion) < bound

    def test_outputs_between_renewals_are_on_the_motion(self) -> None:
        mech, q, v = self.start()
        motion = rg.simulate(mech, q, v, self.T, 0.01, stepper="DOP853", rtol=1e-11, atol=1e-12)
        for k in (17, 101, 155):
            off = pin.log6(self.place(0.01 * k).inverse() * pin.XYZQUATToSE3(motion.q[k])).vector
            np.testing.assert_allclose(off, 0.0, atol=1e-9)


@pytest.mark.parametrize("lengths", [REGULAR, CHANGE_POINT])
def test_floating_four_bar(lengths: tuple[float, ...]) -> None:
    """Order 4 through the crossing as well, closed loops, momentum to the stepper's error."""
    mech = floating(pin.JointModelFreeFlyer(), lengths)
    v = mech.lift(mech.home, np.concatenate([2.0 * PUSH, [4.5]]))
    exact = rg.simulate(mech, mech.home, v, 1.0, 0.25, stepper="DOP853", rtol=1e-13, atol=1e-13)
    crossings = 1 if lengths == CHANGE_POINT else 0
    assert len(exact.crossings) == crossings
    before, errors, drifts = momentum(mech, mech.home, v), [], []
    for k in range(7, 10):
        motion = rg.simulate(mech, mech.home, v, 1.0, 2.0**-k)
        errors.append(apart(mech, exact, motion))
        drifts.append(float(np.abs(momentum(mech, motion.q[-1], motion.v[-1]) - before).max()))
        assert motion.closure_error().max() < 1e-13
        assert [c.kind for c in motion.crossings] == ["transversal"] * crossings
        for found, known in zip(motion.crossings, exact.crossings, strict=True):
            assert abs(found.time - known.time) < 10.0 * errors[-1]
            np.testing.assert_allclose(found.y, np.pi, atol=1e-9)
            assert np.abs(mech.tree.difference(known.q, found.q)).max() < 10.0 * errors[-1]
    np.testing.assert_allclose(orders(errors), 4.0, atol=0.1)
    assert np.all(orders(drifts) > 3.8)
    assert drifts[-1] < 10.0 * errors[-1]
    after = momentum(mech, exact.q[-1], exact.v[-1])
    np.testing.assert_allclose(after, before, atol=1e-10)


@pytest.mark.parametrize("size", [1e-14, 1e-12, 1e-7])
def test_what_rounding_leaves_of_loops_that_rest_breaks_none(size: float) -> None:
    """As a stop's impulse does at a poorly conditioned place; it is a share of all velocities that counts."""
    mech = floating(pin.JointModelFreeFlyer(), REGULAR)
    v = np.append([1.0, 2.0, 3.0, 0.5, -0.5, 0.2], np.zeros(3))
    noise = np.append(np.zeros(6), size * np.array([1.0, 1.0, -1.0]))
    one, other = (rg.simulate(mech, v0=each, duration=0.1, step=1e-3) for each in (v, v + noise))
    assert apart(mech, one, other) < 1e-12 + 3.0 * size
    with pytest.raises(rg.StateError, match="breaks the loop"):
        rg.simulate(mech, v0=v + 1e-4 / size * noise, duration=0.1, step=1e-3)


def test_against_six_joints_of_one_number() -> None:
    """The same base on three slides and three hinges, whose numbers are coordinates as they are."""
    m, i = pin.Model(), 0
    axes = ("PX", "PY", "PZ", "RZ", "RY", "RX")
    for axis in axes:
        i = m.addJoint(i, getattr(pin, f"JointModel{axis}")(), pin.SE3.Identity(), axis)
    m.appendBodyToJoint(i, BODY, pin.SE3.Identity())
    hinged = on(m, i, REGULAR, list(axes))
    free = floating(pin.JointModelFreeFlyer(), REGULAR, gravity=True)
    u = np.concatenate([PUSH, [3.0]])
    v = free.lift(free.home, u)
    start = hinged.lift(hinged.home, np.concatenate([PUSH[:3], PUSH[:2:-1], [3.0]]))
    settings: dict[str, Any] = {"stepper": "DOP853", "rtol": 1e-12, "atol": 1e-12}
    one = rg.simulate(free, free.home, v, 0.5, 0.1, **settings)
    other = rg.simulate(hinged, hinged.home, start, 0.5, 0.1, **settings)
    np.testing.assert_allclose(one.q[:, -3:], other.q[:, -3:], atol=1e-9)
    places, rotations = one.frame("base"), other.frame("RX")
    np.testing.assert_allclose(places.position, rotations.position, atol=1e-9)
    np.testing.assert_allclose(places.rotation, rotations.rotation, atol=1e-9)


class TestInvariance:
    """What moves inside does not feel where the base is and how fast it flies."""

    X = pin.SE3(pin.exp3(np.array([0.7, -1.1, 2.0])), np.array([3.0, -2.0, 5.0]))

    def start(self, boost: Array) -> tuple[rg.Mechanism, list[tuple[Array, Array]]]:
        mech = floating(pin.JointModelFreeFlyer(), CHANGE_POINT)
        v = mech.lift(mech.home, np.concatenate([PUSH, [9.0]]))
        q, flying = mech.home.copy(), v.copy()
        q[:7] = pin.SE3ToXYZQUAT(self.X)
        flying[:3] += self.X.rotation.T @ boost
        return mech, [(mech.home, v), (q, flying)]

    def test_steps_are_the_same_elsewhere(self) -> None:
        mech, starts = self.start(np.zeros(3))
        one, other = (rg.simulate(mech, *start, 1.0, 2e-3) for start in starts)
        np.testing.assert_allclose(one.q[:, 7:], other.q[:, 7:], atol=1e-11)
        np.testing.assert_allclose(one.v, other.v, atol=1e-10)
        ends = zip(one.crossings, other.crossings, strict=True)
        assert len(one.crossings) == 2
        for here, there in ends:
            assert abs(here.time - there.time) < 1e-11
            moved = self.X * pin.XYZQUATToSE3(here.q[:7])
            assert np.abs(pin.log6(moved.inverse() * pin.XYZQUATToSE3(there.q[:7])).vector).max() < 1e-9

    def test_a_flying_observer_sees_the_same(self) -> None:
        mech, starts = self.start(np.array([1.0, 2.0, -3.0]))
        settings: dict[str, Any] = {"stepper": "DOP853", "rtol": 1e-12, "atol": 1e-12}
        one, other = (rg.simulate(mech, *start, 1.0, 0.25, **settings) for start in starts)
        np.testing.assert_allclose(one.q[:, 7:], other.q[:, 7:], atol=1e-9)
        np.testing.assert_allclose(one.v[:, 3:], other.v[:, 3:], atol=1e-9)
        times = [[c.time for c in motion.crossings] for motion in (one, other)]
        assert len(times[0]) == 2
        np.testing.assert_allclose(times[0], times[1], atol=1e-9)


def test_planar_change_point_linkage_against_its_quadrature() -> None:
    """No gravity, no momentum: time and the turn of the base are integrals over the crank's angle."""
    base = pin.Inertia(1.3, np.zeros(3), np.diag([0.2, 0.2, 0.2]))
    m = pin.Model()
    m.gravity.linear[:] = 0.0
    i = m.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    m.appendBodyToJoint(i, base, pin.SE3.Identity())
    sizes = {"q1": 0.5, "q2": 1.0, "q3": 0.5}
    joints = {"": i}
    for name, parent, at in (("q1", "", 0.0), ("q2", "q1", 0.5), ("q3", "", 1.0)):
        place = pin.SE3(np.eye(3), np.array([at, 0.0, 0.0]))
        j = joints[name] = m.addJoint(joints[parent], pin.JointModelRZ(), place, name)
        size = sizes[name]
        inertia = pin.Inertia(
            0.8, np.array([size / 2.0, 0.03, 0.0]), np.diag([0.02, 0.02, 0.02 + size / 12.0])
        )
        m.appendBodyToJoint(j, inertia, pin.SE3.Identity())
    for name, joint in (("e2", "q2"), ("e3", "q3")):
        tip = pin.SE3(np.eye(3), np.array([sizes[joint], 0.0, 0.0]))
        m.addFrame(pin.Frame(name, joints[joint], tip, pin.FrameType.OP_FRAME))
    data = m.createData()
    G = np.zeros((6, 4))
    G[:3, :3], G[3:, 3] = np.eye(3), (1.0, -1.0, 1.0)

    def pose(angle: float) -> Array:
        return np.array([0.0, 0.0, 1.0, 0.0, angle, -angle, angle])

    def shape(angle: float) -> tuple[float, Array]:
        """Reduced inertia of the crank, and the base's velocity for a crank of unit speed."""
        M = pin.crba(m, data, pose(angle))
        A = G.T @ (np.triu(M) + np.triu(M, 1).T) @ G
        follow = -np.linalg.solve(A[:3, :3], A[:3, 3])
        return float(A[3, 3] + A[3, :3] @ follow), follow

    first, last, pace = 1.2, 4.0, 3.0
    size = shape(first)[0]
    x, weights = np.polynomial.legendre.leggauss(80)
    angles = first + 0.5 * (last - first) * (1.0 + x)
    weights = 0.5 * (last - first) * weights
    duration = sum(w * np.sqrt(shape(a)[0] / size) for a, w in zip(angles, weights, strict=True)) / pace
    phase = sum(w * shape(a)[1][2] for a, w in zip(angles, weights, strict=True))

    closures = [rg.PointClosure("e2", "e3")]
    mech = rg.Mechanism.from_pinocchio(m, closures, ["base", "q1"], home=pose(first))
    v = G @ np.concatenate([pace * shape(first)[1], [pace]])
    errors = []
    for n in (100, 200, 400):
        motion = rg.simulate(mech, mech.home, v, float(duration), float(duration) / n)
        assert [c.kind for c in motion.crossings] == ["transversal"]
        end = motion.q[-1]
        errors.append(max(abs(end[4] - last), abs(np.arctan2(end[3], end[2]) - phase)))
    np.testing.assert_allclose(orders(errors), 4.0, atol=0.1)
    exact = rg.simulate(
        mech, mech.home, v, float(duration), stepper="DOP853", rtol=1e-12, atol=1e-12, step=0.1
    )
    assert abs(exact.q[-1, 4] - last) < 1e-10
    assert abs(np.arctan2(exact.q[-1, 3], exact.q[-1, 2]) - phase) < 1e-10


def test_unbounded_hinges_move_as_hinges_do() -> None:
    """One angle adds up in its chart: the steps are the same."""
    base = pin.Inertia(1.0, np.array([0.0, 0.4, 0.0]), np.diag([0.1, 0.1, 0.1]))
    free, hinge = (floating(j, REGULAR, True, base) for j in (pin.JointModelRUBX(), pin.JointModelRX()))
    u = np.array([6.0, 2.0])
    one, other = (rg.simulate(m, m.home, m.lift(m.home, u), 1.0, 1e-2) for m in (free, hinge))
    np.testing.assert_allclose(one.v, other.v, atol=1e-10)
    np.testing.assert_allclose(one.q[:, :2].T, [np.cos(other.q[:, 0]), np.sin(other.q[:, 0])], atol=1e-11)


def test_ball_with_torque_does_the_work_that_is_counted() -> None:
    mech = floating(pin.JointModelSpherical(), gravity=True)
    errors = []
    for k in range(7, 10):
        motion = rg.simulate(
            mech, v0=np.array([1.0, -2.0, 3.0]), duration=1.0, step=2.0**-k, record=("energy",),
            torque=lambda t, q, v: np.array([np.sin(t), 0.3, -0.2 * v[2]]),
        )  # fmt: skip
        errors.append(float(np.abs(motion.energy_error()).max()))
    assert np.all(orders(errors) > 3.8)


class TestAtAState:
    def test_linearised_in_the_tangent_space(self) -> None:
        """δẇ = δu + ½ [w, u]; of torque-free turns ω̇ = I⁻¹ (I ω × ω)."""
        inertia = np.diag([0.05, 0.1, 0.13])
        mech = floating(pin.JointModelSpherical(), base=pin.Inertia(1.0, np.zeros(3), inertia))
        u = np.array([1.0, -2.0, 0.5])
        A = rg.linearise(mech, mech.home, u).A
        np.testing.assert_allclose(A[:3, :3], -0.5 * pin.skew(u), atol=1e-8)
        np.testing.assert_allclose(A[:3, 3:], np.eye(3), atol=1e-8)
        np.testing.assert_allclose(A[3:, :3], 0.0, atol=1e-8)
        gyro = np.linalg.solve(inertia, pin.skew(inertia @ u) - pin.skew(u) @ inertia)
        np.testing.assert_allclose(A[3:, 3:], gyro, atol=1e-7)

    def test_inverse_and_implicit_dynamics_agree_with_the_run(self) -> None:
        mech = floating(pin.JointModelFreeFlyer(), REGULAR, gravity=True)
        v = mech.lift(mech.home, np.concatenate([PUSH, [2.0]]))
        tau = np.linspace(-1.0, 1.0, mech.nv)
        motion = rg.simulate(mech, mech.home, v, 0.01, 0.01, torque=tau, record=("a",))
        assert motion.a is not None
        a = motion.a[0]
        np.testing.assert_allclose(rg.implicit_dynamics(mech, mech.home, v, tau)[0], a, atol=1e-10)
        drives = rg.inverse_dynamics(mech, mech.home, v, a[mech.iv_independent])
        np.testing.assert_allclose(drives, mech.G(mech.home).T @ tau, atol=1e-10)


def test_step_by_step_gives_the_same_digits_and_goes_back_to_them() -> None:
    mech = floating(pin.JointModelFreeFlyer(), CHANGE_POINT)
    v = mech.lift(mech.home, np.concatenate([PUSH, [9.0]]))
    whole = rg.simulate(mech, mech.home, v, 0.4, 0.01)
    simulation = rg.Simulation(mech, mech.home, v, 0.01).step(n=20)
    state = simulation.save()
    for _ in range(2):
        simulation.step(n=20)
        np.testing.assert_array_equal(simulation.q, whole.q[-1])
        np.testing.assert_array_equal(simulation.v, whole.v[-1])
        assert len(simulation.crossings) == len(whole.crossings) == 1
        simulation.restore(state)


class TestDriven:
    """A crank that moves as prescribed pushes the base about, whose momentum stays zero."""

    DRIVE = rg.Motion(lambda t: 1.2 + 0.8 * np.sin(3.0 * t))

    @pytest.mark.parametrize("stepper", ["rk4", "DOP853"])
    def test_momentum_and_work(self, stepper: str) -> None:
        mech = floating(pin.JointModelFreeFlyer(), REGULAR)
        errors: list[float] = []
        drifts: list[float] = []
        for k in range(5, 8):
            motion = rg.simulate(
                mech, duration=1.0, step=2.0**-k, stepper=stepper, rtol=1e-12, atol=1e-12,
                drive={"q1": self.DRIVE}, record="energy",
            )  # fmt: skip
            np.testing.assert_allclose(motion["q1"], 1.2 + 0.8 * np.sin(3.0 * motion.t), atol=1e-12)
            before = momentum(mech, motion.q[0], motion.v[0])
            drifts.append(float(np.abs(momentum(mech, motion.q[-1], motion.v[-1]) - before).max()))
            errors.append(float(np.abs(motion.energy_error()).max()))
            assert motion.closure_error().max() < 1e-13
        assert np.isfinite(motion["drive.q1"]).all()
        if stepper == "rk4":
            assert np.all(orders(drifts) > 3.7)
            assert np.all(orders(errors) > 3.7)
        else:
            assert max(*errors, *drifts) < 1e-9

    def test_the_torque_that_is_recorded_moves_it_so(self) -> None:
        """Forward dynamics under it at an output give the prescribed acceleration."""
        mech = floating(pin.JointModelFreeFlyer(), CHANGE_POINT)
        motion = rg.simulate(mech, duration=0.5, step=1e-2, drive={"q1": self.DRIVE}, record="a")
        tau = np.zeros(mech.nv)
        tau[6] = motion["drive.q1"][30]
        a, _ = rg.implicit_dynamics(mech, motion.q[30], motion.v[30], tau)
        assert motion.a is not None
        np.testing.assert_allclose(a, motion.a[30], atol=1e-8)
        assert a[6] == pytest.approx(-7.2 * np.sin(0.9), abs=1e-9)

    def test_joints_that_are_not_independent_become_so(self) -> None:
        mech = floating(pin.JointModelFreeFlyer(), REGULAR)
        start = float(mech.home[-1])
        motion = rg.simulate(mech, duration=0.2, step=0.01, drive={"q3": rg.Motion(lambda t: start + t)})
        np.testing.assert_allclose(motion["q3"], start + motion.t, atol=1e-12)
        assert motion.closure_error().max() < 1e-13


def test_floating_structure_flies_as_one_body() -> None:
    """Its loops leave no freedom; the base has all of it."""
    mech = floating(pin.JointModelFreeFlyer(), REGULAR)
    held = rg.Mechanism.from_pinocchio(
        mech.model, [*mech.closures, rg.CouplingClosure("q1", None, 0.0, 1.2)], ["base"], home=mech.home
    )
    v = np.concatenate([PUSH, np.zeros(3)])
    motion = rg.simulate(held, held.home, v, 0.5, 0.005)
    assert motion.closure_error().max() < 1e-13
    np.testing.assert_allclose(motion.q[:, 7:], np.tile(held.home[7:], (len(motion.t), 1)), atol=1e-13)
    fixed = rg.Mechanism.from_pinocchio(mech.model, [], ["base", "q1", "q2", "q3"], home=mech.home)
    assert np.abs(momentum(fixed, motion.q[-1], motion.v[-1]) - momentum(fixed, held.home, v)).max() < 1e-8


def test_a_structure_on_the_ground_is_called_rigid() -> None:
    m = pin.Model()
    for name, y in (("a", 0.0), ("b", 1.0)):
        j = m.addJoint(0, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), name)
        m.appendBodyToJoint(j, BODY, pin.SE3.Identity())
        end = pin.SE3(np.eye(3), np.array([0.0, 0.9, 0.0]))
        m.addFrame(pin.Frame(f"e{name}", j, end, pin.FrameType.OP_FRAME))
    closures, home = [rg.PointClosure("ea", "eb")], np.array([1.0, 2.1])
    for own in ([], ["a"]):
        mech = rg.Mechanism.from_pinocchio(m, closures, own, home=home)
        with pytest.raises(rg.PartitionError, match=r"is rigid.*structure"):
            rg.simulate(mech, mech.assemble(home, hold=[]), duration=0.1)
    with pytest.raises(rg.PartitionError, match="rigid"):
        rg.Mechanism.from_pinocchio(m, closures, "auto", home=home)


class TestRefused:
    def test_y_has_no_numbers_on_groups(self) -> None:
        motion = rg.simulate(floating(pin.JointModelFreeFlyer(), REGULAR), duration=0.02, step=0.01)
        assert "base" in str(motion)
        with pytest.raises(rg.PartitionError, match="have no coordinates y"):
            _ = motion.y


def test_a_rigid_structure_on_a_moving_base_moves_with_it() -> None:
    """Six hinges that a weld holds: what `lift` leaves of their velocities is rounding, no broken loop."""
    rng, m = np.random.default_rng(7), pin.Model()
    base = body = m.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    m.appendBodyToJoint(base, BODY, pin.SE3.Identity())
    for i in range(6):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        body = m.addJoint(body, pin.JointModelRX(), place, f"hinge{i}")
        m.appendBodyToJoint(body, BODY, pin.SE3.Identity())
    home = pin.integrate(m, pin.neutral(m), rng.normal(size=m.nv))
    data = m.createData()
    pin.forwardKinematics(m, data, home)
    for name, joint in (("last", body), ("first", base)):
        place = data.oMi[joint].inverse() * data.oMi[body]
        m.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(m, [rg.FrameClosure("last", "first")], "auto", home=home)
    v = mech.lift(home, PUSH)
    assert 0.0 < np.abs(v[6:]).max() < 1e-12
    runs = [rg.simulate(mech, home, start, 0.5, 1e-2) for start in (v, np.append(PUSH, np.zeros(6)))]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-13)
    np.testing.assert_allclose(runs[0].q[:, 7:], np.tile(home[7:], (len(runs[0].q), 1)), atol=1e-12)
    with pytest.raises(rg.StateError, match="breaks the loop"):
        rg.simulate(mech, home, np.append(PUSH, np.full(6, 1e-3)), 0.5, 1e-2)
