"""What happens where one phase of smooth motion ends and another begins."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Happening:
    """What happened where one phase of smooth motion ended and another began.

    Attributes
    ----------
    time : float
        s.
    kind : str
        "impact", "grazing" (an impact where the stop is at a dead point of its joint: its outcome depends on
        the stop's place without bound), "hold" (rows that rest from now on), "release", "at rest" (slipping
        came to an end), "lock" (moving parts were stopped), "touch", "leave" (springy stops).
    joints : tuple of str
    loss : float
        Energy lost at this instant, J.
    """

    time: float
    kind: str
    joints: tuple[str, ...]
    loss: float = 0.0
