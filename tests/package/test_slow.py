"""The lists of slow tests name tests that are there."""

from __future__ import annotations

from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["slow.txt", "long.txt", "long_in_python.txt"])
def test_each_is_there(name: str) -> None:
    for line in (TESTS / name).read_text(encoding="utf-8").splitlines():
        file, _, rest = line.partition("::")
        names = rest.partition("[")[0].split("::")
        text = (TESTS / file).read_text(encoding="utf-8")
        assert all(f"def {name}" in text or f"class {name}" in text for name in names), line
