"""The command line with words by the thousand: done, refused in one line, or argparse's own refusal."""

from __future__ import annotations

import contextlib
import io
import itertools
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robust_gcp.__main__ import main

FUZZ = settings.get_profile("fuzz")

WORDS = st.one_of(
    st.sampled_from(
        ("0", "1", "-1", "0.2", "nan", "inf", "-inf", "1e999", "1e-300", "pi", "-pi/0", "2*pi/3")
    ),
    st.sampled_from(
        ("pi/0", "*pi", "--", "-", "", " ", "rhombus", "9" * 400, "energy,a", ",", "\0", "--out")
    ),
    st.text(max_size=4),
)
FLAGS = (
    *("--q0", "--v0", "--mode", "--method", "--newton-start", "--stepper", "--rtol", "--atol", "--on-toggle"),
    *("--record", "--duration", "--step", "--q", "--json", "--full", "-h", "--help", "--version"),
    *("--ctrl", "--torque", "--limits", "--friction"),
)
MODELS = st.sampled_from(
    ("rhombus", "five_bar", "bricard", "nowhere", ".", "..", "", "\0", "a" * 300, "/dev/null")
)


def run(argv: list[str]) -> tuple[int, str]:
    """Exit code and what was printed on stderr."""
    out, err = io.StringIO(), io.StringIO()
    printed = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with printed[0], printed[1], np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            code = main(argv)
        except SystemExit as stop:
            assert isinstance(stop.code, int)
            code = stop.code
    return code, err.getvalue()


@FUZZ
@given(
    command=st.sampled_from(("simulate", "analyse", "models", "simulat", "")),
    model=MODELS,
    options=st.lists(st.tuples(st.sampled_from(FLAGS), st.lists(WORDS, max_size=3)), max_size=3),
)
def test_words(command: str, model: str, options: list[tuple[str, list[str]]]) -> None:
    words = itertools.chain.from_iterable([flag, *values] for flag, values in options)
    short = ["--duration", "0.002", "--step", "0.001"] if command == "simulate" else []
    code, err = run([command, *[model] * (command != "models"), *short, *words])
    assert code in (0, 2)
    assert code == 0 or err
    assert "Traceback" not in err


@pytest.mark.parametrize("option", ["--out", "--plot"])
@pytest.mark.parametrize(
    "place", ["\0", "a" * 300 + ".png", "/dev/null/x.csv", "/dev/null/x.png", "", "x" * 999]
)
def test_places_that_cannot_be_written(
    option: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, err = run(["simulate", "rhombus", "--duration", "0.002", option, place])
    assert code == 2 or (place == "" and option == "--out")
    assert "Traceback" not in err
