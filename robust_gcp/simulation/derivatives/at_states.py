"""States that equations of motion are asked at, one or many, and what acts there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import at_row, check_whole, checked_rows, is_table
from ...dynamics.equations import TorqueFunction, called_torque
from ...dynamics.loads import Torques, Wrench, one_torque
from ...kernel.derivatives.derivations import derivation
from ...kernel.derivatives.step_derivatives import Derivation
from ...maps.start_check import by_number, checked_mode
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import DETERMINES
from ...mechanism.tree.tree import Array

Found = TypeVar("Found")


@dataclass(frozen=True)
class AtStates:
    """N states, and torques at them.

    Attributes
    ----------
    q, v : ndarray (N, nq), (N, nv)
    given : tuple of (tau, wrenches)
        What acts besides the mechanism's own forces, as the user gave it, at each.
    tau : ndarray (N, nv) or None
        The same where it is no function.
    function : TorqueFunction or None
        The same where it is one.
    one : bool
        Whether a single state was given, not as a row.
    rows : ndarray of int (N,)
        Which of the rows that the user gave they are.
    mode : ndarray (nv, m) or None
        Tangent of the mode that all of them are on, where it was named.
    """

    mechanism: Mechanism
    q: Array
    v: Array
    given: tuple[Any, Sequence[Wrench]]
    tau: Array | None
    function: TorqueFunction | None
    one: bool
    rows: NDArray[np.intp]
    mode: Array | None = None

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        q: ArrayLike,
        v: ArrayLike | None,
        tau: Torques | None,
        wrenches: Sequence[Wrench] = (),
        mode: ArrayLike | None = None,
    ) -> AtStates:
        """What a user gave, checked.

        Raises
        ------
        StateError, OptionError, ModelError
            For what are no states, loads or mode.
        """
        one = not is_table(q)
        if one:
            states = mechanism.configuration(q)[None]
            fast = np.zeros((1, mechanism.nv)) if v is None else mechanism.velocity(v)[None]
        else:
            states = checked_rows(q, None, mechanism.nq, "q", "nq")
            shape = len(states), mechanism.nv
            fast = np.zeros(shape) if v is None else checked_rows(v, *shape, "v", "nv")
        table = None
        if not one and not callable(tau) and is_table(tau):
            table = checked_rows(tau, len(states), mechanism.nv, "tau", "nv")  # type: ignore[arg-type]
        acts = one_torque(mechanism, None if table is not None else tau, wrenches)
        function = called_torque(mechanism, acts)
        held = table
        if acts is not None and function is None:
            held = np.tile(np.asarray(acts, dtype=float), (len(states), 1))
        given = (tau if table is None else table), wrenches
        # all are on one mode: a number is one of the first state's
        mode = by_number(mechanism, states[0], mode) if len(states) else mode
        along = None if mode is None else checked_mode(mechanism, mode)
        return cls(mechanism, states, fast, given, held, function, one, np.arange(len(states)), along)

    def __len__(self) -> int:
        return len(self.q)

    def naming(self, i: int) -> AbstractContextManager[None]:
        """Errors in this context name the state, where it is one of many."""
        return nullcontext() if self.one else at_row(int(self.rows[i]))

    def torque_at(self, i: int) -> Any:
        """What acts at a state, without the wrenches."""
        tau = self.given[0]
        return tau[i] if isinstance(tau, np.ndarray) and tau.ndim == 2 else tau

    def total(self, t: float) -> Array | None:
        """All that acts, at a time, (N, nv)."""
        if self.function is None:
            return self.tau
        # copies: what is no code of ours may write into what it gets
        found = self.function.over(np.full(len(self.q), t), self.q.copy(), self.v.copy())
        return found if self.tau is None else found + self.tau

    def some(self, which: Any) -> AtStates:
        """Some of the states."""
        tau, wrenches = self.given
        if isinstance(tau, np.ndarray) and tau.ndim == 2:
            tau = tau[which]
        held = None if self.tau is None else self.tau[which]
        rows = self.rows[which]
        return replace(self, q=self.q[which], v=self.v[which], given=(tau, wrenches), tau=held, rows=rows)

    def kernel(self) -> Derivation | None:
        """What answers compiled in this thread; None where nothing does."""
        mode, mechanism = self.mode, self.mechanism
        if not len(self.q):
            return None
        if mode is not None and mechanism.m:
            own = mode[mechanism.iv_independent]
            # y rests along this mode: no G leads from y to its tangent, and the reference says so
            if np.linalg.svd(own, compute_uv=False)[-1] <= DETERMINES * np.linalg.norm(mode):
                return None
        return derivation(mechanism, mechanism.configuration(self.q[0]), self.v[0], mode)


def on_threads(
    states: AtStates, threads: int, ask: Callable[[AtStates], Found], join: Callable[[list[Found]], Found]
) -> Found:
    """Ask for parts of many states on threads, and join what was found.

    Raises
    ------
    OptionError
        For what is no number of threads.
    """
    check_whole("threads", threads, 1)
    if threads == 1 or len(states) < 2 * threads:
        return ask(states)
    ends = np.linspace(0, len(states), threads + 1).astype(int)
    parts = [states.some(slice(a, b)) for a, b in pairwise(ends)]
    from concurrent.futures import ThreadPoolExecutor  # what asks on one thread need not load it

    with ThreadPoolExecutor(threads) as pool:
        return join(list(pool.map(ask, parts)))
