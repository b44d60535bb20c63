"""The block `robust_gcp` of robot.yaml: checked, with errors that name the file, the key and the remedy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from ..checks import LARGEST, hint, shown
from ..errors import ModelError, RobustGcpError
from ..mechanism.constraint.closures import AxisClosure, Closure
from ..mechanism.constraint.couplings import CouplingClosure
from ..mechanism.forces.forces import Force, JointDamper, JointSpring, JointTorque, PointSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.recommended import Recommended
from ..mechanism.tree.tree import Array
from .robot_yaml import is_list_of_str

Made = TypeVar("Made")

SCHEMA = 1
RANK = 1e-8
"""Dimensionless size below which a velocity of the loops is rounding."""

LISTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "springs": (("joint", "stiffness"), ("rest",)),
    "dampers": (("joint", "damping"), ()),
    "point_springs": (("frames", "stiffness"), ("rest_length", "damping")),
    "couplings": (("joint1",), ("joint2", "ratio", "offset", "higher", "more")),
}
"""Keys under which there are lists of mappings, with the keys of these: required, and optional."""

OWN_KEYS = (
    *("schema", "description", "home", "guess", "gravity", "axes", "torques", "independent", "recommended"),
    *LISTS,
)


def own_block(settings: dict[str, Any], path: Path) -> dict[str, Any]:
    """The block, its keys and schema checked; empty when the file has none."""
    own = settings.get("robust_gcp") or {}
    if not isinstance(own, dict):
        raise ModelError(f"{path}: robust_gcp must be a mapping")
    _require_known(own, OWN_KEYS, path, "robust_gcp")
    if own and own.get("schema", SCHEMA) != SCHEMA:
        raise ModelError(
            f"{path}: robust_gcp.schema is {shown(own['schema'])}, this version reads {SCHEMA}; "
            "update robust_gcp or the file"
        )
    return own


def home_of(own: dict[str, Any], key: str, model: pin.Model, path: Path) -> Array | None:
    """`home` or `guess`: {joint: value or list of values} as q (nq,); joints not named stay neutral."""
    home = own.get(key)
    if home is None:
        return None
    q: Array = pin.neutral(model)
    if not isinstance(home, dict):
        raise ModelError(f"{path}: robust_gcp.{key} must map joint names to values, not {shown(home)}")
    names = list(model.names)
    for name, value in home.items():
        if name not in names:
            raise ModelError(
                f"{path}: robust_gcp.{key} names the joint {shown(name)}; the model has "
                + ", ".join(names[1:])
            )
        joint = model.joints[model.getJointId(name)]
        values = value if isinstance(value, list) else [value]
        if len(values) != joint.nq or not all(map(_is_finite, values)):
            raise ModelError(
                f"{path}: robust_gcp.{key}[{shown(name)}] is {shown(value)}; expected {joint.nq} finite "
                "number(s)"
            )
        q[joint.idx_q : joint.idx_q + joint.nq] = np.array(values, dtype=float)
    return q


def recommended_of(own: dict[str, Any], mechanism: Mechanism, path: Path) -> Recommended:
    """`recommended: {duration: s, step: s, velocity: {joint: rad/s or m/s}}`: how to run from home."""
    where = f"{path}: robust_gcp.recommended"
    block = own.get("recommended") or {}
    if not isinstance(block, dict):
        raise ModelError(f"{where} must be a mapping, not {shown(block)}")
    _require_known(block, ("duration", "step", "velocity"), path, "robust_gcp.recommended")
    numbers = {name: value for name, value in block.items() if name != "velocity"}
    velocity = block.get("velocity") or {}
    if not isinstance(velocity, dict) or not all(map(_is_finite, velocity.values())):
        raise ModelError(f"{where}.velocity must map joint names to finite numbers, not {shown(velocity)}")
    try:
        return Recommended(**numbers, v0=_moving(mechanism, velocity) if velocity else None)
    except RobustGcpError as error:
        raise ModelError(f"{where}: {error}") from error


def _moving(mechanism: Mechanism, velocity: dict[str, float]) -> Array:
    """The smallest v (nv,) at home with K v = 0 and these velocities of joints."""
    joints = [mechanism.joint(name) for name in velocity]
    wide = [name for name, joint in zip(velocity, joints, strict=True) if joint.nv != 1]
    if wide:
        raise ModelError(f"velocity: joint {wide[0]!r} has several velocities; name others")
    named = [joint.idx_v for joint in joints]
    free = np.setdiff1d(np.arange(mechanism.nv), named)
    K, u = mechanism.scaled(mechanism.K(mechanism.home)), np.zeros(mechanism.nv)
    u[named] = np.array(list(velocity.values())) / mechanism.column_scale[named]
    u[free] = np.linalg.lstsq(K[:, free], -K[:, named] @ u[named], rcond=RANK)[0]
    # least squares answer where there is no solution too
    if np.abs(K @ u).max(initial=0.0) > RANK * np.abs(u).max():
        raise ModelError(f"velocity: the loops do not let {', '.join(velocity)} move so")
    v: Array = mechanism.column_scale * u
    return v


def set_gravity(gravity: Any, model: pin.Model, path: Path) -> None:
    """`gravity: [x, y, z]`, m/s²; Pinocchio's −9.81 along z when left out."""
    if gravity is not None:
        model.gravity.linear = np.array(_vector(gravity, f"{path}: robust_gcp.gravity"))


