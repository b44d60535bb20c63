"""Hermite interpolation: exact on polynomials, its data reproduced, the same polynomial as SciPy's."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import KroghInterpolator

from robust_gcp.maps.cluster.interpolation import NewtonForm

NODES = np.array([-1.0, -0.7, -0.45, 0.45, 0.7, 1.0])


def data_of(functions: list[Polynomial], d: int, nodes: np.ndarray = NODES) -> np.ndarray:
    """f, f', … of each function at the nodes, (n, d, r)."""
    return np.array([[[f.deriv(k)(x) for f in functions] for k in range(d)] for x in nodes])


@pytest.mark.parametrize("d", (1, 2, 3))
def test_polynomials_of_its_degree_are_reproduced_with_two_derivatives(d: int) -> None:
    rng = np.random.default_rng(d)
    functions = [Polynomial(rng.uniform(-1, 1, d * len(NODES))) for _ in range(4)]
    form = NewtonForm(NODES, data_of(functions, d))
    x = np.linspace(-1.0, 1.0, 23)
    found = form(x)
    for k in range(3):
        exact = np.array([f.deriv(k)(x) for f in functions]).T
        np.testing.assert_allclose(found[k], exact, atol=1e-12 * np.abs(exact).max())


def test_it_is_the_polynomial_of_scipy() -> None:
    rng = np.random.default_rng(0)
    data = rng.uniform(-1, 1, (len(NODES), 3, 2))
    x = np.linspace(-0.45, 0.45, 9)
    krogh = KroghInterpolator(np.repeat(NODES, 3), data.reshape(-1, 2)).derivatives(x, 3)
    for ours, theirs in zip(NewtonForm(NODES, data)(x), krogh, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-11 * np.abs(theirs).max())


def test_the_error_of_a_smooth_function_falls_with_the_power_of_its_data() -> None:
    """γ'' of order 3n − 2 in the width of the nodes."""

    def error(width: float) -> float:
        nodes = width * NODES
        data = np.array([[[np.sin(x)], [np.cos(x)], [-np.sin(x)]] for x in nodes[1:5]])
        bend = NewtonForm(nodes[1:5], data)(np.zeros(1) + 0.1 * width)[2]
        return abs(float(bend[0, 0]) + np.sin(0.1 * width))

    assert np.log2(error(2.0) / error(1.0)) == pytest.approx(11.0, abs=1.0)
