"""A `Simulation` with stops, friction and locks: phase by phase under held torques."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...maps.start_check import checked_state, require_freedom
from ...mechanism.tree.tree import Array
from ..current_state import Here
from ..runs.crossings import together
from .course import Phases
from .grid import Chosen, Grid
from .happening import Happening
from .machine import Machines
from .rows import Rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ...dynamics.prescribed.zero_order_hold import HeldTorque
    from ...maps.explicit import Crossing
    from ...mechanism.parts import Part
    from ..events import Events
    from ..runs.course import Course
    from ..runs.schedule import Keep
    from ..trajectories.trajectory import Trajectory


class PhasedRun:
    """What `SteppedRun` is to a motion without phases.

    The first phase waits for the first torque: what is held depends on it. What is told before is under none.

    Parameters
    ----------
    course : Course
        Of its steps; its schedule is not looked at.
    parts : sequence of Stop, JointFriction, Lock
    held : HeldTorque
    start : (q0, v0, mode)
    t0 : float
        s.
    keep : Keep
    kernel, required
        As `Course.run` takes them.
    """

    def __init__(
        self, course: Course, parts: Sequence[Part], held: HeldTorque, start: tuple[Any, Any, Any], t0: float,
        keep: Keep, kernel: Any, required: bool,
    ) -> None:  # fmt: skip
        mechanism = self.mechanism = course.mechanism
        self._grid, self._held, self._acted, self._at = Grid(t0, course.step), held, course.acted, 0
        q0, v0, mode = start
        require_freedom(mechanism)
        state = checked_state(mechanism, mechanism.home if q0 is None else q0, v0)
        machines = Machines(Rows(mechanism, parts), course, held, kernel, required, mode)
        chosen = Chosen(t0, course.step, None, keep)
        self._phases = Phases(machines, self._grid, chosen, state, course.events)
        self._first: tuple[dict[str, Array], Trajectory] | None = None

    def begin(self) -> None:
        """Look at the start."""
        before = self._phases.saved()
        self._phases.advance(self._grid.t0)
        self._first = self._phases.last, self._phases.trajectory()
        self._phases.put_back(before)

    def take(self, torque: Array, n: int) -> None:
        """n steps under a torque (nv,) that is held."""
        self._phases.hold(torque)
        self._first = None
        self._at += n
        self._phases.advance(self._grid.number(self._at))

    def room_for(self, n: int, clock: Callable[[int, int], Array]) -> None:
        """There always is."""

    @property
    def last(self) -> dict[str, Array]:
        """The last row of the record."""
        return self._phases.last if self._first is None else self._first[0]

    @property
    def here(self) -> Here:
        """Where it is."""
        last, phases = self.last, self._phases
        forces = phases.joined.rows.by_column(last["forces"][None])
        more = {name: values[0] for name, values in forces.items()} | {"dissipated": phases.dissipated}
        return Here(last["q"], last["v"], last["a"], last["tau"], None, more)

    @property
    def state(self) -> tuple[Array, Array]:
        """q and v."""
        if self._first is None:
            return self._phases.state
        return self._first[0]["q"], self._first[0]["v"]

    @property
    def time(self) -> float:
        """s."""
        return float(self.last["t"]) if self.ended else self._grid.number(self._at)

    @property
    def ended(self) -> bool:
        """Whether an event of the user's ended it."""
        return self._phases.ended

    @property
    def events(self) -> Events:
        """The user's."""
        return self._phases.events

    @property
    def happenings(self) -> list[Happening]:
        """What happened so far."""
        return list(self._phases.joined.happenings)

    @property
    def dissipated(self) -> float:
        """Energy lost so far, J."""
        return self._phases.dissipated

    @property
    def crossings(self) -> list[Crossing]:
        """Singular places passed so far."""
        return together(self._phases.crossings)

    @property
    def toward(self) -> Array:
        """Velocity when it last moved, (nv,)."""
        return self._phases.toward

    def trajectory(self, begun: float) -> Trajectory:
        """What is recorded so far."""
        run = self._phases.trajectory() if self._first is None else self._first[1]
        run.acted = self._acted
        return run

    def copied(self) -> dict[str, Any]:
        """All that steps change."""
        return {"phases": self._phases.saved(), "at": self._at, "first": self._first}

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these were copied."""
        self._phases.put_back(parts["phases"])
        self._at, self._first = parts["at"], parts["first"]

    @property
    def independent(self) -> tuple[str, ...]:
        """None are told: each phase looks for its own."""
        return ()

    def remembered(self) -> Any:
        """What another simulation with the same parts goes on from, besides the state."""
        return self._phases.remembered()

    def recall(self, phase: Any) -> None:
        """Go on from what a simulation with the same parts remembered."""
        self._phases.recall(phase)
