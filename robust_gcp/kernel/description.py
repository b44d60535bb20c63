"""A mechanism as the plain arrays that the compiled kernel reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..maps.cluster.space import space_of
from ..maps.meeting_points import moved
from ..maps.regular_path import RegularPath
from ..mechanism.closures import closure_frames, frame_of
from ..mechanism.clusters import LoopCluster
from ..mechanism.couplings import CouplingClosure, Couplings
from ..mechanism.forces import JointDamper, JointSpring, JointTorque, PointSpring
from ..mechanism.groups import groups_of
from ..mechanism.loops import ClosedLoops
from ..mechanism.mechanism import Mechanism
from ..mechanism.rows import ROTATION, Row, rows_of
from ..mechanism.tree import Array
from ..mechanism.workspace import memory_left, workspace_bytes
from .structures import Arrays, Cluster, Description


class NotNativeError(Exception):
    """The kernel cannot take this mechanism; the message says why."""


def describe(mechanism: Mechanism, path: RegularPath, works: bool, driven: tuple[int, ...] = ()) -> Arrays:
    """The kernel's `Description`; kept for each mechanism and choice of rows.

    Parameters
    ----------
    path : RegularPath
        Of the mechanism, or of what is left of it without joints on groups.
    works : bool
        Whether the state ends with the work done.
    driven : tuple of int
        Which of y are prescribed.

    Raises
    ------
    NotNativeError
        For a joint that the kernel does not know.
    """
    key = ("description for the kernel", works, driven, *path.rows.tolist())
    return mechanism.memo.once(key, lambda: _described(mechanism, path, works, driven))


def describe_all(mechanism: Mechanism) -> Arrays:
    """All joints, forces and rows of φ in their own units, whatever the path; kept for each mechanism.

    Raises
    ------
    NotNativeError
        For a joint that the kernel does not know.
    """

    def made() -> Arrays:
        arrays, turns = _loops(mechanism)
        arrays.reals(row_weight=np.ones(mechanism.nc), scale=np.ones(mechanism.nv))
        _forces(mechanism, turns, arrays)
        return arrays

    return mechanism.memo.once("description of all for the kernel", made)


def _described(mechanism: Mechanism, path: RegularPath, works: bool, driven: tuple[int, ...]) -> Arrays:
    if mechanism.m == 0:
        raise NotNativeError("the mechanism has no degree of freedom")
    if mechanism.m > 1 and workspace_bytes(mechanism.own_model) > memory_left():
        needed = workspace_bytes(mechanism.own_model) / 1e9
        raise NotNativeError(f"the mechanism has {mechanism.nv} velocities, which take {needed:.3g} GB")
    description = Description(
        joints=mechanism.own_model.njoints - 1, nq=mechanism.nq, nv=mechanism.nv, m=mechanism.m, works=works
    )
    arrays = Arrays(description)
    turns = _tree(mechanism, arrays)
    rest = path.mechanism
    column_scale, scale = mechanism.column_scale.copy(), np.ones(mechanism.nv)
    own = _velocities_of_rest(mechanism)
    column_scale[own] = rest.column_scale
    scale[own[path.dependent]] = rest.column_scale[path.dependent]
    in_q: NDArray[np.int64] = np.full(mechanism.m, -1)
    in_q[mechanism.numbers] = mechanism.iq_numbers
    arrays.structure.driven = len(driven)
    arrays.integers(independent=mechanism.iv_independent, independent_q=in_q, driven_y=driven)
    arrays.reals(size=1.0 / column_scale, turn=1.0 / mechanism.units, scale=scale)
    arrays.reals(own=[mechanism.joint_inertia])
    _closures(mechanism, path.mechanism, path.rows, turns, arrays, path.points)
    _couplings(mechanism, path.mechanism, path.rows, arrays)
    _blocks(mechanism, path, arrays)
    _forces(mechanism, turns, arrays)
    _clusters(mechanism, path, arrays)
    return arrays


def _velocities_of_rest(mechanism: Mechanism) -> NDArray[np.int64]:
    """Where the velocities are in v of all joints but those on groups."""
    groups = groups_of(mechanism)
    return np.arange(mechanism.nv) if groups is None else groups.rest_iv


def _clusters(mechanism: Mechanism, path: RegularPath, arrays: Arrays) -> None:
    """The loop clusters, where they are followed in the kernel."""
    arrays.reals(home=mechanism.home)
    arrays.structure.redundant = mechanism.nc > path.nd
    if not follows_zones(path):
        return
    clusters = path.mechanism.clusters
    arrays.structure.clusters = len(clusters)
    arrays.structures("cluster", [_cluster(mechanism, path.mechanism, cluster) for cluster in clusters])


def follows_zones(path: RegularPath) -> bool:
    """Whether the kernel follows the clusters of a mechanism in zones: all or none; none is a structure."""
    return all(cluster.m for cluster in path.mechanism.clusters)


def _cluster(mechanism: Mechanism, rest: Mechanism, cluster: LoopCluster) -> Arrays:
    """One cluster: its joints, all rows of its φ, and where it is in the whole."""
    loops, space = cluster.loops, space_of(rest, cluster, rest.home[cluster.iq])
    iq, iv, inputs = cluster.iq, cluster.iv, cluster.inputs
    groups = groups_of(mechanism)
    if groups is not None:
        iq, iv, inputs = groups.rest_iq[iq], groups.rest_iv[iv], groups.rest_inputs[inputs]
    description, _ = _loops(loops)
    description.structure.m = cluster.m
    description.reals(scale=space.D)
    description.integers(independent=cluster.chosen)
    part = Arrays(Cluster(phi_size=space.phi_size))
    part.another("loops", description)
    part.integers(
        iq=iq,
        iv=iv,
        inputs=inputs,
        rotates=loops.tree.rotates,
        periodic=loops.tree.periodic,
    )
    part.reals(balance=space.balance)
    return part


def _loops(loops: ClosedLoops) -> tuple[Arrays, list[Array]]:
    """Joints, bodies and all rows of φ; and the turns of `_tree`."""
    arrays = Arrays(Description(joints=loops.own_model.njoints - 1, nq=loops.nq, nv=loops.nv))
    turns, rows = _tree(loops, arrays), np.arange(loops.nc)
    _closures(loops, loops, rows, turns, arrays)
    _couplings(loops, loops, rows, arrays)
    return arrays, turns


def _tree(mechanism: ClosedLoops, arrays: Arrays) -> list[Array]:
    """Joints and bodies; returns the rotation by which each joint's frame is turned to its axis."""
    model = mechanism.near
    if np.any(model.gravity.angular):
        raise NotNativeError("gravity has an angular part")
    kinds, placements, inertias = [], [], []
    turns: list[Array] = [np.eye(3)]
    for joint in mechanism.joints:
        if not joint.in_kernel:
            raise NotNativeError(f"joint {joint.name!r} is of type {joint.type}")
        j, turn = joint.index, np.eye(3) if joint.axis is None else _with_z_along(joint.axis)
        before = turns[model.parents[j]]
        place, body = model.jointPlacements[j], model.inertias[j]
        kinds.append(joint.kind)
        turns.append(turn)
        rotation = before.T @ place.rotation @ turn
        placements.append(np.concatenate([rotation.ravel(), before.T @ place.translation]))
        about = turn.T @ body.inertia @ turn
        inertias.append(
            np.concatenate([[body.mass], turn.T @ body.lever, about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
        )
    arrays.integers(parent=list(model.parents)[1:], kind=kinds)
    arrays.reals(placement=placements, inertia=inertias, armature=model.armature)
    arrays.reals(gravity=model.gravity.linear, ground=mechanism.standpoint)
    return turns


def _with_z_along(axis: Array) -> Array:
    """A rotation matrix whose last column is the axis; exact for a coordinate axis."""
    last = int(np.argmax(np.abs(axis)))
    first = np.cross(np.eye(3)[(last + 2) % 3], axis)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def _closures(
    mechanism: ClosedLoops,
    chooser: ClosedLoops,
    rows: NDArray[np.int64],
    turns: list[Array],
    arrays: Arrays,
    at: Array | None = None,
) -> None:
    """Cut points, and the rows chosen among those of `chooser`, which has the same closures.

    Position rows are taken at these points of the frames, at their origins where left out.
    """
    closures = mechanism.loops
    frames = closure_frames(mechanism.near, closures)
    if at is not None:
        frames = moved(frames, at)
    joints, points, local = [], [], []
    for ends in zip(frames[: len(closures)], frames[len(closures) :], strict=True):
        joints += [joint for joint, _ in ends]
        points += [turns[joint].T @ place.translation for joint, place in ends]
        local.append([turns[joint].T @ place.rotation for joint, place in ends])
    full = rows_of(closures)
    chosen = [full[row] if row < len(full) else Row(-1, "", ROTATION) for row in chooser.implicit.rows[rows]]
    arrays.structure.closures, arrays.structure.rows = len(closures), len(chosen)
    arrays.integers(
        closure_joint=joints,
        row_closure=[row.closure for row in chosen],
        row_axis=[row.axis for row in chosen],
        row_terms=np.cumsum([0, *(len(row.terms) for row in chosen)]),
    )
    arrays.reals(
        closure_point=points,
        row_weight=1.0 / chooser.row_scale[rows],
        terms=[
            [weight, *(local[row.closure][0] @ u), *(local[row.closure][1] @ n)]
            for row in chosen
            for weight, u, n in row.terms
        ],
    )


def _couplings(
    mechanism: ClosedLoops, chooser: ClosedLoops, chosen: NDArray[np.int64], arrays: Arrays
) -> None:
    """The couplings whose rows were chosen."""
    first = len(rows_of(mechanism.loops))
    rows = {int(full) - first: row for row, full in enumerate(chooser.implicit.rows[chosen]) if full >= first}
    given = mechanism.closures[len(mechanism.loops) :]
    ties = Couplings(mechanism.joints, [c for c in given if isinstance(c, CouplingClosure)])
    order = {coupling: place for place, coupling in enumerate(rows)}
    further = [f for f in ties.further if f[0] in order]
    width = ties.coefficients.shape[1]
    structure = arrays.structure
    structure.couplings, structure.coupling_width, structure.coupling_further = len(rows), width, len(further)
    arrays.integers(
        coupling_at=[
            [row, ties.iq[c, 0], ties.iv[c, 0], ties.iq[c, 1], ties.iv[c, 1]] for c, row in rows.items()
        ],
        further_at=[[order[c], iq, iv] for c, iq, iv, _ in further],
    )
    arrays.reals(
        coupling_curve=ties.coefficients[list(rows)].reshape(len(rows), width),
        further_arm=[arm for _, _, _, arm in further],
    )


def _blocks(mechanism: Mechanism, path: RegularPath, arrays: Arrays) -> None:
    """The order of substitution."""
    blocks = path.blocks
    none: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    dependent = _velocities_of_rest(mechanism)[path.dependent]
    arrays.structure.blocks = len(blocks)
    arrays.integers(
        block_start=np.cumsum([0, *(len(block.rows) for block in blocks)]),
        block_rows=np.concatenate([none, *(block.rows for block in blocks)]),
        block_columns=np.concatenate([none, *(dependent[block.columns] for block in blocks)]),
    )
    arrays.reals(reference=path.factor.reference)


def _forces(mechanism: Mechanism, turns: list[Array], arrays: Arrays) -> None:
    """Forces known by their numbers; the others are asked, see `answers`."""
    model, known = mechanism.near, () if mechanism.applied is None else mechanism.applied.known
    damping, drive = np.zeros(mechanism.nv), np.zeros(mechanism.nv)
    spring_at, spring, line_joint, line = [], [], [], []
    for force in known:
        if isinstance(force, PointSpring):
            ends = [frame_of(model, name, "PointSpring") for name in (force.frame1, force.frame2)]
            line_joint += [int(end.parentJoint) for end in ends]
            points = [turns[end.parentJoint].T @ end.placement.translation for end in ends]
            line.append([*points[0], *points[1], force.stiffness, force.rest_length, force.damping])
            continue
        if isinstance(force, JointSpring):
            joint = force.place(mechanism.joints)
            spring_at += [joint.idx_q, joint.idx_v]
            spring.append([force.stiffness, force.rest])
        elif isinstance(force, JointDamper):
            damping[force.place(mechanism.joints).v] += force.damping
        elif isinstance(force, JointTorque):
            drive[force.place(mechanism.joints).v] += force.torque
    arrays.structure.springs, arrays.structure.lines = len(spring), len(line)
    arrays.structure.forces = bool(known)
    arrays.integers(spring_at=spring_at, line_joint=line_joint)
    arrays.reals(spring=spring, damping=damping, drive=drive, line=line)
