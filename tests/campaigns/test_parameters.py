"""Random loops in space: accelerations and steps by placements, masses and centres against differences.

The differences are those of other mechanisms, of order 10, their step quartered until rounding shows; what
two steps in a row agree on is the truth, and how far they are apart what it is worth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.mechanism.building.variable_geometry import DIRECTIONS, MARK, frames_used

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


class Truth:
    """The derivative at 0 of some arrays in one, and how far each may be off."""

    def __init__(self, value: Callable[[float], list[Array]]) -> None:
        self.here = value(0.0)
        size = [float(np.abs(part).max()) for part in self.here]
        self.found, self.apart = [np.zeros_like(part) for part in self.here], [np.inf] * len(size)
        before: list[Array] | None = None
        for h in 4e-2 * 0.25 ** np.arange(8):
            try:
                ends = [(value(k * h), value(-k * h)) for k in range(1, len(TENTH) + 1)]
            except rg.RobustGcpError:  # the loops do not close so far away
                continue
            slopes = [
                sum(w * (b[i] - a[i]) for w, (b, a) in zip(TENTH, ends, strict=True)) / h
                for i in range(len(size))
            ]
            if before is not None:
                rounding = [ROUNDING * part / h for part in size]  # of the values, in differences
                errors = [float(np.abs(s - b).max()) for s, b in zip(slopes, before, strict=True)]
                errors = list(map(max, errors, rounding))
                grown = [error >= apart for error, apart in zip(errors, self.apart, strict=True)]
                for i in np.flatnonzero(~np.array(grown)).tolist():
                    self.found[i], self.apart[i] = before[i], errors[i]
                if all(grown):  # by rounding, from here on
                    break
            before = slopes


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

        def value(s: float, name: str = name) -> list[Array]:
            of = other(mech, name, s)
            there = of.assemble(q, hold=mech.independent)
            state = there, of.lift(there, v[own]), tau
            return [rg.forward_dynamics(of, *state), rg.step(of, *state, STEP).v[own]]

        told = Truth(value)
        for got, exact, apart, here in zip((by, after), told.found, told.apart, told.here, strict=True):
            size = max(float(np.abs(exact).max()), 1e-3 * float(np.abs(here).max()))
            error = float(np.abs(got - exact).max()) / size
            if apart / size > 1e-7:
                found.append("uncertain")
            elif error < max(RIGHT, 10.0 * apart / size):
                found.append("right")
            else:
                found.append(f"wrong: {seed} {name} {error:.1e}")
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
    told = [verdict for seed in (3, 8, 11, 101) for verdict in verdicts(seed)]
    assert told.count("right") > 10
    assert not [verdict for verdict in told if verdict.startswith("wrong")]
