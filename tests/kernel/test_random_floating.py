"""Random linkages on random joints on groups, through zones: both backends and scipy's solvers move alike."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.four_bar import FourBar

from ..compiled import needs_kernel, some
from .random_links import anywhere, carry

pytestmark = needs_kernel

JOINTS = {
    "free": pin.JointModelFreeFlyer,
    "planar": pin.JointModelPlanar,
    "ball": pin.JointModelSpherical,
    "circle": pin.JointModelRUBX,
    "translation": pin.JointModelTranslation,
}
STEPS = 600
RUN = {"duration": 0.6, "step": 0.6 / STEPS}
SEEDS = range(12)


def made(seed: int) -> tuple[rg.Mechanism, np.ndarray]:
    """One or two joints on groups, up to three four-bars that have a flat configuration, perhaps a ball."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear[:] = rng.normal(size=3) * rng.choice([0.0, 5.0])
    names, tips, angles, body = [], [], {}, 0

    for kind in rng.choice(list(JOINTS), size=rng.integers(1, 3)):
        place = anywhere(rng)
        names.append(f"{kind}{len(names)}")
        body = model.addJoint(body, JOINTS[kind](), place, names[-1])
        carry(model, body, rng)
    carriers = [
        body
    ]  # of which the next linkage may stand on any: the last one's rocker and what carries that
    for i in range(rng.integers(1, 4)):
        a, b = rng.uniform(1.0, 3.0, 2)
        lengths = (4.0, 2.0, 3.0, 3.0) if rng.random() < 0.5 else (a, b, a, b)
        on, at = int(rng.choice(carriers)), rng.normal()
        crank = linkages.add_link(model, on, at, f"crank{i}", lengths[1])
        linkages.add_link(model, crank, lengths[1], f"coupler{i}", lengths[2])
        rocker = linkages.add_link(model, on, at + lengths[0], f"rocker{i}", lengths[3])
        q = FourBar(*lengths, 1).evaluate(rng.uniform(2.4, 2.9))[0]
        angles |= dict(zip((f"crank{i}", f"coupler{i}", f"rocker{i}"), q.tolist(), strict=True))
        tips.append(rg.PointClosure(f"coupler{i}_tip", f"rocker{i}_tip"))
        names.append(f"crank{i}")
        carriers = [*carriers[: carriers.index(on) + 1], rocker]
    if rng.random() < 0.4:
        place = pin.SE3(np.eye(3), rng.normal(size=3))
        carry(model, model.addJoint(carriers[-1], pin.JointModelSpherical(), place, "end"), rng)
        names.append("end")
    home = pin.neutral(model)
    for name, angle in angles.items():
        home[model.joints[model.getJointId(name)].idx_q] = angle
    mechanism = rg.Mechanism(model, tips, names, home=home)
    mechanism.home = mechanism.assemble(home)
    rates = rng.choice([-1.0, 1.0], mechanism.m) * rng.uniform(0.5, 3.0, mechanism.m)
    return mechanism, mechanism.lift(mechanism.home, rates)


@pytest.mark.parametrize("seed", some(SEEDS, 4))
def test_both_backends_and_solvers_agree(seed: int) -> None:
    mechanism, v0 = made(seed)
    python, native = (
        rg.simulate(mechanism, v0=v0, **RUN, backend=backend) for backend in ("python", "native")
    )
    # where closures are redundant Python looks once a zone whether other rows of K serve
    assert native.stats.native_steps >= STEPS - 3
    for here, there in ((native.q, python.q), (native.v, python.v)):
        assert (np.abs(here - there) / np.maximum(np.abs(there).max(axis=0), 1.0)).max() < 1e-10
    for here, there in zip(native.crossings, python.crossings, strict=True):
        assert here.time == pytest.approx(there.time, abs=1e-10)
        np.testing.assert_allclose(here.q, there.q, atol=1e-9)
    for stepper in ("DOP853", "BDF"):
        other = rg.simulate(mechanism, v0=v0, duration=0.6, step=0.1, stepper=stepper, rtol=1e-8, atol=1e-10)
        assert np.abs(other.q - native.q[::100]).max() < 1e-5
        assert [c.cluster for c in other.crossings] == [c.cluster for c in native.crossings]


@pytest.mark.parametrize("seed", (0, 1, 2, 4))
def test_what_was_saved_goes_on_to_the_last_bit(seed: int) -> None:
    """In zones of redundant rows too, where Python looks for better ones once."""
    mechanism, v0 = made(seed)
    run = rg.simulate(mechanism, v0=v0, **RUN)
    sim = rg.Simulation(mechanism, v0=v0, step=RUN["step"])
    for first in range(0, STEPS - 60, 60):
        saved = sim.save()
        for _ in range(2):
            sim.restore(saved)
            np.testing.assert_array_equal(sim.step(n=80).q, run.q[first + 80])
        sim.restore(saved).step(n=60)


def test_zones_are_passed() -> None:
    """So that the seeds above say something."""
    runs = [rg.simulate(mechanism, v0=v0, **RUN) for mechanism, v0 in map(made, SEEDS)]
    assert sum(len(run.crossings) for run in runs) >= 8
    assert sum(run.stats.zone_evaluations > 0 for run in runs) >= 6
