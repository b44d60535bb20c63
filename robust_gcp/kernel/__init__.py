"""The compiled kernel: RK4 steps of the regular path, several hundred times faster than in Python.

It is optional. `backends` says whether it is there; `simulate` uses it by itself where it can.
"""

from .library import Backend, NativeBuildWarning, backends

__all__ = ["Backend", "NativeBuildWarning", "backends"]
