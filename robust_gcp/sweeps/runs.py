"""`sweep`: many runs over mechanisms, initial states and methods, on all cores or a cluster."""

from __future__ import annotations

import inspect
import itertools
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..checks import check_callable, check_number, listed, shown
from ..errors import OptionError
from ..mechanism.mechanism import Mechanism
from .file import SweepFile, identity_of
from .pool import Task, here, on_executor, on_processes, on_threads
from .record import Records, RunRecord, key
from .worker import OPTIONS, Build, Keep, Outcome, runs_natively

Progress = bool | Callable[[int, int], None]


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Every combination of the given values, the last axis fastest.

    Parameters
    ----------
    **axes : iterable
        The values of each parameter.

    Examples
    --------
    >>> import robust_gcp as rg
    >>> rg.grid(method=["bridge", "classical"], step=[1e-3])
    [{'method': 'bridge', 'step': 0.001}, {'method': 'classical', 'step': 0.001}]
    """
    values: list[list[Any]] = []
    for name, axis in axes.items():
        values.append(listed(axis, f"grid: {name} = {shown(axis)}", "values", OptionError, object))
    return [dict(zip(axes, combination, strict=True)) for combination in itertools.product(*values)]


def sweep(
    build: Build,
    runs: Iterable[Mapping[str, Any]],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    file: str | Path | None = None,
    keep: Keep = "summary",
    progress: Progress = False,
    on_record: Callable[[RunRecord], None] | None = None,
    **shared: Any,
) -> Records:
    """Simulate many times; the same results as one run after the other.

    Parameters
    ----------
    build : str, Path, Mechanism or callable (**parameters) -> Mechanism
        A model's name or folder for `load`, a mechanism, or a function that makes one.
    runs : iterable of dict
        The parameters of each run, see `grid`. Those of `simulate` go there untouched; all others
        go to `build`, which must then be a function.
    executor : concurrent.futures.Executor, optional
        Where to compute, such as Dask's `client.get_executor()`; it stays open. When left out: threads
        where every run goes to the compiled kernel (see docs/sweep.md), else processes.
    workers : int, optional
        Spawn this many worker processes in any case; 0: one run after the other in this process.
    file : str or Path, optional
        JSON lines, written as runs end. A sweep that was interrupted resumes from it: runs that are in
        it are not computed again, unless they failed by an error that is not a `RobustGcpError`.
    keep : {"summary", "trajectory"} or callable (trajectory) -> object
        What to keep of each run besides its summary; JSON values where there is a file.
    progress : bool or callable (done, total)
        True for a bar on stderr.
    on_record : callable (record), optional
        Called with each record as it comes.
    **shared
        Parameters that all runs share.

    Returns
    -------
    Records
        A list of `RunRecord` in the order of `runs`, failures beside successes; `to_dataframe()` and
        `to_csv(path)` make a table of it.

    Raises
    ------
    OptionError
        For bad arguments, before anything is computed, and for a file of another sweep.
    SweepError
        When workers cannot start, a given executor breaks, or the disk does not take the file.

    Examples
    --------
    >>> import robust_gcp as rg
    >>> runs = rg.grid(method=["bridge", "closed_form"])
    >>> for record in rg.sweep("rhombus", runs, workers=0, duration=0.5, step=5e-3):
    ...     print(record.parameters["method"], record.ok, f"{record.summary['q'][0]:.4f}")
    bridge True -1.2128
    closed_form True -1.2128
    """
    check_callable("on_record", on_record, "(record)")
    records = sweep_as_completed(
        build, runs, executor=executor, workers=workers, file=file, keep=keep, progress=progress, **shared
    )
    found = []
    try:
        for record in records:
            if on_record is not None:
                on_record(record)
            found.append(record)
    finally:
        records.close()
    return Records(sorted(found, key=lambda record: record.index))


def sweep_as_completed(
    build: Build,
    runs: Iterable[Mapping[str, Any]],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    file: str | Path | None = None,
    keep: Keep = "summary",
    progress: Progress = False,
    **shared: Any,
) -> Generator[RunRecord, None, None]:
    """`sweep`, one record at a time: those of the file first, then each as its run ends.

    Closing the iterator, or an interruption (Ctrl-C), cancels what is left and ends the workers.
    See `sweep` for parameters and errors.
    """
    asked = _Asked(build, _merged(runs, shared), executor, workers, file, keep, progress)
    asked.check()
    return asked.records()


def _merged(runs: Iterable[Mapping[str, Any]], shared: Mapping[str, Any]) -> list[dict[str, Any]]:
    merged = []
    items = "dicts, one a run (see robust_gcp.grid)"
    for i, run in enumerate(listed(runs, "runs", items, OptionError, Mapping)):
        if not isinstance(run, Mapping) or not all(isinstance(name, str) for name in run):
            raise OptionError(f"runs[{i}] = {shown(run)} must be a dict of parameters by name")
        merged.append({**shared, **run})
    return merged


@dataclass(frozen=True)
class _Asked:
    """The arguments of a sweep; each run's parameters with what all share."""

    build: Build
    runs: list[dict[str, Any]]
    executor: Executor | None
    workers: int | None
    file: str | Path | None
    keep: Keep
    progress: Progress

    def check(self) -> None:
        """Refuse bad arguments before anything is computed."""
        workers, keep = self.workers, self.keep
        if not isinstance(self.build, str | Path | Mechanism) and not callable(self.build):
            raise OptionError(
                f"build = {shown(self.build)} must be a model's name or folder, a Mechanism, or a function "
                "making one"
            )
        if self.executor is not None and not isinstance(self.executor, Executor):
            raise OptionError(f"executor = {shown(self.executor)} must be a concurrent.futures.Executor")
        if workers is not None:
            check_number("workers", workers)
            if workers < 0 or not float(workers).is_integer():
                raise OptionError(f"workers = {workers} must be a number of processes, 0 or more")
            if self.executor is not None:
                raise OptionError("workers goes with processes of the sweep's own, not with executor")
        if not callable(keep) and shown(keep) not in map(repr, ("summary", "trajectory")):
            raise OptionError(
                f'keep = {shown(keep)} must be "summary", "trajectory", or a function of the trajectory'
            )
        if self.file is not None and keep == "trajectory":
            raise OptionError(
                'keep = "trajectory" does not go to a file; keep a function that returns the numbers you need'
            )
        if not isinstance(self.progress, bool):
            check_callable("progress", self.progress, "(done, total), or True or False")
        for i, run in enumerate(self.runs):
            _check_run(self.build, i, run)

    def records(self) -> Generator[RunRecord, None, None]:
        """Those of the file first, then each as its run ends."""
        names = _names(self.runs) if self.file is not None else []
        with ExitStack() as stack:
            one_more = stack.enter_context(_counting(self.progress, len(self.runs)))
            kept = None
            if self.file is not None:
                identity = {"build": identity_of(self.build), "keep": self.keep}
                kept = stack.enter_context(SweepFile(self.file, identity))
            tasks: list[Task] = []
            for i, run in enumerate(self.runs):
                line = None if kept is None else kept.done.get(names[i])
                if kept is None or line is None or (line["failure"] and not line["failure"]["ours"]):
                    tasks.append((i, run))
                    continue
                one_more()
                yield kept.record(line, i, run)
            if not tasks:
                return
            outcomes = self._outcomes(tasks)
            stack.callback(outcomes.close)
            for index, outcome in outcomes:
                record = RunRecord(index, self.runs[index], outcome.summary, outcome.kept, outcome.failure)
                if kept is not None:
                    record = kept.append(record, names[index][1])
                one_more()
                yield record

    def _outcomes(self, tasks: list[Task]) -> Generator[tuple[int, Outcome], None, None]:
        """As the runs end, wherever they are computed."""
        if self.executor is not None:
            return on_executor(self.executor, self.build, self.keep, tasks)
        if self.workers == 0:
            return here(self.build, self.keep, tasks)
        if self.workers is None and all(runs_natively(run) for _, run in tasks):
            return on_threads(self.build, self.keep, tasks)
        return on_processes(None if self.workers is None else int(self.workers), self.build, self.keep, tasks)


