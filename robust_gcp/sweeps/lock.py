"""A file that one process alone holds, on every system that Python runs on."""

from __future__ import annotations

import importlib
import os
from typing import IO

FAR = 2**30
"""Byte that is locked on Windows: others may go on reading what lies before it."""


def lock(file: IO[bytes]) -> bool:
    """Hold an open file until it is closed or this process ends; False when another one holds it."""
    try:
        fcntl = importlib.import_module("fcntl")
    except ImportError:  # Windows
        msvcrt = importlib.import_module("msvcrt")
        os.lseek(file.fileno(), FAR, os.SEEK_SET)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
