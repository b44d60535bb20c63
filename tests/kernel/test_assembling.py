"""Loops closed from guesses: many as one, the kernel as the reference, all assemblies."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.kernel.constraint.assembling import closed, lifted
from robust_gcp.mechanism.assembly import assembly

NAMES = [name for name in rg.model_names() if rg.load(name).closures]


def guesses(mechanism: rg.Mechanism, count: int, spread: float) -> np.ndarray:
    rng = np.random.default_rng(7)
    steps = spread * rng.normal(size=(count, mechanism.nv)) * mechanism.units
    return np.array([mechanism.tree.integrate(mechanism.home, step) for step in steps])


@pytest.mark.parametrize("name", NAMES)
def test_the_kernel_goes_the_way_of_the_reference(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = rg.load(name)
    free = mechanism.iv_dependent
    starts = guesses(mechanism, 40, 0.3)
    found, done = closed(mechanism, starts, free)
    if rg.backends()["native"].available:
        assert done.sum() >= (4 if name == "stewart" else 35)
    monkeypatch.setattr(assembly, "_in_kernel", lambda *_: None)
    for start, q, good in zip(starts[:12], found, done, strict=False):
        try:
            wanted = assembly.assembled(mechanism, start, free, "", (0.0,))
        except rg.ClosureError:
            assert not good
            continue
        if good:
            np.testing.assert_allclose(q, wanted, atol=1e-11)


@pytest.mark.parametrize("name", ["crank_rocker", "delta", "bricard", "walker", "strandbeest"])
def test_many_are_one_by_one(name: str) -> None:
    """And with other joints held."""
    mechanism = rg.load(name)
    many = guesses(mechanism, 25, 0.15)
    for hold in (None, [], list(mechanism.joint_names[:1])):
        one = []
        for guess in many:
            try:
                one.append(mechanism.assemble(guess, hold))
            except rg.ClosureError:
                one.append(np.full(mechanism.nq, np.nan))
        try:
            together = mechanism.assemble(many, hold)
        except rg.ClosureError as error:
            assert error.failed == tuple(np.flatnonzero(np.isnan(one).any(axis=1)))
            assert f"{len(error.failed)} of 25 guesses" in str(error)
            together = error.nearest
        np.testing.assert_array_equal(together, one)
    q = mechanism.assemble(guesses(mechanism, 25, 0.05), [])
    rates = np.random.default_rng(1).normal(size=(25, mechanism.m))
    v = mechanism.lift(q, rates)
    np.testing.assert_allclose(v, [mechanism.lift(a, b) for a, b in zip(q, rates, strict=True)], atol=1e-10)
    np.testing.assert_array_equal(mechanism.lift(q, rates[0])[0], v[0])


def test_velocities_that_are_not_determined_are_refused_by_number() -> None:
    mechanism = rg.load("parallelogram")
    flat = mechanism.assemble([0.0, 0.0, 0.0], ["q1"])
    open_ones = np.array([mechanism.home, flat])
    with pytest.raises(rg.StateError, match=r"q\[1\]: K_d is singular"):
        mechanism.lift(open_ones, [1.0])
    v = np.ones((2, 3))
    status = lifted(mechanism, open_ones, v, mechanism.iv_dependent)
    assert status is None or status.tolist() == [True, False]


def test_guesses_that_are_no_numbers_are_refused() -> None:
    mechanism = rg.load("rhombus")
    with pytest.raises(rg.StateError, match="q_guess has shape"):
        mechanism.assemble(np.zeros((2, 4)))
    with pytest.raises(rg.StateError, match="not finite"):
        mechanism.assemble([[0.1, 0.2, np.nan]])
    assert mechanism.assemble(np.zeros((0, 3))).shape == (0, 3)
    assert mechanism.lift(np.zeros((0, 3)), [1.0]).shape == (0, 3)


def elbows(crank: float, lengths: tuple[float, ...]) -> int:
    """How many rockers there are: intersections of two circles."""
    ground, a, b, c = lengths
    reach = np.hypot(a * np.cos(crank) - ground, a * np.sin(crank))
    return 2 if abs(b - c) < reach < b + c else 0


@pytest.mark.parametrize("crank", np.linspace(0.3, 6.0, 7))
def test_four_bars_have_as_many_assemblies_as_circles_meet(crank: float) -> None:
    lengths = (4.0, 2.0, 3.5, 2.5)
    mechanism = rg.examples.linkages.four_bar(*lengths, y=1.0)
    q = mechanism.home.copy()
    q[mechanism.joint("q1").idx_q] = crank
    found = mechanism.assemblies(q, ["q1"])
    assert found.complete
    assert len(found) == elbows(crank, lengths)
    for one in found.q:
        assert mechanism.closure_residual(one) < 1e-12
        assert one[mechanism.joint("q1").idx_q] == crank
        assert np.abs(one - q).max() <= np.pi + 1e-9


def test_assemblies_of_apart_loops_are_combined_and_reproducible() -> None:
    walker, beast = rg.load("walker"), rg.load("strandbeest")
    assert [len(m.assemblies()) for m in (walker, beast)] == [4, 8]  # 2 · 2 legs; 2³ dyads
    np.testing.assert_array_equal(beast.assemblies().q, beast.assemblies().q)
    near = beast.assemblies().q[0]
    np.testing.assert_allclose(near, beast.home, atol=1e-9)  # the nearest first
    assert beast.assemblies().inside.all()


def test_what_still_moves_has_no_end_of_assemblies() -> None:
    with pytest.raises(rg.OptionError, match=r"still move, .* hold more of q1, q2, q3, q4"):
        rg.load("five_bar").assemblies(hold=[])


def test_no_assembly_is_no_proof_that_there_is_none() -> None:
    mechanism = rg.load("slider_crank")
    far = rg.examples.linkages.four_bar(4.0, 2.0, 3.0, 1.5, y=0.1)
    q = far.home.copy()
    q[far.joint("q1").idx_q] = np.pi  # 6 m to reach with 4.5
    found = far.assemblies(q, ["q1"])
    assert (len(found), found.complete) == (0, False)
    assert len(mechanism.assemblies()) == 2
