"""What a machine has besides its loops: stops, dry friction and locks, as a user names them.

Each acts on one number r(q) = q_joint − ratio q_other − Σ c q, of joints with one number each: on a joint,
or on a sum of joints such as the angle of a planar loop's cut joint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pinocchio as pin

from ..checks import check_callable, check_finite, check_number, check_text, listed, shown
from ..errors import ModelError, OptionError
from .assembly.ranges import ranges_of
from .loops import ClosedLoops
from .tree.joints import Joint


@dataclass(frozen=True)
class _Part:
    joint: str
    other: str | None = field(default=None, kw_only=True)
    ratio: float = field(default=0.0, kw_only=True)
    more: Sequence[tuple[str, float]] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        kind = type(self).__name__
        check_text(f"{kind}: joint", self.joint)
        label = f"{kind} {self.joint!r}"
        if self.other is not None:
            check_text(f"{label}: other", self.other)
        check_finite(f"{label}: ratio", self.ratio)
        if (self.other is None) != (self.ratio == 0.0):
            raise OptionError(
                f"{label}: other = {shown(self.other)} and ratio = {self.ratio}: give both, r = q_joint − "
                "ratio q_other, or none"
            )
        more = listed(self.more, f"{label}: more", "pairs of joint and number", OptionError)
        try:
            further = tuple((str(name), float(value)) for name, value in more)
        except (TypeError, ValueError) as error:
            raise OptionError(
                f"{label}: more = {shown(self.more)} must be pairs of joint and number"
            ) from error
        for name, value in further:
            check_finite(f"{label}: more, {name}", value)
        object.__setattr__(self, "more", further)
        if len(set(self.joints)) < len(self.joints):
            raise ModelError(f"{label}: a joint counts twice in {', '.join(self.joints)}")

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints of its row."""
        second = () if self.other is None else (self.other,)
        return (self.joint, *second, *(name for name, _ in self.more))

    @property
    def weights(self) -> tuple[float, ...]:
        """∂r/∂q of these."""
        second = () if self.other is None else (-float(self.ratio),)
        return (1.0, *second, *(-value for _, value in self.more))


@dataclass(frozen=True)
class Stop(_Part):
    """lower ≤ r ≤ upper: a rigid stop with Newton's restitution, or a springy one.

    Rigid: ṙ⁺ = −restitution ṙ⁻ at an impact, and a force that only pushes while it rests. Springy
    (Hunt–Crossley): force = stiffness δ (1 + damping δ̇), δ the depth.

    Parameters
    ----------
    joint : str
        A joint with one number; dependent ones of loops too.
    lower, upper : float, optional
        rad or m; at least one of them.
    restitution : float
        From 0 to 1, of a rigid stop. Impacts slower than 1e-6 m/s or rad/s are plastic.
    stiffness : float, optional
        N m/rad or N/m; given, the stop is springy.
    damping : float
        s/m or s/rad, of a springy stop.
    other, ratio, more
        r = q_joint − ratio q_other − Σ value q, `more` = ((joint, value), …).

    Raises
    ------
    OptionError, ModelError
        For numbers that make no stop.
    """

    lower: float | None = None
    upper: float | None = None
    restitution: float = 0.0
    stiffness: float | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        label = f"Stop {self.joint!r}"
        if self.lower is None and self.upper is None:
            raise OptionError(f"{label}: give lower, upper or both")
        for name in ("lower", "upper", "stiffness"):
            if getattr(self, name) is not None:
                check_finite(f"{label}: {name}", getattr(self, name))
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise OptionError(
                f"{label}: lower = {self.lower} must be below upper = {self.upper}; what may not move at all "
                "is a Lock"
            )
        check_number(f"{label}: restitution", self.restitution)
        if not 0.0 <= self.restitution <= 1.0:
            raise OptionError(f"{label}: restitution = {self.restitution} must lie from 0 to 1")
        check_finite(f"{label}: damping", self.damping)
        if self.stiffness is None and self.damping != 0.0:
            raise OptionError(f"{label}: damping goes with stiffness; a rigid stop has restitution")
        if self.stiffness is not None and self.restitution != 0.0:
            raise OptionError(f"{label}: restitution is a rigid stop's; a springy one loses by damping")
        if (self.stiffness is not None and self.stiffness <= 0.0) or self.damping < 0.0:
            raise OptionError(f"{label}: stiffness must be positive, and damping not negative")


