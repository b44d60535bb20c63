"""A model of SDF: its links and joints as bodies and joints between them."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.assembly.ranges import WIDE
from ...mechanism.building.bodies import WORLD, Body, BodyJoint
from ...mechanism.constraint.couplings import CouplingClosure
from ...mechanism.tree.tree import Array
from ..urdf.loops import SUSPECT
from .frames import MODEL, Frames, number_of, numbers_of, pose_of

KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "ball": "spherical",
    "fixed": "fixed",
    "universal": "universal",
    "revolute2": "universal",
}
KNOWN = (
    *("link", "joint", "frame", "pose", "model"),
    *("static", "self_collide", "allow_auto_disable", "enable_wind"),
)
"""Elements of a model that are read, or have no bearing on the motion."""

CONSTRAINTS = {"drake:ball_constraint": "spherical", "drake:weld_constraint": "fixed"}

APART = 1e-9
"""m: frames nearer than that coincide."""


class ModelReader:
    """Bodies and joints of a model and of those in it."""

    def __init__(self, name: str) -> None:
        self.name, self.frames = name, Frames(name)
        self.bodies: list[Body] = []
        self.joints: list[BodyJoint] = []
        self.couplings: list[CouplingClosure] = []
        self.left_out: dict[str, list[str]] = {}
        self.apart: list[str] = []
        self._drawn: set[str] = set()
        self._gears: list[tuple[str, float, list[tuple[str, str, Array]]]] = []

    def place(self, model: Element, scope: str, parent: str) -> None:
        """Frames of a model, `scope` before their names; links before all that may hang on them."""
        if model.get("placement_frame"):
            raise ModelError(f"{self.name}: placement_frame is not read; write the model's own <pose>")
        links = model.findall("link")
        inner = [m.get("name", "") for m in model.findall("model")]
        first = scope + (links[0].get("name", "") if links else f"{inner[0]}::{MODEL}" if inner else "")
        pose = model.find("pose")
        above = (
            parent
            if pose is None or not pose.get("relative_to")
            else _outer(scope) + pose.get("relative_to", "")
        )
        self.frames.add(f"{scope}{MODEL}", above, pose_of(pose, self._where(model)), first)
        for element in (*links, *model.findall("frame"), *model.findall("joint")):
            label, pose, where = scope + self._label(element), element.find("pose"), self._where(element)
            if pose is not None and element.tag == "link":
                self._drawn.add(label)
            attached = {"link": "", "frame": element.get("attached_to") or MODEL}.get(element.tag)
            attached = element.findtext("child", "").strip() if attached is None else attached
            # a joint stands in its child's frame; up to SDF 1.6 `frame` is what `relative_to` is since
            nearest = MODEL if element.tag == "link" else attached
            relative = nearest if pose is None else pose.get("relative_to") or pose.get("frame") or nearest
            self.frames.add(
                label, _in(scope, relative), pose_of(pose, where), attached and _in(scope, attached)
            )
        for part in model.findall("model"):
            below = f"{scope}{self._label(part)}::"
            self.place(part, below, f"{scope}{MODEL}")
            self.frames.add(below[:-2], f"{below}{MODEL}", pin.SE3.Identity(), f"{below}{MODEL}")

    def read(self, model: Element, scope: str) -> None:
        """Bodies and joints."""
        for element in model:
            if element.tag == "link":
                self._link(element, scope)
            elif element.tag == "joint":
                self._joint(element, scope)
            elif element.tag == "model":
                self.read(element, f"{scope}{element.get('name')}::")
            elif element.tag in CONSTRAINTS:
                self._constraint(element, scope)
            elif element.tag not in KNOWN:
                if SUSPECT.search(element.tag):
                    raise ModelError(
                        f"{self.name}: <{element.tag}> ties parts and is not known; write a joint"
                    )
                self._leave(f"<{element.tag}>", element.get("name") or "unnamed")

    def _link(self, link: Element, scope: str) -> None:
        label, where, inertial = scope + self._label(link), self._where(link), link.find("inertial")
        if inertial is not None and inertial.get("auto") in ("true", "1"):
            raise ModelError(f"{where}: <inertial auto='true'> is not computed; write <mass> and <inertia>")
        moments, place = np.eye(3), pin.SE3.Identity()
        mass = number_of(inertial, "mass", 1.0, where)
        if inertial is not None:
            place = pose_of(inertial.find("pose"), where)
            for i, j in zip(*np.triu_indices(3), strict=True):
                given = number_of(inertial, f"inertia/i{'xyz'[i]}{'xyz'[j]}", float(i == j), where)
                moments[i, j] = moments[j, i] = given
        if mass < 0.0 or np.linalg.eigvalsh(moments)[0] < -1e-9 * np.abs(moments).max():
            raise ModelError(f"{where}: its mass or a moment of inertia is negative; correct it")
        turned = place.rotation @ moments @ place.rotation.T
        inertia = pin.Inertia(mass, place.translation, turned)
        self.bodies.append(Body(label, self.frames.world(label, where), inertia))
        if link.find("collision") is not None:
            self._leave("contacts of links", label)
        if (link.findtext("gravity") or "true").strip() in ("false", "0"):
            self._leave("links that gravity does not pull", label)

    def _joint(self, joint: Element, scope: str) -> None:
        label, where, kind = scope + self._label(joint), self._where(joint), KINDS.get(joint.get("type", ""))
        if joint.get("type") == "gearbox":
            self._gear(joint, scope, where)
            return
        if kind is None:
            raise ModelError(f"{where} is of type {joint.get('type')!r}; only {', '.join(KINDS)} are read")
        at, ends, names = self.frames.world(label, where), [], []
        for tag in ("parent", "child"):
            given = _in(scope, (joint.findtext(tag) or "").strip())
            names.append(self.frames.body(given, f"{where}: <{tag}>"))
            own = tag == "parent" and given not in (names[0], WORLD)
            here = self._together(joint, at, given, scope, where) if own else at
            ends.append(self.frames.world(names[-1], where).actInv(here))
        axes = [joint.find(tag) for tag in ("axis", "axis2")]
        ways = [
            self._axis(a, at, scope, where)
            for a in axes[: {"spherical": 0, "fixed": 0, "universal": 2}.get(kind, 1)]
        ]
        made = BodyJoint(label, kind, names[0], names[1], ends[0], ends[1], ways)
        self._acting(made, axes, where)
        self.joints.append(made)
        for axis in axes:
            mimic = None if axis is None else axis.find("mimic")
            if mimic is not None:
                # q = multiplier (q_leader − reference) + offset
                ratio = number_of(mimic, "multiplier", 1.0, where)
                offset = number_of(mimic, "offset", 0.0, where) - ratio * number_of(
                    mimic, "reference", 0.0, where
                )
                self.couplings.append(
                    CouplingClosure(label, _in(scope, mimic.get("joint", "")), ratio, offset)
                )

    def _gear(self, joint: Element, scope: str, where: str) -> None:
        """Angles about an axis against a reference body: θ₂ of the child is −ratio θ₁ of the parent."""
        at, pairs = self.frames.world(scope + self._label(joint), where), []
        third = self.frames.body(_in(scope, joint.findtext("gearbox_reference_body", "").strip()), where)
        for tag, axis in (("parent", "axis"), ("child", "axis2")):
            body = self.frames.body(_in(scope, joint.findtext(tag, "").strip()), where)
            pairs.append((third, body, at.rotation @ self._axis(joint.find(axis), at, scope, where)))
        self._gears.append((where, number_of(joint, "gearbox_ratio", 1.0, where), pairs))

    def tie_gears(self) -> None:
        """The gearboxes as couplings of the revolute joints between their bodies."""
        for where, ratio, pairs in self._gears:
            found: list[tuple[str, float]] = []
            for third, body, axis in pairs:
                for one in self.joints:
                    if one.kind == "revolute" and {one.parent, one.child} == {third, body}:
                        turn = self.frames.turn(one.child, where) @ one.on_child.rotation
                        along = float(turn @ one.axes[0] @ axis)
                        found.append((one.name, along if one.child == body else -along))
            if len(found) != 2 or not all(np.isclose(abs(sign), 1.0, atol=1e-6) for _, sign in found):
                raise ModelError(
                    f"{where}: its two bodies need a revolute joint each, along its axes, to the reference"
                )
            (first, one_sign), (second, other_sign) = found
            self.couplings.append(CouplingClosure(second, first, -ratio * np.sign(one_sign * other_sign)))
        tied = {joint for coupling in self.couplings for joint in coupling.joints}
        for one in self.joints:
            one.kept = one.name in tied

    def _together(self, joint: Element, at: pin.SE3, given: str, scope: str, where: str) -> pin.SE3:
        """Where a joint is on its parent, which it names by a frame of its own.

        SDF takes the joint's place alone. Where neither the joint nor its child is given one, the frame is.
        """
        there = self.frames.world(given, where)
        apart = float(np.linalg.norm(at.actInv(there).translation))
        if apart <= APART:
            return at
        child = _in(scope, (joint.findtext("child") or "").strip())
        drawn = joint.find("pose") is not None or child in self._drawn
        self.apart.append(f"{given} ({apart:.3g} m, {'left there' if drawn else 'brought together'})")
        return at if drawn else pin.SE3(at.rotation, there.translation)

    def _acting(self, made: BodyJoint, axes: list[Element | None], where: str) -> None:
        """Ranges, dampers and springs of a joint."""
        single = made.kind in ("revolute", "prismatic")
        for axis in axes:
            dynamics = None if axis is None else axis.find("dynamics")
            # ±1e16 is what SDF itself says where there is no limit
            low, high = (
                number_of(axis, f"limit/{end}", s * 1e16, where) for end, s in (("lower", -1), ("upper", 1))
            )
            if min(abs(low), abs(high)) < WIDE:
                self._leave("limits of joints", made.name)
                made.range = (low, high) if single and low <= high else None
            damping = number_of(dynamics, "damping", 0.0, where)
            stiffness = number_of(dynamics, "spring_stiffness", 0.0, where)
            if single:
                made.damping, made.stiffness = made.damping or damping, made.stiffness or stiffness
                made.rest = number_of(dynamics, "spring_reference", made.rest, where)
            elif damping or stiffness:
                self._leave("springs and dampers of joints with several axes", made.name)
            if single:
                made.friction = max(made.friction, number_of(dynamics, "friction", 0.0, where))
            if number_of(dynamics, "friction", 0.0, where):
                self._leave("dry friction of joints", made.name)
        if made.damping < 0.0:
            raise ModelError(f"{where}: its damping is negative; give N m s/rad or N s/m")

    def _axis(self, axis: Element | None, at: pin.SE3, scope: str, where: str) -> Array:
        """The direction in the joint's frame."""
        xyz = None if axis is None else axis.find("xyz")
        way = np.array(numbers_of("0 0 1" if xyz is None else xyz.text, 3, f"{where}: <xyz>"))
        if not 1e-100 < np.linalg.norm(way) < 1e100:
            raise ModelError(f"{where}: its <xyz> is no direction; give one, such as '0 0 1'")
        seen_from = None if xyz is None else xyz.get("expressed_in")
        if axis is not None and (axis.findtext("use_parent_model_frame") or "").strip() in ("true", "1"):
            seen_from = MODEL
        if seen_from:
            way = at.rotation.T @ self.frames.turn(_in(scope, seen_from), where) @ way
        return np.asarray(way / np.linalg.norm(way))

    def _constraint(self, element: Element, scope: str) -> None:
        """Drake's: points, or frames, of two bodies held together."""
        where, kind = f"{self.name}: <{element.tag}>", CONSTRAINTS[element.tag]
        tags = [("body_A", "p_AP"), ("body_B", "p_BQ")]
        ends, names = [], []
        for (body, point), plain in zip(tags, ("parent", "child"), strict=True):
            given = element.findtext(f"{element.tag}_{body}") or element.findtext(plain) or ""
            frame = _in(scope, given.strip())
            names.append(self.frames.body(frame, where))
            shift = numbers_of(element.findtext(f"{element.tag}_{point}", "0 0 0"), 3, where)
            place = self.frames.world(frame, where) * pin.SE3(np.eye(3), np.array(shift))
            ends.append(self.frames.world(names[-1], where).actInv(place))
        label = f"{scope}constraint_{len(self.joints)}"
        self.joints.append(BodyJoint(label, kind, names[0], names[1], ends[0], ends[1], cut=True))

    def _leave(self, kind: str, label: str) -> None:
        self.left_out.setdefault(kind, []).append(label)

    def _label(self, element: Element) -> str:
        label = element.get("name")
        if not label or label in (WORLD, MODEL):
            raise ModelError(f"{self.name}: a <{element.tag}> has no name of its own; give it one")
        return label

    def _where(self, element: Element) -> str:
        return f"{self.name}: {element.tag} {element.get('name')!r}"


def _in(scope: str, label: str) -> str:
    """A frame's full name."""
    return label if label == WORLD else scope + label


def _outer(scope: str) -> str:
    """The scope around another."""
    above, colons, _ = scope.removesuffix("::").rpartition("::")
    return above + colons
