"""robust_gcp.h by ctypes: as C calls it."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robust_gcp.kernel.library import NAME, _installed

Array = NDArray[np.float64]


class Counts(ctypes.Structure):
    _fields_ = [(name, c_int32) for name in ("nq", "nv", "m", "controls", "charts")]


class StoppedError(Exception):
    """A status that is not RGCP_OK, with the words of `rgcp_why`."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


def library() -> Any:
    lib = ctypes.CDLL(str(_installed(NAME)))
    for name, arguments in {
        "open": [c_char_p, c_char_p, c_size_t], "open_bytes": [c_char_p, c_size_t, c_char_p, c_size_t],
        "new_within": [c_void_p, c_size_t, c_char_p, c_size_t],
    }.items():  # fmt: skip
        function = getattr(lib, f"rgcp_{name}")
        function.restype, function.argtypes = c_void_p, arguments
    for name in ("close", "free"):
        function = getattr(lib, f"rgcp_{name}")
        function.restype, function.argtypes = None, [c_void_p]
    lib.rgcp_count.restype, lib.rgcp_count.argtypes = Counts, [c_void_p]
    for name in ("joints", "actuators", "why"):
        function = getattr(lib, f"rgcp_{name}")
        function.restype, function.argtypes = c_char_p, [c_void_p]
    for name in ("home", "q", "v", "y", "acceleration", "G", "g"):
        function = getattr(lib, f"rgcp_{name}")
        function.restype, function.argtypes = POINTER(c_double), [c_void_p]
    lib.rgcp_independent.restype, lib.rgcp_independent.argtypes = POINTER(c_int32), [c_void_p, c_int32]
    lib.rgcp_begin.argtypes = [c_void_p, c_void_p, c_void_p, c_double]
    lib.rgcp_used.restype, lib.rgcp_used.argtypes = c_size_t, [c_void_p]
    lib.rgcp_prepare.argtypes = [c_void_p]
    lib.rgcp_step.argtypes = [c_void_p, c_double, c_int64, c_void_p, c_void_p]
    lib.rgcp_time.restype, lib.rgcp_time.argtypes = c_double, [c_void_p]
    lib.rgcp_crossings.restype, lib.rgcp_crossings.argtypes = c_int64, [c_void_p]
    lib.rgcp_chart.argtypes = [c_void_p]
    lib.rgcp_reduced.argtypes, lib.rgcp_derivatives.argtypes = 3 * [c_void_p], 4 * [c_void_p]
    lib.rgcp_state_size.restype, lib.rgcp_state_size.argtypes = c_size_t, [c_void_p]
    lib.rgcp_save.argtypes, lib.rgcp_restore.argtypes = 2 * [[c_void_p, c_void_p, c_size_t]]
    return lib


LIB = library()


class Exported:
    """A mechanism from a file or its bytes."""

    def __init__(self, given: Path | bytes) -> None:
        why = ctypes.create_string_buffer(300)
        if isinstance(given, bytes):
            self.handle = LIB.rgcp_open_bytes(given, len(given), why, len(why))
        else:
            self.handle = LIB.rgcp_open(str(given).encode(), why, len(why))
        if not self.handle:
            raise ValueError(why.value.decode())
        self.counts = LIB.rgcp_count(self.handle)

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            LIB.rgcp_close(self.handle)


def _place(array: Any) -> Any:
    return None if array is None else array.ctypes.data


class CMotion:
    """A motion of it, in `size` bytes of its own, or in the system's memory."""

    def __init__(self, of: Exported, size: int = 0) -> None:
        why = ctypes.create_string_buffer(300)
        self.of, self.handle = of, LIB.rgcp_new_within(of.handle, size, why, len(why))
        if not self.handle:
            raise ValueError(why.value.decode())

    def __del__(self) -> None:
        if self.handle:
            LIB.rgcp_free(self.handle)

    def _require(self, status: int) -> None:
        if status:
            raise StoppedError(status, LIB.rgcp_why(self.handle).decode())

    def begin(self, q: Any = None, u: Any = None, t: float = 0.0) -> CMotion:
        q, u = (None if x is None else np.ascontiguousarray(x, float) for x in (q, u))
        self._require(LIB.rgcp_begin(self.handle, _place(q), _place(u), t))
        return self

    def prepare(self) -> CMotion:
        self._require(LIB.rgcp_prepare(self.handle))
        return self

    def step(self, h: float, n: int, tau: Any = None, control: Any = None) -> CMotion:
        tau, control = (None if x is None else np.ascontiguousarray(x, float) for x in (tau, control))
        self._require(LIB.rgcp_step(self.handle, h, n, _place(tau), _place(control)))
        return self

    def __getattr__(self, name: str) -> Any:
        if name in ("crossings", "chart", "time", "used"):
            return getattr(LIB, f"rgcp_{name}")(self.handle)
        c = self.of.counts
        shapes = {
            "q": (c.nq,),
            "v": (c.nv,),
            "y": (2 * c.m,),
            "acceleration": (c.m,),
            "G": (c.nv, c.m),
            "g": (c.nv,),
        }
        return np.ctypeslib.as_array(getattr(LIB, f"rgcp_{name}")(self.handle), shapes[name]).copy()

    def reduced(self) -> tuple[Array, Array]:
        m = self.of.counts.m
        M, b = np.zeros((m, m)), np.zeros(m)
        self._require(LIB.rgcp_reduced(self.handle, _place(M), _place(b)))
        return M, b

    def derivatives(self, tau: Any = None) -> tuple[Array, Array]:
        c = self.of.counts
        a, rows = np.zeros(c.m), np.zeros((c.m, 2 * c.m + c.nv))
        self._require(LIB.rgcp_derivatives(self.handle, _place(tau), _place(a), _place(rows)))
        return a, rows

    def save(self) -> bytes:
        size = LIB.rgcp_state_size(self.handle)
        room = ctypes.create_string_buffer(max(size, 1))
        self._require(LIB.rgcp_save(self.handle, room, size))
        return room.raw[:size]

    def restore(self, state: bytes) -> CMotion:
        self._require(LIB.rgcp_restore(self.handle, state, len(state)))
        return self
