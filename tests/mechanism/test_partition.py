"""The split into independent and dependent joints: blocks, rows, choices, and solving along the blocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.blocks import BlockFactor
from robust_gcp.maps.regular_path import RegularPath
from robust_gcp.mechanism.coordinates.independent import is_determined
from robust_gcp.mechanism.coordinates.partition import (
    MAX_ENUMERATED,
    Block,
    independent_rows,
    numerical_rank,
    ranked_choices,
    spanning,
    triangular_blocks,
)

Array = NDArray[np.float64]
Pattern = NDArray[np.bool_]


def hidden_blocks(sizes: list[int], seed: int, density: float = 0.3) -> Pattern:
    """A block lower triangular pattern with full diagonal blocks, rows and columns then shuffled."""
    rng = np.random.default_rng(seed)
    n = sum(sizes)
    block = np.repeat(np.arange(len(sizes)), sizes)
    pattern = (block[:, None] > block) & (rng.random((n, n)) < density)
    pattern |= block[:, None] == block
    return np.asarray(pattern[rng.permutation(n)][:, rng.permutation(n)])


def assert_block_lower_triangular(pattern: Pattern, blocks: list[Block]) -> None:
    """Every row and column once, square blocks, and no row sees a column of a later block."""
    n = len(pattern)
    assert sorted(np.concatenate([b.rows for b in blocks]).tolist()) == list(range(n))
    assert sorted(np.concatenate([b.columns for b in blocks]).tolist()) == list(range(n))
    known: list[int] = []
    for b in blocks:
        assert len(b.rows) == len(b.columns)
        known += b.columns.tolist()
        later = np.setdiff1d(np.arange(n), known)
        assert not np.any(pattern[np.ix_(b.rows, later)])


SIZES = st.lists(st.integers(1, 4), min_size=1, max_size=7)


@settings(deadline=None, max_examples=60)
@given(sizes=SIZES, seed=st.integers(0, 10**6))
def test_hidden_blocks_are_found_under_any_permutation(sizes: list[int], seed: int) -> None:
    pattern = hidden_blocks(sizes, seed)
    blocks = triangular_blocks(pattern)
    assert blocks is not None
    assert_block_lower_triangular(pattern, blocks)
    assert sorted(len(b.rows) for b in blocks) == sorted(sizes)


@settings(deadline=None, max_examples=60)
@given(sizes=SIZES, seed=st.integers(0, 10**6))
def test_substitution_along_blocks_solves_the_system(sizes: list[int], seed: int) -> None:
    """A⁻¹ B, and each block's determinant; the product of them is det A up to the permutation's sign."""
    rng = np.random.default_rng(seed)
    pattern = hidden_blocks(sizes, seed)
    A = np.where(pattern, rng.uniform(-1, 1, pattern.shape), 0.0)
    blocks = triangular_blocks(pattern)
    assert blocks is not None
    for b in blocks:  # far from singular: what is lost is rounding
        U, s, Vt = np.linalg.svd(A[np.ix_(b.rows, b.columns)])
        A[np.ix_(b.rows, b.columns)] = U @ np.diag(0.5 + s) @ Vt
    B = rng.uniform(-1, 1, (len(A), 3))
    factor = BlockFactor(blocks, pattern, np.arange(len(A)))
    factor.factor(A)
    # backward stable: the residual is rounding of |A| |X|
    for right in (B, B[:, 0]):
        X = factor.solve(right)
        assert np.abs(A @ X - right).max() <= 1e-12 * max(1.0, np.abs(X).max())
    assert abs(np.prod(factor.det)) == pytest.approx(abs(np.linalg.det(A)), rel=1e-9)


def test_conditioning_and_determinant_of_each_block() -> None:
    """σ_min/σ_max up to 2 × 2, LAPACK's estimate above; zero, and no solution, where singular."""
    rng = np.random.default_rng(0)
    sizes = (1, 2, 4)
    blocks, start = [], 0
    for size in sizes:
        index = np.arange(start, start + size)
        blocks.append(Block(index, index))
        start += size
    A = np.zeros((7, 7))
    for b in blocks:
        A[np.ix_(b.rows, b.rows)] = rng.uniform(-1, 1, (len(b.rows), len(b.rows)))
    factor = BlockFactor(blocks, A != 0.0, np.arange(7))
    factor.factor(A)
    for i, b in enumerate(blocks):
        piece = A[np.ix_(b.rows, b.rows)]
        assert factor.det[i] == pytest.approx(np.linalg.det(piece), rel=1e-12)
        s = np.linalg.svd(piece, compute_uv=False)
        if len(piece) == 2:
            assert factor.rcond[i] == pytest.approx(s[-1] / s[0], rel=1e-12)
        elif len(piece) == 4:  # 1/cond₁ is within a factor n of 1/cond₂
            assert s[-1] / s[0] / 4 <= factor.rcond[i] <= 4 * s[-1] / s[0]
    A[1:3, 1:3] = [[1.0, 2.0], [2.0, 4.0]]
    factor.factor(A)
    assert factor.rcond[1] == factor.det[1] == 0.0
    assert not np.all(np.isfinite(factor.solve(np.ones(7))[1:3]))
    A[3:, 3:] = 0.0
    factor.factor(A)
    assert factor.rcond[2] == 0.0


