"""A mechanism: a spanning tree, loop closures, and the joints chosen as minimal coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..checks import check_model, check_text, checked_vector, listed, require_finite
from ..errors import ModelError, StateError
from .clusters import LoopCluster, loop_clusters
from .couplings import AnyClosure
from .forces import AppliedForces, Force
from .formats.mjcf import model_from_mjcf
from .formats.pin_constraints import with_named_frames
from .formats.urdf import model_from_urdf
from .independent import best_at_home, require_determined
from .loops import ClosedLoops
from .partition import independent_rows
from .recommended import Recommended
from .tolerances import RANK
from .tree import Array


class Mechanism(ClosedLoops):
    """A `pin.Model` with closed loops, seen in minimal coordinates.

    Use `load`, `Mechanism.from_urdf`, `Mechanism.from_mjcf` or `Mechanism.from_pinocchio`.

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
    forces : tuple of forces
        Springs, dampers and constant drives.
    applied : AppliedForces or None
        What the forces amount to; None where there are none.
    recommended : Recommended
        Duration, step and velocity at home that `simulate` takes where they are left out.
    length : float
        Characteristic length, m: the largest distance from a joint to its children and cut points in a loop.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[AnyClosure],
        independent: Sequence[str] | Literal["auto"],
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
    ) -> None:
        super().__init__(model, closures)
        self.forces = tuple(listed(forces, "forces", "forces, such as JointSpring(joint, stiffness)"))
        self.applied = AppliedForces(self.tree, self.forces) if self.forces else None
        check_text("name", name)
        self.name = name or str(model.name)
        self.recommended = Recommended()
        self.home = pin.neutral(self.model) if home is None else self.configuration(home, "home")
        if isinstance(independent, str) and independent == "auto":
            self.home, self.independent = best_at_home(self, self.home, self.name)
        else:
            self.independent = _joints(independent, "independent")
        self.iq_independent, self.iv_independent = self._indices(self.independent)
        self.m = len(self.independent)
        self.iv_dependent = np.setdiff1d(np.arange(self.nv), self.iv_independent)
        self.dependent = tuple(n for n in self.joint_names if n not in self.independent)
        require_determined(self, self.independent, self.dependent, self.iv_dependent, self.home)

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        closures: Sequence[Any] = (),
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
    ) -> Mechanism:
        """A mechanism from any `pin.Model`, which is copied and never written to.

        Parameters
        ----------
        model : pin.Model
            The spanning tree.
        closures : sequence of PointClosure, FrameClosure, RevoluteClosure or CouplingClosure
            Pairs of frame names that close the loops, pairs of joints that move together; also
            Pinocchio's constraint models, see `pin_constraints.with_named_frames`.
        independent : sequence of str or "auto", optional
            Joints that serve as minimal coordinates, one number in q each; may be left out only
            where there is no loop (then: all joints). "auto" takes the best conditioned set at home
            (assembled first where its loops are open) and logs it.
        home : array_like (nq,), optional
            Seed configuration; `pin.neutral` when left out.
        forces : sequence of JointSpring, JointDamper, PointSpring or JointTorque
            What acts besides gravity and the torques of a simulation.

        Raises
        ------
        ModelError
            For a joint or frame that does not exist, or a joint order for which `pin.crba` is wrong.
        PartitionError
            When the dependent joints cannot be solved for in any configuration.
        """
        check_model(model)
        closures = listed(closures, "closures", "closures, such as PointClosure(frame1, frame2)")
        model, closures = with_named_frames(model, closures)
        if independent is None:
            if closures:
                raise ModelError(
                    "independent: name the joints that serve as minimal coordinates, or 'auto'; "
                    f"the model's joints are {', '.join(list(model.names)[1:])}"
                )
            independent = list(model.names)[1:]
        return cls(model, closures, independent, home=home, name=name, forces=forces)

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        closures: Sequence[Any] = (),
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
    ) -> Mechanism:
        """A mechanism from a URDF file (or its text); `continuous` joints become one number in q.

        See `from_pinocchio` for the other parameters.
        """
        return cls.from_pinocchio(model_from_urdf(urdf), closures, independent, home, name, forces)

    @classmethod
    def from_mjcf(
        cls,
        mjcf: str | Path,
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | str | None = None,
        name: str = "",
    ) -> Mechanism:
        """A mechanism from a MJCF file (or its text); see `mjcf.model_from_mjcf` for what is read.

        `home` is q (nq,), the name of a keyframe, or MuJoCo's qpos0 when left out.
        """
        parts = model_from_mjcf(mjcf)
        q = parts.configuration(home) if home is None or isinstance(home, str) else home
        return cls.from_pinocchio(parts.model, parts.closures, independent, q, name, parts.forces)

    @cached_property
    def clusters(self) -> tuple[LoopCluster, ...]:
        """The loop clusters, each with its own joints, closures and mobility; joints in none are free."""
        return loop_clusters(self, self.independent, self.iv_independent)

    def lift(self, q: ArrayLike, ydot: ArrayLike) -> Array:
        """v = G(q) ẏ, (nv,): the velocity of the whole tree for velocities ẏ (m,) of the independent joints.

        Raises
        ------
        StateError
            At a configuration where K_d is singular: give v along a mode of `analyse` instead.
        """
        return self.G(q) @ checked_vector(ydot, self.m, "ydot", "m")

    def G(self, q: ArrayLike) -> Array:
        """∂γ/∂y at a closed q, (nv, m): v = G ẏ, with G = [I; −K_d⁻¹ K_i], Eq. (4).

        Raises
        ------
        StateError
            At a configuration where K_d is singular.
        """
        q = self.configuration(q)
        G = np.zeros((self.nv, self.m))
        G[self.iv_independent] = np.eye(self.m)
        G[self.iv_dependent] = self._dependent(q, -self.K(q)[:, self.iv_independent])
        return G

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

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """Kinetic energy, potential energy of gravity and of the springs together, J."""
        q, v = self.configuration(q), self.velocity(v)
        energy = sum(self.tree.energies(q, v))
        if self.applied is not None:
            energy += self.applied.energy(q)
        return float(require_finite(np.asarray(energy), "the energy"))

    def assemble(self, q_guess: ArrayLike, hold: Sequence[str] | None = None) -> Array:
        """Close the loops from a rough guess.

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
        names = self.independent if hold is None else _joints(hold, "hold")
        _, held = self._indices(names, single=False)
        free = np.setdiff1d(np.arange(self.nv), held)
        return self.close_loops(self.configuration(q_guess, "q_guess"), free)

    def with_independent(self, independent: Sequence[str]) -> Mechanism:
        """The same mechanism in other minimal coordinates."""
        other = Mechanism(self.model, self.closures, independent, self.home, self.name, self.forces)
        other.recommended = self.recommended
        return other

    def __reduce__(self) -> tuple[type[Mechanism], tuple[Any, ...], dict[str, Any]]:
        """Pickle and copy by the recipe: the workspace holds views that must not be copied."""
        recipe = (self.model, self.closures, self.independent, self.home, self.name, self.forces)
        return Mechanism, recipe, {"recommended": self.recommended}

    def __repr__(self) -> str:
        return (
            f"Mechanism({self.name!r}: {self.nv} velocities, {len(self.closures)} closures with "
            f"{self.nc} rows, y = {', '.join(self.independent) or 'none'})"
        )

    # ----------------------------------------------------------------- construction

    def _indices(
        self, names: Sequence[str], single: bool = True
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        iq: list[int] = []
        iv: list[int] = []
        for name in names:
            joint = self.joint(name)
            if single and not joint.single:
                raise ModelError(
                    f"joint {name!r} ({joint.type}) has {joint.nq} numbers in q; an independent "
                    "joint needs exactly one: choose another, or give a revolute joint instead of a "
                    "continuous one (URDF files loaded here are converted)"
                )
            iq += range(joint.idx_q, joint.idx_q + joint.nq)
            iv += range(joint.idx_v, joint.idx_v + joint.nv)
        if len(set(iv)) != len(iv):
            raise ModelError(f"a joint is named twice in {', '.join(map(repr, names))}")
        return np.array(iq, dtype=np.int64), np.array(iv, dtype=np.int64)

    def select_rows(self, K: Array) -> NDArray[np.int64]:
        """As many rows of K as there are dependent velocities, the best conditioned at this K."""
        return independent_rows(self.scaled(K)[:, self.iv_dependent], len(self.iv_dependent))


def _joints(names: Any, what: str) -> tuple[str, ...]:
    """Joint names that were given as a list."""
    return tuple(listed(names, what, "joint names"))
