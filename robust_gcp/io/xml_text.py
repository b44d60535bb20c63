"""XML from files that nobody vouches for: no entities, no bottomless nesting, faults as `ModelError`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeGuard
from xml.etree import ElementTree
from xml.parsers import expat

from ..errors import ModelError
from .text_file import path_of, read_text

DEEPEST = 200
"""Elements within elements; readers that call themselves run out of stack at some hundred."""


LEADING = "\ufeff \t\r\n"
"""What may stand before a document."""

COMMENT, LOOSE = re.compile(r"<!--.*?-->", re.DOTALL), re.compile(r"<!--(?:(?!-->).)*?--(?!>)", re.DOTALL)

MOST = 500_000
"""Elements of a document: a hundred times what a humanoid has, read in some seconds."""


def is_xml_text(given: str | Path) -> TypeGuard[str]:
    """Whether it is a document's text, and no path of one: text starts with "<"."""
    return isinstance(given, str) and given.lstrip(LEADING).startswith("<")


def parsed_xml(
    given: str | Path, what: str, scan: Callable[[str], None] | None = None
) -> tuple[ElementTree.Element, str]:
    """The root element of a file or of XML text itself, and what to call it in errors.

    Tags keep the prefix that the file writes, declared or not (`drake:ball_constraint`), since robots'
    files seldom declare theirs; a prefix of the root element itself is dropped everywhere.

    Parameters
    ----------
    given : str or Path
        Text starts with "<".
    what : str
        The format, to name text by.
    scan : callable, optional
        Looks through the text before it is parsed, and refuses what would take too long.

    Raises
    ------
    ModelError
        Where it cannot be read, is not well-formed, has too many elements, nests too deeply, or declares a
        document type: entities may name other files, or grow without bounds.
    """
    if is_xml_text(given):
        text, name = given, f"{what} text"
    else:
        path = path_of(given, what)
        text, name = read_text(path), str(path)
    elements = text.count("<") - text.count("</")
    if elements > MOST:
        raise ModelError(f"{name}: it has {elements:,} elements, more than {MOST:,}; split it")
    if scan is not None:
        scan(text)
    try:
        try:
            root = _parsed(text.lstrip(LEADING), name)
        except expat.ExpatError:  # robots' programs take "--" in comments, which XML does not
            if not LOOSE.search(text):
                raise
            root = _parsed(COMMENT.sub(lambda m: "\n" * m[0].count("\n"), text.lstrip(LEADING)), name)
    except (expat.ExpatError, ValueError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{name}: not well-formed XML ({error})") from error
    prefix, colon, _ = root.tag.rpartition(":")
    if colon:
        for element in root.iter():
            element.tag = element.tag.removeprefix(f"{prefix}:")
    return root, name


def _parsed(text: str, name: str) -> ElementTree.Element:
    """The root element."""
    builder = _Builder(name)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = builder.doctype
    parser.Parse(text, True)
    return builder.close()


def require_shallow(root: ElementTree.Element, name: str) -> None:
    """A ModelError for a tree that was put together and is too deep to be written out."""
    level, depth = [root], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
        if depth > DEEPEST:
            raise ModelError(_TOO_DEEP.format(name))


_TOO_DEEP = f"{{}}: its elements are nested more than {DEEPEST} deep; flatten it"


class _Builder(ElementTree.TreeBuilder):
    def __init__(self, name: str) -> None:
        super().__init__()
        self._name, self._depth = name, 0

    def start(self, tag: Any, attrs: Any, /) -> ElementTree.Element:
        self._depth += 1
        if self._depth > DEEPEST:
            raise ModelError(_TOO_DEEP.format(self._name))
        return super().start(tag, {key: value for key, value in attrs.items() if key[:5] != "xmlns"})

    def end(self, tag: str, /) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, system: str | None, pubid: str | None, inner: bool) -> None:
        """Refuse a document type declaration, which comes before any entity."""
        raise ModelError(
            f"{self._name}: declares a document type (<!DOCTYPE {name} …>), which may name other files; "
            "remove it and write its entities out"
        )
