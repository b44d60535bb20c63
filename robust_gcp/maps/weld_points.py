"""Where the position rows of welds are taken, so that few velocities move the two points apart.

A weld holds two frames together wherever in them the two points lie that it holds together, if both have
the same place there. At the centre of a spherical joint next to the cut, spelt as one joint or as revolute
joints whose axes meet, its velocities leave the position rows: K_d falls apart into these and the rotation
rows, which these velocities follow from.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..mechanism.constraint.closures import FrameClosure, closure_frames
from ..mechanism.constraint.rows import rows_of
from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array, Tree

STILL = 1e-9
"""How far a velocity of one moves a point that it counts as not moving, in units of its distance."""


def tree_at_points(
    mechanism: ClosedLoops, rows: NDArray[np.int64], dependent: NDArray[np.int64]
) -> tuple[Array, Tree]:
    """The points of `meeting_points`, and a tree that follows the frames there."""
    points, model = meeting_points(mechanism, rows, dependent), mechanism.near
    if not points.any():
        return points, mechanism.tree
    ends = moved(closure_frames(model, mechanism.loops), points)
    tree: Tree = mechanism.of_loops.once(("tree at", points.tobytes()), lambda: Tree(model, ends))
    return points, tree


def meeting_points(mechanism: ClosedLoops, rows: NDArray[np.int64], dependent: NDArray[np.int64]) -> Array:
    """Points of all closures' position rows, in the axes of their frames, from their origins; (loops, 3), m.

    Other than the origin for welds alone whose six rows are all among `rows`.
    """
    points = np.zeros((len(mechanism.loops), 3))
    full = rows_of(mechanism.loops)
    chosen = [full[row].closure for row in mechanism.implicit.rows[rows].tolist() if row < len(full)]
    welds = [
        i
        for i, closure in enumerate(mechanism.loops)
        if type(closure) is FrameClosure and chosen.count(i) == 6
    ]
    for i in welds:
        most = 2  # three have to leave for the rows to fall apart
        for point, still in mechanism.of_loops.once(("still about", i), partial(_candidates, mechanism, i)):
            # at both configurations: axes may meet in one pose by chance
            leaving = min(int(np.isin(velocities, dependent).sum()) for velocities in still)
            if leaving > most:
                most, points[i] = leaving, point
    return points


def _candidates(mechanism: ClosedLoops, weld: int) -> list[tuple[Array, list[list[int]]]]:
    """Points of a weld's frames, and the velocities that do not move them at each of two configurations."""
    model, found = mechanism.near, []
    ends = closure_frames(model, mechanism.loops)
    configurations = mechanism.generic_configurations(2)
    sides = (ends[weld], ends[len(mechanism.loops) + weld])
    for (joint, place), (other, _) in zip(sides, sides[::-1], strict=True):
        beyond = set(model.supports[other])
        tail = [k for k in reversed(list(model.supports[joint])) if k not in beyond]
        # three revolute joints whose axes meet are a spherical one too
        for centre in _centres(mechanism.tree, tail[:3], configurations[0]):
            still = [_still(mechanism, tail, centre, q) for q in configurations]
            found.append((np.array(place.actInv(centre)), still))
    return found


def _centres(tree: Tree, tail: list[int], q: Array) -> list[Array]:
    """Where the joints of a tail are, which goes towards the root, seen from its first."""
    tree.jacobians(q)
    R, p = tree.R, tree.p
    return [R[tail[0]].T @ (p[k] - p[tail[0]]) for k in tail]


def _still(mechanism: ClosedLoops, tail: list[int], point: Array, q: Array) -> list[int]:
    """The velocities of a tail that do not move a point of its first body, until a joint does."""
    tree, model, found = mechanism.tree, mechanism.own_model, list[int]()
    tree.jacobians(q)
    at = tree.p[tail[0]] + tree.R[tail[0]] @ point
    speed = np.abs(tree.J[:, :3] + np.cross(tree.J[:, 3:], at)).max(axis=1)
    still = speed < STILL * (mechanism.length + np.abs(at).max())
    for k in tail:
        own = np.arange(model.idx_vs[k], model.idx_vs[k] + model.nvs[k])
        if not still[own].all():
            break
        found += own.tolist()
    return found


def moved(ends: list[tuple[int, pin.SE3]], points: Array) -> list[tuple[int, pin.SE3]]:
    """What `closure_frames` gives with these points as the frames' origins."""
    return [
        (joint, pin.SE3(place.rotation, place.act(point)))
        for (joint, place), point in zip(ends, np.tile(points, (2, 1)), strict=True)
    ]
