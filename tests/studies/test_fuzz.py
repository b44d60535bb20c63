"""Spoilt files, by the hundred: FUZZ_EXAMPLES=5000, or `robust-gcp reports fuzz`, makes it thousands."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.mechanism.folders.loader import models_folder
from robust_gcp.studies.fuzz import trial
from robust_gcp.studies.fuzz.command import judged
from robust_gcp.studies.fuzz.trial import GOOD, Document, JudgeProcess, Outcome, case, documents, judge

COUNT = int(os.environ.get("FUZZ_EXAMPLES", "0")) or 300
SHIPPED = documents()
FOLDER = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))


@pytest.mark.parametrize("document", SHIPPED, ids=lambda d: d.label)
def test_what_is_spoilt_is_sound(document: Document) -> None:
    assert judge(document, document.text).verdict == "moved"


def test_spoilt_files_are_read_or_refused() -> None:
    outcomes = [judge(*case(SHIPPED, 3, i)) for i in range(COUNT)]
    bad = {i: outcome for i, outcome in enumerate(outcomes) if outcome.verdict not in GOOD}
    assert bad == {}
    counts = Counter(outcome.verdict for outcome in outcomes)
    assert min(counts["moved"], counts["refused"]) > 0.1 * COUNT, "the properties are not empty"
    assert {document.file for document in SHIPPED} == {"robot.yaml", "robot.urdf", "robot.xml"}


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no folder of robots: name one in ROBUST_GCP_ROBOTS")
def test_spoilt_files_of_robots_are_read_or_refused() -> None:
    known = [document for document in documents(FOLDER) if document not in SHIPPED]
    assert len(known) > 5
    bad = {i: o for i in range(COUNT // 2) if (o := judge(*case(known, 4, i))).verdict not in GOOD}
    assert bad == {}


def test_a_case_is_the_same_whenever_it_is_asked_for() -> None:
    assert [case(SHIPPED, 1, i) for i in range(20)] == [case(documents(), 1, i) for i in range(20)]
    assert [case(SHIPPED, 1, i)[1] for i in range(20)] != [case(SHIPPED, 2, i)[1] for i in range(20)]


def test_errors_of_others_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what ends the program, and states that are no numbers."""
    for error in (ZeroDivisionError("foreign"), SystemExit(3), RecursionError()):
        monkeypatch.setattr(trial, "simulate", lambda *a, error=error, **k: (_ for _ in ()).throw(error))
        outcome = judge(SHIPPED[0], SHIPPED[0].text)
        assert outcome.verdict == "foreign" and type(error).__name__ in outcome.words
    run = rg.simulate(rg.load("rhombus"), duration=2e-3, record=("energy",))
    run.v[-1] = float("nan")
    monkeypatch.setattr(trial, "simulate", lambda *a, **k: run)
    assert judge(SHIPPED[0], SHIPPED[0].text).verdict == "not finite"
    monkeypatch.setattr(trial, "SLOWEST", 0.0)
    assert judge(SHIPPED[0], "").verdict == "slow"


def moody(document: Document, text: str) -> Outcome:
    if text == "hang":
        time.sleep(600.0)
    if text == "die":
        os.abort()
    return Outcome("refused", text)


def test_a_process_that_hangs_or_dies_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    # spawned processes take over sys.path and find this file's functions from the checkout's root
    monkeypatch.setattr(sys, "path", [*sys.path, str(Path(__file__).parents[2])])
    tester = JudgeProcess(moody, patience=30.0)
    try:
        answers = [tester.judge(SHIPPED[0], text) for text in ("well", "die", "well")]
        assert [answer.verdict for answer in answers] == ["refused", "died", "refused"]
        assert answers[1].words.startswith("exit code -")
    finally:
        tester.close()
    tester = JudgeProcess(moody, patience=0.5)
    try:
        assert tester.judge(SHIPPED[0], "hang").verdict == "hung"
    finally:
        tester.close()


def test_the_command_tells_what_became_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(models_folder() / "rhombus", tmp_path / "robots" / "mine")
    words = [
        "reports",
        "fuzz",
        "--count",
        "12",
        "--seed",
        "5",
        "--folder",
        str(tmp_path / "robots"),
        "--jobs",
        "2",
    ]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert f"12 spoilt files of {len(SHIPPED) + 2} sound ones, seed 5" in out and "slowest: case" in out
    assert main(["reports", "fuzz", "--folder", str(tmp_path / "none")]) == 2
    monkeypatch.setattr(
        "robust_gcp.studies.fuzz.command.judged",
        lambda *a: iter([(7, Outcome("foreign", "ZeroDivisionError"))]),
    )
    assert main(["reports", "fuzz", "--only", "7", "--out", str(tmp_path / "bad")]) == 1
    out = capsys.readouterr().out
    assert "case 7 (" in out and "ZeroDivisionError" in out
    assert any((tmp_path / "bad" / "7").iterdir())


def test_outcomes_come_in_order() -> None:
    told: list[float] = []
    found = list(judged(SHIPPED, 0, [3, 1, 2], 2, told.append))
    assert [i for i, _ in found] == [3, 1, 2] and told == [1 / 3, 2 / 3, 1.0]
    assert {outcome.verdict for _, outcome in found} <= set(GOOD)
