"""Dry friction as a share of the joint's reaction: F = F₀ + μ r |n|, r = 1 in a prismatic joint.

n (3,) is the resultant force across the joint's axis. It is affine in accelerations and constraint forces,
and so in the friction itself: while joints slip, with their friction x ≥ 0 against the signs of their rates,
n_i = n⁰_i + Σ_j n¹_ij x_j, and

    x_i = F⁰_i + μ_i r_i |n⁰_i + Σ_j n¹_ij x_j|.

Right-hand sides differ by no more than C |Δx|, C_ij = μ_i r_i |n¹_ij|. Where the spectral radius of C is
below 1 that is a contraction, with one solution; elsewhere there may be none or several (Painlevé's paradox).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ...dynamics.equations import Split
from ...dynamics.loads import Wrench
from ...errors import ModelError, OptionError, SimulationError
from ...mechanism.joints import JointKind, joint_named
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import JointFriction
from ...mechanism.tree import Array
from ...mechanism.workspace import workspace
from ..reactions import Loaded

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

    def __init__(self, rows: Rows, wrenches: Sequence[Wrench] = (), controls: Controls | None = None) -> None:
        self._rows, self._wrenches, self._controls = rows, wrenches, controls
        self.share = np.zeros(len(rows.rows))
        self._axes: dict[int, tuple[str, Array]] = {}
        for i, row in enumerate(rows.rows):
            if row.coefficient:
                assert isinstance(row.part, JointFriction)
                self.share[i], self._axes[i] = _share_and_axis(rows.mechanism, row.part)
        self.constant = np.where(self.share > 0.0, np.maximum(rows.bounds, LEAST), rows.bounds)
        if self._axes:
            self._data = workspace(rows.mechanism.own_model)

    @property
    def vary(self) -> bool:
        """Whether there are any that reactions decide."""
        return bool(self._axes)

    def sliding(self, phase: Phase) -> list[int]:
        """Rows of these that slip."""
        return [i for i in phase.slip if i in self._axes]

    def __call__(self, t: Array, q: Array, v: Array, a: Array, tau: Array) -> Array:
        """F (N, n), with tau all that acts besides gravity and the loops, (N, nv)."""
        found: Array = np.tile(self.constant, (len(t), 1))
        if self.vary:
            mechanism = self._rows.mechanism
            forces = [constraint_forces(mechanism, *x) for x in zip(t, q, v, a, tau, strict=True)]
            n = self.reactions(mechanism, list(self._axes), (t, q, v, a, np.array(forces)))
            for k, i in enumerate(self._axes):
                F = self._rows.bounds[i] + self.share[i] * np.linalg.norm(n[k], axis=1)
                found[:, i] = np.maximum(F, LEAST)
        return found

    def at(self, t: float, q: Array, v: Array, a: Array, tau: Array) -> Array:
        """The same at one state, (n,)."""
        return self(np.array([t]), q[None], v[None], a[None], tau[None])[0]

    def reactions(
        self, mechanism: Mechanism, rows: Sequence[int], states: tuple[Array, Array, Array, Array, Array]
    ) -> Array:
        """n (k, N, 3) of k rows at states t, q, v, a, λ, in the joints' own frames."""
        t, q, v, a, multipliers = states
        u = None if self._controls is None or not mechanism.actuators else self._controls(t, q, v)
        u = None if u is None or np.isnan(u).all() else u
        loaded = Loaded(mechanism, t, q, v, lambda: a, multipliers, self._wrenches, u, self._data)
        named, axes = zip(*(self._axes[i] for i in rows), strict=True)
        force = loaded.in_joints(named)[0][..., :3].transpose(1, 0, 2)
        along = np.array(axes)[:, None]
        return np.asarray(force - along * np.sum(along * force, axis=2, keepdims=True))


def _share_and_axis(mechanism: Mechanism, part: JointFriction) -> tuple[float, tuple[str, Array]]:
    """μ r; and the joint's name and axis in its own frame."""
    label, joint = f"JointFriction {part.joint!r}", joint_named(mechanism.joints, part.joint, "JointFriction")
    if len(part.joints) > 1:
        raise OptionError(f"{label}: coefficient goes with one joint, no sum; leave other and more out")
    prismatic = joint.kind is JointKind.SLIDE
    if not prismatic and joint.kind not in (JointKind.HINGE, JointKind.UNBOUNDED_HINGE):
        raise ModelError(f"{label}: coefficient goes with revolute and prismatic joints; give its bound")
    if prismatic != (part.radius is None):
        remedy = "leave radius out" if prismatic else "give its bearing's radius, m"
        raise OptionError(f"{label} is {'prismatic' if prismatic else 'revolute'}: {remedy}")
    model = mechanism.own_model
    number = model.getJointId(joint.name)
    # both in the joint's own frame, in which its axis is the same everywhere
    J = pin.computeJointJacobian(model, workspace(model), pin.neutral(model), number).reshape(6, -1)
    column = J[:, joint.idx_v]
    axis = np.asarray(column[:3] if prismatic else column[3:])
    assert part.coefficient is not None
    share = part.coefficient * (1.0 if part.radius is None else part.radius)
    return share, (joint.name, axis / np.linalg.norm(axis))


