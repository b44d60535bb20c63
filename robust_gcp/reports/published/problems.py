"""IFToMM's library of computational benchmarks, A01 to A05: motions, what is delivered, how it is judged.

Definitions: the library of the IFToMM committee for multibody dynamics and the paper that describes it
(González, Dopico, Lugrís, Cuadrado, Multibody System Dynamics 16, 2006). Known to be stated are the errors
that A02 allows; for the others those here are ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ... import Mechanism
from ...mechanism.tree.tree import Array
from ..contender import Scene
from ..work_precision import scenes
from ..work_precision.benchmarks import ANDREWS_JOINTS
from ..work_precision.reduced import GRAVITY
from ..work_precision.references import SLOW_CAP, SLOW_STEPS, Motion, of_pendulum, times_of

CRANK = 0.007
"""Of Andrews' mechanism, m."""

STIFF_STEPS = (75, 80, 100, 125, 150, 200, 250)
"""In each output interval, of A05 over 10 s: RK4 is stable from 75 on."""

Delivered = Callable[[Mechanism, Array, Array], Array]
"""Of q (N, nq) and v (N, nv): what the results file holds at each time, (N, columns)."""


@dataclass(frozen=True)
class Problem:
    """A benchmark of the library."""

    name: str
    title: str
    motion: Callable[[], Motion]  # its own duration, 401 outputs
    columns: tuple[str, ...]  # of the results file, after the time
    delivered: Delivered
    allowed: tuple[float, float] = (1e-3, 1e-6)  # errors of the columns, low and high precision, m and m/s
    stated: bool = False  # whether the library states them
    conserves: bool = True  # whether its energy is constant


def pendulum() -> Motion:
    """A01: a point of 1 kg on a bar of 1 m without mass, let go where the bar is level, to the left."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
    hinge = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "theta")
    model.appendBodyToJoint(
        hinge, pin.Inertia(1.0, np.array([1.0, 0.0, 0.0]), np.zeros((3, 3))), pin.SE3.Identity()
    )
    mechanism = Mechanism.from_pinocchio(model, [], ["theta"], home=np.array([np.pi]), name="pendulum")
    scene = Scene("pendulum", mechanism, mechanism.home, np.zeros(1), times_of(10.0))
    return of_pendulum("simple pendulum (A01)", scene, 1.0, GRAVITY, np.ones(1))


def _tip(mechanism: Mechanism, q: Array, v: Array) -> Array:
    return np.column_stack([np.cos(q[:, 0]), np.sin(q[:, 0])])


def _tip_and_rate(mechanism: Mechanism, q: Array, v: Array) -> Array:
    rate = v[:, 0] * np.array([-np.sin(q[:, 0]), np.cos(q[:, 0])])
    return np.column_stack([_tip(mechanism, q, v), rate.T])


def _crank_end(mechanism: Mechanism, q: Array, v: Array) -> Array:
    """F, the end of Andrews' crank."""
    beta = q[:, mechanism.joint(ANDREWS_JOINTS[0]).idx_q]
    return CRANK * np.column_stack([np.cos(beta), np.sin(beta)])


def _third_joint(mechanism: Mechanism, q: Array, v: Array) -> Array:
    """P3, at (1, −1, 0) in the beginning: the first rod turns about y, the second about its own z."""
    first, second = q[:, 0], q[:, 1]
    far = 1.0 + np.sin(second)
    return np.column_stack([np.cos(first) * far, -np.cos(second), -np.sin(first) * far])


def _slider(mechanism: Mechanism, q: Array, v: Array) -> Array:
    return q[:, [mechanism.joint("s").idx_q]]


PROBLEMS = (
    Problem("A01", "simple pendulum, 10 s", pendulum, ("x", "y"), _tip),
    Problem(
        "A02",
        "40 four-bars in a row, 20 s",
        lambda: scenes.n_bars(40, 20.0, SLOW_STEPS, SLOW_CAP),
        ("x", "y", "vx", "vy"),
        _tip_and_rate,
        (1e-1, 1e-3),
        stated=True,
    ),
    Problem(
        "A03", "Andrews' mechanism, 0.05 s", lambda: scenes.andrews(0.05),
        ("x", "y"), _crank_end, (1e-5, 1e-8), conserves=False,
    ),
    Problem("A04", "Bricard's mechanism, 10 s", scenes.bricard, ("x", "y", "z"), _third_joint),
    Problem(
        "A05", "flyball governor, 10 s", lambda: scenes.flyball(10.0, STIFF_STEPS),
        ("s",), _slider, (1e-4, 1e-7), conserves=False,
    ),
)  # fmt: skip
