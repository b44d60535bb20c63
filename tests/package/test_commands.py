"""The command line as a user meets it: what it prints, writes and refuses."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp import printing
from robust_gcp.__main__ import main, shield
from robust_gcp.arguments import number

Capture = pytest.CaptureFixture[str]
SHORT = ["--duration", "0.1", "--step", "5e-3"]


def run(line: str, *more: str) -> int:
    return main([*line.split(), *more])


def read_csv(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, np.array(rows, dtype=float)


# --------------------------------------------------------------------------- words


def test_numbers_and_multiples_of_pi() -> None:
    texts = ("0.25", "-1e-3", "pi", " -pi ", "pi/3", "-2*pi/3", "2pi")
    values = (0.25, -1e-3, math.pi, -math.pi, math.pi / 3, -2 * math.pi / 3, 2 * math.pi)
    assert [number(text) for text in texts] == pytest.approx(values, rel=1e-15)


@pytest.mark.parametrize("text", ["pie", "", "pi/", "1,2"])
def test_other_words_are_no_numbers(text: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        number(text)


def test_only_negative_numbers_are_shielded_from_argparse() -> None:
    given = ["--q0", "-pi", "-1e-3", "-h", "0.2", "-pi/0", "rhombus"]
    assert [shield(x) for x in given] == ["--q0", " -pi", " -1e-3", "-h", "0.2", "-pi/0", "rhombus"]


@pytest.mark.parametrize("command", ["", "simulate", "analyse", "models", "reports", "reports paper"])
def test_help_on_each_command(command: str, capsys: Capture) -> None:
    with pytest.raises(SystemExit) as exit:
        main([*command.split(), "--help"])
    assert exit.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: robust-gcp {command}".rstrip())


@pytest.mark.parametrize("given", [[], ["simulat"], ["simulate"], ["simulate", "rhombus", "--fast"]])
def test_words_that_are_not_understood_exit_with_2(given: list[str], capsys: Capture) -> None:
    with pytest.raises(SystemExit) as exit:
        main(given)
    assert exit.value.code == 2
    told = capsys.readouterr().err
    assert "robust-gcp" in told
    assert len(told.splitlines()) <= 4  # the usage does not bury what is wrong


def test_a_value_by_name_that_is_no_number_is_shown(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main(["simulate", "rhombus", "--torque", "q1=a"])
    assert "--torque: 'a' of 'q1=a' is no number" in capsys.readouterr().err


# --------------------------------------------------------------------------- simulate


def test_summary_tells_state_certificates_crossings_and_cost(capsys: Capture) -> None:
    assert run("simulate rhombus --duration 0.3 --step 2e-3") == 0
    out, err = capsys.readouterr()
    assert err == ""
    trajectory = rg.simulate(rg.load("rhombus"), duration=0.3, step=2e-3)
    for words in (
        "rhombus",
        "method bridge; rk4, step 0.002 s",
        "state at t = 0.3 s",
        f"{trajectory.q[-1, 1]:.8f}",
        f"{trajectory.v[-1, 2]:.8f}",
        "rad, rad/s",
        "max closure error",
        "max |energy error|",
        f"right-hand sides    {trajectory.stats.rhs}",
        "wall time",
        "crossings           1",
        "transversal",
    ):
        assert words in out
    # From y = 0.2 at rest the exact motion passes y = 0 at 0.185698051586 s (elliptic functions).
    assert "0.185698  0.000000  transversal" in out
    assert max(map(len, out.splitlines())) <= 80


def test_joints_to_hold_are_looked_at_without_a_guess_too(capsys: Capture) -> None:
    assert main(["assemble", "rhombus", "--hold", "q1"]) == 0
    assert "q1      0.20000000" in capsys.readouterr().out
    assert main(["assemble", "rhombus", "--hold", "none"]) == 2
    assert "no joint 'none'" in capsys.readouterr().err


def test_csv_holds_the_trajectory_to_the_last_digit(tmp_path: Path, capsys: Capture) -> None:
    record = ["--record", "a,energy,multipliers"]
    start = ["--q0", "-0.3", "0.3", "-0.3", "--v0", "-1", "1", "-1"]
    folder = tmp_path / "new" / "runs"
    assert main(["simulate", "rhombus", *start, *SHORT, *record, "--out", str(folder)]) == 0
    path = folder / "rhombus_bridge.csv"
    assert f"wrote {path}" in capsys.readouterr().out
    header, rows = read_csv(path)
    t = rg.simulate(
        rg.load("rhombus"),
        [-0.3, 0.3, -0.3],
        [-1.0, 1.0, -1.0],
        duration=0.1,
        step=5e-3,
        record=("a", "energy", "multipliers"),
    )
    assert t.a is not None and t.energy is not None and t.multipliers is not None
    names = [f"{x}.q{i}" for x in "qva" for i in (1, 2, 3)]
    reactions = [f"lambda.coupler_tip-rocker_tip.{axis}" for axis in "yz"]
    assert header == ["t", *names, "energy", *reactions]
    np.testing.assert_array_equal(rows, np.column_stack([t.t, t.q, t.v, t.a, t.energy, t.multipliers]))


@pytest.mark.parametrize("method", ["bridge", "projection", "classical", "closed_form"])
@pytest.mark.parametrize("stepper", ["rk4", "DOP853"])
def test_every_method_and_stepper(method: str, stepper: str, capsys: Capture) -> None:
    assert run("simulate crank_rocker", *SHORT, "--method", method, "--stepper", stepper) == 0
    out = capsys.readouterr().out
    assert f"method {method}" in out
    assert f"; {stepper}, step 0.005 s" in out


def test_mode_of_a_singular_start_by_its_number(capsys: Capture) -> None:
    modes = rg.analyse(rg.load("rhombus"), [0, 0, 0]).modes
    index = next(i for i, mode in enumerate(modes) if abs(mode[0]) > 0.5)
    start = ["simulate", "rhombus", "--q0", "0", "0", "0", *SHORT]
    assert main([*start, "--mode", str(index)]) == 0
    trajectory = rg.simulate(rg.load("rhombus"), [0, 0, 0], duration=0.1, step=5e-3, mode=modes[index])
    assert f"{trajectory.q[-1, 0]:.8f}" in capsys.readouterr().out
    assert main(start) == 2
    assert "--mode INDEX" in capsys.readouterr().err
    assert main([*start, "--mode", "2"]) == 2
    assert "--mode 2: analyse lists 2 modes" in capsys.readouterr().err


def test_a_run_that_stops_tells_how_far_and_keeps_the_rows(tmp_path: Path, capsys: Capture) -> None:
    # The kite's crank reaches no further than −π/3: a toggle, after some 0.76 s of falling.
    path = tmp_path / "named.csv"
    given = ["simulate", "kite", "--duration", "1", "--step", "5e-3", "--out", str(path)]
    assert main([*given, "--on-toggle", "error"]) == 2
    out, err = capsys.readouterr()
    header, rows = read_csv(path)
    assert out == ""
    assert "robust_gcp: toggle" in err and "q2" in err
    assert f"simulated until t = {rows[-1, 0]:.6g} s ({len(rows)} rows)" in err
    assert f"wrote {path}" in err
    assert 0.7 < rows[-1, 0] < 0.8 and rows[-1, header.index("q.q1")] > -math.pi / 3
    assert main([*given, "--on-toggle", "repartition"]) == 0
    assert "s: y = q" in capsys.readouterr().out
    assert read_csv(path)[1][-1, 0] == 1.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("simulate rhombis", "did you mean 'rhombus'"),
        (
            "simulate rhombus --q0 0.2 -0.2",
            "q0 has shape (2,), expected (nq,) = (3,)",
        ),
        ("simulate rhombus --v0 1 0 0", "velocity breaks the loop"),
        ("simulate rhombus --step -1e-3", "step = -0.001 must be positive"),
        ("simulate rhombus --duration nan", "duration = nan must be positive and finite"),
        ("simulate rhombus --q0 0.2 0.3 0.2", "coupler_tip – rocker_tip is open by"),
        ("simulate rhombus --q0 nan 0 0", "q0"),
        ("simulate rhombus --record a,speed", "record = 'speed' is unknown"),
        ("simulate rhombus --plot motion.jpg", "a figure is a .png or a .pdf file"),
        ("simulate rhombus --speed 2", "--speed goes with --animate"),
        ("simulate rhombus --newton-start previous", "--newton-start goes with --method classical"),
        ("export rhombus r.rgcp --fmi 3", "--fmi goes with a unit for co-simulation"),
        ("export rhombus r.c --step 1e-3", "--step goes with a unit for co-simulation"),
        ("analyse rhombus --q 0 0", "q has shape (2,)"),
        ("analyse rhombus --q 0 0 1", "is open by"),
        ("analyse no/such/folder", "neither a folder with robot.yaml or one robot"),
    ],
)
def test_bad_input_is_one_clear_line_and_exit_2(given: str, words: str, capsys: Capture) -> None:
    assert run(given) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("robust_gcp: ") and err.count("\n") == 1
    assert words in err


def test_an_output_that_cannot_be_written_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["simulate", "rhombus", *SHORT, "--out", str(tmp_path / "file" / "x.csv")]) == 2
    refused = ["simulate", "rhombus", "--duration", "1", "--outputs", "0.5", "0.2"]
    assert main([*refused, "--out", str(tmp_path / "new" / "folder")]) == 2
    assert not (tmp_path / "new").exists()
    assert capsys.readouterr().err.startswith("robust_gcp: ")


# --------------------------------------------------------------------------- torques, drives, pictures


def test_torques_act_by_joint(capsys: Capture) -> None:
    assert run("simulate crank_rocker --torque q1=0.5 q3=-pi --torque q2=1", *SHORT, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    torque = {"q1": 0.5, "q2": 1.0, "q3": -math.pi}
    trajectory = rg.simulate(rg.load("crank_rocker"), duration=0.1, step=5e-3, torque=torque)
    assert list(told["q"].values()) == trajectory.q[-1].tolist()
    assert list(told["v"].values()) == trajectory.v[-1].tolist()


SERVED = """<mujoco><option><flag contact="disable"/></option><worldbody>
<body><joint name="hinge" axis="0 1 0" range="-20 20"/>
<geom size="0.1" pos="0.5 0 0"/></body><body pos="0 1 0"><joint name="rail" type="slide" axis="1 0 0"/>
<geom size="0.1"/></body></worldbody><actuator><motor name="spin" joint="hinge" gear="2"/>
<position name="shift" joint="rail" kp="20"/></actuator></mujoco>"""


def test_actuators_are_controlled_by_name(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "served.xml"
    file.write_text(SERVED)
    start = ["simulate", str(file), *SHORT, "--limits"]
    assert main([*start, "--ctrl", "spin=0.7", "--ctrl", "shift=-pi", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    mech, ctrl = rg.load(file, limits=True), {"spin": 0.7, "shift": -math.pi}
    run_ = rg.simulate(mech, duration=0.1, step=5e-3, ctrl=ctrl)
    assert list(told["q"].values()) == run_.q[-1].tolist() and abs(run_.q[-1]).min() > 1e-3
    assert main([*start, "--ctrl", "spin=1", "shift=2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["q"]["rail"] > 0.0
    for given, words in (
        ("spinn=1", "--ctrl: there is no actuator 'spinn'; did you mean 'spin'?"),
        ("spin=nan", "--ctrl spin = nan"),
        ("spin=fast", "--ctrl"),
        ("spin", "is not NAME=VALUE"),
    ):
        with contextlib.suppress(SystemExit):
            assert main([*start, "--ctrl", given]) == 2
        assert words in capsys.readouterr().err
    assert main([*start, "--ctrl", "spin=1", "spin=2"]) == 2
    assert "--ctrl names 'spin' twice" in capsys.readouterr().err
    file.write_text(SERVED.partition("<actuator>")[0] + "</mujoco>")
    assert main([*start, "--ctrl", "spin=1"]) == 2
    assert "has no actuators; give --torque JOINT=TAU\n" in capsys.readouterr().err


def test_a_joint_is_driven_at_constant_speed_from_where_it_starts(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "run.npz"
    assert run("simulate slider_crank --drive-speed q1=3", *SHORT, "--save", str(path)) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    mech = rg.load("slider_crank")
    saved = rg.load_trajectory(path)
    np.testing.assert_allclose(saved["q1"], mech.home[0] + 3.0 * saved.t, rtol=1e-12)
    drive = {"q1": rg.Motion(lambda t: mech.home[0] + 3.0 * t)}
    there = rg.simulate(mech, duration=0.1, step=5e-3, drive=drive)
    np.testing.assert_allclose(saved["drive.q1"], there["drive.q1"], rtol=1e-9, atol=1e-9)
    assert saved.acted is not None and not saved.acted.lost
    start = mech.assemble({"q1": 2.0})
    given = ["--q0", *map(str, start), "--drive-speed", "q1=-1", "--json"]
    assert run("simulate slider_crank", *SHORT, *given) == 0
    assert json.loads(capsys.readouterr().out)["q"]["q1"] == pytest.approx(1.9, abs=1e-12)


@pytest.mark.parametrize("header", ["", "t,q1\n", "\ufefftime, position\n\n"])
def test_a_joint_is_driven_as_a_table_says(header: str, tmp_path: Path, capsys: Capture) -> None:
    times = np.linspace(0.0, 0.2, 30)
    table = tmp_path / "table.csv"
    rows = "".join(f"{float(t)!r}, {float(1.0 + t * t)!r}\n" for t in times)
    table.write_text(header + rows, encoding="utf-8")
    assert run("simulate slider_crank", *SHORT, "--drive", f"q1={table}", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["q"]["q1"] == pytest.approx(1.01, abs=1e-12)
    assert told["v"]["q1"] == pytest.approx(0.2, abs=1e-9)
    table.write_text("0,1\n0.1;2\n")
    assert run("simulate slider_crank", *SHORT, "--drive", f"q1={table}") == 2
    assert f"--drive {table}, line 2: 0.1;2 is not a time" in capsys.readouterr().err


def test_json_tells_the_summary_and_nothing_else(tmp_path: Path, capsys: Capture) -> None:
    plot, gif = tmp_path / "run.png", tmp_path / "run.gif"
    files = ["--plot", str(plot), "--animate", str(gif), "--speed", "4"]
    assert run("simulate rhombus --duration 0.3 --step 2e-3 --json", *files) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    trajectory = rg.simulate(rg.load("rhombus"), duration=0.3, step=2e-3)
    assert list(told["q"].values()) == trajectory.q[-1].tolist()
    assert told["t"] == 0.3 and told["stopped"] is None and told["times"] == 151
    assert [c["time"] for c in told["crossings"]] == [c.time for c in trajectory.crossings]
    assert told["stats"]["rhs"] == trajectory.stats.rhs
    assert told["max_closure_error"] < 1e-14
    assert told["written"] == [str(plot), str(gif)]
    assert plot.read_bytes().startswith(b"\x89PNG") and gif.read_bytes().startswith(b"GIF89a")
    assert run("simulate kite --duration 1 --step 5e-3 --on-toggle error --json") == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["stopped"].startswith("toggle") and "robust_gcp: toggle" in err


def test_columns_are_drawn_and_recorded_where_they_need_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    seen: list[tuple[object, object, set[str]]] = []

    def plot(trajectory: rg.Trajectory, what: object, path: Path, *, x: object) -> None:
        seen.append((what, x, set(trajectory.columns())))

    monkeypatch.setattr(rg.Trajectory, "plot", plot)
    names = ["q1", "a.q1", "drive.q1", "lambda.coupler_tip-slider_pin.z", "energy"]
    given = ["--plot", str(tmp_path / "run.png"), "--drive-speed", "q1=3"]
    row = next(
        n
        for n in rg.simulate(rg.load("slider_crank"), duration=1e-3, record="multipliers").columns()
        if "lambda" in n
    )
    names[3] = row
    assert run("simulate slider_crank", *SHORT, *given, "--columns", *names, "--over", "tau.q1") == 0
    assert run("simulate slider_crank", *SHORT, *given) == 0
    assert seen[0][:2] == (names, "tau.q1")
    assert seen[0][2] >= {"q.q1", *names[1:], "tau.q1"}
    assert seen[1][:2] == (("q", "v", "drive"), None) and "a.q1" not in seen[1][2]


def test_what_messages_advise_is_spelt_as_options(capsys: Capture) -> None:
    for line, words in (
        ("simulate rhombus --q0 0 0 0", "choose one with --mode INDEX"),
        ("simulate rhombus --q0 0.2 0.3 0.2", "close it first with robust-gcp assemble"),
        ("simulate rhombus --v0 1 0 0", "or leave --v0 out"),
        ("simulate rhombus --on-toggle repartition --method classical", "goes with --method bridge"),
        ("simulate rhombus --plot a.png --columns drive.q1 --duration 0.01", "with --drive JOINT=TABLE.csv"),
        ("simulate rhombus --animate a.gif --speed 1e-5 --duration 0.01", "take --speed "),
        ("simulate rhombus --backend native --method projection", "use --backend auto"),
    ):
        assert run(line) == 2
        assert words in capsys.readouterr().err


# --------------------------------------------------------------------------- the program


def test_help_lists_what_users_call_first_on_one_page(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 40
    listed = [line.split()[0] for line in lines if line.startswith("    ") and line[4] != " "]
    users = ["simulate", "analyse", "assemble", "convert", "export", "modes", "live", "models", "reports"]
    assert listed == users
    with pytest.raises(SystemExit):
        main(["reports", "--help"])
    told = capsys.readouterr().out
    assert all(name in told for name in ("paper", "work-precision", "stability", "a02"))


def test_old_spellings_of_reports_work_and_tell_the_new(capsys: Capture) -> None:
    assert main(["a02", "--step", "0"]) == main(["reports", "a02", "--step", "0"]) == 2
    old, *rest = capsys.readouterr().err.splitlines()
    assert old.startswith("robust_gcp: warning: `a02` is now `reports a02`; the next release")
    assert rest[0] == rest[1] and len(rest) == 2


# --------------------------------------------------------------------------- printing


def test_warnings_of_the_package_are_one_line_others_stay(capsys: Capture) -> None:
    with pytest.warns(UserWarning, match="not ours"), printing.clean_warnings([rg.SingularityWarning]):
        warnings.warn("close to the edge", rg.SingularityWarning, stacklevel=1)
        warnings.warn("not ours", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "robust_gcp: warning: close to the edge\n"


def test_no_bar_without_a_terminal_and_a_bar_with_one(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    with printing.progress_bar(5.0, "rhombus") as progress:
        assert progress is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with printing.progress_bar(5.0, "rhombus") as progress:
        assert progress is not None
        seen: Callable[[float], None] = progress
        for i in range(101):
            seen(i / 100)
    assert "\n" not in capsys.readouterr().err


def test_long_work_says_so_once_and_short_work_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    with printing.telling("short"), printing.progress_bar(1.0, "short too"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(printing, "PATIENCE", 0.01)
    with printing.telling("tracing"):
        time.sleep(0.3)
    assert capsys.readouterr().err == "robust_gcp: tracing …\n"
    assert list(printing.along(range(3), "counting")) == [0, 1, 2]
    with pytest.raises(ZeroDivisionError), printing.telling("failing"):
        _ = 1 / 0
    time.sleep(0.1)
    assert "failing" not in capsys.readouterr().err


def test_a_bar_over_items_moves_as_they_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float] = []

    @contextlib.contextmanager
    def bar(total: float, what: str) -> Iterator[Callable[[float], None]]:
        assert (total, what) == (4.0, "runs")
        yield told.append

    monkeypatch.setattr(printing, "progress_bar", bar)
    for i, item in enumerate(printing.along("abcd", "runs")):
        assert item == "abcd"[i]
        assert told == [k / 4 for k in range(1, i + 1)]
    assert told == [0.25, 0.5, 0.75, 1.0]


def test_long_tables_end_with_a_count() -> None:
    text = printing.table(["name", " x"], [[f"q{i}", str(i)] for i in range(50)])
    assert text.splitlines()[-1] == "  … and 38 more"
    assert len(text.splitlines()) == printing.LONGEST_TABLE + 2


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert printing.fixed(-1e-12, 4) == "0.0000"
    assert printing.listed([-1e-12, -0.2], 4) == "(0, -0.2)"


# --------------------------------------------------------------------------- analyse, models


def test_analyse_prints_the_published_picture_at_the_crossing(capsys: Capture) -> None:
    assert run("analyse rhombus --q 0 0 0") == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for words in (
        "q = (0, 0, 0)",
        "kind singular",
        "rank of K 1 of 2 rows; generic rank 2",
        "δ_diff 2, dimension of the tangent space ker K",
        "δ_loc 1, largest dimension of a mode",
        "coupler_tip – rocker_tip 2.0000 1.0000 -1.0000",
    ):
        assert words in lines
    # Modes (1, −1, 1) and (0, 1, 1) of docs/method.md, in either order, as the last two columns.
    start = next(i for i, line in enumerate(lines) if line.startswith("tangents"))
    modes = np.array([line.split()[-2:] for line in lines[start + 1 : start + 4]], dtype=float).T
    assert sorted(modes.tolist()) == [[0.0, 1.0, 1.0], [1.0, -1.0, 1.0]]


def test_analyse_as_json_keeps_all_digits(capsys: Capture) -> None:
    assert run("analyse rhombus --q pi -pi pi --json") == 0
    picture = json.loads(capsys.readouterr().out)
    here = rg.analyse(rg.load("rhombus"), [math.pi, -math.pi, math.pi])
    assert picture["model"] == "rhombus"
    assert picture["q"] == [math.pi, -math.pi, math.pi]
    assert (picture["rank"], picture["generic_rank"]) == (1, 2)
    assert (picture["differential_dof"], picture["local_dof"]) == (2, 1)
    assert picture["modes"] == [mode.tolist() for mode in here.modes]
    assert picture["kernel"] == here.kernel.tolist()
    np.testing.assert_allclose(picture["K"], [[0, 0, 0], [0, 1, 1]], atol=1e-15)


def test_models_lists_all_of_them(capsys: Capture) -> None:
    assert run("models") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == rg.model_names()
    rhombus = next(line for line in lines if line.split()[0] == "rhombus")
    for words in ("q1, q2, q3", "coupler_tip – rocker_tip (3d)", "all lengths 1 m"):
        assert words in rhombus
    stewart = next(line for line in lines if line.split()[0] == "stewart")
    assert "19 joints" in stewart
    assert "6 closures" in stewart
    assert run("models", "--full") == 0
    assert "leg6_tip – plate_ball6 (3d)" in capsys.readouterr().out


def test_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "robust_gcp", "simulate", "rhombus", *SHORT],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "state at t = 0.1 s" in done.stdout
