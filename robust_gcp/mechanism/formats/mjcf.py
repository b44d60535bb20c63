"""MJCF (MuJoCo XML) to a spanning tree with closures."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin

from ...checks import hint
from ...errors import ModelError
from ..closures import Closure, FrameClosure, PointClosure
from ..couplings import AnyClosure
from ..forces import Force, JointDamper, JointSpring
from ..tree import Array
from ..workspace import workspace
from .contents import FileContents, check_base, named
from .mjcf_couplings import coupling_of
from .mjcf_include import with_includes
from .mjcf_left_out import actuated_by
from .mjcf_parts import Element, Reduced, number, vector
from .mjcf_xml import reduced
from .pin_constraints import close_between
from .xml_text import parsed_xml


def read_mjcf(mjcf: str | Path, base: str | None = None) -> FileContents:
    """What a MJCF file describes: spanning tree, loops and couplings, springs and dampers of joints.

    Bodies, joints (`hinge`, `slide`, `ball`, `free`, also several in one body), masses (given, or
    from geoms of simple shape), armature, joint stiffness and damping, gravity, and of equalities `connect`,
    `weld`, `joint` and `tendon` (fixed ones) are read. Equality constraints are rigid whatever their `solref`
    says. Home is qpos0, where every `connect` of two bodies is closed by definition; bodies and sites are
    frames of the same name. Actuators, contacts, limits, dry friction, tendons, sensors, extensions, drag,
    gravity compensation, springs of ball joints and the masses of meshes are left out and listed, mocap
    bodies stand still; what else would change the motion is refused by name.

    Parameters
    ----------
    mjcf : str or Path
        A file, or the XML text itself.
    base : "fixed", "free" or None
        "fixed": bodies with a free joint are fixed where they are at qpos0. "free": the body that stands on
        the ground floats.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    check_base(base)
    root, name = parsed_xml(mjcf, "MJCF")
    text = isinstance(mjcf, str) and mjcf.lstrip("\ufeff \t\r\n").startswith("<")
    root = with_includes(root, name, None if text else Path(mjcf).parent)
    parts = reduced(root, name, base)
    if not parts.joints:
        raise ModelError(f"{name}: no body has a joint; a mechanism needs one at least")
    model = _tree(parts, name)
    _require_complete(model, parts, name)
    model.gravity.linear = parts.gravity
    for joint, (low, high) in parts.ranges.items():  # Pinocchio's parser moves them by ref
        at = model.joints[model.getJointId(joint)].idx_q
        model.lowerPositionLimit[at], model.upperPositionLimit[at] = low, high
    configurations = {str(e.key()): np.array(e.data()) for e in model.referenceConfigurations}
    home = configurations.pop("qpos0")
    for joint, pose in parts.free.items():
        start = model.joints[model.getJointId(joint)].idx_q
        home[start : start + 7] = pin.SE3ToXYZQUAT(pose)
    for label, site in parts.sites.items():
        place = _place_on(model, site.body, name, site.place)
        model.addFrame(pin.Frame(label, *place, pin.FrameType.OP_FRAME), False)
    forces: list[Force] = [JointSpring(*spring) for spring in parts.springs]
    forces += [JointDamper(*damper) for damper in parts.dampers]
    forces += _oscillators(model, parts, home)
    closures: list[AnyClosure] = []
    for i, item in enumerate(parts.equalities):
        if item.tag in ("joint", "tendon"):
            closures.append(coupling_of(model, item, parts, home, name))
        else:
            closures.append(_closure(model, item, i, parts, home, name))
    left_out = [entry for kind, where in parts.unread.items() for entry in named(kind, where)]
    left_out += parts.left_out
    return FileContents(
        model, closures, forces, home, configurations, None, actuated_by(root, parts), left_out
    )


def _tree(parts: Reduced, name: str) -> pin.Model:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "reduced.xml"
        path.write_text(parts.xml, encoding="utf-8")
        try:
            return pin.buildModelFromMJCF(str(path))
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"{name}: Pinocchio cannot build a model from it ({error})") from error


