"""What a simulation that is saved hands out: a state that leads back that simulation and no other."""

from __future__ import annotations

import weakref
from typing import Any, NoReturn

from ..errors import OptionError


class SavedState:
    """What `Simulation.save` returned; it leads that simulation back, as often as one likes.

    Parameters
    ----------
    simulation : Simulation
    parts : dict
        What its steps change, in whose midst are parts of its run that they do not: so no other run can go on
        from there.
    """

    __slots__ = ("_of", "_parts", "_told")

    def __init__(self, simulation: object, parts: dict[str, Any]) -> None:
        self._of, self._parts, self._told = weakref.ref(simulation), parts, repr(simulation)

    def parts_of(self, simulation: object) -> dict[str, Any]:
        """The parts, for the simulation that they were copied from.

        Raises
        ------
        OptionError
            For another one.
        """
        if self._of() is not simulation:
            raise OptionError(
                f"state was saved by another simulation ({self._told}), and leads back that one alone, not "
                f"{simulation!r}; for another one from there: Simulation(mechanism, q, v, t0=t)"
            )
        return self._parts

    def __deepcopy__(self, memo: Any) -> SavedState:
        return self  # nothing changes it

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        raise OptionError(
            f"the saved state of a simulation ({self._told}) leads back the one that gave it and cannot be "
            "pickled; keep q, v and t, or the motion with trajectory.save(path)"
        )

    def __repr__(self) -> str:
        return f"state saved by {self._told}"
