"""What a run cost."""

from __future__ import annotations

from dataclasses import dataclass, field

Stretches = list[tuple[float, float]]
"""Begin and end of each, s, in the order of time."""


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
        Singular value decompositions; 0 in a scene that never comes near a singularity and has no
        redundant closures, whose rank is looked at once. An analysis at second order counts as one.
        As many as the reference takes: in zones the kernel leaves out those that decide nothing.
    repartitions : list of (float, tuple of str)
        Time and new independent joints of each change of coordinates.
    refined : list of (float, float)
        Beginning and end of each stretch of those steps, s.
    native_steps : int
        Steps taken by the compiled kernel; the other ones were taken in Python.
    wall_seconds : float
    stepper : str
        What took the steps: "rk4", a solver of SciPy's, or "tableau".
    step : float or None
        Length of fixed steps, s.
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
    refined: Stretches = field(default_factory=list)
    wall_seconds: float = 0.0
    stepper: str = "rk4"
    step: float | None = None


def until(stretches: Stretches, t: float) -> Stretches:
    """The stretches of time, or what of them lies before t."""
    return [(begun, min(end, t)) for begun, end in stretches if begun < t]


def extended(stretches: Stretches, begun: float, end: float) -> Stretches:
    """The stretches with one more behind them, of which it may be the continuation."""
    if stretches and stretches[-1][1] == begun:  # both are numbers of one array
        return [*stretches[:-1], (stretches[-1][0], end)]
    return [*stretches, (begun, end)]
