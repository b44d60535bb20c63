"""What crosses to the compiled kernel and back: signals, exceptions, sizes, constants, damaged files."""

from __future__ import annotations

import gc
import importlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import weakref
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.checks import real_array
from robust_gcp.kernel import library, structures
from robust_gcp.kernel.simulation.workspace import Workspace

Array = NDArray[np.float64]

SOURCES = Path(__file__).parents[2] / "robust_gcp" / "kernel"  # headers stay in the checkout

pytestmark = pytest.mark.skipif(
    not rg.backends()["native"].available, reason="the compiled kernel is not built"
)


class AlarmError(Exception):
    """What the handler here raises."""


def gentle(t: float, q: Array, v: Array) -> Array:
    return np.array([0.1 * np.sin(t), 0.0, 0.0])


def run_for(mechanism: rg.Mechanism, duration: float, stepper: str) -> None:
    rg.simulate(
        mechanism,
        [0.2, -0.2, 0.2],
        duration=duration,
        step=2e-5,
        torque=gentle,
        stepper=stepper,
        rtol=1e-12,
        atol=1e-14,
    )


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers")
@pytest.mark.skipif(
    threading.current_thread() is not threading.main_thread(), reason="signals go to the main thread"
)
@pytest.mark.parametrize("stepper", ["rk4", "LSODA", "DOP853"])
@pytest.mark.parametrize("wanted", [KeyboardInterrupt, AlarmError])
def test_signals_are_answered(wanted: type[BaseException], stepper: str) -> None:
    """Whatever is at work when one arrives, kernel or torque function: Ctrl-C's exception, or another."""

    def raising(signum: int, frame: object) -> None:
        raise wanted

    mechanism = rg.load("rhombus")  # before: a file that is just being opened is left open by any signal
    run_for(mechanism, 1e-3, stepper)  # modules that are imported at first use are not what is interrupted
    usual = signal.signal(signal.SIGALRM, raising)
    try:
        for i in range(12 if stepper == "rk4" else 2):
            signal.setitimer(signal.ITIMER_REAL, 0.05 + 0.0037 * i)
            with pytest.raises(wanted):
                run_for(mechanism, 600.0, stepper)  # minutes, if nothing stopped it
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, usual)


def test_numbers_in_lists_leave_signals_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """What arrives while they are made an array is not taken for what is wrong with them."""

    def interrupted(*args: Any, **named: Any) -> Any:
        raise AlarmError

    monkeypatch.setattr("robust_gcp.checks.np.asarray", interrupted)
    for given in ([0.2, -0.2, 1], (1.0,), [[1.0, 2.0], [3.0, 4.0]]):
        with pytest.raises(AlarmError):
            real_array(given)
    with pytest.raises(TypeError, match="no array"):
        real_array([object()])


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt, SystemExit, MemoryError, ZeroDivisionError, GeneratorExit]
)
def test_every_exception_of_a_torque_function_reaches_the_caller(error: type[BaseException]) -> None:
    mechanism = rg.load("rhombus")

    def torque(t: float, q: Array, v: Array) -> Array:
        if t > 0.0123:
            raise error("mine")
        return np.zeros(3)

    with pytest.raises(error, match="mine"):
        rg.simulate(mechanism, [0.2, -0.2, 0.2], duration=0.1, torque=torque, backend="native")
    run = rg.simulate(mechanism, [0.2, -0.2, 0.2], duration=0.1, torque=gentle, backend="native")
    assert run.stats.native_steps > 0


def copied(folder: Path) -> Path:
    """The library with its report, elsewhere."""
    for name in (library.NAME, library.REPORT):
        shutil.copyfile(library._installed(name), folder / name)
    return folder / library.NAME


