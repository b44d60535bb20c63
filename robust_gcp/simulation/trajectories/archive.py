"""Files of arrays: written whole or not at all, and read from anybody without trust."""

from __future__ import annotations

import io
import math
import os
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ...errors import OptionError, RobustGcpError, missing_file
from ...mechanism.tree.tree import Array


def write_whole(path: Path, fill: Callable[[io.BufferedWriter], object]) -> Path:
    """Write a new file beside the old one, which stays whole until this one is, and takes its place.

    Raises
    ------
    OptionError
        Where the system does not take it: no such folder, no permission, no room on the disk.
    """
    beside = path.with_name(f".{path.name[:100]}.{os.getpid()}")  # names have 255 bytes at most
    try:
        try:
            with beside.open("wb") as file:
                fill(file)
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        kept = "; what stood there is as it was" if path.is_file() else ""
        raise OptionError(f"{path} cannot be written ({error.strerror or error}){kept}") from error
    return path


def read_arrays(path: Path) -> dict[str, Array]:
    """The arrays of an archive, none larger than the file itself.

    `save` does not compress: what claims to unfold into more than it takes on the disk is refused unread.
    """
    if path.exists() and not path.is_file():
        raise OptionError(f"{path} is a folder or a device; give a file that Trajectory.save wrote")
    arrays: dict[str, Array] = {}
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            for entry in archive.infolist():
                if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
                    raise OptionError(f"{path} is compressed, which save does not do; write it with save")
                name = entry.filename.removesuffix(".npy")
                if name in arrays:
                    raise OptionError(f"{path} is damaged: it holds {name!r} twice")
                arrays[name] = _array(archive.read(entry))
    except FileNotFoundError as error:
        raise missing_file(path) from error
    except OSError as error:
        raise OptionError(f"{path} cannot be read ({error.strerror or error})") from error
    except RobustGcpError:
        raise
    except Exception as error:  # zipfile and NumPy raise some ten types at what is no archive of arrays
        raise OptionError(f"{path} is not a trajectory that save wrote, or is damaged ({error})") from error
    if "meta" not in arrays:
        raise OptionError(f"{path} is not a trajectory that save wrote, or is damaged (it has no 'meta')")
    return arrays


def _array(text: bytes) -> Array:
    """One `.npy`, whose header must claim just the bytes that follow it, before room for them is taken."""
    file = io.BytesIO(text)
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(file)
    if kind.kind not in "iufb" or math.prod(shape) * kind.itemsize != len(text) - file.tell():
        raise ValueError(f"an array of {kind} with the shape {shape} in {len(text)} bytes")
    file.seek(0)
    return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """What goes wrong within while the contents of `path` are taken apart, as one OptionError."""
    try:
        yield
    except OptionError:
        raise
    except (RobustGcpError, LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise OptionError(f"{path} is damaged: {type(error).__name__}: {error}") from error
