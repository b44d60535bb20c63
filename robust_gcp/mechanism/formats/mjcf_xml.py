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
from .mjcf_parts import (
    SOLIDS,
    Defaults,
    Element,
    Reduced,
    Site,
    direction,
    flag,
    inertia_of,
    number,
    placement,
    solid_of,
    text_of,
    vector,
    words,
)
from .xml_text import require_shallow

IN_FULL = "let MuJoCo write the model out in full (mujoco.mj_saveLastXML after loading it) and load that file"
SILENT = ("asset", "contact", "custom", "sensor", "size", "statistic", "visual")
"""Sections without a bearing on masses, joints and loops; contacts are not simulated."""

READ = ("compiler", "default", "equality", "keyframe", "option", "worldbody", "actuator", *SILENT)
BODY_PARTS = ("body", "joint", "freejoint", "inertial", "geom", "site", "camera", "light")
RESERVED = ("universe", "world")
REFUSED_COMPILER = {
    "settotalmass": ("-1", "give the masses in full"),
    "boundmass": ("0", "give the masses in full"),
    "boundinertia": ("0", "give the inertias in full"),
    "balanceinertia": ("false", "give inertias that satisfy the triangle inequality"),
    "inertiagrouprange": ("0 5", "give each body an <inertial>"),
    "coordinate": ("local", IN_FULL),
    "alignfree": ("false", "leave it out: it moves the frame of a floating body"),
}


