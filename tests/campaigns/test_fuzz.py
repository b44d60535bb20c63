"""Spoilt files: each is read, or refused by a typed error."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

import robust_gcp as rg

from .conftest import Block
from .fuzz import trial
from .fuzz.trial import GOOD, Document, JudgeProcess, Outcome, below, case, judge, shipped

SEED, COUNT = 0, 1000
ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("ROBUST_GCP_ROBOTS", ROOT.parent / "shared" / "robots"))

known = cache(shipped)
robots = cache(lambda: below(FOLDER))


@pytest.fixture(scope="module")
def found() -> Iterator[None]:
    """Processes that are spawned take over sys.path, and find these files from the checkout's root."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path, str(ROOT)])
        yield


@pytest.fixture(scope="module")
def tester(found: None) -> Iterator[JudgeProcess]:
    process = JudgeProcess()
    yield process
    process.close()


@pytest.mark.campaign
@pytest.mark.parametrize(
    "files",
    [
        pytest.param(known, id="shipped"),
        pytest.param(
            robots,
            id="robots",
            marks=pytest.mark.skipif(not FOLDER.is_dir(), reason="no folder: name one in ROBUST_GCP_ROBOTS"),
        ),
    ],
)
def test_spoilt_files_are_read_or_refused(
    files: Callable[[], list[Document]],
    block: Block,
    tester: JudgeProcess,
    record_property: Callable[..., None],
) -> None:
    outcomes = {i: tester.judge(*case(files(), block.seed, i)) for i in block.indices}
    slowest = {"largest s of processor time": max(outcome.seconds for outcome in outcomes.values())}
    counts = Counter(outcome.verdict for outcome in outcomes.values())
    record_property(f"spoilt files, seed {block.seed}", {**counts, **slowest})
    require_good(outcomes, files(), block.seed)


def require_good(outcomes: dict[int, Outcome], files: list[Document], seed: int) -> None:
    bad = {i: outcome for i, outcome in outcomes.items() if outcome.verdict not in GOOD}
    told = [f"case {i} ({case(files, seed, i)[0].label}): {o.verdict}\n{o.words}" for i, o in bad.items()]
    assert not bad, "\n".join(told)


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.campaign)])
def test_what_is_spoilt_is_sound(every: int) -> None:
    files = known()
    assert {document.file for document in files} == {
        *("robot.yaml", "robot.urdf", "robot.xml", "robot.sdf", "robot.usda")
    }
    moved = {document.label: judge(document, document.text).verdict for document in files[::every]}
    assert set(moved.values()) == {"moved"}, moved


def test_some_spoilt_files_are_read_or_refused() -> None:
    outcomes = {i: judge(*case(known(), 3, i)) for i in range(50)}
    require_good(outcomes, known(), 3)
    counts = Counter(outcome.verdict for outcome in outcomes.values())
    assert min(counts["moved"], counts["refused"]) > 5, "the properties are not empty"


def test_a_case_is_the_same_whenever_it_is_asked_for() -> None:
    here, anew = known(), shipped()
    assert [case(here, 1, i) for i in range(20)] == [case(anew, 1, i) for i in range(20)]
    assert [case(here, 1, i)[1] for i in range(20)] != [case(here, 2, i)[1] for i in range(20)]


def test_errors_of_others_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what ends the program, and states that are no numbers."""
    for error in (ZeroDivisionError("foreign"), SystemExit(3), RecursionError()):
        monkeypatch.setattr(trial, "simulate", lambda *a, error=error, **k: (_ for _ in ()).throw(error))
        outcome = judge(known()[0], known()[0].text)
        assert outcome.verdict == "foreign" and type(error).__name__ in outcome.words
    run = rg.simulate(rg.load("rhombus"), duration=2e-3, record=("energy",))
    run.v[-1] = float("nan")
    monkeypatch.setattr(trial, "simulate", lambda *a, **k: run)
    assert judge(known()[0], known()[0].text).verdict == "not finite"
    monkeypatch.setattr(trial, "SLOWEST", 0.0)
    assert judge(known()[0], "").verdict == "slow"


def moody(document: Document, text: str) -> Outcome:
    if text == "hang":
        time.sleep(600.0)
    if text == "die":
        os.abort()
    return Outcome("refused", text)


@pytest.mark.campaign
def test_a_process_that_hangs_or_dies_is_replaced(found: None) -> None:
    tester = JudgeProcess(moody, patience=30.0)
    try:
        answers = [tester.judge(known()[0], text) for text in ("well", "die", "well")]
        assert [answer.verdict for answer in answers] == ["refused", "died", "refused"]
        assert answers[1].words.startswith("exit code -")
    finally:
        tester.close()
    tester = JudgeProcess(moody, patience=0.5)
    try:
        assert tester.judge(known()[0], "hang").verdict == "hung"
    finally:
        tester.close()
