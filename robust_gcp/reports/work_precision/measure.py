"""Points of the study: errors of a run against the exact motion, and its time; and all on disk."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ... import JointTorque, Mechanism, OptionError, StateError
from ...mechanism.tree.tree import Array
from ...printing import finite
from ..contender import Contender, Outcome, Scene
from ..machine import machine
from .references import TOLERANCES, Motion, Reference

LOST = 0.3
"""Path-wise error from which a run counts as failed: on another mode, or nowhere, rad."""

LONG = 0.4
"""s: a run this long is timed twice at the most."""

EXPECTED, COSTLIER = 1.6, 2.5
"""How much longer a run takes at the next tolerance, 100 times tighter: 100^(1/10), at most 100^(1/5)."""

LEAST, PATIENCE = 6, 3.0
"""The first six settings of a ladder may take this many times the cap: a curve needs them."""


@dataclass
class Point:
    """A contender on a scene at one setting."""

    scene: str
    contender: str
    family: str
    stepper: str
    kind: str
    setting: float  # step, s, or relative tolerance
    # seconds, fastest, slowest: median and range of the timed runs, s
    seconds: float = np.nan
    fastest: float = np.nan
    slowest: float = np.nan
    repeats: int = 0
    rhs: int = 0  # evaluations of the equations of motion, or of the engine's step
    # largest difference of a joint from the exact motion over the outputs, rad; a slide's in lengths. Angles
    # are compared as they are, full turns counted
    error: float = np.nan
    # closure, closure_velocity: largest |φ| and |K v| over the outputs, m and rad, per s
    closure: float = np.nan
    closure_velocity: float = np.nan
    # largest difference of the energy from the exact motion's, over its largest kinetic energy
    energy: float = np.nan
    lost: float | None = None  # when the error passed `LOST` or the run stopped, s; None when it went well
    why: str = ""  # why it was not timed or stopped; empty when it went well

    @property
    def timed(self) -> bool:
        """Whether it was run at all."""
        return self.repeats > 0

    @property
    def good(self) -> bool:
        """Whether it reached the end on the right motion."""
        return self.timed and self.lost is None

    @property
    def key(self) -> tuple[str, str, float]:
        """What tells points apart."""
        return self.scene, self.contender, self.setting

    def record(self) -> Any:
        """Plain values; what is not finite becomes None."""
        return finite(asdict(self))


def point_of(record: dict[str, Any]) -> Point:
    """The point of a record."""
    floats = {name for name, kind in Point.__annotations__.items() if kind == "float"}
    values: dict[str, Any] = {k: np.nan if v is None and k in floats else v for k, v in record.items()}
    return Point(**values)


@dataclass
class Judge:
    """Measures runs of one scene against its exact motion."""

    scene: Scene
    reference: Reference

    @cached_property
    def _exact_energy(self) -> tuple[Array, float]:
        mechanism = self.scene.mechanism
        states = list(zip(self.reference.q, self.reference.v, strict=True))
        kinetic = max(mechanism.tree.energies(q, v)[0] for q, v in states)
        return np.array([mechanism.energy(q, v) for q, v in states]), kinetic

    def errors(self, q: Array) -> Array:
        """Largest error over the joints at each output, (n,)."""
        mechanism, exact = self.scene.mechanism, self.reference.q[: len(q)]
        apart = (mechanism.tree.difference(one, two) for one, two in zip(exact, q, strict=True))
        return np.array([(np.abs(off) / mechanism.units).max() for off in apart])

    def lost(self, outcome: Outcome) -> float | None:
        """When the run left the exact motion or stopped, s."""
        off = np.flatnonzero(~(self.errors(outcome.q) <= LOST))
        if len(off):
            return float(self.scene.times[off[0]])
        last = min(len(outcome.q), len(self.scene.times) - 1)
        short = outcome.stopped or len(outcome.q) < len(self.scene.times)
        return float(self.scene.times[last]) if short else None

    def judge(self, outcome: Outcome) -> dict[str, Any]:
        """The errors and the loss, as attributes of a point."""
        mechanism, states = self.scene.mechanism, list(zip(outcome.q, outcome.v, strict=True))
        exact, scale = self._exact_energy
        with np.errstate(over="ignore", invalid="ignore"):  # of lost runs
            energy = np.array([_energy(mechanism, *state) for state in states]) - exact[: len(states)]
            for force in mechanism.forces:
                if isinstance(force, JointTorque):
                    i = mechanism.joint(force.joint).idx_q
                    energy -= force.torque * (outcome.q[:, i] - self.reference.q[: len(states), i])
            return {
                "rhs": outcome.rhs,
                "error": float(self.errors(outcome.q).max(initial=0.0)),
                "closure": _largest(mechanism.phi(q) for q, _ in states),
                "closure_velocity": _largest(mechanism.K(q) @ v for q, v in states),
                "energy": _largest([energy]) / scale,
                "lost": self.lost(outcome),
                "why": outcome.stopped,
            }


def _largest(vectors: Iterable[Array]) -> float:
    """Largest magnitude of any component; 0 where there is none."""
    return max((float(np.abs(vector).max(initial=0.0)) for vector in vectors), default=0.0)


def _energy(mechanism: Mechanism, q: Array, v: Array) -> float:
    """Energy, infinite where a lost run has gone so far that its square overflows."""
    try:
        return mechanism.energy(q, v)
    except StateError:
        return np.inf


def settings_of(
    contender: Contender, scene: Scene, steps: Sequence[int], tolerances: Sequence[float] = TOLERANCES
) -> list[float]:
    """The contender's ladder, coarse to fine: so many steps in each output interval, or tolerances."""
    if contender.kind == "adaptive":
        return list(tolerances)
    return [float(scene.times[1]) / k for k in steps]


