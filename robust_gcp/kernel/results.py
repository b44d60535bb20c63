"""What the kernel left in a request, in the words of the package; and choices on their way there."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ..maps.cluster.options import BridgeOptions
from ..maps.explicit import Crossing
from ..mechanism.tree import Array
from .library import Library
from .structures import Arrays, Bridging, Request


def counted(request: Request) -> dict[str, int]:
    """What was computed, by the names of `Counters`, steps and right-hand sides apart."""
    return {
        "newton_iterations": request.newton,
        "constraint_evaluations": request.constraint_evaluations,
        "force_evaluations": request.force_evaluations,
        "zone_evaluations": request.zone_evaluations,
        "marching_steps": request.marching_steps,
        "svds": request.svds,
        "bridges_built": request.bridges_built,
        "second_order": request.second_order,
    }


def crossings(request: Request, nq: int, numbers: NDArray[np.int64]) -> list[Crossing]:
    """What was passed last; `numbers` are the places of y in q."""
    if not request.logged:
        return []
    shape = (int(request.logged), 8 + nq)
    log = np.ctypeslib.as_array(ctypes.cast(request.log, ctypes.POINTER(ctypes.c_double)), shape).copy()
    return [
        Crossing(
            float(row[1]),
            row[8:][numbers],
            row[8:],
            "near miss" if row[6] else "tangential" if row[7] > 1.0 else "transversal",
            float(row[4]),
            float(row[5]),
            int(row[2]),
            int(row[3]),
            int(row[7]),
        )
        for row in log
    ]


def tracker_numbers(library: Library, handle: int | None) -> Array:
    """The present state of the trackers as plain numbers."""
    count = ctypes.c_int64()
    numbers = library.trackers(handle, ctypes.byref(count))
    return np.ctypeslib.as_array(numbers, (count.value,)).copy()


def bridging(options: BridgeOptions, last_resort: float) -> Arrays:
    """The choices of the bridges as plain numbers; `last_resort` as of `ClusterMap`."""
    numbers = Arrays(
        Bridging(
            count=len(options.nodes),
            reach=options.reach(1),
            reach_of_several=options.reach(2),
            closure_tolerance=options.closure_tolerance,
            geometric_tolerance=options.geometric_tolerance,
            transversality=options.transversality,
            last_resort=last_resort,
        )
    )
    numbers.reals(nodes=options.nodes)
    return numbers
