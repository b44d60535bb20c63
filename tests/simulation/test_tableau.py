"""Explicit methods by their tableau: order conditions, and observed orders across a singular place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.simulation.runs.steppers import rk4_step

MIDPOINT = rg.Tableau(((0.5,),), (0.0, 1.0))
RALSTON = rg.Tableau(((0.5,), (0.0, 0.75)), (2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0))
CLASSICAL = rg.Tableau(((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6))
THREE_EIGHTHS = rg.Tableau(((1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)), (1 / 8, 3 / 8, 3 / 8, 1 / 8))

ORDERS = [(MIDPOINT, 2), (RALSTON, 3), (CLASSICAL, 4), (THREE_EIGHTHS, 4)]


@pytest.mark.parametrize(("tableau", "order"), ORDERS)
def test_order_conditions(tableau: rg.Tableau, order: int) -> None:
    """Hairer, Nørsett, Wanner, section II.2: one condition for each rooted tree of up to four nodes."""
    s, b, c = len(tableau.b), np.array(tableau.b), np.array(tableau.c)
    a = np.zeros((s, s))
    for i, row in enumerate(tableau.a, start=1):
        a[i, :i] = row
    found = {1: [b.sum() - 1], 2: [b @ c - 1 / 2], 3: [b @ c**2 - 1 / 3, b @ a @ c - 1 / 6]}
    found[4] = [b @ c**3 - 1 / 4, (b * c) @ a @ c - 1 / 8, b @ a @ c**2 - 1 / 12, b @ a @ a @ c - 1 / 24]
    for k in range(1, order + 1):
        np.testing.assert_allclose(found[k], 0.0, atol=1e-15)
    if order < 4:
        assert np.abs(found[order + 1]).max() > 1e-3


@pytest.mark.parametrize(("tableau", "order"), ORDERS)
def test_observed_order_across_crossings(tableau: rg.Tableau, order: int) -> None:
    """Free fall of the change-point linkage through its singular configuration, against DOP853.

    The largest error of all common times; the next order's term may still be seen in the steeper ones.
    """
    mech = rg.load("change_point")
    exact = rg.simulate(mech, duration=2.0, step=0.1, stepper="DOP853", rtol=1e-12, atol=1e-13)
    errors = []
    for step in (4e-3, 2e-3):
        run = rg.simulate(mech, duration=2.0, step=step, stepper=tableau)
        errors.append(np.abs(run.q[:: round(0.1 / step)] - exact.q).max())
    assert len(exact.crossings) == len(run.crossings) > 0
    assert order - 0.1 < np.log2(errors[0] / errors[1]) < order + 0.9


def test_the_classical_tableau_is_rk4() -> None:
    """The same sums in another order: apart by roundings."""
    rng = np.random.default_rng(0)
    A, x = rng.normal(size=(5, 5)), rng.normal(size=5)

    def f(t: float, state: np.ndarray) -> np.ndarray:
        return np.asarray(np.sin(A @ state) + t)

    ours, known = (step(f, 0.3, x, 0.1, f(0.3, x)) for step in (CLASSICAL.step, rk4_step))
    np.testing.assert_allclose(ours, known, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (((0.5,),), (0.5, 0.6), "have the sum 1"),
        (((0.5,),), (1.0,), "need rows a of 1, 2"),
        (((0.5, 0.5),), (0.0, 1.0), "an explicit method"),
        (((float("nan"),),), (0.0, 1.0), "finite"),
        (0.5, (0.0, 1.0), "rows of numbers"),
        ((("half",),), (0.0, 1.0), "rows of numbers"),
    ],
)
def test_what_is_no_tableau(a: Any, b: Any, words: str) -> None:
    with pytest.raises(rg.OptionError, match=words):
        rg.Tableau(a, b)
