"""Closed loops seen in minimal coordinates: where y is in q and v, G and g."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import checked_vector, require_finite
from ...errors import ModelError, PartitionError, StateError
from ..constraint.rank import motions
from ..loops import ClosedLoops
from ..many_states import at_each
from ..tolerances import COMPATIBLE, RANK
from ..tree.joints import Joint, in_v
from ..tree.tree import Array
from .clusters import LoopCluster, loop_clusters
from .partition import independent_rows, ranked_choices

COMPONENT = 0.1
"""Weight of one component of a spherical joint beside that of a revolute one, where both would serve."""

INTERNAL = frozenset(
    {
        "K_rate", "actuation", "applied", "chart_joints", "choose", "column_scale", "from_contents",
        "generic_configurations", "generic_jacobians", "group_joints", "implicit", "iq_independent",
        "iq_numbers", "iv_dependent", "iv_independent", "joint_at", "joint_inertia", "judged_at", "lifted",
        "loops", "memo", "near", "numbers", "of_loops", "own_model", "polish", "require_closed",
        "require_unchanged", "row_scale", "scaled", "select_rows", "standpoint", "tree", "units",
        "velocities_named", "velocities_of", "velocity_slice", "y_about",
    }
)  # fmt: skip
"""What the other rooms ask a mechanism for, and nobody who writes its name and a dot is shown."""


class Coordinates(ClosedLoops):
    """`ClosedLoops` with a choice of independent velocities.

    Attributes
    ----------
    independent, dependent : tuple of str
        Names of the joints y is made of, `joint.component` where it is one of several velocities of a
        joint, and of all joints that are not independent as a whole.
    iv_independent, iv_dependent : ndarray of int
        Where their velocities are in v.
    m : int
        How many are independent.
    """

    name: str
    independent: tuple[str, ...]

    def __dir__(self) -> list[str]:
        """What users need."""
        return [name for name in super().__dir__() if name not in INTERNAL]

    def choose(self, independent: tuple[str, ...]) -> None:
        """Make these the independent joints and components; whether they can serve is not asked here."""
        self.independent = independent
        self.iv_independent = self.velocities_named(self.independent)
        self.m = len(self.iv_independent)
        self.iv_dependent = np.setdiff1d(np.arange(self.nv), self.iv_independent)
        chosen = set(self.iv_independent.tolist())
        self.dependent = tuple(j.name for j in self.joints if not chosen.issuperset(j.iv))

    def coordinate_choices(self, q: ArrayLike) -> list[tuple[float, tuple[str, ...]]]:
        """Sets of joints that parametrise the motion at a regular q, best conditioned first.

        Joints with one number each where these suffice, else single velocities of the others too.

        Each with σ_min of its rows of an orthonormal kernel basis, in (0, 1].
        """
        kernel = motions(self, self.configuration(q))
        single = [joint for joint in self.joints if joint.single]
        indices = np.array([joint.idx_v for joint in single], dtype=np.int64)
        found = ranked_choices(kernel, indices, [joint.name for joint in single])
        if found or len(single) == len(self.joints):
            return found
        weight = np.full((self.nv, 1), COMPONENT)
        weight[indices] = 1.0
        numbers = [c.name for c in in_v(self.joints)]
        return ranked_choices(kernel, np.arange(self.nv), numbers, weight=weight)

    @cached_property
    def clusters(self) -> tuple[LoopCluster, ...]:
        """The loop clusters, each with its own joints, closures and mobility; joints in none are free."""
        return loop_clusters(self, self.independent, self.iv_independent)

    @cached_property
    def group_joints(self) -> tuple[Joint, ...]:
        """Joints in no loop whose velocities are all independent and no rates of numbers in q."""
        chosen = set(self.iv_independent.tolist())
        return tuple(
            joint
            for joint in self.joints
            if not joint.flat
            and chosen.issuperset(joint.iv)
            and not any(joint.name in cluster.joints for cluster in self.clusters)
        )

    @cached_property
    def chart_joints(self) -> tuple[Joint, ...]:
        """Joints in loops with independent velocities that are no rates of numbers in q.

        Such as the spherical joint of a rod that spins idly: one velocity is independent, two are dependent.
        """
        chosen = set(self.iv_independent.tolist())
        free = {joint.name for joint in self.group_joints}
        return tuple(
            joint
            for joint in self.joints
            if not joint.flat and not chosen.isdisjoint(joint.iv) and joint.name not in free
        )

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        """Positions of those of y that are numbers in q: all but those of `group_joints`, `chart_joints`."""
        flat = [k for k, i in enumerate(self.iv_independent) if self.joint_at(int(i)).flat]
        return np.array(flat, dtype=np.int64)

    @cached_property
    def iq_numbers(self) -> NDArray[np.int64]:
        """Where these are in q."""
        return self._in_q(self.iv_independent[self.numbers])

    def y_about(self, q: ArrayLike) -> Array:
        """y at q, (m,); 0 for those that are no numbers in q, whose charts are about q."""
        y = np.zeros(self.m)
        y[self.numbers] = checked_vector(q, self.nq, "q", "nq")[self.iq_numbers]
        return y

    @cached_property
    def iq_independent(self) -> NDArray[np.int64]:
        """Where y is in q, (m,).

        Raises
        ------
        PartitionError
            Where an independent velocity is not the rate of a number in q.
        """
        return self._in_q(self.iv_independent)

    def _in_q(self, iv: Sequence[np.int64] | NDArray[np.int64]) -> NDArray[np.int64]:
        """Where the numbers are in q whose rates these velocities are."""
        owners = [self.joint_at(int(i)) for i in iv]
        lost = [joint for joint in owners if not joint.flat]
        if lost:
            raise PartitionError(
                f"the independent velocities {', '.join(self.independent)} of {self.name!r} are not all "
                f"rates of numbers in q: those of joint {lost[0].name!r} ({lost[0].type}) are velocities on "
                "a group and have no coordinates y; read q and v instead"
            )
        places = zip(owners, iv, strict=True)
        return np.array([joint.idx_q + i - joint.idx_v for joint, i in places], dtype=np.int64)

    @at_each("nv", "m")
    def G(self, q: ArrayLike) -> Array:
        """∂γ/∂y at a closed q, (nv, m), or (N, nv, m) at many: v = G ẏ, with G = [I; −K_d⁻¹ K_i], Eq. (4).

        Raises
        ------
        StateError
            At a configuration where K_d is singular.
        """
        q = self.configuration(q)
        G = np.zeros((self.nv, self.m))
        G[self.iv_independent] = np.eye(self.m)
        K = self.K(q)
        G[self.iv_dependent] = self._dependent(q, -K[:, self.iv_independent])
        u = (G.T / self.column_scale).T
        # least squares hides rows that contradict each other, as at a pose where K has gained rank
        if np.abs(self.scaled(K) @ u).max(initial=0.0) > COMPATIBLE * np.abs(u).max(initial=1.0):
            raise StateError(
                f"the loops do not let {', '.join(self.independent)} move one by one at q: K has more "
                "rows than dependent velocities can satisfy; analyse(mech, q) says what moves"
            )
        return G

    @at_each("nv")
    def g(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Ġ ẏ at a closed q with K v = 0, (nv,): a = G ÿ + g, with g = [0; K_d⁻¹ k], Eq. (4).

        Raises
        ------
        StateError
            As for `G`.
        """
        q = self.configuration(q)
        g = np.zeros(self.nv)
        g[self.iv_dependent] = self._dependent(q, self.k(q, v))
        return g

    def _dependent(self, q: Array, rhs: Array) -> Array:
        """K_d⁻¹ rhs, in the least-squares sense over redundant rows."""
        K = self.scaled(self.K(q))[:, self.iv_dependent]
        rhs = (rhs.T / self.row_scale).T
        u, _, rank, _ = np.linalg.lstsq(K, rhs, rcond=RANK)
        if rank < len(self.iv_dependent):
            raise StateError(
                "K_d is singular at q, so ẏ does not determine v; take v along a mode of analyse"
            )
        return require_finite((self.column_scale[self.iv_dependent] * u.T).T, "K_d⁻¹ times it")

    def velocities_named(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Where the velocities of these joints and components of joints are in v."""
        iv = [i for name in names for i in self.velocities_of(name)]
        if len(set(iv)) != len(iv):
            raise ModelError(f"a joint is named twice in {', '.join(map(repr, names))}")
        return np.array(iv, dtype=np.int64)

    def select_rows(self, K: Array) -> NDArray[np.int64]:
        """As many rows of K as there are dependent velocities, the best conditioned at this K."""
        return independent_rows(self.scaled(K)[:, self.iv_dependent], len(self.iv_dependent))
