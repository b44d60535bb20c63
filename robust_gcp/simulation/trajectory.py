"""The result of a simulation, which certifies itself."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..maps.explicit import Crossing
from ..mechanism.joints import in_q, in_v
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass
class Stats:
    """What a run cost.

    Attributes
    ----------
    rhs : int
        Right-hand sides evaluated.
    constraint_evaluations : int
        Evaluations of φ and K, with K_d factorised where it is solved; 0 without closed loops.
    newton_iterations : int
    force_evaluations : int
        Evaluations of springs, dampers, drives and torques; 0 without any.
    second_order : int
        Second-order analyses of a singular configuration: at a start, and one for each bridge.
    zone_evaluations : int
        Right-hand sides taken from a bridge, a projection, or an uncertified zone.
    marching_steps : int
        Small steps taken to follow a branch to a node or past a poor prediction.
    bridges_built : int
    refined_steps : int
        Steps taken with error control because their zone had no certified bridge.
    svds : int
        Singular value decompositions; 0 in a scene that never comes near a singularity.
    repartitions : list of (float, tuple of str)
        Time and new independent joints of each change of coordinates.
    native_steps : int
        Steps taken by the compiled kernel; the other ones were taken in Python.
    wall_seconds : float
    """

    rhs: int = 0
    constraint_evaluations: int = 0
    newton_iterations: int = 0
    force_evaluations: int = 0
    second_order: int = 0
    zone_evaluations: int = 0
    marching_steps: int = 0
    bridges_built: int = 0
    refined_steps: int = 0
    svds: int = 0
    native_steps: int = 0
    repartitions: list[tuple[float, tuple[str, ...]]] = field(default_factory=list)
    wall_seconds: float = 0.0


@dataclass
class Trajectory:
    """A simulated motion.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray (N + 1,)
        s.
    q, v : ndarray (N + 1, nq), (N + 1, nv)
    a : ndarray (N + 1, nv) or None
        Accelerations, when recorded.
    energy : ndarray (N + 1,) or None
        Kinetic energy plus that of gravity and springs, J, when recorded.
    multipliers : ndarray (N + 1, nc) or None
        Constraint forces λ, N and N m, when recorded.
    work : ndarray (N + 1,) or None
        Work done by torques, drives and dampers since the start, J; None without any.
    crossings : list of Crossing
    stats : Stats
    """

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array | None = None
    energy: Array | None = None
    multipliers: Array | None = None
    work: Array | None = None
    crossings: list[Crossing] = field(default_factory=list)
    stats: Stats = field(default_factory=Stats)

    @property
    def y(self) -> Array:
        """Independent coordinates, (N + 1, m)."""
        return self.q[:, self.mechanism.iq_independent]

    def closure_error(self) -> Array:
        """max |φ(q)| at each time, (N + 1,), m or rad."""
        return np.array([np.abs(self.mechanism.phi(q)).max(initial=0.0) for q in self.q])

    def velocity_error(self) -> Array:
        """max |K v| at each time, (N + 1,), m/s or rad/s."""
        return np.array(
            [np.abs(self.mechanism.K(q) @ v).max(initial=0.0) for q, v in zip(self.q, self.v, strict=True)]
        )

    def energy_error(self) -> Array:
        """Energy minus its start and minus the work of torques, drives and dampers, (N + 1,), J."""
        energy = self._energy
        drift = energy - energy[0]
        return drift if self.work is None else drift - self.work

    @cached_property
    def _energy(self) -> Array:
        if self.energy is not None:
            return self.energy
        energy = self.mechanism.energy
        return np.array([energy(q, v) for q, v in zip(self.q, self.v, strict=True)])

    def plot(self, what: Sequence[str] | str | None = None, path: str | Path | None = None) -> Figure:
        """Draw the motion over time, crossings marked by dotted lines; needs the extra `viz`.

        Parameters
        ----------
        what : sequence of {"q", "v", "a", "energy", "closure"}, optional
            Panels. "energy" is `energy_error`, J; "closure" is `closure_error`, on a logarithmic
            scale. When left out: q, v, closure where there are loops, and a and energy if recorded.
        path : str or Path, optional
            Also write this .png or .pdf file.

        Returns
        -------
        matplotlib.figure.Figure
            Outside pyplot: nothing needs to be closed, and a notebook shows it by itself.

        Raises
        ------
        OptionError
            For other words, accelerations that were not recorded, another kind of file.
        MissingExtraError
            When Matplotlib is not installed.
        """
        from ..drawing.figures.motion import plot_motion

        return plot_motion(self, what, path)

    def to_csv(self, path: str | Path) -> Path:
        """Write t, q, v and whatever else was recorded, one row a time; returns the path.

        Columns are called `q.joint` and `v.joint`, or `q.joint.component` where a joint has several
        numbers, such as `q.ball.qw` and `v.ball.rx`.
        """
        m = self.mechanism
        v_names = [component.name for component in in_v(m.joints)]
        columns: list[tuple[list[str], Array]] = [
            (["t"], self.t[:, None]),
            ([f"q.{c.name}" for c in in_q(m.joints)], self.q),
            ([f"v.{n}" for n in v_names], self.v),
        ]
        if self.a is not None:
            columns.append(([f"a.{n}" for n in v_names], self.a))
        if self.energy is not None:
            columns.append((["energy"], self.energy[:, None]))
        if self.multipliers is not None:
            columns.append(([f"lambda.{i}" for i in range(m.nc)], self.multipliers))
        path = Path(path)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([name for names, _ in columns for name in names])
            writer.writerows(np.hstack([values for _, values in columns]).tolist())
        return path
