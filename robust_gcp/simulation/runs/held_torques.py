"""What was held over which steps of a run, for steps that are taken once more and for its trajectory."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...mechanism.tree.tree import Array


class HeldTorques:
    """The values of a `HeldTorque`, each from the step on at which it was set.

    Parameters
    ----------
    now : HeldTorque
        What the equations of motion ask; it holds the first value.

    Attributes
    ----------
    bits : bytes
        Of the value set last, by which another one is told at little cost.
    """

    def __init__(self, now: HeldTorque) -> None:
        self.now = now
        self.restart(now.value)

    def restart(self, value: Array) -> None:
        """Hold a value from the start on, and nothing else before."""
        self._since, self._values = [0], [value]
        self.now.value, self.bits = value, value.tobytes()  # bits: NaN, no power, equals itself there

    def hold(self, i: int, value: Array, bits: bytes) -> None:
        """Hold a value from time i on."""
        self._since.append(i)
        self._values.append(value)
        self.now.value, self.bits = value, bits

    def on(self, i: int) -> Array:
        """What is held from time i on."""
        return self._values[bisect_right(self._since, i) - 1]

    def along(self, steps: NDArray[np.intp]) -> Array:
        """What was held on each of these steps, (len(steps), …)."""
        return np.array(self._values)[np.searchsorted(self._since, steps, side="right") - 1]

    def changes_after(self, i: int) -> bool:
        """Whether another value was set after time i: the steps from there on are taken once more."""
        return self._since[-1] > i

    def forget(self, n: int) -> None:
        """Number the times from the n-th on."""
        first = bisect_right(self._since, n) - 1
        self._since = [max(0, i - n) for i in self._since[first:]]  # the first was set before, and still acts
        self._values = self._values[first:]

    def resume(self) -> None:
        """Hold what was set last, where the run was put back."""
        self.now.value = self._values[-1]