@dataclass(frozen=True)
class JointFriction(_Part):
    """Dry friction: |f| ≤ F, f = −F sign(ṙ) while it slips, F = bound + μ |n| or bound + μ r |n|.

    n is the resultant force that the joint transmits across its axis, N, as `Trajectory.reaction` has it.
    The force along the axis (the thrust of a revolute joint) and moments (tilting of a slide in its guide)
    have no part in it; nor has what is undetermined, such as the force across the plane of a planar loop.
    n depends on the friction itself: where that has not one solution, a run stops (Painlevé's paradox).

    Parameters
    ----------
    joint : str
        A joint with one number; dependent ones of loops too.
    bound : float
        N m or N, not negative: the part that stays as it is, of seals or of preload.
    coefficient : float, optional
        μ of a revolute or prismatic joint, not negative. Such runs have no derivatives, and no
        torques that are held over steps.
    radius : float, optional
        r, m, of a revolute joint's bearing; goes with `coefficient`.
    reaction : str, optional
        Whose reaction counts, as `Trajectory.reaction` takes it, where it is not that of `joint`: a cut
        joint, "frame1-frame2", whose angle is the sum that the row is.
    other, ratio, more
        As for `Stop`.

    Raises
    ------
    OptionError, ModelError
    """

    bound: float = 0.0
    coefficient: float | None = None
    radius: float | None = None
    reaction: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        label = f"JointFriction {self.joint!r}"
        for name in ("coefficient", "radius"):
            value = getattr(self, name)
            if value is None:
                continue
            check_finite(f"{label}: {name}", value)
            if value < 0.0:
                raise OptionError(f"{label}: {name} = {value} must not be negative")
        if self.reaction is not None:
            check_text(f"{label}: reaction", self.reaction)
        if self.radius is not None and self.coefficient is None:
            raise OptionError(f"{label}: radius goes with a coefficient; give it, or leave radius out")
        check_finite(f"{label}: bound", self.bound)
        if self.bound < 0.0:
            raise OptionError(f"{label}: bound = {self.bound} must not be negative")


@dataclass(frozen=True)
class Lock(_Part):
    """ṙ = 0 from `start` to `end`: a brake, a latch; with `other` a clutch. What moves then is stopped.

    With `when` it closes at the first zero of a function after `start`, and holds from there to `end`: no
    further zero opens it.

    Parameters
    ----------
    joint : str
        A joint with one number; dependent ones of loops too.
    start, end : float, optional
        s, on the run's clock; to the end of the run where `end` is left out.
    when : rg.Event or callable (t, q, v) -> float, optional
        Whose first zero, in its direction, closes it. Its `terminal` is not looked at; nor is a zero within
        1e-9 steps of the run's start.
    other, ratio, more
        As for `Stop`; q̇_joint = ratio q̇_other in a clutch.

    Raises
    ------
    OptionError, ModelError
    """

    start: float = 0.0
    end: float | None = None
    when: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        label = f"Lock {self.joint!r}"
        check_callable(f"{label}: when", self.when, "(t, q, v)")
        check_number(f"{label}: start", self.start)
        if self.end is not None:
            check_number(f"{label}: end", self.end)
        if not self.start < (float("inf") if self.end is None else self.end):
            raise OptionError(f"{label}: start = {self.start} must be before end = {self.end}")


Part = Stop | JointFriction | Lock


def parts_given(parts: Any) -> list[Part]:
    """A list of parts, or an OptionError."""
    given = listed(parts, "joints", "Stop, JointFriction and Lock", OptionError, Part)
    for part in given:
        if not isinstance(part, Part):
            raise OptionError(
                f'joints: {shown(part)} is no Stop, JointFriction or Lock, as Stop("q1", lower=0.0)'
            )
    return given


def parts_of_file(
    loops: ClosedLoops, of_tendons: Sequence[Part], bounce: dict[str, float], limits: bool, friction: bool
) -> list[Part]:
    """Rigid stops at the ranges of joints, and their dry friction, as the model's file has them.

    Parameters
    ----------
    bounce : dict of str to float
        Restitution by joint, of those that are not plastic.
    """
    found = [part for part in of_tendons if (limits if isinstance(part, Stop) else friction)]
    if limits:
        ranges = ranges_of(loops)
        for joint, *bounds in zip(ranges.names, ranges.low.tolist(), ranges.high.tolist(), strict=True):
            low, high = (bound if math.isfinite(bound) else None for bound in bounds)  # an open end
            found.append(Stop(joint, lower=low, upper=high, restitution=bounce.get(joint, 0.0)))
    if friction:
        dry = loops.own_model.upperDryFrictionLimit
        rubs = rubbing(loops.own_model, loops.joints)
        found += [JointFriction(joint.name, float(dry[joint.idx_v])) for joint in rubs]
    return found


def rubbing(model: pin.Model, joints: Sequence[Joint]) -> list[Joint]:
    """Joints with one number that the model gives dry friction."""
    dry = model.upperDryFrictionLimit
    return [joint for joint in joints if joint.single and dry[joint.idx_v] > 0.0]
