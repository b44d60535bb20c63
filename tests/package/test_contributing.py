"""CONTRIBUTING.md leads to files that are there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_each_file_of_the_walk_is_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split("|")[2:4] for line in text.splitlines() if line.startswith("|") and ".py`" in line]
    assert len(rows) > 8
    for python, kernel in rows:
        folder = ROOT
        for name in re.findall(r"`([\w/]+\.py)`", python):
            folder = (ROOT / name).parent if "/" in name else folder
            assert (folder / Path(name).name).is_file(), name
        for name in re.findall(r"`([\w/]+\.h)`", kernel):
            assert (ROOT / "robust_gcp" / "kernel" / name).is_file(), name
    for name in re.findall(r"`(\w+/[\w/]*)`", text.partition("Large rooms")[2].partition("Where to look")[0]):
        assert (ROOT / "robust_gcp" / name / "__init__.py").is_file(), name
    for name in re.findall(r"\(`(\w+)`\)", text):
        sources = [*(ROOT / "robust_gcp").rglob("*.py"), *(ROOT / "robust_gcp").rglob("*.h")]
        assert any(name in each.read_text(encoding="utf-8") for each in sources), name
