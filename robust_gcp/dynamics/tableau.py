"""Explicit Runge–Kutta methods given by their tableau."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..checks import shown
from ..errors import OptionError
from ..mechanism.tree.tree import Array

CONSISTENT = 1e-12
"""Largest difference of Σ b from 1: coefficients written with as many digits as a float holds."""


@dataclass(frozen=True)
class Tableau:
    """An explicit Runge–Kutta method with s stages and a fixed step.

    k_i = f(t + c_i h, x + h Σ_j a_ij k_j), x ← x + h Σ_i b_i k_i.

    Parameters
    ----------
    a : tuple of tuples of float
        Rows 2 to s of the strictly lower triangular part: one number, two, …, s − 1. c_i is the sum of row i.
    b : tuple of float
        s weights with sum 1.

    Raises
    ------
    OptionError
        Where these are no such numbers.

    References
    ----------
    Hairer, Nørsett, Wanner, *Solving Ordinary Differential Equations I*, 1993, section II.1.
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]

    def __post_init__(self) -> None:
        try:
            sizes = [len(row) for row in self.a]
            numbers = np.array([*(x for row in self.a for x in row), *self.b], dtype=float)
        except Exception as error:  # whatever an object of the user's raises when it is read
            raise OptionError(
                f"Tableau: a = {shown(self.a)} and b = {shown(self.b)} must be rows of numbers and numbers"
            ) from error
        if sizes != list(range(1, len(self.b))):
            raise OptionError(
                f"Tableau: {len(self.b)} weights b need rows a of 1, 2, …, {len(self.b) - 1} numbers (an "
                f"explicit method), not of {', '.join(map(str, sizes)) or 'none'}"
            )
        total = float(sum(self.b))
        if not np.all(np.isfinite(numbers)) or abs(total - 1.0) > CONSISTENT:
            raise OptionError(f"Tableau: the weights b must be finite and have the sum 1, not {total:.17g}")

    @property
    def c(self) -> tuple[float, ...]:
        """When the stages are, as shares of the step."""
        return (0.0, *(float(sum(row)) for row in self.a))

    def step(self, f: Callable[[float, Array], Array], t: float, x: Array, h: float, k1: Array) -> Array:
        """The state at t + h; the arguments are those of `steppers.rk4_step`."""
        k = [k1]
        for c, row in zip(self.c[1:], self.a, strict=True):
            k.append(f(t + c * h, x + h * _sum(row, k)))
        return np.asarray(x + h * _sum(self.b, k))


def _sum(weights: tuple[float, ...], k: list[Array]) -> Array:
    total = np.zeros_like(k[0])
    for weight, slope in zip(weights, k, strict=True):
        if weight != 0.0:
            total += weight * slope
    return total
