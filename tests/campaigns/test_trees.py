"""Random trees of change-point four-bars against the closed forms of their loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.maps.closed_form import FourBar

from .conftest import Block
from .loops_in_closed_form import Loop, LoopsInClosedForm
from .random_cases import ROUNDING, bad, figures
from .trees import drawn, measured

SEED, COUNT = 20, 100

two = cache(lambda: drawn(7, 2))


@pytest.mark.campaign
def test_trees_keep_to_the_steps_on_their_closed_forms(
    block: Block, record_property: Callable[..., None]
) -> None:
    trees = [measured(*drawn(block.seed, index)) for index in block.indices]
    sizes = [len(tree.lengths) for tree in trees]
    more = {f"of {n} loops": sizes.count(n) for n in range(2, 6)} | {
        "in changed coordinates": sum(tree.changes > 0 for tree in trees),
        "with steps under error control": sum(tree.refined > 0 for tree in trees),
        "silently wrong": sum(tree.silently_wrong for tree in trees),
    }
    record_property(f"trees, seed {block.seed}", figures(trees) | more)
    assert not bad(trees)


def test_some_trees_keep_to_the_steps_on_their_closed_forms() -> None:
    trees = [measured(*two()), measured(*drawn(7, 1))]
    assert not bad(trees)
    assert sum(sum(tree.crossings) for tree in trees) > 3


def test_closed_forms_serve_in_any_joint() -> None:
    """G and g of the product of loops in couplers and rockers, against those of the mechanism itself."""
    tree, equations, exact = two()
    mechanism, m = equations.mechanism, equations.m
    here = equations.explicit.point_at(exact[3][:m], exact[3][m:])
    v = here.G @ here.ydot
    names = [("coupler", "rocker")[i % 2] + str(i) for i in range(m)]
    other = mechanism.with_independent(names)
    explicit = LoopsInClosedForm(equations.explicit.path, here, tree.lengths, other)
    point = explicit.point_at(here.q[other.iq_independent], v[other.iv_independent])
    np.testing.assert_allclose(point.q, here.q, atol=1e-12)
    np.testing.assert_allclose(point.G, other.G(here.q), atol=1e-9)
    np.testing.assert_allclose(point.g, other.g(here.q, v), atol=1e-9 * (1.0 + np.abs(point.g).max()))


def test_the_oracle_takes_steps_under_error_control_and_in_changed_coordinates_too() -> None:
    """Three changes, 24 steps with error control: the runs differ by rounding, not by a stepper's error."""
    tree = measured(*drawn(8, 19))
    assert tree.changes > 1 and tree.refined > 5
    assert tree.floor > 1e-9
    assert abs(tree.ratio - 1.0) < 1e-3


@pytest.mark.parametrize(("part", "back"), [(0, 0.1), (1, 0.1), (2, 2.8)])
def test_a_loop_in_closed_form_by_any_joint(part: int, back: float) -> None:
    """Closed, with the derivatives of differences, also where other joints turn back."""
    l0, l1, l2, l3 = lengths = (1.8, 2.75, 1.525, 0.575)
    q = np.array(FourBar(*lengths, 1).evaluate(-0.3)[0])
    loop = Loop(lengths, part, q)
    np.testing.assert_allclose(loop.evaluate(q[part])[0], q, atol=1e-13)
    for y in np.linspace(q[part] - back, q[part] + 0.1, 7):
        (a, b, c), rate, second = loop.evaluate(y)
        gap = l1 * np.exp(1j * a) + l2 * np.exp(1j * (a + b)) - l0 - l3 * np.exp(1j * c)
        assert abs(gap) < 1e-14
        (before, slow, _), (after, fast, _) = loop.evaluate(y - 1e-4), loop.evaluate(y + 1e-4)
        np.testing.assert_allclose((after - before) / 2e-4, rate, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose((fast - slow) / 2e-4, second, rtol=1e-5, atol=1e-6)


def test_a_tree_that_is_wrong_is_seen() -> None:
    tree = measured(*two())
    assert tree.good
    assert replace(tree, error=1.2 * max(tree.floor, ROUNDING)).silently_wrong
    assert replace(tree, crossings=(2, *tree.crossings[1:])).silently_wrong
    told = replace(tree, crossings=(), told="a coarse step")
    assert not told.good and not told.silently_wrong


def test_the_first_state_is_the_drawn_one() -> None:
    tree, equations, exact = two()
    problem = initial_value_problem(
        equations.mechanism, v0=equations.mechanism.lift(equations.mechanism.home, tree.speeds)
    )
    np.testing.assert_array_equal(exact[0], problem.x)
