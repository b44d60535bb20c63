"""Masses of USD's bodies: from PhysicsMassAPI, and from simple colliders where it does not say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.tree.tree import Array

DENSITY = 1000.0
"""kg/m³, where a collider does not say."""


def value_of(prim: Any, key: str, default: Any) -> Any:
    """An attribute, or what stands for it."""
    attribute = prim.GetAttribute(key)
    value = attribute.Get() if attribute else None
    return default if value is None else value


def schemas_of(prim: Any) -> list[str]:
    """The API schemas that are applied to it, those that the library does not know too."""
    listed = prim.GetMetadata("apiSchemas")
    return [] if listed is None else list(listed.GetAppliedItems())


def rotation_of(quaternion: Any) -> Array:
    """The rotation matrix of a quaternion, which may be absent or zero."""
    if quaternion is None:
        return np.eye(3)
    made = pin.Quaternion(float(quaternion.GetReal()), *map(float, quaternion.GetImaginary()))
    return made.normalized().matrix() if made.norm() > 0.0 else np.eye(3)


def inertia_of(body: Any, stage: Any) -> pin.Inertia:
    """Inertia in the body's frame, kg and m.

    A given mass, centre or diagonal of moments stands; what is not given is that of the colliders, scaled to
    the given mass.

    Raises
    ------
    ModelError
        For a collider that is no box, sphere, cylinder or capsule where its mass is needed, for a body
        without a mass, and for numbers that are negative or not finite.
    """
    mass = float(value_of(body, "physics:mass", 0.0)) * stage.kilograms
    # USD's defaults are 0 kg, a centre at −inf and moments of 0: none of them is a value
    centre = np.array(value_of(body, "physics:centerOfMass", (np.inf,) * 3), dtype=float)
    moments = np.array(value_of(body, "physics:diagonalInertia", (0.0,) * 3), dtype=float)
    axes = rotation_of(value_of(body, "physics:principalAxes", None))
    inertia = axes @ np.diag(moments) @ axes.T * stage.kilograms * stage.metres**2
    placed, weighs, turns = bool(np.all(np.isfinite(centre))), mass > 0.0, bool(np.any(moments))
    drawn = None if placed and weighs and turns else _of_colliders(body, stage)
    lever = np.zeros(3)
    if drawn is not None:
        mass, lever = mass if weighs else drawn.mass, drawn.lever
        inertia = inertia if turns else drawn.inertia * mass / drawn.mass
    elif not weighs:
        raise stage.fail(body, "neither PhysicsMassAPI nor a collider gives its mass; give physics:mass")
    elif not turns:
        raise stage.fail(body, "its mass has no moments of inertia; give physics:diagonalInertia")
    if placed:
        lever = stage.pose(body).actInv(stage.point(body, centre))
    if not np.all(np.isfinite([mass, *lever, *inertia.flat])) or moments.min() < 0.0:
        raise stage.fail(body, "its mass or moments are negative or not finite; correct them")
    return pin.Inertia(mass, lever, inertia)


def _of_colliders(body: Any, stage: Any) -> pin.Inertia | None:
    """The colliders' inertias together; None without any."""
    found = None
    for prim in stage.below(body):
        if "PhysicsCollisionAPI" in schemas_of(prim):
            moved = _solid(prim, stage).se3Action(stage.pose(body).actInv(stage.pose(prim)))
            found = moved if found is None else found + moved
    return found


def _solid(prim: Any, stage: Any) -> pin.Inertia:
    """A collider in its own axes."""
    kind, unit = str(prim.GetTypeName()), stage.unit(prim)
    round_one = {"Cylinder": (1.0, 2.0), "Capsule": (0.5, 1.0)}  # USD's own radius and height
    if kind == "Cube":
        sides = float(value_of(prim, "size", 2.0)) * unit
        made, volume = pin.Inertia.FromBox(1.0, *sides), float(np.prod(sides))
    elif kind == "Sphere":
        radius = float(value_of(prim, "radius", 1.0)) * float(unit.mean())
        made, volume = pin.Inertia.FromSphere(1.0, radius), 4.0 / 3.0 * np.pi * radius**3
    elif kind in round_one:
        spin = "XYZ".index(str(value_of(prim, "axis", "Z")))
        turned = np.roll(np.eye(3), 2 - spin, axis=1)  # z there is the axis
        radius = float(value_of(prim, "radius", round_one[kind][0])) * float(np.delete(unit, spin).mean())
        length = float(value_of(prim, "height", round_one[kind][1])) * float(unit[spin])
        rounded = 4.0 / 3.0 * np.pi * radius**3 if kind == "Capsule" else 0.0
        volume = np.pi * radius**2 * length + rounded
        make = pin.Inertia.FromCylinder if kind == "Cylinder" else pin.Inertia.FromCapsule
        made = make(1.0, radius, length).se3Action(pin.SE3(turned, np.zeros(3)))
    else:
        raise stage.fail(prim, f"the mass of a {kind or 'prim without type'} is not known; give physics:mass")
    density = float(value_of(prim, "physics:density", 0.0)) * stage.kilograms / stage.metres**3
    mass = float(value_of(prim, "physics:mass", 0.0)) * stage.kilograms
    weight = mass if mass > 0.0 else (density if density > 0.0 else DENSITY) * volume
    if not 0.0 <= weight < np.inf:
        raise stage.fail(prim, "its mass is negative or not finite; correct its size and density")
    return pin.Inertia(weight, made.lever, made.inertia * weight)
