"""Refuses configurations whose loops are open, or closed by a false zero of the rotation rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...errors import ClosureError
from ..tree.tree import Array
from .closures import Closure

if TYPE_CHECKING:
    from ..loops import ClosedLoops


def require_closed(loops: ClosedLoops, q: Array, tolerance: float, what: str) -> None:
    """A ClosureError where max |φ| / length exceeds `tolerance`."""
    phi = loops.phi(q)
    worst = int(np.argmax(np.abs(phi) / loops.row_scale))  # metres and radians compare by their scales
    residual = float(np.abs(phi[worst]))
    if residual / loops.row_scale[worst] <= tolerance:
        return
    unit = "m" if loops.implicit.is_length[worst] else "rad"
    loop = loops.implicit.labels[worst]
    raise ClosureError(
        f"{what}: the loop {loop} is open by {residual:.3g} {unit}; close it first with mech.assemble(q)",
        residual,
        loop,
    )


def require_proper(loops: ClosedLoops, q: Array) -> None:
    """A ClosureError where frames or axes are turned by π to each other."""
    if all(type(closure).is_proper is Closure.is_proper for closure in loops.loops):
        return  # any rotation is
    loops.tree.jacobians(q)
    for i, closure in enumerate(loops.loops):
        R1, R2 = loops.tree.frame_R[i], loops.tree.frame_R[len(loops.loops) + i]
        if not closure.is_proper(R2.T @ R1):
            loop = f"{closure.frame1} – {closure.frame2}"
            raise ClosureError(
                f"the loop {loop} is closed with its frames turned by half a turn to each other; "
                "start from a guess nearer to the aligned assembly",
                float(np.pi),
                loop,
            )
