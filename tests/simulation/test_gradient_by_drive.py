"""Gradients of runs with prescribed joints: against differences of runs that are driven otherwise."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.simulation.derivatives import reverse_sweep

from ..compiled import some
from ..dynamics.test_derivatives import floating
from ..kernel.test_kernel import random_mechanism
from .test_gradient import slope
from .test_gradient_by_geometry import moved
from .test_gradient_by_parameters import changed, feedback, thick
from .test_gradient_by_parameters import value as cost_of

Array = NDArray[np.float64]

STEPS, NUDGE = 15, 2e-3


def terminal(q: Array, v: Array) -> float:
    return float(np.sin(q) @ np.cos(np.arange(len(q))) + 0.1 * v @ v)


def running(t: float, q: Array, v: Array, tau: Array) -> float:
    return float(0.3 * q[-1] ** 2 + 0.1 * v[0] * v[-1] + 0.2 * tau @ tau + t * v[1])


COST = rg.Cost(terminal, running)


def value(run: rg.Trajectory, held: bool) -> float:
    """Its cost."""
    return cost_of(run, held, COST)


@dataclass(frozen=True)
class Scene:
    """A mechanism whose joints `driven` are driven about where they are at home, the others free.

    Attributes
    ----------
    u : list of float
        First velocities of all independent joints, in their order; driven ones start as they are driven.
    names : tuple of str
        Parameters.
    """

    mech: rg.Mechanism
    driven: tuple[str, ...]
    u: list[float]
    names: tuple[str, ...]
    h: float = 5e-3
    crossings: int = 0

    def position(self, k: int, t: float, by: float) -> float:
        """Of the k-th driven joint, its motion changed along `change`."""
        joint = self.mech.joint(self.driven[k])
        start = float(self.mech.home[joint.idx_q])
        return start + 0.3 * np.sin((2.0 + k) * t) + (1.0 + k) * t + by * change(k, t)

    def run(
        self,
        of: rg.Mechanism | None = None,
        by: float = 0.0,
        eta: tuple[str, float] = ("", 0.0),
        faster: tuple[int, float] = (0, 0.0),
        hold: bool = False,
    ) -> rg.Trajectory:
        """With the drives changed, and with another number or velocity of a free joint at the start."""
        mech = self.mech if of is None else of
        u, home = np.array(self.u), mech.home.copy()
        drive = {}
        for k, name in enumerate(self.driven):
            motion = rg.Motion(lambda t, k=k: self.position(k, t, by))
            drive[name] = motion
            home[mech.joint(name).idx_q], u[list(mech.iv_independent).index(mech.joint(name).idx_v)], _ = (
                motion.at(0.0)
            )
        if eta[0]:
            home[mech.joint(eta[0]).idx_q] += eta[1]
        u[faster[0]] += faster[1]
        home = mech.assemble(home, hold=mech.independent)
        v0 = mech.lift(home, u)
        return rg.simulate(
            mech, home, v0, duration=STEPS * self.h, step=self.h, torque=feedback, drive=drive, hold=hold
        )

    def free(self) -> list[int]:
        """Which of u are free."""
        own = [self.mech.joint(name).idx_v for name in self.driven]
        return [k for k, i in enumerate(self.mech.iv_independent.tolist()) if i not in own]


def change(k: int, t: float) -> float:
    return 0.4 * np.cos(3.0 * t + k) + 0.2 * t


def _delta(driven: tuple[str, ...]) -> Scene:
    return Scene(thick(rg.load("delta")), driven, [0.4, -0.5, 0.3], ("arm2.placement.y", "platform.mass"))


def _beside_flat() -> rg.Mechanism:
    mech = thick(rg.load("rhombus"))
    mech.home = np.array([-0.04, 0.04, -0.04])
    return mech


SCENES: dict[str, Callable[[], Scene]] = {
    "crank": lambda: Scene(
        thick(rg.load("crank_rocker")), ("q1",), [0.0], ("q3.placement.y", "coupler_tip.placement.y")
    ),
    "five-bar": lambda: Scene(
        thick(rg.load("five_bar")), ("q1",), [0.0, 0.3], ("q3.placement.y", "q2.mass", "gravity.z")
    ),
    "delta, one": lambda: _delta(rg.load("delta").independent[1:2]),
    "delta, two": lambda: _delta(rg.load("delta").independent[::2]),
    "floating": lambda: Scene(
        floating(pin.JointModelFreeFlyer()), ("q1",), [0.4] * 7, ("q2.mass", "q3.placement.y")
    ),
    "through flat": lambda: Scene(_beside_flat(), ("q1",), [0.0], ("q2.mass",), 4e-3, crossings=1),
}


@pytest.mark.parametrize(("name", "hold"), [(name, hold) for name in SCENES for hold in (False, True)])
def test_against_differences_of_runs(name: str, hold: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the drives, by y and u of free joints, by parameters; and what the reference finds."""
    scene = SCENES[name]()
    mech, base = scene.mech, scene.run(hold=hold)
    assert len(base.crossings) == scene.crossings
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.PerformanceWarning)
        found = rg.gradient(base, COST, parameters=scene.names)
    assert found.value == pytest.approx(value(base, hold), rel=1e-12)
    changes = {name: rg.Motion(lambda t, k=k: change(k, t)) for k, name in enumerate(scene.driven)}
    exact = slope(lambda s: value(scene.run(by=s, hold=hold), hold), NUDGE)
    assert found.by_drive(changes) == pytest.approx(exact, rel=3e-9, abs=1e-10)
    alone = sum(found.by_drive({name: motion}) for name, motion in changes.items())
    assert alone == pytest.approx(found.by_drive(changes), rel=1e-12)
    free = scene.free()
    held = np.setdiff1d(np.arange(mech.m), free)
    assert not found.dy[held].any() and not found.dv[held].any()
    size = np.abs(np.append(found.dv, found.dy)).max()
    for k in free[-1:]:
        exact = slope(lambda s, k=k: value(scene.run(faster=(k, s), hold=hold), hold), NUDGE)
        assert found.dv[k] == pytest.approx(exact, abs=1e-9 * size)
        joint = mech.joint_at(int(mech.iv_independent[k])).name
        if joint != "base":
            exact = slope(lambda s, n=joint: value(scene.run(eta=(n, s), hold=hold), hold), NUDGE)
            assert found.dy[k] == pytest.approx(exact, abs=1e-8 * size)
    size = max(map(abs, found.parameters.values()))
    for parameter in scene.names:
        vary = moved if "placement" in parameter else changed
        exact = slope(
            lambda s, p=parameter, vary=vary: value(scene.run(vary(mech, p, s), hold=hold), hold), NUDGE
        )
        assert found.parameters[parameter] == pytest.approx(exact, abs=3e-8 * size + 1e-12), parameter
    monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
    slow = rg.gradient(base, COST, parameters=scene.names)
    assert slow.by_drive(changes) == pytest.approx(found.by_drive(changes), rel=1e-8, abs=1e-12)
    np.testing.assert_allclose(slow.dtau, found.dtau, rtol=0.0, atol=1e-9 * np.abs(found.dtau).max())
    for parameter in scene.names:
        assert slow.parameters[parameter] == pytest.approx(found.parameters[parameter], abs=1e-8 * size)