def attempt(path: Path) -> str:
    """What a process of its own says of a library, and how it ended."""
    code = (
        "import robust_gcp as rg; state = rg.backends()['native']; print(state.available, state.reason)\n"
        "r = rg.simulate(rg.load('rhombus'), duration=0.01); print(r.stats.native_steps)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, library.SWITCH: str(path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("part", [0.0, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_library_is_not_loaded(tmp_path: Path, part: float) -> None:
    path = copied(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    told = attempt(path)
    assert told.startswith("False") and "truncated or changed" in told and told.endswith("\n0\n")


def test_a_changed_byte_is_found_and_a_whole_library_is_loaded(tmp_path: Path) -> None:
    path = copied(tmp_path)
    assert attempt(path).startswith("True")
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    path.write_bytes(damaged)
    assert "truncated or changed" in attempt(path)


def test_a_report_without_a_checksum_is_no_hindrance(tmp_path: Path) -> None:
    path = copied(tmp_path)
    (tmp_path / library.REPORT).write_text(json.dumps({"status": "built"}), encoding="utf-8")
    assert attempt(path).startswith("True")


def test_structures_of_another_size_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Longer(structures.Request):
        _fields_ = [("more", structures.c_int64)]  # noqa: RUF012

    monkeypatch.setattr(library, "Request", Longer)
    with pytest.raises(OSError, match="Longer has"):
        library.Library(library._installed(library.NAME))


# --------------------------------------------------------------------------- copies by hand


def constants(header: str) -> dict[str, float]:
    """Numbers that a header names."""
    text = next(SOURCES.rglob(header)).read_text(encoding="utf-8")
    found = {}
    for line in re.findall(r"constexpr (?:double|int|std::int32_t) ([^;]*);", text):
        found |= {name: float(value) for name, value in re.findall(r"(\w+) = ([-\d.e]+)", line)}
    return found


@pytest.mark.parametrize(
    ("header", "homes"),
    [
        ("abi.h", ["kernel.structures"]),
        ("branch.h", ["maps.regular_path", "maps.cluster.regular_ground", "maps.cluster.regular_ground"]),
        ("loops.h", ["maps.regular_path", "maps.cluster.regular_ground"]),
        ("jet.h", ["maps.cluster.jet"]),
        ("newton.h", ["maps.cluster.jet"]),
        ("solver.h", ["maps.explicit", "mechanism.differences"]),
        ("singular.h", ["maps.cluster.jet"]),
        ("obstacles.h", ["maps.cluster.obstacles"]),
        ("patch.h", ["maps.cluster.known_curves", "maps.cluster.patch"]),
        ("curve.h", ["maps.cluster.curve"]),
        ("curve_builder.h", ["maps.cluster.curve_builder"]),
        ("tracker.h", ["maps.cluster.tracker", "maps.cluster.apex", "maps.cluster.patch"]),
        ("chart.h", ["maps.cluster.chart"]),
        ("clusters.cpp", ["maps.cluster.cluster_map", "maps.cluster.regular_ground"]),
        ("motion.h", ["dynamics.reduced_inertia"]),
    ],
)
def test_constants_of_the_kernel_are_those_of_python(header: str, homes: list[str]) -> None:
    # of the kernel: where it asks Python, where it does not factorise anew, and what it remembers
    own = {"LOOK_AGAIN", "CHORD", "MAX_OBSTACLES"}
    modules = [importlib.import_module(f"robust_gcp.{home}") for home in homes]
    found = constants(header)
    assert found
    for name, value in found.items():
        if name in own:
            continue
        owners = [module for module in modules if hasattr(module, name)]
        assert owners, name
        assert [float(getattr(owner, name)) for owner in owners] == [value] * len(owners), name


def enumeration(header: str, name: str) -> dict[str, int]:
    """The members of an enum, with their values."""
    text = next(SOURCES.rglob(header)).read_text(encoding="utf-8")
    found = re.search(rf"enum {name} : std::int32_t {{(.*?)}};", text, re.DOTALL)
    assert found is not None
    body = re.sub(r"//[^\n]*", "", found.group(1))
    members: dict[str, int] = {}
    for item in filter(None, (part.strip() for part in body.split(","))):
        key, _, value = item.partition("=")
        members[key.strip()] = int(value) if value else len(members)
    return members


def test_reasons_and_kinds_have_the_same_numbers() -> None:
    from robust_gcp.mechanism.tree.joints import JointKind

    assert enumeration("abi.h", "Reason") == {reason.name: reason.value for reason in structures.Reason}
    kinds = {kind.name: int(kind) for kind in JointKind}
    theirs = enumeration("joints.h", "Kind")
    assert theirs == {name: kinds[name] for name in theirs}


@pytest.mark.parametrize("fails", [False, True])
def test_a_run_gives_the_kernels_memory_back_when_it_ends(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    """At once, without the collector, whose turn might be when a signal is to be answered."""
    alive: weakref.WeakSet[Workspace] = weakref.WeakSet()
    made: list[int] = []
    begin = Workspace.__init__

    def noted(self: Workspace, *args: Any) -> None:
        begin(self, *args)
        alive.add(self)
        made.append(1)

    def torque(t: float, q: Array, v: Array) -> Array:
        if fails and t > 0.05:
            raise AlarmError
        return gentle(t, q, v)

    monkeypatch.setattr(Workspace, "__init__", noted)
    mechanism = rg.load("rhombus")
    gc.disable()
    try:
        with pytest.raises(AlarmError) if fails else nullcontext():
            rg.simulate(mechanism, duration=0.1, torque=torque, backend="native")
        assert made
        assert not alive
    finally:
        gc.enable()
