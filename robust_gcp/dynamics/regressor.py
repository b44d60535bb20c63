"""The equations of motion as they are linear in masses, centres of mass and inertias."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..checks import check_mechanism, checked_vector, is_table, of_each, require_finite, rows_like
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import in_v
from ..mechanism.tree.tree import Array
from ..mechanism.tree.workspace import whole_workspace
from .problem import initial_value_problem

OF_A_BODY = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Mass, kg; first moments, kg m; second moments about the joint, kg m²; in Pinocchio's order."""


@dataclass(frozen=True)
class Regressor:
    """Gᵀ (M a + C) = matrix · values, whatever the values.

    Attributes
    ----------
    matrix : ndarray (m, n), or (N, m, n) of many states
        Gᵀ Y, with Y π = M a + C.
    names : tuple of str (n,)
        `joint.m`, `joint.mx`, …, `joint.Izz` of the body on each joint, in the joint's frame; then
        `velocity.armature`, rotor inertia, kg m² or kg.
    values : ndarray (n,)
        π of the mechanism as it is.
    """

    matrix: Array
    names: tuple[str, ...]
    values: Array


class TorqueRegressor(threading.local):
    """Y (nv, n) with Y π = RNEA(q, v, a); one workspace a thread.

    Parameters
    ----------
    mechanism : Mechanism
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._model, self._data = mechanism.near, whole_workspace(mechanism.near)

    def matrix_at(self, q: Array, v: Array, a: Array) -> Array:
        """Y at (q, v, a)."""
        Y = np.array(pin.computeJointTorqueRegressor(self._model, self._data, q, v, a))
        return np.hstack([Y, np.diag(a)])  # rotors, which Pinocchio leaves out of it


def torque_regressor(mechanism: Mechanism) -> TorqueRegressor:
    """That of a mechanism, made once."""
    made: TorqueRegressor = mechanism.memo.once("torque regressor", lambda: TorqueRegressor(mechanism))
    return made


def regressor(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, udot: ArrayLike, mode: ArrayLike | None = None
) -> Regressor:
    """Gᵀ Y(q, v, G u̇ + g): the forces on the independent joints, by inertial parameters.

    matrix · values is what `inverse_dynamics` gives where no springs, dampers or drives act. Least squares
    over many states identifies the parameters that the motion tells apart.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,), or (N, nq), (N, nv)
        Closed, and K v = 0.
    udot : array_like (m,) or (N, m)
        Independent accelerations.
    mode : array_like, optional
        As in `simulate`, where q is singular.

    Returns
    -------
    Regressor

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start.
    """
    check_mechanism(mechanism, Mechanism, "regressor")
    m, joints, model = mechanism.m, mechanism.joints, mechanism.own_model
    names = [f"{joint.name}.{short}" for joint in joints for short in OF_A_BODY]
    names += [f"{component.name}.armature" for component in in_v(joints)]
    bodies = [np.asarray(model.inertias[joint.index].toDynamicParameters()) for joint in joints]
    values = np.concatenate([*bodies, np.asarray(model.armature)])

    def matrix_at(q: Array, v: Array, udot: Array) -> Array:
        wanted = checked_vector(udot, m, "udot", "m")
        point = initial_value_problem(mechanism, q, v, mode).start.point
        G = point.G
        Y = torque_regressor(mechanism).matrix_at(point.q, G @ point.ydot, G @ wanted + point.g)
        return require_finite(G.T @ Y, "the regressor")

    if is_table(q):
        given = (q, mechanism.nq, "q", "nq"), (v, mechanism.nv, "v", "nv"), (udot, m, "udot", "m")
        matrix = of_each(matrix_at, rows_like(*given), m, len(names))
    else:
        matrix = matrix_at(q, v, udot)  # type: ignore[arg-type]  # checked there
    return Regressor(matrix, tuple(names), values)
