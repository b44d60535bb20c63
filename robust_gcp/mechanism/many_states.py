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


def at_each(*shape: str) -> Callable[[Method], Method]:
    """Makes a method of a configuration (nq,) and more take arrays (N, nq), … too; it gives N first.

    Parameters
    ----------
    *shape : str
        The sizes of what it gives, as attributes of its object.

    Raises
    ------
    StateError
        As the method, of the first row that it is at fault with, by number; for arrays of other lengths.
    """

    def made(method: Method) -> Method:
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
            sizes = (int(getattr(self, size)) for size in shape)
            return of_each(functools.partial(method, self), zip(q, *more, strict=True), *sizes)

        return one_or_many  # type: ignore[return-value]

    return made
