"""The closed form of the planar four-bar as an explicit map of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import OptionError, ToggleError
from ..mechanism.constraint.closures import PointClosure, frame_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import JointKind
from ..mechanism.tree.tree import Array
from .closed_form import FourBar
from .explicit import Point, Unaware
from .regular_path import RegularPath

PARALLEL = 1e-12
"""Sine of the angle between joint axes that still counts as parallel."""

DEAD = 1e-8
"""Distance from a dead point, rad, at which y no longer says where the linkage is: G ~ 1/√distance has
then lost four digits."""

NEAR = 0.1
"""Part of the distance to a dead point that one stage of a fixed step may cover: y turns back there as a
square root does, which a step of several times as much does not see."""


@dataclass(frozen=True)
class Drawing:
    """A mechanism read as the paper's four-bar: θ = sign · q + offset turns joint values into its angles.

    Attributes
    ----------
    lengths : tuple of float
        l0, l1, l2, l3, m.
    sign : ndarray (3,)
        ±1: sense of each joint about the common axis.
    offset : ndarray (3,)
        rad.
    """

    lengths: tuple[float, float, float, float]
    sign: Array
    offset: Array


def draw_four_bar(mechanism: Mechanism) -> Drawing:
    """Lengths, senses and offsets of a planar four-bar with a point closure between two chains 2 + 1.

    Raises
    ------
    OptionError
        When the mechanism is anything else.
    """
    model = mechanism.own_model
    wrong = OptionError(
        f"method='closed_form' is for the planar four-bar: three parallel revolute joints, two of them in "
        f"a row, one point closure, the first joint independent; {mechanism.name!r} is not"
    )
    if (
        mechanism.nv != 3
        or any(joint.kind is not JointKind.REVOLUTE for joint in mechanism.joints)
        or len(mechanism.closures) != 1
        or not isinstance(mechanism.closures[0], PointClosure)
        or list(model.parents) != [0, 0, 1, 0]
        or mechanism.iv_independent.tolist() != [0]
    ):
        raise wrong
    tree, zero = mechanism.tree, np.zeros(3)
    tree.jacobians(zero)
    axes = tree.J[:, 3:].copy()
    normal = axes[0]
    if np.abs(np.cross(axes, normal)).max() > PARALLEL:
        raise wrong
    closure = mechanism.closures[0]
    tips = {}
    for name in (closure.frame1, closure.frame2):
        frame = frame_of(model, name, "closed form")
        joint = frame.parentJoint
        tips[joint] = tree.p[joint] + tree.R[joint] @ frame.placement.translation
    if set(tips) != {2, 3}:
        raise wrong
    ground = tree.p[3] - tree.p[1]
    ground -= normal * (normal @ ground)
    links = [tree.p[2] - tree.p[1], tips[2] - tree.p[2], tips[3] - tree.p[3]]
    l0 = float(np.linalg.norm(ground))
    if l0 == 0.0:
        raise wrong
    x = ground / l0
    z = np.cross(normal, x)
    flat = [(float(link @ x), float(link @ z)) for link in links]
    lengths = (l0, *(float(np.hypot(*p)) for p in flat))
    angles = [float(np.arctan2(p[1], p[0])) for p in flat]
    sign = np.sign(axes @ normal)
    offset = np.array([angles[0], angles[1] - angles[0], angles[2]])
    return Drawing((lengths[0], lengths[1], lengths[2], lengths[3]), sign, offset)


class FourBarMap(Unaware):
    """q = γ(y), G and g in closed form, smooth through every change point; no Newton, no K_d.

    Parameters
    ----------
    path : RegularPath
        For the counters.
    start : Point
        Chooses the assembly; its G does where both assemblies meet.
    error_controlled : bool
        Whether the stepper finds by itself that a step is too large beside a dead point.
    """

    def __init__(self, path: RegularPath, start: Point, error_controlled: bool = False) -> None:
        self.path, self.anchor, self._error_controlled = path, start, error_controlled
        self._drawing = draw_four_bar(path.mechanism)
        candidates = []
        for assembly in (1, -1):
            linkage = FourBar(*self._drawing.lengths, assembly)
            candidates.append((self._distance(linkage, start), linkage))
        self.linkage = min(candidates, key=lambda item: item[0])[1]
        self._interval = self._interval_of(start.y)
        theta = self._drawing.sign * start.q + self._drawing.offset
        apart = theta - self.linkage.evaluate(float(theta[0]))[0]
        self._turns = 2.0 * np.pi * np.round(apart / (2.0 * np.pi))

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y; ToggleError at a dead point, beyond it, or where a step may have passed it."""
        left = self._to_dead_point(self.anchor.y)
        try:
            point = self._point(self.linkage, y, ydot)
        except OptionError as error:
            raise ToggleError(f"closed form: {error}", y) from error
        if self._interval_of(y) != self._interval:
            raise ToggleError(
                f"closed form: from y = {self.anchor.y} the stepper jumped to {y}, beyond a dead point; "
                "use a smaller step, or another coordinate",
                y,
            )
        here = self._to_dead_point(y)
        if here <= DEAD:
            raise ToggleError(
                f"closed form: y = {y} is a dead point, where it turns back; use another coordinate", y
            )
        if not self._error_controlled and abs(float(y[0] - self.anchor.y[0])) > NEAR * min(left, here):
            raise ToggleError(
                f"closed form: at y = {y}, {here:.3g} rad beside a dead point, where y turns back, the step "
                "is too large to tell whether it is passed; use a smaller step, or another coordinate",
                y,
            )
        self.anchor = point
        return point

    def _interval_of(self, y: Array) -> tuple[int, int]:
        """Which of the intervals in reach y lies in; whole turns count as different ones at dead points."""
        low, high = self.linkage.reach
        turns = float(self._drawing.sign[0] * y[0] + self._drawing.offset[0]) / (2.0 * np.pi)
        return int(np.floor(turns)) if low > 0.0 else 0, int(np.floor(turns + 0.5)) if high < np.pi else 0

    def _to_dead_point(self, y: Array) -> float:
        """Distance of y in reach to the nearest dead point, rad; infinite where there is none."""
        low, high = self.linkage.reach
        angle = float(self._drawing.sign[0] * y[0] + self._drawing.offset[0])
        angle = abs(float(np.arctan2(np.sin(angle), np.cos(angle))))
        return min(angle - low if low > 0.0 else np.inf, high - angle if high < np.pi else np.inf)

    def _point(self, linkage: FourBar, y: Array, ydot: Array, near: Array | None = None) -> Point:
        """The point at y; q2 and q3 continuous from the start, or else nearest to those of `near`."""
        sign, offset = self._drawing.sign, self._drawing.offset
        about = None if near is None else sign * near + offset
        theta, rate, second = linkage.evaluate(float(sign[0] * y[0] + offset[0]), about)
        if near is None:
            theta = theta + self._turns
        G = (sign * sign[0] * rate)[:, None]
        curvature = sign * second
        one = np.ones(1)
        q = sign * (theta - offset)
        q[0] = y[0]  # to the last bit, which sign and offset do not keep
        return Point(y.copy(), ydot.copy(), q, G, curvature * float(ydot[0]) ** 2, curvature, one, one)

    def _distance(self, linkage: FourBar, start: Point) -> float:
        try:
            point = self._point(linkage, start.y, start.ydot, start.q)
        except OptionError:
            return np.inf
        # q decides; where the assemblies meet, at a change point, both have it and G decides
        return float(np.abs(point.q - start.q).max() + 1e-3 * np.abs(point.G - start.G).max())
