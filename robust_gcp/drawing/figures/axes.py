"""The torus of joint angles on flat axes: where it is cut open, and curves broken there."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...analysis.configuration_space import ConfigurationSpace, ModeCurve
from ...mechanism.tree.joints import Component
from ...mechanism.tree.tree import Array

CUT = np.pi / 4.0
"""Distance of a singular point from where the torus is cut open that is enough, rad."""

TANGENT = 0.3
"""Half length of the tangents at a singular point, as a share of π (rad) or of half the range (m)."""

EIGHTH = np.pi / 4.0
"""Grid of the limits of a revolute joint that does not turn fully, rad."""


class TorusAxis:
    """One coordinate: where it is cut open, its limits and its ticks.

    Parameters
    ----------
    others : sequence of TorusAxis
        Chosen before; where it does no harm, this one is cut where they are.
    """

    def __init__(self, space: ConfigurationSpace, entry: Component, others: Sequence[TorusAxis]) -> None:
        self.name, self.iq, self.iv = entry.name, entry.iq, entry.iv
        self.turns = entry.periodic
        self.label = f"{entry.name} [{entry.unit}]"
        if self.turns:
            self._cut(space, others)
        else:
            values = np.concatenate([mode.q[:, entry.iq] for mode in space.modes])
            margin = 0.05 * float(np.ptp(values)) or 1.0
            self.low, self.high = float(values.min()) - margin, float(values.max()) + margin
        self.tangent = TANGENT * (np.pi if self.turns else 0.5 * (self.high - self.low))

    def _cut(self, space: ConfigurationSpace, others: Sequence[TorusAxis]) -> None:
        """Choose low: away from singular points and resting joints, with few breaks, best at −π."""
        still = [float(m.q[0, self.iq]) for m in space.modes if np.ptp(m.q[:, self.iq]) < 1e-9]
        places = np.array([*(p.q[self.iq] for p in space.singular_points), *still])

        def merit(cut: float) -> tuple[float, int]:
            away = np.abs((places - cut + np.pi) % (2.0 * np.pi) - np.pi).min(initial=CUT)
            self.low, self.high = cut, cut + 2.0 * np.pi
            pieces = sum(len(segments(mode, [*others, self])) for mode in space.modes)
            return round(float(away), 6), -pieces

        # −π first: `max` keeps the first of equals
        best = max((-0.25 * np.pi * k for k in (4, 2, 6, 3, 5, 1, 7)), key=merit)
        merit(best)  # takes low and high back from the last one that was tried
        seen = np.concatenate([self.wrapped(mode.q[:, self.iq]) for mode in space.modes])
        if np.ptp(seen) < np.pi:  # a rocker: no need to show where it never is
            self.low = EIGHTH * np.floor((seen.min() - 0.2) / EIGHTH)
            self.high = EIGHTH * np.ceil((seen.max() + 0.2) / EIGHTH)

    def wrapped(self, values: Any) -> Any:
        """Values between low and high."""
        if not self.turns:
            return values
        return self.low + (values - self.low) % (2.0 * np.pi)

    def dress(self, axis: Any, ends: bool = True) -> None:
        """Label, limits and ticks in multiples of π/2 or, where these are few, of π/4.

        Without those at the ends where they would collide.
        """
        axis.axes.set(**{f"{axis.axis_name}lim": (self.low, self.high)})
        axis.set_label_text(self.label)
        if not self.turns:
            return
        room = 1e-9 if ends else -1e-9
        eighths: list[int] = []
        for unit in (2, 1):
            first = int(np.ceil(self.low / (unit * EIGHTH) - room))
            last = int(np.floor(self.high / (unit * EIGHTH) + room))
            eighths = [unit * k for k in range(first, last + 1)]
            if len(eighths) > 2:
                break
        axis.set_ticks([k * EIGHTH for k in eighths])
        axis.set_ticklabels([_multiple_of_pi(Fraction(k, 4)) for k in eighths])


def _multiple_of_pi(share: Fraction) -> str:
    """share · π, in words."""
    if share == 0:
        return "0"
    sign, size = "−" if share < 0 else "", abs(share)
    over = "" if size.denominator == 1 else f"/{size.denominator}"
    return f"{sign}{size.numerator if size.numerator > 1 else ''}π{over}"


def segments(mode: ModeCurve, axes: Sequence[TorusAxis]) -> list[Array]:
    """The curve over the axes, (n, d) each, broken where it leaves the cut-open torus.

    A break is repeated on both sides, one row outside, so that the line reaches the border.
    """
    columns = np.array([a.wrapped(mode.q[:, a.iq]) for a in axes])
    sheets = np.round(np.array([mode.q[:, a.iq] for a in axes]) - columns, 6)  # whole turns but for rounding
    breaks = np.flatnonzero(np.any(np.diff(sheets, axis=1) != 0.0, axis=0)) + 1
    parts = []
    for rows in np.split(np.arange(len(mode.q)), breaks):
        around = np.arange(max(rows[0] - 1, 0), min(rows[-1] + 2, len(mode.q)))
        parts.append(np.array([mode.q[around, a.iq] for a in axes]).T - sheets[:, rows[0]])
    return parts
