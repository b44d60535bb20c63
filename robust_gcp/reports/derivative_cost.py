"""What derivatives cost in the compiled kernel, in forward evaluations and in runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import Cost, Mechanism, ModelWarning, RobustGcpError, Trajectory, backends, gradient, load, simulate
from ..dynamics.equations import Torque
from ..examples.legged import legged
from ..kernel.derivatives.derivations import derivation
from ..mechanism.tree.tree import Array
from ..printing import along, table, write_json
from . import pages
from .machine import least
from .robots import robots_in

SHIPPED: dict[str, Callable[[], Mechanism]] = {
    "a four-bar": lambda: load("crank_rocker"),
    "a five-bar": lambda: load("five_bar"),
    "a strandbeest": lambda: load("strandbeest"),
    "a delta robot": lambda: load("delta"),
    "a Stewart platform": lambda: load("stewart"),
    "a walker": lambda: load("walker"),
    "four legs, floating": lambda: legged(4, floating=True),
    "a rhombus, flat twice": lambda: load("rhombus"),
}

LONG = {"a rhombus, flat twice": 1e-3}
"""Steps of runs that get to singular places, s."""

STATES = 50
"""In one call, so that the call itself does not count."""

STEPS, STEP = 1000, 1e-4
"""Of the run whose end is differentiated; s."""

SPEED = 0.1
"""Of all independent coordinates, rad/s or m/s."""

GRADIENTS = ("gradient / run", "by masses", "by a placement", "feedback")

HEADER = ("mechanism", "nv", "m", "forward, µs", "derivatives, µs", "ratio", *GRADIENTS)


Row = dict[str, Any]
"""A name, nv and m; µs of a forward evaluation and of derivatives with it; times of gradients over those of
their runs, as `_gradients` has them."""


def cells(row: Row) -> list[str]:
    """A row of the table."""
    name, nv, m, forward, derivatives, *gradients = row.values()
    ratios = ["–" if np.isnan(x) else f"{x:.2g}" for x in (derivatives / forward, *gradients)]
    return [name, str(nv), str(m), f"{forward:.3g}", f"{derivatives:.3g}", *ratios]


def measured(name: str, mechanism: Mechanism, rounds: int) -> Row | None:
    """Least times of some rounds at home; None where the kernel has no derivatives of it there."""
    q = mechanism.home
    kernel = derivation(mechanism, q)
    if kernel is None:
        return None
    v, tau = mechanism.lift(q, np.full(mechanism.m, SPEED)), np.zeros(mechanism.nv)
    states, fast, held = (np.tile(part, (STATES, 1)) for part in (q, v, tau))
    if not kernel.slopes(states, fast, held).good.all():
        return None
    forward = least(lambda: kernel.forward_dynamics(states, fast, held, known=True), rounds) / STATES
    derivatives = least(lambda: kernel.slopes(states, fast, held, known=True), rounds) / STATES
    found = {"name": name, "nv": mechanism.nv, "m": mechanism.m}
    found |= {"forward": 1e6 * forward, "derivatives": 1e6 * derivatives}
    return found | _gradients(mechanism, q, v, LONG.get(name, STEP), rounds)


def rows(made: Mapping[str, Callable[[], Mechanism]], rounds: int) -> list[Row]:
    """Of mechanisms by their names; without those that `load` or the kernel refuses."""
    found = []
    for name in along(list(made), "benchmark"):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ModelWarning)
                mechanism = made[name]()
        except RobustGcpError:
            continue
        row = measured(name, mechanism, rounds)
        found += [] if row is None else [row]
    return found


def tell(folder: Path | None, base: str | None, rounds: int, out: Path | None, page: Path | None) -> None:
    """Print the table, of the robots in a folder that is named.

    Writes its figures to a file that is named, and renews the block of these names in a page.

    Raises
    ------
    OptionError
        When the page has no marks of the block.
    """
    block = "derivatives" if folder is None else "derivatives of robots"
    pages.require_marks(page, [block])
    if not backends()["native"].available:
        print(f"no compiled kernel: {backends()['native'].reason}")
        return
    robots = SHIPPED
    if folder is not None:
        robots = {str(p.relative_to(folder)): partial(load, p, base=base) for p in robots_in(folder)}
    found = rows(robots, rounds)
    lines = [cells(row) for row in found]
    print("Least times in the kernel. forward: u̇ at a state; derivatives: with ∂u̇ by y, u and τ;")
    print(
        f"gradient / run: of a cost at the end of {STEPS} steps of RK4, over the time of the run; also with"
    )
    print("all masses as parameters, with a joint's placement, and under a torque function beside its run")
    print(table(HEADER, lines, None))
    if out:
        write_json(out, found)
    pages.refresh(page, {block: pages.table([HEADER, *lines], range(1, len(HEADER)))})


def _gradients(mechanism: Mechanism, q: Array, v: Array, step: float, rounds: int) -> dict[str, float]:
    """Times of gradients of a terminal cost over those of their runs; NaN where there is none.

    By the start and torques alone, with all masses as parameters, with the placement of a joint, and of a run
    under a torque function that is differentiated.
    """
    by_q, by_v = np.zeros(mechanism.nv), np.ones(mechanism.nv)
    cost = Cost(terminal=lambda q, v: float(by_v @ v), terminal_slopes=lambda q, v: (by_q, by_v))
    drag = -0.1 * np.eye(mechanism.nv)
    slopes = np.zeros_like(drag), drag

    def feedback(t: float, q: Array, v: Array) -> Array:
        return drag @ v

    masses = [f"{joint.name}.mass" for joint in mechanism.joints]

    def ratio(torque: Torque | None, *parameters: str) -> float:
        def make() -> Trajectory:
            return simulate(mechanism, q, v, duration=STEPS * step, step=step, torque=torque)

        of_torque = None if torque is None else lambda t, q, v: slopes
        try:
            run = make()
            gradient(run, cost, parameters=parameters, torque_slopes=of_torque)
        except RobustGcpError:  # to where its coordinates end, or its modes, or loops do not stay closed
            return float("nan")
        few = max(2, rounds // 10)
        swept = least(lambda: gradient(run, cost, parameters=parameters, torque_slopes=of_torque), few)
        return swept / least(make, few)

    last = mechanism.joints[-1].name
    placed = (ratio(None, f"{last}.placement.{axis}") for axis in "yzx")
    by_placement = next((found for found in placed if not np.isnan(found)), float("nan"))
    return {
        "gradient": ratio(None),
        "by_masses": ratio(None, *masses),
        "by_placement": by_placement,
        "feedback": ratio(feedback),
    }
