"""Many runs: the same results wherever they are computed, failures beside successes, resumed from a file."""

from __future__ import annotations

import copy
import csv
import json
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.io.loader import models_folder
from robust_gcp.sweeps.worker import runs_natively

from ..compiled import needs_kernel

SHORT: dict[str, Any] = {"duration": 0.1, "step": 1e-2}
RUNS = rg.grid(method=["bridge", "projection"], q0=[[0.2, -0.2, 0.2], [0.3, -0.3, 0.3]])


def same(record: rg.RunRecord) -> rg.RunRecord:
    """A record without what differs from run to run: its time on the wall."""
    if record.summary is None:
        return record
    stats = {k: v for k, v in record.summary["stats"].items() if k != "wall_seconds"}
    return replace(record, summary={**record.summary, "stats": stats})


def serial(build: Any = "rhombus", runs: list[dict[str, Any]] = RUNS, **more: Any) -> list[rg.RunRecord]:
    return [same(record) for record in rg.sweep(build, runs, workers=0, **{**SHORT, **more})]


def end(trajectory: rg.Trajectory) -> dict[str, Any]:
    return {"q": trajectory.q[-1], "rows": len(trajectory.t)}


# --------------------------------------------------------------------------- runs


def test_a_grid_is_the_product_of_its_axes() -> None:
    runs = rg.grid(step=(1e-3, 2e-3), method=["bridge", "classical", "projection"], q0=iter([[0.0], [1.0]]))
    assert len(runs) == 12 and len({str(run) for run in runs}) == 12
    assert runs[0] == {"step": 1e-3, "method": "bridge", "q0": [0.0]}
    assert runs[1] == {"step": 1e-3, "method": "bridge", "q0": [1.0]}
    assert rg.grid() == [{}]
    for axis in ("bridge", 1e-3, {"a": 1}):
        with pytest.raises(rg.OptionError, match=r"method = .* must be a list of values"):
            rg.grid(method=axis)  # type: ignore[arg-type]


def test_a_record_holds_what_a_run_would_give() -> None:
    (record,) = rg.sweep("rhombus", [{"q0": [0.2, -0.2, 0.2]}], workers=0, duration=0.3, step=5e-3)
    run = rg.simulate(rg.load("rhombus"), [0.2, -0.2, 0.2], duration=0.3, step=5e-3)
    assert record.ok and record.failure is None and not record.resumed
    assert record.parameters == {"duration": 0.3, "step": 5e-3, "q0": [0.2, -0.2, 0.2]}
    assert record.summary is not None
    assert record.summary["q"] == run.q[-1].tolist()
    assert record.summary["v"] == run.v[-1].tolist()
    assert (record.summary["t"], record.summary["rows"], record.summary["crossings"]) == (0.3, 61, 1)
    assert abs(record.summary["max_closure_error"] - run.closure_error().max()) <= 1e-15  # m, of links of 1 m
    assert abs(record.summary["max_energy_error"] - np.abs(run.energy_error()).max()) <= 1e-13  # of 20 J
    assert record.summary["stats"]["rhs"] == run.stats.rhs


def test_runs_override_what_all_share() -> None:
    records = rg.sweep("rhombus", [{}, {"step": 2e-2}], workers=0, **SHORT)
    assert [r.summary["rows"] for r in records if r.summary] == [11, 6]


def test_parameters_that_simulate_does_not_know_build_the_mechanism() -> None:
    lengths = {"l0": 4.0, "l2": 3.0, "l3": 3.0}
    records = rg.sweep(linkages.four_bar, rg.grid(l1=[1.5, 2.0]), workers=0, keep=end, **lengths, **SHORT)
    for record, l1 in zip(records, (1.5, 2.0), strict=True):
        run = rg.simulate(linkages.four_bar(4.0, l1, 3.0, 3.0), **SHORT)
        np.testing.assert_array_equal(record.kept["q"], run.q[-1])


