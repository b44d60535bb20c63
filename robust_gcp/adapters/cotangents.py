"""What a framework asks for of a function of states: values, derivatives that are kept, cotangents.

A state is (q, v). Its independent entries y of q and u of v are the arguments of these functions; the others
say which assembly is meant: loops are closed from there with y held, and v = G u. So slopes by dependent
entries are zero, and what a framework sends back along dependent entries of a result goes to the independent
ones by q = γ(y), v = G(y) u.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..checks import check_mechanism, check_whole
from ..errors import ModelError, StateError
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array

Shapes = tuple[tuple[int, ...], ...]
Arrays = tuple[Array, ...]


class Exact(ABC):
    """A function of q (..., nq), v (..., nv) and τ, the last axes those of one state, with its derivatives.

    Parameters
    ----------
    mechanism : Mechanism
    threads : int
        On which the states of a call are shared out.
    name : str
        Of the function, for errors.

    Attributes
    ----------
    arguments, results, kept : tuple of tuple of int
        Shapes at one state: of the arguments, the results, and what `pulled` needs besides cotangents.
    """

    arguments: Shapes
    results: Shapes
    kept: Shapes

    def __init__(self, mechanism: Mechanism, threads: int, name: str) -> None:
        check_mechanism(mechanism, Mechanism, name)
        check_whole("threads", threads, 1)
        if mechanism.chart_joints:
            raise ModelError(
                f"{name}: joint {mechanism.chart_joints[0].name!r} has independent velocities that are the "
                "rates of no numbers in q; choose other independent joints"
            )
        self.mechanism, self.threads, self.name = mechanism, threads, name

    def evaluated(self, *given: Array) -> Arrays:
        """The results."""
        return self._by_rows(self._evaluated, self.arguments, given)

    def linearised(self, *given: Array) -> Arrays:
        """The results, and what is kept for `pulled`."""
        return self._by_rows(self._linearised, self.arguments, given)

    def pulled(self, *given: Array) -> Arrays:
        """Cotangents of the arguments by what was kept and cotangents of the results."""
        return self._by_rows(self._pulled, self.kept + self.results, given)

    def lead(self, shapes: Shapes) -> tuple[int, ...]:
        """The axes before those of one state, by the shapes of the arguments, which are broadcast.

        Raises
        ------
        StateError
            For shapes that do not fit.
        """
        for name, wanted, found in zip(("q", "v", "tau"), self.arguments, shapes, strict=True):
            if found[max(0, len(found) - len(wanted)) :] != wanted:
                raise StateError(f"{self.name}: {name} is {found}, and must be {('...', *wanted)}")
        leads = [s[: len(s) - len(w)] for s, w in zip(shapes, self.arguments, strict=True)]
        try:
            return np.broadcast_shapes(*leads)
        except ValueError as error:
            told = ", ".join(map(str, leads))
            raise StateError(f"{self.name}: q, v, tau of {told} states do not go together") from error

    def _by_rows(self, function: Callable[..., Arrays], shapes: Shapes, given: Arrays) -> Arrays:
        """A function of N rows at arrays with any axes before those of a row."""
        lead = given[0].shape[: np.ndim(given[0]) - len(shapes[0])]
        count = int(np.prod(lead))
        rows = [np.asarray(x, dtype=float).reshape(count, *s) for x, s in zip(given, shapes, strict=True)]
        if self.threads == 1 or count < 2 * self.threads:
            found = function(*rows)
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                shared = zip(*(np.array_split(x, self.threads) for x in rows), strict=True)
                parts = pool.map(lambda part: function(*part), shared)
                found = tuple(np.concatenate(part) for part in zip(*parts, strict=True))
        return tuple(part.reshape(*lead, *part.shape[1:]) for part in found)

    @abstractmethod
    def _evaluated(self, q: Array, v: Array, tau: Array) -> Arrays: ...

    @abstractmethod
    def _linearised(self, q: Array, v: Array, tau: Array) -> Arrays: ...

    @abstractmethod
    def _pulled(self, *given: Array) -> Arrays: ...
