"""Sensors of actuators, tendons and limits of a compiled MJCF model: what they are about."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...mechanism.actuation.paths import FixedTendon
from .actuators import TENDON, CompiledActuators, is_constant
from .compiled import is_off
from .tendons import CompiledTendons
from .tree import CompiledTree

DRIVEN = ("actuator", "jointactuator", "jointlimit", "tendon")
"""What the names of their kinds begin with."""

UNLIMITED = (-np.inf, np.inf, 0.0)
"""Lower, upper and margin that are never reached."""


class UnknownError(Exception):
    """A part of a sensor is not known, or the sensor cannot be answered."""


class DriveSensors:
    """Fields of a `Sensor` by its kind and MuJoCo's number of what it is about.

    Parameters
    ----------
    m : mjModel
    tree : CompiledTree
    tendons, drives : CompiledTendons, CompiledActuators
        What is simulated of them.
    """

    def __init__(
        self, m: Any, tree: CompiledTree, tendons: CompiledTendons, drives: CompiledActuators
    ) -> None:
        self._m, self._tree, self._tendons, self._drives = m, tree, tendons, drives

    def about(self, kind: str, number: int) -> dict[str, Any]:
        """Its joint, tendon, actuators and numbers, as far as it has them.

        Raises
        ------
        UnknownError
            Where it cannot be answered.
        """
        if kind.startswith("actuator"):
            return {"actuators": self._named([number])}
        if kind == "jointactuatorfrc":
            return self._on_joint(number)
        if kind.startswith("jointlimit"):
            return {"joint": self._tree.joints[number], "numbers": self._joint_range(kind, number)}
        tendon = {"tendon": list(self._tendons.by_name)[number]}
        if kind == "tendonactuatorfrc":
            m = self._m
            pulling = (m.actuator_trntype == TENDON) & (m.actuator_trnid[:, 0] == number)
            return tendon | {"actuators": self._named(np.flatnonzero(pulling).tolist())}
        if kind.startswith("tendonlimit"):
            return tendon | {"numbers": self._tendon_range(kind, number)}
        return tendon

    def _named(self, actuators: list[int]) -> tuple[str, ...]:
        """Names of actuators, all of which are simulated."""
        drives = self._drives
        if not set(actuators) <= set(drives.ids):
            raise UnknownError
        return tuple(drives.actuators[drives.ids.index(a)].name for a in actuators)

    def _on_joint(self, joint: int) -> dict[str, Any]:
        """A joint all of whose actuators are simulated, none of them as a constant torque or a lift."""
        m = self._m
        constant = [a for a in range(m.nu) if is_constant(m, a) and m.actuator_trnid[a, 0] == joint]
        lifts = m.jnt_actgravcomp[joint] and np.any(m.body_gravcomp)
        if self._drives.left_out["actuators"] or constant or lifts:
            raise UnknownError
        return {"joint": self._tree.joints[joint]}

    def _joint_range(self, kind: str, joint: int) -> tuple[float, ...]:
        """Lower, upper and margin; of a ball the angle counts, and `upper` alone."""
        m = self._m
        if not m.jnt_limited[joint] or is_off(m, "LIMIT"):
            return UNLIMITED
        lower, upper = m.jnt_range[joint].tolist()
        margin = float(m.jnt_margin[joint])
        round_ = self._tree.model.nqs[self._tree.model.getJointId(self._tree.joints[joint])] > 1
        if kind == "jointlimitfrc" and (margin or round_):
            raise UnknownError
        return (-np.inf, max(lower, upper), margin) if round_ else (lower, upper, margin)

    def _tendon_range(self, kind: str, tendon: int) -> tuple[float, ...]:
        m, margin = self._m, float(self._m.tendon_margin[tendon])
        if not m.tendon_limited[tendon] or is_off(m, "LIMIT"):
            return UNLIMITED
        if kind == "tendonlimitfrc" and (margin or not isinstance(self._tendons.paths[tendon], FixedTendon)):
            raise UnknownError
        lower, upper = m.tendon_range[tendon].tolist()
        return (lower, upper, margin)
