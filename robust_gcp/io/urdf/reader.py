"""URDF to a spanning tree with closures: the traps of the format removed, its faults named."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.contents import STAYS, FileContents, check_base, named
from ...mechanism.forces.forces import Force, JointDamper, JointSpring
from ...mechanism.tree.workspace import require_memory
from ..gepetto import with_joint_changes
from ..xml_text import parsed_xml
from .base import declare_world, set_base
from .check import LIMITS, MOMENTS, MOVING, PRODUCTS, SPHERICAL, check_urdf
from .gazebo import joints_of_gazebo
from .left_out import left_out_of
from .loops import closures_of, refuse_unknown_ties
from .numbers import number_in, numbers_in
from .springs import springs_of

UNLIMITED = "1e9"
"""Limit, rad or m, written for a joint that has none: nothing here enforces limits."""

VELOCITIES = dict.fromkeys(("revolute", "continuous", "prismatic"), 1) | {"planar": 3}
VELOCITIES |= dict.fromkeys(("floating", *SPHERICAL), 6)
"""How many numbers the types of joints have in v; the others have none."""

READ_AS = {"continuous": "revolute"} | dict.fromkeys(SPHERICAL, "floating")
"""What Pinocchio's parser gets in place of a type; balls are made of floating joints afterwards."""

FORCES = ("spring_stiffness", "spring_reference", "damping")

ENDLESS = {"lower": f"-{UNLIMITED}", "upper": UNLIMITED, "effort": UNLIMITED, "velocity": UNLIMITED}


LARGE = 10_000_000
"""Characters that take some seconds to be parsed and checked."""

COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
TYPED = re.compile(r"""<(?:\w+:)?joint\s[^<>]*?\btype\s*=\s*["'](\w+)["']""")
"""A joint's type, in the text of a URDF."""

YES, NO = ("true", "1"), ("false", "0")


