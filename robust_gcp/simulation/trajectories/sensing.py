"""What sensors of the mechanism's file read, at a state by itself and at those of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_finite, check_mechanism, check_text
from ...dynamics.equations import Torque, TorqueFunction, constraint_forces, torque_function
from ...dynamics.loads import Torques, one_torque
from ...dynamics.prescribed.control import Controls, held_controls
from ...dynamics.problem import initial_value_problem
from ...errors import OptionError
from ...mechanism.actuation.actuators import clipped
from ...mechanism.actuation.paths import FixedTendon
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import Part, Stop
from ...mechanism.sensing.instant import Instant
from ...mechanism.sensing.sensors import Sensor, read
from ...mechanism.tree.tree import Array
from ..phases.rows import columns_of
from .reactions import Loaded


def sense(
    mechanism: Mechanism,
    name: str,
    q: ArrayLike,
    v: ArrayLike | None,
    a: ArrayLike | None,
    tau: Torques | None,
    t: float,
    ctrl: Controls | None,
) -> Array:
    """`Mechanism.sense`."""
    check_text("sense: name", name)
    sensor = mechanism.sensors[name]
    check_finite("t", t)
    at = mechanism.configuration(q)
    moving = mechanism.velocity(np.zeros(mechanism.nv) if v is None else v)
    rates, acting, u = np.zeros_like(moving), None, None if ctrl is None else _inputs(mechanism, ctrl)
    loads = _loads(mechanism, tau, u)
    if a is not None:
        rates = mechanism.velocity(a, "a")
        torque, applied = torque_function(mechanism, loads), mechanism.applied
        given = [] if torque is None else [torque(t, at, moving)]
        given += [] if applied is None else [applied.tau(at, moving)]
        acting = np.sum(given, axis=0) if given else None
    elif sensor.needs in "af":
        check_mechanism(mechanism, Mechanism, "sense")
        problem = initial_value_problem(mechanism, at, moving, None, loads)
        now = problem.equations.at_point(t, problem.start.point)
        at, moving, rates, acting = now.point.q, now.v, now.a, now.tau
    multipliers = None
    if sensor.needs == "f":
        multipliers = constraint_forces(mechanism, at, moving, rates, acting)[None]
    state = mechanism, np.array([t]), at[None], moving[None], lambda: rates[None]
    return np.asarray(sensed(Loaded(*state, multipliers, u=None if u is None else u[None]), name)[0])


def _inputs(mechanism: Mechanism, ctrl: Controls) -> Array:
    """u of the actuators: controls within their ranges, activations as they are given."""
    given = zip(mechanism.actuators, held_controls(mechanism, ctrl).tolist(), strict=True)
    return np.array([clipped(u, a.ctrl_range) if a.dynamics == "none" else u for a, u in given])


def _loads(mechanism: Mechanism, tau: Torques | None, u: Array | None) -> Torque | ArrayLike | None:
    """Torques, with those of the actuators where there are any."""
    base, actuation = one_torque(mechanism, tau), mechanism.actuation
    if u is None or actuation is None:
        return base
    besides = torque_function(mechanism, base)

    def total(t: float, q: Array, v: Array) -> Array:
        own = actuation.forces_at(q, v, u)[1]
        return own if besides is None else own + besides(t, q, v)

    return TorqueFunction(total, mechanism.nv)


def sensed(loaded: Loaded, name: str) -> Array:
    """What a sensor of the mechanism reads at each state, (N, dim).

    Raises
    ------
    ModelError
        For a sensor that there is not.
    OptionError
        As `Loaded.pushes`, for "force" and "torque", and for what a limit does where no stop stands for it.
    """
    sensor, here = loaded.mechanism.sensors[name], Instant(loaded.mechanism)
    rates = loaded.accelerations() if sensor.needs in "af" else np.zeros_like(loaded.v)
    pushes = loaded.pushes() if sensor.needs == "f" else None
    pressed = _pressed(loaded, sensor) if sensor.needs == "s" else np.zeros(len(loaded.q))
    read_off = np.empty((len(loaded.q), sensor.dim))
    for i, (t, q, v, a) in enumerate(zip(loaded.t, loaded.q, loaded.v, rates, strict=True)):
        u = None if loaded.u is None else loaded.u[i]
        here.move(float(t), q, v, a, () if pushes is None else pushes(i), u, float(pressed[i]))
        read_off[i] = read(sensor, here)
    return read_off


def _pressed(loaded: Loaded, sensor: Sensor) -> Array:
    """What the stop pushes with that stands for a limit of the file, (N,), N or N m."""
    mechanism = loaded.mechanism
    lower, upper, _ = sensor.numbers
    if lower == -np.inf and upper == np.inf:
        return np.zeros(len(loaded.q))
    row, arm = {str(sensor.joint): 1.0}, 1.0
    if sensor.tendon is not None:
        path = mechanism.tendons[sensor.tendon]
        assert isinstance(path, FixedTendon)
        arm = next(iter(path.coefficients.values()))
        row = {joint: value / arm for joint, value in path.coefficients.items()}
    parts = list(zip(mechanism.parts, columns_of(mechanism.parts), strict=True))
    own = [column for part, column in parts if isinstance(part, Stop) and _row(part) == row]
    if not own:
        raise OptionError(
            f"sensor {sensor.name!r} reads what a limit of the file does, and no stop stands for it: load it "
            "by rg.load(file, limits=True)"
        )
    if loaded.stops is None:
        raise OptionError(f"sensor {sensor.name!r} reads what a stop does, which is known along a run")
    if own[0] not in loaded.stops:
        raise OptionError(
            f"sensor {sensor.name!r}: the stop that stands for its limit was not in this run; leave joints= "
            "out, or give it joints=[*mech.parts, ...]"
        )
    # the tendon's length is arm times the stop's row: its force is that of the row over arm
    return np.asarray(np.abs(loaded.stops[own[0]]) / abs(arm))


def _row(part: Part) -> dict[str, float]:
    return dict(zip(part.joints, part.weights, strict=True))
