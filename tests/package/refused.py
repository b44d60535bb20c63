"""What a process of its own runs: apart from its test, whose file imports all that the package has."""

from __future__ import annotations

import robust_gcp as rg


def refused(deep: bool) -> None:
    if deep:
        rg.simulate(rg.load("kite"), duration=1.0, step=5e-3, on_toggle="error")
    rg.simulate(rg.load("rhombus"), q0=[0.0, 0.5, 0.0], duration=1e-3)
