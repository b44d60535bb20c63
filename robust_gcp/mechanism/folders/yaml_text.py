"""YAML from files that nobody vouches for: plain values only, bounded, faults as `ModelError`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...errors import ModelError
from ..formats.text_file import read_text

LARGEST = 1_000_000
"""Bytes; a robot.yaml of a hundred joints has some thousand."""

MOST = 100_000
"""Values after aliases are followed: a few lines of aliases of aliases make billions."""

DEEPEST = 50


def parsed_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises
    ------
    ModelError
        Where it cannot be read, is no mapping of plain values with text as keys, names a key twice,
        or grows beyond bounds.
    """
    import yaml

    text = read_text(path, LARGEST)
    loader = yaml.SafeLoader("")
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if node is not None:
            _size(node, path, {}, 0)
        settings = None if node is None else loader.construct_document(node)
    except yaml.YAMLError as error:
        raise ModelError(f"{path}: cannot be read as YAML ({error})") from error
    except (ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path}: cannot be read as YAML ({type(error).__name__}: {error})") from error
    finally:
        loader.dispose()
    if not isinstance(settings, dict):
        raise ModelError(f"{path}: must be a mapping with closed_loop, type and name_mot")
    for key in settings:
        if not isinstance(key, str):
            raise ModelError(f"{path}: the key {key!r} is not text; put it in quotes")
    return settings


def _size(node: Any, path: Path, known: dict[int, int], depth: int) -> int:
    """Values below a node, aliases followed; keys checked on the way.

    An alias of a node that is still open (a loop) counts as too deep.
    """
    if id(node) in known:
        if known[id(node)] == 0:
            raise _refusal(node, path, "contains itself")
        return known[id(node)]
    if isinstance(node.value, str):
        return 1
    if depth > DEEPEST:
        raise _refusal(node, path, f"is nested more than {DEEPEST} deep")
    known[id(node)] = 0
    children = node.value
    if children and isinstance(children[0], tuple):
        seen: set[tuple[str, Any]] = set()
        for key, _ in children:
            label = key.tag, key.value if isinstance(key.value, str) else id(key)
            if label in seen and key.value != "<<":
                raise _refusal(key, path, f"the key {key.value!r} is there twice; remove one")
            seen.add(label)
        children = [part for pair in children for part in pair]
    size = 1
    for child in children:
        size += _size(child, path, known, depth + 1)
        if size > MOST:
            raise _refusal(child, path, f"makes more than {MOST:,} values; write less")
    known[id(node)] = size
    return size


def _refusal(node: Any, path: Path, what: str) -> ModelError:
    return ModelError(f"{path}: cannot be read as YAML (line {node.start_mark.line + 1}: {what})")
