"""Random loops in space: accelerations and steps by placements, masses and centres against differences.

The differences are those of other mechanisms, of order 10, their step halved ten times and more; what two
steps in a row agree on is the truth, and how far they are apart what it is worth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.mechanism.varied import DIRECTIONS, MARK, frames_used

from ..dynamics.test_derivatives import TENTH
from ..kernel.test_kernel import random_mechanism
from ..simulation.test_gradient_by_geometry import other
from .conftest import Block

Array = NDArray[np.float64]

SEED, COUNT = 0, 1000

RIGHT = 1e-9
"""Relative to the largest of what the parameter changes."""

ROUNDING = 1e-15
"""Of values that differences are taken of, relative."""

STEP = 1e-3
"""Of the steps of motions, s."""


def drawn(mech: rg.Mechanism, rng: np.random.Generator) -> list[str]:
    """Names of two placements and of two numbers of bodies."""
    joints = [joint.name for joint in mech.joints]
    targets = [*joints, *sorted(set(frames_used(mech)))]
    placements = [f"{rng.choice(targets)}{MARK}{rng.choice(DIRECTIONS)}" for _ in range(2)]
    return list(dict.fromkeys([*placements, f"{rng.choice(joints)}.mass", f"{rng.choice(joints)}.com.y"]))


def truth(value: Callable[[float], Array]) -> tuple[Array, float]:
    """The derivative at 0, and how far it may be off."""
    found, apart, before = np.zeros(1), np.inf, None
    here = float(np.abs(value(0.0)).max())
    for h in 4e-2 * 0.25 ** np.arange(8):
        try:
            slope = sum(w * (value(k * h) - value(-k * h)) for k, w in enumerate(TENTH, 1)) / h
        except rg.RobustGcpError:  # the loops do not close so far away
            continue
        if before is not None:
            rounding = ROUNDING * here / h  # of the values, in a difference of steps h
            error = max(float(np.abs(slope - before).max()), rounding)
            if error < apart:
                found, apart = before, error
        before = slope
    return found, apart


def verdicts(seed: int) -> list[str]:
    """Of each parameter of a random mechanism: right, wrong, refused, or too uncertain to tell."""
    mech = random_mechanism(seed)
    if mech is None or mech.m == 0:
        return []
    rng = np.random.default_rng([seed, 1])
    q, own = mech.home, mech.iv_independent
    try:
        v = mech.lift(q, rng.normal(size=mech.m))
    except rg.StateError:
        return []
    tau, found = rng.normal(size=mech.nv), []
    for name in drawn(mech, rng):
        try:
            by = rg.by_parameters(mech, q, v, tau, [name])[:, 0]
            after = rg.by_parameters(mech, q, v, tau, [name], h=STEP)[mech.m :, 0]
        except (rg.OptionError, rg.SimulationError):
            found.append("refused")
            continue

        def at(s: float, name: str = name) -> tuple[rg.Mechanism, Array, Array]:
            of = other(mech, name, s)
            there = of.assemble(q, hold=mech.independent)
            return of, there, of.lift(there, v[own])

        def later(s: float) -> Array:
            of, *state = at(s)
            return rg.step(of, *state, tau, STEP).v[own]

        for got, value in ((by, lambda s: rg.forward_dynamics(*at(s), tau)), (after, later)):
            exact, apart = truth(value)
            size = max(float(np.abs(exact).max()), 1e-3 * float(np.abs(value(0.0)).max()))
            error = float(np.abs(got - exact).max()) / size
            apart /= size
            if apart > 1e-7:
                found.append("uncertain")
            else:
                found.append(
                    "right" if error < max(RIGHT, 10.0 * apart) else f"wrong: {seed} {name} {error:.1e}"
                )
    return found


@pytest.mark.campaign
def test_of_random_mechanisms(block: Block, record_property: Callable[..., None]) -> None:
    told = [verdict for i in block.indices for verdict in verdicts(1000 * block.seed + i)]
    counts = {
        what: sum(v.startswith(what) for v in told) for what in ("right", "wrong", "refused", "uncertain")
    }
    record_property(f"parameters, seed {block.seed}", counts)
    assert not [verdict for verdict in told if verdict.startswith("wrong")]


@pytest.mark.slow
def test_of_some_random_mechanisms() -> None:
    told = [verdict for seed in (3, 8, 11) for verdict in verdicts(seed)]
    assert told.count("right") > 10
    assert not [verdict for verdict in told if verdict.startswith("wrong")]
