"""Loops and couplings in URDF: the elements beside the tree that close it, as closures.

Read are `<loop>` and `<coupling>` of URDF+, its earlier `<loop_constraint>` (points held together) and
`<joint_constraint>` with a gear ratio, `<loop_joint>` of RigidBodyDynamics.jl, Drake's first parser and
Isaac Sim, `drake:ball_constraint`, `<constraint>` as proposed for URDF in 2026, the standard's `<mimic>`, and
pairs of links that onshape-to-robot names `closing_NAME_1` and `closing_NAME_2`, as points held together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ...checks import hint
from ...errors import ModelError
from ...mechanism.constraint.closures import (
    Closure,
    FrameClosure,
    PointClosure,
    PrismaticClosure,
    RevoluteClosure,
    UniversalClosure,
)
from ...mechanism.constraint.couplings import AnyClosure
from ...mechanism.constraint.pin_constraints import close_between
from .couplings import coupling, mimic, part
from .numbers import numbers_in

LOOP_TAGS = (
    "loop",
    "loop_joint",
    "loop_constraint",
    "coupling",
    "joint_constraint",
    "constraint",
    "drake:ball_constraint",
)
"""Elements below <robot> that tie links together and are read."""

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

TREELIKE = (
    SPRING,
    "link",
    "joint",
    "material",
    "transmission",
    "sensor",
    "ros2_control",
    "gazebo",
)
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
        if tag in LOOP_TAGS:
            continue
        if tag in TREELIKE:
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
        if element.tag == "loop":
            ends = part(element, "predecessor", where), part(element, "successor", where)
            found.append(_loop(model, element, label, ends, where, "0 0 1"))
        elif element.tag == "loop_joint":
            links = [e for e in element if e.tag in ("link1", "link2")]
            if len(links) != 2:
                raise ModelError(f"{where} needs <link1 link=…> and <link2 link=…>, where the loop is cut")
            found.append(_loop(model, element, label, (links[0], links[1]), where, "1 0 0"))
        elif element.tag == "loop_constraint":
            placed = [_with_origin(element, tag, where) for tag in ("parent", "child")]
            found.append(_loop(model, element, label, (placed[0], placed[1]), where, "0 0 1"))
        elif element.tag == "constraint":
            found.append(_constraint(model, element, label, where))
        elif element.tag == "drake:ball_constraint":
            found.append(_ball(model, element, label, where))
        elif element.tag == "coupling":
            found.append(coupling(root, element, ("predecessor", "successor", "ratio"), where))
        elif element.tag == "joint_constraint":
            found.append(coupling(root, element, ("parent", "child", "gear_ratio"), where))
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


def _with_origin(element: Element, tag: str, where: str) -> Element:
    """A link of `<loop_constraint>` with the place on it, which stands beside it."""
    origin = element.find(f"{tag}_origin")
    given = {} if origin is None else {key: origin.get(key, "") for key in ("xyz", "rpy") if origin.get(key)}
    return Element(tag, {"link": part(element, tag, where).get("link", "")} | given)


def _constraint(model: pin.Model, element: Element, label: str, where: str) -> Closure:
    """A cut joint with a place and an axis on each of its links; `<axis>` alone is that of both.

    The child's place is turned so that its axis has the components of the parent's.
    """
    placed = [_with_origin(element, tag, where) for tag in ("parent", "child")]
    given = element.find("axis")
    axes = []
    for tag in ("parent", "child"):
        axis = element.find(f"{tag}_axis")
        axis = given if axis is None else axis
        axes.append(np.array(numbers_in(axis, "xyz", where) if axis is not None else (1.0, 0.0, 0.0)))
        if not 0.0 < np.linalg.norm(axes[-1]) < np.inf:
            raise ModelError(f"{where}: its {tag}_axis is no direction; give a vector that is not zero")
    kind = element.get("type", "")
    if kind == "universal":
        one, two = (tuple(axis.tolist()) for axis in axes)
        return _between(model, partial(UniversalClosure, axis=one, axis2=two), label, placed, where)
    if kind in ("revolute", "continuous", "prismatic") and not np.array_equal(axes[0], axes[1]):
        turn = pin.SE3(pin.Quaternion.FromTwoVectors(axes[0], axes[1]).matrix(), np.zeros(3))
        first, second = (_place(model, end, where) for end in placed)
        closing = partial(
            PrismaticClosure if kind == "prismatic" else RevoluteClosure, axis=tuple(axes[0].tolist())
        )
        return close_between(model, closing, label, (first, (second[0], second[1] * turn)))
    element = Element(element.tag, element.attrib)
    SubElement(element, "axis", {"xyz": " ".join(map(repr, axes[0].tolist()))})
    return _between(model, _kind(element, where, ""), label, placed, where)


def _loop(
    model: pin.Model,
    element: Element,
    label: str,
    ends: tuple[Element, Element],
    where: str,
    default_axis: str,
) -> Closure:
    """A cut joint of the element's type between two links."""
    return _between(model, _kind(element, where, default_axis), label, ends, where)


