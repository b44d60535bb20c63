"""Mechanisms generated from numbers: families of planar linkages made of uniform slender rods.

All move in the world y–z plane, revolute axes along +x, gravity along −z, as the shipped models do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..checks import check_between, check_number
from ..errors import OptionError
from ..maps.closed_form import FourBar
from ..mechanism.constraint.closures import PointClosure
from ..mechanism.mechanism import Mechanism
from ..mechanism.recommended import Recommended
from ..mechanism.tree.model import OVERFLOWING

UPRIGHT = 1e-9
"""Largest cosine of cranks that would stand for as long as a run takes."""


def rod(length: float, mass: float = 1.0) -> pin.Inertia:
    """A uniform slender rod from a revolute joint along its body's y axis."""
    check_between("rod: length", length, 0.0, OVERFLOWING)
    check_number("rod: mass", mass)
    if not 0.0 <= mass < OVERFLOWING:
        raise OptionError(f"rod: mass = {mass} kg must not be negative, and finite")
    inertia = mass * length**2 / 12.0
    return pin.Inertia(mass, np.array([0.0, 0.5 * length, 0.0]), np.diag([inertia, 0.0, inertia]))


def add_link(model: pin.Model, parent: int, y: float, name: str, length: float, mass: float = 1.0) -> int:
    """A rod hinged at distance y along its parent's y axis; a frame `<name>_tip` at its end."""
    placement = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
    joint = model.addJoint(parent, pin.JointModelRX(), placement, name)
    model.appendBodyToJoint(joint, rod(length, mass), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, length, 0.0]))
    model.addFrame(pin.Frame(f"{name}_tip", joint, tip, pin.FrameType.OP_FRAME))
    return int(joint)


def four_bar(
    l0: float,
    l1: float,
    l2: float,
    l3: float,
    y: float = 0.5,
    assembly: int = 1,
    masses: Sequence[float] = (1.0, 1.0, 1.0),
    independent: str = "q1",
) -> Mechanism:
    """The paper's planar four-bar, q = (q1, q2, q3), at home where q1 = y on one assembly mode.

    Parameters
    ----------
    l0, l1, l2, l3 : float
        Ground, crank, coupler, rocker, m.
    y : float
        rad.
    assembly : {1, -1}
        See `closed_form.FourBar`.
    masses : sequence of float
        Of crank, coupler and rocker, kg.
    independent : str
        The joint that serves as minimal coordinate.
    """
    check_number("four_bar: y", y)
    home = FourBar(l0, l1, l2, l3, assembly).evaluate(y)[0]
    if len(masses) != 3:
        raise OptionError(f"four_bar: masses has {len(masses)} entries; give crank, coupler and rocker")
    model = pin.Model()
    model.name = "four_bar"
    crank = add_link(model, 0, 0.0, "q1", l1, masses[0])
    add_link(model, crank, l1, "q2", l2, masses[1])
    add_link(model, 0, l0, "q3", l3, masses[2])
    return Mechanism(model, [PointClosure("q2_tip", "q3_tip")], [independent], home=home)


def n_four_bar(n: int, angle: float = 0.5 * np.pi, length: float = 1.0, mass: float = 1.0) -> Mechanism:
    """N rhombic four-bars in a row, N + 1 cranks and N couplers (IFToMM benchmark A02).

    At home all cranks stand at `angle` from the ground line, couplers parallel to it: the
    parallelogram mode, on which every loop is singular where the cranks lie flat. Joints are
    `crank0`, `coupler0`, `crank1`, …; crank0 is independent. Upright cranks are in equilibrium: for
    them the benchmark's start is recommended, the cranks' tips at 1 m/s along the ground line.

    Parameters
    ----------
    n : int
        Number of loops.
    angle : float
        rad.
    length, mass : float
        Of every rod, m and kg.
    """
    check_number("n_four_bar: n", n)
    if n < 1 or n != int(n):
        raise OptionError(f"n_four_bar: n = {n} must be at least 1, a whole number")
    model = pin.Model()
    model.name = f"n_four_bar_{n}"
    home: list[float] = []
    for i in range(n + 1):
        crank = add_link(model, 0, i * length, f"crank{i}", length, mass)
        home.append(angle)
        if i < n:
            add_link(model, crank, length, f"coupler{i}", length, mass)
            home.append(-angle)
    closures = [PointClosure(f"coupler{i}_tip", f"crank{i + 1}_tip") for i in range(n)]
    mechanism = Mechanism(model, closures, ["crank0"], home=home)
    if abs(np.cos(angle)) < UPRIGHT:
        v0 = mechanism.lift(mechanism.home, [-1.0 / length])
        mechanism.recommended = Recommended(duration=20.0, v0=v0)
    return mechanism


def swinging_four_bar(
    l0: float, l1: float, l2: float, l3: float, swing: float, y: float, assembly: int = 1
) -> Mechanism:
    """A four-bar whose ground link swings on a pivot: mobility 2, y = (q0, q1).

    q0 turns the ground link, a rod of length l0 and 1 kg, from the horizontal.
    """
    model = pin.Model()
    model.name = "swinging_four_bar"
    ground = add_link(model, 0, 0.0, "q0", l0)
    crank = add_link(model, ground, 0.0, "q1", l1)
    add_link(model, crank, l1, "q2", l2)
    add_link(model, ground, l0, "q3", l3)
    home = [swing, *FourBar(l0, l1, l2, l3, assembly).evaluate(y)[0]]
    return Mechanism(model, [PointClosure("q2_tip", "q3_tip")], ["q0", "q1"], home=home)
