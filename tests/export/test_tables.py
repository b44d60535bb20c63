"""C tables of one coordinate: the motion of `simulate`, through crossings, to 1e-9."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler")


def _compiled(mech: rg.Mechanism, folder: Path, name: str = "robot") -> Any:
    mech.export(folder / f"{name}.c")
    library = folder / f"{name}.so"
    flags = "-std=c99 -O2 -Wall -Wextra -pedantic -Werror -shared -fPIC"
    words = [str(COMPILER), *flags.split(" ")]
    subprocess.run([*words, str(folder / f"{name}.c"), "-lm", "-o", str(library)], check=True, timeout=60)
    found = ctypes.CDLL(str(library))
    function = getattr(found, f"{name}_acceleration")
    function.restype, function.argtypes = ctypes.c_double, 3 * [ctypes.c_double]
    step = getattr(found, f"{name}_step")
    place = ctypes.POINTER(ctypes.c_double)
    step.restype, step.argtypes = None, [place, place, ctypes.c_double, ctypes.c_double]
    return found


@needs_compiler
@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point", "crank_rocker", "slider_crank"])
def test_motions_are_those_of_simulate(name: str, tmp_path: Path) -> None:
    mech, h = rg.load(name), 1e-3
    table, tau = _compiled(mech, tmp_path), 0.2
    run = rg.simulate(mech, duration=5.0, step=h, torque={mech.independent[0]: tau})
    own, pace = mech.iq_independent[0], mech.iv_independent[0]
    y, u = ctypes.c_double(float(run.q[0][own])), ctypes.c_double(float(run.v[0][pace]))
    worst = 0.0
    for k in range(1, 5001):
        table.robot_step(y, u, h, tau)
        worst = max(worst, abs(y.value - float(run.q[k][own])))
    assert worst < 1e-9
    assert name in ("crank_rocker", "slider_crank") or run.crossings


@needs_compiler
def test_springs_and_dampers(tmp_path: Path) -> None:
    plain = rg.load("crank_rocker")
    forces = [rg.JointDamper("q2", 0.3), rg.JointSpring("q3", 2.0, 0.5)]
    mech = rg.Mechanism(plain.model, plain.closures, plain.independent, plain.home, forces=forces)
    table, rng = _compiled(mech, tmp_path), np.random.default_rng(0)
    run = rg.simulate(mech, duration=12.0, step=1e-3, drive={"q1": rg.Motion(lambda t: mech.home[0] + t)})
    for k in rng.integers(0, len(run.t), 30).tolist():
        u, tau = rng.normal(), rng.normal()
        applied = np.array([tau, 0.0, 0.0])
        expected = rg.forward_dynamics(mech, run.q[k], mech.lift(run.q[k], [u]), applied)[0]
        found = table.robot_acceleration(float(run.q[k][0]), u, tau)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


TURNING_BACK = {"kite": "q1", "crank_rocker": "q3", "slider_crank": "q3", "bricard": "hinge1"}


@needs_compiler
@pytest.mark.parametrize("name", TURNING_BACK)
def test_by_arc_length_where_the_joint_turns_back(name: str, tmp_path: Path) -> None:
    """Both by steps so short that their errors, which differ, do not show."""
    joint = TURNING_BACK[name]
    mech, h, tau = rg.load(name).with_independent([joint]), 2e-4, 0.02
    table = _compiled(mech, tmp_path)
    for function in (table.robot_joint, table.robot_rate):
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
    own, pace = mech.iq_independent[0], mech.iv_independent[0]
    assert table.robot_joint(0.0) == pytest.approx(mech.home[own], abs=1e-10)
    fine = rg.simulate(
        mech, mech.home, mech.lift(mech.home, [0.5]), duration=4.0, step=h, torque={joint: tau}
    )
    s, u = ctypes.c_double(0.0), ctypes.c_double(0.5 / table.robot_rate(0.0))
    worst = 0.0
    for k in range(1, len(fine.t)):
        table.robot_step(s, u, h, tau)
        worst = max(worst, abs(table.robot_joint(s.value) - float(fine.q[k][own])))
    assert worst < 2e-9
    assert u.value * table.robot_rate(s.value) == pytest.approx(float(fine.v[-1][pace]), abs=1e-8)


def test_what_is_another_after_a_turn_is_told(tmp_path: Path) -> None:
    """A crank that turns on and on winds its spring up."""
    mech = rg.load("crank_rocker")
    wound = rg.Mechanism.from_pinocchio(
        mech.own_model,
        list(mech.closures),
        mech.independent,
        home=mech.home,
        forces=[rg.JointSpring("q1", 2.0)],
    )
    with pytest.raises(rg.ModelError, match="another after a turn, as of a spring"):
        wound.export(tmp_path / "wound.c")


@needs_compiler
@pytest.mark.parametrize("file", ["2f85", "a-b.c d"])
def test_files_of_any_name(file: str, tmp_path: Path) -> None:
    """What is in them has names of C's; the code asks for its header by the file's."""
    code = rg.load("crank_rocker").export(tmp_path / f"{file}.c")
    words = [str(COMPILER), "-std=c99", "-c", str(code), "-o", str(tmp_path / "object")]
    subprocess.run(words, check=True, timeout=60)


@pytest.mark.parametrize(("name", "why"), [("five_bar", "one coordinate"), ("delta", "one coordinate")])
def test_what_has_no_table(name: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(rg.ModelError, match=why):
        rg.load(name).export(tmp_path / "robot.c")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_what_the_method_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = [tmp_path / folder / "rhombus.c" for folder in ("one", "two")]
    for place in places:
        place.parent.mkdir()
    assert main(["export", "rhombus", str(places[0])]) == 0
    assert "wrote" in capsys.readouterr().out
    rg.load("rhombus").export(places[1])
    assert places[0].read_text() == places[1].read_text()
    assert main(["export", "rhombus", str(tmp_path / "one.step")]) == 2
    assert "the suffix .step is unknown" in capsys.readouterr().err


def test_a_file_that_was_there_stays_whole_until_the_new_one_is(tmp_path: Path) -> None:
    path, kept = tmp_path / "robot.rgcp", tmp_path / "kept"
    path.write_bytes(b"old")
    os.link(path, kept)
    rg.load("five_bar").export(path)
    assert kept.read_bytes() == b"old" != path.read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["kept", "robot.rgcp"]
    with pytest.raises(rg.ModelError, match="cannot be written"):
        rg.load("five_bar").export(tmp_path / "none" / "robot.rgcp")


@needs_compiler
def test_names_that_c_does_not_take(tmp_path: Path) -> None:
    """What ends a comment, and letters beyond ASCII, which are in no name of portable C."""
    plain = rg.load("crank_rocker")
    mech = rg.Mechanism(plain.model, plain.closures, plain.independent, plain.home, "a*/b")
    _compiled(mech, tmp_path)
    mech.export(tmp_path / "mühle.c")
    assert "double m_hle_acceleration(" in (tmp_path / "mühle.h").read_text(encoding="utf-8")
    with pytest.raises(rg.OptionError, match="cannot be included in C"):
        mech.export(tmp_path / 'a"b.c')
