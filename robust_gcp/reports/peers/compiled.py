"""`pinocchio_loop.cpp`: built once from the headers that pip brings, and called by plain arrays.

`python -m robust_gcp.reports.peers.compiled` builds it, which takes a minute; a study that needs it does so
by itself. It is kept in the user's cache, by the name of what it was made from.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import sys
import tempfile
from ctypes import c_double, c_int32, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ... import JointDamper, JointSpring, Mechanism, PointSpring
from ...kernel import build
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..contender import BOUND
from .parts import closure_places, constant_torques, frame_place, held_points

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
ALGORITHMS = ("constraintDynamics", "lcaba", "aba")
DEFINES = (
    *("-DBOOST_FUSION_INVOKE_MAX_ARITY=12", "-DBOOST_ALLOW_DEPRECATED_HEADERS"),
    *("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"),
)
HEADERS = (
    ("pinocchio/multibody.hpp", "libpinocchio", ""),
    ("boost/variant.hpp", "cmeel-boost", ""),
    build.EIGEN,
)

_COUNTS = {"joints": "kind", "closures": "full", "springs": "spring", "lines": "line"}
_ARRAYS = (
    *("kind", "parent", "axis", "placement", "inertia", "armature", "damping", "drive", "gravity"),
    *("full", "closure_joint", "closure_place", "spring_at", "line_joint", "spring", "line"),
)
_INTEGERS = ("kind", "parent", "full", "closure_joint", "spring_at", "line_joint")


class _Description(ctypes.Structure):
    _fields_ = [*((n, c_int32) for n in _COUNTS), *((n, c_void_p) for n in _ARRAYS)]


class _Request(ctypes.Structure):
    _fields_ = [
        *((n, c_int32) for n in ("algorithm", "outputs", "substeps", "iterations")),
        *((n, c_double) for n in ("step", "stiffness", "damping", "mu", "accuracy", "bound")),
        *((n, c_void_p) for n in ("q", "v")),
    ]


@dataclass(frozen=True)
class Settings:
    """How the loop solves for the constraint forces."""

    algorithm: str = ALGORITHMS[0]
    omega: float = 0.0  # of Baumgarte's terms ω² and 2 ω, 1/s
    mu: float = 1e-8  # proximal regularisation
    accuracy: float = 1e-12  # at which the proximal iterations stop
    iterations: int = 10  # of them at most


def path() -> Path:
    """Where the library is or will be: named after its source, flags and Pinocchio's version."""
    made = "\n".join([SOURCE.read_text(encoding="utf-8"), *build.FLAGS, *DEFINES, pin.__version__])
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "robust_gcp" / f"pinocchio_loop-{hashlib.sha256(made.encode()).hexdigest()[:16]}.so"


def make() -> Path:
    """The library, compiled where it is not there.

    Raises
    ------
    BuildError
        Without a compiler, headers or a place to write to, or when the compiler fails.
    """
    wanted = path()
    if wanted.exists():
        return wanted
    command = [*build.compiler(), *build.FLAGS, *DEFINES]
    for folder in build.headers(*HEADERS):
        command += ["-isystem", str(folder)]
    try:
        wanted.parent.mkdir(parents=True, exist_ok=True)  # compiling takes minutes
        with tempfile.TemporaryDirectory() as scratch:
            made = Path(scratch) / wanted.name
            build.call([*command, "-shared", str(SOURCE), "-o", str(made)], [])
            build.install(made, wanted)
    except OSError as error:
        raise build.BuildError(f"{wanted}: {error.strerror}; XDG_CACHE_HOME names another folder") from error
    return wanted


@functools.cache
def library() -> Any:
    """The loaded library, built where it is not there; raises BuildError where that fails."""
    try:
        found = ctypes.CDLL(str(make()))
    except OSError as error:
        raise build.BuildError(f"it does not load: {error}") from error
    found.loop_create.argtypes, found.loop_create.restype = [ctypes.POINTER(_Description)], c_void_p
    found.loop_destroy.argtypes, found.loop_destroy.restype = [c_void_p], None
    found.loop_run.argtypes = [c_void_p, ctypes.POINTER(_Request)]
    found.loop_acceleration.argtypes = [c_void_p, ctypes.POINTER(_Request), c_void_p]
    return found


@functools.cache
def why_not() -> str:
    """Why there is no compiled loop; empty where there is one, which this builds."""
    try:
        library()
    except build.BuildError as error:
        return str(error)
    return ""


