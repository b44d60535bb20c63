"""A mechanism as MJCF text: the same tree, `connect` for its closures, native springs and dampers."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ...mechanism.forces import JointDamper, JointSpring, PointSpring
from ...mechanism.joints import JointKind
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .parts import Joint, Place, closure_places, frame_place, held_points, joints

THIN = 1e-12
"""A slender rod has no moment about itself, which MuJoCo refuses: it gets this fraction of the largest."""

LEAST = 2e-15
"""Twice the moment that MuJoCo takes for none, kg m²."""


def mjcf(mechanism: Mechanism) -> str:
    """MJCF of a mechanism with hinges, sliders and floating bases; joints keep their names and order.

    Equality constraints have MuJoCo's default softness, and drives are left out: they are set on the data.
    """
    root = ElementTree.Element("mujoco", model=mechanism.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = ElementTree.SubElement(root, "option", gravity=_text(mechanism.own_model.gravity.linear))
    ElementTree.SubElement(option, "flag", contact="disable", autoreset="disable")
    bodies = [ElementTree.SubElement(root, "worldbody")]
    for joint in joints(mechanism):
        bodies.append(_body(bodies[joint.parent], joint, mechanism))
    equality = ElementTree.SubElement(root, "equality")
    for closure, ends in zip(mechanism.closures, closure_places(mechanism), strict=True):
        for shift in held_points(mechanism, closure):
            one, two = (_site(bodies, place, shift) for place in ends)
            ElementTree.SubElement(equality, "connect", site1=one, site2=two)
    springs = [force for force in mechanism.forces if isinstance(force, PointSpring)]
    if springs:
        tendons = ElementTree.SubElement(root, "tendon")
        for spring in springs:
            numbers = {
                "stiffness": spring.stiffness,
                "damping": spring.damping,
                "springlength": spring.rest_length,
            }
            tendon = ElementTree.SubElement(tendons, "spatial", {k: _text([x]) for k, x in numbers.items()})
            for frame in (spring.frame1, spring.frame2):
                site = _site(bodies, frame_place(mechanism, frame), np.zeros(3))
                ElementTree.SubElement(tendon, "site", site=site)
    return ElementTree.tostring(root, encoding="unicode")


def _body(parent: ElementTree.Element, joint: Joint, mechanism: Mechanism) -> ElementTree.Element:
    place, inertia = joint.placement, joint.inertia
    body = ElementTree.SubElement(
        parent, "body", name=joint.name, pos=_text(place.translation), quat=_quaternion(place.rotation)
    )
    if joint.kind is JointKind.FREE_FLYER:
        ElementTree.SubElement(body, "freejoint", name=joint.name)
    else:
        _simple_joint(body, joint, mechanism)
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 0] *= np.linalg.det(axes)
    thin = THIN * (moments.max() or inertia.mass * mechanism.length**2)
    moments = np.maximum(moments, max(thin, LEAST))
    moments[1] += max(0.0, moments[2] - moments[0] - moments[1])  # a lamina's triangle, lost by rounding
    where = {"pos": _text(inertia.lever), "quat": _quaternion(axes)}
    ElementTree.SubElement(body, "inertial", where, mass=_text([inertia.mass]), diaginertia=_text(moments))
    return body


def _simple_joint(body: ElementTree.Element, joint: Joint, mechanism: Mechanism) -> None:
    """A hinge or slider with its springs and dampers."""
    kind = "hinge" if joint.hinge else "slide"
    made = ElementTree.SubElement(body, "joint", name=joint.name, type=kind, axis=_text(joint.axis))
    springs = [f for f in mechanism.forces if isinstance(f, JointSpring) and f.joint == joint.name]
    stiffness = sum(f.stiffness for f in springs)
    if stiffness > 0.0:  # several springs amount to one at their weighted rest
        made.set("stiffness", repr(float(stiffness)))
        made.set("springref", repr(float(sum(f.stiffness * f.rest for f in springs) / stiffness)))
    damping = sum(f.damping for f in mechanism.forces if isinstance(f, JointDamper) and f.joint == joint.name)
    made.set("damping", repr(float(damping)))


def _site(bodies: list[ElementTree.Element], place: Place, shift: Array) -> str:
    """Add a site to a body; its name."""
    joint, at = place
    name = f"site{len(bodies[joint].findall('site'))}_{joint}"
    ElementTree.SubElement(bodies[joint], "site", name=name, pos=_text(at.act(shift)))
    return name


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _quaternion(rotation: Array) -> str:
    """MuJoCo's order: w, x, y, z."""
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return _text((w, x, y, z))
