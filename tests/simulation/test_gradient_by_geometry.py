"""Gradients by placements of joints and of closure frames: against differences of runs of other linkages."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.torque_feedback import AppliedSlopes
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.derivatives import reverse_sweep
from robust_gcp.simulation.derivatives.at_states import AtStates

from ..dynamics.test_derivatives import TENTH, floating
from .test_gradient import COST, Case, slope
from .test_gradient_by_parameters import changed, feedback, thick, value

Array = NDArray[np.float64]


def moved(mech: rg.Mechanism, name: str, by: float) -> rg.Mechanism:
    """The same mechanism with the placement of a joint or frame in its parent changed."""
    model = mech.model.copy()
    target, _, direction = name.rpartition(".placement.")
    axis = np.eye(3)["xyz".index(direction[-1])]

    def change(place: pin.SE3) -> pin.SE3:
        if direction.startswith("r"):
            return pin.SE3(pin.exp3(by * axis) @ place.rotation, place.translation)
        return pin.SE3(place.rotation, place.translation + by * axis)

    if target in {joint.name for joint in mech.joints}:
        i = mech.joint(target).index
        model.jointPlacements[i] = change(model.jointPlacements[i])
    else:
        frame = model.frames[model.getFrameId(target)]
        frame.placement = change(frame.placement)
    return rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)


Scene = tuple[rg.Mechanism, list[float], float, tuple[str, ...]]


def _delta() -> Scene:
    mech = thick(rg.load("delta"))
    closure = mech.closures[0]
    frames = closure.frame1, closure.frame2
    names = ("rod1a_y.placement.z", "rod1a_x.placement.rx", "arm2.placement.y", "platform.placement.rz")
    return mech, [0.4, -0.5, 0.3], 5e-3, (*names, f"{frames[0]}.placement.x", f"{frames[1]}.placement.y")


def _free() -> Scene:
    mech = floating(pin.JointModelFreeFlyer())
    last, tip = mech.joints[-1].name, mech.closures[0].frame1
    return mech, [0.4] * 7, 5e-3, (f"{last}.placement.y", f"{tip}.placement.z", f"{tip}.placement.rx")


SCENES: dict[str, Callable[[], Scene]] = {
    "crank-rocker": lambda: (
        thick(rg.load("crank_rocker")),
        [2.0],
        5e-3,
        ("q2.placement.y", "q2.placement.z", "q3.placement.rx", "coupler_tip.placement.y", "q1.placement.rx"),
    ),
    "five-bar": lambda: (
        thick(rg.load("five_bar")),
        [0.5, -0.5],
        5e-3,
        tuple(f"{joint.name}.placement.y" for joint in rg.load("five_bar").joints),
    ),
    "delta": _delta,
    "floating": _free,
}


@pytest.mark.parametrize(
    ("name", "hold"), [(name, hold) for name in SCENES for hold in (False, True) if hold or name != "delta"]
)
def test_against_differences_of_runs(name: str, hold: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The start has the same y and u, and dependent joints that close the loops; and by the reference."""
    mech, u, h, names = SCENES[name]()
    names = (*names, f"{mech.joints[0].name}.mass")

    def run(of: rg.Mechanism) -> rg.Trajectory:
        home = of.assemble(mech.home, hold=mech.independent)
        return rg.simulate(of, home, of.lift(home, u), duration=12 * h, step=h, torque=feedback, hold=hold)

    base = run(mech)
    found = rg.gradient(base, COST, parameters=names)
    plain = rg.gradient(base, COST, parameters=names[-1:])
    assert found.value == pytest.approx(plain.value, rel=1e-12)
    assert found.parameters[names[-1]] == pytest.approx(plain.parameters[names[-1]], rel=1e-8)
    for part in ("dy", "dv", "dtau"):
        one, other = getattr(found, part), getattr(plain, part)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max())
    size = max(map(abs, found.parameters.values()))
    for parameter in names[:-1]:
        exact = slope(lambda s, p=parameter: value(run(moved(mech, p, s)), hold), 2e-3)
        assert found.parameters[parameter] == pytest.approx(exact, abs=3e-8 * size), parameter
    monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
    slow = rg.gradient(base, COST, parameters=names)
    for parameter in names:
        assert slow.parameters[parameter] == pytest.approx(found.parameters[parameter], abs=1e-8 * size)


