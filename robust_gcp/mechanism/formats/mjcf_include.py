"""`<include>` in MJCF: files of the same folder in the place where they are named."""

from __future__ import annotations

from pathlib import Path

from ...checks import shown
from ...errors import ModelError
from .mjcf_parts import Element
from .text_file import inside
from .xml_text import parsed_xml, require_shallow

MOST = 100
"""Files that a document may include."""


def with_includes(root: Element, name: str, folder: Path | None) -> Element:
    """The document with the children of each included file's root in place of its <include>, in place.

    Parameters
    ----------
    folder : Path or None
        Where the main file is, which names are relative to; None for text.

    Raises
    ------
    ModelError
        For a file outside the folder, one that is included twice (MuJoCo refuses that too), or any in text.
    """
    seen: set[Path] = set()
    _expand(root, name, folder, seen)
    require_shallow(root, name)
    return root


def _expand(parent: Element, name: str, folder: Path | None, seen: set[Path]) -> None:
    position = 0
    while position < len(parent):
        child = parent[position]
        if child.tag != "include":
            _expand(child, name, folder, seen)
            position += 1
            continue
        file = child.get("file", "")
        if folder is None:
            raise ModelError(
                f"{name}: <include file={shown(file)}> cannot be read from text; give the file's path"
            )
        path = inside(folder, file) if file and not Path(file).is_absolute() else Path(file)
        if not file or Path(file).is_absolute():
            raise ModelError(f"{name}: <include file={shown(file)}> cannot be read; name a file in {folder}")
        if path.resolve() in seen or len(seen) >= MOST:
            raise ModelError(
                f"{name}: <include file={shown(file)}> is there twice, or one of more than {MOST}"
            )
        seen.add(path.resolve())
        included, _ = parsed_xml(path, "MJCF")
        parent[position : position + 1] = list(included)
