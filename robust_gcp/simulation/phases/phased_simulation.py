"""A `Simulation` with stops, friction and locks: phase by phase under held torques."""

from __future__ import annotations

import copy
import time
from typing import TYPE_CHECKING, Any

from ...mechanism.tree.tree import Array
from ..current_state import Here
from .course import Phases
from .grid import Chosen, Grid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...dynamics.prescribed.zero_order_hold import HeldTorque
    from ...mechanism.parts import Part
    from ..runs.course import Course
    from ..runs.schedule import Keep
    from ..trajectories.trajectory import Trajectory


class PhasedRun(Phases):
    """What `SteppedRun` is to a motion without phases.

    The first phase waits for the first torque: what is held depends on it. What is told before is under none.

    Parameters
    ----------
    held : HeldTorque
    t0 : float
        s.
    keep : Keep
    course, parts, start, kernel, required
        As of `Progress`; the course's schedule is not looked at.
    """

    independent: tuple[str, ...] = ()
    """None are told: each phase looks for its own."""

    def __init__(
        self, course: Course, parts: Sequence[Part], held: HeldTorque, start: tuple[Any, Any, Any], t0: float,
        keep: Keep, kernel: Any, required: bool,
    ) -> None:  # fmt: skip
        chosen = Chosen(Grid(t0, course.step), None, keep)
        super().__init__(course, parts, start, held, kernel, required, chosen)
        self._at: float = 0
        self._first: tuple[dict[str, Array], Trajectory] | None = None

    def begin(self) -> None:
        """Look at the start."""
        begun, before = time.perf_counter(), self.copied()
        self.advance(self._grid.t0)
        first = self.last, self.trajectory(begun)
        self.put_back(before)
        self._first = first

    def take(self, torque: Array, n: int) -> None:
        """n steps under a torque (nv,) that is held."""
        self.hold(torque)
        self._first = None
        self._at += n
        try:
            self.advance(self._grid.number(self._at))
        except BaseException:
            self._at = (float(self.last["t"]) - self._grid.t0) / self._grid.step  # where it stopped
            raise
        self.passed.turns.clear()  # nobody takes the steps of a simulation again

    def room_for(self, n: int, step: float) -> None:
        """There always is."""

    @property
    def last(self) -> dict[str, Array]:
        """The last row of the record."""
        return super().last if self._first is None else self._first[0]

    @property
    def here(self) -> Here:
        """Where it is."""
        last = self.last
        forces = self.joined.rows.by_column(last["forces"][None])
        more = {name: values[0] for name, values in forces.items()}
        more |= {"dissipated": self.dissipated, "work": last["work"] + last["smooth"]}
        drive = None if self.joined.rows.drive is None else last["drive"]
        return Here(last["q"], last["v"], last["a"], last["tau"], drive, more)

    @property
    def state(self) -> tuple[Array, Array]:
        """q and v."""
        return super().state if self._first is None else (self._first[0]["q"], self._first[0]["v"])

    @property
    def time(self) -> float:
        """s."""
        return float(self.last["t"]) if self.ended else self._grid.number(self._at)

    def trajectory(self, begun: float) -> Trajectory:
        """What is recorded so far."""
        return super().trajectory(begun) if self._first is None else copy.copy(self._first[1])

    def copied(self) -> dict[str, Any]:
        """All that steps change."""
        return super().copied() | {"at": self._at, "first": self._first}

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these were copied."""
        super().put_back(parts)
        self._at, self._first = parts["at"], parts["first"]
