"""A mechanism as a graph of bodies and joints, from which it can be described anew.

A joint of the tree and a cut joint are both edges of one graph: any spanning tree of it, drawn in any axes
and units, is the same mechanism.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from robust_gcp.errors import OptionError
from robust_gcp.mechanism.constraint.closures import (
    AxisClosure,
    PointClosure,
    PrismaticClosure,
    RevoluteClosure,
    frame_of,
)
from robust_gcp.mechanism.constraint.couplings import AnyClosure, CouplingClosure
from robust_gcp.mechanism.forces.forces import PointSpring
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.joints import JointKind
from robust_gcp.mechanism.tree.tree import Array

PARALLEL = 1e-9
"""Sine of the angle between hinges of a planar linkage."""

X = np.array([1.0, 0.0, 0.0])


class Link(Enum):
    """What holds two bodies together."""

    HINGE = "hinge"
    SLIDE = "slide"
    BALL = "ball"
    NOTHING = "nothing"  # a free body: an edge of a tree that needs no closure where it is cut


@dataclass(frozen=True)
class Edge:
    """A joint between bodies a and b, at home.

    Attributes
    ----------
    name : str
    kind : Link
    a, b : int
        Bodies by their number, 0 the ground; b moves against a along or about the axis.
    point, axis : ndarray (3,)
        In the world, m.
    """

    name: str
    kind: Link
    a: int
    b: int
    point: Array
    axis: Array


class Graph:
    """The graph of a mechanism in a state, with what is needed to draw it anew.

    Parameters
    ----------
    mechanism : Mechanism
        Of hinges, slides, balls and free bodies, closed by points, hinges or slides.
    q, v : ndarray (nq,), (nv,)
        The start.

    Raises
    ------
    OptionError
        For other joints and closures.
    """

    def __init__(self, mechanism: Mechanism, q: ArrayLike, v: ArrayLike) -> None:
        self.mechanism = mechanism
        model = self._model = mechanism.own_model
        data = model.createData()
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacements(model, data)
        self._poses = [data.oMi[i].copy() for i in range(model.njoints)]
        self._twists = [self._poses[i].act(data.v[i]) for i in range(model.njoints)]
        self._frames = {f.name: (int(f.parentJoint), data.oMf[i].copy()) for i, f in enumerate(model.frames)}
        hinges = [j for j in mechanism.joints if j.kind is JointKind.REVOLUTE]
        axes = [self._poses[j.index].rotation @ np.asarray(j.axis) for j in hinges]
        self.normal = axes[0] if axes else X
        self.planar = bool(axes) and all(
            np.linalg.norm(np.cross(axis, self.normal)) < PARALLEL for axis in axes
        )
        edges = [self._of_joint(j.name, j.kind, j.index, j.axis) for j in mechanism.joints]
        cut = [self._of_closure(closure) for closure in mechanism.closures]
        self._home = {j.name: float(q[j.idx_q]) for j in mechanism.joints if j.nq == 1}
        self.edges = [*edges, *cut]
        self.cuts = tuple(edge.name for edge in cut)

    def _of_joint(self, name: str, kind: JointKind, index: int, axis: Array | None) -> Edge:
        kinds = {
            JointKind.REVOLUTE: Link.HINGE,
            JointKind.PRISMATIC: Link.SLIDE,
            JointKind.SPHERICAL: Link.BALL,
            JointKind.FREE_FLYER: Link.NOTHING,
        }
        if kind not in kinds:
            raise OptionError(f"joint {name!r} of kind {kind.name} is not drawn anew")
        pose, parent = self._poses[index], int(self._model.parents[index])
        turned = X if axis is None else pose.rotation @ np.asarray(axis)
        return Edge(name, kinds[kind], parent, index, pose.translation.copy(), turned)

    def _of_closure(self, closure: AnyClosure) -> Edge:
        if isinstance(closure, CouplingClosure):
            raise OptionError("couplings are not drawn anew")
        ends = [frame_of(self._model, name, "closure") for name in (closure.frame1, closure.frame2)]
        place = self._frames[closure.frame1][1]
        a, b = (int(frame.parentJoint) for frame in ends)
        name = f"{closure.frame1}:{closure.frame2}"
        axis = self.normal
        if isinstance(closure, AxisClosure):
            axis = place.rotation @ np.array(closure.across()[0])
        if isinstance(closure, RevoluteClosure):
            return Edge(name, Link.HINGE, a, b, place.translation.copy(), axis)
        if isinstance(closure, PrismaticClosure):
            return Edge(name, Link.SLIDE, a, b, place.translation.copy(), axis)
        if isinstance(closure, PointClosure):
            kind = Link.HINGE if self.planar else Link.BALL
            return Edge(name, kind, a, b, place.translation.copy(), axis)
        raise OptionError(f"closure {name}: {type(closure).__name__} is not drawn anew")

    # ----------------------------------------------------------------- other descriptions

    def spanning_cuts(self, rng: np.random.Generator) -> tuple[str, ...]:
        """The edges that a random spanning tree leaves over."""
        held = {force.joint for force in self.mechanism.forces if not isinstance(force, PointSpring)}
        group = list(range(len(self._poses)))
        cuts = []
        edges = [self.edges[i] for i in rng.permutation(len(self.edges))]
        for edge in sorted(edges, key=lambda edge: edge.name not in held):
            one, two = group[edge.a], group[edge.b]
            if one == two:
                cuts.append(edge.name)
            group = [one if g == two else g for g in group]
        return tuple(sorted(cuts))

    # ----------------------------------------------------------------- the start

    def edge(self, name: str) -> Edge:
        """The edge of that name."""
        return next(edge for edge in self.edges if edge.name == name)

    def start(self, joint: str) -> float:
        """q of a joint with one number."""
        return self._home[joint]

    def inertia(self, body: int) -> pin.Inertia:
        """Of a body, in the world."""
        return self._poses[body].act(self._model.inertias[body])

    def rates(self, point: Array, body: int, other: int) -> tuple[Array, Array]:
        """Velocity at a point and angular velocity of a body against another, in the world."""
        apart = self._twists[other] - self._twists[body]
        return apart.linear + np.cross(apart.angular, point), apart.angular.copy()

    def frames(self) -> dict[str, tuple[int, pin.SE3]]:
        """A frame `body:i` for each body, and those that forces are tied to, in the world."""
        wanted = {f"body:{i}": (i, pose) for i, pose in enumerate(self._poses)}
        for force in self.mechanism.forces:
            if isinstance(force, PointSpring):
                wanted |= {name: self._frames[name] for name in (force.frame1, force.frame2)}
        return wanted

    # ----------------------------------------------------------------- the common output

    def poses(self, q: Array) -> Array:
        """Rotation and position / length of every body, (len(q), bodies, 12)."""
        return self.flattened(*self.poses_of(self._model, q))

    def poses_of(self, model: pin.Model, q: Array, by_frames: bool = False) -> tuple[Array, Array]:
        """Rotations (len(q), bodies, 3, 3) and positions (…, 3); those of another model by its `body:i`."""
        data = model.createData()
        bodies = range(1, len(self._poses))
        ids = [int(model.getFrameId(f"body:{i}")) for i in bodies] if by_frames else []
        rotations, places = np.empty((len(q), len(bodies), 3, 3)), np.empty((len(q), len(bodies), 3))
        for k, one in enumerate(q):
            pin.forwardKinematics(model, data, one)
            pin.updateFramePlacements(model, data)
            poses = [data.oMf[i] for i in ids] if by_frames else [data.oMi[i] for i in bodies]
            for i, pose in enumerate(poses):
                rotations[k, i], places[k, i] = pose.rotation, pose.translation
        return rotations, places

    def flattened(self, rotations: Array, places: Array) -> Array:
        """Both in one array, positions in lengths."""
        flat = rotations.reshape(*rotations.shape[:2], 9)
        return np.concatenate([flat, places / self.mechanism.length], axis=2)
