"""A mechanism as URDF: its tree, loops as <loop> and <constraint>, couplings as <mimic>, springs, dampers."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.building.body_graph import CLOSURES
from ...mechanism.constraint.closures import AxisClosure, Closure, UniversalClosure, frame_of
from ...mechanism.constraint.couplings import CouplingClosure
from ...mechanism.forces.forces import PointSpring
from ...mechanism.mechanism import Mechanism
from ..written import Lost, Part, parts_of, text, whole_closures
from .loops import SPRING

TYPES = {"slide": "prismatic", "ball": "spherical", "free": "floating"}
KINDS = {closure: kind for kind, closure in CLOSURES.items()}
WIDE = 1e9
"""What is written for a bound that there is not, rad, m, N m, N, rad/s and m/s."""


def urdf_text(mechanism: Mechanism, lost: Lost) -> tuple[str, list[CouplingClosure]]:
    """URDF of a mechanism, and the couplings that no <mimic> amounts to.

    Spherical joints are of the type `spherical` that Bullet and MuJoCo read; armature and springs of joints
    are attributes of <dynamics>, `armature`, and SDF's `spring_stiffness` and `spring_reference`; springs
    between points Drake's `drake:linear_spring_damper`.

    Raises
    ------
    ModelError
        For a closure or a joint that has no place in it, by name.
    """
    ground, parts = parts_of(mechanism, "URDF", lost)
    root = Element("robot", {"name": mechanism.name or "mechanism", "xmlns:drake": "http://drake.mit.edu"})
    SubElement(root, "link", name="world")
    _frames(root, "world", ground)
    leaders: dict[str, CouplingClosure] = {}
    beside = []
    closures = whole_closures(mechanism)
    for tied in closures:
        if isinstance(tied, CouplingClosure):
            simple = tied.joint2 is not None and not tied.higher and not tied.more
            if simple and tied.joint1 not in leaders:
                leaders[tied.joint1] = tied
            else:
                beside.append(tied)
    carriers = ["world", *(part.body for part in parts)]
    for part in parts:
        _body(root, carriers[part.parent], part, leaders.get(part.joint.name))
    plain = {joint.get("name"): joint for joint in root.iterfind("joint") if joint.get("type") != "fixed"}
    if mechanism.closures and all(name in plain for name in mechanism.independent):
        for name, joint in plain.items():  # as in URDF+
            joint.set("independent", str(name in mechanism.independent).lower())
    for i, tied in enumerate(c for c in closures if isinstance(c, Closure)):
        _close(root, mechanism, carriers, f"loop_{i + 1}", tied)
    for spring in (f for f in mechanism.forces if isinstance(f, PointSpring)):
        _spring(root, mechanism, carriers, spring)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n", beside


def _body(root: Element, parent: str, part: Part, follows: CouplingClosure | None) -> None:
    """A joint of the tree, links without mass between the plain ones that it amounts to, and its body."""
    place = part.place
    for i, (name, sort, axis) in enumerate(part.links):
        last = i == len(part.links) - 1
        child = part.body if last else f"{name}_link"
        kind = TYPES.get(sort, "continuous" if part.range is None else "revolute")
        joint = SubElement(root, "joint", name=name, type=kind)
        SubElement(joint, "parent", link=parent)
        SubElement(joint, "child", link=child)
        _origin(joint, place)
        if sort in ("hinge", "slide"):
            SubElement(joint, "axis", xyz=text(axis))
        if kind in ("revolute", "prismatic"):
            low, high = (-WIDE, WIDE) if part.range is None else np.clip(part.range, -WIDE, WIDE).tolist()
            ends = {"lower": repr(low), "upper": repr(high)}
            # urdfdom takes no limit without effort and velocity
            SubElement(joint, "limit", ends, effort=repr(WIDE), velocity=repr(WIDE))
        dynamics: dict[str, str] = {}
        if part.stiffness:
            dynamics = {"spring_stiffness": repr(part.stiffness), "spring_reference": repr(part.rest)}
        if np.any(part.armature):
            of_joint = part.armature if len(part.links) == 1 else part.armature[i : i + 1]
            dynamics["armature"] = text(of_joint if np.ptp(of_joint) else of_joint[:1])
        if part.friction:
            dynamics["friction"] = repr(part.friction)
        if dynamics or part.damping:  # urdfdom takes none without damping
            SubElement(joint, "dynamics", dynamics, damping=repr(part.damping))
        if follows is not None:
            numbers = {"multiplier": repr(float(follows.ratio)), "offset": repr(float(follows.offset))}
            SubElement(joint, "mimic", numbers, joint=str(follows.joint2))
        link = SubElement(root, "link", name=child)
        parent, place = child, pin.SE3.Identity()
    inertia = part.inertia
    if inertia.mass or np.any(inertia.inertia):
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "origin", xyz=text(inertia.lever))
        SubElement(inertial, "mass", value=repr(float(inertia.mass)))
        of = dict(
            zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia.inertia[np.triu_indices(3)], strict=True)
        )
        SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in of.items()})
    _frames(root, part.body, part.frames)


def _frames(root: Element, body: str, frames: list[tuple[str, pin.SE3, str]]) -> None:
    """Links without mass, fixed to a body."""
    for name, place, held_by in frames:
        joint = SubElement(root, "joint", name=held_by or f"{name}_fixed", type="fixed")
        SubElement(joint, "parent", link=body)
        SubElement(joint, "child", link=name)
        _origin(joint, place)
        SubElement(root, "link", name=name)


def _close(root: Element, mechanism: Mechanism, carriers: list[str], label: str, tied: Closure) -> None:
    kind = KINDS.get(type(tied))
    if kind is None:
        raise ModelError(
            f"closure {tied.frame1} – {tied.frame2}: URDF has no loop like {type(tied).__name__}; "
            "cut it at another joint"
        )
    universal = isinstance(tied, UniversalClosure)
    tags = ("parent", "child") if universal else ("predecessor", "successor")
    loop = SubElement(root, "constraint" if universal else "loop", name=label, type=kind)
    for tag, frame in zip(tags, (tied.frame1, tied.frame2), strict=True):
        link, place = _spot(root, mechanism, carriers, frame)
        end = SubElement(loop, tag, link=link)
        if place is not None:
            _origin(loop if universal else end, place, f"{SPRING}_origin" if universal else "origin")
    if isinstance(tied, UniversalClosure):
        SubElement(loop, "parent_axis", xyz=text(tied.axis))
        SubElement(loop, "child_axis", xyz=text(tied.axis2))
    elif isinstance(tied, AxisClosure):
        SubElement(loop, "axis", xyz=text(tied.axis))


def _spring(root: Element, mechanism: Mechanism, carriers: list[str], spring: PointSpring) -> None:
    made = SubElement(root, SPRING)
    for body, point, frame in (("A", "AP", spring.frame1), ("B", "BQ", spring.frame2)):
        link, place = _spot(root, mechanism, carriers, frame)
        SubElement(made, f"{SPRING}_body_{body}", name=link)
        SubElement(
            made, f"{SPRING}_p_{point}", value=text(np.zeros(3) if place is None else place.translation)
        )
    numbers = {"free_length": spring.rest_length, "stiffness": spring.stiffness, "damping": spring.damping}
    for key, value in numbers.items():
        SubElement(made, f"{SPRING}_{key}", value=repr(float(value)))


def _spot(root: Element, mechanism: Mechanism, carriers: list[str], name: str) -> tuple[str, pin.SE3 | None]:
    """A frame as the link of its name, or as a place on the body that it is on."""
    if any(link.get("name") == name for link in root.iterfind("link")):
        return name, None
    frame = frame_of(mechanism.own_model, name, "closures")
    return carriers[frame.parentJoint], frame.placement


def _origin(element: Element, place: pin.SE3, tag: str = "origin") -> None:
    if not place.isIdentity(0.0):
        rpy = text(pin.rpy.matrixToRpy(place.rotation))
        SubElement(element, tag, xyz=text(place.translation), rpy=rpy)
