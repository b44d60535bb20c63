"""`Mechanism.sense`: what a sensor reads at a state by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_finite, check_mechanism, check_text
from ..dynamics.equations import constraint_forces, torque_function
from ..dynamics.loads import Torques, one_torque
from ..dynamics.problem import set_out
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .reactions import Loaded


def sense(
    mechanism: Mechanism,
    name: str,
    q: ArrayLike,
    v: ArrayLike | None,
    a: ArrayLike | None,
    tau: Torques | None,
    t: float,
) -> Array:
    """`Mechanism.sense`."""
    check_text("sense: name", name)
    sensor = mechanism.sensors[name]
    check_finite("t", t)
    at = mechanism.configuration(q)
    moving = mechanism.velocity(np.zeros(mechanism.nv) if v is None else v)
    rates, acting = np.zeros_like(moving), None
    if a is not None:
        rates = mechanism.velocity(a, "a")
        torque, applied = torque_function(mechanism, one_torque(mechanism, tau)), mechanism.applied
        given = [] if torque is None else [torque(t, at, moving)]
        given += [] if applied is None else [applied.tau(at, moving)]
        acting = np.sum(given, axis=0) if given else None
    elif sensor.needs in "af":
        check_mechanism(mechanism, Mechanism, "sense")
        problem = set_out(mechanism, at, moving, None, one_torque(mechanism, tau))
        now = problem.equations.at_point(t, problem.start.point)
        at, moving, rates, acting = now.point.q, now.v, now.a, now.tau
    multipliers = None
    if sensor.needs == "f":
        multipliers = constraint_forces(mechanism, at, moving, rates, acting)[None]
    loaded = Loaded(mechanism, np.array([t]), at[None], moving[None], lambda: rates[None], multipliers)
    return np.asarray(loaded.sensor(name)[0])
