"""Run a scene in all its descriptions and compare what happens in the world."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robust_gcp.analysis.local import analyse
from robust_gcp.errors import RobustGcpError
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array
from robust_gcp.simulation.simulate import simulate
from robust_gcp.simulation.trajectories.trajectory import Trajectory

from .choices import Description, Refused, descriptions
from .drawing import Drawing, View
from .graph import Graph
from .scenes import Scene

SAME_MOTION = 1e-9
"""Largest difference of a body's placement, rad and lengths."""

SAME_BACKEND = 1e-12
"""The same between the compiled kernel and Python."""

RTOL, ATOL, SAME_STEPPER = 1e-9, 1e-11, 1e-6
"""Tolerances of the solvers that control their error, and what they may differ from RK4 by."""

STEPPERS = ("DOP853", "RK45", "Radau", "LSODA", "BDF")

SAME_TIME, SAME_PLACE = 1e-6, 1e-8
"""Of a crossing, s, and rad or lengths."""

PLACE_BY_MOTION = 10.0
"""What a place on a singular surface may be off, in differences of the motions that meet it there."""

SINGULAR = 1e-9
"""Singular value of the dimensionless K below which it has vanished at a crossing."""

CLOSED = 1e-11
"""Largest max |φ| / length at an output."""

SHOWS = 5e-12
"""Errors from which on rounding hides nothing of the order."""

COARSEST = 64
"""Steps of the scene's in the longest one that is tried for errors as large."""

AWAY, OUTPUTS = 1e5, 40
"""Lengths by which the base is moved, and outputs that are compared."""


@dataclass
class Finding:
    """One description of a scene and how its run compares with the reference.

    Attributes
    ----------
    scene, description : str
    difference : float
        Largest of the bodies' placements, rad or lengths.
    allowed : float
        What difference counts as none.
    crossings : str
        How they differ; empty where they agree.
    refused : str
        The message of an error, else empty.
    told : str
        The first warning, else empty.
    open : str
        By how much loops are open, where it is more than rounding.
    seconds : float
    """

    scene: str
    description: str
    difference: float = np.nan
    allowed: float = SAME_MOTION
    crossings: str = ""
    refused: str = ""
    told: str = ""
    open: str = ""
    seconds: float = 0.0

    @property
    def same(self) -> bool:
        """Same motion, same crossings, all rows closed."""
        return not (self.refused or self.crossings or self.open) and self.difference <= self.allowed

    @property
    def silently_wrong(self) -> bool:
        """Not the same, and neither an error nor a warning says so."""
        return not (self.same or self.refused or self.told)


@dataclass
class Report:
    """All descriptions of a scene.

    Attributes
    ----------
    scene : str
    order : float
        Of RK4 in the original description; NaN where errors are rounding.
    findings : list of Finding
    """

    scene: str
    order: float
    findings: list[Finding] = field(default_factory=list)


@dataclass(frozen=True)
class Outcome:
    """What a run shows in the world."""

    poses: Array
    times: Array
    places: Array
    coranks: tuple[int, ...]
    kinds: tuple[str, ...]


def compare(scene: Scene, most: int, seed: int = 1, steppers: Sequence[str] = ()) -> Report:
    """Run all descriptions of a scene, and other steppers on the first one, against the first."""
    mechanism, v0 = scene.started()
    graph = Graph(mechanism, mechanism.home, v0)
    first = Finding(scene.name, "as it is")
    fine = _simulated(first, mechanism, None, v0, scene)
    if fine is None:
        return Report(scene.name, np.nan, [first])
    report = Report(scene.name, _order(mechanism, v0, scene, fine))
    reference = outcome(graph, fine)
    _judge(first, fine, reference, reference)
    if reference.coranks != scene.crossings:
        first.crossings = f"coranks {reference.coranks} instead of {scene.crossings}"
    report.findings.append(first)
    for description in descriptions(scene, most, seed):
        if isinstance(description, Refused):
            report.findings.append(Finding(scene.name, description.name, refused=description.words))
        else:
            report.findings.append(_run(scene, graph, description, reference))
    if not any(getattr(force, "damping", 0.0) for force in mechanism.forces):
        report.findings.append(_reversed(scene, graph, fine, reference))
    report.findings.append(_far(scene, graph))
    python = Finding(scene.name, "in Python", allowed=SAME_BACKEND)
    run = _simulated(python, mechanism, None, v0, scene, backend="python")
    if run is not None:
        _judge(python, run, outcome(graph, run), reference)
    report.findings.append(python)
    for stepper in steppers:
        finding = Finding(scene.name, stepper, allowed=SAME_STEPPER)
        run = _simulated(finding, mechanism, None, v0, scene, stepper=stepper, rtol=RTOL, atol=ATOL)
        if run is not None:
            _judge(finding, run, outcome(graph, run), reference)
        report.findings.append(finding)
    return report


def _order(mechanism: Mechanism, v0: Array, scene: Scene, fine: Trajectory) -> float:
    """That of the steps, from three runs with errors that show it; NaN where there are none."""
    runs, n = [fine], 1
    while len(runs) < 3 or (n < COARSEST and _apart(runs[1], runs[0]) < SHOWS):
        n *= 2
        longer = _simulated(Finding(scene.name, ""), mechanism, None, v0, replace(scene, step=n * scene.step))
        if longer is None:
            break
        runs = [*runs[-2:], longer]
    if len(runs) < 3 or _apart(runs[1], runs[0]) < SHOWS:
        return np.nan
    return float(np.log2(_apart(runs[2], runs[1]) / _apart(runs[1], runs[0])))


