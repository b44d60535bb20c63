"""The first point of a motion with joints on groups: that of the rest, and a chart about q0."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..mechanism.constraint.rank import opening
from ..mechanism.coordinates.groups import Groups, groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .cluster.options import BridgeOptions
from .explicit import Counters
from .grouped import GroupPoint, joined
from .start import Start, initial_point
from .start_check import broken_by, by_number, checked_mode, require_finite_energy


@dataclass
class GroupStart(Start):
    """The start of a mechanism with joints on groups.

    Attributes
    ----------
    groups : Groups
    rest : Start
        Of the mechanism without them.
    """

    point: GroupPoint
    groups: Groups = field(kw_only=True)
    rest: Start = field(kw_only=True)

    @property
    def mechanism(self) -> Mechanism:
        """The whole."""
        return self.groups.mechanism

    def afresh(self) -> GroupStart:
        """See `Start.afresh`."""
        return start_on_groups(self.groups, self.rest.afresh(), self.point)


def initial_point_of_motion(
    mechanism: Mechanism,
    q0: ArrayLike,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    options: BridgeOptions,
    counters: Counters,
) -> Start:
    """`start.initial_point` for any mechanism, with joints on groups or without."""
    groups = groups_of(mechanism)
    if groups is None:
        return initial_point(mechanism, q0, v0, mode, options, counters)
    q = mechanism.configuration(q0, "q0")
    v = mechanism.tree.zero if v0 is None else mechanism.velocity(v0, "v0")
    require_finite_energy(mechanism, v)  # of the whole: what carries the loops has its share
    mode = by_number(mechanism, q, mode)  # the rest would number its own modes
    own = None if mode is None else _of_rest(groups, checked_mode(mechanism, mode))
    rest = initial_point(
        groups.rest, q[groups.rest_iq], _velocities_of_rest(groups, q, v), own, options, counters
    )
    y = np.zeros(mechanism.m)
    y[groups.rest_inputs] = rest.point.y
    point = joined(groups, rest.point, q[groups.iq], y, v[mechanism.iv_independent])
    return start_on_groups(groups, rest, point)


def _velocities_of_rest(groups: Groups, q: Array, v: Array) -> Array:
    """Those in loops; without what breaks these, where that is rounding of all velocities together."""
    rest, own, at = groups.rest, v[groups.rest_iv], q[groups.rest_iq]
    if broken_by(rest, at, own) is None or broken_by(groups.mechanism, q, v) is not None:
        return own
    own = own - opening(rest, at, own)
    return own if broken_by(rest, at, own) is None else np.zeros(len(own))


def start_on_groups(groups: Groups, rest: Start, first: GroupPoint) -> GroupStart:
    """The start of the whole from that of the rest and the first point, both checked."""
    return GroupStart(rest.path, first, first.ydot, rest.trackers, groups=groups, rest=rest)


def _of_rest(groups: Groups, mode: Array) -> Array:
    """The tangent of a mode (nv, m) without the joints on groups: the span of their other rows."""
    # of a floating base's m columns some move nothing of the rest: its m largest left vectors are the span
    U = np.linalg.svd(mode[groups.rest_iv] / groups.rest.column_scale[:, None])[0]
    tangent: Array = groups.rest.column_scale[:, None] * U[:, : groups.rest.m]
    return tangent
