"""YAML from files that nobody vouches for: plain values only, bounded, faults as `ModelError`.

Values are those of YAML 1.2's core schema (null, true, 12, 0x1f, 1.5e-3, .inf, text, lists, mappings)
and merges (`<<`); dates, sexagesimal numbers, yes and no are text. PyYAML takes the document apart; its
constructors, which turn tagged text into objects, are not used.
"""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

from ..checks import shown
from ..errors import ModelError
from .text_file import read_text

LARGEST = 1_000_000
"""Bytes; a robot.yaml of a hundred joints has some thousand."""

MOST = 100_000
"""Values after aliases are followed: a few lines of aliases of aliases make billions."""

DEEPEST = 50

LONGEST_NUMBER = 1000
"""Characters: what is longer takes a time that grows with its square, and fits no float."""

LONGEST_REASON = 500
"""Characters of a parser's message that are passed on; it may quote a whole file."""

_TAG = "tag:yaml.org,2002:"
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_PATTERNS = {
    "null": re.compile(r"(?:~|null|Null|NULL|)\Z"),
    "bool": re.compile(r"(?:true|True|TRUE|false|False|FALSE)\Z"),
    "int": re.compile(r"(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)\Z"),
    "float": re.compile(
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z"
    ),
    "merge": re.compile(r"<<\Z"),
}
"""What text without quotes means, in this order; all else is text."""


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
    try:
        node = _composer()(text, path).get_single_node()
    except ModelError:
        raise
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ModelError(f"{path}: cannot be read as YAML ({str(error)[:LONGEST_REASON]})") from error
    settings = None if node is None else _Values(path).of(node)
    if not isinstance(settings, dict):
        raise ModelError(f"{path}: must be a mapping with closed_loop, type and name_mot")
    for key in settings:
        if not isinstance(key, str):
            raise ModelError(f"{path}: the key {shown(key)} is not text; put it in quotes")
    return settings


@functools.cache
def _composer() -> Any:
    """PyYAML's composer with the core schema's rules, refusing depth before its recursion meets it."""
    from yaml.composer import Composer
    from yaml.parser import Parser
    from yaml.reader import Reader
    from yaml.resolver import BaseResolver
    from yaml.scanner import Scanner

    class Document(Reader, Scanner, Parser, Composer, BaseResolver):
        def __init__(self, text: str, path: Path) -> None:
            Reader.__init__(self, text)
            for part in (Scanner, Parser, Composer, BaseResolver):
                part.__init__(self)
            self.path, self.depth = path, 0

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.depth > DEEPEST:
                raise _refusal(self.path, parent, f"nested more than {DEEPEST} deep")
            self.depth += 1
            node = Composer.compose_node(self, parent, index)
            self.depth -= 1
            return node

    for kind, pattern in _PATTERNS.items():
        Document.add_implicit_resolver(_TAG + kind, pattern, None)
    return Document


class _Values:
    """Python's values of a tree of nodes, `MOST` at most, aliases followed."""

    def __init__(self, path: Path) -> None:
        self.path, self.made = path, 0
        self.open: set[int] = set()

    def of(self, node: Any) -> Any:
        """The value of a node."""
        self.made += 1
        if self.made > MOST:
            raise _refusal(self.path, node, f"makes more than {MOST:,} values; write less")
        if isinstance(node.value, str):
            return self._scalar(node)
        if id(node) in self.open:
            raise _refusal(self.path, node, "contains itself")
        if len(self.open) > DEEPEST:
            raise _refusal(self.path, node, f"nested more than {DEEPEST} deep")
        kind = "map" if node.id == "mapping" else "seq"
        if node.tag != _TAG + kind:
            raise self._unknown(node)
        self.open.add(id(node))
        value = self._mapping(node) if kind == "map" else [self.of(item) for item in node.value]
        self.open.remove(id(node))
        return value

    def _mapping(self, node: Any) -> dict[Any, Any]:
        own: dict[Any, Any] = {}
        merged: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            if key_node.tag == _TAG + "merge":
                value = self.of(value_node)
                for one in value if isinstance(value, list) else [value]:
                    if not isinstance(one, dict):
                        raise _refusal(self.path, value_node, "<< takes a mapping or a list of mappings")
                    for key, item in one.items():
                        merged.setdefault(key, item)
                continue
            key = self.of(key_node)
            if isinstance(key, list | dict):
                raise _refusal(self.path, key_node, "a list or a mapping cannot be a key")
            if key in own:
                raise _refusal(self.path, key_node, f"the key {shown(key)} is there twice; remove one")
            own[key] = self.of(value_node)
        return {**merged, **own}

    def _scalar(self, node: Any) -> Any:
        """The value of text with its tag, which the file or `_PATTERNS` gave it."""
        text, kind = node.value, node.tag.removeprefix(_TAG)
        if kind in ("str", "merge"):
            if not text.isascii() and any("\ud800" <= c <= "\udfff" for c in text):
                raise _refusal(self.path, node, "half a character (a surrogate) in text")
            return text
        if kind not in _PATTERNS or node.tag == kind:
            raise self._unknown(node)
        if len(text) > LONGEST_NUMBER and kind in ("int", "float"):
            raise _refusal(self.path, node, f"a number of more than {LONGEST_NUMBER:,} characters")
        if not _PATTERNS[kind].match(text):
            raise _refusal(self.path, node, f"{shown(text)} is no value of kind {kind!r}")
        if kind == "float":
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        if kind == "int":
            return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
        return _WORDS[text.lower()]

    def _unknown(self, node: Any) -> ModelError:
        what = f"could not determine what the tag {shown(node.tag)} means here; remove it"
        return _refusal(self.path, node, what)


def _refusal(path: Path, place: Any, what: str) -> ModelError:
    """The error for a node or event of this file."""
    return ModelError(f"{path}: cannot be read as YAML (line {place.start_mark.line + 1}: {what})")
