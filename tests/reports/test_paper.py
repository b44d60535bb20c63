"""Figures 4 to 7: the numbers behind them, and the files."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from robust_gcp.__main__ import main
from robust_gcp.drawing.figures import style as plots
from robust_gcp.errors import BranchError, MissingExtraError
from robust_gcp.reports import paper

FILES = (
    "figure4_rhombus_joints",
    "figure5_rhombus_strobe",
    "figure6_parallelogram_joints",
    "figure7_parallelogram_strobe",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("figures") / "new"
    assert main(["reports", "paper", "--quick", "--pdf", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def numbers(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rhombus() -> paper.Case:
    return paper.run_case("rhombus", 1.2, 2e-3)


@pytest.mark.parametrize("name", FILES)
def test_every_figure_is_drawn_for_print(folder: Path, name: str) -> None:
    image = matplotlib.image.imread(folder / f"{name}.png")
    assert image.shape[1] == round(plots.WIDTH * plots.DPI)
    assert image[..., :3].std() > 0.05  # something is on it
    assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")


def test_nothing_else_is_written(folder: Path) -> None:
    expected = {f"{name}{suffix}" for name in FILES for suffix in (".png", ".pdf")}
    assert {path.name for path in folder.iterdir()} == expected | {"summary.json"}


@pytest.mark.parametrize("model", ["rhombus", "parallelogram"])
def test_robust_methods_stay_on_the_exact_motion(numbers: dict[str, Any], model: str) -> None:
    errors = numbers[model]["max_error_rad"]
    assert errors["projection"] < 1e-8
    assert errors["bridge"] < 1e-8
    assert max(numbers[model]["max_closure_error_m"].values()) < 1e-12
    # Down through y = 0 and −π; the rhombus comes back through −π at 1.32 s, within the 1.8 s.
    assert numbers[model]["crossings"]["bridge"] == {"rhombus": 3, "parallelogram": 2}[model]


def test_classical_gcp_locks_on_the_rhombus_at_minus_pi(rhombus: paper.Case) -> None:
    assert rhombus.fate == "locks"
    assert rhombus.lock_time is not None
    # The exact motion passes −π at 0.950314641 s; the first output after it is off the mode.
    assert 0.9503 < rhombus.lock_time < 0.9503 + 2e-3
    run = rhombus.runs["classical"]
    after = run.q[run.t > rhombus.lock_time]
    np.testing.assert_allclose(after[:, 1], np.pi, atol=1e-9)
    np.testing.assert_allclose(after[:, 2], -np.pi, atol=1e-9)


def test_classical_gcp_ends_far_from_the_exact_motion(numbers: dict[str, Any]) -> None:
    assert numbers["rhombus"]["max_error_rad"]["classical"] > 1.0
    assert numbers["rhombus"]["classical"]["fate"] == "locks"


def test_classical_gcp_leaves_the_parallelogram_mode(numbers: dict[str, Any]) -> None:
    classical = numbers["parallelogram"]["classical"]
    assert classical["fate"] in ("changes mode", "stops")
    assert classical["time_s"] < 1.4


def test_the_exact_motion_is_the_one_that_is_simulated(rhombus: paper.Case) -> None:
    run = rhombus.runs["bridge"]
    assert run.a is not None
    np.testing.assert_allclose(run.v, rhombus.exact["v"], atol=1e-8)
    np.testing.assert_allclose(run.a, rhombus.exact["a"], atol=1e-7)


def test_strobe_instants_lie_in_the_run_and_meet_the_lock(rhombus: paper.Case) -> None:
    times = paper.strobe_instants(rhombus)
    assert len(times) == 10
    assert np.all(np.diff(times) > 0.0)
    assert times[0] == 0.0 and times[-1] <= rhombus.t[-1]
    assert rhombus.lock_time in times


def test_a_run_that_stopped_is_drawn_as_far_as_it_got(rhombus: paper.Case) -> None:
    full = rhombus.runs["classical"]
    cut = type(full)(full.mechanism, full.t[:200], full.q[:200], full.v[:200], full.a[:200])
    case = paper.Case(
        rhombus.mechanism,
        rhombus.t,
        rhombus.exact,
        {**rhombus.runs, "classical": cut},
        str(BranchError("Newton failed")),
    )
    assert (case.fate, case.lock_time) == ("stops", full.t[199])
    with plots.style():
        paper.joint_figure(case)
        words = [
            text.get_text()
            for part in paper.strobe_figure(case).subfigs
            for ax in part.axes
            for text in ax.texts
        ]
    assert words == ["stopped"] * 5


def test_figures_are_the_same_picture_every_time(rhombus: paper.Case, tmp_path: Path) -> None:
    """Pixel by pixel; the bytes of a PDF hold coordinates whose last digit is rounding."""
    from matplotlib import image

    with plots.style():
        once, again = (plots.save(paper.strobe_figure(rhombus), tmp_path / f"{i}.png") for i in "ab")
    np.testing.assert_array_equal(image.imread(once), image.imread(again))


def test_pdf_figures_carry_no_date(rhombus: paper.Case, tmp_path: Path) -> None:
    with plots.style():
        path = plots.save(paper.strobe_figure(rhombus), tmp_path / "strobe.pdf")
    assert b"CreationDate" not in path.read_bytes()


def test_a_motion_is_drawn_with_its_crossings(tmp_path: Path) -> None:
    path = tmp_path / "plots" / "motion.png"
    words = "simulate rhombus --duration 0.3 --step 5e-3 --plot"
    assert main([*words.split(), str(path)]) == 0
    assert path.read_bytes().startswith(b"\x89PNG")


def test_missing_matplotlib_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["simulate", "rhombus", "--plot", "x.png"]) == main(["reports", "paper"]) == 2
    assert capsys.readouterr().err.count('pip install ".[viz]"') == 2
    with pytest.raises(MissingExtraError):
        plots.new_figure(1.0)
