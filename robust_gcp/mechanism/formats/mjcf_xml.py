"""MJCF text reduced to what Pinocchio's parser reads without loss.

Pinocchio reads the first body under <worldbody> only, passes over elements that it does not know,
leaves out joints under <frame> and <replicate>, keeps inactive equality constraints and merges default
classes in its own way. Here defaults are resolved, all bodies hang on one fixed body `world`, bodies
with several joints become chains, angles are radians and orientations quaternions; what would change
the mechanism and cannot be read is refused by name.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from .contents import STAYS
from .mjcf_frames import frame_of, pose_between, with_frames_applied
from .mjcf_left_out import SECTIONS, left_out_of
from .mjcf_masses import Masses
from .mjcf_options import IN_FULL, check_compiler, disabled, drag_of, gravity_of
from .mjcf_parts import (
    Defaults,
    Element,
    Reduced,
    Site,
    direction,
    flag,
    number,
    placement,
    text_of,
    vector,
    words,
)
from .xml_text import require_shallow

SILENT = ("asset", "contact", "custom", "size", "statistic", "visual")
"""Sections without a bearing on masses, joints and loops."""

READ = ("compiler", "default", "equality", "keyframe", "option", "worldbody", "actuator", *SECTIONS, *SILENT)
BODY_PARTS = ("body", "joint", "freejoint", "inertial", "geom", "site", "camera", "light")
RESERVED = ("universe", "world")


EQUALITIES = ("connect", "weld", "joint", "tendon")
ROOT_JOINT = "root_joint"
FREE_NUMBERS = 7


def reduced(root: Element, name: str, base: str | None = None) -> Reduced:
    """The parts of a MJCF document, its unreadable ones refused; `base` as in `mjcf.read_mjcf`.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    if root.tag != "mujoco":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a MJCF file starts with <mujoco>")
    for section in root:
        if section.tag not in READ:
            raise ModelError(
                f"{name}: <{section.tag}> cannot be read; remove it, or put its effect into torque="
            )
    return _Reader(root, name, base).read()