def test_models_are_a_parameter_like_others() -> None:
    records = rg.sweep(rg.load, rg.grid(name_or_folder=["kite", "crank_rocker"]), workers=0, **SHORT)
    ends = [rg.simulate(rg.load(n), **SHORT).q[-1].tolist() for n in ("kite", "crank_rocker")]
    assert [r.summary["q"] for r in records if r.summary] == ends


# --------------------------------------------------------------------------- anywhere the same


@pytest.mark.parametrize("kind", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_any_executor_gives_the_serial_results(kind: Callable[..., Executor]) -> None:
    spawned = {"mp_context": multiprocessing.get_context("spawn")} if kind is ProcessPoolExecutor else {}
    with kind(2, **spawned) as executor:
        found = rg.sweep("rhombus", RUNS, executor=executor, **SHORT)
        assert [same(r) for r in found] == serial()
        assert executor.submit(int, "7").result() == 7  # it stays open


def test_own_processes_give_the_serial_results_and_leave_nothing() -> None:
    build = rg.load("change_point")
    runs = rg.grid(method=["bridge", "projection", "classical"])
    found = rg.sweep(build, runs, workers=2, **SHORT)
    assert [same(r) for r in found] == serial(build, runs)
    assert multiprocessing.active_children() == []


def test_threads_do_not_share_the_workspace_of_a_mechanism() -> None:
    build = rg.load("bricard")
    runs = [{"q0": build.assemble(build.home + d)} for d in (0.0, 0.1, -0.1, 0.05, -0.05, 0.2)]
    given = {"duration": 0.1, "step": 2e-3}
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns within a step
    try:
        with ThreadPoolExecutor(4) as executor:
            found = rg.sweep(build, runs, executor=executor, keep=end, **given)
    finally:
        sys.setswitchinterval(before)
    for record, run in zip(found, runs, strict=True):
        np.testing.assert_array_equal(record.kept["q"], rg.simulate(build, run["q0"], **given).q[-1])


# --------------------------------------------------------------------------- threads or processes

compiled = needs_kernel
NATIVE = rg.grid(method=["bridge", "classical"], q0=[[0.2, -0.2, 0.2], [0.3, -0.3, 0.3], [0.4, -0.4, 0.4]])


def process(_: rg.Trajectory) -> int:
    return os.getpid()


@compiled
@pytest.mark.parametrize("build", ["rhombus", rg.load("rhombus"), lambda: rg.load("rhombus")])
def test_native_runs_share_this_process_and_give_the_serial_results(build: Any) -> None:
    found = rg.sweep(build, NATIVE, keep=process, **SHORT)
    assert {record.kept for record in found} == {os.getpid()}
    assert [replace(same(record), kept=None) for record in found] == serial(build, NATIVE)
    assert all(r.summary and r.summary["stats"]["native_steps"] == 10 for r in found)


@compiled
@pytest.mark.parametrize("workers", [0, None])
def test_all_runs_use_the_mechanism_that_is_given(workers: int | None) -> None:
    """Its setting up is done once; what a run counts does not tell who came first."""
    build = rg.load("stewart")
    found = rg.sweep(build, [{}] * 3, workers=workers, keep=lambda run: run.mechanism is build, **SHORT)
    assert [record.kept for record in found] == [True] * 3
    assert same(found[0]).summary == same(found[1]).summary == same(found[2]).summary


@compiled
def test_native_runs_go_on_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    together = threading.Barrier(3, timeout=30.0)  # a run that waits alone fails
    found = rg.sweep("rhombus", NATIVE, keep=lambda _: together.wait() >= 0, **SHORT)
    assert [record.kept for record in found] == [True] * 6


def test_without_the_kernel_runs_go_to_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "0")
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # processes are slow to start
    found = rg.sweep("rhombus", NATIVE[:1], keep=process, **SHORT)
    assert found[0].ok and found[0].kept != os.getpid()
    monkeypatch.delenv("ROBUST_GCP_NATIVE")
    (asked,) = rg.sweep("rhombus", NATIVE[:1], workers=1, keep=process, **SHORT)
    assert asked.ok and asked.kept != os.getpid()
    assert replace(same(asked), kept=None) == serial(runs=NATIVE[:1])[0]


