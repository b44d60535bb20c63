"""A mechanism as numbers and words, for a file: what its tree, its closures and all on them is made of."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...checks import shown
from ...errors import OptionError
from ...mechanism.actuation.actuators import Actuator
from ...mechanism.actuation.muscle import Muscle
from ...mechanism.actuation.paths import FixedTendon, TurningJoint
from ...mechanism.actuation.site_paths import SiteForce, SliderCrank
from ...mechanism.actuation.spatial_tendon import Pulley, SpatialTendon, Wrap
from ...mechanism.assembly.keyframes import Keyframe, Keyframes
from ...mechanism.constraint.closures import closure_kinds
from ...mechanism.constraint.couplings import CouplingClosure
from ...mechanism.forces.applied_forces import STORED
from ...mechanism.forces.forces import Force
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import JointFriction, Lock, Stop
from ...mechanism.sensing.sensors import Sensors, sensor_from
from ...mechanism.tree.tree import Array

OWN = "a class of its own"
"""In place of its kind, for a force that is none of `STORED`."""


def mechanism_as_plain(mechanism: Mechanism) -> dict[str, Any]:
    """All but its tree and home."""
    return {
        "name": mechanism.name,
        "independent": mechanism.independent,
        "actuated": mechanism.actuated,
        "actuators": [_as_plain(a) for a in mechanism.actuators],
        "tendons": {name: _as_plain(path) for name, path in mechanism.tendons.items()},
        "left_out": mechanism.left_out,
        "moved": mechanism.moved,
        "closures": [_as_plain(c) for c in mechanism.closures],
        "forces": [_as_plain(f) for f in mechanism.forces],
        "stops": [_as_plain(p) for p in mechanism.parts if not isinstance(p, Lock) or p.when is None],
        "sensors": [asdict(sensor) for sensor in mechanism.sensors.values()],
        "keyframes": {
            name: [key.q.tolist(), key.v.tolist(), key.closed, key.open]
            for name, key in mechanism.keyframes.items()
        },
    }


def _parts() -> dict[str, type[Any]]:
    """What an archive may hold besides numbers: closures, forces, stops by the names of their classes."""
    paths = FixedTendon, TurningJoint, SiteForce, SliderCrank, SpatialTendon, Pulley, Wrap
    kinds: list[type[Any]] = [*closure_kinds(), CouplingClosure, *STORED, Stop, JointFriction, Lock]
    kinds += [*paths, Actuator, Muscle]
    return {kind.__name__: kind for kind in kinds}


def _as_plain(part: Any) -> dict[str, Any]:
    """A closure or force as its numbers; a force of the user's class as text, since code is not stored."""
    if isinstance(part, Force) and type(part) not in STORED:
        return {"kind": OWN, "called": shown(part)}
    return {"kind": type(part).__name__, **{f.name: _plain(getattr(part, f.name)) for f in fields(part)}}


def _plain(value: Any) -> Any:
    """A field of a part: a part itself, several, or numbers and words."""
    if is_dataclass(value) and not isinstance(value, type):
        return _as_plain(value)
    return [_plain(each) for each in value] if isinstance(value, tuple | list) else value


def _from_plain(part: Any) -> Any:
    if isinstance(part, list):
        return tuple(map(_from_plain, part))
    if not isinstance(part, dict) or "kind" not in part:
        return part
    given = {name: _from_plain(value) for name, value in part.items() if name != "kind"}
    return _parts()[str(part["kind"])](**given)


def mechanism_from(path: Path, meta: dict[str, Any], model: bytes, home: Array) -> Mechanism:
    """What `mechanism_as_plain` was given; an OptionError where it cannot be made again."""
    remedy = "give the mechanism: load_trajectory(path, mechanism)"
    if hashlib.sha256(model).hexdigest() != meta["digest"]:
        raise OptionError(f"{path} is damaged: the stored model is not what was written; {remedy}")
    tree = pin.Model()
    try:
        tree.loadFromString(model.decode())
    except (RuntimeError, ValueError) as error:
        raise OptionError(
            f"{path}: Pinocchio {pin.__version__} cannot read the model that Pinocchio {meta['pinocchio']} "
            f"wrote; {remedy}"
        ) from error
    own = [part["called"] for part in meta["forces"] if part["kind"] == OWN]
    if own:
        raise OptionError(f"{path} does not hold the class of the force {own[0]}; {remedy}")
    closures, forces = ([_from_plain(p) for p in meta[what]] for what in ("closures", "forces"))
    told = tuple(meta.get("actuated", ())), tuple(meta.get("left_out", ()))
    actuators = [_from_plain(actuator) for actuator in meta.get("actuators", ())]
    tendons = {str(name): _from_plain(path) for name, path in meta.get("tendons", {}).items()}
    own_parts = tree, closures, meta["independent"], home, meta["name"], forces
    stops = [_from_plain(part) for part in meta.get("stops", ())]
    made = Mechanism(*own_parts, *told, actuators=actuators, tendons=tendons, parts=stops)
    made.sensors = Sensors({each["name"]: sensor_from(each) for each in meta.get("sensors", ())})
    made.moved = tuple(meta.get("moved", ()))
    keys = meta.get("keyframes", {}).items()  # files of 0.1.0 have none
    made.keyframes = Keyframes({n: Keyframe(np.array(q), np.array(v), *more) for n, (q, v, *more) in keys})
    return made
