"""What a mechanism takes in memory against its number of velocities: `python -m robust_gcp.reports.memory`.

Revolute joints side by side, each mechanism in a fresh process: the size that is computed beforehand, what
the process grew by, and the size of a whole `pin.Data`, whose tensors for second derivatives nothing here
uses.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from .. import Mechanism
from ..mechanism.tree.workspace import whole_bytes, workspace_bytes
from ..printing import table

SIZES = (10, 50, 100, 200, 500, 1000)


def hinges(count: int) -> pin.Model:
    """Revolute joints side by side, each with a body of 1 kg."""
    model = pin.Model()
    for i in range(count):
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), f"hinge{i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    return model


def measure(count: int) -> tuple[float, float]:
    """MB that this process grew by when it made the mechanism, and the seconds that it took."""
    model = hinges(count)
    Mechanism.from_pinocchio(hinges(2))
    before, begun = _resident(), time.perf_counter()
    mechanism = Mechanism.from_pinocchio(model)
    seconds = time.perf_counter() - begun
    assert mechanism.nv == count
    return _resident() - before, seconds


def _resident() -> float:
    """MB of memory in use; Linux tells."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def rows(sizes: Sequence[int] = SIZES) -> list[list[str]]:
    """The table's lines."""
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as fresh:
        measured = fresh.map(measure, sizes, chunksize=1)
    found = []
    for count, (taken, seconds) in zip(sizes, measured, strict=True):
        model = hinges(count)
        size = model.nv, model.njoints
        sizes_mb = workspace_bytes(*size) / 1e6, taken, whole_bytes(*size) / 1e6
        found.append([str(count), *(f"{size:.3g}" for size in sizes_mb), f"{seconds:.2g}"])
    return found


if __name__ == "__main__":
    heading = ["nv", "workspace, MB", "mechanism, measured, MB", "whole pin.Data, MB", "s to make"]
    print(table(heading, rows()))
