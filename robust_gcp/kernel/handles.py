"""Mechanisms in the kernel's memory, kept for the next run, and how points and requests lie there."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from ..maps.explicit import Point
from ..maps.grouped import GroupPoint, taken_apart
from ..maps.regular_path import RegularPath
from ..mechanism.constraint.couplings import MovingCoupling
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.coordinates.joint_charts import loop_charts
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .description import describe
from .library import Library
from .loop_arrays import NotNativeError
from .structures import Request, side_by_side


class Shared:
    """Buffers side by side, which a request points to.

    Parameters
    ----------
    request : Request
    mechanism : Mechanism
    n : int
        Numbers of a state.
    size : int
        Of a point.

    Attributes
    ----------
    time : ndarray (1,)
        Pointed to where a single time is given; see `at_time`.
    x, rate : ndarray (n,)
    anchor : ndarray (size,)
    safe : ndarray (size + n,)
    ydd, tau, origin : ndarray (m,), (nv,), (nq,)
    at_time : int
        The address of `time`.
    """

    def __init__(self, request: Request, mechanism: Mechanism, n: int, size: int) -> None:
        sizes = {"x": n, "rate": n, "anchor": size, "safe": size + n}
        sizes |= {"ydd": mechanism.m, "tau": mechanism.nv, "origin": mechanism.nq, "time": 1}
        arrays, places = side_by_side(sizes)
        self.x, self.rate, self.anchor, self.safe, self.ydd, self.tau, self.origin, self.time = arrays
        self.at_time = places.pop("time")
        for name, place in places.items():
            setattr(request, name, place)


class Layout:
    """Points of a mechanism as rows of numbers.

    Parameters
    ----------
    mechanism : Mechanism
    path : RegularPath
        Whose blocks the points tell of.

    Attributes
    ----------
    size : int
        Numbers of a point.
    q : slice
        Where its configuration is.
    """

    def __init__(self, mechanism: Mechanism, path: RegularPath) -> None:
        self._groups = groups = groups_of(mechanism)
        self._nv, self._m = mechanism.nv, mechanism.m
        self._charts = charts = loop_charts(path.mechanism)
        if charts is not None:
            self._in_charts = charts.iq if groups is None else groups.rest_iq[charts.iq]
        self._looped = bool(path.blocks)
        nv, m, blocks = self._nv, self._m, len(path.blocks)
        widths = [m, m, mechanism.nq, nv * m, nv, nv if m == 1 else 0, blocks, blocks, 1]
        self._slices = [slice(a, b) for a, b in pairwise(np.cumsum([0, *widths]).tolist())]
        self.size, self.q = sum(widths), self._slices[2]

    def pack(self, point: Point, into: Array) -> None:
        """Write a point."""
        y, ydot, q, G, g, bend, det, rcond, worst = self._slices
        into[y], into[ydot], into[q] = point.y, point.ydot, point.q
        into[G], into[g] = point.G.ravel(), point.g
        if point.curvature is not None:
            into[bend] = point.curvature
        elif self._m == 1:
            into[bend] = 0.0  # no loop: γ is linear
        if self._looped:
            into[det], into[rcond] = point.det, point.rcond
        into[worst] = point.conditioning

    def origin(self, point: Point) -> Array:
        """q where a point's charts have their origins, (nq,); other joints as they are."""
        q, groups = point.q.copy(), self._groups
        if groups is not None:
            q[groups.iq] = point.origin
        if self._charts is not None:
            q[self._in_charts] = _rest_of(point).origin
        return q

    def point(self, packed: Array, origin: Array | None = None) -> Point:
        """The point at the front of these numbers, in charts about q, or about another whole q."""
        flat = packed[: self.size].copy()  # the kernel writes its next point there
        y, ydot, q, G, g, bend, det, rcond, _ = self._slices
        one = np.ones(0)
        point = Point(
            flat[y],
            flat[ydot],
            flat[q],
            flat[G].reshape(self._nv, self._m),
            flat[g],
            flat[bend] if self._m == 1 and self._looped else None,
            flat[det] if self._looped else one,
            flat[rcond] if self._looped else one,
            float(flat[-1]),
        )
        origin = point.q if origin is None else origin  # so that w = 0 there
        if self._groups is not None:
            point = taken_apart(self._groups, point, origin[self._groups.iq])
        if self._charts is not None:
            _rest_of(point).origin = origin[self._in_charts]
        return point


def _rest_of(point: Point) -> Point:
    return point.rest if isinstance(point, GroupPoint) else point


