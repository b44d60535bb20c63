"""Joints that `<gazebo>` adds to a URDF, which close loops: SDF's, between the URDF's links."""

from __future__ import annotations

from functools import partial
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.building.body_graph import CLOSURES
from ...mechanism.constraint.closures import Closure
from ...mechanism.constraint.pin_constraints import close_between
from ..sdf.frames import numbers_of, pose_of
from ..sdf.model import KINDS
from .check import WORLD
from .loops import on_link


def joints_of_gazebo(root: Element, model: pin.Model, name: str) -> list[Closure]:
    """Their closures: a joint is where its <pose> has it on the child, on the parent where that is at zero.

    Raises
    ------
    ModelError
        Naming the joint, for a type that no closure stands for, and for links that are not there.
    """
    found: list[Closure] = []
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    for joint in root.findall("gazebo/joint[child]"):
        where, kind = f"{name}: <gazebo> joint {joint.get('name')!r}", KINDS.get(joint.get("type", ""))
        if kind not in ("revolute", "prismatic", "spherical", "fixed"):
            raise ModelError(
                f"{where} is of type {joint.get('type')!r}; give revolute, prismatic, ball or fixed"
            )
        ends = []
        for tag in ("child", "parent"):
            link = (joint.findtext(tag) or "").strip()
            carrier, place = (0, pin.SE3.Identity()) if link == WORLD else on_link(model, link, None, where)
            ends.append((carrier, place, data.oMi[carrier] * place))
        at = ends[0][2] * pose_of(joint.find("pose"), where)
        make = CLOSURES[kind]
        if kind in ("revolute", "prismatic"):
            axis = np.array(numbers_of(joint.findtext("axis/xyz", "0 0 1"), 3, f"{where}: <xyz>"))
            if (joint.findtext("axis/use_parent_model_frame") or "").strip() in ("true", "1"):
                axis = at.rotation.T @ axis
            make = partial(make, axis=tuple(axis.tolist()))
        places = [(carrier, place * there.actInv(at)) for carrier, place, there in ends]
        found.append(close_between(model, make, joint.get("name") or "gazebo", (places[0], places[1])))
    return found
