"""The scenes of `costs`: from one pendulum to everything at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from .. import JointDamper, JointSpring, Mechanism, load
from ..examples import linkages
from .stability.truth import with_forces

RECORDS = ("a", "energy", "multipliers")


def _pendulum() -> Mechanism:
    model = pin.Model()
    linkages.add_link(model, 0, 0.0, "q1", 1.0)
    return Mechanism.from_pinocchio(model, home=[0.5])


def _with_forces(mechanism: Mechanism) -> Mechanism:
    """A spring and a damper on the first joint."""
    return with_forces(mechanism, [JointSpring("q1", 5.0, 0.2), JointDamper("q1", 0.1)])


def _brake(t: float, q: Any, v: Any) -> Any:
    """A torque against the motion of the first joint, N m."""
    return np.concatenate([[-0.1 * v[0]], np.zeros(len(v) - 1)])


def _far(**more: Any) -> dict[str, Any]:
    """0.1 s of a four-bar away from singular configurations."""
    return {"duration": 0.1, "step": 1e-3} | more


def _moving(name: str) -> dict[str, Any]:
    """A robot as its model recommends to start it."""
    recommended = load(name).recommended
    return _far(v0=recommended.v0)


def _rhombus(**more: Any) -> dict[str, Any]:
    """0.4 s of the fall through its first singular configuration."""
    return _far(q0=[0.2, -0.2, 0.2], duration=0.4, **more)


def _swinging() -> tuple[Mechanism, dict[str, Any]]:
    mechanism = linkages.swinging_four_bar(4.0, 2.0, 3.0, 3.0, 0.1, np.pi - 0.3)
    v0 = mechanism.lift(mechanism.home, [0.1, 3.0])
    return mechanism, _far(v0=v0, duration=0.2)


def _toggling() -> tuple[Mechanism, dict[str, Any]]:
    """A crank-rocker driven through the turning point of its rocker, which is the coordinate."""
    driven = load("crank_rocker")
    q0 = driven.assemble([1.5, *driven.home[1:]])
    start = {"q0": q0, "v0": driven.lift(q0, [6.0])}
    return driven.with_independent(["q3"]), _far(**start, duration=0.4, on_toggle="repartition")


SCENES: dict[str, Callable[[], tuple[Mechanism, dict[str, Any]]]] = {
    "one pendulum": lambda: (_pendulum(), _far()),
    "a pendulum with spring and damper": lambda: (_with_forces(_pendulum()), _far()),
    "one loop, far from singular": lambda: (load("crank_rocker"), _far()),
    "… with spring and damper": lambda: (_with_forces(load("crank_rocker")), _far()),
    "… with a torque": lambda: (load("crank_rocker"), _far(torque=_brake)),
    "… recording a": lambda: (load("crank_rocker"), _far(record=("a",))),
    "… recording the energy": lambda: (load("crank_rocker"), _far(record=("energy",))),
    "… recording λ": lambda: (load("crank_rocker"), _far(record=("multipliers",))),
    "… by DOP853": lambda: (load("crank_rocker"), _far(stepper="DOP853")),
    "three loops in a row": lambda: (linkages.n_four_bar(3), _far()),
    "two coordinates, far from singular": lambda: (load("five_bar"), _far()),
    "one closure row too many (Bricard)": lambda: (load("bricard"), _far()),
    "a delta robot, far from singular": lambda: (load("delta"), _moving("delta")),
    "a walker's two clusters, far from singular": lambda: (load("walker"), _moving("walker")),
    "a floating walker, far from singular": lambda: (load("walker", base="free"), _far()),
    "through a crossing": lambda: (load("rhombus"), _rhombus()),
    "two coordinates, through a crossing": _swinging,
    "the coordinate turns back: repartition": _toggling,
    "everything on": lambda: (_with_forces(load("rhombus")), _rhombus(torque=_brake, record=RECORDS)),
}
"""A mechanism and the arguments of `simulate`, by names for the table."""
