"""A step of a motion with its derivatives, and what acts over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...dynamics.change_of_coordinates import Slope
from ...dynamics.derivatives import PointDerivatives
from ...dynamics.discrete import Parametric
from ...dynamics.equations import TorqueFunction
from ...dynamics.modes.taylor_series import circles_of
from ...dynamics.prescribed.constrained_derivatives import DrivenDerivatives, HeldDerivatives
from ...dynamics.prescribed.drive import Drive
from ...dynamics.problem import Problem
from ...dynamics.torque_feedback import TorqueSlopes
from ...kernel.derivatives.derivations import derivation
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array


@dataclass(frozen=True)
class Acting:
    """What acts over a step, and how that changes.

    Attributes
    ----------
    torque : callable, array_like (nv,) or None
    function : TorqueFunction or None
        The torque again, where its slopes are wanted.
    slopes : callable, optional
        See `derivatives`.
    by_more : callable (Stage) -> (m, k), optional
        ∂u̇ by parameters at a stage.
    held : ndarray (k, nv), optional
        Rows of v that are at rest, see `HeldDerivatives`.
    drive : Drive, optional
        Joints that move as prescribed, those that stand for a changing geometry among them.
    """

    torque: Any = None
    function: TorqueFunction | None = None
    slopes: TorqueSlopes | None = None
    by_more: Parametric | None = None
    held: Array | None = None
    drive: Drive | None = None

    def slopes_of(self, motion: Problem, sparing: bool = False) -> PointDerivatives:
        """The derivatives along a motion."""
        others = motion, self.function, self.slopes, circles_of(motion.mechanism), sparing
        if self.drive is not None:
            return DrivenDerivatives(self.drive, *others)
        if self.held is None:
            return PointDerivatives(*others)
        # what stands for a changing geometry the kernel holds by itself
        mechanism = motion.mechanism
        kernel = None if mechanism.still else derivation(mechanism, motion.start.point.q)
        return HeldDerivatives(self.held, *others, None if kernel is None else kernel.at_state)


@dataclass(frozen=True)
class Moved:
    """A step of a motion with its derivatives.

    Attributes
    ----------
    A : ndarray (2m, 2m)
        δ(η, u) after it by δ(η, u) before it, each in its own coordinates.
    B, P : ndarray (2m, nv), (2m, k)
        By torques that are added over it, and by parameters.
    begun, ended : Mechanism
        In the coordinates at its start and end.
    first, last : Slope
        There, in these coordinates.
    q, v : ndarray (nq,), (nv,)
        Its end.
    D : ndarray (2m, 15 driven) or None
        By prescribed motions, see `Step.jacobians`; where the coordinates stay the same.
    """

    A: Array
    B: Array
    P: Array
    begun: Mechanism
    ended: Mechanism
    first: Slope
    last: Slope
    q: Array
    v: Array
    D: Array | None = None

    def then(self, more: Moved) -> Moved:
        """One step after this one, which may begin in other coordinates."""
        A, B, P = self.A, self.B, self.P
        if more.begun is not self.ended:
            A, B, P = (self.last.change(more.begun.iv_independent) @ part for part in (A, B, P))
        A, B, P = more.A @ A, more.A @ B + more.B, more.A @ P + more.P
        return Moved(A, B, P, self.begun, more.ended, self.first, more.last, more.q, more.v)

    def told_in(self, mechanism: Mechanism) -> Moved:
        """The same in a mechanism's coordinates at both ends."""
        A, B, P, first, last = self.A, self.B, self.P, self.first, self.last
        own = mechanism.iv_independent
        if self.ended is not mechanism:
            A, B, P = (last.change(own) @ part for part in (A, B, P))
            last = last.seen_in(own)
        if self.begun is not mechanism:
            # from the right: A takes δ(η, u) of the start, W⁻¹ δ(η', u')
            A = np.linalg.solve(first.change(own).T, A.T).T
            first = first.seen_in(own)
        return Moved(A, B, P, mechanism, mechanism, first, last, self.q, self.v)
