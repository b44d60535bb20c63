"""All of the projected equations of motion at a state, or at many, in one call."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_mechanism
from ...dynamics.loads import Torques
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .accelerations import derivatives, forward_dynamics
from .at_states import AtStates


@dataclass(frozen=True)
class MotionPoint:
    """M_r u̇ + b = Gᵀ τ, v = G u, a = G u̇ + g; of many states N is the first axis of each.

    Attributes
    ----------
    G, g : ndarray (nv, m), (nv,)
        Eq. (4).
    M_r : ndarray (m, m)
        Gᵀ M G.
    b : ndarray (m,)
        Gᵀ (M g + C − τ_own), with the mechanism's own springs, dampers and other forces.
    by_tau : ndarray (m, nv)
        M_r⁻¹ Gᵀ: how u̇ changes with torques.
    udot : ndarray (m,)
        Under the torques that were given.
    """

    G: Array
    g: Array
    M_r: Array
    b: Array
    by_tau: Array
    udot: Array


def motion_point(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
) -> MotionPoint:
    """G, g, the reduced mass and bias, M_r⁻¹ Gᵀ and u̇, also at singular configurations on a mode.

    Parameters
    ----------
    mechanism, q, v, tau, mode, t
        As of `forward_dynamics`, one state or many.

    Raises
    ------
    StateError, SimulationError, ModelError
        As `derivatives`.
    """
    check_mechanism(mechanism, Mechanism, "motion_point")
    found = derivatives(mechanism, q, v, tau, mode, t)
    G, by_tau, own = found.G, found.da_dtau, mechanism.iv_independent
    u = AtStates.of(mechanism, q, v, None).v[:, own].reshape(found.udot.shape)
    M_r = np.linalg.inv(by_tau[..., own])  # the columns of y, where Gᵀ = I
    unforced = forward_dynamics(mechanism, q, v, None, mode, t) if tau is not None else found.udot
    b = -np.einsum("...ij,...j->...i", M_r, unforced)
    g = np.einsum("...nm,...m->...n", found.dv_dy, u)  # the rate of G u along the motion, u held
    return MotionPoint(G, g, M_r, b, by_tau, found.udot)
