"""Bodies and the joints between them, in any order, to a spanning tree and closures.

What lists joints between pairs of bodies (SDF, USD, `Linkage`) says nothing of a tree. One is taken by
Kruskal's rule: joints that join two parts of the mechanism belong to it, the others close loops as closures
of their kind. The motion does not depend on which.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ..constraint.closures import (
    FrameClosure,
    PointClosure,
    PrismaticClosure,
    RevoluteClosure,
    UniversalClosure,
)
from ..constraint.pin_constraints import close_between
from ..contents import STAYS, FileContents, named
from ..forces.forces import Force, JointDamper, JointSpring
from ..tree.joints import along
from ..tree.tree import Array
from ..tree.workspace import require_memory
from .bodies import WORLD, Body, BodyJoint

ROOT_JOINT, GROUND = "root_joint", "universe"

CHAINS = {
    "fixed": "",
    "revolute": "R",
    "prismatic": "P",
    "spherical": "S",
    "free": "F",
    "universal": "RR",
    "cylindrical": "PR",
    "planar": "PPR",
}
"""Kinds of joints as chains of Pinocchio's, the first on the parent; R and P take an axis each."""


def spanned(
    name: str, bodies: Sequence[Body], joints: Sequence[BodyJoint], gravity: Array, base: str | None = None
) -> FileContents:
    """Spanning tree, closures, springs and dampers of a graph of bodies; home is the pose that is drawn.

    In the tree come first the joints that no closure stands for, then those marked `kept`, then those with
    springs or dampers, then the others in their order, those marked `cut` last. A body that no joint leads
    to from the ground floats, unless `base` is "fixed". With "free" the bodies welded to the ground float.

    Raises
    ------
    ModelError
        Naming the joint: between bodies that are not there, with a name that is taken, or one that closes a
        loop and is of a kind without a closure.
    """
    require_memory(sum(len(CHAINS[joint.kind]) for joint in joints), len(joints))
    graph = _Graph(name, bodies, joints, base)
    model = pin.Model()
    model.name = name
    model.gravity.linear = np.asarray(gravity, dtype=float)
    contents = FileContents(model)
    graph.build(contents)
    if model.nv == 0:
        raise ModelError(f"{name}: no joint moves; a mechanism needs one at least, or base='free'")
    graph.close(contents)
    rub = np.zeros(model.nv)
    for joint in (j for j in joints if j.friction and model.existJointName(j.name)):
        rub[model.idx_vs[model.getJointId(joint.name)]] = joint.friction
    model.upperDryFrictionLimit, model.lowerDryFrictionLimit = rub, -rub
    return contents


