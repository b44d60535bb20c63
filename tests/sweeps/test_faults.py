"""Faults of what a sweep is given: one run is lost and told of, never the sweep nor the program."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest

import robust_gcp as rg
from robust_gcp.sweeps.file import SweepFile
from robust_gcp.sweeps.pool import on_threads

SHORT: dict[str, Any] = {"duration": 0.02, "step": 5e-3}


class MuteError(Exception):
    """An error without words."""

    def __str__(self) -> str:
        raise ZeroDivisionError("no words")


class RudeError(MuteError):
    """An error that ends the program when it is asked."""

    def __str__(self) -> str:
        raise SystemExit(5)


class HeldError(Exception):
    """An error that cannot be pickled, nor what it holds."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)
        self.lock = threading.Lock()


class OddError(BaseException):
    """No `Exception`."""


def fails(how: str = "no") -> rg.Mechanism:
    if how == "exit":
        sys.exit(3)
    if how == "exit with words":
        sys.exit("the end")
    if how == "interrupt":
        raise KeyboardInterrupt
    if how == "odd":
        raise OddError("odd")
    if how == "generator":
        raise GeneratorExit
    if how == "mute":
        raise MuteError
    if how == "rude":
        raise RudeError
    if how == "held":
        raise HeldError(threading.Lock(), (x for x in "abc"))
    if how == "long":
        raise ValueError("x" * 3_000_000)
    if how == "half characters":
        raise ValueError("a name of a file: \udcff\ud800")
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "yields":
        return iter([1])  # type: ignore[return-value]
    return rg.load("rhombus")


KINDS = {
    "exit": "SystemExit",
    "exit with words": "SystemExit",
    "interrupt": "KeyboardInterrupt",
    "odd": "OddError",
    "generator": "GeneratorExit",
    "mute": "MuteError",
    "rude": "RudeError",
    "held": "HeldError",
    "long": "ValueError",
    "half characters": "ValueError",
    "yields": "OptionError",
}
OF_THE_CALLER = ("interrupt", "odd")
"""In the main thread of the caller's process these may come from outside the run: a signal, a deadline."""

WHERE = ("here", "threads", "processes", "an executor's threads", "an executor's processes")


def swept(where: str, runs: list[dict[str, Any]], **more: Any) -> list[rg.RunRecord]:
    if where == "here":
        return rg.sweep(fails, runs, workers=0, **more, **SHORT)
    if where == "processes":
        return rg.sweep(fails, runs, workers=2, **more, **SHORT)
    if where == "threads":  # as for the kernel's runs of a mechanism or model
        tasks = [(i, {**run, **SHORT}) for i, run in enumerate(runs)]
        outcomes = dict(on_threads(fails, more.pop("keep", "summary"), tasks))
        return [rg.RunRecord(i, runs[i], o.summary, o.kept, o.failure) for i, o in sorted(outcomes.items())]
    pool = ProcessPoolExecutor(2, get_context("spawn")) if "processes" in where else ThreadPoolExecutor(2)
    with pool as executor:
        return rg.sweep(fails, runs, executor=executor, **more, **SHORT)


@pytest.mark.parametrize("where", WHERE)
def test_whatever_a_run_raises_is_its_failure(where: str, tmp_path: Path) -> None:
    hows = [how for how in KINDS if where != "here" or how not in OF_THE_CALLER]
    file = {} if where == "threads" else {"file": tmp_path / "runs.jsonl"}
    found = swept(where, [{}, *({"how": how} for how in hows), {}], **file)
    assert found[0].ok and found[-1].ok
    for how, record in zip(hows, found[1:], strict=False):
        assert record.failure and record.failure.kind == KINDS[how], how
        assert record.failure.ours == (how == "yields")
        assert len(record.failure.message) <= 20_000 and len(record.failure.trace) <= 20_000
        assert pickle.loads(pickle.dumps(record.failure)) == record.failure
    mute = found[1 + hows.index("mute")].failure
    assert mute and mute.message == "no message: its __str__ raised ZeroDivisionError"
    if file:
        done = 2 + 1  # successes and refusals of ours are not done again, mistakes are
        again = swept(where, [{}, *({"how": how} for how in hows), {}], **file)
        assert sum(record.resumed for record in again) == done
        assert [record.failure for record in again if record.resumed] == [
            record.failure for record, second in zip(found, again, strict=True) if second.resumed
        ]


