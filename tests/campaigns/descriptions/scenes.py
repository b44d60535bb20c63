"""The scenes that are described anew: shipped models, linkages of several loops, spatial ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from robust_gcp.examples import six_bars, spatial
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.six_bars import CHANGE_POINT, lamp
from robust_gcp.examples.six_bars import joined_by_dyad as joined
from robust_gcp.io.loader import load
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array


@dataclass(frozen=True)
class Scene:
    """A mechanism in motion.

    Attributes
    ----------
    name : str
    make : callable () -> Mechanism
        At home where the motion starts.
    rates : tuple of float or None
        ẏ there; None: what the model recommends.
    duration, step : float
        s; the step is short enough for RK4 to err below 1e-9 in all coordinates.
    crossings : tuple of int
        Coranks of those passed, in their order.
    """

    name: str
    make: Callable[[], Mechanism]
    rates: tuple[float, ...] | None
    duration: float
    step: float = 1e-3
    crossings: tuple[int, ...] = ()

    def started(self) -> tuple[Mechanism, Array]:
        """The mechanism and its velocity at home."""
        mechanism = self.make()
        if self.rates is None:
            v0 = mechanism.recommended.velocity(None, None)
            return mechanism, np.zeros(mechanism.nv) if v0 is None else np.asarray(v0)
        return mechanism, mechanism.lift(mechanism.home, self.rates)


def _row(name: str, *angles: float, parents: tuple[int, ...] | None = None) -> Scene:
    """Change-point four-bars, each on the coupler of its parent, all cranks at 3 rad/s through π."""
    n = len(angles)
    make = partial(four_bars, [CHANGE_POINT] * n, angles, parents, spacing=8.0)
    return Scene(name, make, (3.0,) * n, 0.24, crossings=(1,) * n)


SHIPPED = (
    Scene("rhombus", partial(load, "rhombus"), (-2.0,), 0.3, crossings=(1,)),
    Scene("parallelogram", partial(load, "parallelogram"), (-2.0,), 0.3, crossings=(1,)),
    Scene("change_point", partial(load, "change_point"), (3.0,), 0.4, crossings=(1,)),
    Scene("kite", partial(load, "kite"), (-3.0,), 0.3, crossings=(1,)),
    Scene("crank_rocker", partial(load, "crank_rocker"), (3.0,), 0.5),
    Scene("slider_crank", partial(load, "slider_crank"), (3.0,), 0.5, 5e-4),
    Scene("five_bar", partial(load, "five_bar"), (-1.0, 1.0), 0.3),
    Scene("strandbeest", partial(load, "strandbeest"), (3.0,), 0.5, 2e-4),
    Scene("strandbeest_pair", partial(load, "strandbeest_pair"), (3.0,), 0.3, 2e-4),
    Scene("andrews", partial(load, "andrews"), (0.0,), 0.006, 5e-6),
    Scene("bricard", partial(load, "bricard"), (0.0,), 0.5),
    Scene("bricard_square", partial(load, "bricard_square"), (0.0,), 0.5),
    Scene("flyball", partial(load, "flyball"), None, 0.02, 2e-5),
    Scene("stewart", partial(load, "stewart"), (0.2, -0.1, 0.3, 0.1, -0.2, 0.1), 0.1, 2e-4),
)

LIFTS = {1: (1,), 2: (1,), 3: (2,), 4: (3,), 5: (4,)}
"""Coranks that scissor lifts pass: flat, or folded where there is one stage."""

PLANAR = (
    Scene("Watt", six_bars.watt, (3.0,), 0.4, crossings=(1,)),
    Scene("Stephenson", six_bars.stephenson, (3.0,), 0.4, crossings=(1,)),
    *(
        Scene(f"scissor lift, {n}", partial(scissor_lift, n), (-2.0,), 0.6, 5e-4, LIFTS[n])
        for n in (1, 2, 3, 4, 5)
    ),
    Scene("lamp in series", lamp, (-2.0, -2.2), 0.2, crossings=(1, 1)),
    Scene("lamp of three", partial(lamp, (0.3, 0.25, 0.2)), (-2.0, -2.2, -1.8), 0.2, crossings=(1, 1, 1)),
    Scene("lamps side by side", partial(lamp, (0.3, 0.3), True), (-2.0, -2.0), 0.2, crossings=(1, 1)),
    Scene("parallel legs", partial(six_bars.parallel_legs, 3, 0.4), (-3.0,), 0.3, crossings=(1,)),
    Scene("four legs", partial(six_bars.parallel_legs, 4, 0.4), (-3.0,), 0.3, crossings=(1,)),
    _row("two at once", 2.8, 2.8),
    _row("chain of two at once", 2.8, 2.8, parents=(-1, 0)),
    _row("chain of two", 2.75, 2.8, parents=(-1, 0)),
    _row("chain of three", 2.75, 2.8, 2.85, parents=(-1, 0, 1)),
    _row("tree of four", 2.75, 2.8, 2.85, 2.7, parents=(-1, 0, 0, 1)),
    _row("tree of five", 2.75, 2.8, 2.85, 2.7, 2.8, parents=(-1, 0, 0, -1, 3)),
    Scene("joined by a dyad", partial(joined, (2.8, 2.5)), (3.0, 0.5), 0.2, crossings=(1,)),
    Scene("joined by a dyad, both", partial(joined, (2.9, 2.95)), (3.0, 3.0), 0.12, crossings=(1, 1)),
)

SPATIAL = (
    Scene("Bennett", spatial.bennett, (2.0,), 0.5),
    Scene("spherical four-bar", spatial.spherical_four_bar, (3.0,), 0.32, crossings=(1,)),
    Scene("rod between cranks", spatial.rod_between_cranks, (2.0,), 0.3),
    Scene("Sarrus", spatial.sarrus, (2.0,), 0.32, crossings=(2,)),
)

SCENES = (*SHIPPED, *PLANAR, *SPATIAL)
