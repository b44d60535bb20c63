"""Linkages from links and joints, against closed forms and mechanisms made otherwise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

CRANK, ROD = 0.3, 0.8


def slider_crank(**options: Any) -> rg.Mechanism:
    linkage = rg.Linkage("slider_crank", **options)
    linkage.link("crank", CRANK, at="ground")
    linkage.link("rod", ROD, at="crank.end", mass=1.2)
    linkage.slider("rod.end", along=(1, 0), mass=0.5)
    return linkage.mechanism({"crank": 0.5})


def test_a_slider_crank_is_that_of_the_books() -> None:
    """x = r cos θ + √(l² − r² sin² θ), and its rates; θ̈ from the energy, which the motion keeps."""
    mechanism = slider_crank()
    assert mechanism.independent == ("crank",)
    assert mechanism.home[0] == 0.5
    run = rg.simulate(mechanism, v0={"crank": 3.0, **lifted(mechanism, 3.0)}, duration=1.0, step=2.5e-4)
    theta, w = run["crank"], run["v.crank"]
    root = np.sqrt(ROD**2 - (CRANK * np.sin(theta)) ** 2)
    np.testing.assert_allclose(run["slider"], CRANK * np.cos(theta) + root, atol=1e-13)
    rate = -CRANK * np.sin(theta) * (1.0 + CRANK * np.cos(theta) / root) * w
    np.testing.assert_allclose(run["v.slider"], rate, atol=1e-12)
    assert np.abs(run.energy_error()).max() < 1e-8
    m_crank = 7850.0 * 1e-4 * CRANK
    middle = 0.5 * (CRANK * np.sin(theta))  # of the rod, above the line
    own = m_crank * 9.81 * 0.5 * CRANK * np.sin(theta) + 1.2 * 9.81 * middle
    potential = np.array([mechanism.energy(q, np.zeros(mechanism.nv)) for q in run.q])
    np.testing.assert_allclose(potential - potential[0], own - own[0], atol=1e-12)


def lifted(mechanism: rg.Mechanism, speed: float) -> dict[str, float]:
    v = mechanism.lift(mechanism.home, [speed])
    return dict(zip(mechanism.joint_names, v.tolist(), strict=True))


def four_bar() -> rg.Linkage:
    linkage = rg.Linkage("four_bar")
    linkage.point("ground.D", (2.5, 0.0))
    linkage.link("crank", 1.0, at="ground", mass=1.0)
    linkage.link("coupler", 3.0, at="crank.end", mass=1.0)
    linkage.link("rocker", 2.5, at="ground.D", mass=1.0)
    linkage.revolute("coupler.end", "rocker.end")
    return linkage


def by_hand() -> rg.Mechanism:
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    lengths, joints = (1.0, 3.0, 2.5), []
    for name, parent, x in (("crank", 0, 0.0), ("coupler", 1, 1.0), ("rocker", 0, 2.5)):
        place = pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
        joints.append(model.addJoint(parent, pin.JointModelRZ(), place, name))
    for joint, length in zip(joints, lengths, strict=True):
        moments = np.diag([1e-4 / 6.0, (length**2 + 1e-4) / 12.0, (length**2 + 1e-4) / 12.0])
        model.appendBodyToJoint(
            joint, pin.Inertia(1.0, np.array([length / 2, 0, 0]), moments), pin.SE3.Identity()
        )
    for joint, length, name in ((joints[1], 3.0, "P"), (joints[2], 2.5, "Q")):
        model.addFrame(pin.Frame(name, joint, pin.SE3(np.eye(3), np.array([length, 0, 0])), pin.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("P", "Q")], ["crank"])


def test_a_four_bar_is_the_one_made_by_hand() -> None:
    made, wanted = four_bar().mechanism(), by_hand()
    assert made.joint_names == wanted.joint_names
    q = wanted.assemble(made.home)
    np.testing.assert_allclose(made.home, q, atol=1e-12)
    runs = [rg.simulate(m, q, m.lift(q, [2.0]), duration=1.0, step=1e-3) for m in (made, wanted)]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-11)


def test_the_order_of_what_is_said_does_not_matter() -> None:
    one = four_bar().mechanism({"crank": 0.7})
    linkage = rg.Linkage("four_bar")
    linkage.link("rocker", 2.5, mass=1.0)
    linkage.link("coupler", 3.0, mass=1.0)
    linkage.link("crank", 1.0, mass=1.0)
    linkage.point("ground.D", (2.5, 0.0))
    linkage.revolute("rocker.end", "coupler.end", name="coupler")
    linkage.revolute("ground.D", "rocker", name="rocker")
    linkage.revolute("crank.end", "coupler", name="closing")
    linkage.revolute("ground", "crank", name="crank")
    other = linkage.mechanism({"crank": 0.7, "rocker": one.home[2]})
    run = rg.simulate(one, v0=one.lift(one.home, [1.0]), duration=0.5)
    v0 = other.with_independent(["crank"]).lift(other.home, [1.0])
    twin = rg.simulate(other.with_independent(["crank"]), other.home, v0, duration=0.5)
    np.testing.assert_allclose(twin["crank"], run["crank"], atol=1e-10)
    np.testing.assert_allclose(twin["rocker"], run["rocker"], atol=1e-10)


def test_a_ternary_link_makes_a_six_bar() -> None:
    """Stephenson's: a four-bar whose coupler drives a dyad; mobility one."""
    linkage = four_bar()
    linkage.point("coupler.P", (1.5, 0.8))
    linkage.point("ground.E", (3.5, 1.5))
    linkage.link("arm", 1.2, at="coupler.P")
    linkage.link("last", 1.4, at="ground.E")
    linkage.revolute("arm.end", "last.end")
    mechanism = linkage.mechanism()
    assert (mechanism.m, mechanism.independent) == (1, ("crank",))
    run = rg.simulate(mechanism, v0=mechanism.lift(mechanism.home, [0.5]), duration=0.3)
    assert run.closure_error().max() < 1e-13
    frames = [run.frame(name).position for name in ("arm.end", "last.end")]
    np.testing.assert_allclose(frames[0], frames[1], atol=1e-13)


