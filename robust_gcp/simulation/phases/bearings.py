"""Dry friction as a share of the joint's reaction: F = F₀ + μ r |n|, r = 1 in a prismatic joint.

n (3,) is the resultant force across the joint's axis, affine in accelerations and constraint forces, and so
in the friction itself: see `sliding`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from ...dynamics.equations import Split, balancing_forces
from ...dynamics.loads import Wrench
from ...errors import ModelError, OptionError, SimulationError
from ...mechanism.constraint.closures import PointClosure, PrismaticClosure, RevoluteClosure
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import JointFriction
from ...mechanism.tree.joints import JointKind, joint_named
from ...mechanism.tree.tree import Array
from ...mechanism.tree.workspace import workspace
from ..trajectories.reactions import Loaded, closure_number
from .driven import Driven

if TYPE_CHECKING:
    from .decision import Phase
    from .rows import Rows

REMEDY = "make the coefficient smaller, or give the friction's bound in place of it"

LEAST = 1e-12
"""N or N m in place of 0, as forces are weighed by their bounds."""

ALIKE = 1e-10
"""Relative change of bounds at which what they are found from is taken as it is."""

MOST = 200
"""Iterations that a contraction gets."""

UNBALANCED = 1e-3
"""Share of the forces that K may leave open, by interpolation; more are left at singular configurations."""

Controls = Callable[[Array, Array, Array], Array]


class FrictionBounds:
    """F of each row at states.

    Parameters
    ----------
    rows : Rows
    wrenches : sequence of Wrench
        That act on frames.
    controls : callable (t, q, v) -> (N, n)
        Of the actuators, NaN without power.

    Attributes
    ----------
    constant : ndarray (n,)
        F₀, and no less than `LEAST`.
    share : ndarray (n,)
        μ r.
    """

    def __init__(self, rows: Rows, wrenches: Sequence[Wrench], controls: Controls) -> None:
        self.rows, self._wrenches, self._controls = rows, wrenches, controls
        self.share = np.zeros(len(rows.rows))
        self._bearings: dict[int, Bearing] = {}
        for i, row in enumerate(rows.rows):
            if row.coefficient:
                assert isinstance(row.part, JointFriction)
                self.share[i], self._bearings[i] = _share_and_bearing(rows.mechanism, row.part)
        self.constant = np.where(self.share > 0.0, np.maximum(rows.bounds, LEAST), rows.bounds)
        if self._bearings:
            self._data = workspace(rows.mechanism.own_model)

    @property
    def vary(self) -> bool:
        """Whether there are any that reactions decide."""
        return bool(self._bearings)

    def sliding(self, phase: Phase) -> list[int]:
        """Rows of these that slip."""
        return [i for i in phase.slip if i in self._bearings]

    def __call__(self, t: Array, q: Array, v: Array, a: Array, tau: Array) -> Array:
        """F (N, n), with tau all that acts besides gravity and the loops, (N, nv)."""
        found: Array = np.tile(self.constant, (len(t), 1))
        if self.vary:
            mechanism = self.rows.mechanism
            states = zip(t.tolist(), q, v, a, tau, strict=True)
            forces = [constraint_forces(mechanism, *x, self.rows.driven(x[0])) for x in states]
            n = self.reactions(mechanism, list(self._bearings), (t, q, v, a, np.array(forces)))
            for k, i in enumerate(self._bearings):
                F = self.rows.bounds[i] + self.share[i] * np.linalg.norm(n[k], axis=1)
                found[:, i] = np.maximum(F, LEAST)
        return found

    def bounds_at(self, t: float, q: Array, v: Array, a: Array, tau: Array) -> Array:
        """The same at one state, (n,)."""
        return self(np.array([t]), q[None], v[None], a[None], tau[None])[0]

    def reactions(
        self, mechanism: Mechanism, rows: Sequence[int], states: tuple[Array, Array, Array, Array, Array]
    ) -> Array:
        """n (k, N, 3) of k rows at states t, q, v, a, λ, in axes of the joints' own."""
        t, q, v, a, multipliers = states
        u = self._controls(t, q, v) if mechanism.actuators else None
        u = None if u is None or np.isnan(u).all() else u
        loaded = Loaded(mechanism, t, q, v, lambda: a, multipliers, self._wrenches, u, self._data)
        chosen, found = [self._bearings[i] for i in rows], np.empty((len(rows), len(t), 3))
        in_tree = [k for k, bearing in enumerate(chosen) if isinstance(bearing.joint, str)]
        if in_tree:
            local, _ = loaded.in_joints([str(chosen[k].joint) for k in in_tree])
            found[in_tree] = local[..., :3].transpose(1, 0, 2)
        for k, bearing in enumerate(chosen):
            if not isinstance(bearing.joint, str):
                found[k] = self._in_cut(loaded, bearing.joint)
            along = bearing.axis
            found[k] -= np.outer(found[k] @ along, along)
        return found

    def _in_cut(self, loaded: Loaded, number: int) -> Array:
        """The force in a cut joint, (N, 3), in the axes of its second frame."""
        force, tree = loaded.reaction(number).force, loaded.mechanism.tree
        for j, q in enumerate(loaded.q):
            tree.jacobians(q)
            # all first frames lie before all second ones
            force[j] = tree.frame_R[len(loaded.mechanism.loops) + number].T @ force[j]
        return force