def reduced(root: Element, name: str) -> Reduced:
    """The parts of a MJCF document, its unreadable ones refused.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    if root.tag != "mujoco":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a MJCF file starts with <mujoco>")
    for section in root:
        if section.tag not in READ:
            remedy = IN_FULL if section.tag == "include" else "remove it, or put its effect into torque="
            raise ModelError(f"{name}: <{section.tag}> cannot be read; {remedy}")
    return _Reader(root, name).read()


class _Reader:
    def __init__(self, root: Element, name: str) -> None:
        self._root, self._name = root, name
        self._compiler: dict[str, str] = {}
        for compiler in root.findall("compiler"):
            self._compiler |= compiler.attrib
        self._radians = self._compiler.get("angle", "degree") == "radian"
        self._sequence = self._compiler.get("eulerseq", "xyz")
        self._defaults = Defaults(root, name)
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
        self._check_compiler()
        self._read_option()
        self._check_actuators()
        top = ElementTree.Element("mujoco", {"model": self._root.get("model", "mjcf")})
        ElementTree.SubElement(top, "compiler", {"angle": "radian", "autolimits": "true"})
        world = ElementTree.SubElement(ElementTree.SubElement(top, "worldbody"), "body", {"name": "world"})
        for section in self._root.findall("worldbody"):
            self._read_parts(section, world, "world", "")
        keys = [key for section in self._root.findall("keyframe") for key in section.findall("key")]
        kept = {key.get("name"): key for key in keys if key.get("name") and key.get("qpos")}
        if kept:
            section = ElementTree.SubElement(top, "keyframe")
            for label, key in kept.items():
                ElementTree.SubElement(section, "key", {"name": str(label), "qpos": key.get("qpos", "")})
        self._read_equalities()
        require_shallow(top, self._name)
        self._out.xml = ElementTree.tostring(top, encoding="unicode")
        return self._out

    # ----------------------------------------------------------------- sections

    def _check_compiler(self) -> None:
        for key, (harmless, remedy) in REFUSED_COMPILER.items():
            value = self._compiler.get(key, harmless)
            if value.split() != harmless.split() and not (value == "0" and harmless == "false"):
                raise ModelError(f"{self._name}: compiler {key}={value!r} cannot be read; {remedy}")

    def _read_option(self) -> None:
        for option in self._root.findall("option"):
            if option.get("gravity"):
                self._out.gravity = vector(option, "gravity", 3, self._name)
            for key in ("density", "viscosity", "wind"):
                if words(option, key, self._name).any():
                    raise ModelError(
                        f"{self._name}: option {key} cannot be read; put drag into torque= and remove it"
                    )
            for switches in option.findall("flag"):
                if switches.get("gravity") == "disable":
                    self._out.gravity = np.zeros(3)
                for key in ("equality", "spring", "damper", "passive", "constraint"):
                    if switches.get(key) == "disable":
                        raise ModelError(
                            f"{self._name}: flag {key}='disable' cannot be read; remove the elements instead"
                        )

    def _check_actuators(self) -> None:
        for actuator in (a for section in self._root.findall("actuator") for a in section):
            if actuator.tag != "motor":  # a motor without a command exerts nothing
                raise ModelError(
                    f"{self._name}: actuator <{actuator.tag}> {actuator.get('name', '')!r} exerts forces of "
                    "its own and cannot be read; remove it and give torque= to simulate"
                )

    def _read_equalities(self) -> None:
        for item in (e for section in self._root.findall("equality") for e in section):
            item = self._defaults.resolved(item, "", "equality")
            if not flag(item, "active", True):
                continue
            if item.tag not in ("connect", "weld"):
                raise ModelError(
                    f"{self._name}: equality <{item.tag}> {item.get('name', '')!r} cannot be read; only "
                    "connect and weld close loops here: model the coupling with bodies, or remove it"
                )
            self._out.equalities.append(item)

    # ----------------------------------------------------------------- bodies

    def _read_parts(self, source: Element, target: Element, body: str, inherited: str) -> None:
        """Inertia, sites and children of a body into the reduced one."""
        for part in source:
            if part.tag not in BODY_PARTS:
                raise ModelError(f"{self._name}: <{part.tag}> in body {body!r} cannot be read; {IN_FULL}")
        for site in source.findall("site"):
            site = self._defaults.resolved(site, inherited)
            if site.get("fromto"):
                raise ModelError(f"{self._name}: site {site.get('name')!r}: fromto cannot be read; give pos")
            if site.get("name"):
                self._out.sites[site.get("name", "")] = Site(body, self._placement(site))
        if body != "world":
            self._read_inertia(source, target, body, inherited)
        for child in source.findall("body"):
            self._read_body(child, target, inherited)

    def _read_body(self, source: Element, target: Element, inherited: str) -> None:
        inherited = source.get("childclass", inherited)
        name = source.get("name") or self._fresh("body", "body")
        if number(source, "gravcomp", f"{self._name}: body {name!r}") != 0.0:
            raise ModelError(
                f"{self._name}: body {name!r}: gravcomp cannot be read; put the force into torque="
            )
        if flag(source, "mocap", False):
            raise ModelError(f"{self._name}: body {name!r} is a mocap body; remove it, it moves by itself")
        self._out.bodies.append(name)
        place = self._placement(source)
        joints = [self._defaults.resolved(j, inherited) for j in source if j.tag in ("joint", "freejoint")]
        for i, joint in enumerate(joints):
            last = i == len(joints) - 1
            inner = name if last else self._fresh("body", f"{name}_joint{i}")
            if joint.tag == "freejoint" or joint.get("type") == "free":
                if target.get("name") != "world" or len(joints) > 1:
                    raise ModelError(f"{self._name}: body {name!r}: a free joint stands alone, in the world")
                label = joint.get("name") or self._fresh("joint", f"{name}_free")
                self._out.free[label], place = place, pin.SE3.Identity()
            target = _posed(target, "body", place, {"name": inner})
            self._read_joint(joint, target, name)
            place = pin.SE3.Identity()
        if not joints:
            target = _posed(target, "body", place, {"name": name})
        self._read_parts(source, target, name, inherited)

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
            attributes["axis"] = text_of(direction(axis, where, "axis"))
            attributes["ref"] = repr(number(joint, "ref", where) * unit)
        if kind in ("hinge", "ball"):
            attributes["pos"] = text_of(vector(joint, "pos", 3, where, (0.0, 0.0, 0.0)))
        if kind != "free":
            attributes["armature"] = repr(number(joint, "armature", where))
        elif joint.tag == "joint" and number(joint, "armature", where) != 0.0:
            raise ModelError(f"{where}: armature of a free joint cannot be read; leave it out")
        for key in ("frictionloss", "springdamper"):
            if words(joint, key, where).any():
                raise ModelError(f"{where}: {key} cannot be read; put the force into torque=, remove it here")
        stiffness, damping = number(joint, "stiffness", where), number(joint, "damping", where)
        if stiffness != 0.0 and kind in ("ball", "free"):
            raise ModelError(f"{where}: stiffness of a {kind} joint cannot be read; put it into torque=")
        if stiffness != 0.0:
            self._out.springs.append((name, stiffness, number(joint, "springref", where) * unit))
        if damping != 0.0:
            self._out.dampers.append((name, damping))
        ElementTree.SubElement(target, "joint", attributes)

    def _read_inertia(self, source: Element, target: Element, body: str, inherited: str) -> None:
        from_geom = self._compiler.get("inertiafromgeom", "auto")
        inertial = source.find("inertial")
        if inertial is not None and from_geom != "true":
            given = inertia_of(inertial, f"{self._name}: inertial of body {body!r}")
            _posed(target, "inertial", self._placement(inertial), given)
            return
        for geom in source.findall("geom"):
            geom = self._defaults.resolved(geom, inherited)
            where = f"{self._name}: geom {geom.get('name', '')!r} of body {body!r}"
            if from_geom == "false" or number(geom, "mass", where, 1.0) == 0.0:
                continue
            if "mass" not in geom.attrib and number(geom, "density", where, 1000.0) == 0.0:
                continue
            kind = geom.get("type", "sphere")
            if kind in ("plane", "hfield"):
                continue
            if kind not in SOLIDS or geom.get("mesh") or flag(geom, "shellinertia", False):
                raise ModelError(
                    f"{where}: the inertia of a {'shell' if kind in SOLIDS else kind} cannot be computed; "
                    "give the body an <inertial>"
                )
            keep = solid_of(geom, kind, where)
            if "fromto" in keep:
                ElementTree.SubElement(target, "geom", keep)
            else:
                _posed(target, "geom", self._placement(geom), keep)

    # ----------------------------------------------------------------- helpers

    def _placement(self, element: Element) -> pin.SE3:
        return placement(element, self._radians, self._sequence, self._name)

    def _fresh(self, kind: str, wanted: str) -> str:
        """A name that no other body or joint has."""
        name, count = wanted, 0
        while name in self._names[kind]:
            count += 1
            name = f"{wanted}{count}"
        self._names[kind].add(name)
        return name


def _posed(parent: Element, tag: str, place: pin.SE3, attributes: dict[str, str]) -> Element:
    x, y, z, w = pin.Quaternion(place.rotation).coeffs()
    pose = {"pos": text_of(place.translation), "quat": text_of(np.array([w, x, y, z]))}
    return ElementTree.SubElement(parent, tag, attributes | pose)