def constraint_forces(mechanism: Mechanism, t: float, q: Array, v: Array, a: Array, tau: Array) -> Array:
    """λ (nc,) with Kᵀ λ = M a + C − τ as nearly as may be: a may be interpolated.

    Raises
    ------
    SimulationError
        At singular configurations, whose reactions K cannot balance.
    """
    if not mechanism.nc:
        return np.zeros(0)
    tree, split = mechanism.tree, Split(mechanism, q)
    need = tree.rnea(q, v, a) - tau
    parts = np.array([need, tree.rnea(q, v, tree.zero), tau])
    size = float(np.abs(mechanism.column_scale * parts).max()) + LEAST
    if np.abs(split.free.T @ need).max(initial=0.0) > UNBALANCED * size:
        raise _undetermined(t)
    return split.multipliers(need)


def _undetermined(t: float) -> SimulationError:
    return SimulationError(
        f"JointFriction(coefficient=): at t = {t:.6g} s the configuration is singular, where the reactions "
        "that friction is a share of are not determined; give its bound in place of it"
    )


class Sliding:
    """F of each row in a phase in which some joints slip: a function (t, q, v) -> (n,).

    Parameters
    ----------
    bounds : FrictionBounds
    mechanism : Mechanism
        Of the phase, with what it holds.
    rows : Rows
    phase : Phase
    acting : callable (t, q, v, F) -> (nv,)
        All that acts besides gravity and what is held, under bounds F.

    Raises
    ------
    SimulationError
        Where friction is not determined.
    """

    def __init__(
        self,
        bounds: FrictionBounds,
        mechanism: Mechanism,
        rows: Rows,
        phase: Phase,
        acting: Callable[..., Array],
    ) -> None:
        self._bounds, self._mechanism, self._names = bounds, mechanism, rows.names
        self._least = rows.bounds[bounds.sliding(phase)]
        self._rows, self._acting = bounds.sliding(phase), acting
        self._against = np.array([-phase.slip[i] * rows.E[i] for i in self._rows])

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """F (n,) at a state."""
        rows, bounds, k = self._rows, self._bounds, len(self._rows)
        other = bounds.constant.copy()
        other[rows] = 0.0
        tau = self._acting(t, q, v, other) + np.vstack([np.zeros(len(v)), self._against])
        a, multipliers = moved(self._mechanism, t, q, v, tau)
        same = np.full(k + 1, t), np.tile(q, (k + 1, 1)), np.tile(v, (k + 1, 1))
        n = bounds.reactions(self._mechanism, rows, (*same, a, multipliers))
        n0, by = n[:, 0], n[:, 1:] - n[:, :1]
        share = bounds.share[rows]
        growth = np.abs(np.linalg.eigvals(share[:, None] * np.linalg.norm(by, axis=2))).max()
        found = None if growth >= 1.0 else friction(self._least, share, n0, by)
        if found is None:
            raise SimulationError(
                f"JointFriction {', '.join(self._names(rows))}: at t = {t:.6g} s the friction grows by "
                f"{growth:.3g} of itself through the reaction that it causes: there may be no motion, "
                f"or several (Painlevé's paradox); {REMEDY}",
                None, growth=float(growth),
            )  # fmt: skip
        other[rows] = found
        return other


def friction(least: Array, share: Array, n0: Array, by: Array) -> Array | None:
    """x (k,) with x = least + share |n0 + Σ by x|; by Newton's method, by iteration where that leads away.

    Parameters
    ----------
    n0, by : ndarray (k, 3), (k, k, 3)
    """
    rounding = 8.0 * np.finfo(float).eps
    reach = np.linalg.norm(by, axis=2)
    x = least + share * np.linalg.norm(n0, axis=1)
    for _ in range(MOST):
        n = n0 + np.einsum("ijc,j->ic", by, x)
        size = np.linalg.norm(n, axis=1)
        target = least + share * size
        wrong = np.abs(x - target)
        if np.all(wrong <= rounding * (target + share * (np.linalg.norm(n0, axis=1) + reach @ x))):
            return np.asarray(target)
        slope = np.einsum("ijc,ic->ij", by, n) / np.where(size > 0.0, size, 1.0)[:, None]
        trial = x - np.linalg.solve(np.eye(len(x)) - share[:, None] * slope, x - target)
        then = least + share * np.linalg.norm(n0 + np.einsum("ijc,j->ic", by, trial), axis=1)
        x = trial if np.abs(trial - then).max() < 0.5 * wrong.max() else target
    return None


def moved(mechanism: Mechanism, t: float, q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
    """a (k, nv) and λ (k, nc) under each of k torques besides gravity, (k, nv).

    Raises
    ------
    SimulationError
        At singular configurations.
    """
    tree, k = mechanism.tree, len(tau)
    upper = np.triu(tree.crba(q))
    M = upper + np.triu(upper, 1).T
    if not mechanism.nc:
        a = np.linalg.solve(M, (tau - tree.rnea(q, v, tree.zero)).T).T
        return a, np.zeros((k, 0))
    split = Split(mechanism, q)
    N, a0 = split.free, split.acceleration(mechanism.k(q, v))
    if N.shape[1] > mechanism.m:
        raise _undetermined(t)
    free = tau - tree.rnea(q, v, a0)
    further = np.linalg.solve(N.T @ M @ N, N.T @ free.T).T @ N.T
    return a0 + further, np.array([split.multipliers(part) for part in further @ M - free])
