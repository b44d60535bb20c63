"""Families of linkages by formula: scissor lifts, trees of four-bars, any planar linkage by its points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ..maps.closed_form import FourBar
from ..mechanism.constraint.closures import PointClosure
from ..mechanism.mechanism import Mechanism
from .linkages import add_link, rod

Lengths = tuple[float, float, float, float]
"""Ground, crank, coupler and rocker, m."""


def scissor_lift(
    stages: int, angle: float = 1.0, length: float = 1.0, mass: float = 1.0, independent: str = "a1"
) -> Mechanism:
    """A scissor lift: bars a1, a2, … and b1, b2, …, a1 on a pivot, b1 on a slide `foot`.

    Bars a stand at `angle` from the horizontal, bars b at π − `angle`. Where the lift is flat all loops
    are singular at once.
    """
    model = pin.Model()
    model.name = f"scissor_lift_{stages}"

    def frame(joint: int, y: float, name: str) -> None:
        placement = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    # two chains, each bar on the tip of the other family's bar below: a1 – b2 – a3 …, foot – b1 – a2 …
    joint, home = 0, [angle]
    for i in range(1, stages + 1):
        name = f"{'ab'[(i - 1) % 2]}{i}"
        joint = add_link(model, joint, length if i > 1 else 0.0, name, length, mass)
        frame(joint, 0.5 * length, f"{name}_middle")
        if i > 1:
            home.append((np.pi - 2.0 * angle) * (-1.0 if i % 2 else 1.0))  # against the bar below
    foot = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "foot")
    body = pin.Inertia(0.1 * mass, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(foot, body, pin.SE3.Identity())
    home += [length * np.cos(angle), np.pi - angle]
    joint = int(foot)
    for i in range(1, stages + 1):
        name = f"{'ba'[(i - 1) % 2]}{i}"
        joint = add_link(model, joint, length if i > 1 else 0.0, name, length, mass)
        frame(joint, 0.5 * length, f"{name}_middle")
        if i > 1:
            home.append((2.0 * angle - np.pi) * (-1.0 if i % 2 else 1.0))
    closures = [PointClosure(f"a{i}_middle", f"b{i}_middle") for i in range(1, stages + 1)]
    return Mechanism(model, closures, [independent], home=home)


def four_bars(
    lengths: Sequence[Lengths],
    angles: Sequence[float],
    parents: Sequence[int] | None = None,
    assembly: int = 1,
    spacing: float = 0.0,
    floating: pin.Inertia | None = None,
) -> Mechanism:
    """Several four-bars in one model, each a cluster of its own; y is their cranks.

    Parameters
    ----------
    lengths : sequence of (ground, crank, coupler, rocker)
        m.
    angles : sequence of float
        Of the cranks at home against their ground lines, rad.
    parents : sequence of int, optional
        Which linkage's coupler carries the next one's ground line: −1 for the ground, else an earlier index.
        All on the ground where left out.
    assembly : {1, -1}
    spacing : float
        Distance between linkages on the ground, m.
    floating : pin.Inertia, optional
        Of a free body, the joint `base`, in place of the ground; y begins with it.
    """
    model = pin.Model()
    model.name = "four_bars"
    parents = [-1] * len(lengths) if parents is None else parents
    home: list[float] = []
    closures, cranks, ground = [], [], 0
    if floating is not None:
        ground = int(model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base"))
        model.appendBodyToJoint(ground, floating, pin.SE3.Identity())
        home += [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]

    def add(index: int, body: int, at: float) -> None:
        l0, l1, l2, l3 = lengths[index]
        crank = add_link(model, body, at, f"crank{index}", l1)
        q = FourBar(l0, l1, l2, l3, assembly).evaluate(angles[index])[0]
        home.append(q[0])
        coupler = add_link(model, crank, l1, f"coupler{index}", l2)
        home.append(q[1])
        # before the rocker: Pinocchio's CRBA is wrong for joints that are not added depth first
        for child, parent in enumerate(parents):
            if parent == index:
                add(child, coupler, 0.5 * l2)
        add_link(model, body, at + l0, f"rocker{index}", l3)
        home.append(q[2])
        closures.append(PointClosure(f"coupler{index}_tip", f"rocker{index}_tip"))
        cranks.append((index, f"crank{index}"))

    for i, parent in enumerate(parents):
        if parent < 0:
            add(i, ground, i * spacing)
    independent = [name for _, name in sorted(cranks)]
    return Mechanism(model, closures, ["base"] * (ground > 0) + independent, home=home)


def planar_linkage(
    points: Mapping[str, tuple[float, float]],
    links: Mapping[str, Sequence[str]],
    joints: Sequence[tuple[str, str, str]],
    independent: Sequence[str],
    cuts: Sequence[str] = (),
    root: str = "ground",
    rotation: float = 0.0,
    unit: float = 1.0,
) -> Mechanism:
    """A planar linkage of bars hinged at points, with any spanning tree of its graph; q = 0 at home.

    The links are rods between neighbouring points of theirs, 1 kg per m of the given numbers.

    Parameters
    ----------
    points : mapping of str to (float, float)
        Where the revolute joints are at home, y and z.
    links : mapping of str to sequence of str
        The points of each link; the one called `ground` is fixed and has no mass.
    joints : sequence of (name, link, link)
        Revolute, each at the point that its two links share, named `link@point` where they share two.
    independent : sequence of str
        Joint names.
    cuts : sequence of str
        Joints to be cut; others are cut where the tree is complete already.
    rotation : float
        Of the whole in its plane against gravity's frame, rad: gravity turns with it.
    unit : float
        Numbers of the model's length unit in a metre: 1000 for millimetres.
    """
    model = pin.Model()
    model.name = "planar_linkage"
    turn = np.array([[np.cos(rotation), -np.sin(rotation)], [np.sin(rotation), np.cos(rotation)]])
    where = {name: np.concatenate([[0.0], turn @ np.array(p) * unit]) for name, p in points.items()}
    gravity = np.concatenate([[0.0], turn @ np.array([0.0, -9.81]) * unit])
    model.gravity.linear = gravity
    at: dict[str, str] = {}
    ends: dict[str, tuple[str, str]] = {}
    for name, one, two in joints:
        shared = [p for p in links[one] if p in links[two]]
        at[name] = name.partition("@")[2] or shared[0]
        ends[name] = (one, two)
    index, origin, used = {root: 0}, {root: np.zeros(3)}, []

    def grow(link: str) -> None:
        for name, (one, two) in ends.items():
            if name in cuts or link not in (one, two):
                continue
            other = two if link == one else one
            if other in index:
                continue
            place = where[at[name]]
            placement = pin.SE3(np.eye(3), place - origin[link])
            joint = model.addJoint(index[link], pin.JointModelRX(), placement, name)
            index[other], origin[other] = int(joint), place
            used.append(name)
            points_there = [where[p] - place for p in links[other]]
            for a, b in pairwise(points_there):
                size = float(np.linalg.norm(b - a))
                way = (b - a) / size
                frame = np.column_stack([[1.0, 0.0, 0.0], way, np.cross([1.0, 0.0, 0.0], way)])
                inertia = rod(size, size / unit)
                model.appendBodyToJoint(joint, inertia, pin.SE3(frame, a))
            grow(other)  # at once, so that joints are added depth first

    grow(root)
    closures = []
    for name, (one, two) in ends.items():
        if name in used:
            continue
        for side, link in enumerate((one, two)):
            placement = pin.SE3(np.eye(3), where[at[name]] - origin[link])
            frame = pin.Frame(f"{name}:{side}", index[link], placement, pin.FrameType.OP_FRAME)
            model.addFrame(frame)
        closures.append(PointClosure(f"{name}:0", f"{name}:1"))
    return Mechanism(model, closures, list(independent), home=np.zeros(model.nq))
