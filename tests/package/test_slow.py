"""The list of slow tests names tests that are there."""

from __future__ import annotations

from pathlib import Path

TESTS = Path(__file__).parents[1]


def test_each_is_there() -> None:
    for line in (TESTS / "slow.txt").read_text(encoding="utf-8").splitlines():
        file, _, rest = line.partition("::")
        names = rest.partition("[")[0].split("::")
        text = (TESTS / file).read_text(encoding="utf-8")
        assert all(f"def {name}" in text or f"class {name}" in text for name in names), line
