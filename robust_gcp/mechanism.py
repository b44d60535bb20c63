"""A mechanism: a spanning tree, loop closures, and the joints chosen as minimal coordinates."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from .closure import (
    Closure,
    FrameClosure,
    ImplicitConstraint,
    PointClosure,
    RevoluteClosure,
    closure_frames,
)
from .errors import ClosureError, ModelError, PartitionError, StateError
from .partition import independent_rows, numerical_rank, ranked_choices
from .tree import Array, Tree, require_depth_first
from .urdf import model_from_urdf

CLOSED = 1e-12
"""Largest |φ| / length of a configuration that counts as closed: some thousand roundings."""

NEARLY_CLOSED = 1e-6
"""Largest |φ| / length of a start that is polished instead of refused: rounded input, not an open loop."""

STRUCTURAL = 1e-9
"""Relative size below which an entry or singular value at random configurations is a structural zero."""


class Mechanism:
    """A `pin.Model` with closed loops, seen in minimal coordinates.

    Use `load`, `Mechanism.from_urdf` or `Mechanism.from_pinocchio`.

    Attributes
    ----------
    model : pin.Model
        A private copy of the spanning tree.
    closures : tuple of closures
    independent, dependent : tuple of str
        Names of the joints y is made of, and of all others.
    nq, nv, nc, m : int
        Sizes of q, of v, of φ (rows that are zero in every configuration left out), and of y.
    home : ndarray (nq,)
        Seed configuration.
    length : float
        Characteristic length, m: the largest distance from a joint to its children and cut points.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Closure],
        independent: Sequence[str],
        home: ArrayLike | None = None,
        name: str = "",
    ) -> None:
        require_depth_first(model)
        self.model: pin.Model = model.copy()
        self.name = name or str(model.name)
        self.closures = tuple(_as_closure(c) for c in closures)
        self.tree = Tree(self.model, closure_frames(self.model, self.closures))
        self.nq, self.nv = self.tree.nq, self.tree.nv
        self.joint_names = tuple(str(n) for n in self.model.names)[1:]
        self.independent = tuple(independent)
        self.iq_independent, self.iv_independent = self._indices(self.independent)
        self.m = len(self.independent)
        self.iv_dependent = np.setdiff1d(np.arange(self.nv), self.iv_independent)
        self.dependent = tuple(n for n in self.joint_names if n not in self.independent)
        self.home = pin.neutral(self.model) if home is None else self.configuration(home, "home")
        self.length = _characteristic_length(self.model, self.closures)
        self.implicit = self._implicit_without_zero_rows()
        self.nc = len(self.implicit.rows)
        self._require_dependent_columns_regular()

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        closures: Sequence[Closure] = (),
        independent: Sequence[str] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
    ) -> Mechanism:
        """A mechanism from any `pin.Model`, which is copied and never written to.

        Parameters
        ----------
        model : pin.Model
            The spanning tree.
        closures : sequence of PointClosure, FrameClosure or RevoluteClosure
            Pairs of frame names that close the loops.
        independent : sequence of str, optional
            Joints that serve as minimal coordinates, one number in q each; may be left out only
            where there is no loop (then: all joints).
        home : array_like (nq,), optional
            Seed configuration; `pin.neutral` when left out.

        Raises
        ------
        ModelError
            For a joint or frame that does not exist, or a joint order for which `pin.crba` is wrong.
        PartitionError
            When the dependent joints cannot be solved for in any configuration.
        """
        if independent is None:
            if closures:
                raise ModelError(
                    "independent: name the joints that serve as minimal coordinates; "
                    f"the model's joints are {', '.join(list(model.names)[1:])}"
                )
            independent = list(model.names)[1:]
        return cls(model, closures, independent, home=home, name=name)

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        closures: Sequence[Closure] = (),
        independent: Sequence[str] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
    ) -> Mechanism:
        """A mechanism from a URDF file (or its text); `continuous` joints become one number in q.

        See `from_pinocchio` for the other parameters.
        """
        return cls.from_pinocchio(model_from_urdf(urdf), closures, independent, home, name)

    # ----------------------------------------------------------------- the implicit constraint

    def phi(self, q: ArrayLike) -> Array:
        """Loop-closure residual φ(q), (nc,), m and rad."""
        self.tree.jacobians(self.configuration(q))
        return self.implicit.residual()

    def K(self, q: ArrayLike) -> Array:
        """K = ∂φ/∂q, (nc, nv): K v = 0."""
        self.phi(q)
        return self.implicit.jacobian()

    def k(self, q: ArrayLike, v: ArrayLike) -> Array:
        """k = −K̇ v, (nc,): K a = k."""
        q, v = self.configuration(q), self.velocity(v)
        self.tree.jacobians(q)
        self.implicit.residual()
        self.tree.rnea(q, v, self.tree.zero)
        return self.implicit.bias()

    @cached_property
    def row_scale(self) -> Array:
        """Size that makes each row of φ dimensionless, (nc,): the length for metres, 1 for radians."""
        return np.where(self.implicit.is_length, self.length, 1.0)

    @cached_property
    def column_scale(self) -> Array:
        """Size that makes each column of K dimensionless, (nv,).

        v = column_scale · u with u dimensionless: a column's largest norm over generic
        configurations, inverted, so that links of very different lengths weigh the same.
        """
        largest = np.zeros(self.nv)
        for K in self._generic_jacobians():
            largest = np.maximum(largest, np.linalg.norm(K / self.row_scale[:, None], axis=0))
        return 1.0 / np.where(largest > 0.0, largest, 1.0)

    def scaled(self, K: Array) -> Array:
        """K made dimensionless by `row_scale` and `column_scale`."""
        return K / self.row_scale[:, None] * self.column_scale

    def closure_residual(self, q: Array) -> float:
        """max |φ| in units of the characteristic length (m) and of 1 (rad)."""
        if self.nc == 0:
            return 0.0
        return float(np.max(np.abs(self.phi(q)) / self.row_scale))

    # ----------------------------------------------------------------- states

    def configuration(self, q: ArrayLike, what: str = "q") -> Array:
        """q as a float array (nq,), or a StateError that says what is wrong with it."""
        return _checked(q, self.nq, what, "nq")

    def velocity(self, v: ArrayLike, what: str = "v") -> Array:
        """v as a float array (nv,), or a StateError that says what is wrong with it."""
        return _checked(v, self.nv, what, "nv")

    def lift(self, q: ArrayLike, ydot: ArrayLike) -> Array:
        """v = G(q) ẏ, (nv,): the velocity of the whole tree for velocities ẏ (m,) of the independent joints.

        Raises
        ------
        StateError
            At a configuration where K_d is singular: give v along a mode of `analyse` instead.
        """
        q, ydot = self.configuration(q), _checked(ydot, self.m, "ydot", "m")
        v = np.zeros(self.nv)
        v[self.iv_independent] = ydot
        K = self.scaled(self.K(q))[:, self.iv_dependent]
        rhs = -self.K(q)[:, self.iv_independent] @ ydot / self.row_scale
        u, _, rank, _ = np.linalg.lstsq(K, rhs, rcond=1e-8)
        if rank < len(self.iv_dependent):
            raise StateError(
                "lift: K_d is singular at q, so ẏ does not determine v; take v along a mode of analyse"
            )
        v[self.iv_dependent] = self.column_scale[self.iv_dependent] * u
        return v

    def velocity_slice(self, name: str) -> slice:
        """Where the joint's entries are in v."""
        joint = self._joint(name)
        return slice(joint.idx_v, joint.idx_v + joint.nv)

    def assemble(self, q_guess: ArrayLike, hold: Sequence[str] | None = None) -> Array:
        """Close the loops from a rough guess.

        Least squares on φ by damped Gauss–Newton steps with a trust region, some joints held.

        Parameters
        ----------
        q_guess : array_like (nq,)
        hold : sequence of str, optional
            Joints that keep their value; the independent ones when left out.

        Returns
        -------
        ndarray (nq,)
            A configuration with max |φ| at rounding.

        Raises
        ------
        ClosureError
            With the residual that is left and the loop that it is in.
        """
        q = self.configuration(q_guess, "q_guess")
        _, held = self._indices(self.independent if hold is None else tuple(hold), single=False)
        free = np.setdiff1d(np.arange(self.nv), held)
        if self.nc == 0:
            return q

        def lift(step: Array) -> Array:
            dv = np.zeros(self.nv)
            dv[free] = step
            return dv

        def residual(step: Array) -> Array:
            return self.phi(self.tree.integrate(q, lift(step))) / self.row_scale

        def jacobian(step: Array) -> Array:
            dv = lift(step)
            K = self.K(self.tree.integrate(q, dv)) / self.row_scale[:, None]
            return (K @ self.tree.integrate_rate(q, dv))[:, free]

        fit = least_squares(residual, np.zeros(len(free)), jac=jacobian, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        q = self.polish(self.tree.integrate(q, lift(fit.x)), free)
        self.require_closed(q, CLOSED, "assemble")
        self.require_proper(q)
        return q

    def polish(self, q: Array, free: NDArray[np.int64]) -> Array:
        """Minimum-norm Newton steps on the velocities `free` until φ stops shrinking.

        Singular directions of K are left alone, so that a start at a singularity is polished too.
        """
        best, size = q, self.closure_residual(q)
        for _ in range(10):
            K = self.scaled(self.K(best))[:, free]
            step = np.linalg.pinv(K, rcond=1e-6) @ (self.phi(best) / self.row_scale)
            dv = np.zeros(self.nv)
            dv[free] = -step * self.column_scale[free]
            trial = self.tree.integrate(best, dv)
            trial_size = self.closure_residual(trial)
            if not trial_size < 0.5 * size:
                break
            best, size = trial, trial_size
        return best

    def require_closed(self, q: Array, tolerance: float, what: str) -> None:
        """Raise ClosureError when max |φ| / length exceeds `tolerance`."""
        if self.nc == 0:
            return
        phi = self.phi(q)
        worst = int(np.argmax(np.abs(phi) / self.row_scale))
        residual = float(np.abs(phi[worst]))
        if residual / self.row_scale[worst] <= tolerance:
            return
        unit = "m" if self.implicit.is_length[worst] else "rad"
        loop = self.implicit.labels[worst]
        raise ClosureError(
            f"{what}: the loop {loop} is open by {residual:.3g} {unit}; "
            + (
                "no configuration near the guess closes it with the held joints: try another "
                "guess, hold fewer joints, or check the link lengths"
                if what == "assemble"
                else "close it first with mech.assemble(q)"
            ),
            residual,
            loop,
        )

    def require_proper(self, q: Array) -> None:
        """Refuse the false zeros of the rotation rows: frames or axes turned by π to each other."""
        self.tree.jacobians(q)
        for i, closure in enumerate(self.closures):
            if isinstance(closure, PointClosure):
                continue
            R1, R2 = self.tree.frame_R[i], self.tree.frame_R[len(self.closures) + i]
            if isinstance(closure, FrameClosure):
                proper = float(np.trace(R2.T @ R1)) > 1.0
            else:
                axis = np.asarray(closure.axis, dtype=float)
                proper = float((R1 @ axis) @ (R2 @ axis)) > 0.0
            if not proper:
                loop = f"{closure.frame1} – {closure.frame2}"
                raise ClosureError(
                    f"the loop {loop} is closed with its frames turned by half a turn to each other; "
                    "start from a guess nearer to the aligned assembly",
                    float(np.pi),
                    loop,
                )

    def with_independent(self, independent: Sequence[str]) -> Mechanism:
        """The same mechanism in other minimal coordinates."""
        return Mechanism(self.model, self.closures, independent, home=self.home, name=self.name)

    def coordinate_choices(self, q: ArrayLike) -> list[tuple[float, tuple[str, ...]]]:
        """Sets of joints that parametrise the motion at a regular q, best conditioned first.

        Returns
        -------
        list of (float, tuple of str)
            σ_min of the chosen rows of an orthonormal kernel basis, in (0, 1], and the names.
        """
        K = self.scaled(self.K(q))
        _, s, Vt = np.linalg.svd(K)
        kernel = Vt[numerical_rank(s, STRUCTURAL) :].T
        names = [n for n in self.joint_names if self._joint(n).nq == 1 == self._joint(n).nv]
        indices = np.array([self._joint(n).idx_v for n in names], dtype=np.int64)
        return ranked_choices(kernel, indices, names)

    def __repr__(self) -> str:
        return (
            f"Mechanism({self.name!r}: {self.nv} velocities, {len(self.closures)} closures with "
            f"{self.nc} rows, y = {', '.join(self.independent) or 'none'})"
        )

    # ----------------------------------------------------------------- construction

    def _joint(self, name: str) -> pin.JointModel:
        return self.model.joints[self.model.getJointId(name)]

    def _indices(
        self, names: Sequence[str], single: bool = True
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        iq: list[int] = []
        iv: list[int] = []
        for name in names:
            if name not in self.joint_names:
                near = difflib.get_close_matches(str(name), self.joint_names, n=3)
                raise ModelError(
                    f"the model has no joint {name!r}; "
                    + (f"did you mean {' or '.join(map(repr, near))}? " if near else "")
                    + f"its joints are {', '.join(self.joint_names)}"
                )
            joint = self._joint(name)
            if single and (joint.nq, joint.nv) != (1, 1):
                raise ModelError(
                    f"joint {name!r} ({joint.shortname()}) has {joint.nq} numbers in q; an independent "
                    "joint needs exactly one: choose another, or give a revolute joint instead of a "
                    "continuous one (URDF files loaded here are converted)"
                )
            iq += range(joint.idx_q, joint.idx_q + joint.nq)
            iv += range(joint.idx_v, joint.idx_v + joint.nv)
        if len(set(iv)) != len(iv):
            raise ModelError(f"a joint is named twice in {', '.join(map(repr, names))}")
        return np.array(iq, dtype=np.int64), np.array(iv, dtype=np.int64)

    def generic_configurations(self, count: int = 5) -> list[Array]:
        """Reproducible configurations, loops open, at which nothing vanishes by accident."""
        rng = np.random.default_rng(20)
        neutral = pin.neutral(self.model)
        return [self.tree.integrate(neutral, rng.uniform(-2.0, 2.0, self.nv)) for _ in range(count)]

    def _generic_jacobians(self) -> list[Array]:
        return [self.K(q) for q in self.generic_configurations()]

    def _implicit_without_zero_rows(self) -> ImplicitConstraint:
        full = ImplicitConstraint(self.tree, self.closures)
        scale = np.where(full.is_length, self.length, 1.0)
        used = np.zeros(len(full.rows), dtype=bool)
        constant = np.zeros(len(full.rows))
        for q in self.generic_configurations():
            self.tree.jacobians(q)
            constant = full.residual() / scale
            used |= np.max(np.abs(full.jacobian()), axis=1, initial=0.0) > STRUCTURAL * scale
        open_rows = np.flatnonzero(~used & (np.abs(constant) > STRUCTURAL))
        if len(open_rows):
            row = int(open_rows[0])
            raise ModelError(
                f"closure {full.labels[row]}: its frames stay "
                f"{abs(constant[row] * scale[row]):.3g} {'m' if full.is_length[row] else 'rad'} "
                "apart in every configuration, along a direction that no joint moves; "
                "shift or turn one of the two frames"
            )
        return ImplicitConstraint(self.tree, self.closures, np.flatnonzero(used))

    def _require_dependent_columns_regular(self) -> None:
        nd = len(self.iv_dependent)
        ranks = []
        for K in self._generic_jacobians():
            s = np.linalg.svd(self.scaled(K)[:, self.iv_dependent], compute_uv=False)
            ranks.append(numerical_rank(s, STRUCTURAL))
        rank = max(ranks, default=0)
        if rank == nd:
            return
        K = self.scaled(self._generic_jacobians()[0])[:, self.iv_dependent]
        _, _, Vt = np.linalg.svd(K)
        moving = np.max(np.abs(Vt[rank:]), axis=0)
        culprits = [
            n
            for n in self.dependent
            if np.any(moving[np.isin(self.iv_dependent, self._indices([n], single=False)[1])] > 1e-6)
        ]
        suggestions = self._generic_choices()
        hint = (
            "; sets that would serve: " + ", or ".join(" + ".join(c) for c in suggestions)
            if suggestions
            else ""
        )
        raise PartitionError(
            f"independent = {', '.join(map(repr, self.independent)) or 'none'}: K_d is structurally "
            f"singular (rank {rank} for {nd} dependent velocities): the closures do not determine "
            f"{', '.join(map(repr, culprits))} in any configuration{hint}",
            suggestions,
        )

    def _generic_choices(self) -> list[tuple[str, ...]]:
        """Sets of joints whose complement the closures determine at a generic configuration."""
        return [names for _, names in self.coordinate_choices(self.generic_configurations()[0])]

    def select_rows(self, K: Array) -> NDArray[np.int64]:
        """As many rows of K as there are dependent velocities, the best conditioned at this K."""
        return independent_rows(self.scaled(K)[:, self.iv_dependent], len(self.iv_dependent))


def _as_closure(closure: Closure) -> Closure:
    if not isinstance(closure, PointClosure | FrameClosure | RevoluteClosure):
        raise ModelError(f"closures: {closure!r} is not a PointClosure, FrameClosure or RevoluteClosure")
    return closure


def _checked(value: ArrayLike, size: int, what: str, letter: str) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise StateError(f"{what}: {value!r} is not a list of {size} numbers") from error
    if array.shape != (size,):
        raise StateError(f"{what} has shape {array.shape}, expected ({letter},) = ({size},)")
    if not np.all(np.isfinite(array)):
        bad = int(np.flatnonzero(~np.isfinite(array))[0])
        raise StateError(f"{what}[{bad}] is {array[bad]}: every entry must be finite")
    return array


def _characteristic_length(model: pin.Model, closures: Sequence[Closure]) -> float:
    lengths = [float(np.linalg.norm(placement.translation)) for placement in model.jointPlacements]
    ends = {name for c in closures for name in (c.frame1, c.frame2)}
    lengths += [
        float(np.linalg.norm(frame.placement.translation)) for frame in model.frames if frame.name in ends
    ]
    return max(lengths, default=0.0) or 1.0