def read_urdf(urdf: str | Path, base: str | None = None) -> FileContents:
    """What a URDF describes: the spanning tree, its loops and couplings, its joints' dampers.

    `continuous` joints, which Pinocchio stores as (cos, sin), are read as revolute joints without
    limits: one number in q each, and full turns are counted. Links with their inertia, joints with their
    damping, and the elements of `loops` are read; shapes and meshes are not opened. `independent` of URDF+
    marks joints: those marked "false" are not independent, the others are.

    Parameters
    ----------
    urdf : str or Path
        A file, or the XML text itself.
    base : "fixed", "free" or None
        See `base.set_base`.

    Raises
    ------
    ModelError
        Naming the file and what is wrong: not found, not XML, loops that are not known, and see
        `check.check_urdf`.
    """
    check_base(base)
    root, name = parsed_xml(urdf, "URDF", _scan)
    if root.tag != "robot":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a URDF starts with <robot>")
    declare_world(root)
    check_urdf(root, name)
    refuse_unknown_ties(root, name)
    left_out = left_out_of(root, name)  # before joints are added that are not the file's
    left_out += named(STAYS, set_base(root, base))
    _require_memory(joint.get("type", "") for joint in root.findall("joint"))
    try:
        model = pin.buildModelFromXML(ElementTree.tostring(_reduced(root), encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{name}: Pinocchio cannot build a model from it ({error})") from error
    # links, joints and ties by name are the file's: only the tree goes through Pinocchio's parser
    round_ones = {j.get("name", ""): "SPHERICAL" for j in root.findall("joint") if j.get("type") in SPHERICAL}
    model = with_joint_changes(model, round_ones, Path(name))
    _set_armature(root, model, name)
    if model.nv == 0:
        raise ModelError(
            f"{name}: no joint moves; a mechanism needs one at least, or base='free' that lets it float"
        )
    closures = [*closures_of(root, model, name), *joints_of_gazebo(root, model, name)]
    contents = FileContents(model, closures, _forces(root, name), left_out=left_out)
    contents.forces += springs_of(root, model, name)
    contents.independent, contents.actuated = _marked(root, name), _driven(root)
    return contents


def _scan(text: str) -> None:
    """Refuse a large tree whose workspace would not fit, before its text is parsed."""
    if len(text) > LARGE:
        _require_memory(TYPED.findall(COMMENT.sub("", text)))


def _require_memory(kinds: Iterable[str]) -> None:
    """Refuse joints of these types where their workspace would not fit, before Pinocchio reads them."""
    moving = [VELOCITIES.get(kind, 0) for kind in kinds]
    require_memory(sum(moving), sum(map(bool, moving)))


def _forces(root: Element, name: str) -> list[Force]:
    """Dampers and springs of the joints."""
    found: list[Force] = []
    for joint in root.findall("joint"):
        dynamics, label = joint.find("dynamics"), joint.get("name", "")
        if dynamics is None or joint.get("type") == "fixed":
            continue
        stiffness, rest, damping = (number_in(dynamics, key, name, 0.0) for key in FORCES)
        if stiffness:
            found.append(JointSpring(label, stiffness, rest))
        if damping:
            found.append(JointDamper(label, damping))
    return found


def _set_armature(root: Element, model: pin.Model, name: str) -> None:
    """Rotors' inertia of the joints: one number, or one for each velocity."""
    for element in root.findall("joint"):
        dynamics = element.find("dynamics")
        if dynamics is None or dynamics.get("armature") is None or element.get("type") == "fixed":
            continue
        joint = model.joints[model.getJointId(element.get("name", ""))]
        count = 1 if len(dynamics.get("armature", "").split()) == 1 else joint.nv
        numbers = numbers_in(dynamics, "armature", name, count)
        if np.min(numbers) < 0.0:
            raise ModelError(
                f"{name}: joint {element.get('name')!r}: its armature is negative; give kg m² or kg"
            )
        armature = np.array(model.armature)
        armature[joint.idx_v : joint.idx_v + joint.nv] = numbers
        model.armature = armature


def _driven(root: Element) -> tuple[str, ...]:
    """Joints of transmissions, and those that ros2_control commands, as far as they move."""
    moving = {j.get("name", "") for j in root.findall("joint") if j.get("type") != "fixed"}
    named = [j.get("name", "") for t in root.findall("transmission") for j in t.findall("joint")]
    named += [j.get("name", "") for j in root.iterfind("ros2_control/joint[command_interface]")]
    return tuple(joint for joint in dict.fromkeys(named) if joint in moving)


def _marked(root: Element, name: str) -> tuple[str, ...] | None:
    """Joints that are not marked as dependent, where any is marked; None else."""
    moving = [j for j in root.findall("joint") if j.get("type") != "fixed"]
    marks = {j.get("name", ""): j.get("independent", "").lower() for j in moving}
    for joint, mark in marks.items():
        if mark and mark not in (*YES, *NO):
            raise ModelError(f"{name}: joint {joint!r}: independent={mark!r} is neither true nor false")
    if not any(marks.values()):
        return None
    return tuple(joint for joint, mark in marks.items() if mark not in NO)


def _reduced(root: Element) -> Element:
    """What makes the tree, its numbers rewritten: Python and C++ do not read all of them alike."""
    robot = Element("robot", {"name": root.get("name") or "robot"})
    for link in root.findall("link"):
        to = SubElement(robot, "link", {"name": link.get("name", "")})
        inertial = link.find("inertial")
        if inertial is not None:
            to = SubElement(to, "inertial")
            _numbers(inertial, to, "origin", ("xyz", "rpy"))
            _numbers(inertial, to, "mass", ("value",))
            _numbers(inertial, to, "inertia", (*MOMENTS, *PRODUCTS))
    for joint in root.findall("joint"):
        kind = joint.get("type", "")
        to = SubElement(robot, "joint", {"name": joint.get("name", ""), "type": READ_AS.get(kind, kind)})
        for end in ("parent", "child"):
            SubElement(to, end, {"link": joint.find(end).get("link", "")})  # type: ignore[union-attr]
        _numbers(joint, to, "origin", ("xyz", "rpy"))
        axis = joint.find("axis")
        if axis is not None and kind in MOVING:
            x, y, z = map(float, axis.get("xyz", "").split())
            size = math.hypot(x, y, z)
            SubElement(to, "axis", {"xyz": f"{x / size!r} {y / size!r} {z / size!r}"})
        if kind in ("revolute", "prismatic", "continuous"):
            limit = None if kind == "continuous" else joint.find("limit")
            given = {} if limit is None else {k: limit.get(k, "") for k in LIMITS if k in limit.attrib}
            SubElement(to, "limit", ENDLESS | {k: repr(float(number)) for k, number in given.items()})
        _numbers(joint, to, "dynamics", ("damping", "friction"))
    return robot


def _numbers(source: Element, target: Element, tag: str, keys: tuple[str, ...]) -> None:
    """The element of that tag with those of its attributes that are given."""
    element = source.find(tag)
    if element is None:
        return
    given = {key: element.get(key, "").split() for key in keys if key in element.attrib}
    if tag == "dynamics" and not given:  # urdfdom refuses one without damping and friction
        return
    SubElement(target, tag, {key: " ".join(repr(float(x)) for x in words) for key, words in given.items()})
