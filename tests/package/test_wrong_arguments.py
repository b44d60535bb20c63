"""Wrong arguments of every command: a message and exit code 2 before any work begins."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robust_gcp.__main__ import main
from robust_gcp.arguments import Arguments, number, pathname
from robust_gcp.commands.acting import named_number, named_path
from robust_gcp.commands.register import COMMANDS, REPORTS, Command

Capture = pytest.CaptureFixture[str]

LEAVES = [*(command for command in COMMANDS if not command.parts), *REPORTS]
MODULES = {command.name: importlib.import_module(command.module, "robust_gcp") for command in LEAVES}

NO_NUMBERS = ("", " ", "x", "1,2", "pi/0", "--", "1e", "0x10", "٣٫٥x")
NOT_FINITE = ("nan", "inf", "-inf", "1e999")
NOT_WHOLE = ("1.5", "nan", "inf", "1e3", *("9" * 5000,))
BOTH_SIGNS = {"--q0", "--v0", "--q"}
FROM_ZERO = {"--port", "--mode", "--only", "--seed", "--seeds", "--outputs"}


def options(command: Command) -> Iterator[argparse.Action]:
    """The options of a command as argparse has them."""
    parser = argparse.ArgumentParser()
    MODULES[command.name].arguments(Arguments(parser))
    for action in parser._actions:
        if action.option_strings and action.dest != "help":
            yield action


def wrong_words(option: argparse.Action) -> Iterator[str]:
    """Words that no option of this type may take."""
    name = option.option_strings[-1]
    if option.type is number:
        yield from (*NO_NUMBERS, *NOT_FINITE)
        yield from () if name in BOTH_SIGNS else ("-1", "-1e-300", "-pi")
        yield from () if name in BOTH_SIGNS | FROM_ZERO else ("0",)
    elif option.type is int:
        yield from (*NO_NUMBERS, *NOT_WHOLE, "-1", "-5")
        yield from () if name in FROM_ZERO else ("0",)
    elif option.type is pathname:
        yield from ("", " ", "file.txt/inside", "missing/file.txt/", "a" * 300, "missing.txt", "/dev/null/x")
        yield from ("folder.png",) if name == "--plot" else ()
    elif option.type is named_number:
        yield from ("q1", "=1", "q1=", "q1=x", "q1=nan", "q1=-inf")
    elif option.type is named_path:
        yield from ("q1", "=file.txt", "q1=", "q1=missing.csv", "q1=folder.csv")
    elif option.choices is not None:
        yield from ("", "x", "RK4", "-1")


CASES = [
    pytest.param(
        command.name, option.option_strings[-1], word, id=f"{command.name} {option.dest} {word[:12]!r}"
    )
    for command in LEAVES
    for option in options(command)
    for word in wrong_words(option)
]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An otherwise empty folder to work in, with a file and folders whose names are a file's."""
    (tmp_path / "file.txt").write_text("in the way")
    for name in ("folder.png", "folder.csv", "folder.json"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def called(name: str) -> list[str]:
    """The command, and what its line must have."""
    if name in ("simulate", "analyse", "assemble", "modes", "live"):
        return [name, "rhombus"]
    if name == "models":
        return [name]
    if name in ("convert", "export"):
        return [name, "rhombus", "robot.xml" if name == "convert" else "rhombus.rgcp"]
    if name == "robots":
        return ["reports", name, "."]
    return ["reports", name, *(["--out", "out"] if name in ("work-precision", "stability") else [])]


def code_of(words: list[str]) -> int:
    try:
        return main(words)
    except SystemExit as stop:
        assert isinstance(stop.code, int)
        return stop.code


def refused(words: list[str], here: Path, capsys: Capture) -> str:
    """The message of a refusal that printed, made and changed nothing else."""
    before = sorted(here.rglob("*"))
    assert code_of(words) == 2
    out, err = capsys.readouterr()
    assert out == "" and "Traceback" not in err
    assert sorted(here.rglob("*")) == before
    assert (here / "file.txt").read_text() == "in the way"
    return err


@pytest.mark.parametrize(("name", "option", "word"), CASES)
def test_every_option_refuses_wrong_words(
    name: str, option: str, word: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    ran: list[Any] = []
    if not (name in ("simulate", "analyse", "assemble") and option in BOTH_SIGNS):
        monkeypatch.setattr(MODULES[name], "run", lambda args: ran.append(args) or 0)
    err = refused([*called(name), option, word], here, capsys)
    assert not ran
    assert option in err or option.strip("-") in err


def test_the_options_that_are_attacked_are_most_of_them() -> None:
    attacked = {(name, option) for name, option, _ in (case.values for case in CASES)}
    assert len(attacked) >= 35
    assert {name for name, _ in attacked} == set(MODULES) - {"models"}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("simulate rhombus --out folder.csv", "this is a folder; give the name of a file"),
        ("simulate rhombus --out file.txt", "this is a file; give the name of a folder"),
        ("simulate rhombus --out results.txt", ".txt ends the name of a file"),
        ("simulate rhombus --plot folder.png", "this is a folder"),
        ("simulate rhombus --plot motion.jpg", "a figure is a .png or a .pdf file"),
        ("simulate rhombus --replay motion.png", "a replay is a .html or a .htm file"),
        ("simulate rhombus --replay file.txt/motion.html", "file.txt is a file, not a folder"),
        ("simulate rhombus --replay motion.html --trails coupler_tp", "did you mean 'coupler_tip'"),
        ("simulate rhombus --animate motion.png", "an animation is a .gif or a .mp4 file"),
        ("simulate rhombus --save run.csv", "a trajectory is a .npz file"),
        ("simulate rhombus --columns q1", "--columns goes with --plot FILE"),
        ("simulate rhombus --over q1", "--over goes with --plot FILE"),
        ("simulate rhombus --trails coupler_tip", "--trails goes with --replay FILE"),
        ("simulate rhombus --plot a.png --columns v.q8", "--columns v.q8: no joint, column or quantity; did"),
        ("simulate rhombus --plot a.png --over q8", "--over q8: no joint, column or quantity; did you mean"),
        ("simulate rhombus --torque q9=1", "no joint 'q9'"),
        ("simulate rhombus --ctrl q11=1", "no actuator 'q11'; did you mean 'q1'"),
        ("simulate rhombus --torque q1=1 q1=2", "--torque names 'q1' twice"),
        ("simulate rhombus --drive-speed q9=1", "no joint 'q9'"),
        ("simulate rhombus --drive-speed q1=1 --drive q1=file.txt", "both drive 'q1'"),
        ("simulate rhombus --drive q1=file.txt", "a table is (times, positions) of one length, at least 4"),
        ("simulate rhombus --trails ,", "--trails: the model has no frame ''"),
        ("simulate rhombus --replay /proc/motion.html", "cannot write to /"),
        ("reports a02 --out /proc/new/runs.json", "cannot write to /"),
        ("simulate rhombus --record energy,speed", "record = 'speed' is unknown"),
        ("simulate rhombus --mode 7", "--mode 7: analyse lists 1 modes"),
        ("simulate rhombus --duration 1e-4", "longer than the duration"),
        ("simulate rhombus --outputs 0.2 0.1", "give increasing times, s, at least one"),
        ("simulate rhombus --outputs 0.2 0.1 --duration 1 --out new/out.csv", "give increasing times"),
        ("simulate rhombus --outputs 2 --duration 1", "lie outside the run, from 0 to 1 s"),
        ("simulate rhombus --step 1e-12", "outputs, more than"),
        ("simulate rhombus --q0 0.2", "q0 has shape (1,)"),
        ("simulate rhombus --on-toggle repartition --method classical", "goes with --method bridge"),
        ("simulate crank_rockr", "did you mean 'crank_rocker'"),
        ("modes rhombus --dpi 0", "--dpi = 0 must be a whole number from 1 to 1200"),
        ("modes rhombus --dpi 1000000", "--dpi = 1000000 must be a whole number from 1 to 1200"),
        ("modes rhombus --coordinates q1 q9 --out m.png", "must be two or three different joints"),
        ("modes rhombus --coordinates q1", "must be two or three different joints"),
        ("modes rhombus --out folder.png", "this is a folder"),
        ("modes five_bar", "one degree of freedom"),
        ("reports a02 --out runs.csv", "is a .json file"),
        ("reports a02 --duration -1", "--duration = -1.0 must be positive and finite"),
        ("reports a02 --step 0", "--step = 0.0 must be positive and finite"),
        ("reports a02 --duration 0.01 --step 0.1", "shorter than the steps that are tried"),
        ("reports a02 --sizes 2 0", "--sizes = 0 must be a whole number from 1"),
        ("reports growth --out growth.png", ".png ends the name of a file"),
        ("reports growth --docs missing", "there is no such folder"),
        ("reports growth --quick --docs folder.png", "there is no docs/kernel.md to refresh"),
        ("reports benchmark --robots missing", "there is no such folder"),
        ("reports robots missing", "there is no such folder"),
        ("reports robots file.txt", "there is no such folder"),
        ("reports robots . --duration 0", "--duration = 0.0 must be positive and finite"),
        ("reports paper --out figures.png", ".png ends the name of a file"),
        ("reports costs --refresh missing.md", "there is no such file"),
        ("reports costs --refresh file.txt", "there are no marks of a block named costs"),
        ("reports costs --out costs.md", ".md ends the name of a file"),
        ("reports stability --out out --case stif", "--case = 'stif' is unknown"),
        ("reports stability --out out --docs missing", "there is no such folder"),
        ("reports stability --out out --docs folder.png", "there is no stability.md to refresh"),
        ("reports work-precision --out out --docs missing", "there is no such folder"),
        ("reports work-precision --out out --cap inf", "--cap = inf must be positive and finite"),
    ],
)
def test_what_stands_against_the_model_or_the_disk_is_told_before_the_work(
    line: str, message: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def work(*args: Any, **named: Any) -> Any:
        raise AssertionError("work has begun")

    monkeypatch.setattr("robust_gcp.simulation.runs.course.FixedRun", work)
    monkeypatch.setattr("robust_gcp.analysis.space._Search", work)
    monkeypatch.setattr("robust_gcp.reports.costs.measure", work)
    err = refused(line.split(), here, capsys)
    assert err.startswith("robust_gcp: ") and err.count("\n") == 1
    assert message in err


GOOD = {
    "--plot": "new.png",
    "--replay": "new.html",
    "--save": "new.npz",
    "--animate": "new.gif",
    "--torque": "q1=-0.5",
    "--ctrl": "q1=0.5",
    "--fmi": "3",
    "--drive-speed": "q1=pi",
    "--drive": "q1=file.txt",
    "--refresh": "file.txt",
    "--docs": ".",
    "--robots": ".",
    "--case": "stiff",
    "modes --out": "new/modes.pdf",
    "a02 --out": "new/runs.json",
    "benchmark --out": "new.json",
    "benchmark --base": "free",
    "benchmark --starts": "2",
    "gradients --engine": "robust_gcp",
    "gradients --out": "new.json",
    "singular --out": "new.json",
}
"""Words that an option takes, where they are not those of its type."""


@pytest.mark.parametrize("command", LEAVES, ids=lambda command: str(command.name))
def test_good_words_pass_every_check(command: Command, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[argparse.Namespace] = []
    monkeypatch.setattr(MODULES[command.name], "run", lambda args: ran.append(args) or 0)
    monkeypatch.setattr("robust_gcp.reports.stability.command.families", lambda: {"stiff": list})
    for option in options(command):
        flag = option.option_strings[-1]
        word = {number: "0.5", int: "1", pathname: "new.1/folder"}.get(option.type, "word")  # type: ignore
        word = next(iter(option.choices)) if option.choices is not None else word
        word = GOOD.get(flag, GOOD.get(f"{command.name} {flag}", word))
        given = [flag] if option.nargs == 0 else [flag, word]
        assert code_of([*called(command.name), *given]) == 0, given
        assert ran.pop()
