"""Data of a traced configuration space: modes as curves, where they meet, and what hangs together."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .local import LocalAnalysis


@dataclass
class Curve:
    """A mode while it is traced.

    Attributes
    ----------
    q, tangents : list of ndarray
        Configurations (nq,) and dimensionless unit tangents (nv,).
    passes : list of (int, int, int)
        Row, number of the singular point, number of the tangent among its modes.
    closed : bool
    stop : str
        Why an open curve ends where it ends.
    corank : int
        Ranks that K lacks all along it: modes that lie in the singular set are followed too.
    """

    q: list[Array] = field(default_factory=list)
    tangents: list[Array] = field(default_factory=list)
    passes: list[tuple[int, int, int]] = field(default_factory=list)
    closed: bool = False
    stop: str = ""
    corank: int = 0


@dataclass(frozen=True)
class Visit:
    """Where a mode passes a singular point.

    Attributes
    ----------
    row : int
        Row of the mode's arrays.
    point : int
        Number of the singular point in `ConfigurationSpace.singular_points`.
    tangent : int
        Number of the mode's tangent in that point's `modes`.
    """

    row: int
    point: int
    tangent: int


@dataclass(frozen=True)
class ModeCurve:
    """An operation mode: a curve that a smooth motion stays on, through its singular points.

    Attributes
    ----------
    name : str
        "a", "b", …: the mode of the home configuration first.
    q : ndarray (N, nq)
        Configurations along it, angles unwrapped; the last is the first again if it is closed.
    tangents : ndarray (N, nv)
        K t = 0, |t| = 1, all in the same sense along the curve.
    visits : tuple of Visit
    closed : bool
    turns : tuple of int
        Full turns of each joint on one way around a closed mode, (nv,).
    stop : str
        Why an open mode ends; empty for a closed one.
    """

    name: str
    q: Array
    tangents: Array
    visits: tuple[Visit, ...]
    closed: bool
    turns: tuple[int, ...]
    stop: str = ""

    def __repr__(self) -> str:
        """Name, size and how it ends."""
        met = dict.fromkeys(visit.point for visit in self.visits)
        passes = f", singular points {', '.join(map(str, met))}" if met else ""
        end = f"closed, turns {self.turns}" if self.closed else self.stop
        return f"ModeCurve({self.name!r}: {len(self.q)} configurations{passes}; {end})"


@dataclass(frozen=True)
class ConfigurationSpace:
    """What `trace_modes` found.

    Attributes
    ----------
    mechanism : Mechanism
    modes : tuple of ModeCurve
    singular_points : tuple of LocalAnalysis
    seeds : int
        Rough configurations that were tried besides home.
    met : tuple of int
        How many of home and the seeds led to each mode; 0: found from a singular point alone.
    """

    mechanism: Mechanism
    modes: tuple[ModeCurve, ...]
    singular_points: tuple[LocalAnalysis, ...]
    seeds: int = 0
    met: tuple[int, ...] = ()

    def __repr__(self) -> str:
        """The summary, and the modes."""
        lines = [f"ConfigurationSpace of {self.mechanism.name!r}: {self.summary}", *map(repr, self.modes)]
        return "\n  ".join(lines)

    def meeting(self, point: int) -> tuple[str, ...]:
        """Names of the modes that pass a singular point, one for each tangent there."""
        through = {v.tangent: mode.name for mode in self.modes for v in mode.visits if v.point == point}
        return tuple(through[k] for k in sorted(through))

    @property
    def assemblies(self) -> tuple[tuple[str, ...], ...]:
        """The assembly modes: names of modes that are connected through singular points, home's first.

        From one to another the mechanism must be taken apart.
        """
        groups: list[tuple[set[int], list[str]]] = []
        for mode in self.modes:
            points, names = {v.point for v in mode.visits}, [mode.name]
            joined = [group for group in groups if group[0] & points]
            for group in joined:
                points |= group[0]
                names = group[1] + names
                groups.remove(group)
            groups.append((points, names))
        order = {mode.name: i for i, mode in enumerate(self.modes)}
        found = [tuple(sorted(names, key=order.__getitem__)) for _, names in groups]
        return tuple(sorted(found, key=lambda names: order[names[0]]))

    @property
    def summary(self) -> str:
        """What was found, such as "3 modes, 3 singular points" or "2 assembly modes, no singular points"."""
        modes, apart, points = len(self.modes), len(self.assemblies), len(self.singular_points)
        if modes == apart > 1:
            counted = f"{modes} assembly modes"
        else:
            within = f" in {apart} assembly modes" if apart > 1 else ""
            counted = f"{_several(modes, 'mode')}{within}"
        return f"{counted}, {_several(points, 'singular point') if points else 'no singular points'}"

    @property
    def search(self) -> str:
        """How far the search went, and what speaks against its being complete."""
        if not self.seeds:
            return "only what is connected with home was looked for (seeds = 0)"
        number = {mode.name: i for i, mode in enumerate(self.modes)}
        starts = [sum(self.met[number[name]] for name in names) for names in self.assemblies]
        text = f"searched from home and {_several(self.seeds, 'seed')}"
        rare = ["-".join(names) for names, n in zip(self.assemblies, starts, strict=True) if n == 1]
        ended = [mode.name for mode in self.modes if not mode.closed]
        if ended:
            text += f"; not followed to the end: {', '.join(ended)}"
        if rare and len(self.assemblies) > 1:
            alone = ", ".join(rare)
            return f"{text}; met by one of them alone: {alone}, so there may be more: use more seeds"
        return f"{text}; assembly modes with few configurations may be missing"


def _several(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"
