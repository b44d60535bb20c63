"""Parts of a URDF that the simulation leaves out, in words."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from ...mechanism.assembly.ranges import WIDE
from ...mechanism.contents import named
from .check import MOVING
from .loops import LOOP_TAGS, SPRING
from .numbers import number_in

JOINT_PARTS = ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic", "calibration")
DYNAMICS = {"damping", "friction", "armature", "spring_stiffness", "spring_reference"}
PLAIN = (*LOOP_TAGS, SPRING, "link", "joint", "material", "frame", "fixed_frame")
"""Elements below <robot> that are read, or have no bearing on the motion."""


def left_out_of(root: Element, name: str) -> list[str]:
    """What is there and is not simulated, one entry a kind."""
    joints = [j for j in root.findall("joint") if j.get("type") != "fixed"]
    moving = [j for j in joints if j.get("type") in MOVING]
    links = [link for link in root.findall("link") if link.find("collision") is not None]
    kinds = {
        "dry friction of joints": [_label(j) for j in moving if _friction(j, name) > 0.0],
        "limits of joints": [_label(j) for j in moving if _limited(j, name)],
        "soft limits of joints": [_label(j) for j in joints if j.find("safety_controller") is not None],
        "contacts of links": [_label(link) for link in links],
    }
    unknown: dict[str, list[str]] = {}
    for joint in joints:
        for part in joint:
            if part.tag not in (*JOINT_PARTS, "safety_controller"):
                unknown.setdefault(f"<{part.tag}> of joints", []).append(_label(joint))
        for dynamics in joint.findall("dynamics"):
            for key in dynamics.attrib.keys() - DYNAMICS:
                unknown.setdefault(f"{key} of joints", []).append(_label(joint))
    for element in root:
        if element.tag not in PLAIN and not _is_read(element):
            label = element.get("name") or element.get("reference") or "unnamed"
            unknown.setdefault(f"<{element.tag}>", []).append(label)
    return [
        entry for kind, where in [*kinds.items(), *sorted(unknown.items())] for entry in named(kind, where)
    ]


def _is_read(element: Element) -> bool:
    """Whether nothing is left of it: joints that <gazebo> adds, a transmission straight to a joint."""
    if element.tag == "transmission":
        kind = element.get("type") or element.findtext("type") or ""
        reductions = {(r.text or "").strip() for r in element.iter("mechanicalReduction")}
        return "Simple" in kind and reductions <= {"1", "1.0"} and element.find("joint") is not None
    return element.tag == "gazebo" and len(element) > 0 and all(part.tag == "joint" for part in element)


def _label(element: Element) -> str:
    return element.get("name", "")


def _friction(joint: Element, name: str) -> float:
    return sum(number_in(dynamics, "friction", name, 0.0) for dynamics in joint.findall("dynamics"))


def _limited(joint: Element, name: str) -> bool:
    bounds = [number_in(e, end, name, np.inf) for e in joint.findall("limit") for end in ("lower", "upper")]
    return joint.get("type") in ("revolute", "prismatic") and min(map(abs, bounds), default=np.inf) < WIDE
