"""A run under functions that are asked once a step, as a digital controller is."""

from __future__ import annotations

from .stepped import SteppedRun


class HeldRun(SteppedRun):
    """A run that asks a function for the torque at the start of each step, and holds it over the step."""

    def go(self) -> None:
        """Step by step; steps that are taken once more have the torque that they had."""
        ask, motion = self._held.asked, self._motion
        assert ask is not None  # `HeldTorque.of` gave it
        start, times = motion.start, self.times.tolist()
        first = ask(times[0], start.point.q, start.point.G.dot(start.ydot))
        self._held.value, self._torques, self._bits = first, [first], first.tobytes()
        self._first = None  # under no torque
        self.begin()
        self.take(first, 1)
        for t in times[1:-1]:
            if self._ended:
                break
            self.take(ask(t, *self.state), 1)
        self.settle()
