"""Mechanisms and motions that several test files share."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable
from pathlib import Path

# The matrices here are small: threads of BLAS only wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.meetings import trammel as trammel_at

from .compiled import KERNEL

Array = NDArray[np.float64]

THOROUGH = int(os.environ.get("FUZZ_EXAMPLES", "0"))
"""Examples for each property of tests/test_fuzz_*.py; 0: a hundred, the same in every run."""

settings.register_profile(
    "fuzz",
    deadline=None,
    derandomize=not THOROUGH,
    database=None,
    max_examples=THOROUGH or 100,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


LONG = "long.txt" if KERNEL.available else "long_in_python.txt"
LISTED = {
    mark: tuple(Path(__file__).with_name(file).read_text(encoding="utf-8").split("\n")[:-1])
    for mark, file in (("slow", "slow.txt"), ("campaign", LONG))
}
"""Tests, as their names begin, that take more than some two seconds of a processor; and of these the long
ones whose like, in another backend or of a smaller machine, shows the same. Without a kernel those of motions
that take more than some four seconds are long."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """What attacks at random (`-m campaign tests/campaigns`) asks for."""
    group = parser.getgroup("campaigns")
    group.addoption("--seed", type=int, help="of the drawing; default: each campaign's own")
    group.addoption("--count", type=int, help="cases of each campaign; default: each campaign's own")
    group.addoption("--most", type=int, default=20, help="choices of coordinates, and of trees, of a scene")


def pytest_report_header(config: pytest.Config) -> str | None:
    """The seed of a campaign."""
    seed = config.option.seed
    told = "each one's own, which its tests are named by" if seed is None else seed
    return f"campaigns: seed {told}" if config.option.markexpr == "campaign" else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Figures that campaigns recorded, added up over their tests; of what is largest, the largest."""
    found: dict[str, dict[str, float]] = {}
    for report in (each for reports in terminalreporter.stats.values() for each in reports):
        if getattr(report, "when", "") != "call":
            continue
        for name, figures in report.user_properties:
            so_far = found.setdefault(name, {})
            for what, value in figures.items():
                of = max if what.startswith("largest") else sum
                so_far[what] = of((so_far.get(what, 0.0), value))
    if found:
        terminalreporter.section("campaigns")
    for name, figures in sorted(found.items()):
        told = ", ".join(f"{value:.5g} {what}" for what, value in figures.items())
        terminalreporter.line(f"{name}: {told}")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark them."""
    for item in items:
        for mark, names in LISTED.items():
            if item.nodeid.removeprefix("tests/").startswith(names):
                item.add_marker(mark)


def _placement(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))


def _add_body(model: pin.Model, parent: int, joint: object, name: str, rng: np.random.Generator) -> int:
    """A joint at a random place with a random body; returns its index."""
    index = model.addJoint(parent, joint, _placement(rng), name)
    centre, moments = rng.uniform(-0.2, 0.2, 3), rng.uniform(0.05, 0.1, 3)
    model.appendBodyToJoint(
        index, pin.Inertia(rng.uniform(0.5, 2.0), centre, np.diag(moments)), pin.SE3.Identity()
    )
    return int(index)


def _add_pair(model: pin.Model, q: Array, ends: tuple[int, int], name: str, rng: np.random.Generator) -> None:
    """Frames `<name>1` and `<name>2` on two joints (0: the ground) that coincide at q."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    first = _placement(rng)
    second = data.oMi[ends[1]].inverse() * data.oMi[ends[0]] * first
    for number, joint, placement in ((1, ends[0], first), (2, ends[1], second)):
        frame = pin.Frame(f"{name}{number}", joint, placement, pin.FrameType.OP_FRAME)
        model.addFrame(frame)