def test_long_rows_of_loops_are_solved_as_a_band() -> None:
    """30 loops, K_d of 60 columns: the same solution as the dense one, whatever the storage."""
    mech = linkages.n_four_bar(30)
    q = mech.generic_configurations()[0]
    path = RegularPath(mech, mech.select_rows(mech.K(mech.home)))
    K_d = mech.K(q)[path.rows][:, mech.iv_dependent]
    factor = BlockFactor(path.blocks, K_d != 0.0, np.arange(60))
    factor.factor(K_d)
    B = np.random.default_rng(1).uniform(-1, 1, (60, 2))
    X = factor.solve(B)
    assert np.abs(K_d @ X - B).max() <= 1e-12 * max(1.0, np.abs(X).max())
    assert abs(np.prod(factor.det)) == pytest.approx(abs(np.linalg.det(K_d)), rel=1e-9)


def test_no_matching_means_structurally_singular() -> None:
    pattern = hidden_blocks([2, 3], seed=1)
    pattern[:, 2] = False  # a joint that no row sees
    assert triangular_blocks(pattern) is None
    assert triangular_blocks(np.ones((2, 2), dtype=bool) & np.array([[1, 0], [1, 0]], dtype=bool)) is None
    assert triangular_blocks(np.zeros((0, 0), dtype=bool)) == []


@pytest.mark.parametrize("n", (1, 2, 7))
def test_row_of_four_bars_falls_into_loops(n: int) -> None:
    """One 2 × 2 block a loop: each loop's coupler and next crank, given the crank before."""
    mech = linkages.n_four_bar(n)
    path = RegularPath(mech, mech.select_rows(mech.K(mech.home)))
    K_d = mech.K(mech.generic_configurations()[0])[:, mech.iv_dependent]
    assert_block_lower_triangular(K_d != 0.0, list(path.blocks))
    assert len(path.blocks) == n
    loops = [{mech.dependent[j] for j in b.columns} for b in path.blocks]
    assert loops == [{f"coupler{i}", f"crank{i + 1}"} for i in range(n)]


def test_blocks_start_from_the_independent_crank() -> None:
    """With a crank in the middle as y the loops are closed outwards, still one block a loop."""
    mech = linkages.n_four_bar(4).with_independent(["crank2"])
    path = RegularPath(mech, mech.select_rows(mech.K(mech.home)))
    order = [frozenset(mech.dependent[j] for j in b.columns) for b in path.blocks]
    assert set(order) == {
        frozenset({"coupler0", "crank0"}),
        frozenset({"coupler1", "crank1"}),
        frozenset({"coupler2", "crank3"}),
        frozenset({"coupler3", "crank4"}),
    }
    assert order.index(frozenset({"coupler1", "crank1"})) < order.index(frozenset({"coupler0", "crank0"}))
    assert order.index(frozenset({"coupler2", "crank3"})) < order.index(frozenset({"coupler3", "crank4"}))


# --------------------------------------------------------------------------- rows and ranks


def test_independent_rows_span_the_row_space() -> None:
    """Of redundant rows (sums of others, copies, zeros) as many as the rank are kept, regular."""
    rng = np.random.default_rng(2)
    base = rng.uniform(-1, 1, (4, 4))
    K_d = np.vstack([base[0], np.zeros(4), 1e-3 * base[1], base[1], base[2] + base[3], base[2], base[3]])
    rows = independent_rows(K_d, 4)
    assert rows.tolist() == sorted(set(rows.tolist()))
    assert np.linalg.matrix_rank(K_d[rows]) == 4
    assert 2 not in rows  # of two parallel rows the larger one
    assert independent_rows(base, 4).tolist() == [0, 1, 2, 3]


def test_numerical_rank_is_relative() -> None:
    s = np.array([5.0, 1.0, 4.9e-8, 0.0])
    assert numerical_rank(s, 1e-8) == 2
    assert numerical_rank(1e-12 * s, 1e-8) == 2
    assert numerical_rank(s, 1e-9) == 3
    assert numerical_rank(np.zeros(3), 1e-8) == numerical_rank(np.zeros(0), 1e-8) == 0


# --------------------------------------------------------------------------- choices


def test_choices_are_ranked_by_their_smallest_singular_value() -> None:
    """Kernel (0, 1, 2)/√5: the first joint rests and cannot serve, the last moves most."""
    kernel = np.array([[0.0], [1.0], [2.0]]) / np.sqrt(5.0)
    found = ranked_choices(kernel, np.arange(3), ["a", "b", "c"])
    assert [names for _, names in found] == [("c",), ("b",)]
    np.testing.assert_allclose([quality for quality, _ in found], [2 / 5**0.5, 1 / 5**0.5], atol=1e-12)
    assert ranked_choices(kernel, np.array([0, 1]), ["a", "b"]) == found[1:]
    assert ranked_choices(kernel, np.arange(3), ["a", "b", "c"], limit=1) == found[:1]


