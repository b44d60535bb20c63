"""The log of crossings tells of singular places alone, and the same in every description."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.families import planar_linkage
from robust_gcp.examples.six_bars import joined_by_dyad
from robust_gcp.examples.spatial import sarrus
from robust_gcp.maps.explicit import Crossing
from robust_gcp.simulation.runs.crossings import AT_ONCE, together

Array = NDArray[np.float64]

BACKENDS = ("python", "native")

TREES = ((("C", "D"), "O"), (("B", "A2"), "A3"), (("A", "D"), "O"))
"""Joints cut, and the independent one."""

ONE, TWO = (1.0, 2.0), (0.7, 1.6)
"""Short and long sides of the two antiparallelograms, m."""


def need(backend: str) -> None:
    if not rg.backends()[backend].available:  # type: ignore[index]
        pytest.skip("no compiled kernel")


def opposite(sides: tuple[float, float], angle: float) -> float:
    """Of the crank of an antiparallelogram: the other one's angle, tan(x/2) = k tan(angle/2), unwrapped."""
    k = (sides[1] + sides[0]) / (sides[1] - sides[0])
    turned = (k - 1.0) * np.sin(angle) / ((k + 1.0) - (k - 1.0) * np.cos(angle))
    return float(angle + 2.0 * np.arctan(turned))


def chain_of_two(crank: float, apart: float, cuts: tuple[str, ...], independent: str) -> rg.Mechanism:
    """Two antiparallelograms, the second on the ground and on the first one's rocker, at home at this angle.

    The second lies flat where the rocker has turned by `apart` beyond the place where the first does.
    """
    (a, b), (a2, b2) = ONE, TWO
    rocker = -opposite(ONE, crank)
    arm = rocker + apart  # from A to A3
    other = -opposite(TWO, -arm)

    def way(angle: float) -> Array:
        return np.array([np.cos(angle), np.sin(angle)])

    A = np.array([b, 0.0])
    points = {
        "O": np.zeros(2),
        "A": A,
        "A2": A + [a2, 0.0],
        "B": a * way(crank),
        "C": A + a * way(rocker),
        "A3": A + b2 * way(arm),
        "D": A + b2 * way(arm) + a2 * way(arm + other),
    }
    assert np.linalg.norm(points["C"] - points["B"]) == pytest.approx(b, rel=1e-12)
    assert np.linalg.norm(points["D"] - points["A2"]) == pytest.approx(b2, rel=1e-12)
    links = {
        "ground": ("O", "A", "A2"),
        "crank": ("O", "B"),
        "coupler": ("B", "C"),
        "rocker": ("C", "A", "A3"),
        "rod1": ("A2", "D"),
        "rod2": ("A3", "D"),
    }
    joints = [
        ("O", "ground", "crank"),
        ("B", "crank", "coupler"),
        ("C", "coupler", "rocker"),
        ("A", "ground", "rocker"),
        ("A2", "ground", "rod1"),
        ("A3", "rocker", "rod2"),
        ("D", "rod1", "rod2"),
    ]
    return planar_linkage({k: tuple(p) for k, p in points.items()}, links, joints, [independent], cuts)