def test_a_spatial_linkage_of_balls_and_hinges() -> None:
    """RSSR: two cranks about skew axes and a rod on balls, whose idle spin is a coordinate too."""
    linkage = rg.Linkage("rssr", gravity=(0, 0, -9.81))
    linkage.point("ground.O", (1.0, 0.4, 0.2))
    linkage.link("drive", 0.2, at="ground", axis=(0, 0, 1))
    linkage.link("driven", 0.6, at="ground.O", axis=(0, 1, 0))
    linkage.link("rod", 1.1, mass=0.7)
    linkage.spherical("drive.end", "rod", name="ball")
    linkage.spherical("rod.end", "driven.end")
    mechanism = linkage.mechanism({"drive": 0.4})
    assert mechanism.m == 2
    run = rg.simulate(mechanism, duration=0.5, step=1e-3)
    assert run.closure_error().max() < 1e-13
    assert np.abs(run.energy_error()).max() < 1e-8
    ends = [run.frame(name).position for name in ("rod.end", "driven.end")]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-13)


def test_a_hinge_that_closes_has_an_axis_in_either_link() -> None:
    """Bennett's linkage: opposite links and twists are equal, a sin β = b sin α; mobility one in space."""
    a, b, alpha = 1.0, 1.5, 0.6
    beta = np.arcsin(b * np.sin(alpha) / a)
    linkage = rg.Linkage("bennett", gravity=(0, 0, -9.81))
    linkage.point("ground.B", (a, 0.0, 0.0))
    twisted = {angle: (0.0, -np.sin(angle), np.cos(angle)) for angle in (alpha, beta)}
    linkage.link("one", b, at="ground")
    linkage.link("two", a)
    linkage.revolute("one.end", "two", axis=twisted[beta], axis2=(0, 0, 1), name="two")
    linkage.link("three", b)
    linkage.revolute("two.end", "three", axis=twisted[alpha], axis2=(0, 0, 1), name="three")
    linkage.revolute("ground.B", "three.end", axis=twisted[alpha], axis2=twisted[beta], name="closing")
    mechanism = linkage.mechanism({"one": 2.0})
    assert mechanism.m == 1
    run = rg.simulate(mechanism, duration=0.3)
    assert run.closure_error().max() < 1e-12
    assert np.ptp(run["one"]) > 1e-2


def test_what_is_wrong_is_named() -> None:
    def refused(match: str, make: Any) -> None:
        with pytest.raises(rg.ModelError, match=match):
            make()

    linkage = four_bar()
    refused("link 'crank': the name is taken", lambda: linkage.link("crank", 1.0))
    refused("link 'a.b': the name is taken, or has a dot", lambda: linkage.link("a.b", 1.0))
    refused("length = 0", lambda: linkage.link("new", 0.0))
    refused("mass is -1", lambda: linkage.link("new", 1.0, mass=-1.0))
    refused("mass = nan", lambda: linkage.link("new", 1.0, mass=float("nan")))
    refused("give a pin.Inertia", lambda: linkage.link("new", 1.0, inertia=3.0))  # type: ignore[arg-type]
    refused("there is no point 'crank.tip'", lambda: linkage.link("new", 1.0, at="crank.tip"))
    refused("there is no point 'rocket.end'.*did you mean", lambda: linkage.revolute("crank", "rocket.end"))
    refused("both points are of 'crank'", lambda: linkage.revolute("crank", "crank.end"))
    refused("joint 'crank': the name is taken", lambda: linkage.revolute("crank", "rocker", name="crank"))
    refused("point 'crank.end' is there already", lambda: linkage.point("crank.end", (1, 2)))
    refused("point 'P': write link.NAME", lambda: linkage.point("P", (1, 2)))
    refused(r"give \(x, y\) or \(x, y, z\)", lambda: linkage.point("crank.P", (1, float("inf"))))
    refused("axis is zero", lambda: linkage.revolute("crank", "rocker", axis=(0, 0)))
    with pytest.raises(rg.ClosureError, match="is open by"):
        linkage.mechanism({"crank": np.pi, "rocker": 0.0})
    with pytest.raises(rg.ModelError, match=r"home = \[1.0\] must be \{joint: number\}"):
        four_bar().mechanism([1.0])  # type: ignore[arg-type]
    with pytest.raises(rg.StateError, match=r"home: .* no joint 'cranks'"):
        linkage.mechanism({"cranks": 1.0})
    linkage.link("lost", 1.0)
    refused("nothing connects lost to the ground", linkage.mechanism)


def test_springs_hang_on_points() -> None:
    linkage = four_bar()
    linkage.point("ground.S", (1.0, 6.0))
    spring = rg.PointSpring("coupler.end", "ground.S", 30.0, 0.5)
    run = rg.simulate(linkage.mechanism(forces=[spring]), duration=0.5, step=5e-4)
    assert np.abs(run.energy_error()).max() < 1e-8