def test_torques_on_driven_joints_change_nothing() -> None:
    scene = SCENES["five-bar"]()
    run = scene.run()
    found = rg.gradient(run, rg.Cost(terminal=lambda q, v: float(np.sin(q[1]) + v[2])))
    own = scene.mech.joint("q1").idx_v
    assert not found.dtau[:, own].any()
    assert np.abs(np.delete(found.dtau, own, axis=1)).max() > 0.0


def test_step_by_step() -> None:
    """A simulation that was driven gives the same gradient as a run."""
    mech = rg.load("five_bar")
    start = float(mech.home[0])
    motion = rg.Motion(lambda t: start + 0.5 * t)
    v0 = mech.lift(mech.home, [0.5, 0.2])
    tau = np.array([0.0, 0.3, -0.1, 0.2])
    run = rg.simulate(mech, v0=v0, duration=0.02, step=2e-3, torque=tau, drive={"q1": motion})
    sim = rg.Simulation(mech, v0=v0, step=2e-3, drive={"q1": motion})
    for _ in range(10):
        sim.step(tau)
    cost, ahead = rg.Cost(terminal=lambda q, v: float(q[2] + v[1])), {"q1": rg.Motion(lambda t: t**2)}
    one, other = rg.gradient(run, cost), rg.gradient(sim.trajectory, cost)
    assert one.by_drive(ahead) == pytest.approx(other.by_drive(ahead), rel=1e-12)


def test_refusals() -> None:
    scene = SCENES["five-bar"]()
    run = scene.run()
    cost = rg.Cost(terminal=lambda q, v: float(q[1]))
    found = rg.gradient(run, cost)
    with pytest.raises(rg.OptionError, match="'q3' was not driven"):
        found.by_drive({"q3": rg.Motion(1.0)})
    with pytest.raises(rg.OptionError, match="is no Motion"):
        found.by_drive({"q1": 1.0})  # type: ignore[dict-item]
    with pytest.raises(rg.OptionError, match="must be"):
        found.by_drive({})
    with pytest.raises(rg.OptionError, match="does not hold how"):
        rg.gradient(pickle.loads(pickle.dumps(run)), cost, torque=feedback)
    free = rg.simulate(scene.mech, duration=0.01, step=1e-3)
    with pytest.raises(rg.OptionError, match="no joint of this run was driven"):
        rg.gradient(free, cost).by_drive({"q1": rg.Motion(1.0)})


@pytest.mark.parametrize("seed", some(range(60), 8))
def test_of_random_mechanisms(seed: int) -> None:
    """Loops in space, on floating bases too, one of their joints driven."""
    mech = random_mechanism(seed)
    single = [] if mech is None else [n for n in mech.independent if mech.joint(n.split(".")[0]).single]
    if mech is None or not single:
        return
    rng = np.random.default_rng(seed)
    name = str(rng.choice(single))
    start, own = float(mech.home[mech.joint(name).idx_q]), mech.joint(name).idx_v
    u, tau = 0.7 * rng.normal(size=mech.m), rng.normal(size=mech.nv)

    def run(by: float) -> rg.Trajectory:
        motion = rg.Motion(lambda t: start + 0.5 * t + 0.2 * t * t + by * np.sin(5.0 * t))
        u[mech.iv_independent.tolist().index(own)] = motion.at(0.0)[1]
        v0, drive = mech.lift(mech.home, u), {name: motion}
        return rg.simulate(mech, mech.home, v0, duration=0.03, step=3e-3, drive=drive, torque=tau)

    def end(by: float) -> float:
        last = run(by)
        return terminal(last.q[-1], last.v[-1])

    found = rg.gradient(run(0.0), rg.Cost(terminal)).by_drive({name: rg.Motion(lambda t: np.sin(5.0 * t))})
    exact = [slope(end, h) for h in (2e-3, 5e-4)]
    error = min(abs(found - one) for one in exact)
    assert error < 1e-8 * max(1.0, abs(exact[1])) + 2.0 * abs(exact[1] - exact[0])
