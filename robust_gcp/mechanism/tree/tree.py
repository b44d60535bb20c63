"""The spanning tree: the one place where Pinocchio's algorithms are called during a simulation."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from ...errors import ModelError
from .columns import with_simple_joints
from .joints import Array as Array
from .joints import Joint, carrying, in_v, joints_of
from .workspace import workspace


class Tree(threading.local):
    """A `pin.Model` with one workspace a thread, and views into it that stay valid.

    Reading an attribute of `pin.Data` costs as much as the algorithm that filled it, so each result
    is read through a NumPy view made once: `placements` `(R, p)` of all joints, their velocities and
    accelerations, the joint Jacobian J. What one thread computes stays in its views: whoever holds a
    tree may use it from any thread. A thread makes its workspace when it first uses the tree, and
    frees it when it ends; the model is shared.

    Parameters
    ----------
    model : pin.Model
        Never written to.
    points : sequence of (int, pin.SE3), optional
        Parent joint and placement of each frame to follow (the closures' frames).

    Attributes
    ----------
    frame_R, frame_p : ndarray (npoints, 3, 3), (npoints, 3)
        World placement of the followed frames; valid after `jacobians`.
    R, p : ndarray (njoints, 3, 3), (njoints, 3)
        World placement of each joint, m; valid after `jacobians`.
    J : ndarray (nv, 6)
        Transposed joint Jacobian in the world frame (linear, angular); valid after `jacobians`.
    dJ : ndarray (nv, 6)
        Its rate; valid after `jacobian_rates`.
    v, a : ndarray (njoints, 6)
        Spatial velocity and acceleration (minus gravity) of each joint in its own frame (linear,
        angular); valid after `rnea`.
    q, qdot : ndarray (nq,), (nv,)
        What `jacobians` and `rnea` were last called with.
    joined : list of [(int, pin.SE3), (int, pin.SE3)]
        Of `points` those whose origins a closure holds together.
    """

    __slots__ = ("_massive", "_rotors", "joined", "model")  # slots are shared by all threads, the rest is not
    model: pin.Model
    _massive: pin.Model
    _rotors: Array | None
    joined: list[list[tuple[int, pin.SE3]]]

    def __init__(self, model: pin.Model, points: Sequence[tuple[int, pin.SE3]] = ()) -> None:
        if not hasattr(self, "model"):  # runs again, with these arguments, in each further thread
            self._share(model, points)
        first = self.model.nframes - len(points)  # the points are its last frames
        self.data = workspace(self.model)
        self.nq, self.nv = int(model.nq), int(model.nv)
        self.vector_space = self.nq == self.nv
        self.zero = np.zeros(self.nv)
        self._carrying: dict[int, Array] = {}
        self.q: Array = pin.neutral(self.model)
        self.qdot: Array = self.zero
        # with a single velocity Pinocchio hands out a flat vector; its reshaped transpose is still a view
        self.J: Array = self.data.J.reshape((6, self.nv), order="F").T
        self.dJ: Array = self.data.dJ.reshape((6, self.nv), order="F").T
        self.p = _stacked([m.translation for m in self.data.oMi])
        self.R = _stacked([m.rotation for m in self.data.oMi])
        frames = list(self.data.oMf)
        self.frame_p = _stacked([m.translation for m in frames])[first:]
        self.frame_R = _stacked([m.rotation for m in frames])[first:]
        self.v = _stacked([_motion(m) for m in self.data.v])
        self.a = _stacked([_motion(m) for m in self.data.a_gf])

    def _share(self, model: pin.Model, points: Sequence[tuple[int, pin.SE3]]) -> None:
        """What no algorithm writes to: the model with the points, and the same without rotor inertia."""
        self.model, self.joined = model.copy(), []
        for i, (joint, placement) in enumerate(points):
            kind = pin.FrameType.OP_FRAME
            self.model.addFrame(pin.Frame(f"closure frame {i}", joint, placement, kind), False)
        rotors: Array = np.array(model.armature, dtype=float)
        self._rotors, self._massive = None, self.model
        if np.any(rotors):
            self._rotors, self._massive = rotors, self.model.copy()
            self._massive.armature = np.zeros(model.nv)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """All joints but the ground, in the order of q and v."""
        return joints_of(self.model)

    @cached_property
    def rotates(self) -> NDArray[np.bool_]:
        """Which velocities turn their bodies, (nv,); the others slide them."""
        return np.array([c.unit == "rad" for c in in_v(self.joints)], dtype=bool)

    @cached_property
    def periodic(self) -> NDArray[np.bool_]:
        """Which velocities are rates of angles in q, (nv,): whole turns of them change nothing."""
        return np.array([c.periodic for c in in_v(self.joints)], dtype=bool)

    def jacobians(self, q: Array) -> None:
        """Placements and joint Jacobians at q (nq,)."""
        self.q = q
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)

    def lifted(self, joint: int, point: Array, force: Array, moment: Array) -> Array:
        """τ (nv,) of a force at a point of a joint's body and a moment, in world axes; after `jacobians`.

        J of the body at the world's origin serves any point of it.
        """
        (x, y, z), (fx, fy, fz), (mx, my, mz) = point.tolist(), force.tolist(), moment.tolist()
        about_origin = np.array(
            (fx, fy, fz, mx + (y * fz - z * fy), my + (z * fx - x * fz), mz + (x * fy - y * fx))
        )
        if joint not in self._carrying:
            self._carrying[joint] = carrying(self.model, joint)
        tau: Array = self._carrying[joint] * self.J.dot(about_origin)
        return tau

    @cached_property
    def _chain(self) -> tuple[pin.Model, pin.Data] | None:
        """The tree by simple joints where some are not: Pinocchio leaves out how their subspaces turn."""
        chain = with_simple_joints(self.model, self.joints)
        return None if chain is self.model else (chain, workspace(chain))

    def jacobian_rates(self, q: Array, v: Array) -> None:
        """Rates of the joint Jacobians at q (nq,) along v (nv,), besides what `jacobians` computes.

        Raises
        ------
        ModelError
            For an ellipsoid joint, which is no chain of simple ones.
        """
        self.q, self.qdot = q, v
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)
        pin.updateFramePlacements(self.model, self.data)
        if self._chain is not None:
            model, data = self._chain
            pin.computeJointJacobiansTimeVariation(model, data, q, v)
            self.dJ[:] = data.dJ.reshape((6, self.nv), order="F").T

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """M(q) a + C(q, v), (nv,), N or N m; leaves the joints' v and a in their views."""
        self.q, self.qdot = q, v
        tau: Array = pin.rnea(self.model, self.data, q, v, a)
        return tau

    def crba(self, q: Array) -> Array:
        """Joint-space inertia M(q), (nv, nv), kg, kg m or kg m²."""
        M: Array = pin.crba(self.model, self.data, q)
        return M

    def kinetic(self, q: Array, v: Array) -> float:
        """½ vᵀ M v as the sum over the bodies and rotors, J.

        Where joints move against each other so that their bodies hardly move, vᵀ M v cancels and
        this does not. The rotors are added here: Pinocchio's sum leaves them out for joints of several
        kinds, revolute joints with an axis other than x, y and z among them.
        """
        bodies = float(pin.computeKineticEnergy(self._massive, self.data, q, v))
        if self._rotors is None:
            return bodies
        return bodies + 0.5 * float(self._rotors.dot(v * v))

    def energies(self, q: Array, v: Array) -> tuple[float, float]:
        """Kinetic and potential energy, J."""
        return self.kinetic(q, v), float(pin.computePotentialEnergy(self.model, self.data, q))

    def integrate(self, q: Array, dv: Array) -> Array:
        """q ⊕ dv: the configuration reached from q along the tangent dv."""
        if self.vector_space:
            return q + dv
        moved: Array = pin.integrate(self.model, q, dv)
        return moved

    def difference(self, q0: Array, q1: Array) -> Array:
        """q1 ⊖ q0: the tangent (nv,) that leads from q0 to q1."""
        if self.vector_space:
            return q1 - q0
        tangent: Array = pin.difference(self.model, q0, q1)
        return tangent

    def difference_rate(self, q0: Array, q1: Array) -> Array:
        """∂(q1 ⊖ q0)/∂q1, (nv, nv)."""
        if self.vector_space:
            return np.eye(self.nv)
        D: Array = pin.dDifference(self.model, q0, q1, pin.ArgumentPosition.ARG1)
        return D

    def integrate_rate(self, q: Array, dv: Array) -> Array:
        """∂(q ⊕ dv)/∂dv, (nv, nv)."""
        if self.vector_space:
            return np.eye(self.nv)
        D: Array = pin.dIntegrate(self.model, q, dv, pin.ArgumentPosition.ARG1)
        return D


def require_depth_first(model: pin.Model) -> None:
    """Refuse a joint order for which Pinocchio's CRBA is silently wrong.

    CRBA sums over a subtree as a contiguous block of joints, so each joint must follow its parent's
    subtree directly: siblings may not come before their nephews.

    Raises
    ------
    ModelError
        Naming the first joint out of order.
    """
    for joint in range(2, model.njoints):
        parent = model.parents[joint]
        if parent not in (*model.supports[joint - 1], joint - 1):
            raise ModelError(
                f"joint {model.names[joint]!r} is out of depth-first order: it follows "
                f"{model.names[joint - 1]!r}, which does not descend from its parent "
                f"{model.names[parent]!r}, and Pinocchio's crba is wrong for such a model; "
                "add each joint's whole subtree before its next sibling"
            )


def _motion(motion: pin.Motion) -> Array:
    """The six numbers of a motion as one view: linear and angular parts are neighbours in memory."""
    linear: Array = motion.linear
    if _address(motion.angular) - _address(linear) != 24:  # pragma: no cover
        raise RuntimeError("this build of Pinocchio lays motions out in an unknown way")
    return as_strided(linear, shape=(6,), strides=(8,))


def _address(array: Array) -> int:
    return int(array.__array_interface__["data"][0])


def _stacked(views: list[Any]) -> Array:
    """One view over equally spaced elements of a std::vector."""
    step = _address(views[1]) - _address(views[0]) if len(views) > 1 else 8
    addresses = [_address(view) for view in views]
    if any(b - a != step for a, b in pairwise(addresses)):  # pragma: no cover
        raise RuntimeError("this build of Pinocchio does not keep joint results contiguous")
    first = views[0]
    return as_strided(first, shape=(len(views), *first.shape), strides=(step, *first.strides))
