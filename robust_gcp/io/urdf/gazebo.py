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


def joints_of_gazebo(root: Element, model: pin.Model, name: str) -> list[Closure]:
    """Their closures: a joint is where its <pose> has it on the child, on the parent where that is at zero.

    Raises
    ------
    ModelError
        Naming the joint, for a type that no closure stands for, and for links that are not there.
    """
    found: list[Closure] = []
    data = model.createData()
    for joint in (
        j for e in root.findall("gazebo") for j in e.findall("joint") if j.find("child") is not None
    ):
        where, kind = f"{name}: <gazebo> joint {joint.get('name')!r}", KINDS.get(joint.get("type", ""))
        if kind not in ("revolute", "prismatic", "spherical", "fixed"):
            raise ModelError(
                f"{where} is of type {joint.get('type')!r}; give revolute, prismatic, ball or fixed"
            )
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        ends = []
        for tag in ("child", "parent"):
            link = (joint.findtext(tag) or "").strip()
            if link != "world" and not model.existFrame(link, pin.FrameType.BODY):
                raise ModelError(f"{where} names the link {link!r}, which is not there; correct its <{tag}>")
            index = model.getFrameId(link, pin.FrameType.BODY) if link != "world" else 0
            ends.append((model.frames[index], data.oMf[index]))
        at = ends[0][1] * pose_of(joint.find("pose"), where)
        make = CLOSURES[kind]
        if kind in ("revolute", "prismatic"):
            axis = np.array(numbers_of(joint.findtext("axis/xyz", "0 0 1"), 3, f"{where}: <xyz>"))
            if (joint.findtext("axis/use_parent_model_frame") or "").strip() in ("true", "1"):
                axis = at.rotation.T @ axis
            make = partial(make, axis=tuple(axis.tolist()))
        places = [(int(f.parentJoint), f.placement * place.actInv(at)) for f, place in ends]
        found.append(close_between(model, make, joint.get("name") or "gazebo", (places[0], places[1])))
    return found