@compiled
@pytest.mark.parametrize(
    ("parameters", "native"),
    [
        ({}, True),
        ({"backend": "native", "step": 1e-3, "q0": np.zeros(3)}, True),
        ({"method": "classical"}, True),
        ({"torque": [1.0, 0.0, 0.0]}, True),
        ({"torque": lambda t, q, v: 0.0 * v}, False),
        ({"method": "classical", "newton_start": "previous"}, False),
        ({"method": "projection"}, False),
        ({"stepper": "DOP853"}, False),
        ({"backend": "python"}, False),
        ({"backend": "native", "stepper": "RK45"}, False),
        ({"method": np.zeros(2)}, False),
    ],
)
def test_runs_that_python_computes_are_known(parameters: dict[str, Any], native: bool) -> None:
    assert runs_natively(parameters) is native


@compiled
def test_one_run_in_python_sends_all_to_processes() -> None:
    found = rg.sweep("rhombus", [{}, {"backend": "python"}], keep=process, **SHORT)
    assert all(record.ok and record.kept != os.getpid() for record in found)


@compiled
def test_a_function_may_give_all_threads_the_same_mechanism(monkeypatch: pytest.MonkeyPatch) -> None:
    one = rg.load("bricard")
    runs = [{"q0": one.assemble(one.home + d)} for d in (0.0, 0.1, -0.1, 0.05, -0.05, 0.2)]
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        found = rg.sweep(lambda: one, runs, keep=end, duration=0.1, step=2e-3)
    finally:
        sys.setswitchinterval(before)
    for record, run in zip(found, runs, strict=True):
        again = rg.simulate(rg.load("bricard"), run["q0"], duration=0.1, step=2e-3)
        np.testing.assert_array_equal(record.kept["q"], again.q[-1])


@compiled
def test_warnings_of_threads_pass_the_filters_of_the_caller() -> None:
    runs = rg.grid(method=["classical"], q0=[[0.2, -0.2, 0.2], [0.3, -0.3, 0.3]])
    given: dict[str, Any] = {"duration": 1.0, "step": 1e-3}  # through the crossing, where digits are lost
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = rg.sweep("rhombus", runs, **given)
        said = [str(w.message) for w in caught if issubclass(w.category, rg.SingularityWarning)]
        caught.clear()
        assert [same(r) for r in found] == serial(runs=runs, **given)
        assert sorted(said) == sorted(str(w.message) for w in caught) and len(said) >= 2
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.SingularityWarning)
        refused = rg.sweep("rhombus", runs, **given)
    assert [r.failure.kind for r in refused if r.failure] == ["SingularityWarning"] * 2


@compiled
def test_threads_end_with_the_iterator() -> None:
    finished = []
    runs = [{"duration": 0.1}, *[{"duration": 3000.0}] * 3]  # each of the others would take half a minute
    records = rg.sweep_as_completed("crank_rocker", runs, step=1e-3, keep=lambda t: finished.append(len(t.t)))
    assert next(records).index == 0
    records.close()
    assert finished == [101]
    assert not [t for t in threading.enumerate() if t.name.startswith("robust_gcp sweep")]


@compiled
def test_a_model_that_does_not_load_fails_each_run() -> None:
    runs = NATIVE[:2]
    found = rg.sweep("nowhere", runs, **SHORT)
    assert [same(record) for record in found] == serial("nowhere", runs)
    assert all(record.failure and record.failure.ours for record in found)


# --------------------------------------------------------------------------- clusters


