"""Joints whose velocities are no rates of their numbers in q, at many configurations at once.

Quaternions (x, y, z, w), of balls and free bodies, with angular velocities in their own axes, and cosine and
sine, of continuous and planar joints; positions of free and planar joints with velocities in their own axes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import ModelError
from ..mechanism.joints import Joint, JointKind
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array

POSITIONS = {
    JointKind.CONTINUOUS: 0,
    JointKind.SPHERICAL: 0,
    JointKind.FREE_FLYER: 3,
    JointKind.PLANAR: 2,
}
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
    x, y, z, w = part
    rows = [
        *(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        *(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        *(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)
