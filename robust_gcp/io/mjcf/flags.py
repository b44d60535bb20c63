"""What a MJCF file switches off, by MuJoCo's own names: the numbers of its flags change between versions."""

from __future__ import annotations

from typing import Any

BEFORE = {"SPRING": "PASSIVE", "DAMPER": "PASSIVE"}
"""What older versions have in place of a flag."""


def is_off(m: Any, what: str) -> bool:
    """Whether `<flag what="disable"/>` is set."""
    import mujoco

    flags = mujoco.mjtDisableBit.__members__
    flag = flags.get(f"mjDSBL_{what}", flags.get(f"mjDSBL_{BEFORE.get(what, what)}"))
    return flag is not None and bool(m.opt.disableflags & int(flag))