@pytest.mark.filterwarnings("ignore")  # Dask's own
def test_a_dask_cluster_gives_the_serial_results() -> None:
    distributed = pytest.importorskip("distributed", reason="Dask (pip install distributed) is not installed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        found = rg.sweep("rhombus", RUNS, executor=client.get_executor(), **SHORT)
    assert [same(r) for r in found] == serial()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Dask's own
def test_dask_workers_in_processes_of_their_own(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask (pip install distributed) is not installed")
    build = rg.load("rhombus")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None,
            local_directory=str(tmp_path),
        ) as cluster,
        distributed.Client(cluster) as client,
    ):  # fmt: skip
        found = rg.sweep(
            build, RUNS, executor=client.get_executor(), keep=lambda t: t.q[-1].tolist(), **SHORT
        )
    assert [r.kept for r in found] == [r.summary["q"] for r in serial(build) if r.summary]


@pytest.mark.parametrize("name", ["rhombus", "stewart", "andrews"])
def test_a_mechanism_travels_by_its_recipe(name: str) -> None:
    m = rg.load(name)
    for twin in (pickle.loads(pickle.dumps(m)), copy.copy(m), copy.deepcopy(m)):
        assert (twin.name, twin.independent, twin.closures) == (m.name, m.independent, m.closures)
        rng = np.random.default_rng(3)
        for _ in range(3):
            q = m.tree.integrate(m.home, rng.uniform(-1.0, 1.0, m.nv))
            v = rng.uniform(-1.0, 1.0, m.nv)
            np.testing.assert_array_equal(twin.K(q), m.K(q))
            np.testing.assert_array_equal(twin.k(q, v), m.k(q, v))
            assert twin.energy(q, v) == m.energy(q, v)


# --------------------------------------------------------------------------- failures


def crash(how: str = "no") -> rg.Mechanism:
    if how == "crash":
        os._exit(3)
    if how == "mistake":
        raise ZeroDivisionError("one divided by nothing")
    if how == "other":
        return "rhombus"  # type: ignore[return-value]
    return rg.load("rhombus")


def test_failures_stand_beside_successes() -> None:
    runs: list[dict[str, Any]] = [{}, {"q0": [0.0, 0.5, 0.0]}, {"how": "mistake"}, {"how": "other"}]
    good, open_loop, mistake, other = rg.sweep(crash, runs, workers=0, **SHORT)
    assert good.ok
    assert open_loop.failure and (open_loop.failure.kind, open_loop.failure.ours) == ("ClosureError", True)
    assert "is open by" in open_loop.failure.message and open_loop.summary is None
    assert mistake.failure and (mistake.failure.kind, mistake.failure.ours) == ("ZeroDivisionError", False)
    assert 'raise ZeroDivisionError("one divided by nothing")' in mistake.failure.trace
    assert other.failure and other.failure.message == "build must return a Mechanism, not str"


def test_a_run_that_stops_keeps_its_partial_summary() -> None:
    # the kite's crank turns back at −π/3, after some 0.76 s
    summary, whole = (
        rg.sweep("kite", [{}], workers=0, keep=keep, duration=1.0, step=5e-3, on_toggle="error")[0]
        for keep in ("summary", "trajectory")
    )
    assert summary.failure and summary.failure.kind == "ToggleError"
    assert summary.summary and 0.7 < summary.summary["t"] < 0.8
    assert summary.summary["max_closure_error"] < 1e-12
    assert whole.kept.t[-1] == summary.summary["t"] and summary.kept is None


def test_a_worker_that_dies_costs_one_run(tmp_path: Path) -> None:
    runs = [{"how": how} for how in ("no", "crash", "no", "no", "crash", "no")]
    found = rg.sweep(crash, runs, workers=2, file=tmp_path / "runs.jsonl", **SHORT)
    assert [r.ok for r in found] == [True, False, True, True, False, True]
    for record in (found[1], found[4]):
        assert record.failure and (record.failure.kind, record.failure.ours) == ("BrokenProcessPool", False)
        assert "the worker process died during this run" in record.failure.message
    again = rg.sweep(crash, runs[:1] + runs[2:4], workers=0, file=tmp_path / "runs.jsonl", **SHORT)
    assert all(r.resumed for r in again)


