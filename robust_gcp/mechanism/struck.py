"""Impulses on a mechanism, by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from .coordinates import Coordinates

if TYPE_CHECKING:
    from ..simulation.phases.impact import Impact
    from ..simulation.phases.parts import Part


class Struck(Coordinates):
    """`Coordinates` that stops and locks may strike."""

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
