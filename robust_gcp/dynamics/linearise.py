"""The equations of motion (3) linearised at a state, and the largest step of RK4 there.

RK4 multiplies a motion e^{λt} in each step h by R(hλ), R(z) = 1 + z + z²/2 + z³/6 + z⁴/24. A motion that
does not grow stays bounded as long as |R(hλ)| ≤ 1: to |hλ| = 2.785 on the negative real axis, to
2√2 = 2.828 on the imaginary one. Source: Hairer, Wanner, Solving Ordinary Differential Equations II, IV.2.
"""

from __future__ import annotations

import cmath
import functools
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelError, NonFiniteError, NotCertifiedError
from ..maps.choice import MapChoice
from ..mechanism.differences import FORWARD, differences
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .chart_derivatives import chart_derivatives
from .derivatives import PointDerivatives
from .equations import EquationsOfMotion
from .loads import Torques, Wrench, one_torque
from .prescribed.drive import Drive, checked_motions
from .prescribed.driven import driving
from .prescribed.motion import Motion
from .problem import Problem, initial_value_problem

log = logging.getLogger(__name__)

DIRECTIONS = 16
"""Of the Krylov space in which a stiff motion is looked for: it stands apart from all others."""

SETTLED = 0.1
"""Residual of an eigenvalue found in it, relative to the eigenvalue, at which it is believed."""


@dataclass(frozen=True)
class Linearisation:
    """δẋ = A δx about a state x = (y, ẏ).

    Attributes
    ----------
    A : ndarray (2m, 2m)
        [[0, I], [∂ÿ/∂y, ∂ÿ/∂ẏ]], 1/s and 1/s². Of joints on groups δy is w in q ⊕ w and ẏ the velocity u,
        δẇ = δu + ½ [w, u].
    eigenvalues : ndarray of complex (2m,)
        1/s, fastest first.
    """

    A: Array
    eigenvalues: NDArray[np.complexfloating[Any]]

    @classmethod
    def of(cls, A: Array) -> Linearisation:
        """With its eigenvalues."""
        eigenvalues = np.linalg.eigvals(A).astype(complex)
        return cls(A, eigenvalues[np.argsort(-np.abs(eigenvalues))])

    @property
    def limiting(self) -> complex:
        """The eigenvalue that limits the step of RK4, 1/s; 0 where none does."""
        value = complex(min(self.eigenvalues, key=stable_step, default=0j))
        return value if math.isfinite(stable_step(value)) else 0j

    @property
    def largest_stable_step(self) -> float:
        """The largest h with |R(hλ)| ≤ 1 for all λ that do not grow, s; infinite where none limits it."""
        return stable_step(self.limiting)


class ReducedJacobian:
    """∂ẋ/∂x of the equations of motion at (t, x), for the implicit steppers.

    By forward differences of the right-hand side, whatever the explicit map, the closures and the torques
    are. Of the state (y, ẏ, W) only y and ẏ are moved, and ∂ẏ/∂x is known.

    Parameters
    ----------
    equations : EquationsOfMotion
    central : bool
        Central differences, twice the work for errors of ε^⅔ instead of ε^½.
    rate : callable (t, x) -> ẋ, optional
        The same right-hand side by other means.
    """

    def __init__(
        self,
        equations: EquationsOfMotion,
        central: bool = False,
        rate: Callable[[float, Array], Array] | None = None,
    ) -> None:
        self._equations, self._central = equations, central
        self._rate = equations if rate is None else rate
        self._unit = equations.mechanism.units[equations.mechanism.iv_independent]

    def __call__(self, t: float, x: Array) -> Array:
        """(n, n) for a state of n numbers."""
        m = self._equations.m
        # in charts ẏ depends on y too
        known = m if len(self._equations.mechanism.numbers) == m else 0
        rest = x[2 * m :]

        def rate(state: Array) -> Array:
            return self._rate(t, np.concatenate([state, rest]))[known:]

        base = rate(x[: 2 * m])
        speed = np.abs(x[m : 2 * m])
        # a force that ẏ does not change rounds to ε ÿ: ẏ is moved far enough to rise above that
        ydd = base[m - known : 2 * m - known]
        pace = np.maximum(np.maximum(self._unit, speed), np.sqrt(self._unit * np.abs(ydd)))
        found = differences(rate, x[: 2 * m], np.concatenate([self._unit, pace]), self._central, base)
        jacobian = np.zeros((len(x), len(x)))
        jacobian[:m, m : 2 * m] = np.eye(m)
        jacobian[known:, : 2 * m] = found
        return jacobian


