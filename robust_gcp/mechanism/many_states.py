"""Functions of one state that take many."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from ..checks import is_table, of_each
from ..errors import StateError
from .tree.tree import Array

Method = TypeVar("Method", bound=Callable[..., Array])


def at_each(method: Method) -> Method:
    """A method of a configuration (nq,) and more that also takes arrays (N, nq), …, and gives N first.

    Raises
    ------
    StateError
        As the method, of the first row that it is at fault with, by number; for arrays of other lengths.
    """
    signature = inspect.signature(method)

    @functools.wraps(method)
    def one_or_many(self: Any, q: Any, *more: Any, **named: Any) -> Array:
        if named:
            more = signature.bind(self, q, *more, **named).args[2:]
        if not is_table(q):
            return method(self, q, *more)
        if any(not is_table(part) or len(part) != len(q) for part in more):
            raise StateError(
                f"{method.__name__}: q has {len(q)} rows, and what is given beside it has others"
            )
        return of_each(functools.partial(method, self), zip(q, *more, strict=True))

    return one_or_many  # type: ignore[return-value]
