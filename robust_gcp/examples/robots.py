"""Three robots with closed loops, built on example-robot-data (the optional extra `robots`)."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from ..errors import MissingExtraError, OptionError, missing_extra
from ..mechanism.constraint.closures import FrameClosure, PointClosure
from ..mechanism.forces.forces import Force, JointSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..mechanism.tree.workspace import workspace

SOLO = "solo_description/robots/solo12.urdf"
BAXTER = "baxter_description/urdf/baxter.urdf"
TALOS = "talos_data/robots/talos_reduced.urdf"
"""Files of example-robot-data."""

LEVER, ROD, ASIDE = 0.11, 0.225, 0.05
"""Talos' cranks behind the shins and levers at its feet, the rods between, and how far beside the leg, m."""

SHIN = 0.325
"""Talos' ankle below its knee, m."""

LEGS = ("FL", "FR", "HL", "HR")

BAR_LENGTH = 0.5
"""Distance of Baxter's hands along the bar, m."""

BAR_MASS, BAR_RADIUS = 1.0, 0.01
"""A round wooden bar, kg and m."""

FINGER_STIFFNESS = 50.0
"""Springs that hold Baxter's sliding fingers in place, N/m: its grippers do not slide by themselves."""


def robot_file(name: str) -> Path:
    """Where example-robot-data keeps a file, found by the end of its path, without importing anything.

    Raises
    ------
    MissingExtraError
        When the package, or this file of it, is not installed.
    """
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError as error:
        raise _missing(name) from error
    for file in files:
        if f"/{file.as_posix()}".endswith(f"/{name}"):
            path = Path(str(file.locate()))
            if path.is_file():
                return path
    raise _missing(name)


def _missing(name: str) -> MissingExtraError:
    return missing_extra(f"{name} comes with example-robot-data", "example-robot-data", "robots")


def solo12_pinned(stiffness: float = 10.0) -> Mechanism:
    """The quadruped solo12 with its four feet pinned to the ground: mobility 6 + 12 − 4 · 3 = 6.

    The floating base is a free-flyer among the dependent joints; a foot turns freely about its
    pin. Home is the standing pose of the robot's own description, its feet where they are pinned.

    Parameters
    ----------
    stiffness : float
        Of a spring on each leg joint, relaxed at home, N m/rad; 0 for slack legs, which fall.
    """
    urdf = robot_file(SOLO)
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    home = pin.neutral(model)
    home[2] = 0.235
    pose = {"HAA": 0.1, "HFE": 0.8, "KFE": -1.6}
    for leg in LEGS:
        left, hind = 1.0 if leg[1] == "L" else -1.0, -1.0 if leg[0] == "H" else 1.0
        for joint, value in pose.items():
            home[_iq(model, f"{leg}_{joint}")] = value * (left if joint == "HAA" else hind)
    feet = _frame_places(model, home, [f"{leg}_FOOT" for leg in LEGS])
    closures = []
    for leg, foot in zip(LEGS, feet, strict=True):
        pinned = pin.SE3(np.eye(3), foot.translation)
        model.addFrame(pin.Frame(f"{leg}_GROUND", 0, pinned, pin.FrameType.OP_FRAME))
        closures.append(PointClosure(f"{leg}_FOOT", f"{leg}_GROUND"))
    joints = [f"{leg}_{joint}" for leg in LEGS for joint in pose]
    independent = ["FL_HAA", "FL_KFE", "FR_HFE", "HL_HAA", "HL_KFE", "HR_HFE"]
    return Mechanism.from_pinocchio(
        model,
        closures,
        independent,
        home=home,
        name="solo12_pinned",
        forces=_springs(_at(model, home, joints), dict.fromkeys(joints, stiffness)),
    )


