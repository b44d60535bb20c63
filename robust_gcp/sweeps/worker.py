"""One run of a sweep, wherever it is computed: in this process, in a thread, or in a worker process."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..errors import OptionError, RobustGcpError
from ..mechanism.folders.loader import load
from ..mechanism.mechanism import Mechanism
from ..simulation.simulate import simulate
from ..simulation.trajectory import Trajectory
from .record import Failure, summary

Build = str | Path | Mechanism | Callable[..., Mechanism]
Keep = Literal["summary", "trajectory"] | Callable[[Trajectory], Any]

OPTIONS = frozenset(inspect.signature(simulate).parameters) - {"mechanism", "progress"}
"""Parameters of a run that go to `simulate`; all others go to `build`."""


@dataclass(frozen=True)
class Outcome:
    """What a run came to; see `RunRecord`."""

    summary: dict[str, Any] | None = None
    kept: Any = None
    failure: Failure | None = None


class CancelledRunError(Exception):
    """The sweep was given up while this run was under way."""


def work(
    build: Build,
    keep: Keep,
    parameters: Mapping[str, Any],
    cancelled: Callable[[], bool] | None = None,
) -> Outcome:
    """Build, simulate, summarise; every error becomes a `Failure`.

    Parameters
    ----------
    cancelled : callable, optional
        Asked after each output; True ends the run.
    """

    def watch(fraction: float) -> None:
        if cancelled is not None and cancelled():
            raise CancelledRunError("the sweep was given up")

    try:
        mechanism = _mechanism(build, {k: v for k, v in parameters.items() if k not in OPTIONS})
        options = {k: v for k, v in parameters.items() if k in OPTIONS}
        trajectory = simulate(mechanism, **options, progress=watch)
        return Outcome(summary(trajectory), _kept(keep, trajectory))
    except Exception as error:
        return _failed(error, keep)


def _mechanism(build: Build, parameters: dict[str, Any]) -> Mechanism:
    """A mechanism of this run's own: its workspace must not be shared between threads."""
    if isinstance(build, Mechanism):
        return copy.copy(build)
    if isinstance(build, str | Path):
        return load(build)
    made: object = build(**parameters)
    if not isinstance(made, Mechanism):
        raise OptionError(f"build must return a Mechanism, not {type(made).__name__}")
    if threading.current_thread() is threading.main_thread():
        return made
    return copy.copy(made)  # the function may give the same one to another thread


def _kept(keep: Keep, trajectory: Trajectory) -> Any:
    if keep == "summary":
        return None
    return trajectory if keep == "trajectory" else keep(trajectory)


def _failed(error: Exception, keep: Keep) -> Outcome:
    ours = isinstance(error, RobustGcpError)
    trace = "" if ours else "".join(traceback.format_exception(error))
    failure = Failure(type(error).__name__, str(error), ours, trace)
    partial = error.trajectory if isinstance(error, RobustGcpError) else None
    if partial is None:
        return Outcome(failure=failure)
    return Outcome(summary(partial), partial if keep == "trajectory" else None, failure)


# --------------------------------------------------------------------------- worker processes

_given_up: Any = None  # the event of the sweep that this worker process belongs to


def begin(given_up: Any) -> None:
    """Prepare a worker process: Ctrl-C is the parent's affair, and without a parent it ends."""
    global _given_up
    _given_up = given_up
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def ready(task: bytes) -> str:
    """Unpickle build and keep; returns what is wrong with them here, in words."""
    try:
        pickle.loads(task)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def work_pickled(task: bytes) -> Outcome:
    """`work` on pickled (build, keep, parameters)."""
    build, keep, parameters = pickle.loads(task)
    return work(build, keep, parameters, None if _given_up is None else _given_up.is_set)
