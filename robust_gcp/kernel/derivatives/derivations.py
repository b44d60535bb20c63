"""The compiled derivatives of a mechanism, made once."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np

from ...dynamics.problem import Problem, initial_value_problem
from ...errors import PerformanceWarning, RobustGcpError, SingularStartError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..library import library
from ..loop_arrays import NotNativeError
from .step_derivatives import Derivation

BESIDE = 0.02
"""How far from a singular place rows of φ are chosen, dimensionless."""


# A derivation's memory in the kernel is for one thread at a time.
class _Made(threading.local):
    """One `Derivation` a thread; None where the kernel does not take the mechanism."""

    found: Derivation | None = None
    asked = False


def derivation(
    mechanism: Mechanism, q: Array, v: Array | None = None, mode: Array | None = None
) -> Derivation | None:
    """The compiled derivatives of a mechanism; None where the reference is to do the work.

    Whoever asks in this thread has the same one: steps that were taken are there until someone takes others.

    Parameters
    ----------
    q : ndarray (nq,)
        A state's configuration.
    v, mode : ndarray (nv,), (nv, m), optional
        The state's velocity, and the mode that it is on, which serve where q is singular.
    """
    made: _Made = mechanism.memo.once("compiled derivatives", _Made)
    if not made.asked:
        try:
            made.found = own_derivation(mechanism, q, v, mode)
        except RobustGcpError:  # no start: the reference says what is wrong, and others may serve
            return None
        made.asked = True
    return made.found


def own_derivation(
    mechanism: Mechanism,
    q: Array,
    v: Array | None = None,
    mode: Array | None = None,
    driven: Sequence[int] = (),
) -> Derivation | None:
    """The same for the caller alone, whose steps stay as they are whatever others take.

    Parameters
    ----------
    driven : sequence of int
        Which of y move as prescribed.

    Raises
    ------
    RobustGcpError
        Where this is no state to begin with, and none was known before.
    """
    kernel, applied = library(), mechanism.applied
    if kernel is None:
        return None
    reason = (
        "it knows no slopes of forces of one's own and of springs along tendons; as torque functions it does"
    )
    try:
        # one choice of rows of φ, whichever state asks first
        if applied is None or applied.has_slopes:
            path = mechanism.memo.once(
                "regular path of derivatives", lambda: _begun(mechanism, q, v, mode).explicit.path
            )
            return Derivation(kernel, mechanism, path, driven)
    except NotNativeError as error:
        reason = f"{error}; spell it as simple joints"
    warn(
        f"the compiled kernel does not take derivatives and single steps of {mechanism.name or 'a mechanism'}"
        f": {reason}. The Python reference takes 20 to 200 times as long",
        PerformanceWarning,
    )
    return None


BESIDE_SINGULAR = (
    "some states are beside singular configurations or where the independent joints turn back, where no "
    "series of the mode is known to it; start or choose joints so that they are not"
)
"""Why the kernel leaves states of a mechanism that it takes."""


def left_to_python(mechanism: Mechanism, what: str, why: str | None = None) -> None:
    """Warn, once for a mechanism, that the reference does some of what the kernel has derivatives for.

    Where the kernel is not there, or has none of the mechanism, that was told already.
    """
    made: _Made = mechanism.memo.once("compiled derivatives", _Made)
    told: set[str] = mechanism.memo.once("left to Python", set)
    if library() is None or (made.asked and made.found is None) or what in told:
        return
    told.add(what)
    if why is None and mechanism.chart_joints:
        why = f"velocities of {mechanism.chart_joints[0].name} are independent that are rates of no numbers"
        why += "; choose other independent joints"
    warn(
        f"the compiled kernel does not take {what} of {mechanism.name or 'a mechanism'} everywhere: "
        f"{why or BESIDE_SINGULAR}. There the Python reference takes 20 to 600 times as long",
        PerformanceWarning,
    )


def _begun(mechanism: Mechanism, q: Array, v: Array | None, mode: Array | None) -> Problem:
    """A motion from q where that is regular, else from beside it on the mode of a state there."""
    try:
        return initial_value_problem(mechanism, q)
    except SingularStartError:
        if mode is None and (v is None or not np.any(v)):
            raise
    explicit = initial_value_problem(mechanism, q, v, mode).explicit
    aside = BESIDE * mechanism.units[mechanism.iv_independent]
    return initial_value_problem(
        mechanism, explicit.point_at(explicit.anchor.y + aside, np.zeros(mechanism.m)).q
    )
