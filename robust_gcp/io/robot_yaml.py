"""robot.yaml but for its block `robust_gcp`: what is read of it, and the closures that it lists."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from ..checks import shown
from ..errors import ModelError
from ..mechanism.constraint.closures import Closure, closure_kinds
from .yaml_text import parsed_yaml

KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type", "robust_gcp")
"""Keys of robot.yaml that are read."""

ALIKE = 0.85
"""Likeness (difflib's ratio) above which another key is taken for one of them misspelt."""


def settings_of(path: Path) -> dict[str, Any]:
    """The keys and values of robot.yaml; a ModelError for one that is read in another spelling."""
    settings = parsed_yaml(path)
    unknown = [key for key in settings if key not in KEYS]
    for key in KEYS:
        near = [] if key in settings else difflib.get_close_matches(key, map(str, unknown), n=1, cutoff=ALIKE)
        if near:
            raise ModelError(f"{path}: {shown(near[0])} is not a key that is read; did you mean {key!r}?")
    return settings


def closures_of(settings: dict[str, Any], path: Path) -> list[Closure]:
    """`closed_loop` and `type`: pairs of frames, and how each is closed."""
    pairs = settings.get("closed_loop") or []
    kinds = settings.get("type") or []
    if not isinstance(pairs, list) or not all(is_list_of_str(p) and len(p) == 2 for p in pairs):
        raise ModelError(f"{path}: closed_loop must be a list of pairs of frame names, not {shown(pairs)}")
    known = {kind.kind: kind for kind in closure_kinds()}
    if not is_list_of_str(kinds) or len(kinds) != len(pairs):
        raise ModelError(f"{path}: type must list one of {', '.join(known)} for each of {len(pairs)} loops")
    unknown = [kind for kind in kinds if kind.lower() not in known]
    if unknown:
        raise ModelError(f"{path}: type {shown(unknown[0])} is unknown; use one of {', '.join(known)}")
    return [known[kind.lower()](*pair) for pair, kind in zip(pairs, kinds, strict=True)]


def is_list_of_str(value: Any) -> bool:
    """Whether it is a list of text."""
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
