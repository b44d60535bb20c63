"""What must hold of a start: v0 satisfies the constraint, and `mode` names a tangent of the motion."""

from __future__ import annotations

from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.local import analyse
from ..checks import real_array, shown
from ..errors import NonFiniteError, OptionError, PartitionError, StateError
from ..mechanism.constraint.closed_check import require_proper
from ..mechanism.constraint.rank import motions
from ..mechanism.coordinates.independent import regular_near
from ..mechanism.coordinates.partition import numerical_rank, spelled
from ..mechanism.mechanism import Mechanism
from ..mechanism.tolerances import COMPATIBLE, NEARLY_CLOSED, RANK, SAME_MODE
from ..mechanism.tree.tree import Array
from .explicit import Point
from .regular_path import RegularPath

FASTEST = 1e50
"""rad/s or m/s: accelerations grow with the square, and products of those must stay finite."""


PROBE = 1e-2
"""How far a start is moved to see whether left-over rows stay closed, dimensionless."""

LEFT_OPEN = 1e-9
"""max |φ| / length of rows that count as open there."""


STRUCTURE = (
    "its loops leave no joint any freedom, and a structure has no motion to simulate; check the link lengths "
    "and the axes of the joints, or leave a closure out"
)


def require_freedom(mechanism: Mechanism) -> None:
    """Refuse a mechanism without independent velocities."""
    if mechanism.m == 0:
        raise PartitionError(f"{mechanism.name!r} is rigid: {STRUCTURE}")


def checked_state(mechanism: Mechanism, q0: ArrayLike, v0: ArrayLike | None) -> tuple[Array, Array]:
    """q0 (nq,) with its loops closed to rounding, and v0 (nv,), zero where left out.

    Raises
    ------
    StateError, ClosureError, NonFiniteError
        For what is no state of the mechanism.
    """
    q = mechanism.configuration(q0, "q0")
    mechanism.require_closed(q, NEARLY_CLOSED, "the configuration")
    require_proper(mechanism, q)
    q = mechanism.polish(q, mechanism.iv_dependent)
    v = mechanism.tree.zero if v0 is None else mechanism.velocity(v0, "v0")
    require_finite_energy(mechanism, v)
    require_compatible(mechanism, q, v)
    return q, v


def require_finite_energy(mechanism: Mechanism, v: Array) -> None:
    """Products of speeds must be finite numbers: g grows with |v0|², an error estimate with its square."""
    size = max(np.abs(v).max(initial=0.0), np.abs(v / mechanism.column_scale).max(initial=0.0))
    if size > FASTEST:
        raise NonFiniteError(
            f"the velocity is too large (up to {np.abs(v).max():.3g}): products are not finite numbers; "
            "give it in rad/s and m/s"
        )


def broken_by(mechanism: Mechanism, q: Array, v: Array) -> tuple[str, float] | None:
    """The row of K v0 = 0 that is broken most, and by how much, relative to K and v0; None where none is."""
    if mechanism.nc == 0 or not np.any(v):
        return None
    K = mechanism.scaled(mechanism.K(q))
    u = v / mechanism.column_scale
    worst = int(np.argmax(np.abs(K @ u)))
    size = float(np.abs(K @ u)[worst])
    if size > COMPATIBLE * float(np.abs(K).max() * np.abs(u).max()):
        return mechanism.implicit.labels[worst], size
    return None


def require_compatible(mechanism: Mechanism, q: Array, v: Array) -> None:
    """K v0 = 0, relative to the sizes of K and v0."""
    broken = broken_by(mechanism, q, v)
    if broken is not None:
        row, size = broken
        raise StateError(
            f"the velocity breaks the loop {row}: K v = {size:.3g} (scaled); give "
            "v = G ẏ, for instance from mech.lift(q, ydot)"
        )


def require_velocity_in_mode(mechanism: Mechanism, v: Array, G: Array) -> None:
    """v0 = G ẏ0 must hold on the chosen mode too, where K alone allows more."""
    scale = mechanism.column_scale
    off = np.abs((v - G @ v[mechanism.iv_independent]) / scale).max(initial=0.0)
    if off > 10.0 * COMPATIBLE * max(np.abs(v / scale).max(initial=0.0), 1e-300):
        raise StateError(
            "v0 does not lie in the tangent space of the mode that the start is on "
            f"(v0 − G ẏ0 is {off:.3g}, scaled); give v0 along that mode, or another mode"
        )


def require_mobility(mechanism: Mechanism, q: Array, path: RegularPath) -> None:
    """With rows left over, they must depend on the selected ones; else y has too many joints."""
    if mechanism.nc == path.nd:
        return
    s = np.linalg.svd(mechanism.scaled(mechanism.K(q)), compute_uv=False)
    path.counters.svds += 1
    rank = numerical_rank(s, RANK)
    if rank > path.nd:
        if rank == mechanism.nv:
            raise PartitionError(f"{mechanism.name!r} is rigid at q0: {STRUCTURE}")
        choices = [names for _, names in mechanism.coordinate_choices(q)]
        raise PartitionError(
            f"{mechanism.m} independent joints are named, and the mobility at q0 is "
            f"{mechanism.nv - rank}: the loops leave no freedom to some of them; sets that serve: "
            + spelled(choices),
            choices,
        )


