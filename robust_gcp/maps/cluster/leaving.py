"""From a singular configuration outward along one of its modes, to a point where K is regular."""

from __future__ import annotations

import numpy as np

from ...errors import NotCertifiedError
from ...mechanism.tree.tree import Array
from ..explicit import Counters
from .chart import apart
from .curve_builder import REACH, leads_astray
from .jet import Jet, LostError, null_pairing, solved
from .obstacles import ObstacleError
from .options import BridgeOptions
from .space import ClusterSpace
from .tracker import Tracker

STEPS = (0.02, 0.01, 0.03, 0.005, 0.04, 0.0025)
"""First steps tried, dimensionless joint units."""

OFF = 0.3
"""How far Newton may go from the tangent, in units of the first step."""

ARRIVED = 1e-8
"""Agreement of the mode's point at the start with the start itself."""


def tracker_on_mode(
    space: ClusterSpace, x: Array, tangent: Array, C: Array, options: BridgeOptions, counters: Counters
) -> Tracker:
    """A tracker on the mode through a singular x with this tangent space, at x itself.

    Parameters
    ----------
    x : ndarray (nv,)
    tangent : ndarray (nv, m)
        Any basis of the mode's tangent space.
    C : ndarray (nv, m)
        The chart to go on in.

    Raises
    ------
    NotCertifiedError
        When no way leads outward and back through x along the mode.
    """
    T = np.linalg.qr(tangent)[0]
    way = _way(space, x, T)
    reach = options.reach(space.m)
    reasons: list[str] = []
    # Too short a step drowns in rounding, too long a one finds another mode, and one way may lead into the
    # next singular place. That the mode leads back through x is what counts.
    for step in STEPS:
        for sign in (1.0, -1.0):
            try:
                beside = _outward(space, x, T, sign * way, step, reach)
                tracker = Tracker(beside.recharted(C), options, reach, counters)
                found = tracker.jet_at(C.T @ x)
                off, angle = float(np.abs(found.x - x).max()), apart(T, found.tangent())
                if off < ARRIVED and angle < 1e-4:  # another mode passes at an angle
                    return tracker
                reasons.append(f"the mode passes the start at a distance of {off:.1e}, angle {angle:.1e}")
            except (LostError, ObstacleError, np.linalg.LinAlgError) as lost:
                reasons.append(str(lost))
    raise NotCertifiedError(
        f"start at a singularity: the chosen mode could not be followed away from it ({reasons[-1]})"
    )


def _way(space: ClusterSpace, x: Array, T: Array) -> Array:
    """The direction of the mode, in the basis T, in which K becomes regular fastest."""
    m = T.shape[1]
    if m == 1:
        return np.ones(1)
    P = space.factors(x + 1e-3 * T @ np.ones(m))[0][:, : space.nd].T  # at x itself K lacks rows of the mode
    rng = np.random.default_rng(7)  # always the same, as the start of a run must be
    tried = rng.normal(size=(40, m))
    tried = np.vstack([np.eye(m), tried / np.linalg.norm(tried, axis=1)[:, None]])
    scores = [null_pairing(space, P, x, T @ w, T)[1] for w in tried]
    return np.asarray(tried[int(np.argmax(scores))])


def _outward(space: ClusterSpace, x: Array, T: Array, way: Array, step: float, reach: float) -> Jet:
    """A solved point of the mode at least `reach` from the singular set, or as far as can be had."""
    guess = x + step * (T @ way)
    P = space.factors(guess)[0][:, : space.nd].T
    here, _ = solved(space, guess, T, T.T @ x + step * way, P)
    if float(np.linalg.norm(here.x - guess)) > OFF * step:
        raise LostError("Newton leaves the tangent")
    if apart(T, here.tangent()) > 10.0 * step:  # one's own tangent turns by the order of the step
        raise LostError("beside the start Newton found another mode")
    for _ in range(60):
        delta = here.delta()
        if delta >= reach:
            return here
        move = REACH * min(delta, 1.0)
        pace = here.J @ way
        ahead = way * move / float(np.linalg.norm(pace))
        there, first = solved(space, here.predicted(ahead), T, here.y + ahead, here.P)
        if leads_astray(first, move, here):
            raise LostError("the mode cannot be followed outward")
        here = there
    return here
