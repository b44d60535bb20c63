"""Equations of motion where some independent joints move as prescribed, and what that takes.

With y = (d, f), d(t) known and f free, G = [G_d, G_f]: the rows of Eq. (3) that belong to f give

    G_fᵀ M G_f f̈ = G_fᵀ (τ − C − M (g + G_d d̈)),

and those that belong to d the generalized forces on the driven joints, by inverse dynamics,

    τ_d = G_dᵀ (M (G ÿ + g) + C − τ).

Where all independent joints are driven nothing is left to integrate but the work.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import OptionError, SimulationError, StateError
from ...maps.choice import MapChoice
from ...maps.explicit import ExplicitMap, Point
from ...maps.grouped_start import initial_point_of_motion
from ...mechanism.coordinates.groups import coordinate_choices
from ...mechanism.coordinates.partition import spelled
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..equations import EquationsOfMotion, Evaluation, Torque
from .drive import Drive, checked_motions
from .motion import Motion

if TYPE_CHECKING:
    from ...maps.explicit import Counters

log = logging.getLogger(__name__)

STRIDE = 0.02
"""Steps in which home is led to where a drive begins, rad or lengths."""

MEETS = 1e-6
"""How far a given start may be from where its drive begins, rad or lengths, and relative for velocities."""


class DrivenEquations(EquationsOfMotion):
    """Eq. (3) with prescribed motions of some independent joints.

    Of the state (y, ẏ, W) the driven entries are replaced by what is prescribed at each evaluation, so that
    they are exact; a stepper integrates along with them what it is to know nothing of.

    Parameters
    ----------
    mechanism, explicit, torque
        As in `EquationsOfMotion`.
    drive : Drive

    Attributes
    ----------
    columns : ndarray of int
        Where the driven joints' velocities are in v.
    """

    def __init__(
        self, mechanism: Mechanism, explicit: ExplicitMap, torque: Torque | ArrayLike | None, drive: Drive
    ) -> None:
        super().__init__(mechanism, explicit, torque)
        self.works, self.driven = True, True
        self._drive = drive
        self.columns = mechanism.iv_independent[drive.driven]

    def evaluate(self, t: float, x: Array) -> Evaluation:
        """Point, velocity, ÿ and the torques on the driven joints at time t."""
        m, driven = self.m, self._drive.driven
        y, ydot = x[:m].copy(), x[m : 2 * m].copy()
        y[driven], ydot[driven], ydd = self._drive.motion_at(t)  # whatever a stepper made of these
        return self._driven_at(t, self.explicit.point_at(y, ydot), ydd)

    def at_point(self, t: float, point: Point) -> Evaluation:
        """The same at a point that is known, which moves as prescribed."""
        return self._driven_at(t, point, self._drive.motion_at(t)[2])

    def _driven_at(self, t: float, point: Point, prescribed: Array) -> Evaluation:
        tree, driven, free = self.mechanism.tree, self._drive.driven, self._drive.free
        q, G, ydot, ydd = point.q, point.G, point.ydot, np.empty(self.m)
        ydd[driven] = prescribed
        v = G.dot(ydot)
        tau, power = self._act(t, q, v)
        tau = np.zeros(self.mechanism.nv) if tau is None else tau.copy()
        if len(free):
            G_free = G[:, free]
            force = tau - tree.rnea(q, v, point.g + G[:, driven].dot(ydd[driven]))
            ydd[free] = self._inertia.solve(q, G_free, G_free.T.dot(force))
        effort = G[:, driven].T.dot(tree.rnea(q, v, G.dot(ydd) + point.g) - tau)
        self.explicit.counters.rhs += 1
        tau[self.columns] += effort  # rows of G_d that are the identity: Gᵀ τ has it there
        kept = np.full(self.mechanism.nv, np.nan)
        kept[self.columns] = effort
        return Evaluation(point, v, ydd, tau, power + float(effort @ ydot[driven]), kept)


def prescribed(
    mechanism: Mechanism, drive: Any, q0: ArrayLike | None, times: Array
) -> tuple[Mechanism, Drive | None]:
    """The mechanism in coordinates that include the driven joints, and their motions from times[0] on.

    The mechanism as it is, and None, where `drive` is None and the ground does not move. Joints that move the
    ground hold still where `drive` has none for them.

    Raises
    ------
    OptionError
        As `checked_motions` and `driving` do.
    """
    if mechanism.moved and (drive is None or isinstance(drive, Mapping)):
        drive = {**_still(mechanism, q0), **(drive or {})}
    if drive is None:
        return mechanism, None
    motions = checked_motions(mechanism, drive, times)
    mechanism = driving(mechanism, tuple(motions), mechanism.home if q0 is None else q0)
    return mechanism, Drive(mechanism, motions, float(times[0]))


def _still(mechanism: Mechanism, q0: ArrayLike | None) -> dict[str, Motion]:
    """Joints that move the ground, held where they are."""
    q = mechanism.configuration(mechanism.home if q0 is None else q0)
    return {name: Motion(float(q[mechanism.joint(name).idx_q])) for name in mechanism.moved}


def driving(mechanism: Mechanism, names: tuple[str, ...], q: ArrayLike) -> Mechanism:
    """The mechanism in coordinates that include the driven joints; the same where its own do.

    Raises
    ------
    OptionError
        Where none do at q, with sets that would serve.
    """
    missing = [name for name in names if name not in mechanism.independent]
    if not missing:
        return mechanism
    choices = [
        c
        for c in coordinate_choices(mechanism, mechanism.configuration(q))
        if len(mechanism.velocities_named(c)) == mechanism.m
    ]
    fits = [c for c in choices if set(names) <= set(c)]
    if not fits:
        also = f"; sets that can be independent: {spelled(choices)}" if choices else ""
        raise OptionError(
            f"drive: {', '.join(names)} cannot be driven together here: no {mechanism.m} independent joints "
            f"include them{also}; drive others, or start elsewhere (q0)"
        )
    log.info("%s: independent joints %s, for the drive", mechanism.name, ", ".join(fits[0]))
    return mechanism.with_independent(fits[0])


def driven_start(
    mechanism: Mechanism,
    drive: Drive,
    q0: ArrayLike | None,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    choice: MapChoice,
    counters: Counters,
) -> Array:
    """A start (nq,) where the drive begins: home led there along its mode, or q0 and v0 checked.

    Raises
    ------
    StateError
        Where q0 or v0 disagree with the drive.
    OptionError
        Where home cannot be led there.
    """
    position, velocity, _ = drive.motion_at(drive.start)
    unit = mechanism.units[mechanism.iv_independent[drive.driven]]
    if v0 is not None:
        given = mechanism.velocity(v0, "v0")[mechanism.iv_independent[drive.driven]]
        _require_meeting(drive.names, given, velocity, unit + np.abs(velocity), "v0", "velocity")
    if q0 is not None:
        q = mechanism.configuration(q0, "q0")
        given = q[_places(mechanism, drive)]
        _require_meeting(drive.names, given, position, unit, "q0", "position")
        return q
    q = mechanism.home
    gap = position - q[_places(mechanism, drive)]
    count = int(np.ceil(np.max(np.abs(gap) / unit, initial=0.0) / STRIDE))
    if count == 0:
        return q
    try:
        start = initial_point_of_motion(mechanism, q, None, mode, choice.options, counters)
        explicit, end = choice.over(start), start.point.y.copy()
        end[drive.driven] = position
        # In short strides, so that the mode is followed: in one the drive might begin on another.
        for share in np.arange(1, count + 1) / count:
            # at a velocity, so that the next prediction has γ'' along the way too
            pace = (end - start.point.y) * (STRIDE / max(float(np.abs(gap / unit).max()), STRIDE))
            point = explicit.point_at(start.point.y + share * (end - start.point.y), pace)
        return point.q
    except SimulationError as error:
        raise OptionError(
            f"drive: home has {', '.join(drive.names)} at {q[_places(mechanism, drive)]} and cannot be led "
            f"to where the drive begins, {position}: {error}; give q0, closed, with the driven joints there"
        ) from error


def _places(mechanism: Mechanism, drive: Drive) -> list[int]:
    """Where the driven joints' numbers are in q."""
    return [mechanism.joint(name).idx_q for name in drive.names]


def _require_meeting(
    names: tuple[str, ...], given: Array, wanted: Array, scale: Array, what: str, kind: str
) -> None:
    off = np.abs(given - wanted) / scale
    worst = int(np.argmax(off))
    if not off[worst] <= MEETS:
        raise StateError(
            f"{what}: {names[worst]!r} has {given[worst]:.9g}, and its drive begins with the {kind} "
            f"{wanted[worst]:.9g}; leave {what} out, or make them agree"
        )