class _Reader:
    def __init__(self, root: Element, name: str, base: str | None) -> None:
        self._root, self._name, self._base = root, name, base
        self._numbers: list[tuple[int, str | None]] = []
        """Numbers in qpos of each joint of the file, and what to write in their place; None: themselves."""
        self._compiler: dict[str, str] = {}
        for compiler in root.findall("compiler"):
            self._compiler |= compiler.attrib
        self._radians = self._compiler.get("angle", "degree") == "radian"
        self._sequence = self._compiler.get("eulerseq", "xyz")
        self._disabled = disabled(root)
        with_frames_applied(root, name, self._radians, self._sequence)
        self._defaults = Defaults(root, name)
        self._masses = Masses(self._compiler, self._defaults, name, self._placement)
        self._out = Reduced()
        self._names: dict[str, set[str]] = {"body": {"world"}, "joint": set()}
        for kind in self._names:
            self._names[kind] |= {e.get("name", "") for e in root.iter(kind)}
        for element in root.iter():
            if element.tag in ("body", "joint", "freejoint", "site") and element.get("name") in RESERVED:
                raise ModelError(
                    f"{name}: a {element.tag} is named {element.get('name')!r}, which is the ground; "
                    "rename it"
                )

    def read(self) -> Reduced:
        check_compiler(self._compiler, self._name)
        self._out.gravity = gravity_of(self._root, self._name)
        self._out.left_out = left_out_of(self._root, self._defaults, self._name)
        self._out.unread["drag of a medium"] = drag_of(self._root, self._name)
        self._read_tendons()
        if self._base == "free":
            self._let_float()
        top = ElementTree.Element("mujoco", {"model": self._root.get("model", "mjcf")})
        ElementTree.SubElement(top, "compiler", {"angle": "radian", "autolimits": "true"})
        world = ElementTree.SubElement(ElementTree.SubElement(top, "worldbody"), "body", {"name": "world"})
        for section in self._root.findall("worldbody"):
            self._read_parts(section, world, "world", "", True)
        keys = [key for section in self._root.findall("keyframe") for key in section.findall("key")]
        kept = {key.get("name") or f"key{i}": key for i, key in enumerate(keys) if key.get("qpos")}
        if kept:
            section = ElementTree.SubElement(top, "keyframe")
            for label, key in kept.items():
                qpos = self._configuration(key, f"{self._name}: keyframe {label!r}")
                ElementTree.SubElement(section, "key", {"name": label, "qpos": qpos})
        self._read_equalities()
        self._masses.write()
        self._out.unread["masses of meshes on bodies"] = self._masses.meshes
        require_shallow(top, self._name)
        self._out.xml = ElementTree.tostring(top, encoding="unicode")
        return self._out

    # ----------------------------------------------------------------- sections

    def _read_tendons(self) -> None:
        for tendon in (e for section in self._root.findall("tendon") for e in section.findall("fixed")):
            where = f"{self._name}: tendon {tendon.get('name', '')!r}"
            arms = [(j.get("joint", ""), number(j, "coef", where)) for j in tendon.findall("joint")]
            self._out.tendons[tendon.get("name", "")] = arms

    def _let_float(self) -> None:
        """Give the one body that stands on the ground a free joint, unless something floats already."""
        bodies = [b for section in self._root.findall("worldbody") for b in section.findall("body")]
        tied = [b for b in bodies if any(e.tag in ("joint", "freejoint") for e in b)]
        floating = [b for b in bodies if any(_is_free(e) for e in b)]
        if floating:
            for body in bodies:
                if body not in floating and any(e.tag == "joint" for e in body.iter()):
                    self._out.leave_out(STAYS, body.get("name", "unnamed"))
            return
        if len(bodies) != 1 or tied:
            raise ModelError(
                f"{self._name}: base='free' needs one body that stands on the ground by itself, and there "
                f"are {len(bodies)} ({len(tied)} on joints); put them into one body"
            )
        bodies[0].insert(0, ElementTree.Element("freejoint", {"name": self._fresh("joint", ROOT_JOINT)}))

    def _configuration(self, key: Element, where: str) -> str:
        """The numbers of a keyframe for the joints that are kept."""
        given, at, kept = words(key, "qpos", where).tolist(), 0, []
        for count, instead in self._numbers:
            kept.append(text_of(given[at : at + count]) if instead is None else instead)
            at += count
        if at != len(given):
            raise ModelError(f"{where} has {len(given)} numbers in qpos, and the joints have {at}")
        return " ".join(kept)

    def _read_equalities(self) -> None:
        if not self._disabled.isdisjoint(("equality", "constraint")):
            return
        for item in (e for section in self._root.findall("equality") for e in section):
            item = self._defaults.resolved(item, "", "equality")
            if not flag(item, "active", True):
                continue
            if item.tag not in EQUALITIES:
                raise ModelError(
                    f"{self._name}: equality <{item.tag}> {item.get('name', '')!r} cannot be read; only "
                    f"{', '.join(EQUALITIES)} are: model it with bodies, or remove it"
                )
            self._out.equalities.append(item)

    # ----------------------------------------------------------------- bodies

    def _read_parts(self, source: Element, target: Element, body: str, inherited: str, still: bool) -> None:
        """Inertia, sites and children of a body into the reduced one; `still`: it is part of the ground."""
        for part in source:
            if part.tag not in BODY_PARTS:
                raise ModelError(f"{self._name}: <{part.tag}> in body {body!r} cannot be read; {IN_FULL}")
        for site in source.findall("site"):
            site = self._defaults.resolved(site, inherited)
            if site.get("name"):
                pose = self._placement(site) if not site.get("fromto") else pose_between(site, self._name)
                self._out.sites[site.get("name", "")] = Site(body, pose)
        if source.tag == "body":
            self._masses.read(source, None if still else target, body, inherited)
        for child in source.findall("body"):
            self._read_body(child, target, inherited, still)

    def _read_body(self, source: Element, target: Element, inherited: str, still: bool) -> None:
        inherited = source.get("childclass", inherited)
        name = source.get("name") or self._fresh("body", "body")
        if number(source, "gravcomp", f"{self._name}: body {name!r}") != 0.0:
            self._out.leave_out("gravity compensation of bodies", name)
        if flag(source, "mocap", False):
            self._out.leave_out("motion of mocap bodies", name)
        self._out.bodies.append(name)
        place = self._placement(source)
        joints = [self._defaults.resolved(j, inherited) for j in source if j.tag in ("joint", "freejoint")]
        if self._base == "fixed" and any(_is_free(j) for j in joints):
            joints = []
            self._numbers.append((FREE_NUMBERS, ""))
        for i, joint in enumerate(joints):
            last = i == len(joints) - 1
            inner = name if last else self._fresh("body", f"{name}_joint{i}")
            if _is_free(joint):
                if target.get("name") != "world" or len(joints) > 1:
                    raise ModelError(f"{self._name}: body {name!r}: a free joint stands alone, in the world")
                label = joint.get("name") or self._fresh("joint", f"{name}_free")
                added = self._base == "free" and label.startswith(ROOT_JOINT)
                self._numbers.append((0 if added else FREE_NUMBERS, self._pose(place) if added else None))
                self._out.free[label], place = place, pin.SE3.Identity()
            target = _posed(target, "body", place, {"name": inner})
            self._read_joint(joint, target, name)
            place = pin.SE3.Identity()
        if not joints:
            target = _posed(target, "body", place, {"name": name})
        self._read_parts(source, target, name, inherited, still and not joints)

    def _read_joint(self, joint: Element, target: Element, body: str) -> None:
        kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
        free_name = next(reversed(self._out.free)) if kind == "free" else ""
        name = free_name or joint.get("name") or self._fresh("joint", f"{body}_joint")
        where = f"{self._name}: joint {name!r}"
        self._out.joints.append(name)
        attributes = {"name": name, "type": kind}
        unit = math.pi / 180.0 if kind == "hinge" and not self._radians else 1.0
        if kind in ("hinge", "slide"):
            axis = vector(joint, "axis", 3, where, (0.0, 0.0, 1.0))
            if not axis.any():
                raise ModelError(f"{where}: its axis is zero; give a direction")
            attributes["axis"] = text_of(frame_of(joint).rotation @ direction(axis, where, "axis"))
            attributes["ref"] = repr(number(joint, "ref", where) * unit)
        if kind in ("hinge", "ball"):
            attributes["pos"] = text_of(frame_of(joint).act(vector(joint, "pos", 3, where, (0.0, 0.0, 0.0))))
        if kind != "free":
            self._numbers.append((4 if kind == "ball" else 1, None))
            attributes["armature"] = repr(number(joint, "armature", where))
        elif joint.tag == "joint" and number(joint, "armature", where) != 0.0:
            self._out.leave_out("armature of free joints", name)
        if number(joint, "frictionloss", where) != 0.0:
            self._out.leave_out("dry friction of joints", name)
        self._read_range(joint, name, kind, unit, where)
        self._read_forces(joint, name, kind, unit, where)
        ElementTree.SubElement(target, "joint", attributes)

    def _read_range(self, joint: Element, name: str, kind: str, unit: float, where: str) -> None:
        limited = joint.get("limited", "auto")
        if limited == "auto" and flag(ElementTree.Element("compiler", self._compiler), "autolimits", True):
            limited = "true" if joint.get("range") and kind != "free" else "false"
        if limited != "true":
            return
        self._out.leave_out("limits of joints", name)
        if kind in ("hinge", "slide"):
            low, high = vector(joint, "range", 2, where, (0.0, 0.0)) * unit
            self._out.ranges[name] = (float(low), float(high))

    def _read_forces(self, joint: Element, name: str, kind: str, unit: float, where: str) -> None:
        """Springs and dampers of a joint, unless the options switch them off."""
        springs = self._disabled.isdisjoint(("spring", "passive"))
        dampers = self._disabled.isdisjoint(("damper", "passive"))
        stiffness, damping = number(joint, "stiffness", where), number(joint, "damping", where)
        rest = number(joint, "springref", where) * unit
        time, ratio = vector(joint, "springdamper", 2, where, (0.0, 0.0))
        if time > 0.0 and ratio > 0.0 and kind in ("hinge", "slide") and springs and dampers:
            self._out.oscillators.append((name, time, ratio, rest))
            return
        if (stiffness != 0.0 or time > 0.0) and springs and kind in ("ball", "free"):
            self._out.leave_out("springs of ball and free joints", name)
        elif stiffness != 0.0 and springs:
            self._out.springs.append((name, stiffness, rest))
        if damping != 0.0 and dampers:
            self._out.dampers.append((name, damping))

    # ----------------------------------------------------------------- helpers

    def _placement(self, element: Element) -> pin.SE3:
        return frame_of(element) * placement(element, self._radians, self._sequence, self._name)

    def _pose(self, place: pin.SE3) -> str:
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        return text_of([*place.translation, w, x, y, z])

    def _fresh(self, kind: str, wanted: str) -> str:
        """A name that no other body or joint has."""
        name, count = wanted, 0
        while name in self._names[kind]:
            count += 1
            name = f"{wanted}{count}"
        self._names[kind].add(name)
        return name


def _is_free(joint: Element) -> bool:
    return joint.tag == "freejoint" or joint.get("type") == "free"


def _posed(parent: Element, tag: str, place: pin.SE3, attributes: dict[str, str]) -> Element:
    x, y, z, w = pin.Quaternion(place.rotation).coeffs()
    pose = {"pos": text_of(place.translation), "quat": text_of(np.array([w, x, y, z]))}
    return ElementTree.SubElement(parent, tag, attributes | pose)
