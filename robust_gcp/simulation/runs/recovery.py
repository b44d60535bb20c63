"""What a run of fixed steps does at the rare places where it cannot simply go on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...dynamics.prescribed.drive import Drive
from ...errors import SimulationError, ToggleError
from ...maps.cluster.obstacles import ObstacleError
from ...maps.cluster.regular_ground import POOR
from ...maps.explicit import Point
from ...mechanism.tree.tree import Array


def add_remedy(error: Exception, drive: Drive | None, may_change: bool) -> None:
    """Add to a ToggleError, whose trajectory is known, what helps.

    Parameters
    ----------
    error : Exception
        Others are left as they are.
    drive : Drive or None
        A driven joint stays independent, so that no change of coordinates helps.
    may_change : bool
        Whether coordinates would be changed if `on_toggle` were left out.
    """
    if not isinstance(error, ToggleError) or error.trajectory is None:
        return
    run = error.trajectory
    if drive is not None and len(run.t):
        t, moving = float(run.t[-1]), " and ".join(drive.names)
        rates = zip(drive.names, drive.motion_at(t)[1].tolist(), strict=True)
        where = ", ".join(f"{name} = {run[name][-1]:.9g} at {rate:.3g} a second" for name, rate in rates)
        error.args = (
            f"{error}; the drive takes {moving} there after t = {t:.6g} s ({where}), and no motion of the "
            "others goes further: give a motion that turns before, or drive another joint that can",
        )
    elif drive is None and may_change:
        error.args = (
            f'{error} (or leave out on_toggle: by default, "repartition", coordinates are changed)',
        )


@dataclass(frozen=True)
class Checkpoint:
    """A well-conditioned state to return to: step, state and point."""

    i: int
    x: Array
    point: Point


GOOD = 0.8
"""Share of the best conditioning so far that is a good one, where none was above `POOR`."""

LEAST = 0.05
"""Conditioning below which none is."""


def good_from(best: Array) -> Array:
    """The conditioning from which outputs are good ones, of motions that came to `best`."""
    found: Array = np.where(best >= POOR, POOR, np.maximum(LEAST, GOOD * best))
    return found


class Recovery:
    """Remembers where it is safe to return to, and decides how to go on from there.

    In a zone without a certified bridge γ bends sharply, and a fixed step loses its accuracy before the
    zone is met. So the run goes back to the last well-conditioned state and takes the steps from there to
    the next well-conditioned one with error control (`error_controlled`), or changes coordinates as soon as
    others serve better (`changing`). Coordinates that are about to turn back are changed before
    (`Coordinates`); steps so long that they jump there end here.

    Parameters
    ----------
    on_toggle : {"error", "repartition"}
    safe : Checkpoint
        The start.

    Attributes
    ----------
    safe : Checkpoint
        The last well-conditioned state.
    best : float
        The largest conditioning of an output in the present coordinates, and in those before where error
        control goes on: links that are never conditioned above `POOR` are not taken with it all the way.
    error_controlled, changing : bool
    met_at : int
        Output on the way to which the last obstacle was met.
    """

    def __init__(self, on_toggle: str, safe: Checkpoint) -> None:
        self._may_change = on_toggle == "repartition"
        self.safe = safe
        self.best = safe.point.conditioning
        self.error_controlled = self.changing = False
        self.met_at = self._changed_at = -1

    def accept(self, i: int, x: Array, point: Point) -> None:
        """Take note of an output."""
        self.best = max(self.best, point.conditioning)
        good = bool(point.conditioning >= good_from(np.asarray(self.best)))
        # outputs are good again from the checkpoint on: what counts is that the obstacle lies behind
        self.error_controlled = self.error_controlled and not (good and i > self.met_at)
        self.changing = self.changing and self.error_controlled
        if good and not self.error_controlled:
            self.safe = Checkpoint(i, x, point)

    def meet(self, i: int, stop: SimulationError) -> bool:
        """Decide what to do about an obstacle met on the way to output i, from the checkpoint.

        Returns
        -------
        bool
            Whether to change coordinates there; else the run goes on carefully.

        Raises
        ------
        SimulationError
            `stop` itself, where neither helps.
        """
        # met with error control already, the same obstacle is one of the coordinates, or ends the run
        if isinstance(stop, ObstacleError) and not (self.error_controlled and i <= self.met_at):
            self.met_at, self.error_controlled = i, True
            self.changing = stop.obstacle.kind == "toggle" and self._may_change
            return False
        # the true curve is lost in these coordinates; others may hold it
        known = self.changing or not isinstance(stop, ToggleError)  # else told only now what it is
        # coordinates that were changed at this checkpoint did not help: without end otherwise
        if not self.error_controlled or not self._may_change or (known and self.safe.i <= self._changed_at):
            raise stop
        self.error_controlled, self.changing = True, not known
        return known

    def shift(self, n: int) -> None:
        """The numbers of all outputs are smaller by n from now on."""
        self.safe = replace(self.safe, i=self.safe.i - n)
        self.met_at, self._changed_at = self.met_at - n, self._changed_at - n

    def renewed(self, safe: Checkpoint) -> None:
        """With error control on the way, within a step too, it goes on in other coordinates."""
        self.safe, self.best = safe, max(self.best, safe.point.conditioning)

    def through(self, safe: Checkpoint) -> None:
        """Steps of the kernel's came to a well-conditioned state, with error control or without."""
        self.safe = safe
        self.error_controlled = self.changing = False

    def changed(self, safe: Checkpoint) -> None:
        """Go on in other coordinates from here.

        With error control, where it is on the way already and these are poorly conditioned too.
        """
        on_the_way = self.error_controlled and not self.changing
        # one step of RK4 between, in coordinates that are poor too, erred by 5e-5
        self.error_controlled = on_the_way and safe.point.conditioning < POOR
        if not self.error_controlled:
            self.best = 0.0  # what was good in the coordinates before is nothing here
        self.renewed(safe)
        self._changed_at, self.changing = safe.i, False
