"""A number with its first and second rate: how a function of time is differentiated to full precision.

f(t) is evaluated on a jet (t, 1, 0); sums, products, powers and NumPy's elementary functions carry the rates
along by the chain rule, so that they come out as exact as f itself. What takes plain numbers only, such as
`math.sin`, raises a TypeError: a jet is never turned into a number, which would lose its rates silently.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Rule = Callable[[float], tuple[float, float, float]]
"""f, f' and f'' at a number."""


class Jet:
    """x, ẋ and ẍ.

    Attributes
    ----------
    x, rate, bend : float, or ndarray
        Arrays for many numbers at once, which can be compared with none.
    """

    __slots__ = ("bend", "rate", "x")

    def __init__(self, x: float, rate: float = 0.0, bend: float = 0.0) -> None:
        self.x, self.rate, self.bend = x, rate, bend

    def through(self, rule: Rule) -> Jet:
        """f(x): f' ẋ is its first rate, f'' ẋ² + f' ẍ its second."""
        value, slope, curve = rule(self.x)
        return Jet(value, slope * self.rate, curve * self.rate * self.rate + slope * self.bend)

    def __add__(self, other: Any) -> Jet:
        o = _jet(other)
        return NotImplemented if o is None else Jet(self.x + o.x, self.rate + o.rate, self.bend + o.bend)

    def __mul__(self, other: Any) -> Jet:
        o = _jet(other)
        if o is None:
            return NotImplemented
        bend = self.bend * o.x + 2.0 * self.rate * o.rate + self.x * o.bend
        return Jet(self.x * o.x, self.rate * o.x + self.x * o.rate, bend)

    def __neg__(self) -> Jet:
        return Jet(-self.x, -self.rate, -self.bend)

    def __pos__(self) -> Jet:
        return self

    def __abs__(self) -> Jet:
        return -self if self.x < 0.0 else self  # a kink at 0, where the rate is the right one's

    def __sub__(self, other: Any) -> Jet:
        o = _jet(other)
        return NotImplemented if o is None else self + -o

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __truediv__(self, other: Any) -> Jet:
        o = _jet(other)
        return NotImplemented if o is None else self * o.through(_RULES["reciprocal"])

    def __rtruediv__(self, other: Any) -> Jet:
        return self.through(_RULES["reciprocal"]) * other

    def __pow__(self, other: Any) -> Jet:
        o = _jet(other)
        if o is None:
            return NotImplemented
        if o.rate == 0.0 == o.bend:  # a constant power: of negative numbers too, where log has no value
            n = o.x
            slope = n * self.x ** (n - 1.0) if n != 0.0 else 0.0
            curve = n * (n - 1.0) * self.x ** (n - 2.0) if n not in (0.0, 1.0) else 0.0
            return self.through(lambda x: (x**n, slope, curve))
        return (o * self.through(_RULES["log"])).through(_RULES["exp"])

    def __rpow__(self, other: Any) -> Jet:
        return Jet(float(other)) ** self

    def __mod__(self, other: Any) -> Jet:
        return Jet(self.x % float(other), self.rate, self.bend)

    __radd__, __rmul__ = __add__, __mul__

    def __lt__(self, other: Any) -> bool:
        return bool(self.x < _value(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.x <= _value(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.x > _value(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.x >= _value(other))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions of one number, its operators, and comparisons."""
        if method != "__call__" or options:
            return NotImplemented
        name = ufunc.__name__
        if name in _RULES and len(inputs) == 1:
            return inputs[0].through(_RULES[name])
        operator = _OPERATORS.get(name)
        parts = [_jet(value) for value in inputs]
        if operator is None or None in parts:
            return NotImplemented
        return operator(*parts)


def rates(f: Callable[[Any], Any], t: Any) -> tuple[float, float, float]:
    """f, ḟ and f̈ at t, or at each of an array.

    Raises
    ------
    TypeError
        Where f asks for a plain number, or returns none.
    """
    value = f(Jet(np.float64(t) if np.ndim(t) == 0 else t, 1.0))  # which divides by zero as arrays do
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()  # what np.where makes of jets
    jet = _jet(value)
    if jet is None:
        raise TypeError("no number")
    return jet.x, jet.rate, jet.bend


def _jet(value: Any) -> Jet | None:
    """The value as a jet, constant unless it is one; None where it is no number."""
    if isinstance(value, Jet):
        return value
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return Jet(float(value)) if real else None


def _value(value: Any) -> float:
    return float(value.x if isinstance(value, Jet) else value)


def _sqrt(x: float) -> tuple[float, float, float]:
    root = np.sqrt(x)
    return root, 0.5 / root, -0.25 / (root * x)


def _tan(x: float) -> tuple[float, float, float]:
    tan = np.tan(x)
    return tan, 1.0 + tan * tan, 2.0 * tan * (1.0 + tan * tan)


def _tanh(x: float) -> tuple[float, float, float]:
    tanh = np.tanh(x)
    return tanh, 1.0 - tanh * tanh, -2.0 * tanh * (1.0 - tanh * tanh)


def _arcsin(x: float) -> tuple[float, float, float]:
    slope = 1.0 / np.sqrt(1.0 - x * x)
    return np.arcsin(x), slope, x * slope**3


def _arccos(x: float) -> tuple[float, float, float]:
    value, slope, curve = _arcsin(x)
    return 0.5 * np.pi - value, -slope, -curve


_RULES: dict[str, Rule] = {
    "sin": lambda x: (np.sin(x), np.cos(x), -np.sin(x)),
    "cos": lambda x: (np.cos(x), -np.sin(x), -np.cos(x)),
    "tan": _tan,
    "exp": lambda x: (np.exp(x), np.exp(x), np.exp(x)),
    "expm1": lambda x: (np.expm1(x), np.exp(x), np.exp(x)),
    "log": lambda x: (np.log(x), 1.0 / x, -1.0 / x**2),
    "log1p": lambda x: (np.log1p(x), 1.0 / (1.0 + x), -1.0 / (1.0 + x) ** 2),
    "sqrt": _sqrt,
    "square": lambda x: (x * x, 2.0 * x, 2.0),
    "reciprocal": lambda x: (1.0 / x, -1.0 / x**2, 2.0 / x**3),
    "sinh": lambda x: (np.sinh(x), np.cosh(x), np.sinh(x)),
    "cosh": lambda x: (np.cosh(x), np.sinh(x), np.cosh(x)),
    "tanh": _tanh,
    "arcsin": _arcsin,
    "arccos": _arccos,
    "arctan": lambda x: (np.arctan(x), 1.0 / (1.0 + x * x), -2.0 * x / (1.0 + x * x) ** 2),
    "deg2rad": lambda x: (np.deg2rad(x), np.pi / 180.0, 0.0),
    "radians": lambda x: (np.radians(x), np.pi / 180.0, 0.0),
    "floor": lambda x: (np.floor(x), 0.0, 0.0),
    "sign": lambda x: (np.sign(x), 0.0, 0.0),
}
"""By NumPy's names."""

_OPERATORS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "power": lambda a, b: a**b,
    "float_power": lambda a, b: a**b,
    "remainder": lambda a, b: a % b.x,
    "negative": lambda a: -a,
    "positive": lambda a: a,
    "absolute": abs,
    "minimum": lambda a, b: a if a <= b else b,
    "maximum": lambda a, b: a if a >= b else b,
    "less": lambda a, b: a < b,
    "less_equal": lambda a, b: a <= b,
    "greater": lambda a, b: a > b,
    "greater_equal": lambda a, b: a >= b,
}
