"""Tendons of a compiled MJCF model: their paths, and what acts along them without a control."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.actuation.paths import FixedTendon, Path
from ...mechanism.actuation.spatial_tendon import Pulley, SpatialTendon, Wrap
from ...mechanism.actuation.tendon_springs import TendonSpring
from ...mechanism.forces.forces import Force, PointSpring
from ...mechanism.parts import JointFriction, Part, Stop
from ..names import all_named, unlike
from .compiled import is_off
from .stops import restitution_of
from .tree import CompiledTree

WRAP_JOINT, WRAP_PULLEY, WRAP_SITE, WRAP_SPHERE = range(1, 5)
"""MuJoCo's mjtWrap."""

CURVED = ("tendon_stiffnesspoly", "tendon_dampingpoly")


class CompiledTendons:
    """All tendons of a model.

    Parameters
    ----------
    m : mjModel
    tree : CompiledTree

    Attributes
    ----------
    paths : list of Path
        By MuJoCo's numbers.
    by_name : dict of str to Path
    springs : list of Force
        Springs and dampers along them.
    parts : list of Stop, JointFriction
        Limits and dry friction of fixed ones.
    left_out : dict of str to list of str
        Names of what is not simulated, by kind.
    """

    def __init__(self, m: Any, tree: CompiledTree) -> None:
        self._m, self._tree = m, tree
        self._frames: dict[int, str] = {}
        self.paths = [self._path(t) for t in range(m.ntendon)]
        every = range(m.ntendon)
        names = all_named([m.tendon(t).name for t in every], [f"tendon{t}" for t in every])
        self.by_name: dict[str, Path] = dict(zip(names, self.paths, strict=True))
        self.left_out: dict[str, list[str]] = {"tendons": []}
        self.springs, self.parts = list[Force](), list[Part]()
        self._add_springs()
        self._add_parts()

    def _path(self, t: int) -> Path:
        m = self._m
        wraps = range(int(m.tendon_adr[t]), int(m.tendon_adr[t] + m.tendon_num[t]))
        if m.wrap_type[wraps[0]] == WRAP_JOINT:
            arms: dict[str, float] = {}
            for w in wraps:
                name = self._tree.joints[int(m.wrap_objid[w])]
                arms[name] = arms.get(name, 0.0) + float(m.wrap_prm[w])
            return FixedTendon(arms)
        elements: list[str | Pulley | Wrap] = []
        for w in wraps:
            kind, target = int(m.wrap_type[w]), int(m.wrap_objid[w])
            if kind == WRAP_SITE:
                elements.append(self.site(target))
            elif kind == WRAP_PULLEY:
                elements.append(Pulley(float(m.wrap_prm[w])))
            else:
                elements.append(self._wrap(target, kind, round(float(m.wrap_prm[w]))))
        return SpatialTendon(elements)

    def _wrap(self, geom: int, kind: int, side: int) -> Wrap:
        m = self._m
        turn = pin.Quaternion(*map(float, m.geom_quat[geom])).normalized().toRotationMatrix()
        return Wrap(
            self._tree.bodies[int(m.geom_bodyid[geom])],
            float(m.geom_size[geom, 0]),
            "sphere" if kind == WRAP_SPHERE else "cylinder",
            tuple(m.geom_pos[geom].tolist()),
            tuple(map(tuple, turn.tolist())),
            None if side < 0 else self.site(side),
        )

    def site(self, site: int) -> str:
        """The frame of a site, one of its own where it has no name."""
        name = self._tree.sites[site]
        if name:
            return str(name)
        if site not in self._frames:
            label = unlike(f"site{site}", [frame.name for frame in self._tree.model.frames])
            self._tree.model.addFrame(pin.Frame(label, *self._tree.site(site), pin.FrameType.OP_FRAME), False)
            self._frames[site] = label
        return self._frames[site]

    def _add_springs(self) -> None:
        m = self._m
        for t, path in enumerate(self.paths):
            name = m.tendon(t).name or "tendon"
            if any(np.any(getattr(m, key)[t]) for key in CURVED if hasattr(m, key)):
                self.left_out["tendons"].append(name)
                continue
            stiffness = 0.0 if is_off(m, "SPRING") else float(m.tendon_stiffness[t])
            damping = 0.0 if is_off(m, "DAMPER") else float(m.tendon_damping[t])
            if m.tendon_armature[t] or (hasattr(m, "tendon_plasticadr") and m.tendon_plasticadr[t] >= 0):
                self.left_out["tendons"].append(name)
            if not (stiffness or damping):
                continue
            low, high = m.tendon_lengthspring[t].tolist()
            straight = isinstance(path, SpatialTendon) and [type(e) for e in path.elements] == [str, str]
            if straight and low == high:
                one, two = path.elements  # type: ignore[attr-defined]
                self.springs.append(PointSpring(one, two, stiffness, low, damping))
            elif not any(self.is_fixed(joint) for joint in path.joints):
                self.springs.append(TendonSpring(path, stiffness, low, high, damping))

    def _add_parts(self) -> None:
        m = self._m
        rubbing, limited = not is_off(m, "FRICTIONLOSS"), not is_off(m, "LIMIT")
        for t, path in enumerate(self.paths):
            name = m.tendon(t).name or "tendon"
            bound, limits = float(m.tendon_frictionloss[t]), m.tendon_limited[t]
            sort = "tendons" if isinstance(path, FixedTendon) else "spatial tendons"
            kinds = ["limits"] * bool(limits and limited) + ["dry friction"] * (bound > 0.0 and rubbing)
            for kind in kinds:
                self.left_out.setdefault(f"{kind} of {sort}", []).append(name)
            if not kinds or not isinstance(path, FixedTendon) or any(map(self.is_fixed, path.joints)):
                continue
            arms = [(name, arm) for name, arm in path.coefficients.items() if arm]
            if not arms:
                continue
            (joint, arm), *others = arms
            # the length over the first arm, whose sign may turn the range round
            row: dict[str, Any] = {"more": tuple((other, -value / arm) for other, value in others)}
            if limits and limited:
                low, high = sorted((m.tendon_range[t] / arm).tolist())
                bounce = restitution_of(m.tendon_solref_lim[t])
                self.parts.append(Stop(joint, lower=low, upper=high, restitution=bounce, **row))
            if bound > 0.0 and rubbing:
                self.parts.append(JointFriction(joint, bound * abs(arm), **row))

    def is_fixed(self, joint: str) -> bool:
        """Whether a joint is taken away by base="fixed"."""
        return self._tree.is_fixed(self._tree.joints.index(joint))
