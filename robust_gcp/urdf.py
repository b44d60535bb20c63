"""URDF to `pin.Model`, with the two traps of the format removed and its faults named."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pinocchio as pin

from .errors import ModelError

UNLIMITED = "1e9"
"""Limit, rad, written for a joint that turns without limits: nothing here enforces limits."""


def model_from_urdf(urdf: str | Path) -> pin.Model:
    """The spanning tree that a URDF describes.

    `continuous` joints, which Pinocchio stores as (cos, sin), are read as revolute joints without
    limits: one number in q each, and full turns are counted.

    Parameters
    ----------
    urdf : str or Path
        A file, or the XML text itself.

    Raises
    ------
    ModelError
        Naming the file and what is wrong: not found, not XML, not a tree, a joint without limits.
    """
    text, name = _read(urdf)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ModelError(f"{name}: not well-formed XML ({error})") from error
    if root.tag != "robot":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a URDF starts with <robot>")
    _check_tree(root, name)
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            for limit in joint.findall("limit"):
                joint.remove(limit)
            bounds = {"lower": f"-{UNLIMITED}", "upper": UNLIMITED}
            ElementTree.SubElement(joint, "limit", bounds | {"effort": UNLIMITED, "velocity": UNLIMITED})
    try:
        return pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{name}: Pinocchio cannot build a model from it ({error})") from error


def _read(urdf: str | Path) -> tuple[str, str]:
    if isinstance(urdf, str) and urdf.lstrip().startswith("<"):
        return urdf, "URDF text"
    path = Path(urdf)
    try:
        return path.read_text(encoding="utf-8"), str(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: cannot be read ({error})") from error


def _check_tree(root: ElementTree.Element, name: str) -> None:
    """Name the faults that the URDF parser reports on stderr only, or not at all."""
    links = [link.get("name") for link in root.findall("link")]
    parent_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        label = joint.get("name")
        ends = {}
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if link not in links:
                raise ModelError(f"{name}: joint {label!r} names the {end} link {link!r}, which is not there")
            ends[end] = str(link)
        child = ends["child"]
        if child in parent_of:
            raise ModelError(
                f"{name}: link {child!r} has two parent joints, {parent_of[child]!r} and {label!r}; a URDF "
                "is a tree: cut the loop at one of them and close it with a pair of frames in robot.yaml"
            )
        parent_of[child] = str(label)
        limit = joint.find("limit")
        if joint.get("type") in ("revolute", "prismatic"):
            missing = [
                key
                for key in ("lower", "upper", "effort", "velocity")
                if limit is None or limit.get(key) is None
            ]
            if missing:
                raise ModelError(
                    f"{name}: joint {label!r} is {joint.get('type')} and its <limit> lacks "
                    f"{', '.join(missing)}; give them, or use type continuous for a joint without limits"
                )
