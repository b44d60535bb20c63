"""Loops and couplings in URDF: the elements beside the tree that close it, as closures.

Read are `<loop>` and `<coupling>` of URDF+, its earlier `<loop_constraint>` (points held together) and
`<joint_constraint>` with a gear ratio, `<loop_joint>` of RigidBodyDynamics.jl, Drake's first parser and
Isaac Sim, `drake:ball_constraint`, `<constraint>` as proposed for URDF in 2026, the standard's `<mimic>`, and
pairs of links that onshape-to-robot names `closing_NAME_1` and `closing_NAME_2`, as points held together.
"""

from __future__ import annotations

import re
from functools import partial
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...checks import hint
from ...errors import ModelError
from ...mechanism.building.body_graph import CLOSURES
from ...mechanism.constraint.closures import AxisClosure, Closure, PointClosure, RevoluteClosure
from ...mechanism.constraint.couplings import AnyClosure
from ...mechanism.constraint.pin_constraints import close_between
from .couplings import coupling, mimic, part
from .numbers import numbers_in, place_in

BALL = "drake:ball_constraint"

CUTS = {
    "loop": ("predecessor", "successor"),
    "loop_joint": ("link1", "link2"),
    "loop_constraint": ("parent", "child"),
    "constraint": ("parent", "child"),
    BALL: ("body_A", "body_B"),
}
"""Elements below <robot> that are cut joints, and their ends, which name links."""

COUPLINGS = {
    "coupling": ("predecessor", "successor", "ratio"),
    "joint_constraint": ("parent", "child", "gear_ratio"),
}
"""Those that couple joints: the ends of two chains, and the ratio."""

LOOP_TAGS = (*CUTS, *COUPLINGS)
"""All that tie links together and are read."""

KINDS = CLOSURES | {"continuous": RevoluteClosure, "ball": PointClosure}
"""Closures by the types of cut joints."""

SUSPECT = re.compile(
    r"loop|constraint|coupl|closure|closing|mimic|gear|weld|connect|bushing|equality|differential"
    r"|(?<![a-z])ties?(?![a-z])",
    re.I,
)
"""Words in a tag that tell of a tie."""

CUT = re.compile(r"(closing_.+)_1")
"""Names of links that onshape-to-robot puts where it cut a loop; the other end's ends in 2."""

ENDS = re.compile(r"(closedloop.*_)A(.*)", re.I)
"""The same in example-parallel-robots, whose robot.yaml says what kind of joint was cut."""

SPRING = "drake:linear_spring_damper"
"""Drake's element for a spring and damper between points of two links."""

TREELIKE = (SPRING, "link", "joint", "material", "transmission", "sensor", "ros2_control", "gazebo")
"""Elements below <robot> whose meaning is known, and that tie nothing (but see `gazebo`)."""

REMEDY = (
    "write the loop as <loop>, <loop_joint>, <constraint>, drake:ball_constraint, <coupling> or <mimic>, or "
    "list its two frames under closed_loop in robot.yaml"
)


def refuse_unknown_ties(root: Element, name: str) -> None:
    """A ModelError for an element that ties links or joints and is not read: it would leave a loop open."""
    links = {e.get("name", "") for e in root.findall("link")}
    joints = {e.get("name", "") for e in root.findall("joint")}
    for element in root:
        tag, label = element.tag, element.get("name", "")
        if tag.startswith("xacro:"):
            raise ModelError(f"{name}: <{tag}> is not expanded; run xacro on the file and load its output")
        if tag in (*LOOP_TAGS, *TREELIKE):
            continue
        told = [text for e in element.iter() for text in (*e.attrib.values(), (e.text or "").strip())]
        ties = len(links & set(told)) > 1 or len(joints & set(told)) > 1
        if ties or SUSPECT.search(tag):
            raise ModelError(f"{name}: <{tag}> {label!r} ties parts together and is not known; {REMEDY}")