def with_axes(axes: Any, closures: Sequence[Closure], path: Path) -> list[Closure]:
    """`axes: [[x, y, z] or null, ...]`: the axis of each revolute or prismatic closure; z where null."""
    if axes is None:
        return list(closures)
    if not isinstance(axes, list) or len(axes) != len(closures):
        raise ModelError(
            f"{path}: robust_gcp.axes must list an axis or null for each of {len(closures)} loops"
        )
    turned: list[Closure] = []
    for i, (axis, closure) in enumerate(zip(axes, closures, strict=True)):
        if axis is None:
            turned.append(closure)
            continue
        where = f"{path}: robust_gcp.axes[{i}]"
        if not isinstance(closure, AxisClosure):
            raise ModelError(f"{where}: loop {i} is of type {closure.kind!r}, which has no axis; write null")
        x, y, z = _vector(axis, where)
        if x == y == z == 0.0:
            raise ModelError(f"{where} is zero; give a direction")
        turned.append(dataclasses.replace(closure, axis=(x, y, z)))
    return turned


def forces_of(own: dict[str, Any], path: Path) -> list[Force]:
    """`springs`, `dampers`, `point_springs` and `torques`."""
    forces: list[Force] = [*_all_of(own, "springs", JointSpring, path)]
    forces += _all_of(own, "dampers", JointDamper, path)
    forces += _all_of(own, "point_springs", _point_spring, path)
    torques = own.get("torques") or {}
    if not isinstance(torques, dict):
        raise ModelError(f"{path}: robust_gcp.torques must map joint names to N m or N, not {shown(torques)}")
    for name, value in torques.items():
        item = {"joint": name, "torque": value}
        forces.append(_made(JointTorque, item, f"{path}: robust_gcp.torques"))
    return forces


def _point_spring(frames: Any, **numbers: Any) -> PointSpring:
    if not is_list_of_str(frames) or len(frames) != 2:
        raise ModelError(f"frames must be a pair of frame names, not {shown(frames)}")
    return PointSpring(*frames, **numbers)


def couplings_of(own: dict[str, Any], path: Path) -> list[CouplingClosure]:
    """`couplings: [{joint1, joint2, ratio, offset, higher: [...], more: [[joint, number], ...]}]`."""
    return _all_of(own, "couplings", _coupling, path)


def _coupling(higher: Any = None, more: Any = None, **item: Any) -> CouplingClosure:
    lists = {"higher": higher or [], "more": more or []}
    if not all(isinstance(value, list) for value in lists.values()):
        raise ModelError(f"higher and more must be lists, not {shown(lists)}")
    pairs = tuple(tuple(pair) if isinstance(pair, list) else pair for pair in lists["more"])
    item = {"joint2": None, "ratio": 0.0} | item
    return CouplingClosure(**item, higher=tuple(lists["higher"]), more=pairs)


def independent_of(own: dict[str, Any], path: Path) -> list[str] | None:
    """`independent: [joints or joint.component]`: the coordinates, in place of the motors."""
    names = own.get("independent")
    if names is not None and not is_list_of_str(names):
        raise ModelError(f"{path}: robust_gcp.independent must be a list of joint names, not {shown(names)}")
    return names


def _all_of(own: dict[str, Any], key: str, kind: Callable[..., Made], path: Path) -> list[Made]:
    """What the mappings under a key of `LISTS` describe, their keys checked."""
    items, (required, optional) = own.get(key) or [], LISTS[key]
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise ModelError(
            f"{path}: robust_gcp.{key} must be a list of mappings with {', '.join(required)}, not "
            + shown(items)
        )
    found = []
    for i, item in enumerate(items):
        where = f"robust_gcp.{key}[{i}]"
        _require_known(item, required + optional, path, where)
        missing = [name for name in required if name not in item]
        if missing:
            raise ModelError(f"{path}: {where} lacks {', '.join(missing)}; add what is missing")
        found.append(_made(kind, item, f"{path}: {where}"))
    return found


def _made(kind: Callable[..., Made], item: dict[str, Any], where: str) -> Made:
    try:
        return kind(**item)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error


def _require_known(block: dict[Any, Any], known: tuple[str, ...], path: Path, where: str) -> None:
    for key in block:
        if key not in known:
            near = hint(key, known) or f"; known: {', '.join(known)}"
            raise ModelError(f"{path}: unknown key {shown(key)} in {where}{near}")


def _vector(value: Any, where: str) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_finite, value)):
        raise ModelError(f"{where} is {shown(value)}; give three finite numbers [x, y, z]")
    x, y, z = map(float, value)
    return x, y, z


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) < LARGEST
