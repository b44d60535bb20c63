"""The first point of a motion: a checked state, and at a singular configuration the chosen mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.local import LocalAnalysis, analyse
from ..errors import NotCertifiedError, OptionError, SingularStartError, ToggleError
from ..mechanism.coordinates.partition import spelled
from ..mechanism.mechanism import Mechanism
from ..mechanism.tolerances import DETERMINES, SAME_MODE, SINGULAR_START
from ..mechanism.tree.joints import in_v
from ..mechanism.tree.tree import Array
from .charted_path import regular_path
from .cluster.chart import CHANGE, best, smallest
from .cluster.cluster_map import ClusterMap
from .cluster.known_curves import KnownCurves
from .cluster.leaving import tracker_on_mode
from .cluster.options import BridgeOptions, NoBridgeError
from .cluster.space import space_of
from .cluster.touching.contact import Contact, contact_at
from .cluster.tracker import Tracker
from .explicit import Counters, Point
from .regular_path import RegularPath
from .start_check import (
    apart,
    checked_mode,
    checked_state,
    numbered,
    require_lasting_mobility,
    require_mobility,
    require_mode,
    require_velocity_in_mode,
)

NEARLY_PARALLEL = 0.05
"""Sine of the angle between modes below which they are looked at beyond second order."""


@dataclass
class Start:
    """Where and how a motion begins.

    Attributes
    ----------
    path : RegularPath
    point : Point
    ydot : ndarray (m,)
    trackers : mapping of int to Tracker
        Of the clusters that are singular at the start, on their mode.
    """

    path: RegularPath
    point: Point
    ydot: Array
    trackers: Mapping[int, Tracker] = field(default_factory=dict)

    @property
    def mechanism(self) -> Mechanism:
        """Whose start it is."""
        return self.path.mechanism

    def afresh(self) -> Start:
        """The same at a regular place, with a path of its own, so that nothing is counted or moved."""
        path = type(self.path)(self.path.mechanism, self.path.rows, Counters())
        return Start(path, self.point, self.ydot)


def initial_point(
    mechanism: Mechanism,
    q0: ArrayLike,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    options: BridgeOptions,
    counters: Counters,
) -> Start:
    """Check the start and put it on a mode.

    Parameters
    ----------
    q0, v0 : array_like (nq,), (nv,)
        q0 must close the loops to 1e-6 lengths and is polished; v0 must satisfy K v0 = 0.
    mode : array_like (nv,) or (nv, m), or int, optional
        Tangent of the mode to take where several meet (`analyse(...).modes[i]`), or its number i.

    Raises
    ------
    StateError, ClosureError
        For a start that is no state of the mechanism.
    SingularStartError
        When several modes meet at q0 and neither `mode` nor v0 picks one.
    ToggleError, NotCertifiedError
        When the independent joints, or second order, cannot describe the motion from here.
    """
    q, v = checked_state(mechanism, q0, v0)
    ydot = v[mechanism.iv_independent]
    y = mechanism.y_about(q)
    path = regular_path(mechanism, mechanism.select_rows(mechanism.K(q)), counters)
    if path.nd == 0 or path.worst_conditioning(q) > SINGULAR_START:
        point = path.derivatives(path.closed_at(q), y, ydot)
        require_mobility(mechanism, q, path)
        require_mode(mechanism, mode, point.G)
        require_velocity_in_mode(mechanism, v, point.G)
        require_lasting_mobility(path, point)
        return Start(path, point, ydot)
    # K itself must count as singular where K_d did: a start between the two tolerances would be told a toggle
    picture = analyse(mechanism, q, rank_tolerance=10.0 * SINGULAR_START)
    counters.second_order += 1
    counters.svds += 1
    if picture.kind == "regular" or picture.kind == "redundant":
        choices = [names for _, names in mechanism.coordinate_choices(q)]
        raise ToggleError(
            f"start at a toggle: K_d is singular at q0 (conditioning {path.worst_conditioning(q):.1g}) while "
            f"K is not, so {', '.join(mechanism.independent)} cannot parametrise the motion here; joints "
            "that can: " + spelled(choices),
            y,
            choices,
        )
    if not picture.modes or picture.kind == "cusp":  # the motion would begin where it ends
        raise NotCertifiedError(f"start at a singularity: {picture.message}", y)
    contact = contact_at(mechanism, q, 10.0 * SINGULAR_START) if _touching(mechanism, picture) else None
    number, tangent = _beside_place(contact, picture, options) or _picked(mechanism, picture, v, mode)
    if tangent.shape[1] != mechanism.m:
        raise NotCertifiedError(
            f"start at a singularity: the mode has dimension {tangent.shape[1]}, not {mechanism.m} as the "
            "motion to either side",
            y,
        )
    G = _parametrised(mechanism, tangent, y)
    require_velocity_in_mode(mechanism, v, G)
    blocks = np.zeros(len(path.blocks))
    curvature = np.zeros(mechanism.nv) if mechanism.m == 1 else None
    point = path.renewed(Point(y, ydot, q, G, np.zeros(mechanism.nv), curvature, blocks, blocks, 0.0))
    _require_serving(mechanism, tangent, G, y)
    trackers = None if contact is None else _in_contact(contact, number, G, options, counters)
    if trackers is None:
        trackers = _beside(mechanism, q, G, options, counters)
    # from the bridge: G to rounding where the tangent is known to second order only, and g
    return Start(path, ClusterMap(path, point, options, trackers=trackers).point_at(y, ydot), ydot, trackers)


def _in_contact(
    contact: Contact, number: int, G: Array, options: BridgeOptions, counters: Counters
) -> dict[int, Tracker] | None:
    """A tracker at a place where modes touch, on the one of this number, by its cluster.

    Those that cross, at however small an angle, are told apart by their tangents: their numbers are those of
    second order. None where such a one is not told well enough this way.

    Raises
    ------
    NotCertifiedError
    """
    space, cluster = contact.space, contact.space.cluster
    try:
        if contact.found.kind != "inside":
            own = G[np.ix_(cluster.iv, cluster.inputs)][:, 0]
            number = contact.number(np.linalg.solve(space.turn(contact.x), own), number, options)
        curve = contact.mode(number, options)
    except NoBridgeError as failure:
        if contact.found.kind == "meets" and contact.found.order == 1:  # cross: their tangents serve
            return None
        raise NotCertifiedError(f"start where modes touch: {failure}") from failure
    u = curve.u(contact.x)
    counters.bridges_built += 1
    tracker = Tracker(curve.jet(space.chart(space.cluster.chosen), u), options, options.reach(1), counters)
    tracker.known, tracker.current, tracker.u = KnownCurves([curve]), curve, u
    return {cluster.index: tracker}


def _touching(mechanism: Mechanism, picture: LocalAnalysis) -> bool:
    """Whether modes touch at a place, or beside it, where they seem to cross at a small angle."""
    if picture.kind == "inside" or any(order > 1 for *_, order in picture.contacts):
        return True
    bases = [mode.reshape(mechanism.nv, -1) for mode in picture.modes]
    return any(apart(mechanism, a, b) < NEARLY_PARALLEL for a, b in combinations(bases, 2))


def _beside_place(
    contact: Contact | None, picture: LocalAnalysis, options: BridgeOptions
) -> tuple[int, Array] | None:
    """The one mode through a start beside where it touches another, and its tangents (nv, m)."""
    try:
        found = None if contact is None else contact.beside(options)
    except NoBridgeError:
        return None
    if contact is None or found is None:
        return None
    number, own = found
    tangent, iv = picture.modes[number].reshape(len(picture.kernel), -1).copy(), contact.space.cluster.iv
    tangent[iv] = np.outer(own, own @ tangent[iv] / (own @ own))  # beside the place it is not the place's
    return number, tangent


def _picked(
    mechanism: Mechanism, picture: LocalAnalysis, v: Array, mode: ArrayLike | None
) -> tuple[int, Array]:
    """The number of the mode named by the caller or by the initial velocity, and its tangents (nv, m)."""
    listed = "; ".join(f"modes[{i}] = {np.round(t, 4).tolist()}" for i, t in enumerate(picture.modes))
    bases = [t.reshape(mechanism.nv, -1) for t in picture.modes]
    if mode is None:
        fits = [i for i, b in enumerate(bases) if np.any(v) and apart(mechanism, v[:, None], b) < SAME_MODE]
    elif (number := numbered(mode, len(bases))) is not None:
        fits = [number]
    else:
        wanted = checked_mode(mechanism, mode)
        fits = [i for i, b in enumerate(bases) if apart(mechanism, wanted, b) < SAME_MODE]
        if not fits:
            raise OptionError(f"mode is not one of those that meet at q0: {listed}")
        if len(fits) > 1:
            raise OptionError(
                f"modes {' and '.join(map(str, fits))} touch at q0 and share this tangent: name one by its "
                f"number, mode={fits[0]}"
            )
    if len(fits) == 1:
        return fits[0], bases[fits[0]]
    why = (
        "the initial velocity lies in more than one of them"
        if fits
        else "the initial velocity lies in none of them"
        if np.any(v)
        else "the start is at rest"
    )
    raise SingularStartError(
        f"{len(bases)} modes meet at q0 and {why}: choose one with mode=..., of {listed}",
        picture.q[mechanism.iq_numbers],
    )


def _parametrised(mechanism: Mechanism, tangent: Array, y: Array) -> Array:
    """G of the mode: tangent (tangent_independent)⁻¹."""
    block = tangent[mechanism.iv_independent]
    s = np.linalg.svd(tangent / mechanism.column_scale[:, None], compute_uv=False)
    s_block = np.linalg.svd(block / mechanism.column_scale[mechanism.iv_independent, None], compute_uv=False)
    if s_block[-1] < DETERMINES * s[0]:
        choices = _choices(mechanism, tangent)
        found = {name for names in choices for name in names}
        among = [each.name for each in in_v(mechanism.joints) if each.name in found]
        raise ToggleError(
            f"{', '.join(mechanism.independent)} stays at rest on this mode and cannot parametrise it; "
            f"choose independent joints among {', '.join(among)}",
            y,
            choices,
        )
    return np.asarray(tangent @ np.linalg.inv(block), dtype=float)


def _require_serving(mechanism: Mechanism, tangent: Array, G: Array, y: Array) -> None:
    """Refuse independent joints that turn back on a mode at a singular start, or are about to."""
    for cluster in mechanism.clusters:
        J = G[np.ix_(cluster.iv, cluster.inputs)] / cluster.loops.column_scale[:, None]
        T = np.linalg.qr(J)[0]
        if cluster.m and smallest(T, cluster.chosen) < CHANGE * smallest(T, best(T)):
            choices = _choices(mechanism, tangent)
            names = ", ".join(mechanism.independent)
            raise ToggleError(
                f"start at a singularity: {names} moves little on this mode, beside others, and turns back "
                f"next to it; joints that can: {spelled(choices)}",
                y,
                choices,
            )


def _choices(mechanism: Mechanism, tangent: Array) -> list[tuple[str, ...]]:
    """Independent joints for a mode, the best ones first; of mobility 1 all that move on it."""
    numbers = in_v(mechanism.joints)
    T = np.linalg.qr(tangent / mechanism.column_scale[:, None])[0]
    if mechanism.m > 1:
        return [tuple(numbers[i].name for i in best(T))]
    sizes = np.abs(T[:, 0])
    return [(numbers[i].name,) for i in np.argsort(-sizes) if sizes[i] > DETERMINES * sizes.max()]


def _beside(
    mechanism: Mechanism, q: Array, tangent: Array, options: BridgeOptions, counters: Counters
) -> dict[int, Tracker]:
    """Trackers of the clusters that are singular at q, each on the mode with this tangent (nv, m)."""
    trackers: dict[int, Tracker] = {}
    for cluster in mechanism.clusters:
        space = space_of(mechanism, cluster, q[cluster.iq])
        x = space.x(q[cluster.iq])
        sigma = space.factors(x)[1]
        if space.nd == 0 or sigma[space.nd - 1] > 10.0 * SINGULAR_START * sigma[0]:  # as it was analysed
            continue
        own = np.linalg.solve(space.turn(x), tangent[cluster.iv][:, cluster.inputs])
        trackers[cluster.index] = tracker_on_mode(
            space, x, own, space.chart(cluster.chosen), options, counters
        )
    return trackers
