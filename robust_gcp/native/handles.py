"""Mechanisms in the kernel's memory, kept with their mechanism for the next run."""

from __future__ import annotations

import ctypes

from ..maps.regular_path import RegularPath
from ..mechanism.mechanism import Mechanism
from .description import NotNativeError, describe
from .library import Library

IDLE = 2
"""Handles that are kept for the next runs of a mechanism with the same rows of φ."""


class Handle:
    """A mechanism in the kernel; for one thread at a time.

    Parameters
    ----------
    library : Library
    mechanism : Mechanism
    path : RegularPath
        Its rows and blocks are taken over.
    works : bool
        Whether the state ends with the work done.

    Attributes
    ----------
    address : int

    Raises
    ------
    NotNativeError
        When the kernel cannot take the mechanism.
    """

    def __init__(self, library: Library, mechanism: Mechanism, path: RegularPath, works: bool) -> None:
        arrays = describe(mechanism, path, works)
        why = ctypes.create_string_buffer(200)
        self._library = library
        self.address: int | None = library.create(ctypes.byref(arrays.structure), why, len(why))
        if not self.address:
            raise NotNativeError(why.value.decode(errors="replace"))

    def __del__(self) -> None:
        """Free the kernel's memory."""
        address = getattr(self, "address", None)
        if address:
            self._library.destroy(address)


class Handles:
    """Those of one mechanism that nobody uses, for one choice of rows and states.

    Parameters
    ----------
    library, mechanism, path, works
        See `Handle`.
    """

    def __init__(self, library: Library, mechanism: Mechanism, path: RegularPath, works: bool) -> None:
        self._library, self._what = library, (mechanism, path, works)
        key = ("idle in the kernel", library, works, *path.rows.tolist())
        self._idle: list[Handle] = mechanism.memo.once(key, list)

    def take(self) -> Handle:
        """One that knows nothing of another motion."""
        try:
            handle = self._idle.pop()
        except IndexError:
            return Handle(self._library, *self._what)
        self._library.renew(handle.address)
        return handle

    def give_back(self, handle: Handle) -> None:
        """It is not used any more."""
        if len(self._idle) < IDLE:
            self._idle.append(handle)
