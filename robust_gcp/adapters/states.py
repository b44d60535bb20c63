"""Many states (q, v) by their independent entries y and u, forwards and for cotangents.

Joints whose velocities are no rates of their numbers in q: quaternions (x, y, z, w), of spherical joints and
free bodies, with angular velocities in their own axes, and cosine and sine, of continuous and planar joints;
positions of free and planar joints with velocities in their own axes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import ModelError
from ..kernel.constraint.assembling import closed, lifted
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import Joint, JointKind
from ..mechanism.tree.tree import Array
from ..simulation.derivatives.accelerations import derivatives

POSITIONS = {JointKind.CONTINUOUS: 0, JointKind.SPHERICAL: 0, JointKind.FREE_FLYER: 3, JointKind.PLANAR: 2}
"""How many numbers of a joint come before its quaternion, or its cosine and sine."""


def normalised(mechanism: Mechanism, q: Array) -> Array:
    """q (N, nq) with quaternions, cosines and sines of unit length."""
    q = q.copy()
    for joint, first in _turning(mechanism):
        part = q[:, joint.idx_q + first : joint.idx_q + joint.nq]
        part /= np.linalg.norm(part, axis=1, keepdims=True)
    return q


def rates(mechanism: Mechanism, q: Array) -> Array:
    """∂q̇/∂v at q (N, nq), (N, nq, nv): its columns are at right angles to each other.

    Raises
    ------
    ModelError
        For a composite joint with such parts.
    """
    found = np.zeros((len(q), mechanism.nq, mechanism.nv))
    for joint in mechanism.joints:
        if joint.flat:
            for k in range(joint.nq):
                found[:, joint.idx_q + k, joint.idx_v + k] = 1.0
    for joint, first in _turning(mechanism):
        iq, iv = joint.idx_q + first, joint.idx_v + first
        part = q[:, iq : joint.idx_q + joint.nq].T
        found[:, iq : iq + len(part), iv : joint.idx_v + joint.nv] = _turned(part)
        found[:, joint.idx_q : iq, joint.idx_v : iv] = _axes(part)[:, :first, :first]
    return found


def _turning(mechanism: Mechanism) -> Iterator[tuple[Joint, int]]:
    """Such joints, and how many positions they begin with."""
    for joint in mechanism.joints:
        if joint.flat:
            continue
        if joint.kind not in POSITIONS:
            raise ModelError(
                f"joint {joint.name!r} ({joint.type}) is not differentiated here; spell it as simple joints"
            )
        yield joint, POSITIONS[joint.kind]


def _turned(part: Array) -> Array:
    """Rates of a quaternion by angular velocities, (N, 4, 3), or of cosine and sine, (N, 2, 1)."""
    if len(part) == 2:
        cos, sin = part
        return np.stack([-sin, cos], axis=1)[:, :, None]
    x, y, z, w = 0.5 * part
    return np.stack([w, -z, y, z, w, -x, -y, x, w, -x, -y, -z], axis=1).reshape(-1, 4, 3)


def _axes(part: Array) -> Array:
    """The joint's own axes in its parent's, (N, 3, 3) or (N, 2, 2)."""
    if len(part) == 2:
        cos, sin = part
        return np.stack([cos, -sin, sin, cos], axis=1).reshape(-1, 2, 2)
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(part.T).as_matrix())


def closed_states(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Loops closed with y held, and v = G u; v as given where K_d is singular: u does not tell it.

    Raises
    ------
    StateError
        For states that are not finite, or whose loops do not close.
    """
    if mechanism.nq != mechanism.nv:
        q = normalised(mechanism, q)
    q, done = closed(mechanism, q, mechanism.iv_dependent)
    if not np.all(done):
        q[~done] = mechanism.assemble(q[~done])
    fast = np.array(v, order="C")
    known = lifted(mechanism, q, fast, mechanism.iv_dependent)
    if known is None:
        return q, mechanism.lift(q, v[:, mechanism.iv_independent])
    return q, np.where(known[:, None], fast, v)


def to_independent(mechanism: Mechanism, q: Array, v: Array, on_q: Array, on_v: Array) -> Array:
    """Cotangents (N, 2m) of (y, u) by those of q and v: δq = G δy along velocities, δv = ∂v/∂y δy + G δu."""
    own, others = mechanism.iv_independent, mechanism.iv_dependent
    along = on_q if mechanism.nq == mechanism.nv else times(on_q, rates(mechanism, q))
    found = np.concatenate([along[:, own], on_v[:, own]], axis=1)
    # y and u stand for themselves: only where others are asked for are G and ∂v/∂y needed
    some = np.flatnonzero(np.any(along[:, others], axis=1) | np.any(on_v[:, others], axis=1))
    if len(some):
        at = derivatives(mechanism, q[some], v[some])
        on_y = times(along[some], at.G) + times(on_v[some], at.dv_dy)
        found[some] = np.concatenate([on_y, times(on_v[some], at.G)], axis=1)
    return found


def to_state(mechanism: Mechanism, q: Array, rows: Array) -> tuple[Array, Array]:
    """Cotangents of q and v by those of (y, u): zero for dependent entries."""
    m, own = mechanism.m, mechanism.iv_independent
    along, on_v = np.zeros((2, len(rows), mechanism.nv))
    along[:, own], on_v[:, own] = rows[:, :m], rows[:, m:]
    if mechanism.nq == mechanism.nv:
        return along, on_v
    by = rates(mechanism, q)
    # columns at right angles: over their squares they are the pseudo-inverse, δv by δq
    return times(along / np.sum(by * by, axis=1), by.transpose(0, 2, 1)), on_v


def times(rows: Array, matrices: Array) -> Array:
    """Each row (N, n) times its matrix (N, n, k)."""
    product: Array = np.matmul(rows[:, None], matrices)[:, 0]
    return product