def baxter_bar(stiffness: float = 200.0) -> Mechanism:
    """The two-armed robot Baxter, a bar held firmly in both hands: mobility 19 − 6 = 13.

    The bar is part of the left hand, and its far end `bar_end` is welded to the frame
    `right_gripper`. The 19 joints are seven in each arm, the head and four sliding fingers.

    Parameters
    ----------
    stiffness : float
        Of a spring on each shoulder and elbow joint, relaxed at home, N m/rad; wrists and head get
        a tenth. With 0 the arms are slack and fall.
    """
    model = pin.buildModelFromUrdf(str(robot_file(BAXTER)))
    hand = model.frames[model.getFrameId("left_gripper")]
    middle = pin.SE3(np.eye(3), np.array([0.5 * BAR_LENGTH, 0.0, 0.0]))
    end = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi), np.array([BAR_LENGTH, 0.0, 0.0]))
    across = BAR_MASS * (BAR_LENGTH**2 / 12.0 + BAR_RADIUS**2 / 4.0)
    bar = pin.Inertia(BAR_MASS, np.zeros(3), np.diag([0.5 * BAR_MASS * BAR_RADIUS**2, across, across]))
    model.appendBodyToJoint(hand.parentJoint, bar, hand.placement * middle)
    model.addFrame(
        pin.Frame("bar_end", hand.parentJoint, hand.placement * end, pin.FrameType.OP_FRAME), False
    )
    guess = pin.neutral(model)
    pose = {"s0": -0.8, "s1": -0.3, "e0": 0.0, "e1": 0.9, "w0": 0.0, "w1": 0.9, "w2": -0.5 * np.pi}
    for joint, value in pose.items():
        guess[_iq(model, f"left_{joint}")] = value
        # mirrored arms: joints that pitch turn alike, those about axes in the plane of symmetry oppositely
        guess[_iq(model, f"right_{joint}")] = value if joint[1] == "1" else -value
    arms = [f"{side}_{joint}" for side in ("left", "right") for joint in pose]
    fingers = [f"{hand}_gripper_{finger}_finger_joint" for hand in "lr" for finger in "lr"]
    springs = {name: stiffness * (0.1 if "_w" in name else 1.0) for name in arms}
    springs |= {"head_pan": 0.1 * stiffness} | dict.fromkeys(fingers, FINGER_STIFFNESS)
    dependent = ("left_w2", "right_s0", "right_s1", "right_e0", "right_w1", "right_w2")
    independent = [name for name in list(model.names)[1:] if name not in dependent]
    closures = [FrameClosure("bar_end", "right_gripper")]
    open_loop = Mechanism.from_pinocchio(model, closures, independent)
    home = open_loop.assemble(guess)
    return Mechanism.from_pinocchio(
        model,
        closures,
        independent,
        home=home,
        name="baxter_bar",
        forces=_springs(_at(model, home, springs), springs),
    )


def talos_ankles(stiffness: float = 300.0) -> Mechanism:
    """The humanoid Talos, hung up by its waist, its ankles driven by two cranks and rods each: mobility 32.

    On each shin two cranks turn above the ankle, and rods lead from their tips to the foot, where balls hold
    them. Cranks that turn alike pitch the foot by the same angle, as crank, rod and foot are a parallelogram;
    turned against each other they roll it. y has the cranks in place of the ankles' own joints.

    Parameters
    ----------
    stiffness : float
        Of a spring on each leg joint above the ankle and on each crank, relaxed at home, N m/rad; 0 for none.
    """
    root = ElementTree.parse(robot_file(TALOS)).getroot()
    ankles = [f"leg_{side}_{i}_joint" for side in ("left", "right") for i in (5, 6)]
    moving = [j.get("name", "") for j in root.findall("joint") if j.get("type") != "fixed"]
    cranks = []
    for side in ("left", "right"):
        for place, y in (("inner", -ASIDE), ("outer", ASIDE)):
            cranks.append(f"ankle_{side}_{place}")
            root.extend(ElementTree.fromstring(_crank_and_rod(cranks[-1], f"leg_{side}", y)))
    independent = [name for name in moving if name not in ankles] + cranks
    held = {name: stiffness for name in independent if name.startswith(("leg_", "ankle_"))}
    text = ElementTree.tostring(root, encoding="unicode")
    forces = _springs(dict.fromkeys(held, 0.0), held)
    return Mechanism.from_urdf(text, independent=independent, name="talos_ankles", forces=forces)