class _Graph:
    """Which joint leads to which body, and where bodies are on joints."""

    def __init__(
        self, name: str, bodies: Sequence[Body], joints: Sequence[BodyJoint], base: str | None
    ) -> None:
        self.name, self._base = name, base
        self._bodies = {WORLD: Body(WORLD, pin.SE3.Identity())} | {body.name: body for body in bodies}
        self._require_names([body.name for body in bodies], joints)
        self._parts = {body: body for body in self._bodies}
        order = sorted(joints, key=_lateness)  # a stable sort: equal ones as the file has them
        self._standing: list[str] = []
        if base == "free":
            order = self._freed(order)
        self._tree = [joint for joint in order if self._joins(joint)]
        in_tree, there = set(map(id, self._tree)), set(map(id, order))
        self._tree = [joint for joint in joints if id(joint) in in_tree]  # the file's order numbers q
        self._loops = [joint for joint in joints if id(joint) in there - in_tree]
        self._touching: dict[str, list[BodyJoint]] = {body: [] for body in self._bodies}
        for joint in self._tree:
            self._touching[joint.parent].append(joint)
            self._touching[joint.child].append(joint)
        self._places: dict[str, tuple[int, pin.SE3]] = {WORLD: (0, pin.SE3.Identity())}

    def build(self, contents: FileContents) -> None:
        """Add all joints to the model, depth first: Pinocchio's crba is wrong for others."""
        numbers: list[Array] = []
        self._grow(WORLD, contents, numbers)
        led = {joint.child for joint in self._tree}  # a floating tree is rooted where no joint leads to
        for first in [b for b in self._bodies if b not in led] + list(self._bodies):
            if first not in self._places:
                kind = "fixed" if self._base == "fixed" else "free"
                label = ROOT_JOINT if ROOT_JOINT not in contents.model.names else f"{first}_{ROOT_JOINT}"
                pose = self._bodies[first].pose
                start = pose if kind == "fixed" and pose is not None else pin.SE3.Identity()
                root = BodyJoint(label, kind, WORLD, first, start, pin.SE3.Identity())
                self._attach(root, WORLD, contents, numbers)
                self._grow(first, contents, numbers)
        contents.home = np.concatenate([np.zeros(0), *numbers])
        contents.left_out += named(STAYS, self._standing)

    def close(self, contents: FileContents) -> None:
        """The joints outside the tree as closures."""
        lost: list[str] = []
        for joint in self._loops:
            if joint.kind not in CLOSURES:
                raise ModelError(
                    f"{self.name}: joint {joint.name!r} closes a loop of joints that are all of kinds that "
                    f"no closure stands for ({joint.kind}); make one of them {', '.join(CLOSURES)}"
                )
            ends = [
                (self._places[body][0], self._places[body][1] * place)
                for body, place in ((joint.parent, joint.on_parent), (joint.child, joint.on_child))
            ]
            kind = CLOSURES[joint.kind]
            if joint.kind == "universal":
                first, second = (tuple(map(float, axis)) for axis in joint.axes)
                kind = partial(kind, axis=second, axis2=first)
            elif joint.axes:
                kind = partial(kind, axis=tuple(map(float, joint.axes[0])))
            # the parent's is frame 2, in which a closure's axis of sliding is fixed
            contents.closures.append(close_between(contents.model, kind, joint.name, (ends[1], ends[0])))
            if joint.damping or joint.stiffness:
                lost.append(joint.name)
        contents.left_out += named("springs and dampers of joints that close loops", lost)

    def _require_names(self, names: Sequence[str], joints: Sequence[BodyJoint]) -> None:
        for what, given in (
            ("body", [WORLD, GROUND, *names]),
            ("joint", [GROUND, *(j.name for j in joints)]),
        ):
            twice = sorted(label for label, count in Counter(given).items() if count > 1)
            if twice:
                raise ModelError(f"{self.name}: more than one {what} is called {twice[0]!r}; rename one")
        for joint in joints:
            for end in (joint.parent, joint.child):
                if end not in self._bodies:
                    raise ModelError(f"{self.name}: joint {joint.name!r}: there is no body {end!r}")
            if joint.parent == joint.child:
                raise ModelError(f"{self.name}: joint {joint.name!r} ties {joint.parent!r} to itself")

    def _freed(self, order: list[BodyJoint]) -> list[BodyJoint]:
        """The joints without those that weld moving bodies to the ground."""
        welded = [j for j in order if j.kind == "fixed" and WORLD in (j.parent, j.child)]
        tied = [j for j in order if j.kind != "fixed" and WORLD in (j.parent, j.child)]
        free = [j for j in tied if j.kind == "free"]
        if not free and tied:
            raise ModelError(
                f"{self.name}: base='free' needs a body that stands on the ground by itself, and "
                f"{tied[0].name!r} is a joint on the ground; put the ground into a body"
            )
        if free:
            self._standing = [j.child for j in welded]
            return order
        return [j for j in order if j not in welded]

    def _joins(self, joint: BodyJoint) -> bool:
        """Whether it joins two parts, which are one from now on (union–find)."""
        ends = [self._part(joint.parent), self._part(joint.child)]
        if ends[0] == ends[1]:
            return False
        self._parts[ends[1]] = ends[0]
        return True

    def _part(self, body: str) -> str:
        while self._parts[body] != body:
            self._parts[body] = self._parts[self._parts[body]]  # halves the way for the next to ask
            body = self._parts[body]
        return body

    def _grow(self, body: str, contents: FileContents, numbers: list[Array]) -> None:
        """Everything that hangs on a body by joints of the tree."""
        # no recursion: a chain may have thousands of joints
        pending = [(joint, body) for joint in reversed(self._touching[body])]
        while pending:
            joint, near = pending.pop()
            far = joint.child if joint.parent == near else joint.parent
            if far in self._places:
                continue
            self._attach(joint, near, contents, numbers)
            pending += [(further, far) for further in reversed(self._touching[far])]

    def _attach(self, joint: BodyJoint, near: str, contents: FileContents, numbers: list[Array]) -> None:
        """One joint of the tree and its body; gone through from its child, it turns about opposite axes."""
        model, forward = contents.model, joint.parent == near
        far = joint.child if forward else joint.parent
        inner, outer = (joint.on_parent, joint.on_child) if forward else (joint.on_child, joint.on_parent)
        chain, axes = CHAINS[joint.kind], [np.asarray(a, dtype=float) for a in joint.axes]
        if not forward:
            # the same motion seen from the other body
            chain, axes = chain[::-1], [-axis for axis in axes[::-1]]
        carrier, place = self._places[near]
        place = place * inner
        one, other, moved = self._bodies[near].pose, self._bodies[far].pose, pin.SE3.Identity()
        if one is not None and other is not None:
            # as drawn, from the joint's frame on one to that on the other
            moved = (one * inner).actInv(other * outer)
        for number, letter in enumerate(chain):
            place_in_it = number + 1 if forward else len(chain) - number
            label = joint.name if len(chain) == 1 else f"{joint.name}_{place_in_it}"
            if label in model.names:
                raise ModelError(f"{self.name}: joint {joint.name!r}: the name {label!r} is taken; rename it")
            made, start = _made(letter, axes, number, moved, single=len(chain) == 1)
            low, high = _bounds(made, joint.range if len(chain) == 1 else None)
            endless = np.full(made.nv, np.inf)
            carrier = model.addJoint(carrier, made, place, label, endless, endless, low, high)
            model.addJointFrame(carrier)
            numbers.append(start)
            place = pin.SE3.Identity()
        self._places[far] = (carrier, place * outer.inverse())
        body = self._bodies[far]
        if carrier:  # what is welded to the ground has no joint, and its inertia no part
            model.appendBodyToJoint(carrier, body.inertia, self._places[far][1])
        model.addFrame(pin.Frame(far, *self._places[far], pin.FrameType.BODY), False)
        contents.forces += _forces(joint)