def _tripod() -> rg.Mechanism:
    """A free body on three universal-prismatic legs, spherical cut joints: mobility 6 + 9 − 9 = 6."""
    rng = np.random.default_rng(1)
    model = pin.Model()
    platform = _add_body(model, 0, pin.JointModelFreeFlyer(), "platform", rng)
    feet = []
    for i in range(3):
        hip = _add_body(model, 0, pin.JointModelRX(), f"leg{i}x", rng)
        knee = _add_body(model, hip, pin.JointModelRY(), f"leg{i}y", rng)
        feet.append(_add_body(model, knee, pin.JointModelPZ(), f"leg{i}z", rng))
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-0.5, 0.5, model.nv))
    for i, foot in enumerate(feet):
        _add_pair(model, q, (platform, foot), f"leg{i}_tip", rng)
    return rg.Mechanism.from_pinocchio(
        model,
        [rg.PointClosure(f"leg{i}_tip1", f"leg{i}_tip2") for i in range(3)],
        [f"leg{i}{axis}" for i in range(3) for axis in "yz"],
        home=q,
        name="tripod",
    )


def _spherical_loop() -> rg.Mechanism:
    """One loop with a spherical joint inside, cut at a hinge: 3 + 1 + 1 + 1 − 5 = 1."""
    rng = np.random.default_rng(24)  # K_d at home: σ_min/σ_max = 0.16
    model = pin.Model()
    joint = _add_body(model, 0, pin.JointModelRZ(), "crank", rng)
    joint = _add_body(model, joint, pin.JointModelSpherical(), "ball", rng)
    joint = _add_body(model, joint, pin.JointModelRX(), "elbow", rng)
    joint = _add_body(model, joint, pin.JointModelRY(), "wrist", rng)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    _add_pair(model, q, (joint, 0), "pin", rng)
    closure = rg.RevoluteClosure("pin1", "pin2", axis=(1.0, -2.0, 0.5))
    return rg.Mechanism.from_pinocchio(model, [closure], ["crank"], home=q, name="spherical loop")


def _seven_hinges() -> rg.Mechanism:
    """Seven hinges in a ring, one body cut through: 7 − 6 = 1."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    joint = 0
    for i, kind in enumerate("XYZXYZX"):
        joint = _add_body(model, joint, getattr(pin, f"JointModelR{kind}")(), f"hinge{i}", rng)
    q = rng.uniform(-1.0, 1.0, model.nq)
    _add_pair(model, q, (0, joint), "cut", rng)
    closure = rg.FrameClosure("cut1", "cut2")
    return rg.Mechanism.from_pinocchio(model, [closure], ["hinge0"], home=q, name="seven hinges")


def _humanoid() -> rg.Mechanism:
    """Pinocchio's humanoid with a free-flyer, one foot on the ground, hands on one point: 32 − 9."""
    rng = np.random.default_rng(12)  # K_d at home: σ_min/σ_max = 0.27
    pin.seed(12)
    model = pin.buildSampleModelHumanoidRandom(True)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-0.5, 0.5, model.nv))
    foot, left, right = (model.getJointId(f"{n}6_joint") for n in ("rleg", "larm", "rarm"))
    _add_pair(model, q, (foot, 0), "foot", rng)
    _add_pair(model, q, (left, right), "hand", rng)
    dependent = ("universe", "root_joint", *(f"larm{i}_joint" for i in (1, 2, 3)))
    return rg.Mechanism.from_pinocchio(
        model,
        [rg.FrameClosure("foot1", "foot2"), rg.PointClosure("hand1", "hand2")],
        [name for name in model.names if name not in dependent],
        home=q,
        name="humanoid",
    )


@pytest.fixture(scope="session")
def spatial() -> dict[str, rg.Mechanism]:
    """Mechanisms that move in space, with all kinds of closures, closed at home."""
    made = (_tripod(), _spherical_loop(), _seven_hinges(), _humanoid())
    return {mechanism.name: mechanism for mechanism in made}


@pytest.fixture(scope="session")
def trammel() -> Callable[..., rg.Mechanism]:
    """Modes that touch: at θ = π/2 tangentially, at other θ in a cusp."""
    return trammel_at


@pytest.fixture(scope="session")
def mechanisms(spatial: dict[str, rg.Mechanism]) -> dict[str, rg.Mechanism]:
    """The shipped planar models and the spatial ones."""
    return {name: rg.load(name) for name in rg.model_names()} | spatial


