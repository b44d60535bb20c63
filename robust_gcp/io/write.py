"""A mechanism to a file, by its suffix: MJCF, URDF, or a folder of robot.urdf and robot.yaml."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import ModelError, ModelWarning
from ..mechanism.actuation.actuators import Actuator
from ..mechanism.actuation.tendon_springs import TendonSpring
from ..mechanism.forces.applied_forces import is_known
from ..mechanism.forces.forces import JointTorque
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import Stop
from ..warning import warn
from .mjcf.writer import mjcf_text
from .text_file import path_of
from .urdf.writer import urdf_text
from .written import Lost, links_of, note, plain_numbers

SUFFIXES = (".xml", ".mjcf", ".urdf", "")


def write(mechanism: Mechanism, path: str | Path) -> Path:
    """Write a mechanism; a ModelWarning tells what the format has no place for.

    Raises
    ------
    ModelError
        For a suffix that is none of `SUFFIXES`, a closure, coupling or joint that the format has not, or a
        file that cannot be written.
    """
    target = path_of(path, "write")
    lost: Lost = {}
    if not target.name:
        raise ModelError(f"write: {str(path)!r} names no file; give one, or a folder to be made")
    if target.suffix not in SUFFIXES:
        raise ModelError(
            f"{target}: mechanisms are written as .xml (MJCF), .urdf, or a folder without a suffix"
        )
    try:
        if target.suffix in (".xml", ".mjcf"):
            files = {target: mjcf_text(mechanism, lost)}
        elif target.suffix:
            files = {target: _urdf(mechanism, lost)}
        else:
            files = _folder(mechanism, target, lost)
    except ModelError as error:
        raise ModelError(f"{target}: {error}") from error
    note(lost, "sensors", mechanism.sensors)
    note(lost, "that joints move the ground, which are free there", mechanism.moved)
    if target.suffix not in (".xml", ".mjcf"):
        note(lost, "keyframes", mechanism.keyframes)
        bouncing = [part for part in mechanism.parts if isinstance(part, Stop) and part.restitution]
        note(lost, "restitution of stops", [part.joint for part in bouncing])
    try:
        for file, text in files.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ModelError(f"{target}: cannot be written ({error.strerror or error})") from error
    if lost:
        kinds = "; ".join(f"{what} ({', '.join(names)})" for what, names in lost.items())
        warn(f"{target}: not written, or not as it is: {kinds}", ModelWarning)
    return target


def _urdf(mechanism: Mechanism, lost: Lost) -> str:
    text, couplings = urdf_text(mechanism, lost)
    if couplings:
        raise ModelError(
            f"coupling {couplings[0].label}: URDF has <mimic> alone, a multiple of one joint; write a folder"
        )
    gravity = mechanism.own_model.gravity.linear
    if not np.array_equal(gravity, pin.Model.gravity981):
        note(lost, "gravity, which a URDF does not tell", [np.array2string(gravity)])
    _note_acting(mechanism, lost, (TendonSpring, JointTorque))
    return text


def _note_acting(mechanism: Mechanism, lost: Lost, forces: tuple[type, ...]) -> None:
    """Forces of these kinds, tendons, and actuators that are more than a motor of the joint of that name."""
    apart = [force for force in mechanism.forces if isinstance(force, forces) or not is_known(force)]
    note(lost, "forces", [type(force).__name__ for force in apart])
    plain = [Actuator.motor(joint, joint) for joint in mechanism.actuated]
    note(lost, "actuators", [actuator.name for actuator in mechanism.actuators if actuator not in plain])
    note(lost, "tendons", list(mechanism.tendons))


def _folder(mechanism: Mechanism, folder: Path, lost: Lost) -> dict[Path, str]:
    """robot.urdf, and robot.yaml for what URDF has no place for."""
    text, couplings = urdf_text(mechanism, lost)
    torques: dict[str, float] = {}
    for force in mechanism.forces:
        if isinstance(force, JointTorque):
            torques[force.joint] = torques.get(force.joint, 0.0) + float(force.torque)
    _note_acting(mechanism, lost, (TendonSpring,))
    names = {j.name: [n for n, *_ in links_of(mechanism.own_model, j, "URDF")] for j in mechanism.joints}
    rec = mechanism.recommended
    run: dict[str, Any] = {"duration": float(rec.duration), "step": float(rec.step)}
    if rec.v0 is not None:
        run["velocity"] = {j.name: float(rec.v0[j.idx_v]) for j in mechanism.joints if j.single}
    own: dict[str, Any] = {
        "schema": 1,
        "gravity": mechanism.own_model.gravity.linear.tolist(),
        "independent": _independent(mechanism, names),
        "home": _home(mechanism, names),
        "recommended": run,
        "torques": torques,
        "couplings": [dataclasses.asdict(tied) for tied in couplings],
    }
    lines = [f"name_mot: {json.dumps(list(mechanism.actuated))}"] if mechanism.actuated else []
    lines += ["robust_gcp:", *(f"  {key}: {json.dumps(value)}" for key, value in own.items() if value)]
    return {folder / "robot.urdf": text, folder / "robot.yaml": "\n".join(lines) + "\n"}


def _independent(mechanism: Mechanism, names: dict[str, list[str]]) -> list[str]:
    """The coordinates by the names of the joints that are written."""
    found: list[str] = []
    for coordinate in mechanism.independent:
        if coordinate in names:
            found += names[coordinate]
            continue
        joint = mechanism.joint_at(mechanism.velocities_of(coordinate)[0])
        parts = [c.name for c in joint.components if c.iv >= 0]
        split = names[joint.name]
        found.append(coordinate if len(split) == 1 else split[parts.index(coordinate)])
    return found


def _home(mechanism: Mechanism, names: dict[str, list[str]]) -> dict[str, Any]:
    """The numbers of each joint that is written."""
    found: dict[str, Any] = {}
    for joint in mechanism.joints:
        numbers, split = plain_numbers(joint, mechanism.home).tolist(), names[joint.name]
        if len(split) == 1:
            found[split[0]] = numbers if len(numbers) > 1 else numbers[0]
        else:
            found |= dict(zip(split, numbers, strict=True))
    return found
