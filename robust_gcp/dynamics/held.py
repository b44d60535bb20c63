"""A torque that is held over steps."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .equations import CheckedTorque, Torque, TorqueFunction, torque_function


class HeldTorque(TorqueFunction):
    """A torque that stays what it was set to.

    Attributes
    ----------
    value : ndarray (nv,)
    asked : callable (t, q, v) or None
        Where the next one comes from.
    """

    def __init__(self, value: Array) -> None:
        super().__init__(lambda t, q, v: self.value, len(value))
        self.value = value
        self.asked: CheckedTorque | None = None

    @classmethod
    def of(cls, mechanism: Mechanism, torque: Torque | ArrayLike | None) -> HeldTorque | None:
        """What a function of the user's says once a step; None where there is none."""
        if not callable(torque):
            return None
        held = cls(mechanism.tree.zero)
        held.asked = torque_function(mechanism, torque)
        return held

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """The torque held, whatever the state."""
        return self.value

    def __deepcopy__(self, memo: object) -> HeldTorque:
        """Itself: what is held is set anew with each step."""
        return self
