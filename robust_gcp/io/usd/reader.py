"""USD (UsdPhysics) to a spanning tree with closures, by Pixar's own library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import ModelError, RobustGcpError, missing_extra
from ...mechanism.building.bodies import WORLD, Body, BodyJoint
from ...mechanism.building.body_graph import spanned
from ...mechanism.constraint.couplings import CouplingClosure
from ...mechanism.contents import FileContents, check_base, named
from ...mechanism.tree.tree import Array
from ..text_file import path_of, read_bytes
from .masses import inertia_of, rotation_of, schemas_of, value_of

EARTH = 9.81
"""m/s², where a scene does not say."""

KINDS = ("Revolute", "Prismatic", "Spherical", "Fixed")
FREEDOMS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
AXES = dict(zip("XYZ", np.eye(3), strict=True))


def read_usd(usd: str | Path, base: str | None = None, root: str | Path | None = None) -> FileContents:
    """What a USD file describes: bodies, the joints between them, loops.

    Prims with PhysicsRigidBodyAPI are bodies; revolute, prismatic, spherical and fixed joints, and a
    PhysicsJoint whose locked axes amount to one of these, are joints. Those that close loops, with
    `physics:excludeFromArticulation` first, become closures. Masses come from PhysicsMassAPI, or from the
    boxes, spheres, cylinders and capsules of colliders. PhysxMimicJointAPI and NewtonMimicAPI are couplings.
    Numbers are taken to metres, kilograms and radians by the stage's units. Drives, contacts, limits and what
    else acts are left out and listed; kinematic bodies stand still.

    Parameters
    ----------
    usd : str or Path
        A file: *.usda, *.usdc or *.usd.
    base : "fixed", "free" or None
        "fixed": the first body of what floats is held where it is drawn.
    root : str or Path, optional
        A folder besides the file's own that holds files which it refers to.

    Raises
    ------
    ModelError
        Naming the file, the prim and the remedy.
    MissingExtraError
        Without usd-core.
    """
    check_base(base)
    path = path_of(usd, "USD")
    try:
        from pxr import Usd
    except ImportError as error:
        raise missing_extra("USD is read by Pixar's library", "usd-core", "usd") from error
    folders = [path.parent.resolve(), *([] if root is None else [path_of(root, "root").resolve()])]
    _require_inside(path, folders)
    try:
        return _Stage(Usd.Stage.Open(str(path)), path).contents(base)
    except (RuntimeError, TypeError, ValueError, KeyError, ArithmeticError) as error:  # values of other types
        if isinstance(error, RobustGcpError):
            raise
        raise ModelError(f"{path}: its values cannot be read ({_words(error)}); correct the file") from error


def _words(error: Exception) -> str:
    """What the library says, without where in its own code."""
    try:
        return " ".join(str(error).split()).rpartition(" : ")[2][:300]
    except UnicodeError:  # the library's own words hold what the file does
        return "its text is not UTF-8"


def _require_inside(path: Path, folders: list[Path], seen: frozenset[Path] = frozenset()) -> None:
    """Refuse a file that refers to others outside the folders: the library would open them."""
    from pxr import Sdf

    read_bytes(path)
    try:
        layer = Sdf.Layer.FindOrOpen(str(path))
    except Exception as error:
        raise ModelError(f"{path}: not a USD file ({_words(error)}); correct it") from error
    if layer is None:
        raise ModelError(f"{path}: not a USD file; correct it")
    for asset in layer.GetCompositionAssetDependencies():
        target = (path.parent / asset).resolve()
        if "://" in asset or not any(target.is_relative_to(folder) for folder in folders):
            raise ModelError(
                f"{path}: refers to {asset!r}, outside its folder; copy it there, or name its folder by root="
            )
        if target not in seen:
            _require_inside(target, folders, seen | {target})


class _Stage:
    """A stage in metres, kilograms and radians."""

    def __init__(self, stage: Any, path: Path) -> None:
        from pxr import UsdGeom, UsdPhysics

        self._stage, self._path, self._physics = stage, path, UsdPhysics  # prims live as long as the stage
        self._prims = list(stage.Traverse())
        self._up = AXES.get(str(UsdGeom.GetStageUpAxis(stage)), AXES["Y"])
        self.metres = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.kilograms = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
        self._places = UsdGeom.XformCache()
        self._title = stage.GetDefaultPrim().GetName() if stage.HasDefaultPrim() else path.stem
        has = UsdPhysics.RigidBodyAPI
        self._bodies = [p for p in self._prims if p.HasAPI(has) and self._on(p, "physics:rigidBodyEnabled")]
        self._still = [p for p in self._bodies if value_of(p, "physics:kinematicEnabled", False)]
        names = [p.GetName() for p in self._prims if p in self._bodies or p.IsA(UsdPhysics.Joint)]
        self._twice = {name for name in names if names.count(name) > 1}

    def contents(self, base: str | None) -> FileContents:
        bodies = [
            Body(self._name(p), self.pose(p), inertia_of(p, self))
            for p in self._bodies
            if p not in self._still
        ]
        joints = [
            self._joint(p)
            for p in self._prims
            if p.IsA(self._physics.Joint) and self._on(p, "physics:jointEnabled")
        ]
        joints = [joint for joint in joints if not joint.parent == joint.child == WORLD]  # of kinematic ones
        couplings = self._couplings()
        tied = {label for coupling in couplings for label in coupling.joints}
        for joint in joints:
            joint.kept = joint.name in tied
        contents = spanned(self._title, bodies, joints, self._gravity(), base)
        contents.closures += couplings
        drives = self._with("PhysicsDriveAPI")
        contents.actuated = tuple(name for name in drives if name in contents.model.names)
        contents.left_out += named("drives of joints", drives)
        contents.left_out += named("limits of joints", [j.name for j in joints if j.range is not None])
        contents.left_out += named("contacts of bodies", self._with("PhysicsCollisionAPI"))
        contents.left_out += named("motion of kinematic bodies", map(self._name, self._still))
        contents.left_out += named("PhysX's friction and armature of joints", self._with("PhysxJointAPI"))
        return contents

    def fail(self, prim: Any, words: str) -> ModelError:
        """The error that names a prim."""
        return ModelError(f"{self._path}: {prim.GetPath()}: {words}")

    def unit(self, prim: Any) -> Array:
        """What one is along the axes of a prim, m."""
        return np.linalg.norm(self._place(prim)[:3, :3], axis=0) * self.metres

    def point(self, prim: Any, at: Any) -> Array:
        """A point of a prim in the world, m."""
        place = np.append(np.array(at, dtype=float), 1.0)
        if not np.all(np.isfinite(place)):
            raise self.fail(prim, f"{tuple(at)} is no place on it; give finite numbers")
        return (self._place(prim) @ place)[:3] * self.metres

    def below(self, body: Any) -> list[Any]:
        """The prims of a body, without those of bodies within it."""
        return [p for p in self._prims if p.GetPath().HasPrefix(body.GetPath()) and self._carrier(p) == body]

    def _name(self, prim: Any) -> str:
        """Its name, or its path where others have the same."""
        return str(prim.GetPath()) if prim.GetName() in self._twice else str(prim.GetName())

    def _with(self, schema: str) -> list[str]:
        return [self._name(p) for p in self._prims if any(s.startswith(schema) for s in schemas_of(p))]

    def pose(self, prim: Any) -> pin.SE3:
        """Its pose without scales."""
        place = self._place(prim)
        u, _, vt = np.linalg.svd(place[:3, :3])
        if np.linalg.det(u @ vt) < 0.0:
            raise self.fail(prim, "its transform mirrors; give it positive scales")
        return pin.SE3(u @ vt, place[:3, 3] * self.metres)

    def _place(self, prim: Any) -> Array:
        """Local to world, in the stage's units, (4, 4) with columns as vectors."""
        place = np.array(self._places.GetLocalToWorldTransform(prim)).T
        if not np.all(np.isfinite(place)):
            raise self.fail(prim, "its transform is not finite; correct its numbers")
        return place

    @staticmethod
    def _on(prim: Any, key: str) -> bool:
        return bool(value_of(prim, key, True))

    def _carrier(self, prim: Any) -> Any:
        """The body that a prim is of, itself or around it; None: the ground."""
        while prim and prim.GetPath().pathString != "/":
            if prim in self._bodies:
                return prim
            prim = prim.GetParent()
        return None

    def _joint(self, prim: Any) -> BodyJoint:
        kind, axis, span = self._kind(prim)
        names, frames = [], []
        for end in "01":
            targets = prim.GetRelationship(f"physics:body{end}").GetTargets()
            target = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
            if targets and not target:
                raise self.fail(prim, f"body{end} names {targets[0]}, which is not there; correct it")
            body = self._carrier(target) if target else None
            still = body is None or body in self._still
            at = value_of(prim, f"physics:localPos{end}", (0, 0, 0))
            turn = rotation_of(value_of(prim, f"physics:localRot{end}", None))
            if target:
                world = pin.SE3(self.pose(target).rotation @ turn, self.point(target, at))
            else:
                world = pin.SE3(turn, np.array(at, dtype=float) * self.metres)
            names.append(WORLD if still else self._name(body))
            frames.append(world if still else self.pose(body).actInv(world))
        cut = bool(value_of(prim, "physics:excludeFromArticulation", False))
        axes = [axis] if kind in ("revolute", "prismatic") else []
        return BodyJoint(
            self._name(prim), kind, names[0], names[1], frames[0], frames[1], axes, span, cut=cut
        )

    def _kind(self, prim: Any) -> tuple[str, Array, tuple[float, float] | None]:
        """Kind, axis and range of a joint."""
        label = str(prim.GetTypeName()).removeprefix("Physics").removesuffix("Joint")
        axis = AXES[str(value_of(prim, "physics:axis", "X"))]
        low, high = (value_of(prim, f"physics:{end}Limit", None) for end in ("lower", "upper"))
        if not label:  # of six freedoms those are locked whose bounds are crossed
            bounds = [
                [value_of(prim, f"limit:{f}:physics:{end}", None) for end in ("low", "high")]
                for f in FREEDOMS
            ]
            free = [i for i, (a, b) in enumerate(bounds) if a is None or b is None or a <= b]
            kinds = {(): "Fixed", (3, 4, 5): "Spherical"}
            label = kinds.get(
                tuple(free), {1: "Prismatic" if free[:1] < [3] else "Revolute"}.get(len(free), "generic")
            )
            if len(free) == 1:
                axis, (low, high) = np.eye(3)[free[0] % 3], bounds[free[0]]
        if label not in KINDS:
            raise self.fail(
                prim, f"a {label} joint cannot be read; {', '.join(KINDS)} ones and their like can"
            )
        scale = self.metres if label == "Prismatic" else np.pi / 180.0
        wide = low is None or high is None or not np.isfinite([low, high]).all() or label not in KINDS[:2]
        return label.lower(), axis, None if wide else (float(low) * scale, float(high) * scale)

    def _gravity(self) -> Array:
        scenes = [p for p in self._prims if p.IsA(self._physics.Scene)]
        size, way = -1.0, np.zeros(3)
        if scenes:
            size = float(value_of(scenes[0], "physics:gravityMagnitude", -1.0)) * self.metres
            way = np.array(value_of(scenes[0], "physics:gravityDirection", (0, 0, 0)), dtype=float)
        length = float(np.linalg.norm(way))
        if not np.isfinite(length):
            raise self.fail(scenes[0], "its gravityDirection is not finite; give a vector")
        # USD's own default is −inf: Earth's
        return (EARTH if size < 0.0 or not np.isfinite(size) else size) * (
            way / length if length else -self._up
        )

    def _couplings(self) -> list[CouplingClosure]:
        """q = −gearing q_ref − offset of PhysX, q = coef0 + coef1 q_ref of Newton, in degrees or units."""
        tied = []
        for prim, schema in ((p, s) for p in self._prims for s in schemas_of(p) if "Mimic" in s):
            _, _, axis = schema.partition(":")
            newton = schema.startswith("NewtonMimic")
            key = "newton:mimic" if newton else f"physxMimicJoint:{axis}:"
            leader = prim.GetRelationship(key + ("Joint" if newton else "referenceJoint")).GetTargets()
            found = prim.GetStage().GetPrimAtPath(leader[0]) if leader else None
            if not found:
                raise self.fail(prim, f"{schema} names no joint that it follows; name it")
            unit, other = (
                self.metres if p.IsA(self._physics.PrismaticJoint) else np.pi / 180.0 for p in (prim, found)
            )
            if newton:
                ratio, offset = value_of(prim, key + "Coef1", 1.0), value_of(prim, key + "Coef0", 0.0)
            else:
                ratio, offset = (-value_of(prim, key + k, d) for k, d in (("gearing", 1.0), ("offset", 0.0)))
            names = self._name(prim), self._name(found)
            tied.append(CouplingClosure(*names, float(ratio) * unit / other, float(offset) * unit))
        return tied
