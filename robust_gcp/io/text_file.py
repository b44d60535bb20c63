"""Text of model files: regular files of bounded size, and none from outside a model's folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..checks import shown
from ..errors import ModelError, missing_file

LARGEST = 64_000_000
"""Bytes of the largest file that is read: ten times the URDF of a humanoid with its visuals."""

LONGEST_PATH = 1000
"""Characters; what is longer is text that was meant to be XML."""


is_file, is_link = os.path.isfile, os.path.islink
"""Unlike those of pathlib, for which a name too long for the system is an error: it is neither."""


def path_of(given: Any, what: str) -> Path:
    """A path as given by a caller, or a ModelError."""
    if not isinstance(given, str | os.PathLike):
        raise ModelError(f"{what}: {type(given).__name__} is not a path; give a str or a pathlib.Path")
    text = os.fspath(given)
    if not isinstance(text, str) or "\0" in text:
        raise ModelError(f"{what}: {shown(text)} is not a path; give a str without null characters")
    if len(text) > LONGEST_PATH or "\n" in text:
        raise ModelError(f"{what}: {shown(text)} is neither a path nor XML, which starts with '<'")
    return Path(text)


def read_text(path: Path, largest: int = LARGEST) -> str:
    """The text of a regular file in UTF-8, or a ModelError; see `read_bytes`."""
    try:
        return read_bytes(path, largest).decode("utf-8")
    except UnicodeError as error:
        raise ModelError(f"{path}: cannot be read ({error}); save it as UTF-8") from error


def read_bytes(path: Path, largest: int = LARGEST) -> bytes:
    """What a regular file holds.

    Raises
    ------
    ModelError
        Where it is missing, no regular file (a device or pipe may never end), or too large.
    """
    try:
        if path.exists() and not path.is_file():
            raise ModelError(f"{path}: cannot be read: it is a folder or a device; give a file")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            data = b"" if size > largest else file.read(largest + 1)  # a file of /proc has no size
        if max(size, len(data)) > largest:
            raise ModelError(
                f"{path}: cannot be read: it has {max(size, len(data)):,} bytes, more than {largest:,}; "
                "shorten it"
            )
        return data
    except FileNotFoundError as error:
        raise missing_file(path) from error
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error})") from error


def files_in(path: Path) -> list[Path]:
    """The regular files of a folder by name; none where there is no such folder."""
    try:
        return sorted(file for file in path.iterdir() if file.is_file())
    except OSError:
        return []


def inside(folder: Path, name: str) -> Path:
    """`folder / name`, or a ModelError where that is a link to a file outside the folder."""
    path = folder / name
    try:
        place, target, there = folder.resolve(), path.resolve(), path.exists()
    except (OSError, RuntimeError) as error:  # a link to itself, a name too long for the system
        words = error.strerror if isinstance(error, OSError) else error
        raise ModelError(f"{folder}: {shown(name)} in it cannot be read ({words})") from error
    if there and not target.is_relative_to(place):
        raise ModelError(
            f"{path}: is a link to {target}, outside the model's folder, and is not read; copy the file "
            "into the folder, or load the folder that it is in"
        )
    return path
