"""Optimal control with Crocoddyl: closed loops in minimal coordinates, also through singular configurations.

One node is one step of RK4 on the explicit equations (3), the motors' torques held over it. An explicit map
has several values at one y, so the data of each knot carry a map of their own: on its mode, where the knot
was evaluated last.

Needs the extra `control`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..checks import check_mechanism, check_positive
from ..dynamics.derivatives import PointDerivatives
from ..dynamics.discrete import differentiated_step
from ..dynamics.problem import Problem, set_out
from ..errors import OptionError, SimulationError, missing_extra
from ..kernel.derivations import derivation
from ..maps.grouped import GroupMap, joined
from ..mechanism.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..simulation.steppers import rk4_step

try:
    import crocoddyl
except ImportError as missing:
    raise missing_extra("optimal control needs crocoddyl", "crocoddyl", "control") from missing

LEAP = 0.5
"""Largest move of a coordinate at once between two evaluations of a knot, rad or m."""


def state_model(mechanism: Mechanism) -> Any:
    """Crocoddyl's state x = (y, u): independent coordinates and velocities, in the order of `independent`.

    Joints on groups, such as a floating base, have their numbers of q in y and body velocities in u; states
    are subtracted and added on the group.

    Returns
    -------
    crocoddyl.StateMultibody
        Of m independent velocities, without bodies.

    Raises
    ------
    OptionError
        Where single velocities of a ball are independent: they are the rates of no numbers.
    """
    if mechanism.chart_joints:
        raise OptionError(
            f"Crocoddyl: joint {mechanism.chart_joints[0].name!r} has independent velocities that are the "
            "rates of no numbers in q, so there is no state to optimise; choose other independent joints"
        )
    carrier, groups = pin.Model(), {joint.name: joint for joint in mechanism.group_joints}
    for name in mechanism.independent:
        kind = mechanism.own_model.joints[groups[name].index] if name in groups else pin.JointModelPX()
        carrier.addJoint(0, kind, pin.SE3.Identity(), name)
    return crocoddyl.StateMultibody(carrier)


class ClosedLoopAction(crocoddyl.ActionModelAbstract):  # type: ignore[misc]
    """x' = one step of RK4 from x under the torques c of the motors.

    Parameters
    ----------
    mechanism : Mechanism
    costs : crocoddyl.CostModelSum
        Over `state_model(mechanism)` and the motors, a rate: of a step it counts `step` times.
    step : float
        s; 0.0 for the last node, whose costs count once.
    motors : sequence of str, optional
        Joints of one number that c turns; `mechanism.actuated`, else the independent ones, when left out.
    q0, mode : array_like, optional
        Where a knot's map begins, and on which mode: as in `simulate`.
    limits : float or array_like (nu,), optional
        |c| at most, N m or N.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        costs: Any,
        step: float,
        motors: Sequence[str] | None = None,
        q0: ArrayLike | None = None,
        mode: ArrayLike | None = None,
        limits: ArrayLike | None = None,
    ) -> None:
        check_mechanism(mechanism, Mechanism, "ClosedLoopAction")
        if step != 0.0:
            check_positive("step", step)
        groups = {joint.name for joint in mechanism.group_joints}
        own = [name for name in mechanism.independent if name not in groups]
        self.motors = tuple(mechanism.actuated or own if motors is None else motors)
        columns = [mechanism.velocity_slice(name) for name in self.motors]
        self.B = np.hstack([np.zeros((mechanism.nv, 0)), *(np.eye(mechanism.nv)[:, c] for c in columns)])
        if costs.nu != self.B.shape[1]:
            raise OptionError(
                f"ClosedLoopAction: costs are of {costs.nu} torques, not of the {self.B.shape[1]} motor(s) "
                f"{', '.join(self.motors)}"
            )
        super().__init__(costs.state, self.B.shape[1], costs.nr)
        self.mechanism, self.costs, self.step, self.q0, self.mode = mechanism, costs, step, q0, mode
        if limits is not None:
            self.u_ub = np.broadcast_to(np.asarray(limits, dtype=float), (self.nu,)).copy()
            self.u_lb = -self.u_ub

    def createData(self) -> ClosedLoopData:
        """What one knot carries."""
        return ClosedLoopData(self)

    def calc(self, data: ClosedLoopData, x: Array, c: Array | None = None) -> None:
        """The state after the step and its cost; the cost is NaN where the mode has no such state."""
        self.costs.calc(data.costs, x, *(() if c is None else (c,)))
        data.cost = self._weight(c) * data.costs.cost
        data.xnext = x.copy()
        if c is None or self.step == 0.0:
            return
        try:
            start = data.go_to(x, self.B @ c)
            equations = data.motion.equations
            first = equations.derivative(equations.evaluate(0.0, start))

            def f(t: float, x: Array) -> Array:
                return equations.derivative(equations.evaluate(t, x))

            data.xnext = data.numbers(rk4_step(f, 0.0, start, self.step, first))
        except SimulationError as stop:
            data.stopped = stop
            data.cost = np.nan

    def calcDiff(self, data: ClosedLoopData, x: Array, c: Array | None = None) -> None:
        """Derivatives of the step and of its cost."""
        collected = data.costs
        self.costs.calcDiff(collected, x, *(() if c is None else (c,)))
        weight = self._weight(c)
        data.Lx, data.Lxx = weight * collected.Lx, weight * collected.Lxx
        if c is None:
            return
        data.Lu, data.Luu, data.Lxu = weight * collected.Lu, weight * collected.Luu, weight * collected.Lxu
        if self.step == 0.0:
            data.Fx = np.eye(self.state.ndx)
            return
        try:
            start = data.go_to(x, self.B @ c)
            A, B = data.jacobians(start[: 2 * self.mechanism.m], self.step)
            data.Fx, data.Fu = A, B @ self.B
        except SimulationError as stop:
            data.stopped = stop
            data.Fx = np.full((self.state.ndx, self.state.ndx), np.nan)

    def _weight(self, c: Array | None) -> float:
        """Of the costs in a node's."""
        return 1.0 if c is None or self.step == 0.0 else self.step


