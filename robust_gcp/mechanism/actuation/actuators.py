"""Actuators: a force along a path, by a control that a user gives and an activation that follows it.

    force = gain(ℓ, ℓ̇) u + bias(ℓ, ℓ̇)

u is the control or, where there is one, the activation; gain and bias are affine, or a muscle's. Controls,
activations and forces are clipped to their ranges. The form is that of MuJoCo's general actuator.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...checks import check_choice, check_finite, check_text, checked_vector, listed, real_array, shown
from ...errors import ModelError
from .muscle import TINY, Muscle, Range
from .paths import FixedTendon, Path

DYNAMICS = ("none", "integrator", "filter", "muscle")


@dataclass(frozen=True)
class Actuator:
    """A force along a path: gain u + bias, each affine in the path's length and rate, or a muscle's.

    Parameters
    ----------
    name : str
        By which `ctrl` calls it.
    path : str or Path
        A joint with one number, or a tendon, a site, …
    gear : float
        ℓ and ∂ℓ/∂q are the path's times this.
    gain, bias : sequence of up to 3 floats
        Of 1, ℓ and ℓ̇.
    muscle : Muscle, optional
        In place of gain and bias.
    dynamics : {"none", "integrator", "filter", "muscle"}
        Of the activation w by the control u: none; ẇ = u; ẇ = (u − w)/τ; the same with a muscle's τ(u, w).
    time : sequence of float
        τ, s, of a filter; of a muscle those of activation and deactivation, and the width of u − w over which
        one passes into the other.
    ctrl_range, force_range, activation_range : (float, float), optional
    shared_range : (float, float), optional
        Of the sum of all actuators along this path, which are scaled down alike.
    activation : float
        At the start of a run.

    Raises
    ------
    ModelError
        For numbers that make no actuator.
    """

    name: str
    path: Path | str
    gear: float = 1.0
    gain: Sequence[float] = (1.0,)
    bias: Sequence[float] = ()
    muscle: Muscle | None = None
    dynamics: str = "none"
    time: Sequence[float] = ()
    ctrl_range: Range | None = None
    force_range: Range | None = None
    activation_range: Range | None = None
    shared_range: Range | None = None
    activation: float = 0.0

    def __post_init__(self) -> None:
        check_text("Actuator: name", self.name)
        label = f"Actuator {self.name!r}"
        if isinstance(self.path, str):
            object.__setattr__(self, "path", FixedTendon({self.path: 1.0}))
        if not isinstance(self.path, Path):
            raise ModelError(f"{label}: path = {shown(self.path)} is no joint's name and no path")
        if not (self.muscle is None or isinstance(self.muscle, Muscle)):
            raise ModelError(f"{label}: muscle = {shown(self.muscle)} is no Muscle")
        for what in ("gear", "activation"):
            check_finite(f"{label}: {what}", getattr(self, what))
        for what in ("gain", "bias"):
            given = _numbers(getattr(self, what))
            if given is None or len(given) > 3:
                given_ = shown(getattr(self, what))
                raise ModelError(f"{label}: {what} = {given_} must be up to three numbers, of 1, ℓ and ℓ̇")
            object.__setattr__(self, what, (*given, *[0.0] * (3 - len(given))))
        for what in ("ctrl_range", "force_range", "activation_range", "shared_range"):
            if getattr(self, what) is not None:
                low, high = checked_vector(getattr(self, what), 2, f"{label}: {what}", "2").tolist()
                if not low <= high:
                    raise ModelError(f"{label}: {what} = ({low}, {high}) must be ascending")
                object.__setattr__(self, what, (low, high))
        check_choice(f"{label}: dynamics", self.dynamics, DYNAMICS)
        wanted = {"filter": 1, "muscle": 3}.get(self.dynamics, 0)
        times = _numbers(self.time)
        if self.dynamics == "muscle" and times is not None and len(times) == 2:
            times = (*times, 0.0)
        if times is None or len(times) != wanted or any(x < 0.0 for x in times):
            given_ = shown(self.time)
            raise ModelError(f"{label}: dynamics={self.dynamics!r} takes {wanted} times, s, not {given_}")
        object.__setattr__(self, "time", times)

    @classmethod
    def motor(cls, name: str, joint: str | Path, gear: float = 1.0, **more: Any) -> Actuator:
        """force = ctrl, N or N m, times the gear on the joint."""
        return cls(name, joint, gear, **more)

    @classmethod
    def position(cls, name: str, joint: str | Path, kp: float, kv: float = 0.0, **more: Any) -> Actuator:
        """A servo: force = kp (ctrl − ℓ) − kv ℓ̇."""
        check_finite(f"Actuator {shown(name)}: kp", kp)
        check_finite(f"Actuator {shown(name)}: kv", kv)
        return cls(name, joint, gain=(kp,), bias=(0.0, -kp, -kv), **more)

    @classmethod
    def velocity(cls, name: str, joint: str | Path, kv: float, **more: Any) -> Actuator:
        """A servo: force = kv (ctrl − ℓ̇)."""
        check_finite(f"Actuator {shown(name)}: kv", kv)
        return cls(name, joint, gain=(kv,), bias=(0.0, 0.0, -kv), **more)

    @property
    def along(self) -> Path:
        """Its path, by which a joint's name was replaced."""
        assert isinstance(self.path, Path)
        return self.path

    @property
    def kind(self) -> str:
        """What it is in a word: motor, position, velocity, muscle, general."""
        assert len(self.gain) == len(self.bias) == 3
        k, (b0, b1, b2) = self.gain[0], self.bias
        if self.muscle is not None or self.dynamics == "muscle":
            return "muscle"
        if any(self.gain[1:]) or b0:
            return "general"
        if not (b1 or b2):
            return "motor"
        return "position" if k == -b1 else "velocity" if b1 == 0.0 and k == -b2 else "general"

    def force(self, u: float, length: float, rate: float) -> float:
        """gain u + bias, N or N m, not yet clipped."""
        if self.muscle is not None:
            gain, bias = self.muscle.gain_and_bias(length, rate)
        else:
            gain = self.gain[0] + self.gain[1] * length + self.gain[2] * rate
            bias = self.bias[0] + self.bias[1] * length + self.bias[2] * rate
        return gain * u + bias

    def activation_rate(self, ctrl: float, w: float) -> float:
        """ẇ, 1/s."""
        u = clipped(ctrl, self.ctrl_range)
        if self.dynamics == "integrator":
            return u
        if self.dynamics == "filter":
            return (u - w) / max(TINY, self.time[0])
        rise, fall, width = self.time
        # activation slows down, and deactivation speeds up, with w (Millard et al., 2013)
        u, share = min(max(u, 0.0), 1.0), 0.5 + 1.5 * min(max(w, 0.0), 1.0)
        up, down, ahead = rise * share, fall / share, u - w
        if width < TINY:
            tau = up if ahead > 0.0 else down
        else:
            tau = down + (up - down) * _sigmoid(ahead / width + 0.5)
        return ahead / max(TINY, tau)

    def activated(self, ctrl: float, w: float, dt: float) -> float:
        """The activation after the time dt under a constant control; a muscle's by RK4 in small steps."""
        if self.dynamics == "integrator":
            return clipped(w + dt * clipped(ctrl, self.ctrl_range), self.activation_range)
        if self.dynamics == "filter":
            u = clipped(ctrl, self.ctrl_range)
            # exact, so no dt is too long for a quick filter
            return clipped(u + (w - u) * math.exp(-dt / max(TINY, self.time[0])), self.activation_range)
        quick = max(0.5 * min(self.time[0], self.time[1] / 4.0), TINY)
        n = max(4, math.ceil(dt / (QUICK * quick))) if dt else 0
        for _ in range(n):
            h = dt / n
            k1 = self.activation_rate(ctrl, w)
            k2 = self.activation_rate(ctrl, w + 0.5 * h * k1)
            k3 = self.activation_rate(ctrl, w + 0.5 * h * k2)
            k4 = self.activation_rate(ctrl, w + h * k3)
            w += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return clipped(w, self.activation_range)


