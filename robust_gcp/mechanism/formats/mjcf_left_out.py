"""Parts of a MJCF file that the simulation leaves out, in words."""

from __future__ import annotations

from .contents import named
from .mjcf_parts import Defaults, Element, Reduced, words

SECTIONS = ("tendon", "sensor", "extension", "deformable")
"""Sections that are left out and told of; <actuator> and <contact> besides."""


def left_out_of(root: Element, defaults: Defaults, name: str) -> list[str]:
    """What is there beside bodies and is not simulated, one entry a kind."""
    found = named("actuators", (_label(a) for section in root.findall("actuator") for a in section))
    for tag in SECTIONS:
        found += named(f"{tag}s", (_label(e) for section in root.findall(tag) for e in section))
    found += named(
        "contact pairs", (_label(e) for section in root.findall("contact") for e in section.iter("pair"))
    )
    return found + named("contacts of bodies", _colliding(root, defaults, name))


def actuated_by(root: Element, parts: Reduced) -> tuple[str, ...]:
    """Joints that actuators drive, directly or by a fixed tendon."""
    driven: list[str] = []
    for actuator in (a for section in root.findall("actuator") for a in section):
        driven.append(actuator.get("joint", actuator.get("jointinparent", "")))
        driven += [joint for joint, _ in parts.tendons.get(actuator.get("tendon", ""), [])]
    return tuple(joint for joint in dict.fromkeys(driven) if joint in parts.joints)


def _colliding(root: Element, defaults: Defaults, name: str) -> list[str]:
    """Bodies whose shapes may touch others."""
    if any(f.get("contact") == "disable" for f in root.iter("flag")):
        return []
    found: list[str] = []

    def visit(body: Element, inherited: str) -> None:
        inherited = body.get("childclass", inherited)
        for geom in body.findall("geom"):
            geom = defaults.resolved(geom, inherited)
            masks = [
                words(geom, key, name)[0] if key in geom.attrib else 1 for key in ("contype", "conaffinity")
            ]
            if any(masks):
                found.append(body.get("name") or "unnamed")
        for child in body.findall("body"):
            visit(child, inherited)

    for section in root.findall("worldbody"):
        for body in section.findall("body"):
            visit(body, "")
    return found


def _label(element: Element) -> str:
    return element.get("name") or next(
        (element.get(key, "") for key in ("joint", "tendon", "site", "body", "objname") if element.get(key)),
        element.tag,
    )
