"""Straight-line code over floats, written by a program.

A scalar is a constant, or the name of a variable that a line of the source assigns. Sums and products
of constants are worked out at once, zeros and ones vanish, and equal expressions share a variable.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

Scalar = float | str
"""A constant, or the name of a variable, with a minus sign in front or not."""

Vector = tuple[Scalar, Scalar, Scalar]

LONGEST = 80
"""Characters up to which an expression is nested into another one."""

_TEMPORARY = re.compile(r"\bt\d+\b")


class Lines:
    """Assignments over floats: folds constants, computes equal expressions once."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, str] = {}
        self._count = 0

    def let(self, expression: str) -> str:
        """The variable that holds the expression."""
        if expression not in self.names:
            self.names[expression] = f"t{self._count}"
            self._count += 1
            self.lines.append(f"{self.names[expression]} = {expression}")
        return self.names[expression]

    def product(self, a: Scalar, b: Scalar) -> Scalar:
        """a b."""
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if isinstance(b, float):
            a, b = b, a
        if isinstance(a, float) and abs(a) in (0.0, 1.0):
            return 0.0 if a == 0.0 else b if a == 1.0 else negative(b)
        (sign_a, size_a), (sign_b, size_b) = signed(a), signed(b)
        name = self.let(f"{size_a} * {size_b}")
        return name if sign_a == sign_b else f"-{name}"

    def total(self, terms: Sequence[Scalar]) -> Scalar:
        """The sum of the terms."""
        constant = sum((term for term in terms if isinstance(term, float)), 0.0)
        names = [term for term in terms if isinstance(term, str)]
        if not names:
            return constant
        if constant:
            names.append(repr(constant))
        names.sort(key=lambda name: name[0] == "-")  # begin with a positive term
        if len(names) == 1:
            return names[0]
        if names[0][0] == "-":
            return negative(self.total([negative(name) for name in names]))
        return self.let(names[0] + "".join(f" - {n[1:]}" if n[0] == "-" else f" + {n}" for n in names[1:]))

    def dot(self, a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
        """Σ a_i b_i."""
        return self.total([self.product(x, y) for x, y in zip(a, b, strict=True)])

    def add(self, *vectors: Vector) -> Vector:
        """The sum of the vectors."""
        x, y, z = (self.total(entries) for entries in zip(*vectors, strict=True))
        return x, y, z

    def times(self, s: Scalar, a: Vector) -> Vector:
        """s a."""
        return self.product(s, a[0]), self.product(s, a[1]), self.product(s, a[2])

    def cross(self, a: Vector, b: Vector) -> Vector:
        """a × b."""
        return self.cross_entry(a, b, 0), self.cross_entry(a, b, 1), self.cross_entry(a, b, 2)

    def cross_entry(self, a: Vector, b: Vector, r: int) -> Scalar:
        """One entry of a × b."""
        s, t = (r + 1) % 3, (r + 2) % 3
        return self.total([self.product(a[s], b[t]), negative(self.product(a[t], b[s]))])


def nested(lines: list[str]) -> list[str]:
    """The lines without variables that nobody reads, and with those read once put where they are read."""
    kept: list[str] = []
    reads: Counter[str] = Counter()
    for line in reversed(lines):
        name, _, expression = line.strip().partition(" = ")
        if not _TEMPORARY.fullmatch(name) or reads[name]:
            reads.update(_TEMPORARY.findall(expression if _TEMPORARY.fullmatch(name) else line))
            kept.append(line)
    result, inner = [], dict[str, str]()
    for line in reversed(kept):
        line = _TEMPORARY.sub(lambda match: inner.get(match[0], match[0]), line)
        name, _, expression = line.strip().partition(" = ")
        if reads[name] == 1 and len(expression) < LONGEST:
            inner[name] = f"({expression})"
        else:
            result.append(line)
    return result


def negative(a: Scalar) -> Scalar:
    """−a."""
    if isinstance(a, float):
        return -a
    return a[1:] if a[0] == "-" else f"-{a}"


def signed(a: Scalar) -> tuple[bool, str]:
    """Whether a is negative by its sign, and what stands behind the sign."""
    name = text(a)
    return (True, name[1:]) if name[0] == "-" else (False, name)


def text(a: Scalar) -> str:
    """The scalar as it stands in the source."""
    return repr(a) if isinstance(a, float) else a
