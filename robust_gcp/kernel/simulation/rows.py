"""Many motions of one mechanism in one choice of coordinates, a row of numbers each; see rows.h."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ...dynamics.equations import Evaluation
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...maps.cluster.options import BridgeOptions
from ...maps.explicit import Point
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..description import describe
from ..handles import Handle, Layout, tracker_numbers
from ..library import Library
from ..straight.program import Motions, known_steps, straight_steps
from ..structures import ALONE, Arrays, Reason, Rows, address
from .batch import Begun
from .guard import Watch
from .row_state import RowState, Standing, Which
from .workspace import Workspace

MANY = 100_000
"""Steps of all rows together from which on they are compiled: the kernel takes some 0.2 s for these."""

STRETCH = 16
"""Steps that the kernel takes in or beside a zone until code compiled for the mechanism is tried again."""


class _RowSpace(Workspace):
    """A workspace that takes steps of many motions."""

    @property
    def layout(self) -> Layout:
        """How points lie in the kernel's memory."""
        return self._layout

    def many(self, rows: Any, zone: float, options: BridgeOptions, watch: Watch | None) -> None:
        """Steps of many motions, which are told by a pointer to `Rows`; the rest as for `run`."""
        r, self.latest, self._packed = self.request, None, None
        r.best = r.power = 0.0
        self._choices.make(zone, options, watch)
        self.handed.secure()
        self.acting.listen()
        self.library.rows(self.handle, self.reference, rows)


