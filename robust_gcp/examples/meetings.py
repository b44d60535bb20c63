"""Linkages whose modes touch, end in cusps, or lie in the singular set; planar, in the world y–z plane.

All are made of sliders and of uniform slender rods of 1 kg, revolute axes along +x, gravity along −z.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..checks import check_between, check_positive, check_whole, listed
from ..errors import OptionError
from ..mechanism.constraint.closures import PointClosure
from ..mechanism.constraint.couplings import CouplingClosure
from ..mechanism.mechanism import Mechanism
from .families import planar_linkage
from .linkages import add_link, rod

RODS = 0.6, 0.4
"""Crank and connecting rod of a cam's slider-crank, m."""


def cam(profile: Sequence[float], x: float = 0.0) -> Mechanism:
    """A slider-crank whose slider follows a cam: z = 1 − P(x), P(x) = Σ profile[i] xⁱ, y = x.

    The crank's and the rod's bend at their joint is ±√(P(x) …): modes meet where P has a double zero, with
    contact of order k at one of multiplicity 2k, and end in a cusp at one of odd multiplicity, three or
    more.

    Parameters
    ----------
    profile : sequence of float
        Coefficients, lowest first; m and m.
    x : float
        Where home is, on the mode whose revolute joint bends to positive angles, m.

    Raises
    ------
    OptionError
        Where P(x) is negative or above 2 m: out of the rods' reach.

    Examples
    --------
    >>> import robust_gcp as rg
    >>> from robust_gcp.examples.meetings import cam
    >>> rg.analyse(cam([0, 0, 0, 0, 0.8]), [0.0, 1.0, 0.0, 0.0]).contacts
    ((0, 1, 2),)
    """
    a, b = RODS
    P = [float(c) for c in listed(profile, "cam: profile", "coefficients", OptionError, (int, float))]
    depth = float(np.polynomial.polynomial.polyval(x, P))
    if not 0.0 <= depth <= 2.0 * b:
        raise OptionError(
            f"cam: P({x:g}) = {depth:.3g} m must lie within 0 and {2.0 * b:g} m, the rods' reach"
        )
    model = pin.Model()
    model.name = "cam"
    _slider(model, "x", pin.JointModelPZ(), 0.7)
    slider = _slider(model, "z", pin.JointModelPY(), 0.2)
    model.addFrame(pin.Frame("z_tip", slider, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    crank = add_link(model, 0, 0.0, "crank", a)
    add_link(model, crank, a, "rod", b)
    P += [0.0] * (2 - len(P))  # offset and ratio of a coupling are arguments of their own
    follows = CouplingClosure("z", "x", -P[1], a + b - P[0], tuple(-c for c in P[2:]))
    # the law of cosines by half the angle: by arccos half of the digits are lost where the rods stretch
    bend = 2.0 * np.arcsin(np.sqrt(depth * (2.0 * (a + b) - depth) / (4.0 * a * b)))
    home = [x, a + b - depth, np.arctan2(-b * np.sin(bend), a + b * np.cos(bend)), bend]
    return Mechanism(model, [PointClosure("rod_tip", "z_tip"), follows], ["x"], home=home)


def touching_cams(order: int = 2, x: float = 0.0) -> Mechanism:
    """The cam z = 1 − 0.8 x^(2k): two modes meet at x = 0 with contact of order k, k = 1 a crossing."""
    check_whole("touching_cams: order", order, 1, 6)
    return cam([0.0] * (2 * order) + [0.8], x)


def cusp_cam(x: float = 0.1) -> Mechanism:
    """The cam z = 1 − 0.8 x³: the mode ends in a cusp at x = 0."""
    return cam([0.0, 0.0, 0.0, 0.8], x)


def trammel(theta: float = 0.5 * np.pi, share: float = 0.55) -> Mechanism:
    """Cardan's trammel with a dyad centred on the evolute at θ; y = angle of the ladder, home at the meeting.

    A ladder of unit length slides along the z and y axes; its point T at the distance b from the lower end
    runs on the ellipse (a cos θ, b sin θ), a = 1 − b. A dyad hinged at O with the total reach ρ holds T.
    Its two assemblies meet where |T − O| = ρ. With O the centre of curvature of the ellipse at θ and ρ its
    radius there, |T − O| − ρ starts with the third power, and at a vertex with the fourth: a cusp, and
    modes in contact of order 2.

    Parameters
    ----------
    theta : float
        rad.
    share : float
        Of the reach in the dyad's upper link.
    """
    check_between("trammel: share", share, 0.0, 1.0)
    B = 0.3
    A = 1.0 - B
    radius = ((A * np.sin(theta)) ** 2 + (B * np.cos(theta)) ** 2) ** 1.5 / (A * B)
    center = (A**2 - B**2) * np.array([np.cos(theta) ** 3 / A, -(np.sin(theta) ** 3) / B])
    model = pin.Model()
    model.name = "trammel"
    foot = _slider(model, "foot", pin.JointModelPY(), 0.1)
    # the ladder leans back from its foot: direction (−cos θ, sin θ), joint value π − θ
    ladder = add_link(model, foot, 0.0, "ladder", 1.0)
    at_T = pin.SE3(np.eye(3), np.array([0.0, B, 0.0]))
    model.addFrame(pin.Frame("T", ladder, at_T, pin.FrameType.OP_FRAME))
    head = _slider(model, "head", pin.JointModelPZ(), 0.1)
    model.addFrame(pin.Frame("head_frame", head, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    upper = model.addJoint(0, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, *center])), "upper")
    model.appendBodyToJoint(upper, rod(share * radius), pin.SE3.Identity())
    add_link(model, upper, share * radius, "lower", (1.0 - share) * radius)
    point = np.array([A * np.cos(theta), B * np.sin(theta)]) - center
    home = [np.cos(theta), np.pi - theta, np.sin(theta), np.arctan2(point[1], point[0]), 0.0]
    closures = [PointClosure("ladder_tip", "head_frame"), PointClosure("lower_tip", "T")]
    return Mechanism(model, closures, ["ladder"], home=home)


def stretched_dyad(reach: float = 0.9, share: float = 0.6, angle: float = 0.7) -> Mechanism:
    """A crank and a dyad of the same reach about one pivot, tip to tip: the dyad is stretched always.

    K lacks a rank all along: the mode lies in the singular set.

    Parameters
    ----------
    reach : float
        m.
    share : float
        Of the reach in the dyad's first link.
    angle : float
        Of the crank at home, rad.
    """
    check_positive("stretched_dyad: reach", reach)
    check_between("stretched_dyad: share", share, 0.0, 1.0)
    model = pin.Model()
    model.name = "stretched_dyad"
    add_link(model, 0, 0.0, "crank", reach)
    upper = add_link(model, 0, 0.0, "upper", share * reach)
    add_link(model, upper, share * reach, "lower", (1.0 - share) * reach)
    closures = [PointClosure("crank_tip", "lower_tip")]
    return Mechanism(model, closures, ["crank"], home=[angle, angle, 0.0])


def double_watt(
    mirrored: bool = True, arm: float = 1.0, coupler: float = 1.0, distance: float = 1.0, **drawing: Any
) -> Mechanism:
    """Two of Watt's straight-line linkages, the middles of their couplers joined by a bar; home is the place.

    Middles that move up by s and s + d part from their line as s⁵. A bar at right angles to it asks that
    d² = c s⁵ where one linkage is the other's mirror image: the mode ends in a cusp. Where it is its copy,
    d (d + c s⁴ + …) = 0: two modes in contact of order 4. y = angle of joint `low0`.

    Parameters
    ----------
    mirrored : bool
    arm, coupler, distance : float
        Each linkage's two cranks, its coupler, and the bar, m.
    drawing
        Goes to `planar_linkage` (cuts, rotation, unit).

    References
    ----------
    Connelly and Servatius, "Higher-order rigidity: what is the proper definition?", Discrete & Computational
    Geometry 11 (1994).
    """
    for name, length in (("arm", arm), ("coupler", coupler), ("distance", distance)):
        check_positive(f"double_watt: {name}", length)
    points: dict[str, tuple[float, float]] = {}
    links: dict[str, tuple[str, ...]] = {"ground": ("A0", "D0", "A1", "D1")}
    joints: list[tuple[str, str, str]] = []
    for i, x, way in ((0, 0.0, 1.0), (1, distance, -1.0 if mirrored else 1.0)):
        points |= {
            f"A{i}": (x - way * arm, -0.5 * coupler), f"B{i}": (x, -0.5 * coupler), f"M{i}": (x, 0.0),
            f"C{i}": (x, 0.5 * coupler), f"D{i}": (x + way * arm, 0.5 * coupler),
        }  # fmt: skip
        links |= {f"low{i}": (f"A{i}", f"B{i}"), f"coupler{i}": (f"B{i}", f"M{i}", f"C{i}")}
        links[f"up{i}"] = (f"D{i}", f"C{i}")
        joints += [(f"low{i}", "ground", f"low{i}"), (f"up{i}", "ground", f"up{i}")]
        joints += [(f"coupler{i}", f"low{i}", f"coupler{i}"), (f"cut{i}", f"up{i}", f"coupler{i}")]
        joints.append((f"bar{i}", f"coupler{i}", "bar"))
    links["bar"] = ("M0", "M1")
    drawing.setdefault("cuts", ("cut0", "cut1", "bar1"))
    return planar_linkage(points, links, joints, ["low0"], **drawing)


def cranks_on_one_slide(
    amplitudes: Sequence[float] = (1.0, 0.5), x: float = 0.35, bends: Sequence[int] = (1, 1)
) -> Mechanism:
    """Slider-cranks that follow cams 1 − 0.8 aᵢ x⁴ of one slide x: all of them touch at x = 0.

    K lacks a rank for each there.

    Parameters
    ----------
    amplitudes : sequence of float
        aᵢ.
    x : float
        Of home, m.
    bends : sequence of {1, -1}
        To which side each bends at home.
    """
    a, b = RODS
    model = pin.Model()
    model.name = "cranks_on_one_slide"
    _slider(model, "x", pin.JointModelPZ(), 0.7)
    closures: list[PointClosure | CouplingClosure] = []
    home = [x]
    for i, (amplitude, side) in enumerate(zip(amplitudes, bends, strict=True)):
        place = pin.SE3(np.eye(3), np.array([0.3 * i, 0.0, 0.0]))
        slider = _slider(model, f"z{i}", pin.JointModelPY(), 0.2, place)
        model.addFrame(pin.Frame(f"z{i}_tip", slider, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        crank = model.addJoint(0, pin.JointModelRX(), place, f"crank{i}")
        model.appendBodyToJoint(crank, rod(a), pin.SE3.Identity())
        add_link(model, int(crank), a, f"rod{i}", b)
        closures.append(PointClosure(f"rod{i}_tip", f"z{i}_tip"))
        closures.append(CouplingClosure(f"z{i}", "x", 0.0, a + b, (0.0, 0.0, -0.8 * amplitude)))
        depth = 0.8 * amplitude * x**4
        bend = side * 2.0 * np.arcsin(np.sqrt(depth * (2.0 * (a + b) - depth) / (4.0 * a * b)))
        home += [a + b - depth, np.arctan2(-b * np.sin(bend), a + b * np.cos(bend)), bend]
    return Mechanism(model, closures, ["x"], home=home)


def _slider(model: pin.Model, name: str, kind: object, mass: float, place: pin.SE3 | None = None) -> int:
    joint = model.addJoint(0, kind, pin.SE3.Identity() if place is None else place, name)
    inertia = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return int(joint)
