"""Loops with balls some of whose velocities are coordinates: both backends and scipy's solvers move alike."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

from ..compiled import needs_kernel
from ..simulation.test_idle_spins import COMPONENTS, rssr, spinning
from .random_links import anywhere, carry

pytestmark = needs_kernel

JOINTS = {
    "hinge": pin.JointModelRZ,
    "slide": pin.JointModelPX,
    "ball": pin.JointModelSpherical,
    "planar": pin.JointModelPlanar,
    "free": pin.JointModelFreeFlyer,
    "translation": pin.JointModelTranslation,
    "circle": pin.JointModelRUBZ,
}
STEPS = 200
RUN = {"duration": 0.2, "step": 1e-3}


def apart(mech: rg.Mechanism, one: rg.Trajectory, other: rg.Trajectory) -> float:
    assert len(one.q) == len(other.q)
    rows = zip(one.q, other.q, strict=True)
    return max(float(np.abs(mech.tree.difference(a, b)).max()) for a, b in rows)


def made(seed: int) -> tuple[rg.Mechanism, np.ndarray]:
    """Two random chains that are joined at their ends, perhaps on a floating base, and a motion of theirs."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear[:] = rng.normal(size=3) * rng.choice([0.0, 5.0])

    def link(parent: int, kind: str) -> int:
        joint = int(model.addJoint(parent, JOINTS[kind](), anywhere(rng), f"{kind}{model.njoints}"))
        carry(model, joint, rng)
        return joint

    root = link(0, "free") if rng.random() < 0.3 else 0
    kinds = list(JOINTS)
    first, second = (["ball", *rng.choice(kinds, size=rng.integers(1, 3))] for _ in range(2))
    rng.shuffle(first)
    ends = [root, root]
    for side, chain in enumerate((first, second[1:])):
        for kind in chain:
            ends[side] = link(ends[side], str(kind))
    q = pin.integrate(model, pin.neutral(model), 0.7 * rng.normal(size=model.nv))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    meeting = anywhere(rng)
    for side, joint in enumerate(ends):
        place = data.oMi[joint].inverse() * meeting
        model.addFrame(pin.Frame(f"tip{side}", joint, place, pin.FrameType.OP_FRAME))
    closure = (rg.PointClosure if rng.random() < 0.7 else rg.FrameClosure)("tip0", "tip1")
    mech = rg.Mechanism.from_pinocchio(model, [closure], "auto", home=q)
    return mech, mech.lift(mech.home, rng.normal(size=mech.m))


@pytest.mark.parametrize("floating", (False, True))
@pytest.mark.parametrize("component", COMPONENTS)
def test_idle_spins(component: str, floating: bool) -> None:
    mech = rssr(*(("base",) if floating else ()), "crank", component, floating=floating)
    v = spinning(mech, [0.0] * 6 * floating + [2.0, 0.0], 5.0)
    python, kernel = (rg.simulate(mech, mech.home, v, **RUN, backend=b) for b in ("python", "native"))
    assert kernel.stats.native_steps == STEPS
    assert apart(mech, python, kernel) < 1e-12
    for stepper, rtol in (("DOP853", 1e-9), ("Radau", 1e-7)):
        choice = {"stepper": stepper, "rtol": rtol, "atol": rtol}
        two = [rg.simulate(mech, mech.home, v, 0.3, 0.1, backend=b, **choice) for b in ("python", "native")]
        assert apart(mech, *two) < 1e-11
        assert two[1].stats.rhs == two[0].stats.rhs
        assert two[1].stats.marching_steps == two[0].stats.marching_steps == 0


@pytest.mark.parametrize("seed", range(14))
def test_random_loops(seed: int) -> None:
    mech, v = made(seed)
    python, kernel = (rg.simulate(mech, mech.home, v, **RUN, backend=b) for b in ("python", "auto"))
    assert kernel.stats.native_steps > 0.8 * STEPS
    assert apart(mech, python, kernel) < 1e-12
    exact = rg.simulate(mech, mech.home, v, 0.2, 0.1, stepper="DOP853", rtol=1e-11, atol=1e-11)
    assert np.abs(mech.tree.difference(exact.q[-1], kernel.q[-1])).max() < 1e-5
    assert kernel.closure_error().max() < 1e-12
