"""Numbers that write down how they come about, as straight-line C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Tape:
    """What was computed, each thing once."""

    lines: list[tuple[str, str, tuple[str, ...]]] = field(default_factory=list)
    known: dict[tuple[str, ...], Traced] = field(default_factory=dict)

    def given(self, name: str) -> Traced:
        """A number that comes from outside."""
        return Traced(self, None, name)

    def constant(self, value: float) -> Traced:
        """One that is known."""
        return Traced(self, float(value), "")

    def made(self, form: str, *parts: Traced, commutes: bool = False) -> Traced:
        """One that is computed from others by a form with places {0}, {1}."""
        texts = [part.text for part in parts]
        key = (form, *(sorted(texts) if commutes else texts))  # a + b and b + a round alike
        if key not in self.known:
            made = self.known[key] = Traced(self, None, f"t{len(self.known)}")
            self.lines.append((made.name, form.format(*texts), tuple(texts)))
        return self.known[key]

    def written(self, outputs: dict[str, Traced]) -> str:
        """The lines that outputs need, and the outputs."""
        needed, body = {number.text for number in outputs.values()}, list[str]()
        for name, text, parts in reversed(self.lines):
            # an output, or a part of one: backwards, so that each is known before its parts
            if name in needed:
                needed.update(parts)
                body.append(f"    const real {name} = {text};")
        body.reverse()
        body += [f"    {place} = {number.text};" for place, number in outputs.items()]
        return "\n".join(body)


@dataclass(frozen=True, eq=False)
class Traced:
    """A number that is known, or has a name."""

    tape: Tape
    value: float | None
    name: str

    @property
    def text(self) -> str:
        """As C."""
        return self.name if self.value is None else f"fixed({self.value!r})"  # all digits

    def _with(self, other: Traced | float) -> Traced:
        return other if isinstance(other, Traced) else self.tape.constant(other)

    def __neg__(self) -> Traced:
        return self.tape.constant(-self.value) if self.value is not None else self.tape.made("-{0}", self)

    def __add__(self, given: Traced | float) -> Traced:
        other = self._with(given)
        if self.value is not None and other.value is not None:
            return self.tape.constant(self.value + other.value)
        if self.value == 0.0 or other.value == 0.0:
            return other if self.value == 0.0 else self
        return self.tape.made("{0} + {1}", self, other, commutes=True)

    def __sub__(self, given: Traced | float) -> Traced:
        other = self._with(given)
        if self.value is not None and other.value is not None:
            return self.tape.constant(self.value - other.value)
        if other.value == 0.0:
            return self
        return -other if self.value == 0.0 else self.tape.made("{0} - {1}", self, other)

    def __mul__(self, given: Traced | float) -> Traced:
        other = self._with(given)
        if self.value is not None and other.value is not None:
            return self.tape.constant(self.value * other.value)
        for one, more in ((self, other), (other, self)):
            if one.value == 0.0:  # zero by construction, whatever the other is
                return one
            if one.value == 1.0:
                return more
            if one.value == -1.0:
                return -more
        return self.tape.made("{0} * {1}", self, other, commutes=True)

    def __truediv__(self, given: Traced | float) -> Traced:
        other = self._with(given)
        if self.value == 0.0 or other.value == 1.0:
            return self
        if self.value is not None and other.value is not None:
            return self.tape.constant(self.value / other.value)
        return self.tape.made("{0} / {1}", self, other)

    def __radd__(self, other: float) -> Traced:
        return self + other

    def __rmul__(self, other: float) -> Traced:
        return self * other

    def absolute(self) -> Traced:
        """|x|."""
        if self.value is not None:
            return self.tape.constant(abs(self.value))
        return self.tape.made("absolute({0})", self)

    def or_larger(self, other: Traced) -> Traced:
        """max(x, y); not NaN where that is y."""
        return self.tape.made("larger({0}, {1})", self, other)

    def or_smaller(self, other: Traced) -> Traced:
        """min(x, y)."""
        return self.tape.made("smaller({0}, {1})", self, other)

    def root(self) -> Traced:
        """√x of what is not negative."""
        return self.tape.made("root({0})", self)


Vector = list[Traced]


def dot(a: Sequence[Traced], b: Sequence[Traced]) -> Traced:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Traced], b: Sequence[Traced]) -> Vector:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(*vectors: Sequence[Traced]) -> Vector:
    """Their sum."""
    found = list(vectors[0])
    for vector in vectors[1:]:
        found = [a + b for a, b in zip(found, vector, strict=True)]
    return found


def times(s: Traced | float, v: Sequence[Traced]) -> Vector:
    """s v."""
    return [x * s for x in v]


def within(x: Traced, low: float, high: float) -> Traced:
    """x, or the end of a range."""
    if low > -np.inf:
        x = x.or_larger(x.tape.constant(low))
    return x if high == np.inf else x.or_smaller(x.tape.constant(high))


def total(numbers: Sequence[Traced]) -> Any:
    """Their sum; 0.0 of none."""
    found: Any = 0.0
    for number in numbers:
        found = number + found
    return found