def _states(name: str) -> tuple[rg.Mechanism, rg.Trajectory, tuple[str, ...], Array]:
    mech, u, _, names = SCENES[name]()
    run = rg.simulate(mech, v0=mech.lift(mech.home, u), duration=0.02, step=5e-3)
    joint = mech.joints[-1].name
    numbers = (f"{joint}.com.y", f"{joint}.Ixx", "gravity.z", f"{mech.joints[0].name}.mass")
    return mech, run, (*names, *numbers), np.random.default_rng(6).normal(size=run.v.shape)


def other(mech: rg.Mechanism, name: str, by: float) -> rg.Mechanism:
    return moved(mech, name, by) if ".placement." in name else changed(mech, name, by)


def carried(mech: rg.Mechanism, of: rg.Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """The state of another linkage with the same independent positions and velocities."""
    at = of.assemble(q, hold=mech.independent)
    return at, of.lift(at, v[mech.iv_independent])


@pytest.mark.parametrize("native", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_accelerations_and_steps(name: str, native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """By differences of other linkages, one state and many, the kernel and the reference."""
    mech, run, names, tau = _states(name)
    if not native:
        monkeypatch.setattr(AtStates, "kernel", lambda self: None)
        run.q, run.v, tau = run.q[:2], run.v[:2], tau[:2]
    h, own = 5e-3, mech.iv_independent
    middle = rg.step(mech, run.q[1], run.v[1], tau[1], h)
    by = rg.by_parameters(mech, run.q, run.v, tau, names)
    after = rg.by_parameters(mech, run.q, run.v, tau, names, h=h)
    one = rg.by_parameters(mech, run.q[1], run.v[1], tau[1], names)
    np.testing.assert_allclose(one, by[1], rtol=0, atol=1e-9 * np.abs(by[1]).max())
    for k, parameter in enumerate(names):

        @functools.cache
        def at(s: float, p: str = parameter) -> tuple[rg.Mechanism, Array, Array]:
            of = other(mech, p, s)
            return (of, *carried(mech, of, run.q[1], run.v[1]))

        def quick(s: float, at: Any = at) -> Array:
            return rg.forward_dynamics(*at(s), tau[1])

        def later(s: float, at: Any = at) -> Array:
            end = rg.step(*at(s), tau[1], h)
            apart = mech.tree.difference(middle.q, end.q)[own]
            return np.concatenate([apart, end.v[own]])

        step = 1e-3 if "Ixx" in parameter else 2e-3
        for found, function in ((by[1, :, k], quick), (after[1, :, k], later)):
            exact = sum(w * (function(i * step) - function(-i * step)) for i, w in enumerate(TENTH, 1)) / step
            size = np.abs(by if function is quick else after).max()
            np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8 * size, err_msg=parameter)


@pytest.mark.parametrize("reference", ["world", "local"])
@pytest.mark.parametrize("hold", [False, True])
def test_wrenches_go_with_their_frames(reference: Any, hold: bool) -> None:
    """Levers of forces change with lengths; beside torques that are given, their slopes or neither."""
    mech, u, name = rg.load("crank_rocker"), [2.0], "coupler_tip.placement.y"
    push = rg.Wrench("coupler_tip", lambda t, q, v: [0.0, 3.0, 7.0 + v[2], 2.0, 0.0, 0.0], reference)

    def run(by: float) -> rg.Trajectory:
        of = moved(mech, name, by)
        home = of.assemble(mech.home, hold=mech.independent)
        push_on = {"torque": feedback, "wrenches": [push], "hold": hold}
        return rg.simulate(of, home, of.lift(home, u), duration=0.06, step=5e-3, **push_on)

    exact = slope(lambda s: run(s).q[-1, 2], 2e-3)
    cost = rg.Cost(lambda q, v: q[2])
    ways: list[dict[str, Any]] = [
        {},
        {"torque": feedback},
        {"torque_slopes": AppliedSlopes(mech, feedback, None)},
    ]
    for options in ways:
        found = rg.gradient(run(0.0), cost, parameters=[name], **options).parameters[name]
        assert found == pytest.approx(exact, rel=1e-7)


def test_the_length_of_a_link() -> None:
    """By placements, and as the crank-rocker's closed form: a longer coupler, whose end is its tip."""
    mech = rg.load("crank_rocker")
    run = rg.simulate(mech, v0=mech.lift(mech.home, [2.0]), duration=0.1, step=5e-3)
    length = rg.along("q2", "coupler_tip")
    found = rg.gradient(run, COST, parameters=[length, "q2.mass"])
    assert list(found.parameters) == ["along(q2, coupler_tip)", "q2.mass"]
    frame = mech.model.frames[mech.model.getFrameId("coupler_tip")]
    direction = frame.placement.translation / np.linalg.norm(frame.placement.translation)
    names = [f"coupler_tip.placement.{axis}" for axis in "yz"]
    parts = rg.gradient(run, COST, parameters=names).parameters
    wanted = direction[1] * parts[names[0]] + direction[2] * parts[names[1]]
    assert found.parameters["along(q2, coupler_tip)"] == pytest.approx(wanted, rel=1e-12)
    by = rg.by_parameters(mech, mech.home, run.v[0], parameters=[length])
    assert by.shape == (1, 1)


class TestRefused:
    MECH = rg.load("crank_rocker")

    def _gradient(self, parameters: list[Any], mech: rg.Mechanism | None = None) -> rg.Gradient:
        mech = self.MECH if mech is None else mech
        run = rg.simulate(mech, v0=mech.lift(mech.home, [1.0]), duration=0.02, step=5e-3)
        return rg.gradient(run, COST, parameters=parameters)

    @pytest.mark.parametrize("name", ["q2.placement.x", "q3.placement.ry", "rocker_tip.placement.x"])
    def test_out_of_the_plane(self, name: str) -> None:
        with pytest.raises(rg.OptionError, match=rf"loops do not stay closed when {name} changes"):
            self._gradient([name])
        with pytest.raises(rg.OptionError, match=rf"loops do not stay closed when {name} changes"):
            rg.by_parameters(self.MECH, self.MECH.home, parameters=[name])

    def test_linkages_that_move_by_their_dimensions(self) -> None:
        mech = rg.load("bricard")
        with pytest.raises(rg.OptionError, match=r"not stay closed when hinge3.placement.x changes"):
            self._gradient(["hinge3.placement.x"], mech)

    def test_names(self) -> None:
        with pytest.raises(rg.OptionError, match=r"q2.placement.w' is none; did you mean 'q2.placement"):
            self._gradient(["q2.placement.w"])
        with pytest.raises(rg.OptionError, match=r"'q7' is no joint, nor the frame"):
            self._gradient([rg.along("q7", "coupler_tip")])
        with pytest.raises(rg.OptionError, match=r"'coupler_tip' is carried by 'q2'"):
            self._gradient([rg.along("q1", "coupler_tip")])

    def test_crossings(self) -> None:
        """The rhombus: with other lengths there is no flat configuration to pass."""
        mech = rg.load("rhombus")
        run = rg.simulate(mech, mech.assemble([0.05, -0.05, 0.05]), None, 1.0, 1e-3)
        assert run.crossings
        with pytest.raises(rg.OptionError, match=r"come apart when q3.placement.y changes"):
            rg.gradient(run, COST, parameters=["q3.placement.y"])
        name, far = "q3.placement.y", mech.assemble([0.5, -0.5, 0.5])
        before = rg.simulate(mech, far, None, 0.05, 1e-3)
        assert not before.crossings
        assert np.isfinite(rg.gradient(before, COST, parameters=[name]).parameters[name])
        near = mech.assemble([1e-3, -1e-3, 1e-3])
        beside = rg.simulate(mech, near, None, 0.01, 1e-3)
        assert not beside.crossings
        unknown = r"no derivative by q3\.placement\.y is known beside"
        with pytest.raises(rg.SimulationError, match=unknown):
            rg.gradient(beside, COST, parameters=[name])
        for q, h in ((near, None), (np.zeros(3), None), (np.zeros(3), 1e-3)):
            with pytest.raises(rg.SimulationError, match=unknown):
                rg.by_parameters(mech, q, parameters=[name], h=h)


def test_through_changes_of_the_independent_joints() -> None:
    """A rocker turns back, another takes over and gives back, as in `test_gradient`."""
    case = Case(four_bar(1.0, 1.2, 1.4, 0.7, y=1.0), [-1.0], 120, 4e-3)
    case.tau *= 0.1
    run = case.run()
    assert len(run.stats.repartitions) == 2
    names = ["q2.placement.y", "q2_tip.placement.z", "q1.placement.z"]
    found = rg.gradient(run, COST, case.tau, parameters=names).parameters

    def of(name: str, by: float) -> float:
        changed = Case(moved(case.mech, name, by), case.u.tolist(), case.steps, case.h)
        changed.tau = case.tau
        home = changed.mech.assemble(case.mech.home, hold=case.mech.independent)
        sim = rg.Simulation(changed.mech, home, changed.mech.lift(home, case.u), step=case.h)
        for torque in case.tau:
            sim.step(torque)
        return changed.value(sim.trajectory)

    for name in names:
        assert found[name] == pytest.approx(slope(lambda s, n=name: of(n, s), 1e-4), rel=1e-8), name