def velocity(chain: rg.Mechanism, speed: float, crank: float) -> Array:
    """v at home, at this crank angle, for the crank's speed; by the first rocker where the crank is cut."""
    if "O" in chain.joint_names:
        return chain.with_independent(["O"]).lift(chain.home, [speed])
    k, half = (ONE[1] + ONE[0]) / (ONE[1] - ONE[0]), np.tan(0.5 * crank)
    rocker = -speed * k * (1.0 + half**2) / (1.0 + (k * half) ** 2)
    return chain.with_independent(["A"]).lift(chain.home, [rocker])


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_passed_beside_is_no_crossing(backend: Any) -> None:
    """Sarrus' linkage folded on its base: two pendula, m = 2, which another mode meets in one point.

    There K loses rank, and nowhere beside it, though the rows that determine the dependent joints do.
    """
    need(backend)
    folded = sarrus(height=0.0).with_independent(["hinge1", "hinge4"])
    v0 = np.array([2.0, 0.0, -2.0, -2.0, 0.0])
    for beside in (1e-3,) if backend == "python" else (0.0, 1e-6, 1e-3, 1e-2):
        q0 = np.array([-0.05, 0.0, 0.05, 0.05 + beside, 0.0])
        run = rg.simulate(folded, q0, v0, duration=0.028, step=4e-3, backend=backend)
        assert run.q[-1, 3] < 0.0 < run.q[-1, 0]  # both have passed
        assert len(run.crossings) == int(beside == 0.0)
        for crossing in run.crossings:
            assert np.linalg.svd(folded.K(crossing.q), compute_uv=False)[2] < 1e-12
            assert crossing.kind == "transversal"


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-8, 1e-5, 1e-2])
def test_the_log_is_the_same_for_every_tree(apart: float) -> None:
    """Two loops of one cluster that are flat nearly at once: one crossing of corank 2, or two of one."""
    runs = []
    for backend in BACKENDS:
        for cuts, independent in TREES:
            dear = backend == "python" and (cuts[0] != "C" or apart != 1e-8)
            if dear or not rg.backends()[backend].available:
                continue
            chain = chain_of_two(0.3, apart, cuts, independent)
            v0 = velocity(chain, -4.0, 0.3)
            runs.append(rg.simulate(chain, v0=v0, duration=0.25, step=1e-3, backend=backend))
    if not runs:
        pytest.skip("without the kernel one distance is enough")
    first = runs[0].crossings
    assert [c.corank for c in first] == ([2] if apart < 5e-9 else [1, 1])
    for run in runs[1:]:
        assert [(c.kind, c.corank) for c in run.crossings] == [(c.kind, c.corank) for c in first]
        assert [c.time for c in run.crossings] == pytest.approx([c.time for c in first], abs=1e-9)


@pytest.mark.parametrize("beside", [1e-4, 3e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("tree", TREES)
def test_starts_beside_a_crossing_of_two_loops(beside: float, tree: tuple[tuple[str, ...], str]) -> None:
    """K loses rank ten times nearer off the mode than along it: nodes are reached all the same."""
    chain = chain_of_two(np.pi + beside, 0.0, *tree)
    run = rg.simulate(chain, v0=velocity(chain, -2.0, np.pi + beside), duration=0.05, step=1e-3)
    assert np.abs(run.energy_error()).max() < 1e-9
    assert run.stats.refined_steps == 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_start_at_a_singular_place_of_several_coordinates(backend: Any) -> None:
    """On the line through it; what is there at the start is no crossing."""
    need(backend)
    mechanism = joined_by_dyad((np.pi, 2.65))
    for mode in rg.analyse(mechanism, mechanism.home).modes:
        rates = mode[mechanism.iv_independent]
        if abs(np.linalg.det(rates)) < 1e-3:
            continue
        v0 = mode @ np.linalg.solve(rates, [1.3, -0.8])
        at = rg.forward_dynamics(mechanism, mechanism.home, v0, mode=mode)
        run = rg.simulate(mechanism, mechanism.home, v0, 0.02, 1e-3, mode=mode, backend=backend)
        assert run.crossings == []
        assert run.stats.refined_steps == 0
        assert np.abs(run.energy_error()).max() < 1e-9
        beside = rg.forward_dynamics(mechanism, run.q[1], run.v[1])
        assert beside == pytest.approx(at, rel=2e-2, abs=1e-1)
        break
    else:
        raise AssertionError("no mode is parametrised by the cranks")


def crossing(time: float, cluster: int | None = 0, **more: Any) -> Crossing:
    kind = more.pop("kind", "transversal")
    return Crossing(time, np.zeros(1), np.zeros(3), kind, 1e-15, 0.1, cluster, **more)


def test_what_a_cluster_passes_at_once_is_one() -> None:
    near, far = 0.5 * AT_ONCE, 3.0 * AT_ONCE
    one = together([crossing(1.0), crossing(1.0 + near, corank=2), crossing(1.0 + far)])
    assert [(c.time, c.corank) for c in one] == [(1.0, 3), (1.0 + far, 1)]
    assert len(together([crossing(1.0), crossing(1.0, 1), crossing(1.0)])) == 2
    assert len(together([crossing(1.0, None), crossing(1.0, None)])) == 2
    (gap,) = together([crossing(1.0), crossing(1.0, kind="near miss")])
    assert gap.kind == "near miss"
