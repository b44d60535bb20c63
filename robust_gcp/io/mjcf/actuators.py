"""Actuators of a compiled MJCF model."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...mechanism.actuation.actuators import Actuator
from ...mechanism.actuation.muscle import Muscle
from ...mechanism.actuation.paths import FixedTendon, Path, TurningJoint
from ...mechanism.actuation.site_paths import SiteForce, SliderCrank
from ...mechanism.actuation.spatial_tendon import SpatialTendon
from ...mechanism.actuation.tendon_springs import TendonSpring
from ...mechanism.forces.forces import Force, JointTorque
from ..names import all_named
from .compiled import is_off
from .tendons import CompiledTendons
from .tree import BALL, FREE, CompiledTree

JOINT, IN_PARENT, SLIDER_CRANK, TENDON, SITE, BODY = range(6)
"""MuJoCo's mjtTrn: what an actuator drives."""

NONE, AFFINE = 0, 1
"""MuJoCo's mjGAIN_FIXED and mjBIAS_NONE, mjGAIN_AFFINE and mjBIAS_AFFINE; 2 is a muscle's of both."""

MUSCLE = 2

OF_DYNAMICS = {0: "none", 1: "integrator", 2: "filter", 3: "filter", 4: "muscle"}
"""MuJoCo's mjtDyn by our words; a filter is one however MuJoCo integrates it."""


