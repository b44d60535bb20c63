"""The kernel's structures as they lie in memory, with the places where pointers are; see image.h."""

from __future__ import annotations

import ctypes
import struct

import numpy as np

from ..kernel.structures import VERSION, Arrays, Cluster, Description, Exported
from ..mechanism.tree.tree import Array

FNV, PRIME = 14695981039346656037, 1099511628211
"""Of the checksum FNV-1a, 64 bits."""

HEAD = struct.Struct("<4sIIIQQQQ")
"""Magic, version, width of the structures, 0, size, places, root, checksum."""


class Image:
    """Bytes of an .rgcp file.

    Parameters
    ----------
    root : Arrays
        Of an `Exported`.
    """

    def __init__(self, root: Arrays) -> None:
        self._data, self._places = bytearray(), list[tuple[int, int, int]]()
        self._root = self._put(root)

    def __bytes__(self) -> bytes:
        """The whole file."""
        data = bytes(self._data)
        data += b"".join(struct.pack("<QQQ", *place) for place in self._places)
        width = sum(ctypes.sizeof(kind) for kind in (Description, Cluster, Exported))
        head = (b"RGCP", VERSION, width, 0, len(self._data), len(self._places), self._root, checksum(data))
        return HEAD.pack(*head) + data

    def _room(self, raw: bytes) -> int:
        at = len(self._data)
        self._data += raw + b"\0" * (-len(raw) % 8)  # aligned for doubles where it is read
        return at

    def _point(self, at: int, to: int, size: int) -> None:
        self._places.append((at, to, size))

    def _put(self, arrays: Arrays) -> int:
        """A structure and all that it points to; where it is."""
        structure, parts = arrays.structure, arrays.parts()
        size = ctypes.sizeof(structure)
        at = self._room(b"\0" * size)
        own = bytearray(bytes(structure))
        for name in (field[0] for field in structure._fields_):
            field = getattr(type(structure), name)
            part = parts.get(name)
            if part is None and not _is_pointer(structure, name):
                continue
            # no address of this process in the file, whose bytes are the same each time
            own[field.offset : field.offset + field.size] = b"\0" * field.size
            if isinstance(part, Arrays):
                self._point(at + field.offset, self._put(part), ctypes.sizeof(part.structure))
            elif part is not None and part.size:
                to, length = self._array(arrays, part)
                self._point(at + field.offset, to, length)
        self._data[at : at + size] = own
        return at

    def _array(self, arrays: Arrays, part: Array) -> tuple[int, int]:
        """Where numbers, or pointers to structures, are and how many bytes that is."""
        members = arrays.members(part)
        if members is None:
            raw = np.ascontiguousarray(part).tobytes()
            return self._room(raw), len(raw)
        at = self._room(b"\0" * 8 * len(members))
        for k, member in enumerate(members):
            self._point(at + 8 * k, self._put(member), ctypes.sizeof(member.structure))
        return at, 8 * len(members)


def checksum(data: bytes) -> int:
    """FNV-1a of 64 bits."""
    found = FNV
    for byte in data:
        found = ((found ^ byte) * PRIME) & 0xFFFFFFFFFFFFFFFF
    return found


def _is_pointer(structure: ctypes.Structure, name: str) -> bool:
    kinds = {field[0]: field[1] for field in structure._fields_}
    return kinds[name] not in (ctypes.c_int32, ctypes.c_int64, ctypes.c_double)
