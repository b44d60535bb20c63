"""Files that were damaged: by chance, or by someone who knows the checksum."""

from __future__ import annotations

import random
import struct

from robust_gcp.export.image import HEAD, checksum

WHOLE = (-1, 0, 1, 2, 7, 2**31 - 1, -(2**31), 1000, 65536)
REAL = (0.0, float("nan"), 1e308, -1.0, float("inf"))


def spoilt(whole: bytes, rng: random.Random, signed: bool) -> bytes:
    """Something in it is another, or its end is missing; `signed`: the checksum is right."""
    data, kind = bytearray(whole), rng.randrange(4)
    if kind == 0:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        at = rng.randrange(0, len(data) - 4) // 4 * 4
        data[at : at + 4] = struct.pack("<i", rng.choice(WHOLE))
    elif kind == 2:
        data = data[: rng.randrange(len(data))]
    else:
        at = rng.randrange(0, len(data) - 8) // 8 * 8
        data[at : at + 8] = struct.pack("<d", rng.choice(REAL))
    if signed and len(data) > HEAD.size:
        head = list(HEAD.unpack(bytes(data[: HEAD.size])))
        head[-1] = checksum(bytes(data[HEAD.size :]))
        data[: HEAD.size] = HEAD.pack(*head)
    return bytes(data)
