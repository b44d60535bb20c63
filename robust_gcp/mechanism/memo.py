"""What is worked out once for a mechanism and kept with it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")


class Memo:
    """Results by key, each made once, whatever thread asks first; they live as long as their owner.

    Copies and pickles start empty: what is kept here can be made again.
    """

    def __init__(self) -> None:
        self._known: dict[Hashable, Any] = {}
        self._lock = threading.RLock()

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """The result for this key; `make` is called where there is none yet."""
        if key not in self._known:
            with self._lock:
                if key not in self._known:  # another thread may have made it meanwhile
                    self._known[key] = make()
        found: T = self._known[key]
        return found

    def __contains__(self, key: Hashable) -> bool:
        """Whether it is known already."""
        return key in self._known

    def __reduce__(self) -> tuple[type[Memo], tuple[()]]:
        """An empty one."""
        return Memo, ()
