"""A graph of bodies and joints drawn as a mechanism: along another tree, in other axes, places and units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from robust_gcp.checks import shown
from robust_gcp.errors import ModelError
from robust_gcp.mechanism.constraint.closures import Closure, PointClosure, PrismaticClosure, RevoluteClosure
from robust_gcp.mechanism.forces.forces import Force, JointDamper, JointSpring, JointTorque, PointSpring
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array

from .graph import Edge, Graph, Link, X


@dataclass(frozen=True)
class View:
    """How a mechanism is drawn anew.

    Attributes
    ----------
    cuts : tuple of str or None
        Edges that close the loops; None: those that do so in the original.
    order : int
        Seed of the order in which the tree grows; 0: that of the original.
    turn : ndarray (3, 3) or None
        Rotation of everything, gravity too.
    shift : ndarray (3,) or None
        Where the original's origin stands, m.
    unit : float
        Numbers of the length unit in a metre.
    hinged : bool
        Planar loops are closed by hinges (five rows, three of them redundant) instead of points.
    """

    cuts: tuple[str, ...] | None = None
    order: int = 0
    turn: Array | None = None
    shift: Array | None = None
    unit: float = 1.0
    hinged: bool = False


class Drawing:
    """A graph drawn as a mechanism, at q = 0 at the start (a ball's and a free body's: no rotation).

    Parameters
    ----------
    graph : Graph
    view : View

    Attributes
    ----------
    mechanism : Mechanism
        With the best conditioned independent joints, and a frame `body:i` on each body.
    v0 : ndarray (nv,)
        The velocity at the start.
    """

    def __init__(self, graph: Graph, view: View) -> None:
        self._graph, self._view = graph, view
        self._turn = np.eye(3) if view.turn is None else view.turn
        self._shift = np.zeros(3) if view.shift is None else view.shift
        model = self._model = pin.Model()
        model.name = graph.mechanism.name
        model.gravity.linear = self._turn @ graph.mechanism.own_model.gravity.linear * view.unit
        cuts = graph.cuts if view.cuts is None else view.cuts
        left = [edge for edge in graph.edges if edge.name not in cuts]
        if view.order:
            left = [left[i] for i in np.random.default_rng(view.order).permutation(len(left))]
        self._index = {0: 0}
        self._origin: dict[int, Array] = {0: np.zeros(3)}
        self._rates: list[Array] = []
        self._grow(0, left)
        self._add_frames()
        closing = [edge for edge in graph.edges if edge.name in cuts and edge.kind is not Link.NOTHING]
        closures = [self._closure(edge) for edge in closing]
        forces = [self._in_unit(force) for force in graph.mechanism.forces]
        self.v0: Array = np.concatenate(self._rates)
        self.mechanism = Mechanism.from_pinocchio(
            model, closures, "auto" if closures else None, pin.neutral(model), model.name, forces
        )

    def _place(self, p: Array) -> Array:
        """Where a point of the original is."""
        return np.asarray(self._turn @ (p + self._shift) * self._view.unit)

    def _grow(self, body: int, left: list[Edge]) -> None:
        """Add what hangs on a body, depth first."""
        graph, model = self._graph, self._model
        for edge in left:
            if body not in (edge.a, edge.b):
                continue
            other, sense = (edge.b, 1.0) if body == edge.a else (edge.a, -1.0)
            if other in self._index:
                continue
            axis, at = sense * (self._turn @ edge.axis), self._place(edge.point)
            placement = pin.SE3(np.eye(3), at - self._origin[body])
            joint = int(model.addJoint(self._index[body], _joint(edge.kind, axis), placement, edge.name))
            self._index[other], self._origin[other] = joint, at
            inertia = graph.inertia(other)
            turned = self._turn @ inertia.inertia @ self._turn.T * self._view.unit**2
            own = pin.Inertia(inertia.mass, self._place(inertia.lever) - at, turned)
            model.appendBodyToJoint(joint, own, pin.SE3.Identity())
            linear, angular = (self._turn @ part for part in graph.rates(edge.point, body, other))
            self._rates.append(_rate(edge.kind, axis, linear * self._view.unit, angular))
            self._grow(other, left)

    def _add_frames(self) -> None:
        """A frame on each body, and all that forces are tied to, where the original has them."""
        for name, (body, pose) in self._graph.frames().items():
            place = self._place(pose.translation) - self._origin[body]
            self._frame(name, body, pin.SE3(self._turn @ pose.rotation, place))

    def _frame(self, name: str, body: int, placement: pin.SE3) -> None:
        self._model.addFrame(pin.Frame(name, self._index[body], placement, pin.FrameType.OP_FRAME))

    def _closure(self, edge: Edge) -> Closure:
        names = (f"{edge.name}|a", f"{edge.name}|b")
        for name, body in zip(names, (edge.a, edge.b), strict=True):
            self._frame(name, body, pin.SE3(np.eye(3), self._place(edge.point) - self._origin[body]))
        x, y, z = (self._turn @ edge.axis).tolist()
        if edge.kind is Link.SLIDE:
            return PrismaticClosure(*names, axis=(x, y, z))
        if edge.kind is Link.HINGE and (self._view.hinged or not self._graph.planar):
            return RevoluteClosure(*names, axis=(x, y, z))
        return PointClosure(*names)

    def _in_unit(self, force: Force) -> Force:
        """A force in the unit of length, at joints whose zero is the start."""
        unit = self._view.unit
        if isinstance(force, PointSpring):
            return replace(force, rest_length=force.rest_length * unit)
        if not isinstance(force, JointSpring | JointDamper | JointTorque):
            raise ModelError(f"descriptions: {shown(force)} cannot be drawn in another unit of length")
        slides = self._graph.edge(force.joint).kind is Link.SLIDE
        rotary = 1.0 if slides else unit**2
        if isinstance(force, JointTorque):
            return replace(force, torque=force.torque * (unit if slides else rotary))
        if isinstance(force, JointDamper):
            return replace(force, damping=force.damping * rotary)
        rest = (force.rest - self._graph.start(force.joint)) * (unit if slides else 1.0)
        return replace(force, stiffness=force.stiffness * rotary, rest=rest)

    def poses(self, q: Array) -> Array:
        """As `Graph.poses`, of this mechanism's configurations, in the world of the original."""
        found = self._graph.poses_of(self.mechanism.own_model, q, by_frames=True)
        rotations = np.einsum("ba,kibc->kiac", self._turn, found[0])
        places = found[1] @ self._turn / self._view.unit - self._shift
        return self._graph.flattened(rotations, places)


def _joint(kind: Link, axis: Array) -> pin.JointModel:
    if kind is Link.BALL:
        return pin.JointModelSpherical()
    if kind is Link.NOTHING:
        return pin.JointModelFreeFlyer()
    if kind is Link.HINGE:
        return pin.JointModelRX() if np.array_equal(axis, X) else pin.JointModelRevoluteUnaligned(axis)
    return pin.JointModelPrismaticUnaligned(axis)


def _rate(kind: Link, axis: Array, linear: Array, angular: Array) -> Array:
    """Of a joint whose axes are the world's."""
    rates = {
        Link.HINGE: np.array([axis @ angular]),
        Link.SLIDE: np.array([axis @ linear]),
        Link.BALL: angular,
        Link.NOTHING: np.concatenate([linear, angular]),
    }
    return rates[kind]
