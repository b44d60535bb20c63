"""The build backend: scikit-build-core's, which asks for the wheel of a compiler where there is none.

Named in pyproject.toml, and run at installation alone; needs nothing of the package but `build.py` beside it.
"""

from __future__ import annotations

import os
from typing import Any

from build import SWITCH, BuildError, compiler
from scikit_build_core import build as backend
from scikit_build_core.build import build_editable as build_editable
from scikit_build_core.build import build_sdist as build_sdist
from scikit_build_core.build import build_wheel as build_wheel
from scikit_build_core.build import get_requires_for_build_sdist as get_requires_for_build_sdist


def get_requires_for_build_wheel(settings: dict[str, Any] | None = None) -> list[str]:
    """What scikit-build-core asks for, and ziglang where no C++ compiler is found."""
    return [*backend.get_requires_for_build_wheel(settings), *_compiler()]


def get_requires_for_build_editable(settings: dict[str, Any] | None = None) -> list[str]:
    """The same for an editable installation."""
    return [*backend.get_requires_for_build_editable(settings), *_compiler()]


def _compiler() -> list[str]:
    if os.environ.get(SWITCH) == "0":
        return []
    try:
        compiler()
    except BuildError:
        return [] if os.environ.get("CXX") else ["ziglang>=0.13"]
    return []
