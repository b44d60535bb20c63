"""Derivatives as the compiled kernel returns them, and their sums by parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...dynamics.derivatives import Accelerations, Derivatives
from ...dynamics.discrete import STAGES
from ...dynamics.parameters import Parameters, lifts_of, torques_by
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..dynamics.measures import weighed


@dataclass(frozen=True)
class Slopes:
    """What the kernel found at N states; rows of those that are not `good` hold nothing.

    Attributes
    ----------
    good : ndarray of bool (N,)
    udot : ndarray (N, m)
    rows : ndarray (N, m, 2m + nv)
        ∂u̇ by y, u and τ.
    G, dv_dy : ndarray (N, nv, m)
    whole : Accelerations or None
        (N, nv) and (N, nv, m), where they were asked for.
    """

    good: NDArray[np.bool_]
    udot: Array
    rows: Array
    G: Array
    dv_dy: Array
    whole: Accelerations | None = None

    def of_state(self, i: int | slice | NDArray[np.bool_]) -> Derivatives:
        """Those of a state, or of several with their number as the first axis."""
        m, rows = self.G.shape[2], self.rows[i]
        by_y, by_v, by_tau = rows[..., :m], rows[..., m : 2 * m], rows[..., 2 * m :]
        return Derivatives(self.udot[i], by_y, by_v, by_tau, self.G[i], self.dv_dy[i])


@dataclass(frozen=True)
class Stages:
    """The states at the stages of N steps, four rows to a step.

    Attributes
    ----------
    t : ndarray (4 N,)
        s.
    q, v, a : ndarray (4 N, nq), (4 N, nv), (4 N, nv)
    G, dv_dy : ndarray (4 N, nv, m)
    """

    t: Array
    q: Array
    v: Array
    a: Array
    G: Array
    dv_dy: Array

    @classmethod
    def room(cls, times: Array, nq: int, nv: int, m: int) -> Stages:
        """Room for those of steps between times, s."""
        steps, n = np.diff(times), 4 * (len(times) - 1)
        t = times[:-1, None] + np.array(STAGES) * steps[:, None]
        shapes = ((n, nq), (n, nv), (n, nv), (n, nv, m), (n, nv, m))
        return cls(t.ravel(), *(np.empty(shape) for shape in shapes))

    def arrays(self) -> dict[str, Array]:
        """Where the kernel writes them."""
        names = ("stage_q", "stage_v", "stage_a", "stage_G", "stage_v_y")
        return dict(zip(names, (self.q, self.v, self.a, self.G, self.dv_dy), strict=True))

    def of(self, first: int, last: int) -> Stages:
        """Those of some of the steps."""
        return Stages(*(getattr(self, field.name)[4 * first : 4 * last] for field in fields(Stages)))


@dataclass(frozen=True)
class Taken:
    """N steps that were taken.

    Attributes
    ----------
    good : ndarray of bool (N + 1,)
        Whether a state, and the step that begins there, are.
    G, dv_dy : ndarray (N + 1, nv, m)
        At the states.
    q, v : ndarray (N + 1, nq), (N + 1, nv)
        The states that were reached.
    stages : Stages or None
    """

    good: NDArray[np.bool_]
    G: Array
    dv_dy: Array
    q: Array
    v: Array
    stages: Stages | None


class Pulled(NamedTuple):
    """What multiplies changes before some steps, and what acts on them.

    Attributes
    ----------
    rows : ndarray (k, 2m)
        Of (η, u) before the first.
    by_tau : ndarray (N, k, nv)
        Of the torques held over each step.
    by_stage : ndarray (N, k, 4, nv) or None
        Of the torques at each stage.
    by_drive : ndarray (N, k, 5, 3, driven) or None
        Of y, ẏ and ÿ of driven ones at each stage, and at the end of the step.
    """

    rows: Array
    by_tau: Array
    by_stage: Array | None
    by_drive: Array | None


def by_parameters(mechanism: Mechanism, parameters: Parameters, stages: Stages, weights: Array) -> Array:
    """Σ λᵀ ∂(τ − M a − C)/∂p over stages of steps, (parameters,).

    Parameters
    ----------
    weights : ndarray (N, nv)
        λ.
    """
    by = np.zeros(len(parameters.names))
    if parameters.bodies or parameters.gravity:
        found = weighed(mechanism, stages.q, stages.v, stages.a, weights)
        assert found is not None  # the stages are the kernel's
        for i, joint, share in parameters.bodies:
            by[i] = -found[0][joint] @ share  # what is weighed is M a + C
        for i, k in parameters.gravity:
            by[i] = -found[1][k]
            for lift in lifts_of(mechanism):  # what is lifted has no weight to vary
                along = (lift.along(mechanism, q, k) for q in stages.q)
                by[i] += sum(map(np.dot, weights, along))
    for i, k in parameters.armature:
        by[i] = -weights[:, k] @ stages.a[:, k]  # a rotor adds to M's diagonal alone
    for i, (what, force) in parameters.forces:
        at, torque = torques_by(mechanism, what, force, stages.q, stages.v)
        by[i] = np.einsum("nk,nk->", weights[:, at], torque)
    return by