def test_an_executor_that_breaks_is_named() -> None:
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor,
        pytest.raises(rg.SweepError, match="BrokenProcessPool") as caught,
    ):
        rg.sweep(crash, [{"how": "crash"}], executor=executor, **SHORT)
    assert isinstance(caught.value, rg.RobustGcpError)


# --------------------------------------------------------------------------- as they come


def test_records_come_as_they_are_done() -> None:
    begun: list[int] = []
    records = rg.sweep_as_completed(
        "rhombus", RUNS, workers=0, progress=lambda d, n: begun.append(d), **SHORT
    )
    assert begun == []
    assert next(records).index == 0
    assert begun == [1]
    records.close()
    assert begun == [1]


def test_progress_and_records_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    told: list[tuple[int, int]] = []
    seen: list[rg.RunRecord] = []
    found = rg.sweep(
        "rhombus", RUNS, workers=0, progress=lambda *c: told.append(c), on_record=seen.append, **SHORT
    )
    assert told == [(i, 4) for i in (1, 2, 3, 4)]
    assert seen == found
    assert capsys.readouterr().err == ""
    rg.sweep("rhombus", RUNS[:2], workers=0, progress=True, **SHORT)
    assert "2/2" in capsys.readouterr().err


def test_trajectories_can_be_kept() -> None:
    found = rg.sweep("rhombus", RUNS[:1], workers=1, keep="trajectory", **SHORT)
    run = rg.simulate(rg.load("rhombus"), **RUNS[0], **SHORT)
    np.testing.assert_array_equal(found[0].kept.q, run.q)
    np.testing.assert_array_equal(found[0].kept.closure_error(), run.closure_error())


