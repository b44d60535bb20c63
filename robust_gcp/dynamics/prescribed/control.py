"""What drives the actuators of a run: controls by a user, and activations that follow them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import hint, is_table, real_array, shown
from ...errors import OptionError
from ...mechanism.actuation.actuators import Actuator, clipped
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...user_functions import returned
from ..equations import CheckedTorque, Torque, TorqueFunction, torque_function
from .control_curves import Curve, Table, curve_of

Controls = Mapping[str, Any] | ArrayLike
"""By actuator: a number, a function (t, q, v) of it, or a table (times, values)."""

Given = float | Table | Callable[..., Any]


def controls_given(mechanism: Mechanism, ctrl: Controls, numbers: bool = False) -> list[Given]:
    """The control of each actuator; 0 for those that are not named.

    Parameters
    ----------
    ctrl : mapping of str, or array_like (n,)
    numbers : bool
        Whether functions and tables are refused, as where a step holds them.

    Raises
    ------
    OptionError
        For a name that is no actuator's, and for what is no control.
    """
    actuators = mechanism.actuators
    if not actuators:
        raise OptionError(
            f"ctrl: {shown(mechanism)} has no actuators; give torque={{joint: value}}, or a mechanism with "
            "actuators=[...]"
        )
    names = [actuator.name for actuator in actuators]
    if not isinstance(ctrl, Mapping):
        values = real_array(ctrl) if is_number_or_array(ctrl) else np.zeros(0)
        if values.shape != (len(names),):
            raise OptionError(
                f"ctrl = {shown(ctrl)} must be {{actuator: control}}, or {len(names)} numbers, of "
                + ", ".join(names)
            )
        ctrl = dict(zip(names, values.tolist(), strict=True))
    for name in ctrl:
        if name not in names:
            near = hint(name, names) or f"; there are {', '.join(names)}"
            raise OptionError(f"ctrl: there is no actuator {name!r}{near}")
    return [_given(name, ctrl.get(name, 0.0), numbers) for name in names]


def held_controls(mechanism: Mechanism, ctrl: Controls, before: Array | None = None) -> Array:
    """Controls that a step holds, (n,); those that a mapping does not name are as before, else 0."""
    given = np.array(controls_given(mechanism, ctrl, numbers=True), dtype=float)
    if before is None or not isinstance(ctrl, Mapping):
        return given
    named = np.array([actuator.name in ctrl for actuator in mechanism.actuators])
    return np.where(named, given, before)


def is_number_or_array(value: Any) -> bool:
    """Whether real numbers were given."""
    try:
        return bool(np.all(np.isfinite(real_array(value))))
    except TypeError:
        return False


def _given(name: str, value: Any, numbers: bool) -> Given:
    label = f"ctrl[{name!r}]"
    if callable(value) and not numbers:
        return value
    if is_number_or_array(value) and np.ndim(value) == 0:
        return float(value)
    if numbers:
        raise OptionError(f"{label} = {shown(value)}: a step holds a finite number")
    in_two = (isinstance(value, Sequence) or is_table(value)) and len(value) == 2
    if in_two and all(is_number_or_array(part) for part in value):
        times, values = (real_array(part) for part in value)
        ascending = times.ndim == 1 and len(times) > 1 and np.all(np.diff(times) > 0.0)
        if ascending and values.shape == times.shape:
            return Table(times, values)
    raise OptionError(
        f"{label} = {shown(value)} is no finite number, function (t, q, v) or table (times, values), times "
        "ascending"
    )


class Control:
    """Controls and activations u of all actuators over a run.

    Parameters
    ----------
    mechanism : Mechanism
    given : list
        As `controls_given` returns it.
    t0, t1 : float
        The run's span, s.

    Attributes
    ----------
    asks : bool
        Whether a function of the user's says some of it.
    constant : ndarray (n,) or None
        u, where it is the same at all times.

    Raises
    ------
    OptionError
        For a function of the state whose activation would have to be a state of the motion.
    """

    def __init__(self, mechanism: Mechanism, given: Sequence[Given], t0: float, t1: float) -> None:
        self._parts: list[Curve | _Asked] = []
        fixed: list[float] = []
        for actuator, control in zip(mechanism.actuators, given, strict=True):
            if isinstance(control, float | Table):
                self._parts.append(curve_of(actuator, control, t0, t1))
            elif actuator.dynamics == "none":
                self._parts.append(_Asked(actuator, control))
            else:
                raise OptionError(
                    f"ctrl[{actuator.name!r}] is a function, and its actuator has dynamics="
                    f"{actuator.dynamics!r}: give hold=True, by which it is asked once a step, or a table "
                    "(times, values)"
                )
            if isinstance(control, float) and actuator.dynamics == "none":
                fixed.append(clipped(control, actuator.ctrl_range))
        self.asks = any(isinstance(part, _Asked) for part in self._parts)
        self.constant = np.array(fixed) if len(fixed) == len(self._parts) else None

    def controls_at(self, t: float, q: Array, v: Array) -> Array:
        """u at a state, (n,)."""
        if self.constant is not None:
            return self.constant
        now = np.array([t])
        found = [part(t, q, v) if isinstance(part, _Asked) else part(now)[0] for part in self._parts]
        return np.array(found, dtype=float)

    def over(self, times: Array) -> Array:
        """u at each time, (N, n), where no function is asked."""
        return np.stack([part(times) for part in self._parts if not isinstance(part, _Asked)], axis=1)

    def stages(self, times: Array, shares: Sequence[float]) -> Array:
        """u at each time and the stages after it, (N, s, n)."""
        steps = np.append(np.diff(times), 0.0)
        at = times[:, None] + np.array(shares) * steps[:, None]
        return np.ascontiguousarray(self.over(at.ravel()).reshape(*at.shape, -1))


def asked_of(actuator: Actuator, control: Given) -> Callable[[float, Array, Array], float]:
    """A control, clipped, as a function (t, q, v) of any kind of it."""
    if isinstance(control, float | Table):
        # the control itself: whoever holds it follows its activation
        curve = curve_of(replace(actuator, dynamics="none", time=()), control, 0.0, 0.0)
        return lambda t, q, v: float(curve(np.array([t]))[0])
    return _Asked(actuator, control)


class _Asked:
    """A function of the user's, checked and clipped."""

    def __init__(self, actuator: Actuator, supplied: Callable[..., Any]) -> None:
        self._actuator, self._supplied = actuator, supplied

    def __call__(self, t: float, q: Array, v: Array) -> float:
        label, value = f"ctrl[{self._actuator.name!r}](t, q, v)", self._supplied(t, q.copy(), v.copy())
        number = float(returned(value, (), label, t=t))
        return clipped(number, self._actuator.ctrl_range)


