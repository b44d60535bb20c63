"""The first point of a motion: a checked state, and at a singular configuration the chosen mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .bridge import Bridge, BridgeOptions, Builder, NoBridgeError
from .errors import (
    NonFiniteError,
    NotCertifiedError,
    OptionError,
    PartitionError,
    SingularStartError,
    StateError,
    ToggleError,
)
from .kernel import Counters, Point, RegularPath
from .loops import NEARLY_CLOSED
from .march import same_branch
from .mechanism import Mechanism
from .partition import numerical_rank
from .singularity import LocalAnalysis, analyse
from .tree import Array
from .unrolled import regular_path

SINGULAR = 1e-5
"""Conditioning of K_d below which a start counts as singular: G has lost ten digits there."""

COMPATIBLE = 1e-6
"""Largest |K v| relative to |K| |v| of an initial velocity that satisfies the constraint."""

SAME_MODE = 1e-4
"""Sine of the largest angle, dimensionless velocities, between tangents of the same mode."""


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
    _require_finite_energy(mechanism, v)
    _require_compatible(mechanism, q, v)
    ydot = v[mechanism.iv_independent]
    y = q[mechanism.iq_independent]
    path = regular_path(mechanism, mechanism.select_rows(mechanism.K(q)), counters)
    rest = np.zeros(mechanism.m)
    if path.nd == 0 or path.worst_conditioning(q) > SINGULAR:
        point = path.derivatives(q, y, ydot)
        _require_mobility(mechanism, q, path)
        _require_mode(mechanism, mode, point.G)
        _require_velocity_in_mode(mechanism, v, point.G)
        return Start(path, point, ydot)
    picture = analyse(mechanism, q, rank_tolerance=10.0 * SINGULAR)
    if picture.kind == "regular" or picture.kind == "redundant":
        choices = [names for _, names in mechanism.coordinate_choices(q)]
        raise ToggleError(
            f"start at a toggle: K_d is singular at q0 while K is not, so "
            f"{', '.join(mechanism.independent)} cannot parametrise the motion here; joints that can: "
            + (", or ".join(" + ".join(c) for c in choices) or "none"),
            y,
            choices,
        )
    if not picture.modes:
        raise NotCertifiedError(f"start at a singularity: {picture.message}", y)
    tangent = _pick(mechanism, picture, v, mode)
    G = _parametrised(mechanism, tangent, y)
    bridge, path = _bridge_along(mechanism, path, q, G, options)
    point = bridge.line.at(bridge.parameter(y), rest)
    point.ydot = ydot
    _require_velocity_in_mode(mechanism, v, G)
    return Start(path, path_point(point, ydot), ydot, bridge)


def path_point(point: Point, ydot: Array) -> Point:
    """The point with its g for ẏ (m = 1; for other m the first evaluation sets it)."""
    if point.curvature is not None:
        point.g = point.curvature * float(ydot[0]) ** 2
    return point


def _require_finite_energy(mechanism: Mechanism, v: Array) -> None:
    with np.errstate(over="ignore"):
        u = v / mechanism.column_scale
        finite = np.isfinite(u @ u) and np.isfinite(v @ v)
    if not finite:
        raise NonFiniteError(
            f"v0 is so large (up to {np.abs(v).max():.3g}) that its square is not a finite number; "
            "give it in rad/s and m/s"
        )


def _require_compatible(mechanism: Mechanism, q: Array, v: Array) -> None:
    if mechanism.nc == 0 or not np.any(v):
        return
    K = mechanism.scaled(mechanism.K(q))
    u = v / mechanism.column_scale
    worst = int(np.argmax(np.abs(K @ u)))
    size = float(np.abs(K @ u)[worst])
    if size > COMPATIBLE * float(np.abs(K).max() * np.abs(u).max()):
        raise StateError(
            f"v0 breaks the loop {mechanism.implicit.labels[worst]}: K v0 = {size:.3g} (scaled); give "
            "v0 = G ẏ, for instance from mech.lift(q0, ydot)"
        )


def _require_velocity_in_mode(mechanism: Mechanism, v: Array, G: Array) -> None:
    """v0 = G ẏ0 must hold on the chosen mode too, where K alone allows more."""
    scale = mechanism.column_scale
    off = np.abs((v - G @ v[mechanism.iv_independent]) / scale).max(initial=0.0)
    if off > 10.0 * COMPATIBLE * max(np.abs(v / scale).max(initial=0.0), 1e-300) and off > 0.0:
        raise StateError(
            "v0 does not lie in the tangent space of the mode that the start is on "
            f"(v0 − G ẏ0 is {off:.3g}, scaled); give v0 along that mode, or another mode"
        )


def _require_mobility(mechanism: Mechanism, q: Array, path: RegularPath) -> None:
    """With rows left over, they must depend on the selected ones; else y has too many joints."""
    if mechanism.nc == path.nd:
        return
    s = np.linalg.svd(mechanism.scaled(mechanism.K(q)), compute_uv=False)
    rank = numerical_rank(s, 1e-8)
    if rank > path.nd:
        choices = [names for _, names in mechanism.coordinate_choices(q)]
        raise PartitionError(
            f"{mechanism.m} independent joints are named, and the mobility at q0 is "
            f"{mechanism.nv - rank}: the loops leave no freedom to some of them; sets that serve: "
            + (", or ".join(" + ".join(c) for c in choices) or "none"),
            choices,
        )


def _pick(mechanism: Mechanism, picture: LocalAnalysis, v: Array, mode: ArrayLike | None) -> Array:
    """Tangent basis (nv, m) of the mode named by the caller or by the initial velocity."""
    listed = "; ".join(f"modes[{i}] = {np.round(t, 4).tolist()}" for i, t in enumerate(picture.modes))
    bases = [t.reshape(mechanism.nv, -1) for t in picture.modes]
    if mode is not None:
        wanted = _checked_mode(mechanism, mode)
        fits = [b for b in bases if _apart(mechanism, wanted, b) < SAME_MODE]
        if not fits:
            raise OptionError(f"mode is not one of those that meet at q0: {listed}")
        return fits[0]
    moving = [b for b in bases if np.any(v) and _apart(mechanism, v[:, None], b) < SAME_MODE]
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


def _checked_mode(mechanism: Mechanism, mode: ArrayLike) -> Array:
    """`mode` as a finite float array (nv, m), or an OptionError."""
    shape = f"(nv,) = ({mechanism.nv},)" if mechanism.m == 1 else f"(nv, m) = ({mechanism.nv}, {mechanism.m})"
    try:
        wanted = np.asarray(mode, dtype=float)
    except (TypeError, ValueError) as error:
        raise OptionError(
            f"mode = {mode!r} is not an array of numbers {shape}; give one of analyse(mechanism, q0).modes"
        ) from error
    if wanted.size != mechanism.nv * mechanism.m:
        raise OptionError(f"mode must have shape {shape}, not {wanted.shape}")
    if not np.all(np.isfinite(wanted)):
        raise OptionError(f"mode = {wanted.tolist()} must be finite; give one of analyse(mechanism, q0).modes")
    return wanted.reshape(mechanism.nv, mechanism.m)


def _require_mode(mechanism: Mechanism, mode: ArrayLike | None, G: Array) -> None:
    """A mode named at a regular start must be the one that the start is on."""
    if mode is None:
        return
    wanted = _checked_mode(mechanism, mode)
    if mechanism.m and _apart(mechanism, wanted, G) >= SAME_MODE:
        raise OptionError(
            f"mode = {wanted.squeeze().tolist()} is not tangent to the motion at q0, a regular configuration on "
            f"one mode only, whose tangent is {np.round(G, 4).squeeze().tolist()}: leave mode out, or start "
            "where the modes meet"
        )


def _apart(mechanism: Mechanism, vectors: Array, basis: Array) -> float:
    """Sine of the largest angle between vectors and the span of basis, dimensionless velocities."""
    scale = mechanism.column_scale[:, None]
    Q, _ = np.linalg.qr(basis / scale)
    u = vectors / scale
    size = np.linalg.norm(u, axis=0)
    if np.any(size == 0.0):
        return 1.0  # no direction at all
    u = u / size
    return float(np.linalg.norm(u - Q @ (Q.T @ u), axis=0).max())


def _parametrised(mechanism: Mechanism, tangent: Array, y: Array) -> Array:
    """G of the mode: tangent (tangent_independent)⁻¹."""
    block = tangent[mechanism.iv_independent]
    s = np.linalg.svd(tangent / mechanism.column_scale[:, None], compute_uv=False)
    s_block = np.linalg.svd(block / mechanism.column_scale[mechanism.iv_independent, None], compute_uv=False)
    if s_block[-1] < 1e-6 * s[0]:
        moving = [
            n
            for n in mechanism.joint_names
            if np.abs(tangent[mechanism.velocity_slice(n)]).max() > 1e-6 * np.abs(tangent).max()
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
) -> tuple[Bridge, RegularPath]:
    """The bridge over a singular q on the mode with tangent space G."""
    y = q[mechanism.iq_independent]
    motion = np.abs(G / mechanism.column_scale[:, None]).max(axis=0)
    reasons: list[str] = []
    size = 0.05
    while size > 1e-5:
        direction = _outward(mechanism, path, q, y, G, motion, size)
        if direction is not None:
            d, point = direction
            try:
                bridge = Builder(path, options).build(point, d)
            except NoBridgeError as failure:
                reasons.append(str(failure))
            else:
                here = bridge.line.at(bridge.parameter(y), np.zeros(mechanism.m))
                gap = np.abs(mechanism.tree.difference(q, here.q) / mechanism.column_scale).max()
                turn = np.abs((here.G - G) / mechanism.column_scale[:, None]).max() / motion.max()
                if gap < 10.0 * np.sqrt(SINGULAR) * size and turn < 1e-2:
                    return bridge, path
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
    ahead = beside(d * (size / float(np.abs(G @ d / mechanism.column_scale).max())))
    nearer = beside(d * (0.8 * size / float(np.abs(G @ d / mechanism.column_scale).max())))
    if ahead is None or nearer is None:
        return None
    check = path.step(ahead, nearer.y, rest)
    if check is None or not same_branch(ahead, check):
        return None
    return d, ahead