@pytest.mark.parametrize("how", OF_THE_CALLER)
def test_interruptions_of_the_caller_end_the_sweep_here(how: str) -> None:
    with pytest.raises((KeyboardInterrupt, OddError)):
        swept("here", [{"how": how}])


def test_a_worker_that_is_killed_costs_one_run(tmp_path: Path) -> None:
    found = swept("processes", [{}, {"how": "killed"}, {}, {"how": "exit"}], file=tmp_path / "runs.jsonl")
    kinds = [record.failure.kind if record.failure else "" for record in found]
    assert kinds == ["", "BrokenProcessPool", "", "SystemExit"]


# --------------------------------------------------------------------------- results


class Vanishing:
    """Pickles, and cannot be read back."""

    def __reduce__(self) -> tuple[Any, ...]:
        return pickle.loads, (b"no pickle",)


class Ending(Vanishing):
    """Ends the program that reads it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return sys.exit, (4,)


def function(trajectory: rg.Trajectory) -> Any:
    return lambda: trajectory


def generator(trajectory: rg.Trajectory) -> Iterator[float]:
    yield trajectory.t[-1]


def vanishing(trajectory: rg.Trajectory) -> Vanishing:
    return Vanishing()


def ending(trajectory: rg.Trajectory) -> Vanishing:
    return Ending()


def wrong(trajectory: rg.Trajectory) -> float:
    raise KeyError("no such figure")


def deep(trajectory: rg.Trajectory) -> list[Any]:
    made: list[Any] = []
    for _ in range(100_000):
        made = [made]
    return made


@pytest.mark.parametrize("keep", [function, generator, vanishing, ending, deep])
def test_a_result_that_cannot_travel_leaves_the_summary(keep: Any) -> None:
    for record in swept("processes", [{}, {}], keep=keep):
        assert record.failure and not record.failure.ours and record.kept is None
        assert "kept" in record.failure.message
        assert record.summary and record.summary["t"] == 0.02


@pytest.mark.parametrize("where", WHERE)
def test_a_function_that_fails_on_the_result_leaves_the_summary(where: str) -> None:
    for record in swept(where, [{}, {}], keep=wrong):
        assert record.failure and (record.failure.kind, record.failure.ours) == ("KeyError", False)
        assert record.summary and record.summary["t"] == 0.02


class Closed(Executor):
    """Takes no work."""

    def submit(self, *args: Any, **kwargs: Any) -> Future[Any]:
        raise RuntimeError("cannot schedule new futures after shutdown")


class Cancelling(Executor):
    """Takes work and does none."""

    def submit(self, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


def test_executors_that_do_not_work_are_told_of() -> None:
    with pytest.raises(rg.SweepError, match="does not take run 0"):
        rg.sweep(fails, [{}], executor=Closed(), **SHORT)
    (record,) = rg.sweep(fails, [{}], executor=Cancelling(), **SHORT)
    assert record.failure and record.failure.kind == "CancelledError"


def test_a_module_that_ends_the_program_is_told_of(tmp_path: Path) -> None:
    """When a worker imports it; the parent would end the same way if the error were passed on as it is."""
    (tmp_path / "ender.py").write_text(
        "import sys, multiprocessing, robust_gcp\n"
        "if multiprocessing.parent_process(): sys.exit(7)\n"
        "def build(): return robust_gcp.load('rhombus')\n"
    )
    script = (
        "import robust_gcp as rg\n"
        "if __name__ == '__main__':\n"
        "    import ender\n"
        "    try: rg.sweep(ender.build, [{}], workers=1, duration=0.1)\n"
        "    except rg.SweepError as error: print('told:', error)\n"
    )
    (tmp_path / "script.py").write_text(script)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert "told: worker processes cannot" in done.stdout


# --------------------------------------------------------------------------- the file


def whole(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_bytes().splitlines()]


@pytest.mark.parametrize(
    "place", ["", "/dev/null", "/dev/full", "/dev/zero", "pipe", "file/runs", "loop", "x" * 400]
)
def test_what_is_no_file_is_refused_before_anything_is_computed(tmp_path: Path, place: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to("loop")
    path = Path(place) if place.startswith("/dev") else tmp_path / place
    if place.startswith("/dev") and not path.exists():
        pytest.skip(f"no {place} here")
    began: list[int] = []
    with pytest.raises(rg.OptionError, match="cannot"):
        rg.sweep(lambda: began.append(1), [{}], workers=0, file=path, **SHORT)  # type: ignore[arg-type,func-returns-value]
    assert began == []


@pytest.mark.parametrize("path", [7, b"runs", "a\0b", ["runs"], 1.5])
def test_what_is_no_path_is_refused(path: Any) -> None:
    with pytest.raises(rg.OptionError, match="not a path"):
        rg.sweep(fails, [{}], workers=0, file=path, **SHORT)


def test_a_file_that_may_not_be_written_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    path.touch()
    path.chmod(0o400)
    if os.access(path, os.W_OK):
        pytest.skip("this user may write anything")
    with pytest.raises(rg.OptionError, match="cannot be the file of a sweep"):
        rg.sweep(fails, [{}], workers=0, file=path, **SHORT)


def test_a_full_disk_keeps_what_is_done(tmp_path: Path) -> None:
    """The limit on the size of files stands for the disk's end; it cuts a line in two."""
    path = tmp_path / "runs.jsonl"
    runs = [{"step": s} for s in (5e-3, 4e-3, 2e-3, 1e-3)]
    rg.sweep("rhombus", runs[:1], workers=0, file=path, duration=0.02)
    line = path.stat().st_size
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(1.5 * line), old[1]))
        with pytest.raises(rg.SweepError, match="make room and call sweep again") as caught:
            rg.sweep("rhombus", runs, workers=0, file=path, duration=0.02)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, handler)
    assert isinstance(caught.value.__cause__, OSError)
    assert path.read_bytes().endswith(b"}\n") and len(whole(path)) >= 2
    kept = len(whole(path)) - 1
    found = rg.sweep("rhombus", runs, workers=0, file=path, duration=0.02)
    assert [record.resumed for record in found] == [True] * kept + [False] * (4 - kept)
    assert all(record.ok for record in found)


