"""A mechanism as MJCF: its tree, `connect` and `weld` for its closures, springs, dampers, ranges, home."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.constraint.closures import Closure, FrameClosure, PointClosure, RevoluteClosure, frame_of
from ...mechanism.constraint.couplings import CouplingClosure
from ...mechanism.forces.applied_forces import is_known
from ...mechanism.forces.forces import JointTorque
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import Stop
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..names import RESERVED, unlike
from ..written import Lost, Part, note, parts_of, plain_numbers, quaternion, text, whole_closures
from .drives_writer import DrivesWriter
from .stops import solref_of

LEAST = 2e-15
"""Twice the mass, kg, and moment, kg m², that MuJoCo takes for none: a slender rod's about itself."""

THIN, TRIANGLE = 1e-14, 1e-15
"""Shares of the largest moment that each has at least, and that the others exceed it by together: MuJoCo
refuses what rounding takes from a slender rod, or from a lamina."""

ROUNDED = 1e-9
"""Share of a body's largest moment that rounding may leave of another."""

DEGREE = 4
"""Of the polynomials that MuJoCo's couplings have."""


def mjcf_text(mechanism: Mechanism, lost: Lost) -> str:
    """MJCF of a mechanism; what it has no place for goes to `lost`, by kind.

    A revolute closure becomes two `connect` on its axis, whose rows are one more than its own. Equalities
    have MuJoCo's default softness.

    Raises
    ------
    ModelError
        For a closure or a joint that MJCF has not, by name.
    """
    ground, parts = parts_of(mechanism, "MJCF", lost)
    root = Element("mujoco", model=mechanism.name or "mechanism")
    SubElement(root, "compiler", angle="radian", autolimits="false")
    SubElement(root, "option", gravity=text(mechanism.own_model.gravity.linear))
    bodies = [SubElement(root, "worldbody")]
    for part in parts:
        bodies.append(_body(bodies[part.parent], part, lost))
    _tell_bounce(root, mechanism)
    writer = _Ties(mechanism, bodies)
    for body, frames in zip(bodies, [ground, *(part.frames for part in parts)], strict=True):
        for name, place, held_by in frames:
            writer.site(body, name, place)
            if held_by:
                writer.site(body, held_by, place)
    writer.tie()
    drives = DrivesWriter(mechanism, bodies, writer.site_of, lost)
    writer.tendons += drives.tendons
    motors = drives.actuators
    if not mechanism.actuators:
        motors = [Element("motor", joint=n) for n in mechanism.actuated if mechanism.joint(n).single]
    motors += [_constant(force) for force in mechanism.forces if isinstance(force, JointTorque)]
    _filled(root, "tendon", writer.tendons)
    _filled(root, "equality", writer.equalities)
    _filled(root, "actuator", motors)
    keys = {name: key.q for name, key in mechanism.keyframes.items()} | {"home": mechanism.home}
    # home first: `load` has activations from the first one
    written = [_key(name, parts, keys[name]) for name in sorted(keys, key="home".__ne__)]
    if any(drives.activations):
        written[0].set("act", text(drives.activations))
    _filled(root, "keyframe", written)
    moving = [name for name, key in mechanism.keyframes.items() if np.any(key.v)]
    note(lost, "velocities of keyframes", moving)
    note(lost, "forces", [type(force).__name__ for force in mechanism.forces if not is_known(force)])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _key(name: str, parts: list[Part], q: Array) -> Element:
    numbers = [_qpos(part, q) for part in parts]
    return Element("key", name=name, qpos=text(np.concatenate([np.zeros(0), *numbers])))


def _tell_bounce(root: Element, mechanism: Mechanism) -> None:
    """The restitution of stops at the ranges of joints, as the softness that tends to it."""
    bounce = {p.joint: p.restitution for p in mechanism.parts if isinstance(p, Stop) and len(p.joints) == 1}
    for joint in root.iter("joint"):
        if joint.get("limited") and joint.get("name") in bounce:
            joint.set("solreflimit", text(solref_of(bounce[str(joint.get("name"))])))


def _constant(force: JointTorque) -> Element:
    """An actuator that its control does not change."""
    what = {"gaintype": "fixed", "gainprm": "0", "biastype": "affine", "biasprm": repr(float(force.torque))}
    return Element("general", what, joint=force.joint)


def _filled(root: Element, tag: str, parts: list[Element]) -> None:
    if parts:
        SubElement(root, tag).extend(parts)