def _numbers(value: Any) -> tuple[float, ...] | None:
    """Finite numbers in a row, or a single one; None for anything else."""
    try:
        found = np.atleast_1d(real_array(value)).astype(float)
    except TypeError:
        return None
    return tuple(found.tolist()) if found.ndim == 1 and np.all(np.isfinite(found)) else None


QUICK = 0.05
"""Share of the shortest time constant that a step of a muscle's activation takes."""


def _sigmoid(x: float) -> float:
    """The polynomial of degree five that is flat at 0 and 1."""
    return 0.0 if x <= 0.0 else 1.0 if x >= 1.0 else x**3 * (3.0 * x * (2.0 * x - 5.0) + 10.0)


def clipped(value: float, to: Range | None) -> float:
    """The value, within a range where there is one."""
    return value if to is None else min(max(value, to[0]), to[1])


def actuators_given(actuators: Any) -> tuple[Actuator, ...]:
    """Actuators with names of their own, or an error."""
    found = tuple(
        listed(actuators, "actuators", 'Actuators, such as Actuator.motor("m", "q1")', kind=Actuator)
    )
    for actuator in found:
        if not isinstance(actuator, Actuator):
            raise ModelError(
                f'actuators: {shown(actuator)} is no Actuator, such as Actuator.motor("m", "q1")'
            )
    names = [a.name for a in found]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"actuators: {name!r} names {names.count(name)} of them; rename all but one")
    return found
