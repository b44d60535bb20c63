"""Exudyn: implicit integrators of order 2 on constraints of position (index 3) or velocity (index 2).

Planar scenes are rigid bodies with revolute joints, others a kinematic tree with joints between links.
Springs, dampers and drives are Exudyn's own.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ... import JointTorque, PointSpring
from ...mechanism.tree.tree import Array
from ..contender import Contender, Kind, Outcome, Scene, clock, division, reached
from .exudyn_models import ExudynModel, KinematicTree, PlanarBodies, exu, is_planar
from .parts import has_simple_joints

SMALLEST = 1.0 / 16.0
"""Of the step: where halving it four times does not help Newton's iterations, the run stops. Down to
Exudyn's own least step, 1e-8 s, it would crawl for hours."""


@dataclass
class Implicit:
    """Exudyn's generalised-alpha family."""

    name: str
    tuning: str
    stepper: str
    # settings under `timeIntegration` that differ from Exudyn's defaults
    integration: dict[str, Any] = field(default_factory=dict)
    family: str = "Exudyn"
    kind: Kind = "fixed"

    def refuses(self, scene: Scene) -> str:
        """Why not: joints or springs that the adapter does not know."""
        if not has_simple_joints(scene.mechanism):
            return "the adapter knows revolute and prismatic joints only"
        if scene.joints or len(scene.mechanism.loops) < len(scene.mechanism.closures):
            return "the adapter knows no stops, dry friction or couplings"
        if not all(isinstance(f, PointSpring | JointTorque) for f in scene.mechanism.forces):
            return "the adapter knows point springs and constant drives only"
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        """Fixed steps nearest to `setting`, s; Exudyn halves one at which its Newton iterations fail."""
        substeps, step = division(scene, setting)
        with quiet():
            built: ExudynModel = PlanarBodies(scene) if is_planar(scene) else KinematicTree(scene)
            settings = self.settings(scene, substeps, step, built.linear_solver)
            solver = exu.MainSolverImplicitSecondOrder()
            why = "Newton's iterations failed"
            solver.InitializeSolver(built.mbs, settings)
            begun = clock()
            try:
                solver.SolveSteps(built.mbs, settings)
            except (exu.SolverError, exu.InternalError) as error:
                why = str(error).splitlines()[0]
            seconds = clock() - begun
            solver.FinalizeSolver(built.mbs, settings)
        t, states = stored(built)
        q, v = at_times(scene.times, t, *built.tree_coordinates(states))
        return reached(scene, zip(q[1:], v[1:], strict=True), seconds, int(solver.it.newtonStepsCount), why)

    def settings(self, scene: Scene, substeps: int, step: float, linear_solver: tuple[str, bool]) -> Any:
        """Exudyn's settings: this many steps between outputs, kept by sensors in memory."""
        settings = exu.SimulationSettings()
        end, spacings = float(scene.times[-1]), len(scene.times) - 1
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps = end, spacings * substeps
        integration.automaticStepSize = False
        integration.minimumStepSize = SMALLEST * step
        for path, value in self.integration.items():
            owner, _, name = path.rpartition(".")
            setattr(operator.attrgetter(owner)(integration), name, value)
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = end / spacings
        solver, ignore = linear_solver
        settings.linearSolver.solverType = getattr(exu.LinearSolverType, solver)
        settings.linearSolver.ignoreSingularJacobian = ignore
        return settings


def stored(built: ExudynModel) -> tuple[Array, list[list[Array]]]:
    """Times and states that the sensors kept."""
    tables = [[np.array(built.mbs.GetSensorStoredData(s)) for s in kind] for kind in built.sensors]
    return tables[0][0][:, 0], [[table[:, 1:] for table in kind] for kind in tables]


def at_times(times: Array, t: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """The states at the scene's times: those kept, or up to a step later where a step was halved.

    Then q and v are brought back by their Taylor series, with an error of the third and second order of
    the step, which the integrators' own order allows.
    """
    n = min(len(t), len(times))
    back = (times[:n] - t[:n])[:, None]
    back[np.abs(back) < 1e-9 * times[-1]] = 0.0  # the rounding of Exudyn's clock
    return q[:n] + back * v[:n] + 0.5 * back**2 * a[:n], v[:n] + back * a[:n]


@contextmanager
def quiet() -> Iterator[None]:
    """Exudyn says nothing on the console."""
    before = exu.config.printToConsole, exu.config.suppressWarnings
    exu.config.printToConsole, exu.config.suppressWarnings = False, True
    try:
        yield
    finally:
        exu.config.printToConsole, exu.config.suppressWarnings = before


DEFAULTS = Implicit(
    "Exudyn generalised-alpha",
    "position constraints (index 3), spectral radius 0.9, modified Newton to 1e-8: Exudyn's defaults, "
    "which no variant beat",
    "generalised-alpha",
)
INDEX_2 = Implicit(
    "Exudyn trapezoidal, index 2",
    "velocity constraints (index 2), which Exudyn offers with the trapezoidal rule alone; else its defaults",
    "trapezoidal",
    {"generalizedAlpha.useNewmark": True, "generalizedAlpha.useIndex2Constraints": True},
)


def contenders() -> list[Contender]:
    """Generalised-alpha of index 3, Exudyn's defaults, and the trapezoidal rule of index 2."""
    return [DEFAULTS, INDEX_2]
