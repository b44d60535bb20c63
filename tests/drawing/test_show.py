"""Pictures of notebooks: displayed by them, files beside a script."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import robust_gcp as rg
from robust_gcp.drawing.show import show

SCRIPT = """
import robust_gcp as rg
from robust_gcp.drawing.show import show
run = rg.simulate(rg.load("rhombus"), duration=0.05, step=1e-2)
assert show(run.plot("q"), "motion") is None
assert show(rg.replay(run), "page") is None
"""


def test_a_script_writes_its_pictures_beside_itself(tmp_path: Path) -> None:
    pytest.importorskip("meshcat", reason="meshcat (extra viz) is not installed")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True, cwd="/")
    assert done.stdout.splitlines() == [f"drew {tmp_path / name}" for name in ("motion.png", "page.html")]
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")
    assert "<html" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_notebook_is_handed_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = rg.simulate(rg.load("rhombus"), duration=0.05, step=1e-2).plot("q")
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    assert show(figure, "motion") is figure
