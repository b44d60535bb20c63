"""What a robot's file describes, whatever its format: the contract of the readers in this folder."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass, field

import pinocchio as pin

from ..checks import check_choice, hint
from ..errors import ModelError, ModelWarning, OptionError
from ..warning import warn
from .actuation.actuators import Actuator
from .actuation.paths import Path
from .constraint.couplings import AnyClosure, CouplingClosure
from .forces.forces import Force
from .parts import Part
from .sensing.sensors import Sensor
from .tree.tree import Array

BASES = ("fixed", "free")

STAYS = "base='free' where other bodies float already"
"""What is told of bodies that keep standing on the ground."""


@dataclass
class FileContents:
    """A spanning tree and what belongs to it.

    Attributes
    ----------
    model : pin.Model
    closures : list of closures and couplings
    forces : list of forces
        Springs and dampers of the joints.
    home : ndarray (nq,) or None
        The file's own pose; None: neutral.
    keyframes : dict of str to ndarray (nq,)
    independent : tuple of str or None
        Joints that the file marks as independent.
    actuated : tuple of str
        Joints that the file drives.
    left_out : list of str
        Parts that are not simulated, one entry a kind.
    actuators : list of Actuator
    tendons : dict of str to Path
    parts : list of Stop, JointFriction
        Limits and dry friction of tendons; those of joints are the model's.
    bounce : dict of str to float
        Restitution of limits, by joint, where they are not plastic.
    velocities : dict of str to ndarray (nv,)
        Of keyframes that have one.
    sensors : list of Sensor
    moved : tuple of str
        Joints that move the ground, as prescribed.
    """

    model: pin.Model
    closures: list[AnyClosure] = field(default_factory=list)
    forces: list[Force] = field(default_factory=list)
    home: Array | None = None
    keyframes: dict[str, Array] = field(default_factory=dict)
    independent: tuple[str, ...] | None = None
    actuated: tuple[str, ...] = ()
    left_out: list[str] = field(default_factory=list)
    actuators: list[Actuator] = field(default_factory=list)
    tendons: dict[str, Path] = field(default_factory=dict)
    parts: list[Part] = field(default_factory=list)
    bounce: dict[str, float] = field(default_factory=dict)
    velocities: dict[str, Array] = field(default_factory=dict)
    sensors: list[Sensor] = field(default_factory=list)
    moved: tuple[str, ...] = ()

    def close(self, closures: Iterable[AnyClosure]) -> None:
        """Add closures given beside the file's, in place of those between the same two frames."""
        added = list(closures)
        pairs = {_frames(closure) for closure in added}
        # one who names a file's cut joint anew means another kind of it, not the same rows twice
        self.closures = [c for c in self.closures if _frames(c) not in pairs] + added

    def pose(self) -> Array | None:
        """The keyframe "home", or the first, or home."""
        first = next(iter(self.keyframes.values()), self.home)
        return self.keyframes.get("home", first)

    def wanted(self) -> tuple[str, ...]:
        """Joints that the file would have as coordinates: those that it marks, else those that it drives."""
        return (*self.moved, *(self.actuated if self.independent is None else self.independent))

    def configuration(self, name: str | None) -> Array | None:
        """The keyframe of that name, or a ModelError; home for None."""
        if name is None:
            return self.home
        if name not in self.keyframes:
            raise ModelError(f"home: there is no keyframe {name!r}{hint(name, list(self.keyframes))}")
        return self.keyframes[name]


def _frames(closure: AnyClosure) -> frozenset[str] | int:
    """The frames that a closure holds together; of a coupling what is its own."""
    if isinstance(closure, CouplingClosure):
        return id(closure)  # equals no other's, so that couplings add up
    return frozenset((closure.frame1, closure.frame2))


def check_base(base: str | None) -> None:
    """Refuse what is neither None, "fixed" nor "free"."""
    if base is not None:
        check_choice("base", base, BASES)


def named(what: str, names: Iterable[str]) -> list[str]:
    """One entry of `left_out` that lists where the part is; none where it is nowhere."""
    found = list(dict.fromkeys(names))
    return [f"{what} ({', '.join(found)})"] if found else []


def tell_left_out(left_out: Iterable[str], where: str, strict: bool) -> tuple[str, ...]:
    """Warn once of the parts that are not simulated, or refuse them.

    Raises
    ------
    ModelError
        Where `strict` and there are any.
    """
    if not isinstance(strict, bool):
        raise OptionError(f"strict = {strict!r} must be True or False")
    parts = tuple(left_out)
    if not parts:
        return parts
    brief = "; ".join(textwrap.shorten(part, 120, placeholder=" …)") for part in parts)
    if strict:
        raise ModelError(f"{where}: strict=True, and these parts of it are not simulated: {brief}")
    warn(f"{where}: not simulated: {brief}", ModelWarning)
    return parts
