"""`simulate_many`: one mechanism from many starts, on threads, without Python between the steps."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_mechanism, check_whole, listed, shown
from ...dynamics.equations import does_work
from ...dynamics.loads import Torques, one_torque
from ...dynamics.problem import initial_value_problem
from ...errors import OptionError, RobustGcpError
from ...kernel.library import Library
from ...kernel.loop_arrays import NotNativeError
from ...kernel.simulation.batch import Outputs, count_in
from ...kernel.simulation.steps import chosen_library
from ...kernel.simulation.workspace import Workspace
from ...kernel.structures import Reason
from ...maps.cluster.options import USUAL
from ...maps.explicit import Crossing
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import NEARLY_CLOSED
from ...mechanism.tree.tree import Array
from ..runs.initial_state import closed_by_kernel, state_given
from ..runs.schedule import planned
from ..runs.stats import Stats
from ..runs.too_long_steps import Coarse
from ..simulate import checked_record, simulate
from ..trajectories.acted import Acted
from ..trajectories.trajectory import Trajectory
from .compiled_steps import together
from .runs import Runs

Start = tuple[ArrayLike | None, ArrayLike | None]
"""q0 and v0 as `simulate` takes them."""

NATIVE_RECORDS = ("a", "energy")
"""What a start can record without Python between its steps."""

STRETCH = 1_000_000
"""Steps times velocities that go to the kernel at once: below a second, so that an interrupt is answered."""

LOOKS = 9
"""Outputs at which all rows of φ are looked at where some are redundant."""

FIRST = 3
"""Starts that are tried for one from which the kernel can begin."""


def simulate_many(
    mechanism: Mechanism,
    starts: Iterable[Start],
    duration: float | None = None,
    step: float | None = None,
    *,
    threads: int | None = None,
    torque: Torques | None = None,
    record: Sequence[str] = (),
    torques: Sequence[Torques | None] | None = None,
) -> Runs:
    """Simulate a mechanism from many starts by RK4, the same motions as `simulate` gives one by one.

    In the compiled kernel each start is closed, checked and stepped to its end without Python, on as many
    threads as there are processors; many that stay on regular ground go side by side, by steps compiled for
    the mechanism where there is a compiler (equal to 1e-13). A start that is not plain (singular, in
    coordinates that do not serve to the end, or with a velocity that the loops do not allow) is left to
    `simulate`, and so are all where there is no kernel, `torque` is a function, or the mechanism's file has
    stops, dry friction or joints that move the ground.

    Parameters
    ----------
    mechanism : Mechanism
    starts : iterable of (q0, v0)
        As in `simulate`, None for what is left out there.
    duration, step : float, optional
        s, as in `simulate`. Whether the step suits the mechanism is told at the first start only.
    threads : int, optional
        The number of processors when left out.
    torque : callable (t, q, v) -> (nv,), array_like (nv,) or mapping, optional
        On every start. A function is called by all threads, one at a time in Python.
    record : sequence of {"a", "energy", "multipliers"}
    torques : sequence, optional
        One for each start, in place of `torque`.

    Returns
    -------
    Runs
        A trajectory for each start, and the errors by start: none is lost, none stops the others.

    Raises
    ------
    OptionError
        For bad arguments.

    Examples
    --------
    >>> import robust_gcp as rg
    >>> mech = rg.load("crank_rocker")
    >>> runs = rg.simulate_many(mech, [(None, mech.lift(mech.home, [w])) for w in (1.0, 2.0)], duration=0.1)
    >>> [f"{run['q1'][-1]:.3f}" for run in runs], runs.errors
    (['1.075', '1.170'], {})
    """
    check_mechanism(mechanism, Mechanism, "simulate_many")
    pairs = listed(starts, "starts", "(q0, v0) pairs", OptionError, ())
    given = [_checked(i, pair) for i, pair in enumerate(pairs)]
    count = (os.cpu_count() or 1) if threads is None else threads
    check_whole("threads", count, 1)
    each = _each(torque, torques, len(given))
    applied, record = one_torque(mechanism, torque), checked_record(record)
    schedule, step = planned(0.0, *mechanism.recommended.run(duration, step), None, True)
    options: dict[str, Any] = {"duration": float(schedule.times[-1]), "step": step}
    options["record"] = record
    trajectories: list[Trajectory | None] = [None] * len(given)
    runs = Runs(trajectories)
    if not given:
        return runs
    given_up, plain = threading.Event(), None
    simple = torques is None and not (mechanism.parts or mechanism.moved or set(record) - {*NATIVE_RECORDS})
    if simple and not callable(applied):
        library = chosen_library("auto", "bridge", "tangent")
        path = None if library is None else _found(mechanism, given, applied)
        if library is not None and path is not None:
            with suppress(NotNativeError):
                plain = _Plain(mechanism, library, path, applied, schedule.times, record, step, given_up)

    def one(i: int) -> None:
        if given_up.is_set():
            return
        q0, v0 = given[i]
        try:
            # the first one with all that simulate checks and warns of
            run = plain.run(q0, v0) if plain is not None and i > 0 else None
            trajectories[i] = run or simulate(mechanism, q0, v0, torque=each[i], **options)
        except RobustGcpError as error:
            runs.errors[i], trajectories[i] = error, error.trajectory

    one(0)
    left = set(range(1, len(given)))
    pool = ThreadPoolExecutor(min(count, len(given)), "robust_gcp simulate_many")
    try:
        if plain is not None:
            for i, run in plain.together([(i, *given[i]) for i in sorted(left)], count, pool):
                trajectories[i] = run
                left.discard(i)
        for future in [pool.submit(one, i) for i in sorted(left)]:
            future.result()
    finally:
        given_up.set()  # what runs on threads cannot be cancelled, and looks at this
        pool.shutdown(wait=True, cancel_futures=True)
    return runs


def _each(torque: Torques | None, torques: Any, count: int) -> list[Torques | None]:
    """The torque on each start."""
    if torques is None:
        return [torque] * count
    if torque is not None:
        raise OptionError("simulate_many: give torque=, on every start, or torques=, one for each, not both")
    found = listed(torques, "torques", "torques as simulate takes them, one for each start", OptionError)
    if len(found) != count:
        raise OptionError(f"torques: {len(found)} are given for {count} starts; give one for each")
    return found


def _checked(i: int, start: Any) -> Start:
    if not isinstance(start, tuple) or len(start) != 2:
        raise OptionError(f"starts[{i}] = {shown(start)} must be a tuple (q0, v0), None for what is left out")
    return start


def _found(mechanism: Mechanism, starts: Sequence[Start], torque: ArrayLike | None) -> RegularPath | None:
    """The regular path of the first start that has one."""
    for q0, v0 in starts[:FIRST]:
        with suppress(RobustGcpError):
            return initial_value_problem(mechanism, q0, v0, torque=torque).start.path
    return None


class _Plain(threading.local):
    """Starts that are plain, with a workspace for each thread.

    Parameters
    ----------
    mechanism, library, path, torque
        As `Workspace` takes them.
    times : ndarray (N + 1,)
        s.
    record : sequence of str
    step : float
        s.
    given_up : threading.Event
        Set where nobody waits any more.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        library: Library,
        path: RegularPath,
        torque: ArrayLike | None,
        times: Array,
        record: Sequence[str],
        step: float,
        given_up: threading.Event,
    ) -> None:
        self._mechanism, self._times, self._given_up = mechanism, times, given_up
        works = does_work(mechanism, torque)
        self._workspace = Workspace(library, mechanism, path, torque, works)
        self._wanted = (*record, "work") if works else tuple(record)
        self._redundant = mechanism.nc > path.nd
        # in zones of several coordinates these are looked at, which `simulate` does
        self._single = all(cluster.m == 1 for cluster in path.mechanism.clusters)
        self._torque, self._coarse, self._acted = torque, Coarse(mechanism, step), Acted(torque)

    def run(self, q0: ArrayLike | None, v0: ArrayLike | None) -> Trajectory | None:
        """The motion from a start, or None where `simulate` has to look at it."""
        mechanism, times = self._mechanism, self._times
        q, v = state_given(mechanism, q0, v0)
        options, zone = USUAL, USUAL.zone
        beside = options if self._single else None
        begun = closed_by_kernel(self._workspace, mechanism, q, v, zone, options=beside)
        if begun is None:
            return None
        x, now, trackers = begun[:3]
        outputs = Outputs.room(len(times), mechanism.nq, mechanism.nv, self._wanted)
        outputs.q[0], outputs.v[0] = now.point.q, now.v
        if outputs.a is not None:
            outputs.a[0] = now.a
        if outputs.energy is not None:
            outputs.energy[0] = mechanism.energy(now.point.q, now.v)
        stats, stride = Stats(rhs=1), max(1, STRETCH // mechanism.nv)
        crossings: list[Crossing] = []
        for i in range(0, len(times) - 1, stride):
            ends = times[i : i + stride + 1]
            room = outputs.between(i + 1, i + len(ends))
            batch = self._workspace.run(ends, x, now, room, zone, options, trackers)
            regular = batch.trackers is None and not batch.crossings
            if batch.reason is not Reason.DONE or not (regular or self._single) or self._given_up.is_set():
                return None
            crossings += batch.crossings
            x, now = batch.x, batch.now
            count_in(stats, batch.counts)
        if self._redundant and not self._all_closed(outputs.q):
            return None
        run = Trajectory(
            mechanism,
            times.copy(),
            outputs.q,
            outputs.v,
            outputs.a,
            outputs.energy,
            work=outputs.work,
            crossings=crossings,
            stats=stats,
            acted=self._acted,
        )
        self._coarse.judge(run)
        return run

    def together(
        self, starts: Sequence[Any], threads: int, pool: ThreadPoolExecutor
    ) -> Iterator[tuple[int, Trajectory]]:
        """Those of (number, q0, v0) that come to their end side by side, where there is nothing to record."""
        mechanism, times, last = self._mechanism, self._times, len(self._times) - 1
        if self._redundant or self._wanted:  # these look at no rows of φ, and record nothing
            return
        space, torque = self._workspace, self._torque
        for i, q, v in together(mechanism, space.library, space.path, starts, torque, times, threads, pool):
            stats = Stats(rhs=1 + 4 * last, native_steps=last)  # of the start and the stages
            run = Trajectory(mechanism, times.copy(), q, v, stats=stats, acted=self._acted)
            self._coarse.judge(run)
            yield i, run

    def _all_closed(self, q: Array) -> bool:
        rows = np.unique(np.linspace(0, len(q) - 1, LOOKS).astype(int))
        return all(self._mechanism.closure_residual(q[i]) <= NEARLY_CLOSED for i in rows)
