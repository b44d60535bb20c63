"""What is of the loops alone is worked out once, whatever coordinates a mechanism is seen in."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.legged import legged
from robust_gcp.mechanism.coordinates.groups import groups_of


def anew(mech: rg.Mechanism, names: tuple[str, ...]) -> rg.Mechanism:
    """The same in these coordinates with nothing in common."""
    return rg.Mechanism(mech.own_model, mech.closures, names, mech.home, mech.name, mech.forces)


@pytest.fixture(params=["walker", "five_bar", "legs"])
def pair(request: pytest.FixtureRequest) -> tuple[rg.Mechanism, tuple[str, ...]]:
    """A mechanism, and other coordinates of it."""
    mech = legged(3, floating=True) if request.param == "legs" else rg.load(request.param)
    free = [joint.name for joint in mech.group_joints]
    groups = groups_of(mech)
    base = mech if groups is None else groups.rest
    found = base.coordinate_choices(mech.home[-base.nq :])
    other = next(names for _, names in found if set(names) != set(base.independent))
    return mech, (*free, *other)


def test_other_coordinates_have_the_loops_in_common(pair: tuple[rg.Mechanism, tuple[str, ...]]) -> None:
    mech, names = pair
    other = mech.with_independent(names)
    third = other.with_independent(mech.independent)
    for one in (other, third):
        assert one.tree is mech.tree and one.implicit is mech.implicit
        assert all(a.loops is b.loops for a, b in zip(one.clusters, mech.clusters, strict=True))
    assert other.clusters is not mech.clusters and other.memo is not mech.memo
    plain = anew(mech, names)
    for name in ("column_scale", "row_scale", "units", "iv_dependent", "iq_numbers"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name))
    assert pickle.loads(pickle.dumps(other)).independent == other.independent


@pytest.mark.parametrize("backend", ["python", "native"])
def test_their_motions_are_those_of_mechanisms_built_anew(
    pair: tuple[rg.Mechanism, tuple[str, ...]], backend: str
) -> None:
    """To the last bit, also where runs in both coordinates take turns on one thread."""
    if not rg.backends()[backend].available:
        pytest.skip("no compiled kernel")
    mech, names = pair
    v = mech.lift(mech.home, np.random.default_rng(3).normal(size=mech.m))
    given = {"step": 1e-3, "backend": backend}
    both = [rg.Simulation(one, mech.home, v, **given) for one in (mech, mech.with_independent(names))]
    alone = [rg.Simulation(anew(mech, n), mech.home, v, **given) for n in (mech.independent, names)]
    for _ in range(20):
        for simulation in both:
            simulation.step()
    for simulation, plain in zip(both, alone, strict=True):
        plain.step(n=20)
        np.testing.assert_array_equal(simulation.q, plain.q)
        np.testing.assert_array_equal(simulation.v, plain.v)


def test_threads_may_see_it_in_different_coordinates(pair: tuple[rg.Mechanism, tuple[str, ...]]) -> None:
    mech, names = pair
    v = mech.lift(mech.home, np.random.default_rng(3).normal(size=mech.m))

    def end(chosen: tuple[str, ...]) -> np.ndarray:
        return rg.simulate(mech.with_independent(chosen), mech.home, v, 0.05, 1e-3, backend="python").q[-1]

    wanted = [end(chosen) for chosen in (mech.independent, names)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(end, (mech.independent, names) * 4))
    for i, q in enumerate(found):
        np.testing.assert_array_equal(q, wanted[i % 2])
