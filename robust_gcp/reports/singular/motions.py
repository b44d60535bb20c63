"""The motions: reading them, and the mechanism of one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ... import JointFriction, Mechanism, Stop
from ...mechanism.tree.tree import Array
from ..contender import Scene
from ..linkages import mechanism_of, parts_of
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
