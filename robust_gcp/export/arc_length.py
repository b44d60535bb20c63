"""A mode of mobility 1 by its arc length, whichever joints turn back on the way."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..errors import ModelError, RobustGcpError
from ..mechanism.assembly.assemblies import way_between
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..simulation.simulate import simulate

FIRST, LONGEST = 0.01, 200.0
"""Steps by which the way round is found, and how long it may be: rad, or lengths of the mechanism."""

FINER = 8
"""Steps taken for each sample."""

CLOSED = 1e-9
"""What may be missing of the way round, rad or lengths."""


def by_arc_length(mechanism: Mechanism, count: int) -> tuple[float, Array, Array]:
    """The length of the mode of home, and q and dq/ds (count + 1, n) evenly along it, home again at the end.

    A point of unit inertia along each joint keeps its speed on the mode, √Σ(dq_i / L_i)² being its way with
    L = 1 rad or the mechanism's length: K alone leads it, M and forces have no part. So a run of it is the
    mode by its arc length.

    Raises
    ------
    ModelError
        Where the mode does not close, or leads where it cannot be followed.
    """
    point, called = _point(mechanism), mechanism.name or "the mechanism"
    v = point.lift(point.home, [1.0])
    v /= np.linalg.norm(v / point.units)
    way = v / point.units
    try:
        length = _first(point, v, way)
        # what is missing falls as its square: 1e-8 after the first look, 1e-13 after one correction
        for _ in range(3):
            step = length / (FINER * count)
            run = simulate(point, point.home, v, duration=length, step=step)
            apart = way_between(point, point.home, run.q[-1])
            missing = float(way @ apart)
            if abs(missing) <= CLOSED and np.abs(apart).max() <= CLOSED:
                return length, run.q[::FINER], run.v[::FINER]
            length -= missing
    except RobustGcpError as error:
        raise ModelError(f"export: {called} has no table by its arc length: {error}; export .rgcp") from error
    raise ModelError(f"export: the mode of {called} does not close; export .rgcp")


def _point(mechanism: Mechanism) -> Mechanism:
    """The loops alone, with a point of unit inertia along each joint in place of its links."""
    model = mechanism.model.copy()
    for j in range(1, model.njoints):
        model.inertias[j] = pin.Inertia.Zero()
    model.armature = 1.0 / mechanism.units**2
    model.gravity.linear = np.zeros(3)
    return Mechanism(model, mechanism.closures, mechanism.independent, mechanism.home, mechanism.name)


def _first(point: Mechanism, v: Array, way: Array) -> float:
    """Where the mode comes back to home on the same way, to some digits."""
    run = simulate(point, point.home, v, duration=LONGEST, step=FIRST)
    apart = np.array([way_between(point, point.home, q) for q in run.q])
    # other modes may lead through home as well, and this one backwards: the way must be the same
    near = np.linalg.norm(apart, axis=1) < 2.0 * FIRST
    # nor is the start itself one
    again = np.flatnonzero(near & ((run.v / point.units) @ way > 0.9) & (run.t > 10.0 * FIRST))
    if not len(again):
        raise ModelError("it does not come back to home")
    k = int(again[0])
    return float(run.t[k] - way @ apart[k])