IDLE = 2
"""Mechanisms in the kernel that are kept for the next runs, for one choice of rows of φ and of the state."""


def tracker_numbers(library: Library, handle: int | None) -> Array:
    """The present state of the trackers as plain numbers."""
    count = ctypes.c_int64()
    numbers = library.trackers(handle, ctypes.byref(count))
    return np.ctypeslib.as_array(numbers, (count.value,)).copy()  # the kernel writes over its own


class Trackers:
    """The trackers of the kernel's clusters as plain numbers, fetched when they are asked for."""

    def __init__(self, fetch: Callable[[], Array]) -> None:
        self._fetch: Callable[[], Array] | None = fetch
        self._numbers: Array = np.zeros(0)

    def __call__(self) -> Array:
        """See `maps.cluster.tracker_numbers`."""
        if self._fetch is not None:
            self._numbers, self._fetch = self._fetch(), None
        return self._numbers

    def __deepcopy__(self, memo: object) -> Trackers:
        """Itself, with the numbers, which do not change any more."""
        self()
        return self


class Handed:
    """Hands out trackers, and sees that the last ones are fetched while they are what they were.

    Parameters
    ----------
    fetch : callable () -> ndarray
        Their present numbers.
    """

    def __init__(self, fetch: Callable[[], Array]) -> None:
        self._fetch = fetch
        self._last: weakref.ref[Trackers] | None = None

    def new(self) -> Trackers:
        """The trackers as they are."""
        self.secure()
        trackers = Trackers(self._fetch)
        self._last = weakref.ref(trackers)  # what nobody keeps is never fetched
        return trackers

    def secure(self) -> None:
        """The kernel is about to go on."""
        last = None if self._last is None else self._last()
        if last is not None:
            last()


class Pool:
    """Addresses that nobody uses; they are freed with the pool, which lives as long as its mechanism.

    Parameters
    ----------
    library : Library
    """

    def __init__(self, library: Library) -> None:
        self._library = library
        self._idle: list[int] = []
        self._room = IDLE
        self.offsets: tuple[float, ...] = ()

    def take(self, offsets: tuple[float, ...]) -> int | None:
        """One that knows nothing of another motion, where there is one with these offsets."""
        if offsets != self.offsets:
            self._empty()
            self.offsets = offsets
        try:
            address = self._idle.pop()  # another thread may take the last one at any time
        except IndexError:
            return None
        self._library.renew(address)
        return address

    def give_back(self, address: int, offsets: tuple[float, ...]) -> None:
        """It is not used any more."""
        if len(self._idle) < self._room and offsets == self.offsets:
            self._idle.append(address)
        else:
            self._library.destroy(address)

    def __del__(self) -> None:
        """Free the kernel's memory; what comes back later is freed at once."""
        self._room = 0
        self._empty()

    def _empty(self) -> None:
        while self._idle:
            self._library.destroy(self._idle.pop())


class Handle:
    """A mechanism in the kernel; for one thread at a time.

    The collector calls the finalisers of a dead cycle in any order. What is left to others is therefore a
    plain number, and this finaliser the only one of a run that touches the kernel's memory.

    Parameters
    ----------
    library : Library
    mechanism : Mechanism
    path : RegularPath
        Its rows and blocks are taken over.
    works : bool
        Whether the state ends with the work done.
    driven : tuple of int
        Which of y are prescribed.

    Attributes
    ----------
    address : int
    handed : Handed
        Of its trackers.

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
        works: bool,
        driven: tuple[int, ...] = (),
    ) -> None:
        key = ("idle in the kernel", library, works, driven, *path.rows.tolist())
        self._pool = mechanism.memo.once(key, lambda: Pool(library))
        # `create` copies these, so one that was made at other offsets closes other loops
        self._offsets = tuple([c.offset for c in mechanism.closures if isinstance(c, MovingCoupling)])
        address = self._pool.take(self._offsets)
        if address is None:
            arrays = describe(mechanism, path, works, driven)
            why = ctypes.create_string_buffer(200)
            address = library.create(ctypes.byref(arrays.structure), why, len(why))
            if not address:
                raise NotNativeError(why.value.decode(errors="replace"))
        self.address: int = address
        self.handed = Handed(partial(tracker_numbers, library, address))

    def __del__(self) -> None:
        """Leave the kernel's memory to the next one."""
        if hasattr(self, "handed"):  # not where `__init__` raised
            self.handed.secure()
            self._pool.give_back(self.address, self._offsets)
