"""What a mechanism does by rooms that stand above it: assemblies, impulses by themselves, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks import at_row, checked_rows, checked_vector, is_table, listed
from .assembly.assemblies import Assemblies, assemblies
from .assembly.ranges import assembled_all, assembled_near
from .coordinates.coordinates import Coordinates
from .named_numbers import Named
from .tree.tree import Array

if TYPE_CHECKING:
    from ..simulation.phases.impact import Impact
    from .parts import Part


class Above(Coordinates):
    """`Coordinates` that are assembled, struck by stops and locks, and written to files."""

    def write(self, path: str | Path) -> Path:
        """Write it as a file that `load` reads back with the same motion, by the path's suffix.

        - `.xml`, `.mjcf`: MJCF, with `connect`, `weld`, `joint` and `tendon` equalities, springs, dampers,
          armature, ranges, constant torques, motors, home and other keyframes;
        - `.urdf`: URDF with its loops as `<loop>` and `<constraint>`, couplings as `<mimic>`; it has no place
          for gravity, constant torques and home;
        - no suffix: a folder of robot.urdf and robot.yaml, which holds all but forces of your own.

        Joints, bodies, frames and units are kept. A ModelWarning tells what the format has no place for.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        ModelError
            For another suffix, a joint, closure or coupling that the format has not, by name, and where the
            system does not take the file.
        """
        from ..io.write import write

        return write(self, path)  # type: ignore[arg-type]  # every one of them is a Mechanism

    def export(
        self, path: str | Path, charts: Sequence[Sequence[str]] = (), step: float = 1e-3, fmi: int = 2
    ) -> Path:
        """Write it for programs without Python, by the path's suffix.

        - `.rgcp`: a file that the C library opens (`robust_gcp.h`): motions, G, g, the reduced equation and
          derivatives, the same bits as from here;
        - `.fmu`: a unit for co-simulation, FMI 2.0 or 3.0, of this system and processor: inputs
          `tau.JOINT` and `ctrl.ACTUATOR`, outputs `q.JOINT`, `v.JOINT` and `crossings`;
        - `.c`: for one coordinate, C99 tables of the reduced equation along the mode of home, with their
          header beside it: by y where it goes all the way round, else by the mode's arc length.

        Parameters
        ----------
        path : str or Path
        charts : sequence of sequence of str
            Further choices of independent joints, which a motion changes to where those named turn back.
        step : float
            Of RK4 within a unit for co-simulation, s.
        fmi : {2, 3}
            Version of the standard that such a unit is of.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        ModelError
            For another suffix, what the compiled kernel does not do alone (stops, friction, forces of your
            own, actuators with activations), and where the system does not take the file.
        """
        from ..export.write import export

        return export(self, path, charts, step, fmi)  # type: ignore[arg-type]  # every one of them is a Mechanism

    def assemble(self, q_guess: ArrayLike | Named, hold: Sequence[str] | None = None) -> Array:
        """Close the loops from a rough guess, or from many.

        Far from the guess an assembly is preferred that has the joints inside their ranges.

        Parameters
        ----------
        q_guess : array_like (nq,), dict, or array_like (N, nq)
            Numbers by joint: joints that are not named are where home has them. Many guesses are closed
            together, some microseconds each.
        hold : sequence of str, optional
            Joints that keep their value; the independent ones when left out.

        Returns
        -------
        ndarray (nq,) or (N, nq)
            Configurations with max |φ| at rounding.

        Raises
        ------
        ClosureError
            With each loop that stays open, and by how much; of many guesses `failed` has the numbers of
            those that are not closed, `nearest` the others' configurations.
        """
        held = self.velocities_named(self.independent if hold is None else joint_names(hold, "hold"))
        free = np.setdiff1d(np.arange(self.nv), held)
        if isinstance(q_guess, Mapping) or not is_table(q_guess):
            return assembled_near(self, self.configuration(q_guess, "q_guess"), free, "assemble")
        return assembled_all(self, self.configurations(q_guess, "q_guess"), free, "assemble")

    def lift(self, q: ArrayLike, ydot: ArrayLike) -> Array:
        """v = G(q) ẏ: the velocity of the whole tree for velocities ẏ of the independent joints.

        Parameters
        ----------
        q : array_like (nq,) or (N, nq)
            Closed configurations.
        ydot : array_like (m,), or (N, m) for many configurations

        Returns
        -------
        ndarray (nv,) or (N, nv)

        Raises
        ------
        StateError
            At a configuration where K_d is singular: give v along a mode of `analyse` instead.
        """
        if not is_table(q):
            return self.G(q) @ checked_vector(ydot, self.m, "ydot", "m")
        many = self.configurations(q, "q")
        rates = ydot if is_table(ydot) else np.tile(checked_vector(ydot, self.m, "ydot", "m"), (len(many), 1))
        v = np.zeros((len(many), self.nv))
        v[:, self.iv_independent] = checked_rows(rates, len(many), self.m, "ydot", "m")
        from ..kernel.constraint.assembling import lifted

        done = lifted(self, many, v, self.iv_dependent)
        for i in range(len(many)) if done is None else np.flatnonzero(~done):  # `G` says why it cannot be
            with at_row(int(i)):
                v[i] = self.G(many[i]) @ v[i, self.iv_independent]
        return v

    def assemblies(self, q: ArrayLike | Named | None = None, hold: Sequence[str] | None = None) -> Assemblies:
        """All ways to assemble the loops with some joints held: configurations apart from each other.

        Each loop cluster is closed from reproducible starts at random until every configuration was met
        several times; those of the clusters are combined. Angles are within half a turn of those of `q`.

        Parameters
        ----------
        q : array_like (nq,) or dict, optional
            Where the joints are held; home when left out.
        hold : sequence of str, optional
            Joints that keep their value; the independent ones when left out.

        Returns
        -------
        Assemblies
            `q` (N, nq), the nearest to the given one first; `complete`: whether each was met often enough
            that another is not to be expected (no proof); `inside` (N,): whether the joints are in their
            ranges; `starts`, how many were made.

        Raises
        ------
        OptionError
            Where the joints still move with these held.
        """
        held = self.velocities_named(self.independent if hold is None else joint_names(hold, "hold"))
        return assemblies(self, self.home if q is None else self.configuration(q, "q"), held)

    def impact(self, q: ArrayLike, v: ArrayLike, joints: Sequence[Part]) -> Impact:
        """The velocity after an impulse: v⁺ = v + G M_r⁻¹ Gᵀ Eᵀ P, by Newton's restitution.

        Stops that are closed at q and approached take part, and all locks, whatever their times; dry
        friction, which is bounded, has no impulse.

        Parameters
        ----------
        q, v : array_like (nq,), (nv,)
            A closed configuration, and a velocity with K v = 0.
        joints : sequence of Stop, JointFriction, Lock
            As for `simulate`.

        Returns
        -------
        Impact
            `v` (nv,), `impulses` by name, N m s or N s, `loss`, J.

        Raises
        ------
        StateError
            For loops that are open, a velocity that breaks them, a configuration beyond a stop.
        SimulationError
            Where stops and locks contradict each other, or at a singular configuration whose mode v does
            not tell.
        """
        from ..simulation.phases.impact import impact

        return impact(self, q, v, joints)

    def sense(
        self,
        name: str,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        tau: Any = None,
        t: float = 0.0,
        ctrl: Any = None,
    ) -> Array:
        """What a sensor of the mechanism's file reads at a state; numbers and signs are MJCF's.

        Parameters
        ----------
        name : str
            One of `sensors`.
        q, v : array_like (nq,), (nv,)
            At rest where v is left out.
        a : array_like (nv,), optional
            Left out: that of the motion under `tau`, for sensors that depend on it; q is closed then.
        tau : optional
            Torques as in `simulate`, besides the mechanism's own forces.
        t : float
            s.
        ctrl : mapping of str or array_like (n,), optional
            Controls of the actuators as numbers; of one with an activation that activation. Without it they
            have no power.

        Returns
        -------
        ndarray (dim,)

        Raises
        ------
        ModelError
            For a sensor that there is not.
        OptionError
            For forces of limits, which are those of stops along a run.
        StateError, SimulationError
            Where an acceleration is asked for, as `simulate` does for a start.
        """
        from ..simulation.trajectories.sensing import sense

        return sense(self, name, q, v, a, tau, t, ctrl)  # type: ignore[arg-type]


def joint_names(names: Any, what: str) -> tuple[str, ...]:
    """Joint names that were given as a list."""
    return tuple(listed(names, what, "joint names"))