def test_choices_of_several_joints_must_be_regular_together() -> None:
    """Joints 0 and 1 always move alike: not both."""
    kernel, _ = np.linalg.qr(np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    found = {names for _, names in ranked_choices(kernel, np.arange(3), ["a", "b", "c"])}
    assert found == {("a", "c"), ("b", "c")}
    assert ranked_choices(kernel, np.array([2]), ["c"]) == []  # fewer joints than freedoms
    assert ranked_choices(np.zeros((3, 0)), np.arange(3), ["a", "b", "c"]) == []


def test_many_joints_get_one_rank_revealing_choice() -> None:
    """C(30, 8) = 5.9 million sets are not tried one by one; the one offered is regular."""
    rng = np.random.default_rng(3)
    kernel, _ = np.linalg.qr(rng.normal(size=(30, 8)))
    names = [f"q{i}" for i in range(30)]
    ((quality, chosen),) = ranked_choices(kernel, np.arange(30), names)
    rows = [names.index(name) for name in chosen]
    s = np.linalg.svd(kernel[rows], compute_uv=False)
    assert quality == pytest.approx(s[-1], abs=1e-11)
    assert quality > 0.1  # pivoting finds a well conditioned set where there are so many
    assert MAX_ENUMERATED < 5_852_925


def test_every_choice_that_an_error_offers_makes_a_mechanism() -> None:
    """A pendulum outside the loop cannot be dependent: the closure does not see it."""
    model = linkages.four_bar(4.0, 1.0, 3.5, 3.0).model
    linkages.add_link(model, 0, -2.0, "pendulum", 1.0)
    closures = [rg.PointClosure("q2_tip", "q3_tip")]
    with pytest.raises(
        rg.PartitionError, match=r"structurally singular.*do not determine 'pendulum'"
    ) as caught:
        rg.Mechanism.from_pinocchio(model, closures, ["q1"])
    choices = caught.value.choices
    assert {frozenset(c) for c in choices} == {frozenset({"pendulum", q}) for q in ("q1", "q2", "q3")}
    for names in choices:
        assert " + ".join(names) in str(caught.value)
        assert rg.Mechanism.from_pinocchio(model, closures, names).m == 2


def test_choices_follow_the_motion_of_the_whole_mechanism() -> None:
    """A four-bar on a swinging base: its closure does not see the base, so q0 is in every set."""
    mech = linkages.swinging_four_bar(4.0, 1.0, 3.5, 3.0, swing=0.3, y=1.0)
    choices = mech.coordinate_choices(mech.home)
    assert {frozenset(c) for _, c in choices} == {frozenset({"q0", q}) for q in ("q1", "q2", "q3")}
    assert [quality for quality, _ in choices] == sorted((s for s, _ in choices), reverse=True)
    for _, names in choices:
        assert mech.with_independent(names).m == 2


@pytest.mark.parametrize("count", [2, 30, 60])
def test_a_chain_of_loops_is_determined_however_long(count: int) -> None:
    """Each loop is regular; σ_min/σ_max of all at once falls with their number."""
    mechanism = linkages.n_four_bar(count)
    K = mechanism.scaled(mechanism.generic_jacobians()[0])[:, mechanism.iv_dependent]
    assert is_determined([K])


def test_a_chain_as_ill_conditioned_as_a_singular_matrix_is_regular_in_blocks() -> None:
    """A triangular matrix with ones on and twos below its diagonal: det = 1, σ_min/σ_max far below 1e-9."""
    n = 120
    K = np.eye(n) + np.diag(np.full(n - 1, 2.0), -1)
    s = np.linalg.svd(K, compute_uv=False)
    assert s[-1] / s[0] < 1e-15
    assert is_determined([K])
    K[60, 60] = 0.0
    assert not is_determined([K])  # no matching: structurally singular
    assert not is_determined([K[:-1]])


def test_redundant_rows_and_blocks_that_are_regular_in_turn() -> None:
    rng = np.random.default_rng(0)
    regular = rng.uniform(-1.0, 1.0, (4, 4))
    singular = np.outer(regular[0], regular[1])
    assert is_determined([np.vstack([singular, regular])])
    assert not is_determined([np.vstack([singular, singular]), singular[[0, 1, 2, 3] * 2]])
    none = np.zeros((4, 4))
    turns = (regular, singular), (singular, regular)
    assert is_determined([np.block([[a, none], [none, b]]) for a, b in turns])
    assert not is_determined([np.block([[singular, none], [none, regular]])])


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 12), m=st.integers(1, 6))
def test_of_joints_that_serve_equally_the_first_are_taken(seed: int, n: int, m: int) -> None:
    """Whatever basis of the motions a decomposition came to: rows that come twice, in any basis."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(n, m))
    T = np.vstack([half, half * rng.choice([-1.0, 1.0], (n, 1))])
    for _ in range(4):
        turned = T @ np.linalg.qr(rng.normal(size=(m, m)))[0]
        chosen = spanning(turned, min(n, m))
        assert all(row < n for row in chosen), chosen
        assert chosen == spanning(T, min(n, m))