@pytest.fixture(scope="session")
def closed_states() -> Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]:
    """Random closed configurations around home and velocities there, reproducible."""

    def states(mechanism: rg.Mechanism, count: int) -> list[tuple[Array, Array]]:
        rng = np.random.default_rng(count)
        found: list[tuple[Array, Array]] = []
        for _ in range(20 * count):
            guess = mechanism.tree.integrate(mechanism.home, rng.uniform(-0.3, 0.3, mechanism.nv))
            try:
                q = mechanism.assemble(guess)
            except rg.ClosureError:
                continue  # out of reach of the dependent joints
            K_d = mechanism.scaled(mechanism.K(q))[:, mechanism.iv_dependent]
            if np.linalg.cond(K_d) < 200.0:  # two digits may be lost, not more
                found.append((q, mechanism.lift(q, rng.uniform(-1.0, 1.0, mechanism.m))))
            if len(found) == count:
                return found
        raise AssertionError(f"{mechanism.name}: no closed configurations near home")

    return states


@pytest.fixture(scope="session")
def derivative() -> Callable[..., Array]:
    """d f/ds at s = 0 by an eighth-order central difference."""

    def differentiate(f: Callable[[float], Array], h: float = 1e-2) -> Array:
        # Error h⁸ f⁽⁹⁾/630, 1e-16 for the sines of unit frequency that mechanisms are made of,
        # and ε/h = 2e-14 of rounding.
        weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
        return np.tensordot(weights, np.array([f(i * h) for i in range(-4, 5)]), 1) / h

    return differentiate


@pytest.fixture(scope="session")
def free_fall() -> Callable[..., rg.Trajectory]:
    """The paper's motion: from q1 = 0.2 rad at rest on the parallelogram mode; each run made once."""

    @functools.cache
    def run(name: str, method: str, step: float = 1e-3, duration: float = 5.0) -> rg.Trajectory:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.SingularityWarning)  # classical GCP says so itself
            return rg.simulate(
                rg.load(name),
                q0=[0.2, -0.2, 0.2],
                duration=duration,
                step=step,
                method=method,
                newton_start="previous" if method == "classical" else "tangent",
                record=("a", "energy"),
            )

    return run


@pytest.fixture(scope="session")
def accepted() -> Callable[[Callable[[], object]], object]:
    """What a call gives, or None where it refuses with an error of ours; any other error is a fault."""

    def attempt(call: Callable[[], object]) -> object:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)  # what they warn of is checked in the results
            try:
                return call()
            except rg.RobustGcpError as error:
                assert 10 < len(str(error)) < 20_000, "an error says what was wrong, and briefly"
                return None

    return attempt


@pytest.fixture(scope="session")
def require_sane(accepted: Callable[..., object]) -> Callable[[rg.Mechanism], None]:
    """A mechanism that was accepted is finite, and moves with its loops closed or says why not."""

    def check(mechanism: rg.Mechanism) -> None:
        assert np.all(np.isfinite(mechanism.home))
        assert np.isfinite(mechanism.length)
        inertia = np.linalg.eigvalsh(np.triu(M := mechanism.tree.crba(mechanism.home)) + np.triu(M, 1).T)
        assert inertia[0] >= -1e-6 * abs(inertia[-1]), "no velocity has negative kinetic energy"
        run = accepted(lambda: rg.simulate(mechanism, duration=3e-3, step=1e-3, record=("energy",)))
        if run is None:
            return
        assert isinstance(run, rg.Trajectory)
        assert np.all(np.isfinite(run.q)) and np.all(np.isfinite(run.v)) and np.all(np.isfinite(run.energy))
        for q, v in zip(run.q, run.v, strict=True):
            assert mechanism.closure_residual(q) < 1e-9
            K, u = mechanism.scaled(mechanism.K(q)), v / mechanism.column_scale
            assert np.abs(K @ u).max(initial=0.0) <= 1e-7 * np.abs(K).max(initial=0.0) * np.abs(u).max(
                initial=0.0
            )

    return check
