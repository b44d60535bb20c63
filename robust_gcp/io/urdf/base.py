"""What a URDF stands on: the ground, floating bodies, and the base that a caller asks for."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from ..names import unlike
from .check import WORLD

BASE_JOINT = "root_joint"
"""Name of a free base's joint, as Pinocchio's own reader calls it."""


def declare_world(root: Element) -> None:
    """Add the link `world` where joints hang on it and the file does not declare it, as Drake reads it."""
    if any(link.get("name") == WORLD for link in root.findall("link")):
        return
    if any(parent.get("link") == WORLD for parent in root.findall("joint/parent")):
        root.insert(0, Element("link", {"name": WORLD}))


def set_base(root: Element, base: str | None) -> list[str]:
    """Joints between the ground and the bodies that stand on it.

    Roots beside the link `world` float, unless `base` is "fixed". "fixed" welds what floats on the root link
    where it is. "free" lets a robot float: what is welded to `world` and moves in itself, or else the root
    link.

    Parameters
    ----------
    root : Element
        A checked <robot>; changed in place.
    base : "fixed", "free" or None
        None: as the file says.

    Returns
    -------
    list of str
        Links that keep standing on the ground although `base` is "free", as others float already.
    """
    links = [link.get("name", "") for link in root.findall("link")]
    carried = {
        child.get("link"): joint for joint in root.findall("joint") for child in joint.findall("child")
    }
    roots = [link for link in links if link not in carried]
    if len(roots) > 1:
        for link in roots:
            if link != WORLD:
                _join(root, WORLD, link, "fixed" if base == "fixed" else "floating")
        return []
    ground = roots[0]
    on_ground = [j for j in root.findall("joint") if _end(j, "parent") == ground]
    floating = [j for j in on_ground if j.get("type") == "floating"]
    if base == "fixed":
        for joint in floating:
            joint.set("type", "fixed")
    elif base == "free":
        welded = [j for j in on_ground if j.get("type") == "fixed" and _moves(root, _end(j, "child"))]
        if floating:
            return [_end(joint, "child") for joint in welded]
        if ground == WORLD and welded:
            for joint in welded:
                joint.set("type", "floating")
            return []
        below = WORLD if WORLD not in links else unlike(f"{WORLD}_below", links)
        root.insert(0, Element("link", {"name": below}))
        _join(root, below, ground, "floating")
    return []


def _join(root: Element, parent: str, child: str, kind: str) -> None:
    names = [joint.get("name", "") for joint in root.findall("joint")]
    name = BASE_JOINT if BASE_JOINT not in names else unlike(f"{child}_{BASE_JOINT}", names)
    joint = SubElement(root, "joint", {"name": name, "type": kind})
    SubElement(joint, "parent", {"link": parent})
    SubElement(joint, "child", {"link": child})


def _end(joint: Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _moves(root: Element, link: str) -> bool:
    """Whether a joint below the link moves."""
    below = [link]
    for above in below:  # which grows
        hanging = [joint for joint in root.findall("joint") if _end(joint, "parent") == above]
        if any(joint.get("type") != "fixed" for joint in hanging):
            return True
        below += [_end(joint, "child") for joint in hanging]
    return False
