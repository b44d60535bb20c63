"""Names for what a file leaves without one."""

from __future__ import annotations

from collections.abc import Container, Sequence

RESERVED = ("universe", "world")
"""The ground's: nothing else of an MJCF is called so."""


def unlike(name: str, taken: Container[str], first: int = 1, join: str = "") -> str:
    """The name, numbered where it is taken."""
    label, count = name, first
    while label in taken:
        label, count = f"{name}{join}{count}", count + 1
    return label


def all_named(given: Sequence[str], wanted: Sequence[str], first: int = 1, join: str = "") -> list[str]:
    """The names that are given; in place of empty ones the wanted ones, numbered where they are taken."""
    taken, made = set(given), []
    for name, other in zip(given, wanted, strict=True):
        made.append(name or unlike(other, taken, first, join))
        taken.add(made[-1])
    return made
