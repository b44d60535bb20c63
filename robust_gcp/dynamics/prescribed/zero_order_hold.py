"""A torque, and controls of actuators, that are held over steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...mechanism.actuation.actuators import clipped
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..equations import CheckedTorque, Torque, TorqueFunction, torque_function
from .control import Controls, asked_of, controls_given

Span = tuple[float, float]

ROWS_HELD = 4
"""Of u in what is held, where there are activations."""


class HeldTorque(TorqueFunction):
    """A torque that stays what it was set to, and what actuators do under controls that stay.

    `value` is all that is held as one row of numbers: τ (nv,); of mechanisms with actuators then u as the
    compiled kernel reads it, at the start, the middle and the end of a step and once more where there are
    activations, else once; the controls; the activations at the start; and when that is, s. Controls that are
    NaN leave the actuators without power.

    Attributes
    ----------
    value : ndarray
    asked : callable (t, q, v) -> ndarray, or None
        Where the next one comes from.
    start : ndarray (n,)
        Activations where nothing was held before.
    stride : int
        Numbers of u at one time where it changes, else 0.
    """

    asks = False

    def __init__(self, mechanism: Mechanism, value: Array | None = None) -> None:
        super().__init__(lambda t, q, v: self(t, q, v), mechanism.nv)
        self._mechanism = mechanism
        self._actuators, self._actuation, self._size = mechanism.actuators, mechanism.actuation, mechanism.nv
        n = len(self._actuators)
        self.start = np.array([actuator.activation for actuator in self._actuators])
        self.value: Array = np.zeros(0)
        self.stride = n if any(a.dynamics != "none" for a in self._actuators) else 0
        self.value = self.row(mechanism.tree.zero, None, (0.0, 0.0)) if value is None else value
        self.asked: CheckedTorque | None = None

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        torque: Torque | ArrayLike | None,
        ctrl: Controls | None = None,
        times: Array | None = None,
    ) -> HeldTorque | None:
        """What functions of the user's say once a step; None where there are none.

        Parameters
        ----------
        ctrl : mapping or array_like, optional
            Controls of actuators, see `controls_given`.
        times : ndarray, optional
            Of the steps' ends.
        """
        if ctrl is None and not callable(torque):
            return None
        held = cls(mechanism)
        function = torque_function(mechanism, torque)
        given = () if ctrl is None else controls_given(mechanism, ctrl)
        pairs = zip(mechanism.actuators if given else (), given, strict=True)
        parts = [asked_of(*pair) for pair in pairs]

        def asked(t: float, q: Array, v: Array) -> Array:
            tau = mechanism.tree.zero if function is None else function(t, q, v)
            if not parts or times is None:
                return held.row(tau, None, (t, t))
            after = times[min(int(np.searchsorted(times, t, side="right")), len(times) - 1)]
            return held.row(tau, [part(t, q, v) for part in parts], (t, float(after)))

        held.asked = asked
        return held

    def row(self, tau: Array, controls: ArrayLike | None, span: Span, active: Array | None = None) -> Array:
        """A value to hold over a step, with the activations that the value before it leads to.

        Parameters
        ----------
        controls : sequence of float, optional
            NaN: those of the value before.
        span : (float, float)
            When the step begins and ends, s.
        active : ndarray (n,), optional
            Activations, where they are not those that the value before leads to.
        """
        if not self._actuators:
            return tau
        t0, t1 = span
        ctrl = np.full(len(self._actuators), np.nan) if controls is None else np.array(controls, dtype=float)
        w = self.activations(t0) if active is None else active  # they go on, whatever is held anew
        times = (t0, 0.5 * (t0 + t1), t1, t1) if self.stride else (t0,)
        u = [self._driven(ctrl, w, t - t0) for t in times]
        return np.concatenate([tau, *u, ctrl, w, [t0 if self.stride else 0.0]])

    def spanning(self, span: Span | None, more: Array) -> HeldTorque:
        """The same with another torque (nv,) beside it, and from a time within the step on."""
        value = self.beside(self.value, more)
        if span is not None and self.stride:
            value = self.row(value[: self._size], self.powered, span)
        return HeldTorque(self._mechanism, value)

    def beside(self, value: Array, more: Array) -> Array:
        """Such a value with another torque (nv,) beside it."""
        return np.concatenate([value[: self._size] + more, value[self._size :]])

    def now(self, t: float) -> Array | None:
        """u at a time in the step, (1, n); None without power."""
        return None if self.powered is None else self.u(t)[None]

    def _driven(self, ctrl: Array, w: Array, dt: float) -> Array:
        """u after the time dt under controls, from activations w on."""
        if np.isnan(ctrl[0]):
            return np.full(len(ctrl), np.nan)
        parts = zip(self._actuators, ctrl.tolist(), w.tolist(), strict=True)
        return np.array(
            [clipped(c, a.ctrl_range) if a.dynamics == "none" else a.activated(c, w, dt) for a, c, w in parts]
        )

    @property
    def controls(self) -> Array:
        """The controls that are held, (n,), NaN without power."""
        n = len(self._actuators)
        return self.value[-2 * n - 1 : -n - 1]

    @property
    def powered(self) -> Array | None:
        """The controls; None without power."""
        powered = len(self.value) > self._size and not np.isnan(self.controls[0])
        return self.controls.copy() if powered else None

    def activations(self, t: float) -> Array:
        """Activations at a time in the step, (n,); without meaning for actuators without."""
        n = len(self._actuators)
        if not len(self.value) or not self.stride:
            return self.start
        w, begun = self.value[-n - 1 : -1], float(self.value[-1])
        return w if np.isnan(self.controls[0]) else self._driven(self.controls, w, t - begun)

    def u(self, t: float) -> Array:
        """u at a time in the step, (n,)."""
        return self._u(self.value, t)

    def _u(self, value: Array, t: float) -> Array:
        """u at a time in the step that a value is held over, (n,)."""
        n = len(self._actuators)
        return self._driven(value[-2 * n - 1 : -n - 1], value[-n - 1 : -1], t - float(value[-1]))

    def driven(self, rows: Array, t: Array) -> Array | None:
        """u at outputs (N,), of the values (N, …) held there: (N, n). None where there never was power."""
        n = len(self._actuators)
        u = rows[:, self._size : self._size + n].copy()
        if not n or not len(t) or rows.shape[1] == self._size or np.all(np.isnan(u)):
            return None
        for k in np.flatnonzero(t != rows[:, -1]) if self.stride else ():  # within steps
            u[k] = self._u(rows[k], t[k])
        return u

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """τ (nv,), whatever the state, and that of the actuators."""
        tau = self.value[: self._size]
        if self._actuation is None or self.powered is None:
            return tau
        return tau + self._actuation.forces_at(q, v, self.u(t))[1]

    @property
    def native(self) -> TorqueFunction:
        """What the compiled kernel takes: itself, or a function where it does not know paths of actuators."""
        known = all(actuator.along.in_kernel for actuator in self._actuators)
        return self if known else TorqueFunction(lambda t, q, v: self(t, q, v), self._size)

    def __deepcopy__(self, memo: object) -> HeldTorque:
        """Itself: what is held is set anew with each step."""
        return self
