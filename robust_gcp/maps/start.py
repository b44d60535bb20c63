"""The first point of a motion: a checked state, and at a singular configuration the chosen mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.local import LocalAnalysis, analyse
from ..errors import (
    NotCertifiedError,
    OptionError,
    SingularStartError,
    ToggleError,
)
from ..mechanism.mechanism import Mechanism
from ..mechanism.partition import spelled
from ..mechanism.tolerances import DETERMINES, NEARLY_CLOSED, SAME_MODE, SINGULAR_START
from ..mechanism.tree import Array
from .bridge.bridge import Bridge, BridgeOptions, Builder, NoBridgeError
from .march import same_branch
from .point import Counters, Point
from .regular_path import RegularPath
from .start_check import (
    apart,
    checked_mode,
    require_compatible,
    require_finite_energy,
    require_mobility,
    require_mode,
    require_velocity_in_mode,
)
from .unrolled import regular_path

LARGEST, SMALLEST = 0.05, 1e-5
"""Distances of the first nodes from a singular start, dimensionless: halved until a bridge is certified.
Below the smaller one K has lost the digits that the bridge is to restore."""

ALONG = 1e-2
"""Largest turn of G on a bridge against that of the chosen mode: another mode turns by the order of 1."""


@dataclass
class Start:
    """Where and how a motion begins.

    Attributes
    ----------
    path : RegularPath
    point : Point
    ydot : ndarray (m,)
    bridge : Bridge or None
        The certified bridge through a singular start.
    """

    path: RegularPath
    point: Point
    ydot: Array
    bridge: Bridge | None = None


def begin(
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
    mode : array_like (nv,) or (nv, m), optional
        Tangent of the mode to take where several meet (`analyse(...).modes[i]`).

    Raises
    ------
    StateError, ClosureError
        For a start that is no state of the mechanism.
    SingularStartError
        When several modes meet at q0 and neither `mode` nor v0 picks one.
    ToggleError, NotCertifiedError
        When the independent joints, or second order, cannot describe the motion from here.
    """
    q = mechanism.configuration(q0, "q0")
    mechanism.require_closed(q, NEARLY_CLOSED, "q0")
    mechanism.require_proper(q)
    q = mechanism.polish(q, mechanism.iv_dependent)
    v = mechanism.tree.zero if v0 is None else mechanism.velocity(v0, "v0")
    require_finite_energy(mechanism, v)
    require_compatible(mechanism, q, v)
    ydot = v[mechanism.iv_independent]
    y = q[mechanism.iq_independent]
    path = regular_path(mechanism, mechanism.select_rows(mechanism.K(q)), counters)
    if path.nd == 0 or path.worst_conditioning(q) > SINGULAR_START:
        point = path.derivatives(path.closed_at(q), y, ydot)
        require_mobility(mechanism, q, path)
        require_mode(mechanism, mode, point.G)
        require_velocity_in_mode(mechanism, v, point.G)
        return Start(path, point, ydot)
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
    if not picture.modes:
        raise NotCertifiedError(f"start at a singularity: {picture.message}", y)
    tangent = _pick(mechanism, picture, v, mode)
    G = _parametrised(mechanism, tangent, y)
    bridge = _bridge_along(mechanism, path, q, G, options)
    require_velocity_in_mode(mechanism, v, G)
    return Start(path, bridge.line.at(bridge.parameter(y), ydot), ydot, bridge)


def _pick(mechanism: Mechanism, picture: LocalAnalysis, v: Array, mode: ArrayLike | None) -> Array:
    """Tangent basis (nv, m) of the mode named by the caller or by the initial velocity."""
    listed = "; ".join(f"modes[{i}] = {np.round(t, 4).tolist()}" for i, t in enumerate(picture.modes))
    bases = [t.reshape(mechanism.nv, -1) for t in picture.modes]
    if mode is not None:
        wanted = checked_mode(mechanism, mode)
        fits = [b for b in bases if apart(mechanism, wanted, b) < SAME_MODE]
        if not fits:
            raise OptionError(f"mode is not one of those that meet at q0: {listed}")
        return fits[0]
    moving = [b for b in bases if np.any(v) and apart(mechanism, v[:, None], b) < SAME_MODE]
    if len(moving) == 1:
        return moving[0]
    why = (
        "the initial velocity lies in more than one of them"
        if moving
        else "the initial velocity lies in none of them"
        if np.any(v)
        else "the start is at rest"
    )
    raise SingularStartError(
        f"{len(bases)} modes meet at q0 and {why}: choose one with mode=..., of {listed}",
        picture.q[mechanism.iq_independent],
    )


