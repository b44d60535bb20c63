"""What a simulation that is saved hands out: a state that leads back, and its numbers where it is pickled."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ..errors import OptionError
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array

if TYPE_CHECKING:
    from typing import TypeAlias

    from .phases.phased_simulation import PhasedRun
    from .runs.stepped import SteppedRun

    Run: TypeAlias = SteppedRun | PhasedRun


@dataclass(frozen=True, eq=False)
class StartState:
    """Where a motion can begin: what pickling leaves of a saved state.

    Attributes
    ----------
    joints : tuple of str
        Names of the mechanism's joints.
    t : float
        s.
    q, v : ndarray (nq,), (nv,)
    mode : ndarray (nv, m) or (nv,)
        Tangent of the mode there.
    driven : (ndarray (n,), ndarray (n,)) or None
        Controls and activations of the actuators; None without power.
    phase : object, optional
        What stops, friction and locks do there.
    independent : tuple of str
        The joints that were independent there; those of the simulation where none are told.
    """

    joints: tuple[str, ...]
    t: float
    q: Array
    v: Array
    mode: Array
    driven: tuple[Array, Array] | None = None
    phase: Any = None
    independent: tuple[str, ...] = ()


class SavedState:
    """What `Simulation.save` returned; it leads that simulation back to the last bit, as often as one likes.

    Pickled, it is a `StartState`: any simulation of such a mechanism goes on from there, equal to rounding.

    Parameters
    ----------
    simulation : Simulation
    run : SteppedRun or PhasedRun
        That it was on, which alone can go on from there: its grid of times, stops and maps are not saved.
    start : StartState
    """

    __slots__ = ("_of", "_parts", "_run", "_start", "_told")

    def __init__(self, simulation: object, run: Run, start: StartState) -> None:
        self._of, self._told = weakref.ref(simulation), repr(simulation)  # states keep no simulation
        self._run, self._parts, self._start = run, run.copied(), start

    def run_of(self, simulation: object) -> Run:
        """The run, back where it was, for the simulation that was on it.

        Raises
        ------
        OptionError
            For another one.
        """
        if self._of() is not simulation:
            raise OptionError(
                f"state was saved by another simulation ({self._told}), and leads back that one alone, not "
                f"{simulation!r}; for another one from there: Simulation(mechanism, q, v, t0=t), or "
                "restore(pickle.loads(pickle.dumps(state)))"
            )
        self._run.put_back(self._parts)
        return self._run

    def __deepcopy__(self, memo: Any) -> SavedState:
        return self  # nothing changes it

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        start = self._start
        return StartState, tuple(getattr(start, field.name) for field in fields(start))

    def __repr__(self) -> str:
        return f"state saved by {self._told}"


def unchanging(mechanism: Mechanism) -> list[Any]:
    """A mechanism and what its maps hold of it."""
    loops = [cluster.loops for cluster in mechanism.clusters]
    trees = [each.tree for each in (mechanism, *loops)]
    applied = [] if mechanism.applied is None else [mechanism.applied]
    groups = groups_of(mechanism)
    apart = [] if groups is None else [groups, *unchanging(groups.rest)]
    return [mechanism, mechanism.clusters, *mechanism.clusters, *loops, *trees, *applied, *apart]
