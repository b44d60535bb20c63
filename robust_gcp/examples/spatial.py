"""Spatial loops of hinges by formula: Bennett's, Sarrus', spherical four-bars, a rod between two cranks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..mechanism.constraint.closures import PointClosure, RevoluteClosure
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array

THICKNESS = 0.1
"""Radius of the rods, m: what turns about its own axis has inertia too."""


def hinge_loop(
    points: Sequence[ArrayLike], axes: Sequence[ArrayLike], independent: str = "hinge1", name: str = "loop"
) -> Mechanism:
    """A closed loop of rods from hinge to hinge, the first and the last on the ground; q = 0 at home.

    Parameters
    ----------
    points, axes : array_like (n, 3)
        Of the hinges `hinge1`, `hinge2`, … at home, m; the last one is the cut.
    """
    at, along = np.array(points, dtype=float), np.array(axes, dtype=float)
    along /= np.linalg.norm(along, axis=1)[:, None]
    model = pin.Model()
    model.name = name
    parent, origin, joint = 0, np.zeros(3), 0
    for i in range(len(at) - 1):
        placement = pin.SE3(np.eye(3), at[i] - origin)
        joint = model.addJoint(parent, pin.JointModelRevoluteUnaligned(along[i]), placement, f"hinge{i + 1}")
        model.appendBodyToJoint(joint, _rod(at[i + 1] - at[i]), pin.SE3.Identity())
        parent, origin = joint, at[i]
    model.addFrame(_frame("tip", int(joint), at[-1] - origin))
    model.addFrame(_frame("foot", 0, at[-1]))
    closure = RevoluteClosure("tip", "foot", axis=tuple(along[-1].tolist()))
    return Mechanism(model, [closure], [independent], home=np.zeros(model.nq))


def bennett(angle: float = 1.0, twists: tuple[float, float] = (0.5, 1.1), length: float = 1.0) -> Mechanism:
    """Bennett's linkage: opposite links alike, sin α / a = sin β / b; most loops of four hinges are rigid.

    Parameters
    ----------
    angle : float
        The first joint's angle, rad; the linkage is folded in a line at 0 and π.
    twists : (float, float)
        α, β between neighbouring hinge axes, rad.
    length : float
        a, m; b follows.
    """
    alpha, beta = twists
    lengths = length, length * np.sin(beta) / np.sin(alpha)
    ratio = np.sin(0.5 * (beta + alpha)) / np.sin(0.5 * (beta - alpha))
    second = 2.0 * np.arctan(ratio / np.tan(0.5 * angle))  # the half angles' product of tangents is constant
    pose, points, axes = pin.SE3.Identity(), [], []
    angles = angle, second, -angle, -second
    for i in range(4):  # Denavit and Hartenberg, without offsets
        points.append(pose.translation.copy())
        axes.append(pose.rotation[:, 2].copy())
        a, twist = (lengths[i % 2], (alpha, beta)[i % 2])
        turned = pin.SE3(pin.utils.rotate("z", angles[i]), np.zeros(3))
        pose = pose * turned * pin.SE3(pin.utils.rotate("x", twist), np.array([a, 0.0, 0.0]))
    return hinge_loop(points, axes, name="bennett")


def spherical_four_bar(
    arcs: tuple[float, float, float, float] = (1.0, 0.5, 0.75, 0.75), angle: float = 2.6, radius: float = 1.0
) -> Mechanism:
    """A four-bar on a sphere: arcs of ground, crank, coupler and rocker, rad; y = the crank.

    With ground + crank = coupler + rocker its modes meet where the crank points away from the rocker's axis.
    """
    ground, crank, coupler, rocker = arcs
    A, D = _at(0.0), _at(ground)
    B = _turned(A, _at(crank), angle)
    # C at the arcs `coupler` from B and `rocker` from D, on the side of B × D
    cosine = float(B @ D)
    x, y = np.linalg.solve([[1.0, cosine], [cosine, 1.0]], [np.cos(coupler), np.cos(rocker)])
    flat = x * B + y * D
    out = np.cross(B, D)
    # max: stretched, C lies on the arc from B to D but for rounding
    C = flat + out * np.sqrt(max(0.0, 1.0 - float(flat @ flat))) / np.linalg.norm(out)
    points = radius * np.array([A, B, C, D])
    return hinge_loop(list(points), list(points), name="spherical_four_bar")


def sarrus(height: float = 0.8, rods: tuple[float, float] = (1.0, 1.0)) -> Mechanism:
    """Sarrus' linkage: a platform lifted straight by two pairs of rods in planes at right angles.

    At height 0 both pairs lie flat and K loses rank.

    Parameters
    ----------
    height : float
        Of the platform at home, m.
    rods : (float, float)
        Length of the rods of each pair, m.
    """
    points, axes = [], []
    for axis, way, rod in ((np.eye(3)[1], np.eye(3)[0], rods[0]), (np.eye(3)[0], np.eye(3)[1], rods[1])):
        out = np.sqrt(rod**2 - 0.25 * height**2)
        foot = 0.5 * way
        chain = [foot, foot + out * way + [0.0, 0.0, 0.5 * height], foot + [0.0, 0.0, height]]
        points.append(chain)
        axes.append([axis] * 3)
    return hinge_loop([*points[0], *points[1][::-1]], [*axes[0], *axes[1]], name="sarrus")


def rod_between_cranks(angle: float = 1.0) -> Mechanism:
    """A rod between two cranks in planes at right angles (RSSR), its spin about itself held; y = `crank1`.

    The rod hangs on two crossed hinges at the first crank and on a ball at the second one.
    """
    model = pin.Model()
    model.name = "rod_between_cranks"
    tip = 0.4 * np.array([0.0, np.cos(angle), np.sin(angle)])
    foot = np.array([1.2, 0.3, 0.0])
    end = foot + np.array([0.3, 0.0, 0.9])
    crank = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "crank1")
    model.appendBodyToJoint(crank, _rod(tip), pin.SE3.Identity())
    fork = model.addJoint(crank, pin.JointModelRY(), pin.SE3(np.eye(3), tip), "fork")
    model.appendBodyToJoint(fork, _rod(np.array([0.1, 0.0, 0.0])), pin.SE3.Identity())
    rod = model.addJoint(fork, pin.JointModelRZ(), pin.SE3.Identity(), "rod")
    model.appendBodyToJoint(rod, _rod(end - tip), pin.SE3.Identity())
    model.addFrame(_frame("rod_tip", int(rod), end - tip))
    other = model.addJoint(0, pin.JointModelRY(), pin.SE3(np.eye(3), foot), "crank2")
    model.appendBodyToJoint(other, _rod(end - foot), pin.SE3.Identity())
    model.addFrame(_frame("crank2_tip", int(other), end - foot))
    return Mechanism(model, [PointClosure("rod_tip", "crank2_tip")], ["crank1"], home=np.zeros(4))


def _rod(way: Array, mass: float = 1.0) -> pin.Inertia:
    """A round rod from the body's origin along `way`."""
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return pin.Inertia.FromSphere(mass, THICKNESS)
    u = way / length
    across = np.eye(3) - np.outer(u, u)
    inertia = mass * ((length**2 / 12.0 + THICKNESS**2 / 4.0) * across + THICKNESS**2 / 2.0 * np.outer(u, u))
    return pin.Inertia(mass, 0.5 * np.asarray(way), inertia)


def _frame(name: str, joint: int, at: Array) -> pin.Frame:
    return pin.Frame(name, joint, pin.SE3(np.eye(3), np.asarray(at)), pin.FrameType.OP_FRAME)


def _at(arc: float) -> Array:
    """A point of the unit sphere along the ground arc."""
    return np.array([np.sin(arc), 0.0, np.cos(arc)])


def _turned(axis: Array, p: Array, angle: float) -> Array:
    """p turned about an axis."""
    return np.asarray(pin.exp3(axis / np.linalg.norm(axis) * angle) @ p)
