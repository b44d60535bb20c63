"""Other tools as contenders of the work-precision study; docs/peers.md says what each one's model is.

Each module states its model and its tuning; `tests/reports/test_peers.py` holds each to its known order on
regular mechanisms first. Pinocchio is always there; the others come with the extra `bench`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.util import find_spec

from ...mechanism.tree.tree import Array
from ..contender import Contender, Scene

TOOLS = {"pinocchio": "Pinocchio", "mujoco": "MuJoCo", "exudyn": "Exudyn"}
"""Packages, which are also the names of the modules here, and the names of the tools."""


def contenders(exact: Callable[[Scene], Array] | None = None) -> list[Contender]:
    """All contenders of the tools that are installed; gains are scanned by a scene's exact q, where given."""
    found: list[Contender] = []
    for package in TOOLS:
        if find_spec(package) is not None:
            made = importlib.import_module(f"{__name__}.{package}").contenders
            found += made(exact) if package == "pinocchio" else made()
    return found


def missing() -> list[str]:
    """One sentence for each tool that is not installed: its name and how to get it."""
    return [
        f'{tool} is not installed: pip install {package}, or in a checkout pip install ".[bench]"'
        for package, tool in TOOLS.items()
        if find_spec(package) is None
    ]
