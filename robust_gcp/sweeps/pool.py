"""Where runs are computed: here, on a given executor, or on threads or processes of the sweep's own."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..checks import shown
from ..errors import OptionError, SweepError
from ..io.loader import load
from .record import Failure, failure_of, words_of
from .worker import Build, Keep, Outcome, begin, ready, unpickled, work, work_pickled

Task = tuple[int, Mapping[str, Any]]
"""A run's place in the sweep, and its parameters."""

AHEAD = 2
"""Runs handed over to each worker, so that it never waits for this thread."""


def here(build: Build, keep: Keep, tasks: Sequence[Task]) -> Generator[tuple[int, Outcome], None, None]:
    """One run after the other in this process."""
    build = _loaded(build)
    for index, parameters in tasks:
        yield index, work(build, keep, parameters)


def on_executor(
    executor: Executor, build: Build, keep: Keep, tasks: Sequence[Task]
) -> Generator[tuple[int, Outcome], None, None]:
    """Runs on an executor that belongs to the caller, as they end.

    Raises
    ------
    SweepError
        When the executor breaks. What is not under way is cancelled; the executor stays open.
    """
    futures: dict[Future[Outcome], int] = {}
    try:
        for index, parameters in tasks:
            try:
                futures[executor.submit(work, build, keep, parameters)] = index
            except Exception as error:  # executors raise what they like
                raise SweepError(
                    f"the executor does not take run {index} ({type(error).__name__}: {error}): it is broken "
                    "or was shut down; give a fresh one, or executor=None"
                ) from error
        for future in as_completed(futures):
            failed = _failure(future)
            if isinstance(failed, BrokenExecutor):
                raise SweepError(
                    f"the executor broke ({type(failed).__name__}: {failed}) with run {futures[future]} "
                    "under way: a worker died or could not start; with executor=None a sweep tells which"
                ) from failed
            yield futures[future], future.result() if failed is None else _lost(failed)
    finally:
        for future in futures:
            future.cancel()


def on_threads(build: Build, keep: Keep, tasks: Sequence[Task]) -> Generator[tuple[int, Outcome], None, None]:
    """Runs on threads of this process, as they end; none is left when the iterator is closed.

    For runs in the compiled kernel, which takes its steps without the interpreter's lock. Warnings
    pass the filters of this process: no run changes them.
    """
    count = min(os.cpu_count() or 1, len(tasks))
    build, waiting, running = _loaded(build), deque(tasks), dict[Future[Outcome], int]()
    given_up = threading.Event()
    pool = ThreadPoolExecutor(count, "robust_gcp sweep")
    try:
        while waiting or running:
            while waiting and len(running) < AHEAD * count:
                index, parameters = waiting.popleft()
                running[pool.submit(work, build, keep, parameters, given_up.is_set)] = index
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:
        given_up.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _loaded(build: Build) -> Build:
    """The model that each run would load, as one mechanism for all."""
    if not isinstance(build, str | Path):
        return build
    try:
        return load(build)
    except Exception:
        return build  # each run fails by the same error, and its record tells it


def on_processes(
    workers: int | None, build: Build, keep: Keep, tasks: Sequence[Task]
) -> Generator[tuple[int, Outcome], None, None]:
    """Runs on fresh worker processes, as they end; none is left when the iterator is closed.

    Workers are spawned, not forked, so that they start the same way on Linux and macOS and inherit
    no locks. When one dies, the runs that were under way are done again one at a time, which tells
    the run that kills its worker: that one fails, the others count.
    """
    pickled = [(index, _pickled(index, build, keep, parameters)) for index, parameters in tasks]
    count = min(workers or os.cpu_count() or 1, len(tasks))
    with _Processes(count) as processes:
        processes.start(pickled[0][1])
        yield from processes.run(deque(pickled))


class _Processes:
    """Worker processes of one sweep."""

    def __init__(self, count: int) -> None:
        self.count, self.context = count, multiprocessing.get_context("spawn")
        self.given_up = self.context.Event()
        self.pool = self._new()
        self.running: dict[Future[Outcome], tuple[int, bytes]] = {}

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.count, self.context, begin, (self.given_up,))

    def start(self, task: bytes) -> None:
        """Start a worker and see whether it knows what to do."""
        try:
            wrong = self.pool.submit(ready, task).result()
        except BrokenExecutor as error:
            raise SweepError(
                "worker processes cannot start; in a script, call sweep below "
                '`if __name__ == "__main__":`, for workers import the script (one read from standard input '
                "cannot be); or use executor=ThreadPoolExecutor() or workers=0"
            ) from error
        if wrong:
            raise SweepError(
                f"worker processes cannot use what was given ({wrong}); define functions in a module that "
                "can be imported, or use executor=ThreadPoolExecutor() or workers=0"
            )

    def run(self, waiting: deque[tuple[int, bytes]]) -> Generator[tuple[int, Outcome], None, None]:
        suspects: deque[tuple[int, bytes]] = deque()
        while waiting or suspects or self.running:
            alone = bool(suspects)
            source, most = (suspects, 1) if alone else (waiting, AHEAD * self.count)
            broken = not self._submit(source, most)
            done = set(self.running) if broken else wait(self.running, return_when=FIRST_COMPLETED).done
            lost: list[tuple[int, bytes]] = []
            while done:
                for future in done:
                    task, failed = self.running.pop(future), _failure(future)
                    if isinstance(failed, BrokenExecutor):
                        broken = True
                        lost.append(task)
                    else:
                        yield task[0], unpickled(future.result()) if failed is None else _lost(failed)
                done = set(self.running) if broken else set()  # a broken pool has ended all of them
            if broken:
                self.pool.shutdown(wait=True)
                self.pool = self._new()
            if alone and lost:
                yield lost[0][0], _died()
            else:
                suspects.extend(sorted(lost))

    def _submit(self, source: deque[tuple[int, bytes]], most: int) -> bool:
        """Hand over runs; False where the pool is broken."""
        while source and len(self.running) < most:
            try:
                future = self.pool.submit(work_pickled, source[0][1])
            except BrokenExecutor:
                return False
            self.running[future] = source.popleft()
        return True

    def __enter__(self) -> _Processes:
        return self

    def __exit__(self, *error: object) -> None:
        self.given_up.set()
        self.pool.shutdown(wait=True, cancel_futures=True)


def _failure(future: Future[Outcome]) -> BaseException | None:
    """What a future ended with; raised here, a worker's KeyboardInterrupt would pass for the caller's."""
    try:
        return future.exception()
    except CancelledError as error:
        return error


def _lost(error: BaseException) -> Outcome:
    words = f"the executor lost the run: {words_of(error)}"
    return Outcome(failure=replace(failure_of(error), message=words, ours=False))


def _died() -> Outcome:
    words = "the worker process died during this run (out of memory, killed, or a crash in compiled code)"
    return Outcome(failure=Failure("BrokenProcessPool", words, ours=False))


def _pickled(index: int, build: Build, keep: Keep, parameters: Mapping[str, Any]) -> bytes:
    for what, value in (("build", build), ("keep", keep), (f"runs[{index}]", dict(parameters))):
        try:  # apart, to tell which of them it is
            pickle.dumps(value)
        except Exception as error:  # pickle raises what it likes
            raise OptionError(
                f"{what} = {shown(value)} cannot be sent to worker processes ({words_of(error)}); define "
                "functions at the top of a module, or use executor=ThreadPoolExecutor() or workers=0"
            ) from error
    return pickle.dumps((build, keep, dict(parameters)))