def summed(line: dict[str, Any]) -> bytes:
    """A line with the checksum that belongs to it, so that it is its form that is refused."""
    digest = hashlib.sha256(json.dumps(line).encode()).hexdigest()[:16]
    return json.dumps({**line, "sha256": digest}).encode()


RUN = {"parameters": {"step": 5e-3}, "repetition": 0, "summary": {}, "kept": None, "failure": None}
FAILURE = {"kind": "E", "message": "m", "ours": True, "trace": ""}
SPOILT: dict[str, bytes] = {
    "no JSON": b"{'a': 1}",
    "no text": b"\xff\xfe{}",
    "empty": b"",
    "a list": b"[1, 2]",
    "a number": b"3",
    "deep": b"[" * 100_000,
    "deep and closed": b"[" * 50_000 + b"]" * 50_000,
    "digits": b"9" * 10_000,
    "two runs": summed(RUN) * 2,
    "without its checksum": json.dumps(RUN).encode(),
    "with another's checksum": summed(RUN).replace(b"0.005", b"0.004"),
    **{f"without {name}": summed({k: v for k, v in RUN.items() if k != name}) for name in RUN},
    **{
        f"{name} = {value!r}": summed({**RUN, name: value})
        for name, value in (
            ("parameters", [1]),
            ("parameters", None),
            ("repetition", [0]),
            ("repetition", {}),
            ("summary", "none"),
            ("summary", [1]),
            ("failure", "none"),
            ("failure", []),
            ("failure", {}),
            ("failure", {**FAILURE, "more": 1}),
            ("failure", {**FAILURE, "ours": "yes"}),
            ("failure", {k: v for k, v in FAILURE.items() if k != "message"}),
        )
    },
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_damaged_line_is_named_and_the_file_left_alone(tmp_path: Path, name: str) -> None:
    path = tmp_path / "runs.jsonl"
    rg.sweep("rhombus", [{"step": 5e-3}, {"step": 4e-3}], workers=0, file=path, duration=0.02)
    header, first, second = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([header, SPOILT[name], second, b""]))
    before = path.read_bytes()
    with pytest.raises(rg.OptionError, match=r"line 2: not a run of a sweep, or .*; remove that line"):
        rg.sweep("rhombus", [{"step": 5e-3}, {"step": 4e-3}], workers=0, file=path, duration=0.02)
    assert path.read_bytes() == before
    path.write_bytes(b"\n".join([header, second, b""]))  # as the message says
    found = rg.sweep("rhombus", [{"step": 5e-3}, {"step": 4e-3}], workers=0, file=path, duration=0.02)
    assert [record.resumed for record in found] == [False, True]
    assert sorted(path.read_bytes().splitlines())[:1] and len(whole(path)) == 3
    assert first.split(b'"stats"')[0] in path.read_bytes()


