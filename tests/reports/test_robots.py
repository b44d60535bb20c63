"""The table of robots' files: what runs, what is refused, and what would fall short."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.io.loader import models_folder
from robust_gcp.reports.robots import Entry, files_below, tried


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model, a file of parts, and one that is refused."""
    shutil.copytree(models_folder() / "rhombus", tmp_path / "arms" / "rhombus")
    (tmp_path / "parts.xml").write_text("<mujocoinclude><default/></mujocoinclude>", encoding="utf-8")
    plane = "<mujoco><worldbody><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
    (tmp_path / "plane.xml").write_text(plane, encoding="utf-8")
    return tmp_path


def test_models_are_found(folder: Path) -> None:
    assert list(files_below(folder)) == [folder / "arms" / "rhombus", folder / "plane.xml"]


def test_the_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robots", str(folder), "--duration", "0.1"]) == 0
    printed = capsys.readouterr().out
    assert "1 of 2 files run 0.1 s" in printed
    assert "plane.xml" in printed
    assert "refused: ModelError: no body has a joint" in printed


def test_an_energy_that_does_not_fall_is_seen(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = tried(folder / "arms" / "rhombus", "rhombus", 0.1, 1e-2)
    assert (entry.verdict, entry.closure < 1e-13) == ("runs", True)
    monkeypatch.setattr(rg.Trajectory, "energy_error", lambda self: np.full(len(self.t), 1e-3))
    assert tried(folder / "arms" / "rhombus", "rhombus", 0.1, 1e-2).verdict == "falls short"


def test_a_stiff_file_runs_at_the_step_that_it_needs(tmp_path: Path) -> None:
    """From rest, where no step is named; with one it blows up."""
    (tmp_path / "stiff.xml").write_text(
        """<mujoco><worldbody><body><joint type="slide" damping="15000"/><geom type="sphere" size="0.1"
        mass="1" contype="0" conaffinity="0"/></body></worldbody></mujoco>""",
        encoding="utf-8",
    )
    with pytest.warns(rg.StabilityWarning):
        entry = tried(tmp_path / "stiff.xml", "stiff", 0.1, None, 0.0)
    assert (entry.verdict, entry.step) == ("runs", "0.0625")
    with pytest.warns(rg.StabilityWarning):
        assert tried(tmp_path / "stiff.xml", "stiff", 0.1, 1e-3, 0.0).verdict == "stops"


def test_cells_of_a_file_that_is_refused() -> None:
    cells = Entry("a", why="ModelError: nothing").cells()
    assert cells == ["a", *[""] * 9, "refused: ModelError: nothing"]
