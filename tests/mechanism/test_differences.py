"""Differences: exact where the formula is, and of the order it has elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from robust_gcp.mechanism.differences import CENTRAL, FORWARD, differences


@pytest.mark.parametrize("central", (False, True))
def test_linear_functions_have_their_matrix(central: bool) -> None:
    """Truncation is nil: what is left is rounding over the step, ε |f| / step."""
    M = np.array([[1.0, -2.0, 0.5], [3.0, 0.0, 7.0]])
    found = differences(lambda x: M @ x, np.array([1.0, 2.0, -3.0]), np.ones(3), central)
    np.testing.assert_allclose(found, M, atol=50 * 2.2e-16 / (CENTRAL if central else FORWARD))


def test_central_differences_are_exact_for_quadratics() -> None:
    """With a step of 1/10 a quadratic's slope comes out to rounding; forward it errs by step · ½ f''."""
    scale = np.array([0.1 / CENTRAL])
    x = np.array([2.0])
    assert differences(lambda x: x**2, x, scale, central=True)[0, 0] == pytest.approx(4.0, rel=1e-13)
    forward = differences(lambda x: x**2, x, scale)[0, 0]
    assert forward - 4.0 == pytest.approx(scale[0] * FORWARD, rel=1e-4)


def test_errors_at_the_default_steps() -> None:
    """ε^½ forward and ε^⅔ central, for a function that bends over 1."""
    x = np.array([0.7])
    for central, allowed in ((False, 2e-8), (True, 1e-10)):
        assert abs(differences(np.sin, x, np.ones(1), central)[0, 0] - np.cos(0.7)) < allowed


def test_the_value_at_hand_saves_an_evaluation_and_the_argument_stays() -> None:
    calls = []

    def f(x: np.ndarray) -> np.ndarray:
        calls.append(x)
        return 3.0 * x

    x = np.array([1.0, 2.0])
    differences(f, x, np.ones(2), base=3.0 * x)
    assert len(calls) == 2
    np.testing.assert_array_equal(x, [1.0, 2.0])
