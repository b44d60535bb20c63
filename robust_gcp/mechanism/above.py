"""What a mechanism does by rooms that stand above it: impulses by themselves, files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from .coordinates import Coordinates

if TYPE_CHECKING:
    from ..simulation.phases.impact import Impact
    from ..simulation.phases.parts import Part


class Above(Coordinates):
    """`Coordinates` that are struck by stops and locks, and written to files."""

    def write(self, path: str | Path) -> Path:
        """Write it as a file that `load` reads back with the same motion, by the path's suffix.

        - `.xml`, `.mjcf`: MJCF, with `connect`, `weld`, `joint` and `tendon` equalities, springs, dampers,
          armature, ranges, constant torques, motors, and home as a keyframe;
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
