"""Robots of any size: a body with legs around it, each a hip and a four-bar."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..checks import check_number
from ..errors import OptionError
from ..maps.closed_form import FourBar
from ..mechanism.constraint.closures import PointClosure
from ..mechanism.mechanism import Mechanism
from .linkages import add_link

GROUND, CRANK, COUPLER, ROCKER = 0.45, 0.25, 0.5, 0.4
"""Lengths of a leg's four-bar, m: the crank turns all the way round, far from any singular place."""

RADIUS = 0.5
"""Of the body, m; it weighs 5 kg."""

BENT = 1.2
"""rad: the cranks at home."""


def legged(legs: int, floating: bool = False) -> Mechanism:
    """A body with that many legs, each of 4 joints: a hip that turns the leg about the vertical, and a loop.

    Independent: the base where it floats, and each leg's hip `h<i>` and crank `c<i>`; a loop cluster of
    mobility 1 in each leg. 50 legs make a robot of 200 joints and 50 loops.

    Parameters
    ----------
    legs : int
    floating : bool
        Whether the body floats; else it is the ground.
    """
    check_number("legged: legs", legs)
    if not 1 <= legs <= 10_000 or legs != int(legs):
        raise OptionError(f"legged: legs = {legs} must be a whole number from 1 to 10000")
    model, body, independent = pin.Model(), 0, []
    model.name = f"legged {legs}"
    if floating:
        body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        model.appendBodyToJoint(body, pin.Inertia.FromSphere(5.0, RADIUS), pin.SE3.Identity())
        independent = ["base"]
    leg = FourBar(GROUND, CRANK, COUPLER, ROCKER, 1).evaluate(BENT)[0]
    closures, home = [], [pin.neutral(model)]
    for i in range(int(legs)):
        turn = pin.exp3(np.array([0.0, 0.0, 2.0 * np.pi * i / legs]))
        place = pin.SE3(turn, turn @ np.array([0.0, RADIUS, 0.0]))
        hip = model.addJoint(body, pin.JointModelRZ(), place, f"h{i}")
        model.appendBodyToJoint(hip, pin.Inertia.FromSphere(0.5, 0.1), pin.SE3.Identity())
        crank = add_link(model, int(hip), 0.0, f"c{i}", CRANK)
        add_link(model, crank, CRANK, f"k{i}", COUPLER)
        add_link(model, int(hip), GROUND, f"r{i}", ROCKER)
        closures.append(PointClosure(f"k{i}_tip", f"r{i}_tip"))
        independent += [f"h{i}", f"c{i}"]
        home += [np.zeros(1), leg]
    return Mechanism.from_pinocchio(model, closures, independent, home=np.concatenate(home))
