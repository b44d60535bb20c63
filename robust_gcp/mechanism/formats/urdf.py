"""URDF to `pin.Model`, with the two traps of the format removed and its faults named."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import pinocchio as pin

from ...errors import ModelError
from .urdf_check import LIMITS, MOMENTS, MOVING, PRODUCTS, check_urdf
from .xml_text import parsed_xml

UNLIMITED = "1e9"
"""Limit, rad, written for a joint that turns without limits: nothing here enforces limits."""


def model_from_urdf(urdf: str | Path) -> pin.Model:
    """The spanning tree that a URDF describes.

    `continuous` joints, which Pinocchio stores as (cos, sin), are read as revolute joints without
    limits: one number in q each, and full turns are counted. Links with their inertia and joints are
    read; shapes, meshes and all else are left out unread.

    Parameters
    ----------
    urdf : str or Path
        A file, or the XML text itself.

    Raises
    ------
    ModelError
        Naming the file and what is wrong: not found, not XML, and see `urdf_check.check_urdf`.
    """
    root, name = parsed_xml(urdf, "URDF")
    if root.tag != "robot":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a URDF starts with <robot>")
    check_urdf(root, name)
    try:
        return pin.buildModelFromXML(ElementTree.tostring(_reduced(root), encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{name}: Pinocchio cannot build a model from it ({error})") from error


def _reduced(root: Element) -> Element:
    """What makes the tree, its numbers rewritten: Python and C++ do not read all of them alike."""
    robot = Element("robot", {"name": root.get("name") or "robot"})
    for link in root.findall("link"):
        to = SubElement(robot, "link", {"name": link.get("name", "")})
        inertial = link.find("inertial")
        if inertial is not None:
            to = SubElement(to, "inertial")
            _place(inertial, to)
            _numbers(inertial, to, "mass", ("value",))
            _numbers(inertial, to, "inertia", (*MOMENTS, *PRODUCTS))
    for joint in root.findall("joint"):
        kind = joint.get("type", "")
        endless = kind == "continuous"
        to = SubElement(
            robot, "joint", {"name": joint.get("name", ""), "type": "revolute" if endless else kind}
        )
        for end in ("parent", "child"):
            SubElement(to, end, {"link": joint.find(end).get("link", "")})  # type: ignore[union-attr]
        _place(joint, to)
        axis = joint.find("axis")
        if axis is not None and kind in MOVING:
            x, y, z = map(float, axis.get("xyz", "").split())
            size = math.hypot(x, y, z)
            SubElement(to, "axis", {"xyz": f"{x / size!r} {y / size!r} {z / size!r}"})
        if endless:
            bounds = {"lower": f"-{UNLIMITED}", "upper": UNLIMITED}
            SubElement(to, "limit", bounds | {"effort": UNLIMITED, "velocity": UNLIMITED})
        else:
            _numbers(joint, to, "limit", LIMITS)
        _numbers(joint, to, "dynamics", ("damping", "friction"))
    return robot


def _place(source: Element, target: Element) -> None:
    _numbers(source, target, "origin", ("xyz", "rpy"))


def _numbers(source: Element, target: Element, tag: str, keys: tuple[str, ...]) -> None:
    """The element of that tag with those of its attributes that are given."""
    element = source.find(tag)
    if element is None:
        return
    given = {key: element.get(key, "").split() for key in keys if key in element.attrib}
    SubElement(target, tag, {key: " ".join(repr(float(x)) for x in words) for key, words in given.items()})