class Loop:
    """The compiled loop of a mechanism, of revolute, prismatic and spherical joints and free-flyers."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._library, self._nq, self._nv = library(), mechanism.nq, mechanism.nv
        arrays = _described(mechanism)
        counts = {name: len(arrays[counted]) for name, counted in _COUNTS.items()}
        self._kept = {
            name: np.ascontiguousarray(arrays[name], dtype=np.int32 if name in _INTEGERS else np.float64)
            for name in _ARRAYS
        }
        pointers = {name: array.ctypes.data for name, array in self._kept.items()}
        self._loop = self._library.loop_create(_Description(**counts, **pointers))
        if not self._loop:
            raise MemoryError("the compiled loop could not be made")

    def __del__(self) -> None:
        if getattr(self, "_loop", None):
            self._library.loop_destroy(self._loop)

    def run(
        self, q: Array, v: Array, step: float, substeps: int, outputs: int, how: Settings
    ) -> tuple[Array, Array]:
        """RK4 from q and v: q (n, nq) and v (n, nv) at the start and the outputs that it reached."""
        qs, vs = np.empty((outputs + 1, self._nq)), np.empty((outputs + 1, self._nv))
        qs[0], vs[0] = q, v
        reached = self._library.loop_run(self._loop, self._request(qs, vs, how, step, substeps, outputs))
        return qs[: max(reached, 0) + 1], vs[: max(reached, 0) + 1]

    def acceleration(self, q: Array, v: Array, how: Settings) -> Array:
        """q̈, (nv,)."""
        q, v, a = np.array(q, dtype=float), np.array(v, dtype=float), np.empty(self._nv)
        self._library.loop_acceleration(self._loop, self._request(q, v, how), a.ctypes.data)
        return a

    def _request(
        self, q: Array, v: Array, how: Settings, step: float = 0.0, substeps: int = 0, outputs: int = 0
    ) -> _Request:
        return _Request(
            *(ALGORITHMS.index(how.algorithm), outputs, substeps, how.iterations),
            *(step, how.omega**2, 2.0 * how.omega, how.mu, how.accuracy, BOUND),
            *(q.ctypes.data, v.ctypes.data),
        )


def knows(mechanism: Mechanism) -> bool:
    """Whether all its joints are such as the loop has."""
    return all(joint.kind in _KINDS for joint in mechanism.joints)


_KINDS = {JointKind.REVOLUTE: 0, JointKind.PRISMATIC: 4, JointKind.SPHERICAL: 8, JointKind.FREE_FLYER: 9}
_OTHER_AXIS = 3


def _described(mechanism: Mechanism) -> dict[str, Any]:
    """The arrays of `Description` in the C++ source."""
    model = mechanism.own_model
    kinds, axes = [], []
    for joint in mechanism.joints:
        axis = np.zeros(3) if joint.axis is None else np.asarray(joint.axis, dtype=float)
        along = [i for i in range(3) if axis[i] == 1.0]
        kinds.append(_KINDS[joint.kind] + (0 if joint.axis is None else along[0] if along else _OTHER_AXIS))
        axes.append(axis)
    inertias = []
    for body in list(model.inertias)[1:]:
        about = body.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        inertias.append(np.concatenate([[body.mass], body.lever, about]))
    arrays: dict[str, Any] = {
        "kind": kinds,
        "parent": list(model.parents)[1:],
        "axis": axes,
        "placement": [_numbers(place) for place in list(model.jointPlacements)[1:]],
        "inertia": inertias,
        "armature": model.armature,
        "gravity": model.gravity.linear,
    }
    return arrays | _closures(mechanism) | _forces(mechanism)


def _numbers(place: pin.SE3) -> Array:
    return np.concatenate([place.rotation.ravel(), place.translation])


def _closures(mechanism: Mechanism) -> dict[str, Any]:
    """A point, a frame, or for a cut revolute joint two points on its axis."""
    full: list[int] = []
    joints: list[list[int]] = []
    places: list[list[Array]] = []
    for closure, ends in zip(mechanism.loops, closure_places(mechanism), strict=True):
        for shift in held_points(mechanism, closure):
            full.append(int(closure.kind == "6d"))
            joints.append([int(joint) for joint, _ in ends])
            places.append([_numbers(place * pin.SE3(np.eye(3), shift)) for _, place in ends])
    return {"full": full, "closure_joint": joints, "closure_place": places}


def _forces(mechanism: Mechanism) -> dict[str, Any]:
    damping = np.zeros(mechanism.nv)
    found: dict[str, list[Any]] = {name: [] for name in ("spring_at", "spring", "line_joint", "line")}
    for force in mechanism.forces:
        if isinstance(force, PointSpring):
            ends = [frame_place(mechanism, f) for f in (force.frame1, force.frame2)]
            found["line_joint"].append([joint for joint, _ in ends])
            points = [x for _, place in ends for x in place.translation]
            found["line"].append([*points, force.stiffness, force.rest_length, force.damping])
            continue
        joint = mechanism.joint(force.joint)
        if isinstance(force, JointSpring):
            found["spring_at"].append([joint.idx_q, joint.idx_v])
            found["spring"].append([force.stiffness, force.rest])
        elif isinstance(force, JointDamper):
            damping[joint.v] += force.damping
    return {"damping": damping, "drive": constant_torques(mechanism), **found}


def main() -> int:
    """Build it, and say where it is or why not."""
    why = why_not()
    print(f"Pinocchio's loop in C++: {why or path()}")
    return 1 if why else 0


if __name__ == "__main__":
    sys.exit(main())
