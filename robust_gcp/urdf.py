"""URDF to `pin.Model`, with the two traps of the format removed and its faults named."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pinocchio as pin

from .errors import ModelError
from .urdf_check import check_urdf

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
        Naming the file and what is wrong: not found, not XML, and see `urdf_check.check_urdf`.
    """
    text, name = _read(urdf)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ModelError(f"{name}: not well-formed XML ({error})") from error
    if root.tag != "robot":
        raise ModelError(f"{name}: the root element is <{root.tag}>, a URDF starts with <robot>")
    check_urdf(root, name)
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
