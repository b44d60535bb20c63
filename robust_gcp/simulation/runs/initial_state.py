"""How a motion begins: the usual start is closed, checked and evaluated by the kernel, others in Python."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.prescribed.drive import Drive
from ...dynamics.prescribed.driven import driven_start
from ...dynamics.problem import Problem, initial_value_problem
from ...errors import PartitionError, SimulationError, ToggleError
from ...kernel.simulation.batch import Begun, count_in
from ...kernel.simulation.steps import NativeSteps
from ...kernel.simulation.workspace import Workspace
from ...maps.choice import MapChoice
from ...maps.cluster.options import BridgeOptions
from ...maps.explicit import Counters, Point
from ...maps.grouped import GroupPoint
from ...maps.grouped_start import start_on_groups
from ...maps.regular_path import RegularPath
from ...maps.start import Start
from ...maps.start_check import require_finite_energy
from ...mechanism.constraint.closed_check import require_proper
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import COMPATIBLE, NEARLY_CLOSED
from ...mechanism.tree.tree import Array
from .coordinates import Coordinates


def problem_where_served(
    mechanism: Mechanism,
    q0: ArrayLike | None,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    counters: Counters,
) -> Problem:
    """`initial_value_problem`, in other coordinates where those of the mechanism turn back at the start.

    Raises
    ------
    ToggleError
        Where no others serve either.
    """
    try:
        return initial_value_problem(mechanism, q0, v0, mode, torque, choice, counters)
    except ToggleError as stop:
        q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
        found = Coordinates(mechanism, mechanism.independent, counters).at_rest(q)
        for names in ([] if found is None else [found]) + _whole(mechanism, stop.choices):
            other = mechanism.with_independent(names)
            try:
                return initial_value_problem(other, q0, v0, mode, torque, choice, counters)
            except (SimulationError, PartitionError):
                continue  # the first error is raised: it is of what the caller named
        raise


def _whole(mechanism: Mechanism, choices: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Choices of independent joints with those on groups, which are in all of them."""
    groups = groups_of(mechanism)
    kept = [] if groups is None else [n for n in mechanism.independent if n not in groups.rest.independent]
    return [(*kept, *names) for names in choices]


Given = tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None]
"""q0, v0 and mode, as `simulate` takes them."""


def is_plain(mechanism: Mechanism) -> bool:
    """Whether the rows of each cluster are as many as its dependent velocities, and y are numbers in q.

    But for joints on groups, such as a floating base.
    """

    def found() -> bool:
        rest = rest_of(mechanism)
        # which of redundant rows serve hangs on the configuration, and is Python's to find
        determined = rest.nc == len(rest.iv_dependent)
        determined = determined and all(c.loops.nc == len(c.iv) - c.m for c in rest.clusters)
        return determined and len(rest.numbers) == rest.m and mechanism.m > 0

    plain: bool = mechanism.memo.once("rows as many as dependent velocities", found)
    return plain


def rest_of(mechanism: Mechanism) -> Mechanism:
    """Without joints on groups."""
    groups = groups_of(mechanism)
    return mechanism if groups is None else groups.rest


def closed_by_kernel(
    workspace: Workspace,
    mechanism: Mechanism,
    q: Array,
    v: Array | None,
    zone: float,
    t: float = 0.0,
    options: BridgeOptions | None = None,
) -> Begun | None:
    """The state and its evaluation at a start that is closed, with a velocity that the loops allow.

    None where it is not on regular ground (K_d conditioned to `zone`, or with `options` to 1e-4), or is no
    such start. Without a velocity what is not prescribed rests.
    """
    require_proper(mechanism, q)
    u = np.zeros(mechanism.m) if v is None else v[mechanism.iv_independent]
    # The kernel closes the loops from q: how far that moves it, and v, tells whether the start was one.
    begun = workspace.begin(q, u, zone, t, options)
    if begun is None:
        return None
    now = begun.now
    units = mechanism.units
    moved = np.abs(mechanism.tree.difference(q, now.point.q) / units).max()
    if v is None:
        return begun if moved <= NEARLY_CLOSED else None
    apart, size = np.abs((now.v - v) / units).max(), np.abs(v / units).max()
    # at rest there is nothing to be relative to: 1 rad or length a second
    return begun if moved <= NEARLY_CLOSED and apart <= COMPATIBLE * max(size, 1.0) else None


