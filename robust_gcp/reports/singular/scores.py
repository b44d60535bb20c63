"""`python -m robust_gcp reports singular`: which tool follows which motion through singular configurations.

Each runs at ever finer settings; what counts is its least error at the 20 instants of a motion, and whether
it is still on the mode that it started on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ... import JointFriction, Mechanism, Stop
from ...arguments import Arguments, existing_file, file, number, part, positive
from ...mechanism.tree.tree import Array
from ...printing import along, table, write_json
from .. import pages
from ..contender import Contender, Scene
from ..linkages import mechanism_of, parts_of
from ..machine import footer, machine
from ..tools import tools
from ..work_precision import ours
from ..work_precision.measure import LOST, settings_of
from ..work_precision.references import times_of

MOTIONS = Path(__file__).with_name("motions.json")


@dataclass(frozen=True)
class Motion:
    """A linkage that moves under gravity, some with a stop or dry friction, through singular configurations.

    Attributes
    ----------
    name, singular : str
        Which, and what is singular on its way.
    linkage : dict
        See `reports.linkages`; one coordinate.
    times : ndarray (21,)
        s, equally spaced from 0.
    q, v : ndarray (n, nv)
        Rounded from 25 digits; the first is the start, on the mode that is meant. Less than 21 where it ends.
    end : float
        s, when the mode ends in a cusp; infinite for others.
    """

    name: str
    singular: str
    linkage: dict[str, Any]
    times: Array
    q: Array
    v: Array
    end: float = np.inf

    @property
    def joints(self) -> tuple[Stop | JointFriction, ...]:
        """Its stops and what rubs, as `simulate` takes them."""
        return parts_of(self.linkage)

    @cached_property
    def mechanism(self) -> Mechanism:
        """At home at the start."""
        return mechanism_of(self.linkage, self.q[0])

    @cached_property
    def scene(self) -> Scene:
        """As contenders run it."""
        times = times_of(float(self.times[-1]))
        return Scene(self.name, self.mechanism, self.q[0], self.v[0], times, self.joints)


def motions() -> list[Motion]:
    """All of them."""
    found = []
    for given in json.loads(MOTIONS.read_text(encoding="utf-8")):
        times, q, v = (np.array(given[key], dtype=float) for key in ("times", "q", "v"))
        end = float(given.get("end", np.inf))
        found.append(Motion(given["name"], given["singular"], given["linkage"], times, q, v, end))
    return found


# --------------------------------------------------------------------------- scores

STEPS = (1, 2, 5, 10, 20)
"""In each of 400 intervals."""

FINE = 20
"""Of our own steps in each, for the gains that other tools are given: they are scanned by a motion."""


@dataclass(frozen=True)
class Score:
    """How a tool does on a motion."""

    tool: str
    motion: str
    error: float = np.inf  # least over its settings: largest difference of a joint at the 20 instants, rad
    lost: float = np.nan  # when it left the mode at its best setting, s; NaN where it did not
    refused: str = ""  # why it was not run
    past: bool = False  # whether it went on, without a word, where the motion ends

    @property
    def cell(self) -> str:
        """In the table."""
        if self.refused:
            return "refused"
        held = f"{self.error:.0e}" if np.isnan(self.lost) else f"lost at {self.lost:.3g} s"
        return f"{held}, goes on" if self.past else held


def scored(contender: Contender, motion: Motion, cap: float) -> Score:
    """A tool's best on a motion; settings are left once one takes longer than `cap` seconds."""
    scene = motion.scene
    why = contender.refuses(scene)
    if why:
        return Score(contender.name, motion.name, refused=why)
    every, best = (len(scene.times) - 1) // (len(motion.times) - 1), Score(contender.name, motion.name)
    for setting in settings_of(contender, scene, STEPS):
        outcome = contender.run(scene, setting)
        found = outcome.q[::every]
        past, n = len(found) > len(motion.q), min(len(found), len(motion.q))
        errors = np.full(len(motion.q), np.inf)  # where it did not get to
        with np.errstate(over="ignore", invalid="ignore"):
            off = np.abs(found[:n] - motion.q[:n]) / scene.mechanism.units
        errors[:n] = np.nan_to_num(off.max(axis=1), nan=np.inf, posinf=np.inf)
        gone, error = np.flatnonzero(errors > LOST), float(errors.max())
        lost = float(motion.times[gone[0]]) if len(gone) else np.nan
        if error < best.error or (np.isinf(best.error) and not best.lost > lost):
            best = Score(contender.name, motion.name, error, lost, past=past)
        if outcome.seconds > cap:
            break
    return best


def followed(scene: Scene, backend: Literal["auto", "python", "native"] = "auto") -> Array:
    """q of our own in `FINE` steps between a scene's times, as far as it goes."""
    tool = ours.Ours("own", "bridge", "bridge", ours.FIXED, "", backend=backend)
    return tool.run(scene, float(scene.times[1]) / FINE).q


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = "tools whose name or family contains it; default: all that are installed"
    add_to.add("--method", part, nargs="+", default=[], metavar="PART", help=text)
    text = "no finer settings of a tool once a run takes longer, s; default: 1"
    add_to.add("--cap", positive, type=number, default=1.0, metavar="S", help=text)
    add_to.path("--out", file((".json",), "a record of scores"), "FILE", "figures as JSON")
    add_to.path("--refresh", existing_file, "PAGE", "renew the block of this name in a page")


def run(args: argparse.Namespace) -> int:
    """Score, print the table, write the files; 1 where one of ours is not right."""
    pages.require_marks(args.refresh, ["singular"])
    found: list[Score] = []
    exact: dict[str, Array] = {}
    taking_part = tools(lambda scene: exact[scene.name], args.method, ["bridge, RK4", ours.COMPILED])
    for motion in along(motions(), "singular"):
        exact[motion.name] = followed(motion.scene)
        found += [scored(tool, motion, args.cap) for tool in taking_part]
    rows = cells(found)
    print(table(rows[0], rows[1:], None))
    where = machine()
    last = footer(where)
    print(last)
    if args.out is not None:
        write_json(args.out, {"machine": where, "scores": [asdict(score) for score in found]})
    block = pages.table(rows, range(1, len(rows[0]))) + f"\n\n*{last}*"
    pages.refresh(args.refresh, {"singular": block})
    wrong = [s for s in found if s.tool.startswith("bridge") and not s.error < 1e-6]
    return 1 if wrong else 0


def cells(found: Sequence[Score]) -> list[list[str]]:
    """A header, and a row for each tool."""
    tools = list(dict.fromkeys(score.tool for score in found))
    by = {(score.tool, score.motion): score for score in found}
    names = list(dict.fromkeys(score.motion for score in found))
    return [["tool", *names], *([tool, *(by[tool, name].cell for name in names)] for tool in tools)]