def test_a_changed_bit_is_found(tmp_path: Path) -> None:
    """Wherever a bit of a run's line is turned: refused, or the run is done again; never another result."""
    path = tmp_path / "runs.jsonl"

    def swept() -> list[rg.RunRecord]:
        return rg.sweep("rhombus", [{"step": 5e-3}], workers=0, file=path, duration=0.01)

    (right,) = swept()
    whole, header = path.read_bytes(), path.read_bytes().index(b"\n") + 1
    refused = 0
    for place in range(header, len(whole), 5):
        changed = bytearray(whole)
        changed[place] ^= 1 << (place % 8)
        path.write_bytes(changed)
        try:
            (found,) = swept()
        except rg.OptionError:
            refused += 1
        else:
            assert (found.summary["q"], found.kept) == (right.summary["q"], right.kept)
    assert refused > (len(whole) - header) // 7


def test_a_file_of_the_first_version_is_gone_on_with(tmp_path: Path) -> None:
    """Its lines have no checksums."""
    path, runs = tmp_path / "runs.jsonl", [{"step": 5e-3}, {"step": 4e-3}]
    rg.sweep("rhombus", runs[:1], workers=0, file=path, duration=0.02)
    header, line = map(json.loads, path.read_text().splitlines())
    header["format"] = "robust_gcp sweep 1"
    del line["sha256"]
    path.write_text("".join(json.dumps(each) + "\n" for each in (header, line)))
    for resumed in ([True, False], [True, True]):
        found = rg.sweep("rhombus", runs, workers=0, file=path, duration=0.02)
        assert [record.resumed for record in found] == resumed


@pytest.mark.parametrize(
    "first", [b"[" * 100_000, b"9" * 10_000, b'{"format": []}', b"\xff", b"\0" * 2_000_000]
)
def test_a_damaged_header_is_refused(tmp_path: Path, first: bytes) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_bytes(first + b"\n")
    with pytest.raises(rg.OptionError, match="is not the file of a sweep"):
        rg.sweep("rhombus", [{}], workers=0, file=path, **SHORT)
    assert path.read_bytes() == first + b"\n"


def test_a_large_file_of_another_kind_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "film"
    with path.open("wb") as file:
        file.truncate(10**12)  # a hole: takes no room on the disk
    with pytest.raises(rg.OptionError, match="is not the file of a sweep"):
        SweepFile(path, {})


def looped() -> list[Any]:
    made: list[Any] = []
    made.append(made)
    return made


UNWRITTEN: dict[str, Any] = {
    "a list in itself": looped(),
    "digits": 10**5000,
    "a list of it": [looped()],
    "digits in a mapping": {"a": 10**5000},
    "bytes": b"bytes",
    "a set": {1.5},
    "a lock": threading.Lock(),
}


@pytest.mark.parametrize("name", UNWRITTEN)
def test_parameters_that_no_file_holds_are_refused_first(tmp_path: Path, name: str) -> None:
    began: list[int] = []
    with pytest.raises(rg.OptionError, match=r"runs\[0\]"):
        rg.sweep(
            lambda x: began.append(1),  # type: ignore[arg-type]
            [{"x": UNWRITTEN[name]}], workers=0, file=tmp_path / "runs.jsonl", **SHORT,
        )  # fmt: skip
    assert began == []


def test_half_characters_are_kept(tmp_path: Path) -> None:
    """As in names of files that are no UTF-8."""
    for resumed in (False, True):
        (record,) = rg.sweep(
            named, [{"name": "\udcff"}], workers=0, file=tmp_path / "runs.jsonl", keep=lambda_free, **SHORT
        )
        assert record.ok and record.resumed == resumed and record.kept == ["\udcff"]


def named(name: str) -> rg.Mechanism:
    assert name == "\udcff"
    return rg.load("rhombus")


def lambda_free(trajectory: rg.Trajectory) -> list[str]:
    return ["\udcff"]


def test_a_mechanism_that_was_pickled_is_the_one_that_the_file_knows(tmp_path: Path) -> None:
    mech, path = rg.load("crank_rocker"), tmp_path / "runs.jsonl"
    rg.sweep(mech, [{"duration": 0.01}], file=path, workers=0)
    (found,) = rg.sweep(pickle.loads(pickle.dumps(mech)), [{"duration": 0.01}], file=path, workers=0)
    assert found.resumed
