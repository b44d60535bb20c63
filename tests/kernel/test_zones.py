"""Zones in the compiled kernel: any number of clusters and coordinates, any corank; hand-over on a bridge."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import families, linkages
from robust_gcp.maps.cluster.cluster_map import ClusterMap
from robust_gcp.maps.cluster.patch_builder import NODES
from robust_gcp.maps.cluster.space import space_of
from robust_gcp.maps.cluster.tracker_numbers import read, written
from robust_gcp.maps.four_bar import FourBar
from robust_gcp.simulation.runs.crossings import point_of_rest
from robust_gcp.simulation.runs.steppers import rk4_step

from ..compiled import needs_kernel

pytestmark = needs_kernel

CHANGE_POINT = (4.0, 2.0, 3.0, 3.0)

COUNTED = ("bridges_built", "zone_evaluations", "marching_steps", "svds", "second_order")


def two_joined() -> rg.Mechanism:
    """Two change-point four-bars with a dyad from coupler to coupler: one cluster of mobility 2."""
    model, home, tips = pin.Model(), [], []
    couplers = []
    for i, angle in enumerate((2.9, 2.2)):
        y = 9.0 * i
        crank = linkages.add_link(model, 0, y, f"crank{i}", 2.0)
        couplers.append(linkages.add_link(model, crank, 2.0, f"coupler{i}", 3.0))
        if i == 0:
            first = linkages.add_link(model, couplers[0], 1.5, "dyad0", 6.0)
            linkages.add_link(model, first, 6.0, "dyad1", 6.0)
        linkages.add_link(model, 0, y + 4.0, f"rocker{i}", 3.0)
        q = FourBar(*CHANGE_POINT, 1).evaluate(angle)[0].tolist()
        home += [*q[:2], *([0.9, -1.9] if i == 0 else []), q[2]]
        tips.append(rg.PointClosure(f"coupler{i}_tip", f"rocker{i}_tip"))
    middle = pin.SE3(np.eye(3), np.array([0.0, 1.5, 0.0]))
    model.addFrame(pin.Frame("middle1", couplers[1], middle, pin.FrameType.OP_FRAME))
    tips.append(rg.PointClosure("dyad1_tip", "middle1"))
    mechanism = rg.Mechanism(model, tips, ["crank0", "crank1"], home=home)
    held = ["crank0", "coupler0", "rocker0", "crank1", "coupler1", "rocker1"]
    mechanism.home = mechanism.assemble(mechanism.home, hold=held)
    return mechanism


def overlapping() -> rg.Mechanism:
    return families.four_bars([CHANGE_POINT] * 2, (2.6, 2.65))


def carried() -> rg.Mechanism:
    return families.four_bars([CHANGE_POINT] * 2, (2.6, 2.65), parents=[-1, 0])


BASE = pin.Inertia(3.0, np.array([0.1, -0.2, 0.3]), np.diag([0.6, 0.4, 0.5]))
THROWN = [0.3, 0.4, -0.2, 0.5, -0.8, 0.7]


def floating(parents: list[int] | None = None) -> rg.Mechanism:
    return families.four_bars([CHANGE_POINT] * 2, (2.6, 2.65), parents, floating=BASE)


def planar() -> rg.Mechanism:
    """A body that slides and turns in the ground's plane, with a change-point four-bar and a ball on it."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, BASE, pin.SE3.Identity())
    crank = linkages.add_link(model, base, 0.0, "crank", 2.0)
    tips = [linkages.add_link(model, crank, 2.0, "coupler", 3.0)]
    ball = model.addJoint(tips[0], pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(
        ball, pin.Inertia(0.4, np.array([0.0, 0.3, 0.1]), 0.02 * np.eye(3)), pin.SE3.Identity()
    )
    linkages.add_link(model, base, 4.0, "rocker", 3.0)
    q = FourBar(*CHANGE_POINT, 1).evaluate(2.6)[0]
    home = [0.2, -0.1, np.cos(0.4), np.sin(0.4), q[0], q[1], 0.0, 0.0, 0.0, 1.0, q[2]]
    tip = rg.PointClosure("coupler_tip", "rocker_tip")
    mechanism = rg.Mechanism(model, [tip], ["base", "ball", "crank"], home=home)
    mechanism.home = mechanism.assemble(mechanism.home)
    return mechanism


SCENES: dict[str, tuple[Callable[[], rg.Mechanism], list[float], float, list[tuple[int, int]]]] = {
    "two clusters at once": (overlapping, [3.0, 3.0], 0.4, [(1, 1), (0, 1)]),
    "one on the other": (carried, [3.0, 3.0], 0.4, [(0, 1), (1, 1)]),
    "coranks 2 and 3": (lambda: families.scissor_lift(3), [-2.0], 0.8, [(0, 2), (0, 3)]),
    "two coordinates in a cluster": (two_joined, [1.5, 0.5], 0.16, [(0, 1)]),
    "on a floating base": (floating, [*THROWN, 3.0, 3.0], 0.4, [(1, 1), (0, 1)]),
    "one on the other, floating": (lambda: floating([-1, 0]), [*THROWN, 3.0, 3.0], 0.4, [(0, 1), (1, 1)]),
    "on a planar joint, with a ball": (planar, [0.3, -0.2, 2.0, 1.0, -2.0, 0.5, 3.0], 0.4, [(0, 1)]),
}


def runs(name: str, **options: Any) -> list[rg.Trajectory]:
    make, ydot, duration, _ = SCENES[name]
    mechanism = make()
    options |= {"v0": mechanism.lift(mechanism.home, ydot), "duration": duration}
    return [rg.simulate(mechanism, backend=backend, **options) for backend in ("python", "native")]


@pytest.mark.parametrize("name", SCENES)
def test_both_backends_take_the_same_decisions(name: str) -> None:
    """The same motion, crossings and amounts of work, with bridges that each builds for itself."""
    python, native = runs(name)
    assert native.stats.native_steps == len(native.t) - 1
    assert [(c.cluster, c.corank) for c in native.crossings] == SCENES[name][3]
    for counted in COUNTED:
        # on lines the time of a crossing is found to rounding: a try more or less follows every node anew
        allowed = (
            0.1 if name == "two coordinates in a cluster" and counted in ("marching_steps", "svds") else 0.0
        )
        expected = getattr(python.stats, counted)
        assert abs(getattr(native.stats, counted) - expected) <= allowed * expected, counted
    for a, b in ((python.q, native.q), (python.v, native.v)):
        assert (np.abs(a - b) / np.maximum(np.abs(a).max(axis=0), 1.0)).max() < 1e-11
    for one, other in zip(python.crossings, native.crossings, strict=True):
        assert abs(one.time - other.time) < 1e-12
        assert np.abs(one.q - other.q).max() < 1e-12
        assert one.kind == other.kind
        np.testing.assert_allclose(other.transversality, one.transversality, rtol=1e-6)


def on_a_bridge(name: str) -> rg.Simulation:
    """A simulation by the kernel that has stopped in a zone."""
    make, ydot, *_ = SCENES[name]
    mechanism = make()
    sim = rg.Simulation(mechanism, v0=mechanism.lift(mechanism.home, ydot), backend="native")
    for _ in range(400):
        run = sim.step()._run
        run.settle()
        explicit = run._motion.explicit.rest
        if explicit.in_zone and any(t.current is not None for t in read_back(explicit)):
            return sim
    raise AssertionError("no bridge was met")


def read_back(explicit: ClusterMap) -> list[Any]:
    """The kernel's trackers as those of Python."""
    mechanism = explicit.mechanism
    spaces = [space_of(mechanism, cluster, mechanism.home[cluster.iq]) for cluster in mechanism.clusters]
    return read(explicit.written(), spaces, explicit.options, explicit.counters)


@pytest.mark.parametrize(
    "name", ["two clusters at once", "coranks 2 and 3", "two coordinates in a cluster", "on a floating base"]
)
def test_trackers_pass_between_the_backends(name: str) -> None:
    """As plain numbers and back they are the same; Python goes on where the kernel was, on its bridge."""
    sim = on_a_bridge(name)
    explicit = sim._run._motion.explicit.rest
    numbers = explicit.written()
    again_written = written(read_back(explicit))
    np.testing.assert_allclose(again_written[:-1], numbers[:-1], rtol=1e-12, atol=1e-12)
    here = point_of_rest(sim._run.last.point)
    again = explicit.point_at(here.y, here.ydot)
    assert np.abs(again.q - here.q).max() < 1e-13
    assert np.abs(again.G - here.G).max() < 1e-11


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("inside", [False, True])
def test_a_map_made_on_the_way_is_where_the_motion_is(name: str, inside: bool) -> None:
    """On regular ground and in zones: a step in Python from there is the kernel's next one."""
    make, ydot, *_ = SCENES[name]
    mechanism = make()
    sim = rg.Simulation(mechanism, v0=mechanism.lift(mechanism.home, ydot), backend="native")
    run, motion = sim._run, sim._run._motion
    for _ in range(400):
        sim.step()
        run.settle()
        assert run._motion is motion and motion._explicit is None  # which the kernel does not ask for
        if (motion.trackers is not None) is inside:
            break
    else:
        raise AssertionError("no such place was met")
    np.testing.assert_array_equal(motion.explicit.anchor.q, sim.q)
    f, x, h = motion.equations, run._x.copy(), 1e-3
    after = rk4_step(f, sim.t, x, h, f(sim.t, x))
    wanted = motion.explicit.point_at(after[: mechanism.m], after[mechanism.m : 2 * mechanism.m]).q
    other = rg.Simulation(mechanism, v0=mechanism.lift(mechanism.home, ydot), backend="native")
    other.step(n=round((sim.t + h) / h))
    assert np.abs(other.q - wanted).max() < 1e-12


@pytest.mark.parametrize(
    "name", ["two clusters at once", "two coordinates in a cluster", "on a planar joint, with a ball"]
)
def test_going_back_to_a_bridge(name: str) -> None:
    """A state saved in a zone leads on to the same last bit, as often as one likes."""
    sim = on_a_bridge(name)
    state, ends = sim.save(), []
    for _ in range(2):
        ends.append(np.concatenate([sim.step(n=15).q, sim.v]))
        sim.restore(state)
    np.testing.assert_array_equal(ends[0], ends[1])


@pytest.mark.parametrize(
    "name", ["two clusters at once", "on a floating base", "on a planar joint, with a ball"]
)
def test_python_takes_over_on_a_bridge(name: str) -> None:
    """An event within a zone is located by the Python path from the kernel's trackers."""
    make, ydot, duration, _ = SCENES[name]
    mechanism = make()
    options = {"v0": mechanism.lift(mechanism.home, ydot), "duration": duration}
    plain = rg.simulate(mechanism, **options)
    crank = next(joint.idx_q for joint in mechanism.joints if joint.name.startswith("crank"))
    level = float(plain.crossings[0].q[crank]) - 1e-3

    def meets(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[crank]) - level

    found = [rg.simulate(mechanism, backend=b, events=[meets], **options) for b in ("python", "native")]
    for run in found:
        assert np.abs(run.q - plain.q).max() < 1e-11
    a, b = (run.t_events[0] for run in found)
    assert len(a) == len(b) == 1
    assert abs(a[0] - b[0]) < 1e-11


@pytest.mark.parametrize("short", [0.3, 0.05, 0.01])
@pytest.mark.parametrize("start", [0.02, 0.3])
def test_very_short_links_are_measured_alike(short: float, start: float) -> None:
    """Joints of short links turn far: D stops at ten radians, K is balanced instead. From in the zone too."""
    linkage = linkages.four_bar(short, 4.0, 4.0 - 0.4 * short, 0.6 * short, y=start)  # flat at y = 0
    v0 = linkage.lift(linkage.home, [-2.0])
    python, native = (
        rg.simulate(linkage, v0=v0, duration=0.5, step=1e-3, backend=backend)
        for backend in ("python", "native")
    )
    assert native.stats.native_steps > 400
    assert native.closure_error().max() < 1e-12
    assert len(python.crossings) == len(native.crossings) >= 1
    for one, other in zip(python.crossings, native.crossings, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-10)
    np.testing.assert_allclose(native.q, python.q, atol=1e-9)
    for name in COUNTED:
        assert getattr(native.stats, name) == getattr(python.stats, name)


def test_steps_that_pass_nothing_follow_each_node_once_a_stage() -> None:
    """What tells that a step passed no singular place needs no points of the mode beside its two ends."""
    sim = on_a_bridge("two coordinates in a cluster")
    counters = sim._run._motion.explicit.counters
    begun = counters.marching_steps, counters.zone_evaluations
    run = sim.step(n=2)._run
    run.settle()
    assert not sim.crossings
    nodes, stages = 2 * len(NODES), counters.zone_evaluations - begun[1]
    assert stages == 2 * 4
    assert counters.marching_steps - begun[0] == stages * nodes