def linearise(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    torque: Torques | None = None,
    t: float = 0.0,
    mode: ArrayLike | None = None,
    wrenches: Sequence[Wrench] = (),
    drive: Mapping[str, Motion] | None = None,
) -> Linearisation:
    """The reference of `robust_gcp.linearise`, where its arguments are told and checked.

    By the analytic `derivatives`; by central differences of the right-hand side where there are none: for
    ellipsoid joints, beside modes that pass each other, and beside joints that are driven.
    """
    applied = one_torque(mechanism, torque, wrenches)
    drives = None
    if drive is not None:
        motions = checked_motions(mechanism, drive, np.array([t, t + 1.0]))
        mechanism = driving(mechanism, tuple(motions), q)
        drives = Drive(mechanism, motions, t)
    motion = initial_value_problem(
        mechanism, q, v, mode, applied, MapChoice(error_controlled=True), drive=drives
    )
    if drives is not None:
        free = np.concatenate([drives.free, mechanism.m + drives.free])
        return Linearisation.of(slopes_at(motion, t, central=True)[np.ix_(free, free)])
    try:
        slopes = PointDerivatives(motion, applied).at_start(t)
    except (ModelError, NotCertifiedError) as missing:
        log.info("%s: linearised by differences: %s", mechanism.name, missing)
        return Linearisation.of(slopes_at(motion, t, central=True))
    m, point = mechanism.m, motion.start.point
    here = chart_derivatives(mechanism, point, point, slopes.dv_dy)
    A = np.block([[here.rate_by_y, np.eye(m)], [slopes.da_dy, slopes.da_dv]])
    return Linearisation.of(A)


def slopes_at(motion: Problem, t: float, central: bool) -> Array:
    """A at the start of a motion by differences, (2m, 2m)."""
    m, y = motion.mechanism.m, motion.start.point.y
    with np.errstate(all="ignore"):  # what is not finite is told below
        A = ReducedJacobian(motion.equations, central)(t, motion.x)[: 2 * m, : 2 * m]
    if not np.all(np.isfinite(A)):
        raise NonFiniteError(f"the linearisation at y = {y} is not finite", y)
    return A


def limiting_eigenvalue(
    motion: Problem,
    step: float,
    push: Callable[[Array], Array] | None = None,
    rate: Callable[[float, Array], Array | None] | None = None,
) -> complex:
    """The eigenvalue that limits a step of RK4 at the start of a motion, 1/s; 0 where none was found.

    From `DIRECTIONS` + 1 right-hand sides, however many the coordinates are: Arnoldi's method on δẋ = A δx
    with y in units of one and ẏ in such units per step, A's products by forward differences. Source: Saad,
    Numerical Methods for Large Eigenvalue Problems, 6.2.

    Parameters
    ----------
    motion : Problem
    step : float
        s.
    push : callable (2m,) -> (m,), optional
        What δ(y, ẏ) adds to ÿ besides the motion's own equations.
    rate : callable (t, x) -> ẋ or None, optional
        These equations by other means; None where they cannot tell.
    """
    m, x = motion.mechanism.m, motion.x
    unit = motion.mechanism.units[motion.mechanism.iv_independent]
    size = np.concatenate([unit, unit / step])

    f = motion.equations if rate is None else rate

    def moved(state: Array) -> Array:
        found = f(0.0, np.concatenate([state, x[2 * m :]]))
        return np.full(2 * m, np.nan) if found is None else found[: 2 * m]

    with np.errstate(all="ignore"):  # what is not finite says nothing
        base = moved(x[: 2 * m])
        first = np.random.default_rng(0).normal(size=2 * m)  # always the same: so must be what is warned of
        basis = [first / np.linalg.norm(first)]
        H = np.zeros((DIRECTIONS + 1, DIRECTIONS))
        for k in range(DIRECTIONS):
            small = FORWARD / float(np.abs(basis[k]).max())  # as far as the one that moves most may go
            change = (moved(x[: 2 * m] + small * size * basis[k]) - base) / small
            if push is not None:
                change[m:] += push(size * basis[k])
            w = step * change / size
            for j, direction in enumerate(basis):
                H[j, k] = direction @ w
                w = w - H[j, k] * direction
            H[k + 1, k] = np.linalg.norm(w)
            if not np.isfinite(H[k + 1, k]):
                return 0j
            basis.append(w / max(H[k + 1, k], np.finfo(float).tiny))  # 0: invariant already
    values, vectors = np.linalg.eig(H[:-1])
    residuals = H[-1, -1] * np.abs(vectors[-1])  # of Ritz pairs, from Hessenberg's last row alone
    settled = [complex(z) / step for z, r in zip(values, residuals, strict=True) if r <= SETTLED * abs(z)]
    return min(settled, key=stable_step, default=0j)


def stable_step(eigenvalue: complex) -> float:
    """The largest step, s, with which RK4 does not let e^{λt} grow; infinite for real λ ≥ 0.

    A motion that grows of itself is not stiff. If it oscillates as well, its oscillation limits the step.
    """
    if eigenvalue.real >= 0.0:
        eigenvalue = complex(0.0, eigenvalue.imag)
    size = abs(eigenvalue)
    return rk4_reach(cmath.phase(eigenvalue)) / size if size > 0.0 else math.inf


@functools.lru_cache(maxsize=1024)
def rk4_reach(angle: float) -> float:
    """The largest |z| along the ray z = |z| e^{i angle} in the left half-plane with |R(z)| ≤ 1.

    R(z) = Σ zᵏ/k!, k ≤ 4: |R|² − 1 is a polynomial in |z|, which has one root between 1 and 4.
    """
    R = [cmath.rect(1.0 / math.factorial(k), k * angle) for k in range(4, -1, -1)]
    growth = np.convolve(R, np.conj(R)).real
    found = np.roots(growth[:-1])  # |R(0)| = 1: the root at 0 is left out
    return float(found[(np.abs(found.imag) < 1e-6) & (found.real > 1.0) & (found.real < 4.0)].real.min())
