"""To a cusp of the mode, and round it onto its other branch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...errors import CuspError
from .happening import Happening
from .progress import Progress

if TYPE_CHECKING:
    from ..runs.cusp import Part

MOST = 4096
"""Outputs of a part of a cusp's arc."""


class RoundCusps(Progress):
    """A motion that ends in cusps, or turns there where it is asked to."""

    def _stop_at_event(self) -> None:
        raise NotImplementedError

    @property
    def _free(self) -> bool:
        """Whether there are no stops, friction or locks, which the arc of a cusp knows nothing of."""
        return not self._rows.rows

    def _round(self, fault: CuspError) -> None:
        """To a cusp, and back from it on the other branch, v⁺ = −e v⁻, as far as its arc goes.

        Raises
        ------
        CuspError
            At the cusp, where no e is given; here, where the motion is not followed there.
        """
        if fault.arrival is None or not self._free:
            raise fault
        arc, part = fault.arrival
        e, end = self._machines.course.restitution, self._grid.end
        self._keep(part.steps(np.array([self._t])), np.zeros((1, len(self._rows.rows))))
        while self._along(part):
            if e is None:
                raise fault
            loss = (1.0 - e**2) * self._rows.mechanism.tree.kinetic(self._q, self._v)
            self.joined.happenings.append(Happening(self._t, "cusp", fault.joints, float(loss)))
            part = arc.part(self._t, 0.0, -e * part.eta, end, -part.branch)
            self._keep(part.steps(np.array([self._t])), np.zeros((1, len(self._rows.rows))))

    def _along(self, part: Part) -> bool:
        """Along a part of a cusp's arc; whether it ends at the cusp."""
        since, slack = self._t, self._grid.slack
        times = np.union1d(self._grid.after(since, MOST), self.joined.chosen.between(since, part.t1))
        times = times[(since < times) & (times < part.t1 - slack)]
        # at the cusp itself the acceleration is infinite
        times = np.array([since, *times, np.nextafter(part.t1, -np.inf) if part.ends == "cusp" else part.t1])
        zero = part.ended(self._events, times) if self._events else None
        if zero is not None:
            times = np.append(times[times < zero], zero)
        steps = part.steps(times)
        held = np.zeros((len(times), len(self._rows.rows)))
        self.joined.add(self._stretch.block(steps, held), self._phase, first=1)
        self._arrive(steps)
        self._t = part.t1 if zero is None else zero
        if zero is not None:
            self._stop_at_event()
            return False
        self._fresh = self._t < self._grid.end - slack
        return bool(part.ends == "cusp")
