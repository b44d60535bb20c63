"""The compiled derivatives of a mechanism, made once."""

from __future__ import annotations

import threading

from ..errors import PerformanceWarning, RobustGcpError
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..warning import warn
from .derivation import Derivation
from .library import library
from .loop_arrays import NotNativeError


class _Made(threading.local):
    """One `Derivation` a thread; None where the kernel does not take the mechanism."""

    found: Derivation | None = None
    asked = False


def derivation(mechanism: Mechanism, q: Array) -> Derivation | None:
    """The compiled derivatives of a mechanism; None where the reference is to do the work.

    Whoever asks in this thread has the same one: steps that were taken are there until someone takes others.

    Parameters
    ----------
    q : ndarray (nq,)
        A state's configuration.
    """
    made: _Made = mechanism.memo.once("compiled derivatives", _Made)
    if not made.asked:
        try:
            made.found = own_derivation(mechanism, q)
        except RobustGcpError:  # no regular start: the reference says what is wrong, and others may serve
            return None
        made.asked = True
    return made.found


def own_derivation(mechanism: Mechanism, q: Array) -> Derivation | None:
    """The same for the caller alone, whose steps stay as they are whatever others take.

    Raises
    ------
    RobustGcpError
        Where q is no regular state to begin with.
    """
    kernel, applied = library(), mechanism.applied
    if kernel is None:
        return None
    reason = (
        "it knows no slopes of forces of one's own and of springs along tendons; as torque functions it does"
    )
    try:
        if applied is None or applied.has_slopes:
            return Derivation(kernel, mechanism, q)
    except NotNativeError as error:
        reason = f"{error}; spell it as simple joints"
    warn(
        f"the compiled kernel does not take derivatives and single steps of {mechanism.name or 'a mechanism'}"
        f": {reason}. The Python reference takes 20 to 200 times as long",
        PerformanceWarning,
    )
    return None