def _crank_and_rod(name: str, leg: str, y: float) -> str:
    """One of the two that drive an ankle, in URDF+; 0.2 kg and 0.15 kg."""
    return f"""<robot><link name="{name}_fork"/>
    <link name="{name}_crank"><inertial><origin xyz="{-0.5 * LEVER} 0 0"/><mass value="0.2"/>
      <inertia ixx="1e-4" iyy="3e-4" izz="3e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="{name}_rod"><inertial><origin xyz="0 0 {-0.5 * ROD}"/><mass value="0.15"/>
      <inertia ixx="7e-4" iyy="7e-4" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="{name}" type="continuous"><parent link="{leg}_4_link"/><child link="{name}_crank"/>
      <origin xyz="0 {y} {ROD - SHIN}"/><axis xyz="0 1 0"/></joint>
    <joint name="{name}_pitch" type="continuous"><parent link="{name}_crank"/><child link="{name}_fork"/>
      <origin xyz="{-LEVER} 0 0"/><axis xyz="0 1 0"/></joint>
    <joint name="{name}_roll" type="continuous"><parent link="{name}_fork"/><child link="{name}_rod"/>
      <axis xyz="1 0 0"/></joint>
    <loop name="{name}_foot" type="spherical">
      <predecessor link="{name}_rod"><origin xyz="0 0 {-ROD}"/></predecessor>
      <successor link="{leg}_6_link"><origin xyz="{-LEVER} {y} 0"/></successor></loop></robot>"""


def shapes(mechanism: Mechanism) -> pin.GeometryModel:
    """What solo12 or Baxter looks like, for `replay(..., visual=)`; Baxter's bar included.

    Raises
    ------
    OptionError
        For another mechanism than those made here.
    """
    files = {"solo12_pinned": SOLO, "baxter_bar": BAXTER}
    if mechanism.name not in files:
        raise OptionError(f"{mechanism.name!r} is none of the robots here: {', '.join(files)}")
    urdf = robot_file(files[mechanism.name])
    packages = [str(folder) for folder in urdf.parents]
    visual = pin.buildGeomFromUrdf(mechanism.own_model, str(urdf), pin.VISUAL, package_dirs=packages)
    if mechanism.name == "baxter_bar":
        hand = mechanism.own_model.frames[mechanism.own_model.getFrameId("left_gripper")]
        along = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.5 * np.pi, 0.0), np.array([0.5 * BAR_LENGTH, 0.0, 0.0]))
        round_bar = coal.Cylinder(BAR_RADIUS, BAR_LENGTH)
        bar = pin.GeometryObject("bar", hand.parentJoint, hand.placement * along, round_bar)
        bar.meshColor = np.array([0.6, 0.4, 0.2, 1.0])
        visual.addGeometryObject(bar)
    return visual


def _iq(model: pin.Model, joint: str) -> int:
    return int(model.joints[model.getJointId(joint)].idx_q)


def _frame_places(model: pin.Model, q: Array, names: list[str]) -> list[pin.SE3]:
    data = workspace(model)
    pin.framesForwardKinematics(model, data, q)
    return [data.oMf[model.getFrameId(name)].copy() for name in names]


def _at(model: pin.Model, q: Array, joints: Iterable[str]) -> dict[str, float]:
    return {name: float(q[_iq(model, name)]) for name in joints}


def _springs(rest: dict[str, float], stiffness: dict[str, float]) -> list[Force]:
    if any(value < 0.0 for value in stiffness.values()):
        raise OptionError("stiffness must not be negative; 0 leaves the springs out")
    return [JointSpring(name, value, rest[name]) for name, value in stiffness.items() if value > 0.0]
