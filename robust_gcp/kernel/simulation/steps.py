"""The regular steps of a run, taken by the compiled kernel; everything rare stays with the run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...dynamics.equations import Evaluation, Torque, does_work, is_asked, torque_function
from ...dynamics.prescribed.drive import Drive
from ...dynamics.problem import Problem
from ...dynamics.tableau import Tableau
from ...errors import OptionError, PerformanceWarning
from ...maps.choice import MapChoice
from ...maps.classical import DIGITS_LOST
from ...maps.cluster.options import BridgeOptions
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..description import follows_zones
from ..library import Library, kernel_or_reason, library
from ..loop_arrays import NotNativeError
from .batch import Batch, Looked, Outputs, Within
from .guard import ErrorControl, Guard, Watch
from .prepared import Prepared
from .rates import Rates
from .workspace import Workspace

BACKENDS = ("auto", "python", "native")

BATCH = 20_000
"""Steps of a batch times velocities: some 20 ms, so that an interrupt or a progress bar need not wait."""


def chosen_library(backend: str, method: str, newton_start: str) -> Library | None:
    """The kernel for these choices, or None where Python is to do the work.

    Raises
    ------
    OptionError
        For backend="native" where the kernel is not there or does not know the method.
    """
    if backend == "python":
        return None
    why = None
    if method not in ("bridge", "classical"):
        why = f'it knows the methods "bridge" and "classical", not {method!r}'
    elif method == "classical" and newton_start != "tangent":
        why = f'with method="classical" it knows newton_start="tangent", not {newton_start!r}'
    if backend == "auto":
        return library() if why is None else None
    found, why = kernel_or_reason() if why is None else (None, why)
    if found is None:
        raise OptionError(f'backend="native": {why}; use backend="auto" or "python"')
    return found


class NativeSteps:
    """Takes a run's steps in the kernel as long as nothing rare happens.

    Parameters
    ----------
    library : Library
    torque : callable, array_like or None
    required : bool
        Whether a mechanism that the kernel cannot take is an error.
    drive, tableau, guard : Drive, Tableau, Guard, optional
        See `Workspace`.

    Attributes
    ----------
    asks : bool
        Whether a function of the user's is asked for the torque.
    """

    def __init__(
        self,
        library: Library,
        torque: Torque | ArrayLike | None,
        required: bool,
        drive: Drive | None = None,
        tableau: Tableau | None = None,
        guard: Guard | None = None,
    ) -> None:
        self._library, self._torque, self._required = library, torque, required
        self.asks = is_asked(torque)
        self._taken = drive, tableau, guard
        self._drive = drive
        self._path: RegularPath | None = None
        self._first = True
        self._workspace: Workspace | None = None

    def prepare(self, mechanism: Mechanism, path: RegularPath) -> Workspace | None:
        """The workspace for this path; None where the kernel cannot take the mechanism.

        Raises
        ------
        OptionError
            In that case, if the kernel is required and these are the coordinates that the run begins in.
        """
        if self._path is not path:
            torque = torque_function(mechanism, self._torque) if callable(self._torque) else self._torque
            works = does_work(mechanism, self._torque) or self._drive is not None
            self._path, self._first = path, self._path is None
            try:
                self._workspace = Workspace(self._library, mechanism, path, torque, works, *self._taken)
            except NotNativeError as error:
                self._workspace = None
                if self._required and self._first:
                    raise OptionError(
                        f'backend="native": {error}, which the compiled kernel does not know; '
                        'use backend="auto" or "python"'
                    ) from error
                if self._first:
                    warn(
                        f"the compiled kernel does not take {mechanism.name or 'a mechanism'}: {error}; "
                        "spell it as simple joints. Python's steps take 20 to 200 times as long; "
                        'backend="python" asks for them without this warning',
                        PerformanceWarning,
                    )
        return self._workspace

    def release(self) -> None:
        """Give the kernel's memory back, whoever still holds these steps, such as an error's traceback."""
        self._path = self._workspace = None

    def look(self, motion: Problem, now: Evaluation, x: Array, t: float) -> Evaluation | None:
        """An evaluation at x under the torque that is held now; None where Python has to look."""
        # the kernel looks at its own last state, so that has to be this one
        if self._workspace is None or now.point is not self._workspace.latest:
            begun = self.take(motion, now, x, np.array([t]), ())  # no step, but the kernel is there
            if begun is None:
                return None
            now = begun.now
        return None if self._workspace is None else self._workspace.look(t, now)

    def take(
        self,
        motion: Problem,
        now: Evaluation,
        x: Array,
        times: Array,
        wanted: Sequence[str],
        watch: Watch | None = None,
        best: float = 0.0,
        control: ErrorControl | None = None,
        within: tuple[Array, NDArray[np.int64]] | None = None,
        looked: Looked | None = None,
    ) -> Batch | None:
        """Steps from times[0] as far as nothing rare happens; None where Python has to take them.

        Parameters
        ----------
        now, x : Evaluation, ndarray
            The evaluation and the state at times[0].
        wanted : sequence of str
            Outputs besides q and v.
        watch, best, control, looked : Watch, float, ErrorControl, Looked, optional
            See `Workspace.run`.
        within : (ndarray (k,), ndarray of int (N + 1,)), optional
            Times of outputs within the steps, and how many of them come before each of `times`. Where the
            kernel does not take them, the steps end before one that has some, or are that one.
        """
        workspace, trackers = self._at(motion)
        if workspace is None:
            return None
        options, zone = limits_of(motion.choice)
        mechanism = motion.mechanism
        n = min(len(times) - 1, most_steps(mechanism))
        driven, prescribed = 0, None
        if self._drive is not None:
            driven = len(self._drive.names)
            prescribed = self._drive.stages(times[: n + 1], workspace.shares)
            if len(prescribed) < min(2, n + 1):  # not even the first step: Python tells what is wrong in it
                return None
            n = len(prescribed) - 1  # as far as the drive could be asked
        sizes, inside = (mechanism.nq, mechanism.nv, wanted, driven), None
        if within is not None and workspace.looks_within and control is None:  # with it steps end elsewhere
            before = within[1][: n + 1]
            at = within[0][: before[-1]]
            told = None if self._drive is None else self._drive.stages(at, (0.0,))
            if told is None or len(told) == len(at):
                inside = Within(at, before, Outputs.room(len(at), *sizes), told)
        if within is not None and inside is None:
            n = min(n, max(1, int(np.searchsorted(within[1], 0, side="right")) - 1))
        outputs = Outputs.room(n, *sizes)
        outputs = outputs if inside is None else replace(outputs, within=inside)
        limits = zone, options, trackers, watch, best, prescribed, control, looked
        return workspace.run(times[: n + 1], x, now, outputs, *limits)

    def prepared(
        self,
        motion: Problem,
        now: Evaluation,
        times: Array,
        outputs: Outputs,
        watch: Watch | None = None,
        best: float = 0.0,
        looked: Callable[[float], bool] | None = None,
    ) -> Prepared | None:
        """Steps to come from where the kernel is, see `Workspace.prepared`; None where it is not at `now`."""
        if self._workspace is None or now.point is not self._workspace.latest:
            return None
        options, zone = limits_of(motion.choice)
        return self._workspace.prepared(times, outputs, zone, options, watch, best, looked)

    def rates(self, motion: Problem, now: Evaluation, x: Array, watch: Watch | None) -> Rates | None:
        """ẋ by the kernel from an evaluation at x on; None where it cannot."""
        workspace, trackers = self._at(motion)
        if workspace is None:
            return None
        options, zone = limits_of(motion.choice)
        return workspace.rates(now, x, zone, options, watch, trackers)

    def _at(self, motion: Problem) -> tuple[Workspace | None, Callable[[], Array] | None]:
        """The workspace where a motion is, None where the kernel cannot go on; and trackers in a zone."""
        trackers = motion.trackers
        if trackers is not None and not follows_zones(motion.path):
            return None, None
        return self.prepare(motion.mechanism, motion.path), trackers

    def settled(self, begun: int, reached: int) -> Batch:
        """What prepared steps came to; see `Workspace.settled`."""
        assert self._workspace is not None  # it prepared them
        return self._workspace.settled(begun, reached)


def most_steps(mechanism: Mechanism) -> int:
    """Steps that are taken at once."""
    return max(1, BATCH // mechanism.nv)


def limits_of(choice: MapChoice) -> tuple[BridgeOptions | None, float]:
    """The choices of the bridges, and the conditioning at which the regular path ends."""
    return (choice.options, choice.options.zone) if choice.method == "bridge" else (None, DIGITS_LOST)