class ClosedLoopData(crocoddyl.ActionDataAbstract):  # type: ignore[misc]
    """A knot's explicit map, where it was evaluated last.

    Attributes
    ----------
    stopped : SimulationError or None
        Why the knot had no step when it was last without one. Crocoddyl is told so by NaN: its solvers then
        take a shorter step, while an exception would end the process in their threads.
    """

    def __init__(self, action: ClosedLoopAction) -> None:
        super().__init__(action)
        mechanism, carrier = action.mechanism, action.state.pinocchio
        self.costs = action.costs.createData(crocoddyl.DataCollectorAbstract())
        self.stopped: SimulationError | None = None
        self.tau: Array = np.zeros(mechanism.nv)
        self.motion: Problem = set_out(mechanism, action.q0, None, action.mode, lambda t, q, v: self.tau)
        self.slopes = PointDerivatives(self.motion)
        self.m, self.nq, self.groups = mechanism.m, carrier.nq, groups_of(mechanism)
        self._numbers: NDArray[np.int64] = np.arange(self.nq)
        if self.groups is not None:
            first = {name: carrier.joints[carrier.getJointId(name)].idx_q for name in carrier.names[1:]}
            on_groups = [first[j.name] + k for j in mechanism.group_joints for k in range(j.nq)]
            self._on_groups = np.array(on_groups)
            self._numbers = np.setdiff1d(self._numbers, self._on_groups)

    def go_to(self, x: Array, tau: Array) -> Array:
        """The motion's state at x, its map there on the mode, with these torques."""
        explicit, m, u = self.motion.explicit, self.m, x[self.nq :]
        self.tau = tau
        y = np.zeros(m)
        if self.groups is None:
            y[:] = x[self._numbers]
        else:
            assert isinstance(explicit, GroupMap)
            y[self.groups.rest_inputs] = x[self._numbers]
            here = np.zeros(m)
            here[self.groups.rest_inputs] = explicit.rest.anchor.y
            explicit.anchor = joined(self.groups, explicit.rest.anchor, x[self._on_groups].copy(), here, u)
        away = y - explicit.anchor.y
        steps = int(np.ceil(np.abs(away).max(initial=0.0) / LEAP))
        for k in range(1, steps):
            explicit.at(y - (1.0 - k / steps) * away, u)
        return np.concatenate([y, u, self.motion.x[2 * m :]])

    def jacobians(self, x: Array, step: float) -> tuple[Array, Array]:
        """Of one step from a state of the motion: by the kernel on regular ground, else by the reference."""
        mechanism, explicit, m = self.motion.mechanism, self.motion.explicit, self.m
        point = explicit.at(x[:m], x[m:])
        kernel = derivation(mechanism, point.q)
        found = None
        if kernel is not None:
            v = point.G @ point.ydot
            found = kernel.step_jacobians(point.q[None], v[None], self.tau[None], step)
        return differentiated_step(self.slopes, 0.0, x, step).jacobians() if found is None else found

    def numbers(self, state: Array) -> Array:
        """x of a state of the motion in the chart of the step."""
        y, u = state[: self.m], state[self.m : 2 * self.m]
        if self.groups is None:
            return np.concatenate([y, u])
        explicit = self.motion.explicit
        assert isinstance(explicit, GroupMap)
        x = np.empty(self.nq)
        x[self._numbers] = y[self.groups.rest_inputs]
        x[self._on_groups] = self.groups.place(explicit.origin, y[self.groups.inputs])
        return np.concatenate([x, u])