class MotionRows:
    """The rows of a batch in one choice of coordinates.

    Those that come to a singular place have a workspace of their own from then on, which knows their bridges.

    Parameters
    ----------
    library : Library
    mechanism : Mechanism
    path : RegularPath
    held : HeldTorque
        What tells how wide the rows of torques are.
    state : RowState
    options : BridgeOptions
    zone : float
        Conditioning below which the regular path ends.
    watch : Watch or None
        Up to where these coordinates serve.
    threads : int

    Attributes
    ----------
    mechanism, path, options, zone
        As they were given.
    in_zone : ndarray of int (N,)
        Whether rows are beside singular places.
    compiles : bool
        Whether steps on regular ground are compiled for this mechanism once there are many.

    Raises
    ------
    NotNativeError
        When the kernel cannot take the mechanism.
    """

    def __init__(
        self,
        library: Library,
        mechanism: Mechanism,
        path: RegularPath,
        held: HeldTorque,
        state: RowState,
        options: BridgeOptions,
        zone: float,
        watch: Watch | None,
        threads: int,
    ) -> None:
        self.mechanism, self.path, self._library, self._state = mechanism, path, library, state
        self.zone, self.options, self._limits = zone, options, (zone, options, watch)
        self._spaces = [_RowSpace(library, mechanism, path, held) for _ in range(threads)]
        self.layout, count, m = self._spaces[0].layout, len(state.at), mechanism.m
        self._x, self._ydd = np.zeros((count, 2 * m)), np.zeros((count, m))
        self._anchor, self._origin = np.zeros((count, self.layout.size)), np.zeros((count, mechanism.nq))
        self._own, self._trackers = np.zeros(count, np.uint64), np.zeros(count, np.uint64)
        self._going, self.in_zone = np.zeros(count, np.int32), np.zeros(count, np.int32)
        self._first, self._limit, self._uneven = watch, np.zeros(count), np.zeros((count, m))
        self._straight: Any = None  # a function, or the reason why there is none
        self._recording: tuple[Array, Array] | None = None
        self.compiles, self._taken = True, 0
        self._structures: dict[Any, Any] = {}
        self._handles: dict[int, Handle] = {}
        self._numbers: dict[int, Array] = {}

    @property
    def workspace(self) -> Workspace:
        """Where starts are looked at."""
        return self._spaces[0]

    def put(self, i: int, standing: Standing) -> None:
        """A row is there now."""
        self.let_go(i)
        self._x[i], self._anchor[i], self._origin[i] = standing.x, standing.anchor, standing.origin
        self._ydd[i], trackers = standing.ydd, standing.trackers
        self.set_watch(i, standing.watch or self._first)
        if trackers is not None:
            self._numbers[i] = trackers  # kept, as the kernel reads them where they are
            self._trackers[i] = address(trackers) or 0
            self._alone(i)
            self.in_zone[i] = True

    def standing_at(
        self, x: Array, now: Evaluation, trackers: Array | None = None, watch: Watch | None = None
    ) -> Standing:
        """A place for `put`."""
        anchor = np.zeros(self.layout.size)
        self.layout.pack(now.point, anchor)
        size = 2 * self.mechanism.m  # rows count no work done
        origin = self.layout.origin(now.point)
        return Standing(x[:size].copy(), anchor, origin, now.ydd.copy(), trackers, watch)

    def begun(self, start: Begun) -> Standing:
        """The same for a start of the workspace's."""
        return self.standing_at(start.x, start.now, None if start.trackers is None else start.trackers())

    def where(self, i: int) -> Standing:
        """Where a row is."""
        x, anchor, origin, ydd = (part[i].copy() for part in (self._x, self._anchor, self._origin, self._ydd))
        trackers = self._numbers.get(i) if self.in_zone[i] else None
        if self.in_zone[i] and self._going[i]:
            trackers = tracker_numbers(self._library, self._handles[i].address)
        return Standing(x, anchor, origin, ydd, trackers, self.watch(i))

    def state_of(self, i: int) -> tuple[Array, Array]:
        """q and v of a row."""
        point = self.point(i)
        return point.q, point.G.dot(point.ydot)

    def conditioning(self, which: Which) -> Array:
        """How K_d is conditioned where some rows are."""
        found: Array = self._anchor[which, self.layout.size - 1]
        return found

    def point(self, i: int) -> Point:
        """The point that a row is at."""
        return self.layout.point(self._anchor[i], self._origin[i])

    def watch(self, i: int) -> Watch | None:
        """Up to where these coordinates serve a row."""
        first = self._first
        return None if first is None else Watch(first.sizes, float(self._limit[i]), self._uneven[i].copy())

    def set_watch(self, i: int, watch: Watch | None) -> None:
        """They serve it up to there."""
        if watch is not None:
            self._limit[i], self._uneven[i] = watch.limit, watch.uneven

    def let_go(self, i: int) -> None:
        """A row is not here any more, or begins anew."""
        self._own[i] = self._trackers[i] = 0
        self._going[i] = self.in_zone[i] = False
        self._handles.pop(i, None)
        self._numbers.pop(i, None)

    def advance(self, which: Which, steps: int, pool: ThreadPoolExecutor | None) -> None:
        """So many steps of some rows, or as many as the kernel takes: `RowState.left` tells, `status` why."""
        state = self._state
        state.left[which], state.status[which] = steps, Reason.DONE
        if self._straight is None and self._worth(len(which) * steps):
            self._straight = straight_steps(self.mechanism, self._described())
        if not callable(self._straight):  # a reason in words, or not tried yet
            self._by_kernel(which, pool)
            return
        while len(which):
            regular = which[self.in_zone[which] == 0]
            before = state.at[regular]
            self._on_threads(self._ahead, regular, pool)
            self._going[regular[state.at[regular] != before]] = False  # their own workspaces stayed behind
            which = which[(state.left[which] > 0) & (state.status[which] != Reason.CHART)]
            state.status[which], later = Reason.DONE, np.maximum(state.left[which] - STRETCH, 0)
            state.left[which] -= later
            self._by_kernel(which, pool)
            state.left[which] += later
            which = which[(later > 0) & (state.status[which] == Reason.DONE)]

    def _by_kernel(self, which: Which, pool: ThreadPoolExecutor | None) -> None:
        """The steps that are left of some rows, or as many as the kernel takes."""
        if not len(which):
            return
        state = self._state
        self._trackers[which[self.in_zone[which] == 0]] = 0  # of a zone that was left
        self._on_threads(self._advance, which, pool)
        alone = which[state.status[which] == ALONE]
        for i in alone.tolist():
            self._alone(i)
        if len(alone):
            self._on_threads(self._advance, alone, pool)

    def recorded(self, which: Which, steps: int, pool: ThreadPoolExecutor) -> tuple[Array, Array]:
        """q and v (N, steps + 1, n) of some rows by compiled steps; `RowState.at` tells how far they came."""
        state, mechanism = self._state, self.mechanism
        q, v = (np.empty((len(state.at), steps + 1, n)) for n in (mechanism.nq, mechanism.nv))
        for i in which.tolist():
            q[i, 0], v[i, 0] = self.state_of(i)
        state.left[which], state.status[which], self._recording = steps, Reason.DONE, (q, v)
        try:
            self._on_threads(self._ahead, which, pool)
        finally:
            self._recording = None
        return q, v

    def specialise(self) -> str | None:
        """Have the steps compiled for this mechanism; the reason where that cannot be."""
        self._straight = straight_steps(self.mechanism, self._described())
        return None if callable(self._straight) else str(self._straight)

    def _worth(self, steps: int) -> bool:
        """Whether so many steps have come together that compiling them pays, or they are compiled."""
        self._taken += steps
        return self.compiles and (self._taken >= MANY or known_steps(self.mechanism))

    def _described(self) -> Arrays:
        return describe(self.mechanism, self.path, False)

    def _alone(self, i: int) -> None:
        """A workspace for a row."""
        handle = self._handles[i] = Handle(self._library, self.mechanism, self.path, False)
        self._own[i] = handle.address

    def _on_threads(
        self, do: Callable[[_RowSpace, Which], None], which: Which, pool: ThreadPoolExecutor | None
    ) -> None:
        count = len(self._spaces)
        if pool is None or len(which) < 2 * count:
            do(self._spaces[0], which)  # too few to share out
            return
        pairs = zip(self._spaces, np.array_split(which, count), strict=True)
        for done in [pool.submit(do, *pair) for pair in pairs]:
            done.result()

    def _advance(self, space: _RowSpace, which: Which) -> None:
        """Steps by the kernel, as many as are left of each."""
        which = np.ascontiguousarray(which, dtype=np.int64)
        space.many(ctypes.byref(self._told(Rows, which)), *self._limits)

    def _ahead(self, space: _RowSpace, which: Which) -> None:
        """The same by code compiled for this mechanism, on regular ground; it leaves what it cannot take."""
        which = np.ascontiguousarray(which, dtype=np.int64)
        rows = self._told(Motions, which)
        if self._recording is not None:
            q, v = self._recording
            rows.room, rows.all_q, rows.all_v = q.shape[1], address(q), address(v)
        self._straight(ctypes.byref(rows))

    def _told(self, kind: Any, which: Which) -> Any:
        """A structure that points to the numbers of some rows."""
        if kind not in self._structures:
            self._structures[kind] = self._pointing(kind())
        rows = kind.from_buffer_copy(self._structures[kind])  # one for each thread
        rows.count, rows.which = len(which), which.ctypes.data
        return rows

    def _pointing(self, rows: Any) -> Any:
        """That of all of them, whose arrays stay where they are."""
        state = self._state
        rows.step, rows.width = state.step, state.held.shape[1]
        arrays = {
            name: getattr(state, name) for name in ("t0", "at", "left", "passed", "status", "held", "q", "v")
        }
        arrays |= {"limit": self._limit, "uneven": self._uneven, "x": self._x, "anchor": self._anchor}
        arrays |= {"origin": self._origin, "ydd": self._ydd, "own": self._own, "going": self._going}
        arrays |= {"trackers": self._trackers, "in_zone": self.in_zone}
        if isinstance(rows, Motions):
            rows.zone = self.zone
            arrays["sizes"] = None if self._first is None else self._first.sizes
        for name in (name for name, _ in rows._fields_ if name in arrays):
            setattr(rows, name, address(arrays[name]))
        return rows