class Bearing(NamedTuple):
    """Whose reaction counts: a joint of the tree or the number of a cut one; and its axis, 0 for none."""

    joint: str | int
    axis: Array


def _share_and_bearing(mechanism: Mechanism, part: JointFriction) -> tuple[float, Bearing]:
    """μ r, and where it rubs."""
    label, names = f"JointFriction {part.joint!r}", mechanism.joint_names
    if len(part.joints) > 1 and part.reaction is None:
        raise OptionError(
            f"{label}: coefficient goes with one joint; where the sum is the angle of a cut joint, name it, "
            'reaction="frame1-frame2"'
        )
    name = part.joint if part.reaction is None else part.reaction
    prismatic, bearing = (_in_tree if name in names else _cut)(mechanism, name, label)
    if prismatic != (part.radius is None):
        remedy = "leave radius out" if prismatic else "give its bearing's radius, m"
        raise OptionError(f"{label}: {name} is {'prismatic' if prismatic else 'revolute'}: {remedy}")
    assert part.coefficient is not None
    return part.coefficient * (1.0 if part.radius is None else part.radius), bearing


def _in_tree(mechanism: Mechanism, name: str, label: str) -> tuple[bool, Bearing]:
    joint, model = joint_named(mechanism.joints, name, label), mechanism.own_model
    prismatic = joint.kind is JointKind.PRISMATIC
    if not prismatic and joint.kind not in (JointKind.REVOLUTE, JointKind.CONTINUOUS):
        raise ModelError(f"{label}: coefficient goes with revolute and prismatic joints; give its bound")
    # in the joint's own frame, in which its axis is the same everywhere
    number = model.getJointId(name)
    J = pin.computeJointJacobian(model, workspace(model), pin.neutral(model), number).reshape(6, -1)
    axis = np.asarray(J[:3, joint.idx_v] if prismatic else J[3:, joint.idx_v])
    return prismatic, Bearing(name, axis / np.linalg.norm(axis))


def _cut(mechanism: Mechanism, name: str, label: str) -> tuple[bool, Bearing]:
    """A point that closes a planar loop carries no force along its axis, nor a slide along its own."""
    number = closure_number(mechanism, name)
    closure = mechanism.loops[number]
    if not isinstance(closure, PointClosure | RevoluteClosure | PrismaticClosure):
        raise ModelError(f"{label}: {name} is no cut revolute or prismatic joint; give its bound")
    axis = np.array(closure.across()[0]) if isinstance(closure, RevoluteClosure) else np.zeros(3)
    return isinstance(closure, PrismaticClosure), Bearing(number, axis)


def constraint_forces(
    mechanism: Mechanism, t: float, q: Array, v: Array, a: Array, tau: Array, driven: Driven | None
) -> Array:
    """λ (nc,) with Kᵀ λ = M a + C − τ as nearly as may be: a may be interpolated.

    τ need not have what drives take.

    Raises
    ------
    SimulationError
        At singular configurations, whose reactions K cannot balance.
    """
    if not mechanism.nc:
        return np.zeros(0)
    split = Split(mechanism, q)
    if driven is not None:
        tau = tau.copy()
        tau[driven.iv] += driven.effort(split.free, mechanism.tree.rnea(q, v, a) - tau)
    found = balancing_forces(mechanism, q, v, a, tau, split, UNBALANCED)
    if found is None:
        raise undetermined(t)
    return found


def undetermined(t: float) -> SimulationError:
    """At a singular configuration."""
    return SimulationError(
        f"JointFriction(coefficient=): at t = {t:.6g} s the configuration is singular, where the reactions "
        "that friction is a share of are not determined; give its bound in place of it"
    )
