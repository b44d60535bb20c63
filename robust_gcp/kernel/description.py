"""A mechanism as the plain arrays that the compiled kernel reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..maps.cluster.space import space_of
from ..maps.regular_path import RegularPath
from ..mechanism.actuation.tendon_springs import TendonSpring
from ..mechanism.constraint.closures import frame_of
from ..mechanism.coordinates.clusters import LoopCluster
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.forces.forces import JointDamper, JointSpring, JointTorque, PointSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..mechanism.tree.workspace import memory_left, workspace_bytes
from .loop_arrays import (
    NotNativeError,
    closure_arrays,
    coupling_arrays,
    in_own_units,
    loops_arrays,
    tree_arrays,
)
from .path_arrays import path_arrays
from .structures import Arrays, Cluster, Description


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
    found: Arrays = mechanism.memo.once(key, lambda: _described(mechanism, path, works, driven))
    found.refresh()
    return found


def describe_all(mechanism: Mechanism) -> Arrays:
    """All joints, forces and rows of φ in their own units, whatever the path; kept for each mechanism.

    Raises
    ------
    NotNativeError
        For a joint that the kernel does not know.
    """

    def made() -> Arrays:
        arrays, turns = in_own_units(mechanism)
        _forces(mechanism, turns, arrays)
        return arrays

    found: Arrays = mechanism.memo.once("description of all for the kernel", made)
    found.refresh()
    return found


def _described(mechanism: Mechanism, path: RegularPath, works: bool, driven: tuple[int, ...]) -> Arrays:
    if mechanism.m == 0:
        raise NotNativeError("the mechanism has no degree of freedom")
    needed = workspace_bytes(mechanism.nv, mechanism.own_model.njoints)
    if mechanism.m > 1 and needed > memory_left():
        raise NotNativeError(f"the mechanism has {mechanism.nv} velocities, which take {needed / 1e9:.3g} GB")
    description = Description(
        joints=mechanism.own_model.njoints - 1, nq=mechanism.nq, nv=mechanism.nv, m=mechanism.m, works=works
    )
    arrays = Arrays(description)
    turns = tree_arrays(mechanism, arrays)
    rest = path.mechanism
    column_scale, scale = mechanism.column_scale.copy(), np.ones(mechanism.nv)
    own = _velocities_of_rest(mechanism)
    column_scale[own] = rest.column_scale
    # columns of the dependent joints alone, so that y and G keep their own units
    scale[own[path.dependent]] = rest.column_scale[path.dependent]
    in_q: NDArray[np.int64] = np.full(mechanism.m, -1)
    in_q[mechanism.numbers] = mechanism.iq_numbers  # −1 where a coordinate is no number in q
    arrays.structure.driven = len(driven)
    arrays.integers(independent=mechanism.iv_independent, independent_q=in_q, driven_y=driven)
    arrays.reals(size=1.0 / column_scale, turn=1.0 / mechanism.units, scale=scale)
    arrays.reals(own=[mechanism.joint_inertia])
    closure_arrays(mechanism, path.mechanism, path.rows, turns, arrays, path.points)
    coupling_arrays(mechanism, path.mechanism, path.rows, arrays)
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
    description, _ = loops_arrays(loops)
    description.structure.m = cluster.m
    description.reals(scale=space.D)  # in the cluster's own dimensionless coordinates
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
    """Forces known by their numbers; the others are asked, see `dynamics.acting`."""
    model, known = mechanism.near, () if mechanism.applied is None else mechanism.applied.known
    damping, drive = np.zeros(mechanism.nv), np.zeros(mechanism.nv)
    spring_at, spring, line_joint, line = [], [], [], []
    path_arrays(mechanism, [force for force in known if isinstance(force, TendonSpring)], turns, arrays)
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