def _check_run(build: Build, i: int, run: Mapping[str, Any]) -> None:
    """Refuse parameters that neither `simulate` nor `build` takes."""
    for name in ("progress", "mechanism"):
        if name in run:
            raise OptionError(
                f"runs[{i}]: {name} is not a parameter of a run; see sweep's build and progress"
            )
    extra = {name: value for name, value in run.items() if name not in OPTIONS}
    if isinstance(build, str | Path | Mechanism):
        if extra:
            raise OptionError(
                f"runs[{i}]: simulate has no parameter {next(iter(extra))!r}, and build is no function that "
                "could take it"
            )
        return
    try:
        inspect.signature(build).bind(**extra)
    except TypeError as error:
        raise OptionError(
            f"runs[{i}]: build cannot be called with {', '.join(extra) or 'no parameters'}: {error}"
        ) from error
    except ValueError:
        return  # a callable without a signature: it will say so itself


def _names(runs: list[dict[str, Any]]) -> list[tuple[str, int]]:
    """Each run's key in the file, and how many runs before it have the same parameters."""
    seen: Counter[str] = Counter()
    names = []
    for i, run in enumerate(runs):
        text = key(run, f"runs[{i}]")
        names.append((text, seen[text]))
        seen[text] += 1
    return names


@contextmanager
def _counting(progress: Progress, total: int) -> Iterator[Callable[[], object]]:
    """What is called for each run that has ended, to tell of progress as it was asked for."""
    if callable(progress):
        done = itertools.count(1)
        yield lambda: progress(next(done), total)
    elif progress:
        from tqdm import tqdm

        with tqdm(total=total, unit="run") as bar:
            yield bar.update
    else:
        yield lambda: None