class CompiledActuators:
    """All actuators of a model, as far as they are simulated.

    Parameters
    ----------
    m : mjModel
    tree : CompiledTree
    tendons : CompiledTendons

    Attributes
    ----------
    actuators, ids : list of Actuator, list of int
        And their numbers in the model.
    springs : list of Force
        Dampers of actuators, and actuators whose force is a constant.
    left_out : dict of str to list of str
        Names of what is not simulated, by kind.
    """

    def __init__(self, m: Any, tree: CompiledTree, tendons: CompiledTendons) -> None:
        self._m, self._tree, self._tendons = m, tree, tendons
        self.actuators, self.springs = list[Actuator](), list[Force]()
        self.ids = list[int]()
        self.left_out: dict[str, list[str]] = {"actuators": []}
        every = range(len(m.actuator_trntype))
        names = all_named([m.actuator(a).name for a in every], [self._label(a) for a in every])
        for a, name in () if is_off(m, "ACTUATION") else enumerate(names):
            self._add(a, name)

    def _add(self, a: int, label: str) -> None:
        m, path = self._m, self._path(a)
        if path is None or not self._is_known(a):
            if not self._is_idle(a):
                self.left_out["actuators"].append(label)
            return
        # of balls, free joints and sites gears are vectors, which are in the path
        with_gear = isinstance(path, FixedTendon | SpatialTendon | SliderCrank)
        gear = float(m.actuator_gear[a, 0]) if with_gear else 1.0
        for what in ("damping", "armature"):
            if hasattr(m, f"actuator_{what}") and getattr(m, f"actuator_{what}")[a]:
                self._add_passive(a, what, path, gear, label)
        if self._is_switched_off(a):
            return
        if is_constant(m, a):
            (joint,), target = path.joints, m.actuator_trnid[a, 0]
            torque = float(m.actuator_biasprm[a, 0]) * gear
            if m.jnt_actfrclimited[target]:
                torque = float(np.clip(torque, *m.jnt_actfrcrange[target]))
            self.springs.append(JointTorque(joint, torque))
            return
        self.ids.append(a)
        self.actuators.append(self._actuator(a, label, path, gear))

    def _is_switched_off(self, a: int) -> bool:
        """Whether `<option actuatorgroupdisable>` names its group."""
        group = int(self._m.actuator_group[a])
        # bits of an int: groups beyond them cannot be switched off
        return 0 <= group <= 30 and bool(int(self._m.opt.disableactuator) >> group & 1)

    def _add_passive(self, a: int, what: str, path: Path, gear: float, label: str) -> None:
        """An actuator's damping acts without any control; its armature is left out."""
        value = float(getattr(self._m, f"actuator_{what}")[a])
        poly = getattr(self._m, "actuator_dampingpoly", None)
        if what == "damping" and not (poly is not None and np.any(poly[a])):
            if not is_off(self._m, "DAMPER"):
                self.springs.append(TendonSpring(path, 0.0, damping=value * gear**2))  # length = gear × path
        else:
            self.left_out.setdefault(f"{what} of actuators", []).append(label)

    def _path(self, a: int) -> Path | None:
        """What it drives; None for what has no path here."""
        m, tree = self._m, self._tree
        kind, (target, other) = int(m.actuator_trntype[a]), m.actuator_trnid[a].tolist()
        gear = tuple(m.actuator_gear[a].tolist())
        if kind in (JOINT, IN_PARENT):
            if tree.is_fixed(target):
                return None
            joint, sort = tree.joints[target], m.jnt_type[target]
            if sort in (BALL, FREE):
                return TurningJoint(joint, gear[: 3 if sort == BALL else 6], kind == IN_PARENT)
            return FixedTendon({joint: 1.0})
        if kind == TENDON:
            path = self._tendons.paths[target]
            return None if any(map(self._tendons.is_fixed, path.joints)) else path
        if kind == SITE:
            reference = None if other < 0 else self._tendons.site(other)
            return SiteForce(self._tendons.site(target), gear, reference)
        if kind == SLIDER_CRANK:
            return SliderCrank(
                self._tendons.site(target), self._tendons.site(other), float(m.actuator_cranklength[a])
            )
        return None

    def _is_known(self, a: int) -> bool:
        m = self._m
        late = hasattr(m, "actuator_delay") and bool(np.any(m.actuator_delay[a]))
        plugged = hasattr(m, "actuator_plugin") and m.actuator_plugin[a] >= 0
        several = m.actuator_actnum[a] > 1
        known = m.actuator_gaintype[a] <= MUSCLE and m.actuator_biastype[a] <= MUSCLE
        mixed = (m.actuator_gaintype[a] == MUSCLE) != (m.actuator_biastype[a] == MUSCLE)
        # lengths that a file does not give MuJoCo finds by a simulation, which is switched off
        unmeasured = m.actuator_gaintype[a] == MUSCLE and not np.ptp(m.actuator_lengthrange[a])
        odd = mixed or late or plugged or several or unmeasured
        return bool(known and not odd) and int(m.actuator_dyntype[a]) in OF_DYNAMICS

    def _is_idle(self, a: int) -> bool:
        """Whether it drives a free joint that base="fixed" takes away."""
        kind, target = int(self._m.actuator_trntype[a]), int(self._m.actuator_trnid[a, 0])
        return kind in (JOINT, IN_PARENT) and self._tree.is_fixed(target)

    def _actuator(self, a: int, name: str, path: Path, gear: float) -> Actuator:
        m = self._m
        gain, bias = m.actuator_gainprm[a], m.actuator_biasprm[a]
        dynamics = OF_DYNAMICS[int(m.actuator_dyntype[a])]
        times = {"filter": 1, "muscle": 3}.get(dynamics, 0)
        muscle = None
        if m.actuator_gaintype[a] == MUSCLE:
            force = float(gain[2])
            if force < 0.0:  # not given: MuJoCo's scale, by what acceleration 1 N makes
                force = float(gain[3]) / max(1e-15, float(m.actuator_acc0[a]))
            muscle = Muscle(
                tuple(m.actuator_lengthrange[a].tolist()), force, tuple(gain[:2].tolist()),
                *gain[4:9].tolist(),
            )  # fmt: skip
        limited = {
            "ctrl_range": m.actuator_ctrllimited[a]
            and not is_off(m, "CLAMPCTRL")
            and m.actuator_ctrlrange[a],
            "force_range": m.actuator_forcelimited[a] and m.actuator_forcerange[a],
            "activation_range": dynamics != "none" and m.actuator_actlimited[a] and m.actuator_actrange[a],
        }
        if m.actuator_trntype[a] == TENDON and hasattr(m, "tendon_actfrclimited"):
            t = int(m.actuator_trnid[a, 0])
            limited["shared_range"] = m.tendon_actfrclimited[t] and m.tendon_actfrcrange[t]
        ranges: dict[str, Any] = {
            key: tuple(map(float, value)) for key, value in limited.items() if np.size(value) == 2
        }
        affine = m.actuator_gaintype[a] == AFFINE, m.actuator_biastype[a] == AFFINE
        # qpos0 has no activations of its own
        start = m.key_act[0, int(m.actuator_actadr[a])] if m.nkey and dynamics != "none" else 0.0
        return Actuator(
            name, path, gear,
            () if muscle else tuple(gain[: 3 if affine[0] else 1].tolist()),
            tuple(bias[:3].tolist()) if affine[1] else (),
            muscle, dynamics, tuple(m.actuator_dynprm[a, :times].tolist()),
            **ranges, activation=float(start),
        )  # fmt: skip

    def _label(self, a: int) -> str:
        """What it drives, for one without a name."""
        m = self._m
        kind, target = int(m.actuator_trntype[a]), int(m.actuator_trnid[a, 0])
        if kind in (JOINT, IN_PARENT):
            return str(self._tree.joints[target])
        if kind == TENDON:
            return str(m.tendon(target).name) or "tendon"
        return str(self._tree.bodies[target]) if kind == BODY else self._tree.sites[target] or "site"


def is_constant(m: Any, a: int) -> bool:
    """Whether an actuator's force is a constant on a joint with one number, whatever its control."""
    single = m.actuator_trntype[a] == JOINT and m.jnt_type[m.actuator_trnid[a, 0]] not in (FREE, BALL)
    plain = m.actuator_dyntype[a] == 0 == m.actuator_gaintype[a] and m.actuator_biastype[a] == AFFINE
    constant = not (np.any(m.actuator_gainprm[a]) or np.any(m.actuator_biasprm[a, 1:]))
    return bool(single and plain and constant and not m.actuator_forcelimited[a])
