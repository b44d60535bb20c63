"""A motion in a few lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .trajectory import Trajectory

ROUNDED = 1e-12
"""Share of a run below which a time is told as zero: a start at a singular place passes it at once."""

SHOWN = 7
"""Names or times that are listed."""


def told(motion: Trajectory, recorded: Sequence[str]) -> str:
    """What moved, how long, what was recorded and what happened."""
    m, n = motion.mechanism, len(motion.t)
    span = f"{n} times from {motion.t[0]:g} to {motion.t[-1]:g} s" if n else "no times"
    lines = [
        f"Trajectory of {m.name!r}: {span}",
        f"  {len(m.joint_names)} joints: {_brief(m.joint_names)}; independent: {_brief(m.independent)}",
        f"  recorded: {', '.join(recorded)}",
    ]
    if motion.crossings:
        least = ROUNDED * float(motion.t[-1] - motion.t[0])
        when = [f"{c.time if abs(c.time) > least else 0.0:.4g} s" for c in motion.crossings]
        lines.append(f"  {len(when)} crossings: {_brief(when)}")
    if motion.t_events:
        counts = _brief([str(len(times)) for times in motion.t_events])
        end = "" if motion.ended_by is None else f"; the run ended at number {motion.ended_by}"
        lines.append(f"  events found: {counts}{end}")
    if motion.stats.repartitions:
        when = [f"{t:.4g} s" for t, _ in motion.stats.repartitions]
        lines.append(f"  coordinates changed at {_brief(when)}")
    return "\n".join(lines)


def _brief(words: Sequence[str]) -> str:
    """All of a few words, the first of many."""
    if len(words) <= SHOWN:
        return ", ".join(words) or "none"
    return ", ".join(words[: SHOWN - 1]) + f", … {words[-1]}"