# --------------------------------------------------------------------------- the file


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The file of a sweep with two of its four runs done."""
    path = tmp_path / "new" / "runs.jsonl"
    rg.sweep("rhombus", RUNS[:2], workers=0, file=path, keep=end, **SHORT)
    return path


def test_an_interrupted_sweep_goes_on_from_its_file(file: Path) -> None:
    found = rg.sweep("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT)
    assert [r.resumed for r in found] == [True, True, False, False]
    fresh = rg.sweep("rhombus", RUNS, workers=0, file=file.with_name("other.jsonl"), keep=end, **SHORT)
    assert [same(r) for r in found] == [same(r) for r in fresh]
    assert file.read_text().count("\n") == 5
    before = file.read_bytes()
    assert all(r.resumed for r in rg.sweep("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT))
    assert file.read_bytes() == before


@pytest.mark.parametrize("cut", [1, 5, 200])
def test_a_torn_last_line_is_done_again(file: Path, cut: int) -> None:
    whole = file.read_bytes()
    file.write_bytes(whole[:-cut])
    found = rg.sweep("rhombus", RUNS[:2], workers=0, file=file, keep=end, **SHORT)
    assert [r.resumed for r in found] == [True, False]
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert [line["kept"] for line in lines[1:]] == [r.kept for r in found]


@pytest.mark.parametrize("left", [0, 3, 20])
def test_a_torn_first_line_is_written_again(file: Path, left: int) -> None:
    file.write_bytes(file.read_bytes()[:left])
    found = rg.sweep("rhombus", RUNS[:1], workers=0, file=file, keep=end, **SHORT)
    assert not found[0].resumed
    assert rg.sweep("rhombus", RUNS[:1], workers=0, file=file, keep=end, **SHORT)[0].resumed


def test_equal_runs_are_runs_of_their_own(file: Path) -> None:
    found = rg.sweep("rhombus", RUNS[:1] * 3, workers=0, file=file, keep=end, **SHORT)
    assert [r.resumed for r in found] == [True, False, False]
    assert all(r.resumed for r in rg.sweep("rhombus", RUNS[:1] * 3, workers=0, file=file, keep=end, **SHORT))


def test_refusals_are_kept_and_mistakes_are_tried_again(tmp_path: Path) -> None:
    runs: list[dict[str, Any]] = [{"q0": [0.0, 0.5, 0.0]}, {"how": "mistake"}]
    for resumed in ([False, False], [True, False], [True, False]):
        found = rg.sweep(crash, runs, workers=0, file=tmp_path / "runs.jsonl", **SHORT)
        assert [r.resumed for r in found] == resumed
        assert [r.failure.kind for r in found if r.failure] == ["ClosureError", "ZeroDivisionError"]


@pytest.mark.parametrize(
    ("build", "keep", "words"),
    [
        ("kite", end, "another sweep: its build is 'rhombus', not 'kite'"),
        ("rhombus", "summary", "another sweep: its keep is .*end.*, not 'summary'"),
    ],
)
def test_the_file_of_another_sweep_is_refused(file: Path, build: str, keep: Any, words: str) -> None:
    before = file.read_bytes()
    with pytest.raises(rg.OptionError, match=words):
        rg.sweep(build, RUNS, workers=0, file=file, keep=keep, **SHORT)
    assert file.read_bytes() == before


def test_mechanisms_that_differ_are_other_sweeps(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    rg.sweep(rg.load("rhombus"), [{}], workers=0, file=path, **SHORT)
    assert rg.sweep(rg.load("rhombus"), [{}], workers=0, file=path, **SHORT)[0].resumed
    with pytest.raises(rg.OptionError, match="another sweep: its build is 'rhombus "):
        rg.sweep(rg.load("rhombus", independent=["q3"]), [{}], workers=0, file=path, **SHORT)


def test_a_model_that_was_edited_is_another_sweep(tmp_path: Path) -> None:
    """It went on with what the model had been, without a word."""
    model, path = tmp_path / "own", tmp_path / "runs.jsonl"
    shutil.copytree(models_folder() / "crank_rocker", model)
    rg.sweep(model, [{}], workers=0, file=path, **SHORT)
    assert rg.sweep(str(model), [{}], workers=0, file=path, **SHORT)[0].resumed
    urdf = model / "robot.urdf"
    edited = urdf.read_text().replace('mass value="', 'mass value="1')
    assert edited != urdf.read_text()
    urdf.write_text(edited)
    with pytest.raises(rg.OptionError, match=r"another sweep: its build is '.*own "):
        rg.sweep(model, [{}], workers=0, file=path, **SHORT)


@pytest.mark.parametrize("text", ["t,q1,q2\n0,1,2\n", "notes", '{"format": "other"}\n', "\n"])
def test_other_files_are_not_touched(tmp_path: Path, text: str) -> None:
    path = tmp_path / "notes.txt"
    path.write_text(text)
    with pytest.raises(rg.OptionError, match="is not the file of a sweep"):
        rg.sweep("rhombus", RUNS, workers=0, file=path, **SHORT)
    assert path.read_text() == text


def test_a_line_that_was_spoilt_is_named(file: Path) -> None:
    lines = file.read_text().splitlines()
    file.write_text("\n".join([lines[0], '{"no": "run"}', lines[2], ""]))
    with pytest.raises(rg.OptionError, match=r"line 2: not a run of a sweep"):
        rg.sweep("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT)


def test_two_sweeps_do_not_write_to_one_file(file: Path) -> None:
    records = rg.sweep_as_completed("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT)
    next(records)
    with pytest.raises(rg.OptionError, match="another sweep is writing to this file"):
        rg.sweep("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT)
    records.close()
    assert len(rg.sweep("rhombus", RUNS, workers=0, file=file, keep=end, **SHORT)) == 4


def test_what_has_no_form_in_a_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    with pytest.raises(rg.OptionError, match=r"runs\[0\]\['torque'\] = <function"):
        rg.sweep("rhombus", [{"torque": lambda t, q, v: 0.0 * v}], workers=0, file=path, **SHORT)
    with pytest.raises(rg.OptionError, match="what keep returned"):
        rg.sweep("rhombus", [{}], workers=0, file=path, keep=pickle.dumps, **SHORT)


SCRIPT = """
import signal, sys, robust_gcp as rg
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background starts with it ignored
if __name__ == "__main__":
    runs = rg.grid(step=[5e-3, 4e-3, 3e-3, 1e-5, 1.1e-5, 1.2e-5, 1.3e-5])
    print("begun", flush=True)
    rg.sweep("crank_rocker", runs, workers=2, file=sys.argv[1], duration=5.0)
