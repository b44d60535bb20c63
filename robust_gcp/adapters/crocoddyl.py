"""Optimal control with Crocoddyl: closed loops in minimal coordinates, also through singular configurations.

One node is one step of RK4 on the explicit equations (3), the motors' torques held over it. An explicit map
has several values at one y, so the data of each knot carry a map of their own: on its mode, where the knot
was evaluated last.

Needs the extra `control`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..checks import check_mechanism, check_positive
from ..errors import OptionError, SimulationError, missing_extra
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .knot import Knot

try:
    import crocoddyl
except ImportError as missing:
    raise missing_extra("optimal control needs crocoddyl", "crocoddyl", "control") from missing


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
        Where single velocities of a spherical joint are independent: they are the rates of no numbers.
    """
    if mechanism.chart_joints:
        raise OptionError(
            f"Crocoddyl: joint {mechanism.chart_joints[0].name!r} has independent velocities that are the "
            "rates of no numbers in q, so there is no state to optimise; choose other independent joints"
        )
    carrier = pin.Model()
    # side by side on the ground: of a state Crocoddyl asks sums and differences alone
    for name, kind, _ in _joints(mechanism):
        carrier.addJoint(0, kind, pin.SE3.Identity(), name)
    return crocoddyl.StateMultibody(carrier)


def _joints(mechanism: Mechanism) -> Iterator[tuple[str, Any, list[int]]]:
    """The joints of a state by name, model, and place in q: those on groups, and a slide for each number."""
    groups = {joint.name: joint for joint in mechanism.group_joints}
    numbers = iter(mechanism.iq_numbers.tolist())
    for name in mechanism.independent:
        if name in groups:
            joint = groups[name]
            yield name, mechanism.own_model.joints[joint.index], [*range(joint.idx_q, joint.idx_q + joint.nq)]
            continue
        count = len(mechanism.velocities_named([name]))
        for k in range(count):
            yield name if count == 1 else f"{name}.{k}", pin.JointModelPX(), [next(numbers)]


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
        self.places = np.concatenate([places for _, _, places in _joints(mechanism)])
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
            data.xnext = data.knot.step(x, self.B @ c, self.step)
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
            A, B = data.knot.jacobians(x, self.B @ c, self.step)
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
        self.costs = action.costs.createData(crocoddyl.DataCollectorAbstract())
        self.stopped: SimulationError | None = None
        self.knot = Knot(action.mechanism, action.q0, action.mode, action.places)
