"""What a mechanism takes in memory against its number of velocities: `python -m robust_gcp.reports.memory`.

Revolute joints side by side, each mechanism in a fresh process: the size that is computed beforehand, what
the process grew by, and the size of a whole `pin.Data`, whose tensors for second derivatives nothing here
uses.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
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
    found = []
    for count in sizes:
        words = [sys.executable, "-m", "robust_gcp.reports.memory", "--one", str(count)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        taken, seconds = map(float, done.stdout.split())
        model = hinges(count)
        size = model.nv, model.njoints
        sizes_mb = workspace_bytes(*size) / 1e6, taken, whole_bytes(*size) / 1e6
        found.append([str(count), *(f"{size:.3g}" for size in sizes_mb), f"{seconds:.2g}"])
    return found


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="memory against the number of velocities")
    parser.add_argument("--one", type=int, help="measure this many revolute joints in this process")
    options = parser.parse_args()
    if options.one is not None:
        print(*measure(options.one))
        return
    heading = ["nv", "workspace, MB", "mechanism, measured, MB", "whole pin.Data, MB", "s to make"]
    print(table(heading, rows()))


if __name__ == "__main__":
    main()
