"""Tendons and actuators as the plain arrays that the compiled kernel reads."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..mechanism.actuation.actuators import Actuator
from ..mechanism.actuation.muscle import Range
from ..mechanism.actuation.paths import BoundPath, Path, SumOfJoints
from ..mechanism.actuation.spatial_tendon import Line, Round
from ..mechanism.actuation.tendon_springs import TendonSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .structures import Arrays

SPRING, AFFINE, MUSCLE = range(3)
"""Laws in kernel/dynamics/pulls.h."""

STRAIGHT = -1


def drives_in_kernel(mechanism: Mechanism) -> bool:
    """Whether the kernel knows the paths of all actuators."""
    return all(actuator.along.in_kernel for actuator in mechanism.actuators)


def path_arrays(
    mechanism: Mechanism, springs: list[TendonSpring], turns: list[Array], arrays: Arrays
) -> None:
    """Springs along tendons, and the actuators where the kernel knows all of their paths.

    Parameters
    ----------
    turns : list of ndarray (3, 3)
        By which each joint's frame is turned to its axis.
    """
    actuators = mechanism.actuators if drives_in_kernel(mechanism) else ()
    described = _Paths(turns)
    pulls, pull_at = [], []
    for spring in springs:
        pull_at += [described.number(spring.path, spring.bound(mechanism)), SPRING, -1, -1]
        numbers = [spring.stiffness, spring.lower, spring.upper, spring.damping]
        pulls.append(_pull(1.0, numbers, None, None))
    actuation = mechanism.actuation
    for i, actuator in enumerate(actuators):
        assert actuation is not None  # of these actuators
        none = -1, None
        group, shared = next(((g, x) for g, (of, x) in enumerate(actuation.sharing) if i in of), none)
        law = AFFINE if actuator.muscle is None else MUSCLE
        pull_at += [described.number(actuator.along, actuation.paths[i]), law, i, group]
        pulls.append(_pull(actuator.gear, _law(actuator), actuator.force_range, shared))
    arrays.structure.paths, arrays.structure.pulls = len(described.path_at) // 4, len(pulls)
    arrays.integers(
        path_at=described.path_at, arm_at=described.arm_at, stretch_at=described.stretch_at, pull_at=pull_at
    )
    arrays.reals(arm=described.arm, stretch=described.stretch, pull=pulls)
    if actuation is not None:
        arrays.reals(effort=np.stack([actuation.low, actuation.high], axis=1))
    else:
        arrays.reals(effort=np.tile([-np.inf, np.inf], (mechanism.nv, 1)))


def _law(actuator: Actuator) -> list[float]:
    muscle = actuator.muscle
    if muscle is None:
        return [*actuator.gain, *actuator.bias]
    curves = muscle.lmin, muscle.lmax, muscle.vmax, muscle.fpmax, muscle.fvmax
    return [*muscle.lengths, *muscle.range, muscle.force, *curves]


def _pull(gear: float, numbers: list[float], *ranges: Range | None) -> list[float]:
    limits = [end for each in ranges for end in (each or (-np.inf, np.inf))]
    return [gear, *numbers, *[0.0] * (10 - len(numbers)), *limits]  # a muscle has ten


class _Paths:
    """Paths one after the other, each once."""

    def __init__(self, turns: list[Array]) -> None:
        self._turns, self._numbers = turns, dict[Path, int]()
        self.path_at, self.arm_at, self.arm = list[int](), list[int](), list[float]()
        self.stretch_at, self.stretch = list[int](), list[list[float]]()

    def number(self, path: Path, bound: BoundPath) -> int:
        """The number of a path."""
        if path not in self._numbers:
            self._numbers[path] = len(self._numbers)
            first = len(self.arm), len(self.stretch)
            if isinstance(bound, SumOfJoints):
                for iq, iv, arm in zip(bound.iq, bound.iv, bound.arms, strict=True):
                    self.arm_at += [int(iq), int(iv)]
                    self.arm.append(float(arm))
            else:
                assert isinstance(bound, Line)  # what `in_kernel` says
                for stretch in bound.stretches:
                    self._add(*stretch)
            sizes = len(self.arm) - first[0], len(self.stretch) - first[1]
            self.path_at += [first[0], sizes[0], first[1], sizes[1]]
        return self._numbers[path]

    def _on(self, joint: int, at: Array) -> list[float]:
        """A point in the kernel's axes of its joint."""
        return list(map(float, self._turns[joint].T @ at))

    def _add(self, share: float, a: int, at_a: Array, b: int, at_b: Array, wrap: Round | None) -> None:
        row: list[Any] = [share, *self._on(a, at_a), *self._on(b, at_b)]
        if wrap is None:
            self.stretch_at += [a, b, STRAIGHT, 0, -1]
            self.stretch.append([*row, *[0.0] * 16])  # radius, centre, axes and side of no wrap
            return
        axes = self._turns[wrap.joint].T @ wrap.place.rotation
        beside, side = (-1, [0.0] * 3) if wrap.side is None else (wrap.side[0], self._on(*wrap.side))
        self.stretch_at += [a, b, int(wrap.cylinder), wrap.joint, beside]
        centre = self._on(wrap.joint, wrap.place.translation)
        self.stretch.append([*row, wrap.radius, *centre, *map(float, axes.ravel()), *side])
