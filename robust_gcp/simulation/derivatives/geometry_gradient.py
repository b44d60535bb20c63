"""The gradient by parameters that change the geometry: the sweep in coordinates that hold these still."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import is_table
from ...dynamics.loads import Wrench, one_torque, without_wrenches
from ...dynamics.prescribed.control import Actuated
from ...dynamics.prescribed.motion import Motion
from ...dynamics.torque_feedback import TorqueSlopes, slopes_of_all
from ...errors import OptionError, SimulationError
from ...mechanism.building.variable_geometry import MARK, Varied, is_geometry, varied
from ...mechanism.constraint.closures import Closure
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.acted import Acted
from ..trajectories.trajectory import Trajectory
from .cost import Cost, Gradient, checked_torques
from .reverse_sweep import ReverseSweep


def by_geometry(
    trajectory: Trajectory,
    cost: Cost,
    torque: Any,
    parameters: Sequence[str],
    torque_slopes: TorqueSlopes | None,
    mode: ArrayLike | None,
) -> Gradient:
    """`gradient` where some of the parameters are placements; y and u of the start are held.

    Raises
    ------
    OptionError
        As `gradient`; where loops do not stay closed, or modes that the run went through do not cross, when a
        placement changes; for actuators.
    """
    mech = trajectory.mechanism
    wide = varied(mech, [name for name in parameters if is_geometry(name)])
    wide.require_closed(trajectory.q[[0, len(trajectory.t) // 2, -1]])  # a singular one tells nothing
    _require_no_crossing(wide, trajectory)
    acted = Acted() if trajectory.acted is None else trajectory.acted
    rows, given = is_table(torque), None
    run = _run(wide, trajectory, acted, rows)
    if torque is not None:
        one = checked_torques(mech, torque, len(trajectory.t) - 1) if rows else one_torque(mech, torque)
        given = torque_of_all(wide, one, () if rows else acted.wrenches)
    slopes = None
    if torque_slopes is not None:
        wrenches = [_pushing(wide, wrench) for wrench in acted.wrenches]
        slopes = slopes_of_all(wide.mechanism, _torque_slopes(wide, torque_slopes), wrenches)
    start = None if mode is None else wide.v(mech.velocity(mode, "mode"))
    rest = [name for name in parameters if not is_geometry(name)]
    with beside_singular(wide, "gradient"):
        found = ReverseSweep(run, _cost(wide, cost), given, rest, slopes, start).gradient()
    by = dict(zip(wide.names, found.dy[wide.more].tolist(), strict=True)) | found.parameters
    if found.drive is not None:  # where what is held is one motion more that is prescribed
        by |= {name: found.by_drive({name: Motion(1.0)}) for name in wide.names}
    return Gradient(
        found.value,
        found.dy[wide.own],
        found.dv[wide.own],
        found.dtau[:, wide.iv],
        {name: by[name] for name in parameters},
        None if found.drive is None else found.drive.of(tuple(acted.motions)),
    )


@contextmanager
def beside_singular(wide: Varied, what: str) -> Iterator[None]:
    """Errors of motions in this context say what a change of geometry has to do with it."""
    try:
        yield
    except SimulationError as error:
        error.args = (
            f"{what}: no derivative by {', '.join(wide.names)} is known beside singular configurations, "
            f"whose modes come apart when these change ({error.args[0]})",
            *error.args[1:],
        )
        raise


def _run(wide: Varied, run: Trajectory, acted: Acted, in_rows: bool) -> Trajectory:
    """The run in the coordinates of the mechanism that can change."""
    if isinstance(acted.torque, Actuated) or run.u is not None:
        raise OptionError(
            "gradient: by placements is not known for runs with ctrl=; drive the joints by torque=, or take "
            "differences of whole runs"
        )
    held = None if acted.held is None else wide.v(acted.held)
    still = {name: Motion(0.0) for name in wide.names}
    motions = {**acted.motions, **still} if acted.motions else {}
    changes = [(t, (*names, *wide.names)) for t, names in run.stats.repartitions]  # held ones stay so
    pushes = acted.wrenches if callable(acted.torque) else ()  # else part of what was held
    total = torque_of_all(wide, without_wrenches(acted.torque), pushes)
    wrenches = acted.wrenches if in_rows else ()  # for the refusal of a table beside them
    return Trajectory(
        wide.mechanism,
        run.t,
        wide.q(run.q),
        wide.v(run.v),
        crossings=run.crossings,
        stats=replace(run.stats, repartitions=changes),
        acted=replace(acted, torque=total, wrenches=wrenches, held=held, motions=motions),
    )


def torque_of_all(wide: Varied, torque: Any, wrenches: Sequence[Wrench] = ()) -> Any:
    """A torque of the mechanism as it is: a constant, a function or None; wrenches go with the frames."""
    if not callable(torque) and not wrenches:
        return None if torque is None else wide.v(np.asarray(torque, dtype=float))
    pushes: Any = one_torque(wide.mechanism, None, [_pushing(wide, wrench) for wrench in wrenches])

    def of_all(t: float, q: Array, v: Array) -> Array:
        own = torque(t, q[wide.iq], v[wide.iv]) if callable(torque) else torque
        tau = np.zeros(len(wide.iv)) if own is None else np.array(own, dtype=float)
        if wrenches:  # what they do to the placements, which are held, moves nothing
            tau += pushes(t, q, v)[wide.iv]
        return wide.v(tau)

    return of_all


def _pushing(wide: Varied, wrench: Wrench) -> Wrench:
    """The same wrench on the mechanism that can change; its function is handed states of the one that is."""
    given = wrench.force
    if not callable(given):
        return wrench
    return replace(wrench, force=lambda t, q, v: given(t, q[wide.iq], v[wide.iv]))


def _torque_slopes(wide: Varied, slopes: TorqueSlopes) -> TorqueSlopes:
    def of_all(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        by_q, by_v = (np.asarray(part, dtype=float) for part in slopes(t, q[wide.iq], v[wide.iv]))
        return wide.v(wide.v(by_q).T).T, wide.v(wide.v(by_v).T).T

    return of_all


def _cost(wide: Varied, cost: Cost) -> Cost:
    """The same cost; its functions may be handed many states, whose number is last."""

    def own(*state: Any) -> tuple[Any, ...]:
        """(q, v) or (t, q, v, tau) of the mechanism as it is."""
        *t, q, v = state[:3]
        return (*t, q[wide.iq], v[wide.iv], *(tau[wide.iv] for tau in state[3:]))

    def term(given: Callable[..., Any] | None) -> Callable[..., Any] | None:
        return None if given is None else lambda *state: given(*own(*state))

    def slopes(given: Callable[..., Any] | None) -> Callable[..., Any] | None:
        if given is None:
            return None
        return lambda *state: [wide.v(np.asarray(part, dtype=float)) for part in given(*own(*state))]

    return Cost(
        term(cost.terminal), term(cost.running), slopes(cost.terminal_slopes), slopes(cost.running_slopes)
    )


def _require_no_crossing(wide: Varied, run: Trajectory) -> None:
    """An OptionError where modes cross that a change of geometry takes apart."""
    mech: Mechanism = run.mechanism
    for crossing in run.crossings:
        cluster = None if crossing.cluster is None else mech.clusters[crossing.cluster]
        for name in wide.names:
            target = name.rpartition(MARK)[0]
            if cluster is None or _is_in(target, cluster, mech):
                raise OptionError(
                    f"gradient: the run passes a singular configuration at t = {crossing.time:.6g} s, where "
                    f"modes that cross come apart when {name} changes: motions beyond it have no derivative "
                    "by it; end the run before, or leave it out"
                )


def _is_in(target: str, cluster: Any, mech: Mechanism) -> bool:
    """Whether a joint or a frame of a closure belongs to a loop cluster."""
    if target in cluster.joints:
        return True
    return any(target in (c.frame1, c.frame2) for c in cluster.closures if isinstance(c, Closure))
