"""The memory that Pinocchio's algorithms work in: how much a model needs, and no more than that."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from ...errors import ModelError

LEAN_FROM = 120
"""Velocities from which the workspace is put together here: `pin.Data` holds four tensors of nv³ numbers for
second derivatives of the forces, 55 MB from there on, which nothing here uses."""

LEAN_VERSIONS = ("4.1.",)
"""Versions of Pinocchio whose algorithms were looked through for what they read and write."""

BODY = 6000
"""Bytes that one joint takes in a workspace, besides arrays over velocities."""


def workspace(model: pin.Model) -> pin.Data:
    """A workspace for kinematics, `rnea`, `crba` and energies of the model.

    Raises
    ------
    ModelError
        Where it does not fit into the memory that is left, with how much it needs.
    """
    require_memory(int(model.nv), int(model.njoints))
    return _lean(model) if is_lean(int(model.nv)) else pin.Data(model)


def whole_workspace(model: pin.Model) -> pin.Data:
    """The same for all of Pinocchio's algorithms."""
    nv, joints = int(model.nv), int(model.njoints)
    _require_left(whole_bytes(nv, joints), nv)
    return model.createData()


def is_lean(nv: int) -> bool:
    """Whether the workspace of a model with so many velocities leaves out what nothing here uses."""
    return nv >= LEAN_FROM and pin.__version__.startswith(LEAN_VERSIONS)


def workspace_bytes(nv: int, joints: int) -> int:
    """What a workspace takes, measured to a few per cent: 32 nv³ bytes where it is a whole `pin.Data`."""
    return 8 * (2 * nv * nv + 6 * nv * joints) + BODY * joints if is_lean(nv) else whole_bytes(nv, joints)


def whole_bytes(nv: int, joints: int) -> int:
    """What a whole `pin.Data` takes."""
    return 8 * (4 * nv**3 + 18 * nv * nv + 22 * nv * joints) + BODY * joints


def require_memory(nv: int, joints: int) -> None:
    """A ModelError where a workspace for so many velocities and joints does not fit into what is left.

    A reader asks before it makes the model, which takes a minute for 20,000 joints.
    """
    _require_left(workspace_bytes(nv, joints), nv)


def _require_left(needed: int, nv: int) -> None:
    left = memory_left()
    if needed > left:
        raise ModelError(
            f"the model's {nv} velocities need a workspace of {needed / 1e9:.3g} GB in each thread "
            f"that uses it, and {left / 1e9:.3g} GB are left; split the model into its independent parts, or "
            "use a machine with more memory"
        )


def memory_left() -> float:
    """Bytes that can still be taken, as far as the system tells."""
    left: list[float] = []
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        left += [1024.0 * float(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        group = Path("/sys/fs/cgroup")  # a container's share is less than the machine's memory
        limit = (group / "memory.max").read_text(encoding="ascii").strip()
        if limit != "max":
            left.append(float(limit) - float((group / "memory.current").read_text(encoding="ascii")))
    except (OSError, ValueError, IndexError):
        pass  # another system, or one that does not tell
    if not left and hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        left.append(float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE")))
    return min(left, default=float("inf"))


def _lean(model: pin.Model) -> pin.Data:
    """A `pin.Data` of which only what `Tree` asks for has its size."""
    data, nv = pin.Data(), int(model.nv)
    _extend(data.joints, [joint.createData() for joint in model.joints])
    for name in ("oMi", "liMi"):
        _extend(getattr(data, name), [pin.SE3.Identity()] * model.njoints)
    _extend(data.oMf, [pin.SE3.Identity()] * model.nframes)
    for name in ("v", "ov", "a", "a_gf", "oa", "oa_gf"):
        _extend(getattr(data, name), [pin.Motion.Zero()] * model.njoints)
    for name in ("f", "of", "h", "oh"):
        _extend(getattr(data, name), [pin.Force.Zero()] * model.njoints)
    for name in ("Ycrb", "oYcrb"):
        _extend(getattr(data, name), [pin.Inertia.Zero()] * model.njoints)
    for name in ("com", "vcom", "acom"):
        _extend(getattr(data, name), [np.zeros(3)] * model.njoints)
    for name in ("J", "dJ", "Ag"):
        setattr(data, name, np.zeros((6, nv), order="F"))
    data.M = np.zeros((nv, nv), order="F")
    data.tau, data.nle, data.g = np.zeros(nv), np.zeros(nv), np.zeros(nv)
    _extend(data.mass, [0.0] * model.njoints)
    below = [0] * model.njoints  # velocities of each joint's subtree
    for j in range(model.njoints - 1, 0, -1):
        below[j] += int(model.nvs[j])
        below[model.parents[j]] += below[j]
    _extend(data.nvSubtree, below)
    _extend(data.Fcrb, [np.zeros((6, nv), order="F")] * model.njoints)
    return data


def _extend(vector: object, items: Sequence[object]) -> None:
    """Append to a std::vector of Pinocchio's."""
    vector.extend(items)  # type: ignore[attr-defined]