def closures_of(root: Element, model: pin.Model, name: str) -> list[AnyClosure]:
    """Closures and couplings of all elements that tie, frames added to the model.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    found: list[AnyClosure] = []
    for i, element in enumerate(root):
        label = element.get("name") or f"{element.tag.replace(':', '_')}_{i}"
        where = f"{name}: <{element.tag}> {label!r}"
        if element.tag in CUTS:
            found.append(_cut_joint(model, element, label, where))
        elif element.tag in COUPLINGS:
            found.append(coupling(root, element, COUPLINGS[element.tag], where))
    found += _cut_by_name(model)
    for joint in root.findall("joint"):
        tag = joint.find("mimic")
        if tag is not None and joint.get("type") != "fixed":
            found.append(mimic(joint, tag, name))
    return found


def _cut_by_name(model: pin.Model) -> list[AnyClosure]:
    """Points held together where the names of links say that a loop was cut."""
    links = {f.name for f in model.frames if f.type == pin.FrameType.BODY}
    found: list[AnyClosure] = []
    for first in sorted(links):
        cut = CUT.fullmatch(first)
        second = f"{cut[1]}_2" if cut else ""
        if second in links and _carrier(model, first) != _carrier(model, second):
            found.append(PointClosure(first, second))
    return found


def open_ends(model: pin.Model) -> list[tuple[str, str]]:
    """Pairs of frames that mark where a loop is cut, and that a robot.yaml ought to close."""
    names = {f.name for f in model.frames}
    pairs = [(name, ENDS.fullmatch(name)) for name in sorted(names)]
    ends = [(name, f"{found[1]}B{found[2]}") for name, found in pairs if found]
    return [(name, other) for name, other in ends if other in names]


def _carrier(model: pin.Model, link: str) -> int:
    return int(model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint)


def _cut_joint(model: pin.Model, element: Element, label: str, where: str) -> Closure:
    """A closure of the element's type between places on two links, of the links where it is at their frames.

    The second place is turned so that its axis has the components of the first one's.
    """
    kind = element.get("type", "spherical" if element.tag in (BALL, "loop_constraint") else "")
    if kind not in KINDS or (kind == "universal" and element.tag != "constraint"):
        raise ModelError(
            f"{where} is of type {kind!r}; loops are closed by revolute, continuous, prismatic, spherical "
            "and fixed ones"
        )
    for other in element.findall("link1")[1:]:  # as Isaac Sim writes it
        other.tag = "link2"
    tags = CUTS[element.tag]
    ends = drake_ends(element, where) if element.tag == BALL else [_end(element, t, where) for t in tags]
    first, second = (on_link(model, link, place, where) for link, place in ends)
    make, aligned = KINDS[kind], True
    if kind == "universal":
        one, two = (_axis(element, tag, where) for tag in tags)
        make = partial(make, axis=tuple(one), axis2=tuple(two))
    elif issubclass(make, AxisClosure):
        one, two = (_axis(element, tag, where) for tag in tags)
        make, aligned = partial(make, axis=tuple(one)), one == two
        if not aligned:
            turn = pin.Quaternion.FromTwoVectors(np.array(one), np.array(two)).matrix()
            second = second[0], second[1] * pin.SE3(turn, np.zeros(3))
    if aligned and all(place is None for _, place in ends):
        closure: Closure = make(*(link for link, _ in ends))
        return closure
    return close_between(model, make, label, (first, second))


def _end(element: Element, tag: str, where: str) -> tuple[str, pin.SE3 | None]:
    """The link at an end of a cut joint, and the place on it: below the end, beside it, or by attributes."""
    end = part(element, tag, where)
    found = [e for e in (element.find(f"{tag}_origin"), end.find("origin")) if e is not None]
    placed = found[0] if found else end
    given = bool(found) or placed.get("xyz") is not None or placed.get("rpy") is not None
    return end.get("link", ""), place_in(placed, where) if given else None


def _axis(element: Element, tag: str, where: str) -> list[float]:
    """The axis at an end of a cut joint: its own, or `<axis>`, which is that of both."""
    own = element.find(f"{tag}_axis")
    given = element.find("axis") if own is None else own
    if given is None:
        # the first two have URDF's own default
        return [1.0, 0.0, 0.0] if element.tag in ("loop_joint", "constraint") else [0.0, 0.0, 1.0]
    axis = numbers_in(given, "xyz", where)
    if not any(axis):
        raise ModelError(f"{where}: its {given.tag} is no direction; give a vector that is not zero")
    return axis


def drake_ends(element: Element, where: str) -> list[tuple[str, pin.SE3]]:
    """The two links that an element of Drake's names, and the points on them."""
    ends = []
    for keys in (("body_A", "p_AP"), ("body_B", "p_BQ")):
        body, point = (drake_part(element, key, where) for key in keys)
        at = pin.SE3(np.eye(3), np.array(numbers_in(point, "value", where)))
        ends.append((body.get("name", ""), at))
    return ends


def drake_part(element: Element, key: str, where: str) -> Element:
    """A part of an element of Drake's, whose tags begin with its own; a ModelError where it is not there."""
    found = element.find(f"{element.tag}_{key}")
    if found is None:
        raise ModelError(f"{where} lacks {element.tag}_{key}; add it")
    return found


def on_link(model: pin.Model, link: str, place: pin.SE3 | None, where: str) -> tuple[int, pin.SE3]:
    """The joint that carries a link, and a place on it, or the link's own, in the joint's frame."""
    if not model.existFrame(link, pin.FrameType.BODY):
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise ModelError(f"{where} names the link {link!r}, which is not there{hint(link, links)}")
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement * (pin.SE3.Identity() if place is None else place)