def climb(
    contender: Contender, motion: Motion, judge: Judge, settings: list[float], known: dict[float, Point],
    repeats: int, cap: float,
) -> Iterator[Point]:  # fmt: skip
    """The contender's points on a scene, coarse to fine; known ones are passed on.

    A run that is predicted from the last one to take longer than `cap` is left out, and says so. The first
    setting is run once more beforehand, which prepares whatever is prepared once.
    """
    warm, before, last = False, None, None
    for i, setting in enumerate(settings):
        point = known.get(setting)
        if point is None:
            allowed = cap * (PATIENCE if i < LEAST else 1.0)
            predicted = _predicted(contender, before, last, setting)
            if predicted > allowed:
                why = f"not run: {predicted:.1f} s predicted, {allowed:.2g} s allowed"
                point = Point(*_names(contender, motion), setting, why=why)
            else:
                if not warm:
                    contender.run(motion.scene, setting)
                outcome = contender.run(motion.scene, setting)
                point = _timed(contender, motion, judge, setting, outcome, repeats)
                warm = True
        if point.timed:
            before, last = last, point
        yield point


def _names(contender: Contender, motion: Motion) -> tuple[str, str, str, str, str]:
    return motion.scene.name, contender.name, contender.family, contender.stepper, contender.kind


def _predicted(contender: Contender, before: Point | None, last: Point | None, setting: float) -> float:
    """Seconds of the next run: in proportion to the steps, or by the growth between the last tolerances."""
    if last is None:
        return 0.0
    if contender.kind == "fixed":
        return last.slowest * last.setting / setting
    growth = EXPECTED if before is None else last.slowest / before.slowest
    return last.slowest * min(max(growth, 1.0), COSTLIER)


def _timed(
    contender: Contender, motion: Motion, judge: Judge, setting: float, outcome: Outcome, repeats: int
) -> Point:
    """The point of a run that was made, which is repeated for the time."""
    found = judge.judge(outcome)
    times = [outcome.seconds]
    wanted = min(repeats, 2) if outcome.seconds > LONG else repeats
    while found["lost"] is None and len(times) < wanted:
        times.append(contender.run(motion.scene, setting).seconds)
    spread = statistics.median(times), min(times), max(times)
    return Point(*_names(contender, motion), setting, *spread, len(times), **found)


# --------------------------------------------------------------------------- on disk


class Store:
    """The points of a folder, made when missing.

    Raises
    ------
    OptionError
        When the folder holds points of other settings, another version or another machine, which do not
        compare; `fresh` forgets what is there.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], fresh: bool = False) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._path = folder, folder / "points.jsonl"
        begun = date.today().isoformat()
        self.header: dict[str, Any] = {"settings": settings, "machine": machine(), "begun": begun}
        self.points: dict[tuple[str, str, float], Point] = {}
        if fresh or not self._path.exists():
            self._path.write_text(json.dumps(self.header) + "\n", encoding="utf-8")
        else:
            self._read()

    def _read(self) -> None:
        first, *lines = self._path.read_text(encoding="utf-8").splitlines() or ["{}"]
        old = json.loads(first)
        for part in ("settings", "machine"):
            for name, value in self.header[part].items():
                there = old.get(part, {}).get(name)
                if there != json.loads(json.dumps(value)):
                    raise OptionError(
                        f"{self._path} holds points with {name} = {there!r}, now it is {value!r}: points of "
                        "different runs do not compare; give another --out, or start anew with --fresh"
                    )
        self.header["begun"] = old["begun"]
        complete = [first]
        for line in lines:
            try:
                point = point_of(json.loads(line))
            except (json.JSONDecodeError, TypeError):  # cut off while being written
                break
            complete.append(line)
            self.points[point.key] = point
        self._path.write_text("\n".join(complete) + "\n", encoding="utf-8")

    def known(self, scene: str, contender: str) -> dict[float, Point]:
        """Finished points by setting."""
        return {p.setting: p for p in self.points.values() if (p.scene, p.contender) == (scene, contender)}

    def add(self, point: Point) -> None:
        """Keep a point, on disk at once."""
        if point.key in self.points:
            return
        self.points[point.key] = point
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(point.record()) + "\n")