def state_given(mechanism: Mechanism, q0: ArrayLike | None, v0: ArrayLike | None) -> tuple[Array, Array]:
    """q and v of a start as `simulate` takes it: home, and at rest but as the mechanism recommends."""
    q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
    v0 = mechanism.recommended.velocity(q0, None) if v0 is None else v0
    return q, mechanism.tree.zero if v0 is None else mechanism.velocity(v0, "v0")


def _plain(
    native: NativeSteps | None,
    mechanism: Mechanism,
    q0: ArrayLike | None,
    v0: ArrayLike | None,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    counters: Counters,
    drives: Drive | None,
    t0: float,
) -> Problem | None:
    """`initial_value_problem`, with the evaluation there where no function has to be asked for a torque.

    None where `initial_value_problem` has to look, and to say what is wrong.
    """
    if native is None or not is_plain(mechanism):
        return None
    q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
    if drives is not None:
        q = driven_start(mechanism, drives, q0, v0, None, choice, counters)
    v: Array | None = None if drives is not None else mechanism.tree.zero
    if v0 is not None:
        v = given = mechanism.velocity(v0, "v0")
        require_finite_energy(mechanism, given)
    rest = rest_of(mechanism)
    path = RegularPath(rest, np.arange(rest.nc), counters)
    return _evaluated(native, mechanism, path, q, v, torque, choice, drives, t0)


def _evaluated(
    native: NativeSteps,
    mechanism: Mechanism,
    path: RegularPath,
    q: Array,
    v: Array | None,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    drives: Drive | None,
    t0: float,
) -> Problem | None:
    """The motion from a start that `closed_by_kernel` finds; None where it finds none."""
    workspace = native.prepare(mechanism, path)
    if workspace is None:
        return None
    options = choice.options if choice.method == "bridge" and drives is None else None
    begun = closed_by_kernel(workspace, mechanism, q, v, choice.options.zone, t0, options)
    if begun is None:
        return None
    now = begun.now
    motion = Problem(start_at(mechanism, path, now.point), torque, choice, drives)
    if begun.trackers is not None:
        motion.resume(now.point, begun.trackers)
        count_in(path.counters, begun.counts)
    motion.first = None if native.asks else now  # a function has not been asked: the run does, in its order
    return motion


def start_at(mechanism: Mechanism, path: RegularPath, point: Point) -> Start:
    """At a point on regular ground."""
    groups = groups_of(mechanism)
    if groups is None:
        return Start(path, point, point.ydot)
    assert isinstance(point, GroupPoint)
    return start_on_groups(groups, Start(path, point.rest, point.rest.ydot), point)


def initialise(
    native: NativeSteps | None,
    mechanism: Mechanism,
    start: Given,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    on_toggle: str,
    drives: Drive | None,
    t0: float,
) -> Problem:
    """The motion from a start, by the kernel where it is a plain one.

    Parameters
    ----------
    native : NativeSteps or None
    start : (q0, v0, mode)
        As `simulate` takes them; so are the others.

    Raises
    ------
    StateError, ClosureError, OptionError, SimulationError
        As `dynamics.problem.initial_value_problem` does.
    """
    (q0, v0, mode), counters = start, Counters()
    if mode is None:
        motion = _plain(native, mechanism, q0, v0, torque, choice, counters, drives, t0)
        if motion is not None:
            return motion
    if on_toggle == "error":
        motion = initial_value_problem(mechanism, q0, v0, mode, torque, choice, counters, drives)
    else:
        motion = problem_where_served(mechanism, q0, v0, mode, torque, choice, counters)
    found, begun = None, motion.start
    if native is not None:
        if drives is None and not begun.trackers:  # with the kernel's own digits
            q, v = begun.point.q, begun.point.G.dot(begun.ydot)
            found = _evaluated(native, motion.mechanism, begun.path, q, v, torque, choice, None, t0)
        if found is None:
            native.prepare(motion.mechanism, begun.path)
    return motion if found is None else found