def _body(parent: Element, part: Part, lost: Lost) -> Element:
    """A body with its joints."""
    place, inertia = part.place, part.inertia
    body = SubElement(
        parent, "body", name=part.body, pos=text(place.translation), quat=quaternion(place.rotation)
    )
    links = part.links
    if links[0][1] == "free" and part.parent:
        raise ModelError(
            f"joint {part.joint.name!r} is free on a moving body, which MJCF has not; write a URDF"
        )
    for name, sort, axis in links:
        if sort == "free":
            if not place.isIdentity(0.0):
                note(lost, "numbers in q of free joints, which are those of the world", [name])
            made = SubElement(body, "joint", name=name, type="free")
        else:
            made = SubElement(body, "joint", name=name, type=sort, axis=text(axis))
        if part.range is not None:
            made.attrib |= {"limited": "true", "range": text(part.range)}
        if part.stiffness:
            made.attrib |= {"stiffness": repr(part.stiffness), "springref": repr(part.rest)}
        if part.effort is not None:
            made.attrib |= {"actuatorfrclimited": "true", "actuatorfrcrange": text(part.effort)}
        if part.friction:
            made.set("frictionloss", repr(part.friction))
        if part.damping:
            made.set("damping", repr(part.damping))
        if np.any(part.armature):
            if sort == "free" or (np.ptp(part.armature) > 0.0 and len(links) == 1):
                note(lost, "armature of joints", [name])
            else:
                made.set("armature", repr(float(part.armature[links.index((name, sort, axis))])))
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 0] *= np.linalg.det(axes)  # no mirror, which no quaternion is
    proper = np.maximum(moments, max(LEAST, THIN * moments[2]))
    short = proper[2] - proper[0] - proper[1]  # of a triangle, which rounding takes a lamina
    proper[1] += max(0.0, short + TRIANGLE * proper[2])
    if np.max(np.abs(proper - moments)) > ROUNDED * moments[2] + LEAST:
        note(lost, "moments of inertia that no body can have, which are raised", [part.body])
    where = {"pos": text(inertia.lever), "quat": quaternion(axes)}
    mass = max(inertia.mass, LEAST)
    SubElement(body, "inertial", where, mass=text([mass]), diaginertia=text(proper))
    return body


def _qpos(part: Part, q: Array) -> Array:
    """A joint's numbers as MuJoCo has them: scalar first, a free body's in the world."""
    numbers = plain_numbers(part.joint, q).copy()
    if part.joint.kind is JointKind.FREE_FLYER:
        numbers = pin.SE3ToXYZQUAT(part.place * pin.XYZQUATToSE3(numbers))
    if part.links[0][1] in ("free", "ball"):
        numbers[-4:] = np.roll(numbers[-4:], 1)
    return numbers


class _Ties:
    """Equalities, the tendons of couplings, and the sites that they need."""

    def __init__(self, mechanism: Mechanism, bodies: list[Element]) -> None:
        self.tendons: list[Element] = []
        self.equalities: list[Element] = []
        self._mechanism, self._bodies, self._sites = mechanism, bodies, set[str]()

    def site(self, body: Element, name: str, place: pin.SE3) -> None:
        """Put a site on a body, unless another has the name."""
        if name in self._sites:
            return
        self._sites.add(name)
        where = {"pos": text(place.translation), "quat": quaternion(place.rotation)}
        SubElement(body, "site", where, name=name)

    def tie(self) -> None:
        """Add everything that ties."""
        for tied in whole_closures(self._mechanism):
            if isinstance(tied, CouplingClosure):
                self._couple(tied)
            else:
                self._close(tied)

    def _close(self, tied: Closure) -> None:
        frames = (tied.frame1, tied.frame2)
        if isinstance(tied, RevoluteClosure):
            points = [np.zeros(3), self._mechanism.length * np.array(tied.across()[0])]
        elif isinstance(tied, (PointClosure, FrameClosure)):
            points = [np.zeros(3)]
        else:
            raise ModelError(
                f"closure {tied.frame1} – {tied.frame2}: MJCF has no equality like {type(tied).__name__}; "
                "cut the loop at another joint, or write a URDF or a folder"
            )
        kind = "weld" if isinstance(tied, FrameClosure) else "connect"
        for point in points:
            one, two = (self._at(frame, point) for frame in frames)
            self.equalities.append(Element(kind, site1=one, site2=two))

    def _couple(self, tied: CouplingClosure) -> None:
        """q₁ = P(q₂), or with further joints a tendon of all that keeps its length."""
        numbers = [*tied.coefficients, *([0.0] * DEGREE)][: DEGREE + 1]
        if len(tied.coefficients) > DEGREE + 1 or (tied.more and tied.higher):
            raise ModelError(
                f"coupling {tied.label}: MJCF has polynomials up to degree {DEGREE} of one joint alone"
            )
        if not tied.more:
            made = Element("joint", joint1=tied.joint1, polycoef=text(numbers))
            if tied.joint2 is not None:
                made.set("joint2", tied.joint2)
            self.equalities.append(made)
            return
        name = f"coupling_{len(self.tendons)}"
        tendon = Element("fixed", name=name)
        pulls = [(tied.joint1, 1.0), (str(tied.joint2), -tied.ratio), *((j, -c) for j, c in tied.more)]
        for joint, arm in pulls:
            SubElement(tendon, "joint", joint=joint, coef=repr(float(arm)))
        self.tendons.append(tendon)
        self.equalities.append(Element("tendon", tendon1=name, polycoef=text([tied.offset, 0, 0, 0, 0])))

    def site_of(self, frame: str) -> str:
        """The site of a frame; its name."""
        return self._at(frame, np.zeros(3))

    def _at(self, frame: str, shift: Array) -> str:
        """The site of a frame, or one beside it; its name."""
        if frame in self._sites and not np.any(shift):
            return frame
        found = frame_of(self._mechanism.own_model, frame, "closures")
        name = unlike(frame, {*self._sites, *RESERVED}, first=2, join="_")
        self.site(self._bodies[found.parentJoint], name, found.placement * pin.SE3(np.eye(3), shift))
        return name
