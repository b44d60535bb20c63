"""Sensors of a compiled MJCF model, and by name those that a rigid mechanism does not answer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.sensing.instant import GROUND, Branch, Spot
from ...mechanism.sensing.sensors import KINDS, Sensor
from ..names import all_named
from .actuators import CompiledActuators
from .compiled import is_off
from .drive_sensors import DRIVEN, DriveSensors, UnknownError
from .tendons import CompiledTendons
from .tree import CompiledTree

BODY, XBODY, GEOM, SITE, CAMERA = 1, 2, 5, 6, 7
"""MuJoCo's mjtObj: a body's frame of inertia, its own frame, and what is fixed on it."""

MESH, SENSORS_OFF = 7, 1 << 13
"""MuJoCo's mjGEOM_MESH and mjDSBL_SENSOR."""

FIELDS = ("sensor_delay", "sensor_interval")
"""What makes a sensor tell of another time than the present; MuJoCo 3.3 has none."""

OF_JOINTS = ("jointpos", "jointvel", "ballquat", "ballangvel")

WRITTEN = {"jointactfrc": "jointactuatorfrc", "tendonactfrc": "tendonactuatorfrc"}
"""Kinds that files spell otherwise than MuJoCo's mjtSensor."""


def sensors_of(
    m: Any, tree: CompiledTree, tendons: CompiledTendons, drives: CompiledActuators, has_meshes: bool
) -> tuple[list[Sensor], list[str]]:
    """Sensors that are answered, and names of the others.

    Parameters
    ----------
    tendons, drives : CompiledTendons, CompiledActuators
        What is simulated of them.
    has_meshes : bool
        Whether meshes may have been left unread: frames and masses that come from them are not known, but for
        masses of bodies that move.
    """
    found: list[Sensor] = []
    others: list[str] = []
    if is_off(m, "SENSOR"):
        return found, others
    kinds = [_kind(m, i) for i in range(m.nsensor)]
    names = all_named([m.sensor(i).name for i in range(m.nsensor)], kinds, first=2)
    reader = _Reader(m, tree, DriveSensors(m, tree, tendons, drives), has_meshes)
    for i, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        made = reader.sensor(i, name, kind)
        if made is None:
            others.append(name)
        else:
            found.append(made)
    return found, others


def _kind(m: Any, i: int) -> str:
    import mujoco

    kind = str(mujoco.mjtSensor(int(m.sensor_type[i])).name).removeprefix("mjSENS_").lower()
    return WRITTEN.get(kind, kind)