"""


def processes_of(group: int) -> list[int]:
    """Live processes of a process group."""
    found = subprocess.run(["ps", "-eo", "pid=,pgid=,stat="], capture_output=True, text=True, check=True)
    rows = [line.split() for line in found.stdout.splitlines()]
    return [int(pid) for pid, pgid, stat in rows if int(pgid) == group and not stat.startswith("Z")]


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interruption_leaves_no_process_and_a_file_to_go_on_from(tmp_path: Path, how: int) -> None:
    script, path = tmp_path / "script.py", tmp_path / "runs.jsonl"
    script.write_text(SCRIPT)
    child = subprocess.Popen(
        [sys.executable, str(script), str(path)], start_new_session=True, stderr=subprocess.PIPE, text=True,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        until = time.monotonic() + 120.0
        while (not path.exists() or path.read_text().count("\n") < 4) and time.monotonic() < until:
            time.sleep(0.05)
        if how == signal.SIGINT:
            os.killpg(child.pid, how)  # as Ctrl-C in a terminal: the workers get it too
        else:
            child.send_signal(how)
        _, err = child.communicate(timeout=60.0)
        assert child.returncode == -how or "KeyboardInterrupt" in err
        while processes_of(child.pid) and time.monotonic() < until:
            time.sleep(0.05)
        assert processes_of(child.pid) == []
    finally:
        if processes_of(child.pid):
            os.killpg(child.pid, signal.SIGKILL)
    short = [{"step": s} for s in (5e-3, 4e-3, 3e-3)]
    assert all(r.resumed for r in rg.sweep("crank_rocker", short, workers=0, file=path, duration=5.0))


# --------------------------------------------------------------------------- refused before anything runs


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"build": 7}, "build = 7 must be"),
        ({"runs": {"step": 1e-3}}, "must be a list of dicts"),
        ({"runs": "abc"}, "must be a list of dicts"),
        ({"runs": [{}, 3]}, r"runs\[1\] = 3 must be a dict"),
        ({"runs": [{"stepp": 1e-3}]}, "simulate has no parameter 'stepp'"),
        ({"runs": [{"progress": print}]}, "progress is not a parameter of a run"),
        ({"build": linkages.four_bar, "runs": [{"l9": 1.0}]}, "build cannot be called with l9"),
        ({"executor": "threads"}, "must be a concurrent.futures.Executor"),
        ({"workers": -1}, "workers = -1"),
        ({"workers": 1.5}, "workers = 1.5"),
        ({"keep": "everything"}, "keep = 'everything'"),
        ({"keep": "trajectory", "file": "x.jsonl"}, "does not go to a file"),
        ({"progress": 3}, "progress = 3"),
    ],
)
def test_bad_arguments_are_refused(given: dict[str, Any], words: str) -> None:
    arguments: dict[str, Any] = {"build": "rhombus", "runs": RUNS, "workers": 0, **given}
    if "executor" in given:
        del arguments["workers"]
    with pytest.raises(rg.OptionError, match=words):
        rg.sweep_as_completed(**arguments)


def test_functions_that_cannot_travel_are_named() -> None:
    with pytest.raises(rg.OptionError, match=r"keep = <function .* cannot be sent to worker processes"):
        rg.sweep("rhombus", RUNS, workers=1, keep=lambda t: 0, **SHORT)
    with pytest.raises(rg.OptionError, match=r"runs\[0\] = .* cannot be sent to worker processes"):
        rg.sweep("rhombus", [{"torque": lambda t, q, v: 0.0 * v}], workers=1, **SHORT)


def test_a_script_without_a_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text('import robust_gcp as rg\nrg.sweep("rhombus", [{}], workers=1, duration=0.1)\n')
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 1
    assert (
        "SweepError: worker processes cannot start; in a script, call sweep below `if __name__ =="
        in done.stderr
    )


def test_no_runs_are_no_records(tmp_path: Path) -> None:
    assert rg.sweep("rhombus", []) == rg.sweep("rhombus", [], file=tmp_path / "runs.jsonl") == []


def constant_speed(t: Any) -> Any:
    return 1.0 + 3.0 * t


def test_a_driven_sweep_resumes_from_its_file(tmp_path: Path) -> None:
    """A motion is known by the functions, numbers and tables that it was made of."""
    path = tmp_path / "driven.jsonl"
    table = (np.linspace(0.0, 0.1, 7), 1.0 + 0.1 * np.linspace(0.0, 0.1, 7))
    motions = [rg.Motion(constant_speed), rg.Motion(1.0), rg.Motion(table)]

    def swept(motions: list[rg.Motion]) -> list[rg.RunRecord]:
        runs = [{"drive": {"q1": motion}} for motion in motions]
        return rg.sweep("slider_crank", runs, workers=0, file=path, duration=0.02, step=1e-2)

    first, again = swept(motions), swept([*motions, rg.Motion(1.5)])
    assert all(record.ok for record in [*first, *again])
    assert [record.resumed for record in again] == [True, True, True, False]
    with pytest.raises(rg.OptionError, match=r"position.*defined at the top of a module"):
        swept([rg.Motion(lambda t: 1.0 + t)])


def test_records_are_a_table(tmp_path: Path) -> None:
    """Parameters, numbers and failures, a row a run; the list is what it was."""
    runs = [{"q0": [0.2, -0.2, 0.2]}, {"q0": [9.0, 0.0, 0.0]}, {"q0": [0.3, -0.3, 0.3], "t0": 1.5}]
    records = rg.sweep("rhombus", runs, workers=0, duration=0.5, step=5e-3)
    assert isinstance(records, list) and [record.ok for record in records] == [True, False, True]
    table = records.to_dataframe()
    assert table.index.tolist() == [0, 1, 2] and table["ok"].tolist() == [True, False, True]
    assert table["t0"].tolist()[2] == 1.5 and table["q.0"][0] == records[0].summary["q"][0]
    assert table["crossings"][2] == records[2].summary["crossings"]
    assert table["stats.rhs"][0] == records[0].summary["stats"]["rhs"]
    assert "ClosureError" in table["failure"][1] and table["q.0"].isna().tolist() == [False, True, False]
    with records.to_csv(tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[2]["v.1"]) == records[2].summary["v"][1] and rows[1]["v.1"] == ""
    assert rg.sweep("rhombus", [], workers=0).columns() == {}


def crank_of(t: float, ok: bool, index: int) -> rg.Mechanism:
    """Parameters that are called as columns are."""
    return rg.load("crank_rocker")


def test_parameters_called_as_columns_are_kept() -> None:
    runs = [{"t": 0.5, "ok": False, "index": 7}]
    table = rg.sweep(crank_of, runs, workers=0, duration=0.1, step=1e-2).columns()
    assert (table["index"], table["ok"], table["t"]) == ([0], [True], [0.1])
    assert (table["build.index"], table["build.ok"], table["build.t"]) == ([7], [False], [0.5])
