"""What goes to the compiled kernel for a batch of steps and comes back from it."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...dynamics.equations import Evaluation
from ...dynamics.tableau import Tableau
from ...maps.cluster.options import BridgeOptions
from ...maps.explicit import Crossing, Point
from ...mechanism.tree.tree import Array
from ..handles import Trackers
from ..structures import Arrays, Bridging, OutputRows, Reason, Request, address
from .guard import ErrorControl, Guard, Watch, dop853


def counted(request: Request) -> dict[str, int]:
    """What was computed, by the names of `Counters`, steps apart."""
    return {
        "rhs": request.rhs,
        "newton_iterations": request.newton,
        "constraint_evaluations": request.constraint_evaluations,
        "force_evaluations": request.force_evaluations,
        "zone_evaluations": request.zone_evaluations,
        "marching_steps": request.marching_steps,
        "svds": request.svds,
        "bridges_built": request.bridges_built,
        "second_order": request.second_order,
    }


def crossings(request: Request, nq: int, numbers: NDArray[np.int64]) -> list[Crossing]:
    """What was passed last; `numbers` are the places of y in q."""
    shape = (int(request.logged), 8 + nq)
    # a copy: the kernel writes its next log there
    log = np.ctypeslib.as_array(ctypes.cast(request.log, ctypes.POINTER(ctypes.c_double)), shape).copy()
    return [
        Crossing(
            float(row[1]),
            row[8:][numbers],
            row[8:],
            # row[7]: order of contact
            "near miss" if row[6] else "tangential" if row[7] > 1.0 else "transversal",
            float(row[4]),
            float(row[5]),
            int(row[2]),
            int(row[3]),
            int(row[7]),
        )
        for row in log
    ]


@functools.lru_cache
def bridging(options: BridgeOptions, last_resort: float, error_controlled: bool = False) -> Arrays:
    """The choices of the bridges as plain numbers, which nobody changes.

    Parameters
    ----------
    last_resort : float
        As of `ClusterMap`.
    error_controlled : bool
        Whether whoever asks controls the error.
    """
    numbers = Arrays(
        Bridging(
            count=len(options.nodes),
            reach=options.reach(1),
            reach_of_several=options.reach(2),  # the same for any number from two on
            closure_tolerance=options.closure_tolerance,
            geometric_tolerance=options.geometric_tolerance,
            transversality=options.transversality,
            last_resort=last_resort,
            error_controlled=error_controlled,
        )
    )
    numbers.reals(nodes=options.nodes)
    return numbers


Looked = Callable[[float, Array, Array], bool]
"""Told the end of a step, by t, q and v; whether to stop there."""

NAMES = tuple(field[0] for field in OutputRows._fields_)


@dataclass(frozen=True)
class Outputs:
    """Rows for several outputs at once, C-contiguous; None where not wanted."""

    q: Array
    v: Array
    a: Array | None = None
    tau: Array | None = None
    energy: Array | None = None
    work: Array | None = None
    effort: Array | None = None  # of driven joints
    within: Within | None = None

    @classmethod
    def room(cls, n: int, nq: int, nv: int, wanted: Sequence[str] = (), driven: int = 0) -> Outputs:
        """Room for n outputs; `wanted` names those besides q and v."""
        widths = {"a": (n, nv), "tau": (n, nv), "energy": (n,), "work": (n,), "effort": (n, driven)}
        more: dict[str, Any] = {name: np.zeros(widths[name]) for name in wanted}
        return cls(np.empty((n, nq)), np.empty((n, nv)), **more)

    def written_by(self, request: Request) -> None:
        """Have the kernel write into these rows, from the first on."""
        within, targets = self.within, [(request.ends, self)]
        request.before = None
        if within is not None:
            targets.append((request.within, within.rows))
            request.times_within, request.before = address(within.times), address(within.before)
            request.prescribed_within = address(within.prescribed)
        for rows, own in targets:
            for name in NAMES:
                setattr(rows, name, address(getattr(own, name)))

    def first(self, n: int) -> Outputs:
        """The first n of them."""
        if n == len(self.q):
            return self
        within = None if self.within is None else self.within.first(n)
        return replace(self.between(0, n), within=within)

    def between(self, first: int, end: int) -> Outputs:
        """Those from `first` to before `end`, at the ends of steps alone."""
        kept = {name: getattr(self, name) for name in NAMES}
        cut: dict[str, Any] = {name: None if rows is None else rows[first:end] for name, rows in kept.items()}
        return Outputs(**cut)


def one_by_one(looked: Looked, outputs: Outputs, first: int = 0) -> Callable[[float], bool]:
    """What is told the ends of steps one after the other, by outputs from one on."""
    ends = zip(outputs.q[first:], outputs.v[first:], strict=True)
    return lambda t: looked(t, *next(ends))  # the kernel has written the row before it tells


@dataclass(frozen=True)
class Within:
    """Outputs within steps.

    Attributes
    ----------
    times : ndarray (k,)
        Increasing, s.
    before : ndarray of int (n + 1,)
        How many of them come before the first step's start and each of the n steps' ends.
    rows : Outputs
    prescribed : ndarray (k, 3, driven) or None
        y, ẏ and ÿ there of what moves as prescribed.
    """

    times: Array
    before: NDArray[np.int64]
    rows: Outputs
    prescribed: Array | None = None

    def first(self, n: int) -> Within:
        """Those within the first n steps."""
        k = int(self.before[n])
        return Within(self.times[:k], self.before[: n + 1], self.rows.between(0, k))


@dataclass(frozen=True)
class Batch:
    """What came of a batch of steps.

    Attributes
    ----------
    steps : int
        Steps completed; every number below belongs to the last one.
    reason : Reason
        Why the kernel stopped.
    x, now : ndarray, Evaluation
    trackers : Trackers or None
        Of the last state, where it is in a zone.
    outputs : Outputs
        Of the steps completed.
    crossings : list of Crossing
        Singular places passed, in the order of time.
    safe : (int, ndarray, Point) or None
        Step, state and point of the last well-conditioned one among the completed steps.
    best : float
        Largest conditioning of an output so far.
    counts : dict of str to int
        What they took, by the names of `Counters`.
    failure : BaseException or None
        What the torque callback raised after these steps.
    rounding : (float, float)
        With error control: what rounding costs of G at most, and how near a singular place.
    """

    steps: int
    reason: Reason
    x: Array
    now: Evaluation
    trackers: Trackers | None
    outputs: Outputs
    crossings: list[Crossing]
    safe: tuple[int, Array, Point] | None
    best: float
    counts: dict[str, int]
    failure: BaseException | None
    rounding: tuple[float, float]


def count_in(counters: Any, counts: dict[str, int]) -> None:
    """Add what was computed to counters."""
    for name, count in counts.items():
        if count:
            setattr(counters, name, getattr(counters, name) + count)


class Begun(NamedTuple):
    """A start: the state, its evaluation, in a zone the trackers, and what these took."""

    x: Array
    now: Evaluation
    trackers: Trackers | None
    counts: dict[str, int]


class Choices:
    """Makes a request's choices, and keeps what it then points to.

    Parameters
    ----------
    request : Request
    last_resort : float
        See `ClusterMap`.
    tableau, guard : Tableau, Guard, optional
        See `Workspace`.

    Attributes
    ----------
    shares : tuple of float
        See `Workspace`.
    """

    def __init__(
        self, request: Request, last_resort: float, tableau: Tableau | None, guard: Guard | None
    ) -> None:
        self._request, self._last_resort = request, last_resort
        self.shares: tuple[float, ...] = (0.0, 0.5)  # RK4's; c = 1 is the next step's 0
        if tableau is not None:
            self.shares = tableau.c
            self._weights = np.array([*(x for row in tableau.a for x in row), *tableau.b, *tableau.c])
            request.stages, request.tableau = len(tableau.b), address(self._weights)
        if guard is not None:
            self._guarded = guard.structure
            request.guard = ctypes.addressof(self._guarded.structure)
        self._watch: Watch | None = None

    def make(
        self,
        zone: float,
        options: BridgeOptions | None,
        watch: Watch | None,
        error_controlled: bool = False,
        control: ErrorControl | None = None,
    ) -> None:
        """Parameters are those of `Workspace.run`; `error_controlled`: the caller controls its error."""
        r = self._request
        r.zone, r.solver = zone, None
        if control is not None:
            error_controlled, r.solver = True, address(dop853())
            r.rtol, r.atol, r.safe_from = control
        r.bridging = None
        if options is not None:
            self._bridging = bridging(options, self._last_resort, error_controlled)
            r.bridging = ctypes.pointer(self._bridging.structure)
        self._watch = watch
        r.sizes = r.uneven = None
        if watch is not None:
            r.sizes, r.limit, r.uneven = address(watch.sizes), watch.limit, address(watch.uneven)
