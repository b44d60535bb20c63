"""Closed loops: a spanning tree with its implicit constraint, before any choice of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TypeVar, cast

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import ArrayLike, NDArray

from ..checks import checked_rows, checked_vector, require_finite
from ..errors import ModelError, StateError
from .constraint.closed_check import require_closed
from .constraint.closures import closure_frames
from .constraint.constraint import without_zero_rows
from .constraint.couplings import AnyClosure, CouplingClosure, Couplings, closures_given
from .coordinates.loop_graph import characteristic_length
from .many_states import at_each
from .memo import Memo
from .named_numbers import Named, with_numbers
from .tolerances import CLOSED, POLISHED, ROUNDED, STRUCTURAL
from .tree.joints import Joint, in_v, joint_named, joints_of
from .tree.model import check_model, require_equal, seen_from, standpoint
from .tree.tree import Array, Tree, require_depth_first

MADE = (
    "closures", "implicit", "joint_names", "length", "loops", "nc", "near", "nq", "nv", "own_model",
    "standpoint", "tree",
)  # fmt: skip
"""What loops consist of; the rest is worked out from it."""


Kind = TypeVar("Kind", bound="ClosedLoops")


class ClosedLoops:
    """A `pin.Model` and the closures that close its loops.

    Rows that no joint moves are left out where they stay open by no more than `rounded`, rad or lengths.

    Attributes
    ----------
    own_model : pin.Model
        A private copy of the spanning tree, which nobody changes.
    standpoint : ndarray (3,)
        The point of the ground that `near` and `tree` have as their origin, m.
    near : pin.Model
        The model seen from there; the same one where its first joint is not far from the origin.
    closures : tuple of closures
        Those between two frames, then those that couple two joints, as their rows come in φ.
    loops : tuple of closures
        Those between two frames.
    nq, nv, nc : int
        Sizes of q, of v, and of φ (rows that are zero in every configuration left out).
    home : ndarray (nq,)
        Seed configuration.
    length : float
        Characteristic length, m: the largest distance from a joint to its children and cut points in a loop.
    memo, of_loops : Memo
        What was worked out once, by whoever needs it; `of_loops` is the same in all coordinates.
    """

    def __init__(self, model: pin.Model, closures: Sequence[AnyClosure], rounded: float = STRUCTURAL) -> None:
        check_model(model)
        closures = closures_given(closures)
        require_depth_first(model)
        self.memo, self.of_loops = Memo(), Memo()
        self.home: Array = pin.neutral(model)
        self.own_model: pin.Model = model.copy()
        self._shown_model: pin.Model | None = None
        closures = [_as_closure(c) for c in closures]
        couplings = [c for c in closures if isinstance(c, CouplingClosure)]
        self.loops = tuple(c for c in closures if not isinstance(c, CouplingClosure))
        self.closures: tuple[AnyClosure, ...] = (*self.loops, *couplings)
        Couplings(joints_of(self.own_model), couplings)  # these two refuse what is not there
        closure_frames(self.own_model, self.loops)
        self.length = characteristic_length(self.own_model, self.closures)
        self.standpoint = standpoint(self.own_model)
        self.near = seen_from(self.own_model, self.standpoint)
        points, n = closure_frames(self.near, self.loops), len(self.loops)
        self.tree = Tree(self.near, points)
        self.tree.joined = [points[i::n] for i, closure in enumerate(self.loops) if closure.joins]
        self.nq, self.nv = self.tree.nq, self.tree.nv
        self.joint_names = tuple(joint.name for joint in self.joints)
        self.implicit = without_zero_rows(
            self.tree, self.closures, self.length, self.generic_configurations(), rounded
        )
        self.nc = len(self.implicit.rows)

    @property
    def model(self) -> pin.Model:
        """The spanning tree, to be read: a copy, after whose change every call is refused."""
        if self._shown_model is None:
            self._shown_model = self.own_model.copy()
        return self._shown_model

    def require_unchanged(self) -> None:
        """Refuse to go on with a mechanism whose `model` was changed, since what follows from it was not.

        See `tree.model.require_equal`.
        """
        if self._shown_model is not None:
            require_equal(self._shown_model, self.own_model)

    # ----------------------------------------------------------------- the implicit constraint

    @at_each("nc")
    def phi(self, q: ArrayLike) -> Array:
        """Loop-closure residual φ(q), (nc,), m and rad; (N, nc) at q (N, nq), as the next ones."""
        self.tree.jacobians(self.configuration(q))
        return require_finite(self.implicit.residual(), "φ(q)")

    @at_each("nc", "nv")
    def K(self, q: ArrayLike) -> Array:
        """K = ∂φ/∂q, (nc, nv): K v = 0."""
        self.tree.jacobians(self.configuration(q))
        return require_finite(self.implicit.jacobian(), "K(q)")

    @at_each("nc")
    def k(self, q: ArrayLike, v: ArrayLike) -> Array:
        """k = −K̇ v, (nc,): K a = k."""
        q, v = self.configuration(q), self.velocity(v)
        self.tree.jacobians(q)
        self.tree.rnea(q, v, self.tree.zero)
        return require_finite(self.implicit.bias(), "k(q, v)")

    @at_each("nc", "nv")
    def K_rate(self, q: ArrayLike, v: ArrayLike) -> Array:
        """K̇ along v, (nc, nv): K̇ v = −k."""
        q, v = self.configuration(q), self.velocity(v)
        self.tree.jacobian_rates(q, v)
        return require_finite(self.implicit.jacobian_rate(v), "the rate of K")

    @cached_property
    def row_scale(self) -> Array:
        """Size that makes each row of φ dimensionless, (nc,): the length for metres, 1 for radians."""
        return np.where(self.implicit.is_length, self.length, 1.0)

    @cached_property
    def column_scale(self) -> Array:
        """Size that makes each column of K dimensionless, (nv,).

        v = column_scale · u with u dimensionless: a column's largest norm over generic
        configurations, inverted, so that links of very different lengths weigh the same; the joint's
        own unit where that norm is rounding.
        """
        largest = np.zeros(self.nv)
        for K in self.generic_jacobians():
            largest = np.maximum(largest, np.linalg.norm(K / self.row_scale[:, None], axis=0))
        largest *= self.units  # columns by radians and lengths, or their sizes do not compare
        # the column of an idle spin, rounding of 1e-16, would be scaled up to look like any other
        acts = largest > STRUCTURAL * largest.max(initial=0.0)
        return self.units / np.where(acts, largest, 1.0)

    @cached_property
    def units(self) -> Array:
        """What counts as one of each joint's coordinates, (nv,): a radian, or the characteristic length."""
        return np.where(self.tree.rotates, 1.0, self.length)

    @cached_property
    def joint_inertia(self) -> float:
        """What the joints' motions have as inertia one by one, at most 1 fast without dimension."""
        diagonals = [self.tree.crba(q).diagonal() for q in self.generic_configurations()]
        return float((np.max(diagonals, axis=0) * self.column_scale**2).sum()) if diagonals else 0.0

    def scaled(self, K: Array) -> Array:
        """K made dimensionless by `row_scale` and `column_scale`."""
        return K / self.row_scale[:, None] * self.column_scale

    def closure_residual(self, q: Array) -> float:
        """max |φ| in units of the characteristic length (m) and of 1 (rad)."""
        if self.nc == 0:
            return 0.0
        return float(np.max(np.abs(self.phi(q)) / self.row_scale))

    def configuration(self, q: ArrayLike | Named, what: str = "q") -> Array:
        """q as a float array (nq,), or a StateError that says what is wrong with it.

        Numbers by joint, or by component of a joint, stand for the seed configuration with these in it.
        """
        self.require_unchanged()
        if isinstance(q, Mapping):
            q = with_numbers(self.joints, self.home, q, "q", what)
        checked = checked_vector(q, self.nq, what, "nq")
        if self.tree.vector_space or pin.isNormalized(self.own_model, checked, CLOSED):
            return checked
        if pin.isNormalized(self.own_model, checked, ROUNDED):
            normalised: Array = pin.normalize(self.own_model, checked)
            return normalised
        turning = ", ".join(repr(joint.name) for joint in self.joints if not joint.flat)
        raise StateError(
            f"{what}: an orientation in it is none: the quaternion (x, y, z, w), or (cos, sin), of each of "
            f"{turning} must have norm 1; use pin.normalize(model, q)"
        )

    def configurations(self, q: ArrayLike, what: str = "q") -> Array:
        """Many of them as a float array (N, nq); see `configuration`."""
        self.require_unchanged()
        checked = checked_rows(q, None, self.nq, what, "nq")
        if self.tree.vector_space:
            return checked
        return np.array([self.configuration(one, f"{what}[{i}]") for i, one in enumerate(checked)])

    def velocity(self, v: ArrayLike | Named, what: str = "v") -> Array:
        """v as a float array (nv,), or a StateError that says what is wrong with it; see `configuration`.

        Velocities that are not named are zero.
        """
        if isinstance(v, Mapping):
            v = with_numbers(self.joints, np.zeros(self.nv), v, "v", what)
        return checked_vector(v, self.nv, what, "nv")

    def polish(self, q: Array, free: NDArray[np.int64]) -> Array:
        """Minimum-norm Newton steps on the velocities `free` until φ stops shrinking.

        Singular directions of K are left alone, so that a start at a singularity is polished too. By a
        complete orthogonal factorisation (LAPACK's gelsy), at a third of an SVD's cost.
        """
        best, size = q, self.closure_residual(q)
        for _ in range(10 if size > 0.0 and len(free) else 0):
            K = self.scaled(self.K(best))[:, free]
            residual = self.phi(best) / self.row_scale
            # redundant rows need no choice: the step of least norm closes all of them
            step = scipy.linalg.lstsq(K, residual, cond=POLISHED, lapack_driver="gelsy")[0]
            dv = np.zeros(self.nv)
            dv[free] = -step * self.column_scale[free]
            trial = self.tree.integrate(best, dv)
            trial_size = self.closure_residual(trial)
            if not trial_size < 0.5 * size:  # beside rounding Newton's steps gain nothing; also for NaN
                break
            best, size = trial, trial_size
        return best

    def require_closed(self, q: Array, tolerance: float, what: str) -> None:
        """Raise ClosureError when max |φ| / length exceeds `tolerance`."""
        if self.nc:
            require_closed(self, q, tolerance, what)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints but the ground, in the order of q and v."""
        return self.tree.joints

    def joint(self, name: str) -> Joint:
        """The joint of that name, or a ModelError that names near ones."""
        return joint_named(self.joints, name)

    def velocities_of(self, name: str) -> list[int]:
        """Where the velocities of a joint, or of one component of a joint, are in v."""
        found, given = list[int](), cast(object, name)
        if isinstance(given, str) and given not in self.joint_names:
            found = [c.iv for c in in_v(self.joints) if c.name == given]
        return found or list(self.joint(name).iv)  # which tells near names

    def velocity_slice(self, name: str) -> slice:
        """Where the joint's entries are in v."""
        return self.joint(name).v

    def joint_at(self, i: int) -> Joint:
        """The joint that velocity i belongs to."""
        return next(joint for joint in self.joints if i < joint.idx_v + joint.nv)

    def generic_configurations(self, count: int = 5) -> list[Array]:
        """Reproducible configurations, loops open, at which nothing vanishes by accident.

        Up to two radians, or two characteristic lengths, from the neutral one.
        """
        rng = np.random.default_rng(20)  # the same for everyone: scales, ranks and choices rest on them
        neutral = pin.neutral(self.own_model)
        steps = [rng.uniform(-2.0, 2.0, self.nv) * self.units for _ in range(count)]
        return [self.tree.integrate(neutral, step) for step in steps]

    def generic_jacobians(self) -> list[Array]:
        """K at the generic configurations."""
        return [*map(self.K, self.generic_configurations())]


def once_more(loops: ClosedLoops, kind: type[Kind]) -> Kind:
    """The same loops, of which nothing is worked out yet, on the same workspace of Pinocchio's.

    Both use it one after the other on a thread, as two runs of one mechanism do.
    """
    same = kind.__new__(kind)
    vars(same).update({name: vars(loops)[name] for name in MADE})
    same.memo, same.of_loops, same._shown_model = Memo(), Memo(), None
    same.home = pin.neutral(same.own_model)
    return same


def _as_closure(closure: AnyClosure) -> AnyClosure:
    if isinstance(closure, AnyClosure):
        return closure
    raise ModelError(f"closures: {closure!r} is no Closure, such as a PointClosure, and no CouplingClosure")
