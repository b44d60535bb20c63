"""A problem's contenders, from coarse steps to fine ones, until they err by no more than is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..contender import Contender, Outcome
from ..work_precision.measure import settings_of
from ..work_precision.motion import Motion
from ..work_precision.references import Reference
from .problems import Problem

REPEATED = 3
"""Timed runs of a setting that is good enough; their least counts."""


@dataclass(frozen=True)
class Reached:
    """What a contender needs for one of the two precisions of a problem.

    Attributes
    ----------
    allowed, error : float
        Largest error of what the results file holds, m and m/s; NaN where no setting was good enough.
    setting : float
        Step, s, or relative tolerance.
    seconds : float
        Processor time.
    energy : float
        Largest change of the energy, J; NaN where it is not constant.
    """

    problem: str
    contender: str
    family: str
    allowed: float
    error: float = np.nan
    setting: float = np.nan
    seconds: float = np.nan
    energy: float = np.nan


def measured(
    problem: Problem, motion: Motion, exact: Reference, contender: Contender, cap: float
) -> Iterator[Reached]:
    """Both precisions; settings are left once one takes longer than `cap` seconds."""
    wanted = problem.delivered(motion.scene.mechanism, exact.q, exact.v)
    settings = settings_of(contender, motion.scene, motion.steps)
    left = list(problem.allowed)
    contender.run(motion.scene, settings[0])  # what is prepared once
    for setting in settings:
        outcome = contender.run(motion.scene, setting)
        error = _error(problem, motion.scene.mechanism, outcome, wanted)
        while left and error <= left[0]:
            again = [contender.run(motion.scene, setting).seconds for _ in range(REPEATED - 1)]
            seconds = min(outcome.seconds, *again)
            energy = _energy(motion.scene.mechanism, outcome) if problem.conserves else np.nan
            yield Reached(
                problem.name, contender.name, contender.family, left.pop(0), error, setting, seconds, energy
            )
        if not left or outcome.seconds > cap:
            break
    for allowed in left:
        yield Reached(problem.name, contender.name, contender.family, allowed)


def fastest(found: Sequence[Reached]) -> list[Reached]:
    """Of each precision and family of contenders the one that takes least time; those that get there."""
    best: dict[tuple[float, str], Reached] = {}
    for one in found:
        key = one.allowed, one.family
        if np.isfinite(one.error) and (key not in best or one.seconds < best[key].seconds):
            best[key] = one
    return list(best.values())


def _error(problem: Problem, mechanism: Mechanism, outcome: Outcome, wanted: Array) -> float:
    """Infinite where the run stopped early."""
    if len(outcome.q) < len(wanted):
        return np.inf
    return float(np.abs(problem.delivered(mechanism, outcome.q, outcome.v) - wanted).max())


def _energy(mechanism: Mechanism, outcome: Outcome) -> float:
    energies = np.array([mechanism.energy(q, v) for q, v in zip(outcome.q, outcome.v, strict=True)])
    return float(np.abs(energies - energies[0]).max())
