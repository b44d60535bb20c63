"""Random trees of all joints, tied at random: clusters of many coordinates, carried ones, rigid ones."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.kernel.derivatives.derivations import derivation

from ..compiled import needs_kernel, some
from .random_links import anywhere, carry
from .test_derivation import same

pytestmark = needs_kernel

JOINTS = {
    "rx": pin.JointModelRX,
    "ry": pin.JointModelRY,
    "rz": pin.JointModelRZ,
    "slide": pin.JointModelPZ,
    "ball": pin.JointModelSpherical,
    "circle": pin.JointModelRUBZ,
    "translation": pin.JointModelTranslation,
    "planar": pin.JointModelPlanar,
    "free": pin.JointModelFreeFlyer,
}
SHARES = (0.19, 0.19, 0.15, 0.08, 0.16, 0.05, 0.05, 0.08, 0.05)
BASES = (pin.JointModelFreeFlyer, pin.JointModelPlanar, pin.JointModelSpherical)
CLOSURES = (rg.PointClosure, rg.RevoluteClosure, rg.FrameClosure)
SEEDS = sorted(set(range(48)) - {40})
"""Not one that cannot move."""

RUN = {"duration": 0.02, "step": 2e-3}


@cache
def made(seed: int) -> tuple[rg.Mechanism, np.ndarray]:
    """Up to 21 joints, perhaps on a moving base, up to four closures and a coupling; a velocity."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear[:] = rng.normal(size=3) * rng.choice([0.0, 5.0])

    def link(parent: int, joint: pin.JointModel, name: str) -> int:
        added = int(model.addJoint(parent, joint, anywhere(rng), name))
        carry(model, added, rng)
        return added

    root = link(0, rng.choice(BASES)(), "base") if rng.random() < 0.5 else 0
    for i in range(rng.integers(6, 22)):
        way = [j for j in reversed(list(model.supports[model.njoints - 1])) if j >= root]
        kind = str(rng.choice(list(JOINTS), p=SHARES))
        link(way[min(int(rng.geometric(0.6)) - 1, len(way) - 1)], JOINTS[kind](), f"{kind}{i}")
    model.armature = np.where(rng.random(model.nv) < 0.2, rng.uniform(0.0, 1.0, model.nv), 0.0)
    q, data = pin.integrate(model, pin.neutral(model), 0.7 * rng.normal(size=model.nv)), model.createData()
    pin.forwardKinematics(model, data, q)
    closures: list[rg.Closure] = []
    for c in range(rng.integers(1, 5)):
        there = anywhere(rng)
        for side, joint in zip(
            "ab", rng.choice(np.arange(root, model.njoints), 2, replace=False), strict=True
        ):
            place = data.oMi[int(joint)].actInv(there)
            model.addFrame(pin.Frame(f"{side}{c}", int(joint), place, pin.FrameType.OP_FRAME))
        closures.append(rng.choice(CLOSURES, p=(0.6, 0.3, 0.1))(f"a{c}", f"b{c}"))
    hinges = [j for j in range(1, model.njoints) if model.joints[j].nq == 1]
    if len(hinges) > 1 and rng.random() < 0.3:
        one, other = (int(j) for j in rng.choice(hinges, 2, replace=False))
        ratio = float(rng.normal())
        offset = q[model.joints[one].idx_q] - ratio * q[model.joints[other].idx_q]
        closures.append(rg.CouplingClosure(model.names[one], model.names[other], ratio, float(offset)))
    mechanism = rg.Mechanism.from_pinocchio(model, closures, "auto", home=q)
    v = mechanism.lift(mechanism.home, rng.normal(size=mechanism.m))
    return mechanism, v / np.abs(v).max()


@pytest.mark.parametrize("seed", some(SEEDS, 16))
def test_both_backends_move_alike(seed: int) -> None:
    mechanism, v0 = made(seed)
    python, native = (
        rg.simulate(mechanism, v0=v0, **RUN, backend=backend) for backend in ("python", "native")
    )
    assert np.abs(native.v - python.v).max() < 1e-11 * max(1.0, np.abs(python.v).max())
    for one, other in zip(native.q, python.q, strict=True):
        assert np.abs(mechanism.tree.difference(one, other)).max() < 1e-12
    assert native.stats.native_steps == len(native.t) - 1 or native.stats.zone_evaluations > 0


@pytest.mark.parametrize("seed", some(SEEDS, 16))
def test_derivatives_as_by_the_reference(seed: int) -> None:
    mechanism, v = made(seed)
    tau = np.random.default_rng(seed).normal(size=mechanism.nv)
    kernel = derivation(mechanism, mechanism.home)
    assert kernel is not None
    found = kernel.slopes(mechanism.home[None], v[None], tau[None])
    exact = reference.derivatives(mechanism, mechanism.home, v, tau)
    if not found.good.all():
        pytest.skip("near a singular configuration, which is the reference's")
    same(found.of_state(0), exact, 1e-9)


@pytest.mark.parametrize("seed", some(SEEDS, 16))
def test_what_was_saved_goes_on_to_the_last_bit(seed: int) -> None:
    mechanism, v0 = made(seed)
    sim = rg.Simulation(mechanism, v0=v0, step=RUN["step"])
    run = rg.simulate(mechanism, v0=v0, **RUN)
    for first in (0, 4):
        sim.reset(v0=v0)
        for _ in range(first):
            sim.step()
        saved = sim.save()
        for _ in range(2):
            for i in range(first + 1, first + 6):
                sim.step()
                np.testing.assert_array_equal(sim.q, run.q[i])
            sim.restore(saved)


def test_what_is_rare_is_among_them() -> None:
    """So that the seeds above say something."""
    cases = [made(seed)[0] for seed in SEEDS]
    clusters = [c for mechanism in cases for c in mechanism.clusters]
    assert sum(len(c.independent) >= 5 for c in clusters) >= 10
    assert sum(not c.independent and len(c.joints) == 1 for c in clusters) >= 2, "a joint that cannot move"
    assert sum(len(c.joints) == 1 and len(c.independent) > 0 for c in clusters) >= 2, (
        "a joint tied to its carrier"
    )
    assert sum(len(mechanism.clusters) > 1 for mechanism in cases) >= 8
