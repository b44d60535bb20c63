"""Sliders of a live view: independent joints are dragged, and the mechanism follows along its mode."""

from __future__ import annotations

import json

import numpy as np
import umsgpack  # type: ignore[import-untyped, import-not-found, unused-ignore]

from ...dynamics.problem import Problem, initial_value_problem
from ...errors import SimulationError, ToggleError
from ...maps.choice import MapChoice
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import in_v
from ...mechanism.tree.tree import Array

STRIDE = 0.02
"""Largest step of continuation, rad or characteristic lengths."""

FARTHEST = 2.0 * np.pi
"""What a slider spans to either side, in the same units."""

LONGEST = 200
"""Characters of a message from a page."""

NOTICE = "notice"


class Sliders:
    """The numbers that a page may set, and the configuration that they lead to.

    Each moves by continuation along the mode of the configuration before, in small steps; where one can go no
    further it stops, and says why.

    Parameters
    ----------
    mechanism : Mechanism
    q : ndarray (nq,)
        A closed configuration.

    Attributes
    ----------
    q : ndarray (nq,)
        Where the mechanism is.
    """

    def __init__(self, mechanism: Mechanism, q: Array) -> None:
        # a mechanism of its own: pages are served from another thread
        self._mechanism = mechanism.with_independent(mechanism.independent)
        named = in_v(mechanism.joints)
        self._inputs = {named[mechanism.iv_independent[k]].name: int(k) for k in mechanism.numbers}
        self._units = mechanism.units[mechanism.iv_independent]
        self._told: set[str] = set()  # notices that some page may show
        self.place(q)

    def place(self, q: Array) -> None:
        """Go on from this configuration."""
        self.q, self._why = q, ""
        self._motion: Problem | None = None
        try:
            self._motion = initial_value_problem(self._mechanism, q, choice=MapChoice(error_controlled=True))
        except SimulationError as error:
            self._why = f"{type(error).__name__}: no mode to follow here"

    def value(self, name: str) -> float:
        """What a slider shows."""
        mechanism = self._mechanism
        return float(self.q[mechanism.iq_numbers[mechanism.numbers.tolist().index(self._inputs[name])]])

    def controls(self) -> list[bytes]:
        """Build the sliders, in meshcat's wire format."""
        made = []
        for name, k in self._inputs.items():
            send = f"this.connection.send(JSON.stringify({{name: {json.dumps(name)}, value: value}}))"
            send = f"(this.gui.open(), (value) => {send})"  # meshcat's panel is closed at first
            at, reach = self.value(name), FARTHEST * float(self._units[k])
            limits = {"min": at - reach, "max": at + reach, "step": reach / 1000.0}
            made.append({"type": "set_control", "name": name, "callback": send, "value": at, **limits})
        return [umsgpack.packb(command) for command in made]

    def heard(self, message: str | bytes) -> tuple[str, float] | None:
        """The slider and the number that a page sent; None for anything else."""
        if not isinstance(message, str) or len(message) > LONGEST:
            return None
        try:
            given = json.loads(message)
        except (ValueError, RecursionError):
            return None
        if not isinstance(given, dict) or set(given) != {"name", "value"}:
            return None
        name, value = given["name"], given["value"]
        # abs: json reads NaN and Infinity, and integers without end
        number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e6
        return (name, float(value)) if isinstance(name, str) and name in self._inputs and number else None

    def move(self, name: str, value: float) -> str:
        """Follow the mode until this number is reached; why not, where that ends before it, else nothing."""
        if self._motion is None:
            return self._why
        explicit, k = self._motion.explicit, self._inputs[name]
        start = explicit.anchor.y.copy()
        steps = max(1, int(np.ceil(abs(value - start[k]) / (STRIDE * self._units[k]))))
        for i in range(1, steps + 1):
            y = start.copy()
            y[k] += i / steps * (value - start[k])
            try:
                self.q = explicit.point_at(y, np.zeros(len(y))).q.copy()
            except SimulationError as error:
                self.place(self.q)  # the map may have gone on towards the dead point
                return f"{name}: a dead point" if isinstance(error, ToggleError) else f"{name}: no further"
        return ""

    def answer(self, name: str, why: str) -> dict[str, bytes]:
        """What the page is to show after a move: the notice that holds, and the slider where it stopped."""
        commands: list[dict[str, object]] = [
            {"type": "delete_control", "name": told} for told in self._told - {why}
        ]
        if why:
            self._told.add(why)
            commands.append({"type": "set_control", "name": why, "callback": "() => {}"})
            value = self.value(name)
            commands.append(
                {"type": "set_control_value", "name": name, "value": value, "invoke_callback": False}
            )
        return {f"{NOTICE}{i}": umsgpack.packb(command) for i, command in enumerate(commands)}
