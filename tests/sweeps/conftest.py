"""What all tests of sweeps need."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def importable_by_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spawned workers take over sys.path and find the functions of these files from the checkout's root."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(Path(__file__).parents[2])])
