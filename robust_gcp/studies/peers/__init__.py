"""Other tools as contenders of the work-precision study; docs/peers.md says what each one's model is.

Each module states its model and its tuning; `tests/studies/test_peers.py` holds each to its known order on
regular mechanisms first. Pinocchio is always there; the others come with the extra `bench`.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec

from ..contender import Contender

TOOLS = {"pinocchio": "Pinocchio", "mujoco": "MuJoCo", "exudyn": "Exudyn"}
"""Packages, which are also the names of the modules here, and the names of the tools."""


def contenders() -> list[Contender]:
    """All contenders of the tools that are installed."""
    found: list[Contender] = []
    for package in TOOLS:
        if find_spec(package) is not None:
            found += importlib.import_module(f"{__name__}.{package}").contenders()
    return found


def missing() -> list[str]:
    """One sentence for each tool that is not installed: its name and how to get it."""
    return [
        f'{tool} is not installed: pip install {package}, or in a checkout pip install ".[bench]"'
        for package, tool in TOOLS.items()
        if find_spec(package) is None
    ]
