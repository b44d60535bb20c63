"""Mechanisms in the kernel's memory, kept with their mechanism for the next run."""

from __future__ import annotations

import ctypes
from functools import partial

from ..maps.regular_path import RegularPath
from ..mechanism.constraint.couplings import MovingCoupling
from ..mechanism.mechanism import Mechanism
from .batch import Handed
from .description import describe
from .library import Library
from .loop_arrays import NotNativeError
from .results import tracker_numbers

IDLE = 2
"""Mechanisms in the kernel that are kept for the next runs, for one choice of rows of φ and of the state."""


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
            address = self._idle.pop()
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
        if hasattr(self, "handed"):
            self.handed.secure()
            self._pool.give_back(self.address, self._offsets)