def _apart(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest difference of q after steps that both runs have, those of one twice those of the other."""
    whole = (len(fine.t) - 1) // 2 + 1
    return float(np.abs(coarse.q[:whole] - fine.q[::2][:whole]).max())


def outcome(drawn: Graph | Drawing, run: Trajectory) -> Outcome:
    """Placements at some outputs, and the crossings."""
    crossed = run.crossings
    at_crossings = np.array([c.q for c in crossed]).reshape(-1, run.mechanism.nq)
    return Outcome(
        drawn.poses(run.q[_some(run)]),
        np.array([c.time for c in crossed]),
        drawn.poses(at_crossings),
        tuple(c.corank for c in crossed),
        tuple(c.kind for c in crossed),
    )


def _some(run: Trajectory) -> Array:
    """Outputs that are compared: the same ones counted from either end."""
    half = np.linspace(0, (len(run.t) - 1) // 2, OUTPUTS // 2).astype(int)
    return np.unique(np.concatenate([half, len(run.t) - 1 - half]))


def _run(scene: Scene, graph: Graph, description: Description, reference: Outcome) -> Finding:
    finding = Finding(scene.name, description.name)
    run = _simulated(finding, description.mechanism, None, description.v0, scene)
    if run is not None:
        _judge(finding, run, outcome(description.drawing or graph, run), reference)
    return finding


def _reversed(scene: Scene, graph: Graph, forward: Trajectory, reference: Outcome) -> Finding:
    """The motion back from its end."""
    finding = Finding(scene.name, "backwards")
    run = _simulated(finding, forward.mechanism, forward.q[-1], -forward.v[-1], scene)
    if run is not None:
        there = outcome(graph, run)
        times = scene.duration - there.times[::-1]
        _judge(
            finding,
            run,
            Outcome(there.poses[::-1], times, there.places[::-1], there.coranks[::-1], there.kinds[::-1]),
            reference,
        )
    return finding


def _far(scene: Scene, graph: Graph) -> Finding:
    """The base far away, against the same lengths, as they are rounded there, at the origin: bit by bit."""
    finding = Finding(scene.name, f"{AWAY:g} lengths away", allowed=0.0)
    try:
        drawn = Drawing(graph, View(shift=AWAY * graph.mechanism.length * np.array([0.6, -0.8, 0.3])))
    except RobustGcpError as error:
        return replace(finding, refused=f"{type(error).__name__}: {error}")
    far = drawn.mechanism
    at = far.near, far.closures, far.independent, far.home, far.name, far.forces
    runs = [_simulated(finding, m, None, drawn.v0, scene) for m in (far, Mechanism.from_pinocchio(*at))]
    if runs[0] is not None and runs[1] is not None:
        _judge(finding, runs[0], outcome(drawn, runs[0]), outcome(drawn, runs[1]))
    return finding


def _simulated(
    finding: Finding, mechanism: Mechanism, q0: Array | None, v0: Array, scene: Scene, **options: Any
) -> Trajectory | None:
    """A run of the scene, with its time; None, with the reason in the finding, where it is refused."""
    begun = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            return simulate(mechanism, q0, v0, duration=scene.duration, step=scene.step, **options)
        except RobustGcpError as error:
            finding.refused = f"{type(error).__name__}: {error}"
            return None
        finally:
            finding.seconds = time.perf_counter() - begun
            finding.told = str(caught[0].message) if caught else ""


def _judge(finding: Finding, run: Trajectory, found: Outcome, reference: Outcome) -> None:
    """Fill in how a run compares with the reference."""
    finding.difference = float(np.abs(found.poses - reference.poses).max(initial=0.0))
    allowed = max(SAME_PLACE, PLACE_BY_MOTION * finding.difference)
    finding.crossings = _other_crossings(found, reference, allowed) or _off_their_place(run)
    left_open = float(run.closure_error().max() / run.mechanism.length) if run.mechanism.nc else 0.0
    finding.open = f"loops open by {left_open:.1e} lengths" if left_open > CLOSED else ""


def _other_crossings(found: Outcome, reference: Outcome, allowed: float) -> str:
    """How two lists of crossings differ, those at one time in any order; empty where they agree."""
    if sorted(found.coranks) != sorted(reference.coranks):
        return f"coranks {found.coranks} instead of {reference.coranks}"
    if sorted(found.kinds) != sorted(reference.kinds):
        return f"kinds {found.kinds} instead of {reference.kinds}"
    left = list(range(len(found.coranks)))
    for time_, place, corank in zip(reference.times, reference.places, reference.coranks, strict=True):
        near = [i for i in left if found.coranks[i] == corank and abs(found.times[i] - time_) < SAME_TIME]
        if not near:
            off = np.abs(found.times - time_).min()
            return f"the one at {time_:.6g} s is {off:.1e} s away"
        offs = [float(np.abs(found.places[i] - place).max()) for i in near]
        best = int(np.argmin(offs))
        if offs[best] > allowed:
            return f"the one at {time_:.6g} s is {offs[best]:.1e} away"
        left.remove(near[best])
    return ""


def _off_their_place(run: Trajectory) -> str:
    """Which crossing is not on the singular set, or has no modes there."""
    for crossing in run.crossings:
        assert crossing.cluster is not None
        cluster = run.mechanism.clusters[crossing.cluster]
        K = cluster.loops.scaled(cluster.loops.K(crossing.q[cluster.iq]))
        s = np.linalg.svd(K, compute_uv=False)
        generic = cluster.loops.nv - cluster.m
        if int(np.sum(s[:generic] < SINGULAR)) != crossing.corank:
            return f"the one at {crossing.time:.6g} s is beside the singular set: {s[generic - 1]:.1e}"
        if not analyse(run.mechanism, crossing.q).modes:
            return f"no modes are found at the one at {crossing.time:.6g} s"
    return ""