def _require_complete(model: pin.Model, parts: Reduced, name: str) -> None:
    """No body and no joint of the file may be missing in the model."""
    lost = [b for b in parts.bodies if not model.existFrame(b, pin.FrameType.BODY)]
    lost += [j for j in parts.joints if not model.existJointName(j)]
    if lost or model.njoints - 1 != len(parts.joints):
        raise ModelError(
            f"{name}: Pinocchio's parser left out {', '.join(map(repr, lost)) or 'some joints'}; "
            "give every body and joint a name of its own"
        )


def _place_on(model: pin.Model, body: str, where: str, offset: pin.SE3) -> tuple[int, pin.SE3]:
    """Joint that carries a body, and the placement on it of a place given in body axes."""
    if not model.existFrame(body, pin.FrameType.BODY):
        bodies = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise ModelError(f"{where}: there is no body {body!r}{hint(body, bodies)}")
    frame = model.frames[model.getFrameId(body, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement * offset


def _oscillators(model: pin.Model, parts: Reduced, home: Array) -> list[Force]:
    """`springdamper`: stiffness m / (t d)² and damping 2 m / t, with m = 1 / (M⁻¹)ᵢᵢ at qpos0."""
    if not parts.oscillators:
        return []
    M = np.triu(pin.crba(model, workspace(model), home))
    mobility = np.linalg.pinv(M + np.triu(M, 1).T).diagonal()
    found: list[Force] = []
    for joint, time, ratio, rest in parts.oscillators:
        own = float(1.0 / mobility[model.joints[model.getJointId(joint)].idx_v])
        found.append(JointSpring(joint, own / (time * ratio) ** 2, rest))
        found.append(JointDamper(joint, 2.0 * own / time))
    return found


def _closure(
    model: pin.Model, item: Element, position: int, parts: Reduced, home: Array, name: str
) -> Closure:
    label = item.get("name") or f"{item.tag}_{position}"
    where = f"{name}: {item.tag} {label!r}"
    kind = _kind_of(item, where)
    if item.get("site1") or item.get("site2"):
        first, second = (_site_place(model, item.get(key, ""), parts, where) for key in ("site1", "site2"))
        return close_between(model, kind, label, (first, second))
    bodies = (item.get("body1", ""), item.get("body2", "world"))
    data = workspace(model)
    pin.forwardKinematics(model, data, home)
    still = [_place_on(model, body, where, pin.SE3.Identity()) for body in bodies]
    poses = [data.oMi[joint] * placement for joint, placement in still]
    default = None if item.tag == "connect" else (0.0, 0.0, 0.0)
    anchor = pin.SE3(np.eye(3), vector(item, "anchor", 3, where, default))
    relative = poses[0].inverse() * poses[1]  # of body 2 in body 1, at qpos0
    if item.tag == "connect":
        ends = (anchor, relative.inverse() * anchor)
    else:
        ends = (_relative_pose(item, where) or relative * anchor, anchor)
    first, second = ((joint, place * end) for (joint, place), end in zip(still, ends, strict=True))
    return close_between(model, kind, label, (first, second))


def _kind_of(item: Element, where: str) -> type[PointClosure] | type[FrameClosure]:
    """What an equality holds together: MuJoCo scales the rotation rows of a weld by its `torquescale`.

    Any factor but zero leaves a rigid weld as it is; zero leaves its point alone.
    """
    if item.tag == "weld" and number(item, "torquescale", where, 1.0) != 0.0:
        return FrameClosure
    return PointClosure


def _relative_pose(item: Element, where: str) -> pin.SE3 | None:
    """The `relpose` of a weld: where on body 1 the anchor is held; None with a zero quaternion (the default).

    MuJoCo takes its position as that of the anchor, not of body 2's origin.
    """
    pose = vector(item, "relpose", 7, where, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    if not np.any(pose[3:]):
        return None
    w, x, y, z = pose[3:] / np.linalg.norm(pose[3:])
    return pin.SE3(pin.Quaternion(float(w), float(x), float(y), float(z)).toRotationMatrix(), pose[:3])


def _site_place(model: pin.Model, site: str, parts: Reduced, where: str) -> tuple[int, pin.SE3]:
    if site not in parts.sites:
        raise ModelError(f"{where}: there is no site {site!r}{hint(site, list(parts.sites))}")
    return _place_on(model, parts.sites[site].body, where, parts.sites[site].place)
