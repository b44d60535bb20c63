"""What the builders of curves and of lines share: widths tried, nodes on the far side, what is certified."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

import numpy as np

from ...mechanism.tree.tree import Array
from ..explicit import CrossingKind
from .jet import Jet, LostError
from .options import BridgeOptions, NoBridgeError
from .space import ClusterSpace

COARSE, FINE = 2.0**-6, 2.0**-12
"""Grids of a parameter's direction and origin, and of a curve's nodes."""

GOOD = 1e-9
"""Relative error of Γ at which no shorter bridge is tried."""

FAR_SIDE = (0.1, 0.02)
"""Newton's first correction at the first node beyond, and at the others, in half widths."""


FAILING = (NoBridgeError, LostError, np.linalg.LinAlgError)
"""What an attempt at a bridge may fail by."""


class Certified(Protocol):
    """A bridge: what it is, and how good."""

    kind: CrossingKind
    error: float


B = TypeVar("B", bound=Certified)


def rounded(numbers: Array, grid: float) -> Array:
    """Near enough, in numbers that do not carry a solved point's rounding.

    Runs that differ by rounding alone, as those of two backends do, get the same bridge.
    """
    return np.round(numbers / grid) * grid


def best_of(
    attempt: Callable[[float], B],
    widths: Sequence[float],
    good: Callable[[B], bool],
    failing: tuple[type[Exception], ...] = FAILING,
) -> tuple[B | None, list[Exception]]:
    """The first of several attempts that is good, else that of the least error; and what made others fail."""
    best: B | None = None
    failures: list[Exception] = []
    for width in widths:
        try:
            made = attempt(width)
        except failing as failure:
            failures.append(failure)
            continue
        if best is None or made.error < best.error:
            best = made
        if good(made):
            break
    return best, failures


def certified(attempt: Callable[[float], B], *half_widths: Sequence[float]) -> B:
    """The best bridge of the first half widths that serve.

    Raises
    ------
    NoBridgeError
        When no attempt earns a certificate: that of the attempt which came nearest.
    """
    # Wide bridges first: K is well conditioned at their nodes; narrow ones where the mode bends much.
    failures: list[Exception] = []
    for tried in half_widths:
        best, failed = best_of(attempt, tried, lambda made: made.error <= GOOD and made.kind == "transversal")
        if best is not None:
            return best
        failures += failed
    nearest = min(failures, key=lambda failure: getattr(failure, "residual", np.inf))
    raise nearest if isinstance(nearest, NoBridgeError) else NoBridgeError(str(nearest))


def beyond(
    near: Sequence[float],
    nodes: Sequence[Jet],
    far: Iterable[float],
    half_width: float,
    guess: Callable[[Sequence[float], Sequence[Jet], float], Array],
    solve: Callable[[Array, float, Array], tuple[Jet, float]],
) -> list[Jet]:
    """Nodes on the far side, from those on the near one: by extrapolation of all so far, then Newton.

    Raises
    ------
    NoBridgeError
        When Newton's first correction says that the mode does not go on smoothly.
    """
    places, found, P = list(near), list(nodes), nodes[0].P
    for k, place in enumerate(far):
        node, first = solve(guess(places, found, place), place, P)
        # On a corner the extrapolation misses the first node beyond by the width: then this is not one mode.
        if first > FAR_SIDE[min(k, 1)] * half_width:  # on smooth modes 1e-8 of it and less
            raise NoBridgeError("beyond the singular place the mode does not go on smoothly", first)
        P = node.P
        places.append(place)
        found.append(node)
    return found[len(nodes) :]


def closure(
    space: ClusterSpace, options: BridgeOptions, points: Iterable[Array], beside: Array
) -> tuple[float, CrossingKind]:
    """max |φ| between the nodes, in lengths, and what that makes of the place; `beside` is a point near by.

    Raises
    ------
    NoBridgeError
        When the loops stay open by more than a gap that may be bridged.
    """
    left = max(space.residual(x) for x in points)
    allowed = options.closure_tolerance + space.noise(beside)  # after many turns angles are rounded coarser
    if left > max(allowed, options.geometric_tolerance):
        raise NoBridgeError("the interpolated mode does not close the loops", left)
    return left, "transversal" if left <= allowed else "near miss"


def held_out(
    places: Sequence[float] | Array,
    center: float,
    off: Callable[[float, int], float],
    growth: Callable[[float], float],
) -> float:
    """Error of Γ in the middle, from its error between two nodes on each side.

    Parameters
    ----------
    places : array_like (n,)
        The nodes', ascending.
    center : float
    off : callable
        Error of Γ at a place, near the node of this number.
    growth : callable
        Error in the middle over that at a place, from Π|(s_i − center)/(s_i − s)|.
    """
    s, n, worst = np.asarray(places), len(places), 0.0
    for inner, outer in ((n // 2 - 1, n // 2 - 2), (n // 2, n // 2 + 1)):
        place = 0.5 * float(s[inner] + s[outer])
        worst = max(worst, off(place, inner) * growth(float(np.prod(np.abs((s - center) / (s - place))))))
    return worst


def relative(found: Array, known: Array) -> float:
    """Largest error over one and the largest of what is known."""
    return float(np.abs(known - found).max() / (1.0 + np.abs(known).max()))
