"""Who takes part in a report: methods of ours, and the other tools that are installed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .. import OptionError
from ..mechanism.tree.tree import Array
from . import peers
from .contender import Contender, Scene
from .work_precision import ours


def tools(
    exact: Callable[[Scene], Array], wanted: Sequence[str] = (), own: Sequence[str] | None = None
) -> list[Contender]:
    """Those whose name or family contains one of the words; all where there is none.

    Parameters
    ----------
    exact : callable (Scene) -> ndarray (n, nq)
        A scene's exact q, which gains are scanned by.
    own : sequence of str, optional
        Names of those of ours that take part; all when left out.

    Raises
    ------
    OptionError
        Where the words fit none.
    """
    mine = [c for c in ours.contenders(exact) if own is None or c.name in own]
    everyone = [*mine, *peers.contenders(exact)]
    words = [word.lower() for word in wanted]
    named = [(f"{c.name}\n{c.family}".lower(), c) for c in everyone]
    found = [c for name, c in named if not words or any(word in name for word in words)]
    if not found:
        names = ", ".join(c.name for c in everyone)
        raise OptionError(f"--method {' '.join(wanted)} fits none of {names}")
    return found