class _Reader:
    """Sensors of the compiled model, one after the other."""

    def __init__(self, m: Any, tree: CompiledTree, driven: DriveSensors, has_meshes: bool) -> None:
        self._m, self._tree, self._driven, self._meshes = m, tree, driven, has_meshes

    def sensor(self, i: int, name: str, kind: str) -> Sensor | None:
        """None where it cannot be answered."""
        m = self._m
        if kind not in KINDS or any(np.any(getattr(m, key)[i]) for key in FIELDS if hasattr(m, key)):
            return None
        made = Sensor(name, kind, cutoff=float(m.sensor_cutoff[i]))
        about = int(m.sensor_objid[i])
        try:
            if kind in OF_JOINTS:
                return replace(made, joint=self._tree.joints[about])
            if kind.startswith(DRIVEN):
                return replace(made, **self._driven.about(kind, about))
            if kind.startswith("subtree"):
                return replace(made, branch=self._branch(about))
            if kind == "e_potential":
                return replace(made, branch=self._standing())
            if kind in ("e_kinetic", "clock"):
                return made
            spot = self._spot(int(m.sensor_objtype[i]), about)
            if kind in ("force", "torque"):
                return replace(made, spot=spot, branch=self._branch(int(m.site_bodyid[about])))
            field = tuple(m.opt.magnetic.tolist()) if kind == "magnetometer" else ()
            refers = int(m.sensor_refid[i])
            reference = self._spot(int(m.sensor_reftype[i]), refers) if refers >= 0 else None
            return replace(made, spot=spot, reference=reference, numbers=field)
        except UnknownError:
            return None

    def _spot(self, what: int, at: int) -> Spot:
        """A frame of MuJoCo's as a place on a joint."""
        m, tree = self._m, self._tree
        if what == BODY:
            self._require_masses(at)
            return self._placed(*tree.on(at, m.body_ipos[at], m.body_iquat[at]))
        if what == XBODY:
            return self._placed(*tree.on(at, np.zeros(3)))
        if what == SITE:
            return self._placed(*tree.site(at))
        if what == GEOM and not (self._meshes and m.geom_type[at] == MESH):
            return self._placed(*tree.on(int(m.geom_bodyid[at]), m.geom_pos[at], m.geom_quat[at]))
        if what == CAMERA and m.cam_mode[at] == 0:
            return self._placed(*tree.on(int(m.cam_bodyid[at]), m.cam_pos[at], m.cam_quat[at]))
        raise UnknownError

    def _placed(self, joint: int, place: pin.SE3) -> Spot:
        return Spot(str(self._tree.model.names[joint]), tuple(pin.SE3ToXYZQUAT(place).tolist()))

    def _require_masses(self, body: int) -> None:
        """Bodies that stand still may have masses of meshes that were not read."""
        if self._meshes and self._tree.carrier(body) == 0:
            raise UnknownError

    def _standing(self) -> Branch | None:
        """Bodies on the ground, which have weight too; None where they have none."""
        still = [b for b in range(1, self._m.nbody) if self._tree.carrier(b) == 0]
        massive = [b for b in still if self._m.body_mass[b] > 0.0]
        if is_off(self._m, "GRAVITY") or not massive:
            return None
        self._require_masses(massive[0])
        return Branch(GROUND, self._inertia(massive), ())

    def _branch(self, body: int) -> Branch:
        """A body and all below it: those on its own joint, and the joints that hang on them."""
        m, model = self._m, self._tree.model
        below = [body]
        for b in range(body + 1, m.nbody):  # parents come first
            if m.body_parentid[b] in below:
                below.append(b)
        joint = self._tree.carrier(body)
        own = [b for b in below if self._tree.carrier(b) == joint]
        if any(m.body_mass[b] > 0.0 for b in own):
            self._require_masses(body)
        if not sum(m.body_mass[b] for b in below) > 0.0:
            raise UnknownError
        carriers = {self._tree.carrier(b) for b in below} - {joint}
        own_joints = m.body_jntnum[body] > 0 and not all(map(self._tree.is_fixed, self._joints(body)))
        whole = bool(own_joints) or joint == 0 == body
        frames = None if whole else tuple(self._frames(own))
        names = tuple(str(model.names[j]) for j in sorted(carriers))
        return Branch(str(model.names[joint]), self._inertia(own), names, frames)

    def _joints(self, body: int) -> range:
        first = int(self._m.body_jntadr[body])
        return range(first, first + int(self._m.body_jntnum[body]))

    def _frames(self, bodies: list[int]) -> list[str]:
        """Names of bodies and of sites on them."""
        m, tree = self._m, self._tree
        sites = [tree.sites[s] for s in range(m.nsite) if m.site_bodyid[s] in bodies and tree.sites[s]]
        return [*(tree.bodies[b] for b in bodies), *sites]

    def _inertia(self, bodies: list[int]) -> tuple[float, ...]:
        """Mass, centre and moments of bodies that are fixed together, on their joint."""
        m, total = self._m, pin.Inertia.Zero()
        for b in bodies:
            turn = self._tree.on(b, m.body_ipos[b], m.body_iquat[b])[1]
            if m.body_mass[b] > 0.0:
                own = pin.Inertia(float(m.body_mass[b]), np.zeros(3), np.diag(m.body_inertia[b]))
                total += turn.act(own)
        numbers = [total.mass, *total.lever, *np.ravel(total.inertia)]
        return tuple(map(float, numbers)) if total.mass > 0.0 else ()