def _parametrised(mechanism: Mechanism, tangent: Array, y: Array) -> Array:
    """G of the mode: tangent (tangent_independent)⁻¹."""
    block = tangent[mechanism.iv_independent]
    s = np.linalg.svd(tangent / mechanism.column_scale[:, None], compute_uv=False)
    s_block = np.linalg.svd(block / mechanism.column_scale[mechanism.iv_independent, None], compute_uv=False)
    if s_block[-1] < DETERMINES * s[0]:
        moving = [
            n
            for n in mechanism.joint_names
            if np.abs(tangent[mechanism.velocity_slice(n)]).max() > DETERMINES * np.abs(tangent).max()
        ]
        raise ToggleError(
            f"{', '.join(mechanism.independent)} stays at rest on this mode and cannot parametrise it; "
            f"choose independent joints among {', '.join(moving)}",
            y,
            [(n,) for n in moving] if mechanism.m == 1 else [],
        )
    return np.asarray(tangent @ np.linalg.inv(block), dtype=float)


def _bridge_along(
    mechanism: Mechanism, path: RegularPath, q: Array, G: Array, options: BridgeOptions
) -> Bridge:
    """The bridge over a singular q on the mode with tangent space G."""
    y = q[mechanism.iq_independent]
    motion = np.abs(G / mechanism.column_scale[:, None]).max(axis=0)
    reasons: list[str] = []
    size = LARGEST
    while size > SMALLEST:
        direction = _outward(mechanism, path, q, y, G, motion, size)
        if direction is not None:
            d, point = direction
            try:
                bridge = Builder(path, options).build(point, d)
            except NoBridgeError as failure:
                reasons.append(str(failure))
            else:
                here = bridge.line.at(bridge.parameter(y), np.zeros(mechanism.m))
                gap = path.size(mechanism.tree.difference(q, here.q))
                turn = np.abs((here.G - G) / mechanism.column_scale[:, None]).max() / motion.max()
                if gap < 10.0 * np.sqrt(SINGULAR_START) * size and turn < ALONG:
                    return bridge
                reasons.append("the bridge does not pass through q0 along the mode")
        size *= 0.5
    raise NotCertifiedError(
        "start at a singularity: the chosen mode could not be followed away from it"
        + (f" ({reasons[0]})" if reasons else ""),
        y,
    )


def _outward(
    mechanism: Mechanism,
    path: RegularPath,
    q: Array,
    y: Array,
    G: Array,
    motion: Array,
    size: float,
) -> tuple[Array, Point] | None:
    """A point of the mode beside q, along the direction in which K_d improves fastest."""
    rest = np.zeros(mechanism.m)
    gradient = np.zeros(mechanism.m)

    def beside(step: Array) -> Point | None:
        point = path.settle(mechanism.tree.integrate(q, G @ step), y + step, rest)
        if point is None:
            return None
        turn = np.abs((point.G - G) / mechanism.column_scale[:, None]).max() / motion.max()
        return point if turn < 0.3 and point.correction < 0.3 * size else None

    for j in range(mechanism.m):
        step = np.zeros(mechanism.m)
        step[j] = size / motion[j]
        point = beside(step)
        if point is None:
            return None
        gradient[j] = point.det[int(np.argmin(point.rcond))] / step[j] / motion[j]
    direction = gradient / motion
    norm = float(np.linalg.norm(direction))
    if norm == 0.0:
        return None
    d = np.ones(1) if mechanism.m == 1 else direction / norm
    reach = size / path.size(G @ d)
    ahead, nearer = beside(d * reach), beside(d * (0.8 * reach))
    if ahead is None or nearer is None:
        return None
    check = path.step(ahead, nearer.y, rest)
    if check is None or not same_branch(ahead, check):
        return None
    return d, ahead