def _lateness(joint: BodyJoint) -> tuple[bool, ...]:
    """What is lost where it is not in the tree, the worst first."""
    return joint.cut, joint.kind in CLOSURES, not joint.kept, not (joint.damping or joint.stiffness)


def _made(
    letter: str, axes: Sequence[Array], number: int, moved: pin.SE3, single: bool
) -> tuple[pin.JointModel, Array]:
    """Pinocchio's joint, and its numbers where the child is displaced by `moved`."""
    if letter == "S":
        return pin.JointModelSpherical(), pin.SE3ToXYZQUAT(moved)[3:]
    if letter == "F":
        return pin.JointModelFreeFlyer(), pin.SE3ToXYZQUAT(moved)
    axis = axes[number] / np.linalg.norm(axes[number])
    turned = np.array([axis @ (pin.log3(moved.rotation) if letter == "R" else moved.translation)])
    return along(letter, axis), turned if single else np.zeros(1)


def _bounds(made: pin.JointModel, span: tuple[float, float] | None) -> tuple[Array, Array]:
    high = np.full(made.nq, np.inf)
    if made.nq > made.nv:  # quaternions: a little more than one, as Pinocchio's readers have it
        high[-4:] = 1.01
    return (-high, high) if span is None else (np.array([span[0]]), np.array([span[1]]))


def _forces(joint: BodyJoint) -> list[Force]:
    found: list[Force] = []
    if joint.stiffness:
        found.append(JointSpring(joint.name, joint.stiffness, joint.rest))
    if joint.damping:
        found.append(JointDamper(joint.name, joint.damping))
    return found


CLOSURES: dict[str, Any] = {
    "spherical": PointClosure,
    "fixed": FrameClosure,
    "revolute": RevoluteClosure,
    "prismatic": PrismaticClosure,
    "universal": UniversalClosure,
}
