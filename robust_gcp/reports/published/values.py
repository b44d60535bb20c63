"""Numbers that others publish of mechanisms with loops, and what this package finds for the same.

Of Exudyn's suite of test models and of the Test Set for IVP Solvers (Andrews' mechanism, end of the motion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ... import Mechanism, PointClosure, load, simulate
from ...examples.linkages import n_four_bar
from ...mechanism.tree.tree import Array
from ..stability.truth import governor
from ..work_precision.benchmarks import ANDREWS_JOINTS
from ..work_precision.reduced import GRAVITY


@dataclass(frozen=True)
class Value:
    """A published number beside ours."""

    source: str  # who publishes it
    what: str
    theirs: float
    ours: float
    why: str  # what the difference is

    @property
    def apart(self) -> float:
        """|ours − theirs|."""
        return abs(self.ours - self.theirs)


def double_four_bar() -> Value:
    """The first bar's centre after 4 s of A02 with two loops; and the suite's number, which is not that."""
    mechanism = n_four_bar(2)
    run = simulate(mechanism, v0=mechanism.lift(mechanism.home, [-1.0]), duration=4.0, step=1e-3)
    return Value(
        "Exudyn, fourBarMechanismIftomm",
        "x of the first bar's centre after 4 s, m",
        0.05815092990659491,
        0.5 * float(np.cos(run.q[-1, 0])),
        "their step of 10 ms; the suite's 0.1721665271840173 is this plus the 0.1140155972774224 J by which "
        "their energy drifts",
    )


def bricard() -> Value:
    """The norm of all displacements after 1 s of A04 with square rods, in points and quaternions."""
    mechanism = load("bricard_square")
    run = simulate(mechanism, mechanism.home, duration=1.0, step=1e-3)
    total = 0.0
    for before, after in zip(_bodies(mechanism, mechanism.home), _bodies(mechanism, run.q[-1]), strict=True):
        turned = pin.Quaternion(after.rotation @ before.rotation.T).coeffs().copy()
        turned *= np.sign(turned[3])
        total += float(np.sum((after.translation - before.translation) ** 2))
        total += float(np.sum((turned - np.array([0.0, 0.0, 0.0, 1.0])) ** 2))
    return Value(
        "Exudyn, bricardMechanism",
        "norm of all coordinates after 1 s, + 1 freedom + 1 redundant row",
        4.172189649307425,
        float(np.sqrt(total)) + 2.0,
        "their steps of 1 ms by an index-2 scheme of second order",
    )


def spatial_slider_crank() -> Value:
    """Sum of coordinates of crank and rod after 0.2 s; the rod hangs on the slide by two hinges."""
    crank_length, length = 0.08, 0.3
    A = np.array([0.0, 0.1, 0.12])
    B = A + [0.0, 0.0, crank_length]
    C = np.array([np.sqrt(length**2 - B[1] ** 2 - B[2] ** 2), 0.0, 0.0])
    along = (C - B) / length
    normal = A - (A @ along) * along
    normal /= np.linalg.norm(normal)
    axis = np.cross(normal, along)  # of the second revolute joint, fixed to the rod
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])

    def add(parent: int, kind: pin.JointModel, at: Array, name: str) -> int:
        return int(model.addJoint(parent, kind, pin.SE3(np.eye(3), at), name))

    def weigh(joint: int, mass: float, moments: list[float], place: pin.SE3) -> None:
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.diag(moments)), place)

    none, here = np.zeros(3), pin.SE3.Identity()
    crank = add(0, pin.JointModelRX(), A, "crank")
    slider = add(0, pin.JointModelPX(), C, "slider")
    rod = add(
        add(slider, pin.JointModelRX(), none, "roll"), pin.JointModelRevoluteUnaligned(axis), none, "rod"
    )
    middle = pin.SE3(np.array([along, axis, normal]).T, 0.5 * (B - C))
    weigh(crank, 0.12, [1e-4, 1e-5, 1e-4], here)
    weigh(slider, 2.0, [1e-4] * 3, here)
    weigh(rod, 0.5, [4e-4, 4e-3, 4e-3], middle)
    for name, joint, place in (("crank_end", crank, B - A), ("rod_end", rod, B - C)):
        model.addFrame(pin.Frame(name, joint, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME))
    mechanism = Mechanism.from_pinocchio(model, [PointClosure("crank_end", "rod_end")], ["crank"])
    run = simulate(mechanism, v0=mechanism.lift(mechanism.home, [6.0]), duration=0.2, step=2e-4)
    places = _bodies(mechanism, run.q[-1])
    ends = [places[crank - 1], places[rod - 1] * middle]
    found = sum(np.abs(e.translation).sum() + np.abs(pin.Quaternion(e.rotation).coeffs()).sum() for e in ends)
    return Value(
        "Exudyn, sliderCrank3Dtest",
        "sum of the coordinates of crank and rod after 0.2 s, m and quaternions",
        3.3642761780921897,
        float(found),
        "their steps of 0.2 ms by an index-2 scheme of second order",
    )


def soft_flyball() -> Value:
    """Speed of a rod of A05 across after 1 ms, its springs 200 times as soft, its joints rigid."""
    mechanism = governor(0.005)
    v0 = np.zeros(mechanism.nv)
    v0[mechanism.joint("shaft").idx_v] = 0.16 * 2.0 * np.pi
    run = simulate(mechanism, mechanism.home, v0, duration=1e-3, step=5e-5)
    model = mechanism.own_model
    data, rod = model.createData(), model.getJointId("alpha1")
    pin.forwardKinematics(model, data, run.q[-1], run.v[-1])
    moving = data.oMi[rod].act(data.v[rod])
    centre = data.oMi[rod].act(model.inertias[rod].lever)
    speed = moving.linear + np.cross(moving.angular, centre)
    return Value(
        "Exudyn, stiffFlyballGovernor",
        "speed of a rod's centre across after 1 ms, m/s",
        0.8962488779114738,
        float(speed[1]),
        "another model: their joints are springs of 20 kN/m, which give way in the first millisecond",
    )


ANDREWS_END = (
    (15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948, 0.5244099658805303,
     0.5347301163226948, 1.048080741042263),
    (1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385, 0.5735699284790808,
     -19.29337464421385, 0.3231791658026955),
)  # fmt: skip
"""q and v after 0.03 s as the Test Set for IVP Solvers prints them, in the order of `ANDREWS_JOINTS`."""


def andrews() -> Value:
    """The worst of Andrews' fourteen numbers, relative to the largest angle or rate of its joint."""
    mechanism = load("andrews")
    run = simulate(mechanism, mechanism.home, duration=0.03, step=5e-6)
    order = [mechanism.joint(name).idx_v for name in ANDREWS_JOINTS]
    found = run.q[-1, order], run.v[-1, order]
    largest = np.abs(run.q).max(axis=0)[order], np.abs(run.v).max(axis=0)[order]
    pairs = zip(found, ANDREWS_END, largest, strict=True)
    off = np.array([(np.array(one) - other) / size for one, other, size in pairs])
    kind, joint = np.unravel_index(int(np.abs(off).argmax()), off.shape)
    return Value(
        "Test Set for IVP Solvers, Andrews",
        f"{'angle' if kind == 0 else 'rate'} of {ANDREWS_JOINTS[joint]} after 0.03 s, the worst of 14",
        ANDREWS_END[kind][joint],
        float(found[kind][joint]),
        "theirs hold some seven digits: they miss the energy balance by 2e-10 J",
    )


def _bodies(mechanism: Mechanism, q: Array) -> list[pin.SE3]:
    """Where the bodies of the joints are."""
    model = mechanism.own_model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return [pin.SE3(place) for place in list(data.oMi)[1:]]


VALUES = (double_four_bar, bricard, spatial_slider_crank, soft_flyball, andrews)