def require_lasting_mobility(path: RegularPath, start: Point) -> None:
    """With rows left over, these must stay closed a little way on: else the rank is lower at the start only.

    Two bars flat between pins as far apart as they are long look movable at q0, to first order. They are not.
    """
    mechanism = path.mechanism
    if mechanism.nc == path.nd:
        return
    mechanism.require_closed(start.q, LEFT_OPEN, "q0, with what rounded lengths leave open")
    for j in range(mechanism.m):
        for sign in (1.0, -1.0):
            step = np.zeros(mechanism.m)
            step[j] = sign * PROBE / max(path.size(start.G[:, j]), 1e-300)
            near = path.step(start, start.y + step, start.ydot)
            if near is None:
                continue  # out of reach: nothing is known
            left = mechanism.closure_residual(near.q)
            if left <= LEFT_OPEN:
                continue
            _refuse_coordinates_beside(mechanism, start.q)
            raise PartitionError(
                f"no mobility at q0 in {mechanism.independent[j]}: rank {path.nd} of {mechanism.nc} "
                f"rows there and a higher one nearby; moved by {PROBE:g} the loops open by {left:.2g} "
                "lengths. It is rigid, nothing moves; check the lengths of the links, or leave a closure out"
            )


def _refuse_coordinates_beside(mechanism: Mechanism, q: Array) -> None:
    """Where the loops move beside a singular q, with fewer coordinates than were named: say which serve."""
    place = regular_near(mechanism, q, wanted=mechanism.independent)
    freedom = motions(mechanism, place).shape[1]
    if place is q or freedom == 0:
        return
    choices = [names for _, names in mechanism.coordinate_choices(place)]
    raise PartitionError(
        f"{mechanism.m} independent joints are named, and q0 is singular: beside it K has a higher rank and "
        f"the mobility is {freedom}; sets that serve: " + spelled(choices),
        choices,
    )


def _is_number(mode: ArrayLike | None) -> TypeGuard[int | np.integer[Any]]:
    return isinstance(mode, int | np.integer) and not isinstance(mode, bool)


def numbered(mode: ArrayLike | None, modes: int) -> int | None:
    """`mode` where it is the number of one of the modes, or None; an OptionError for a number of none."""
    if not _is_number(mode):
        return None
    if not 0 <= mode < modes:
        raise OptionError(f"mode = {mode} names none of the {modes} modes at q0; they are numbered from 0")
    return int(mode)


def by_number(mechanism: Mechanism, q: Array, mode: ArrayLike | None) -> ArrayLike | None:
    """`mode` as it is, or its tangent where it is the number of one at q."""
    if not _is_number(mode):
        return mode
    modes = analyse(mechanism, q).modes
    numbered(mode, len(modes))  # refuses a number of none
    return modes[mode]


def checked_mode(mechanism: Mechanism, mode: ArrayLike) -> Array:
    """`mode` as a finite float array (nv, m), or an OptionError."""
    shape = f"(nv,) = ({mechanism.nv},)" if mechanism.m == 1 else f"(nv, m) = ({mechanism.nv}, {mechanism.m})"
    try:
        wanted = real_array(mode)
    except TypeError as error:
        raise OptionError(
            f"mode = {shown(mode)} is not an array of numbers {shape}; give one of "
            "analyse(mechanism, q0).modes, or its number"
        ) from error
    if wanted.size != mechanism.nv * mechanism.m:
        raise OptionError(f"mode must have shape {shape}, not {wanted.shape}")
    if not np.all(np.isfinite(wanted)):
        raise OptionError(
            f"mode = {wanted.tolist()} must be finite; give one of analyse(mechanism, q0).modes"
        )
    return wanted.reshape(mechanism.nv, mechanism.m)


def require_mode(mechanism: Mechanism, mode: ArrayLike | None, G: Array) -> None:
    """A mode named at a regular start must be the one that the start is on."""
    if mode is None or numbered(mode, 1) is not None:
        return
    wanted = checked_mode(mechanism, mode)
    if mechanism.m and apart(mechanism, wanted, G) >= SAME_MODE:
        tangent = np.round(G, 4).squeeze().tolist()
        raise OptionError(
            f"mode = {wanted.squeeze().tolist()} is not tangent to the motion at q0, a regular "
            f"configuration on one mode only, whose tangent is {tangent}: leave mode out, or "
            "start where the modes meet"
        )


def apart(mechanism: Mechanism, vectors: Array, basis: Array) -> float:
    """Sine of the largest angle between vectors and the span of basis, dimensionless velocities."""
    scale = mechanism.column_scale[:, None]
    Q, _ = np.linalg.qr(basis / scale)
    u = vectors / scale
    size = np.linalg.norm(u, axis=0)
    if np.any(size == 0.0):
        return 1.0  # no direction at all
    u = u / size
    return float(np.linalg.norm(u - Q @ (Q.T @ u), axis=0).max())