def with_control(
    mechanism: Mechanism, torque: Torque | ArrayLike | None, ctrl: Controls | None, times: Array
) -> Torque | ArrayLike | None:
    """A torque, and what the actuators do under their controls over these times."""
    if ctrl is None:
        return torque
    control = Control(mechanism, controls_given(mechanism, ctrl), float(times[0]), float(times[-1]))
    return Actuated(mechanism, torque, control)


class Actuated(TorqueFunction):
    """What actuators do under their control, besides another torque.

    Parameters
    ----------
    mechanism : Mechanism
    base : callable, array_like (nv,) or None
    control : Control

    Attributes
    ----------
    control : Control
    constant : ndarray (nv,) or None
        The other torque, where it is one.
    asks : bool
        Whether the compiled kernel has to ask for it.
    """

    def __init__(self, mechanism: Mechanism, base: Torque | ArrayLike | None, control: Control) -> None:
        super().__init__(lambda t, q, v: self(t, q, v), mechanism.nv)
        assert mechanism.actuation is not None  # whoever made the control knows
        self._mechanism, self.control, self._actuation = mechanism, control, mechanism.actuation
        self.constant = None if base is None or callable(base) else mechanism.velocity(base, "torque")
        self._function: CheckedTorque | None = torque_function(mechanism, base)
        known = all(actuator.along.in_kernel for actuator in mechanism.actuators)
        self.asks = control.asks or callable(base) or not known

    def beside(self, more: Array) -> Actuated:
        """The same with another torque (nv,) beside it."""
        mechanism, function, constant = self._mechanism, self._function, self.constant
        if function is None or constant is not None:
            return Actuated(mechanism, more if constant is None else constant + more, self.control)
        return Actuated(mechanism, lambda t, q, v: more + function(t, q, v), self.control)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """τ, (nv,)."""
        tau = self.forces(t, q, v)[1]
        return tau if self._function is None else tau + self._function(t, q, v)

    def forces(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Forces of the actuators (n,) and their τ (nv,)."""
        return self._actuation.forces_at(q, v, self.control.controls_at(t, q, v))