def _between(
    model: pin.Model, make: Callable[[str, str], Closure], label: str, ends: Sequence[Element], where: str
) -> Closure:
    """A closure between places on two links, of the links themselves where it is at their frames."""
    first, second = (_place(model, end, where) for end in ends)
    if not any(end.get("xyz") or end.get("rpy") or end.find("origin") is not None for end in ends):
        return make(*(end.get("link", "") for end in ends))
    return close_between(model, make, label, (first, second))


def _kind(element: Element, where: str, default_axis: str) -> Callable[[str, str], Closure]:
    """The closure of the element's type, its frames open."""
    kind = element.get("type", "spherical" if element.tag == "loop_constraint" else "")
    axis = element.find("axis")
    if kind in ("revolute", "continuous", "prismatic"):
        given = Element("axis", {"xyz": default_axis}) if axis is None else axis
        x, y, z = numbers_in(given, "xyz", where)
        return partial(PrismaticClosure if kind == "prismatic" else RevoluteClosure, axis=(x, y, z))
    if kind in ("spherical", "ball"):
        return PointClosure
    if kind == "fixed":
        return FrameClosure
    raise ModelError(
        f"{where} is of type {kind!r}; loops are closed by revolute, continuous, prismatic, spherical "
        "and fixed ones"
    )


def _ball(model: pin.Model, element: Element, label: str, where: str) -> Closure:
    ends = []
    for body, point in (("A", "AP"), ("B", "BQ")):
        link = element.find(f"drake:ball_constraint_body_{body}")
        at = element.find(f"drake:ball_constraint_p_{point}")
        if link is None or at is None:
            raise ModelError(
                f"{where} lacks drake:ball_constraint_body_{body} or drake:ball_constraint_p_{point}; "
                "give both"
            )
        place = pin.SE3(np.eye(3), np.array(numbers_in(at, "value", where)))
        ends.append(on_link(model, link.get("name", ""), place, where))
    return close_between(model, PointClosure, label, (ends[0], ends[1]))


def _place(model: pin.Model, end: Element, where: str) -> tuple[int, pin.SE3]:
    """A place on a link: by an <origin> below the element, or by xyz and rpy of its own."""
    origin = end.find("origin")
    given = end if origin is None else origin
    xyz = numbers_in(given, "xyz", where) if given.get("xyz") is not None else [0.0, 0.0, 0.0]
    rpy = numbers_in(given, "rpy", where) if given.get("rpy") is not None else [0.0, 0.0, 0.0]
    place = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    return on_link(model, end.get("link", ""), place, where)


def on_link(model: pin.Model, link: str, place: pin.SE3, where: str) -> tuple[int, pin.SE3]:
    """The joint that carries a link, and a place on it in the joint's frame."""
    if not model.existFrame(link, pin.FrameType.BODY):
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise ModelError(f"{where} names the link {link!r}, which is not there{hint(link, links)}")
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement * place
