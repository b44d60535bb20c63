"""Traced modes against what is known of linkages: closure, tangents, counts, closed forms."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.analysis.curve import PASSING
from robust_gcp.analysis.torus import Torus
from robust_gcp.examples import linkages
from robust_gcp.examples.linkages import add_link, four_bar
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.four_bar import draw_four_bar

FOUR_BARS = ("rhombus", "parallelogram", "change_point", "kite", "crank_rocker")
OTHERS = ("slider_crank", *(pytest.param(name, marks=pytest.mark.slow) for name in ("bricard", "andrews")))


@functools.cache
def traced(name: str) -> rg.ConfigurationSpace:
    return rg.trace_modes(rg.load(name))


@functools.cache
def traced_four_bar(*lengths: float) -> rg.ConfigurationSpace:
    return rg.trace_modes(four_bar(*lengths, y=1.0), seeds=12)


def collinear(lengths: tuple[float, ...]) -> int:
    """Configurations of a four-bar with all links on one line: signs with l0 ± l1 ± l2 ± l3 = 0."""
    l0, *moving = lengths
    return sum(abs(l0 + np.dot(s, moving)) < 1e-12 for s in product((1, -1), repeat=3))


def components(lengths: tuple[float, ...]) -> int:
    """Grashof: the two assemblies are apart when the shortest and longest link are less than the others."""
    return 2 if min(lengths) + max(lengths) < 0.5 * sum(lengths) else 1


# --------------------------------------------------------------------------- every row


@pytest.mark.parametrize("name", [*FOUR_BARS, *OTHERS])
def test_every_row_closes_the_loops_and_moves_along_the_kernel(name: str) -> None:
    space = traced(name)
    m = space.mechanism
    for mode in space.modes:
        for q, t in zip(mode.q, mode.tangents, strict=True):
            assert m.closure_residual(q) < 1e-12
            assert np.abs(m.scaled(m.K(q)) @ (t / m.column_scale)).max() < 1e-12
        np.testing.assert_allclose(np.linalg.norm(mode.tangents, axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("name", [*FOUR_BARS, *OTHERS])
def test_tangents_are_those_of_the_curve(name: str) -> None:
    # The secant between neighbours and the mean of their tangents differ by the second order of the
    # step: with tangents that turn by at most 0.15 rad from row to row, by 0.15² / 12 < 3e-3.
    for mode in traced(name).modes:
        scale = traced(name).mechanism.column_scale
        secants = np.diff(mode.q, axis=0) / scale
        lengths = np.linalg.norm(secants, axis=1)
        assert lengths.max() < 1.3 * PASSING  # the longest step, past a singular point
        u = mode.tangents / scale
        u /= np.linalg.norm(u, axis=1)[:, None]
        middle = u[:-1] + u[1:]
        middle /= np.linalg.norm(middle, axis=1)[:, None]
        kept = lengths > 1e-6
        np.testing.assert_allclose((secants / lengths[:, None])[kept], middle[kept], atol=3e-3)


@pytest.mark.parametrize("name", [*FOUR_BARS, *OTHERS])
def test_closed_modes_return_by_whole_turns(name: str) -> None:
    for mode in traced(name).modes:
        assert mode.closed and mode.stop == ""
        np.testing.assert_allclose(mode.q[-1] - mode.q[0], 2.0 * np.pi * np.array(mode.turns), atol=1e-9)
        np.testing.assert_allclose(mode.tangents[-1], mode.tangents[0], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["seven hinges", pytest.param("spherical loop", marks=pytest.mark.campaign)])
def test_spatial_loops_are_traced_through_every_turning_point(
    name: str, spatial: dict[str, rg.Mechanism]
) -> None:
    m = spatial[name]
    space = rg.trace_modes(m, seeds=0)
    (mode,) = space.modes
    assert mode.closed and space.singular_points == ()
    for q, t in zip(mode.q[::5], mode.tangents[::5], strict=True):
        assert m.closure_residual(q) < 1e-12
        assert np.abs(m.scaled(m.K(q)) @ (t / m.column_scale)).max() < 1e-12


# --------------------------------------------------------------------------- counts from theory


@pytest.mark.parametrize("name", FOUR_BARS)
def test_four_bars_are_singular_where_all_links_align(name: str) -> None:
    points = traced(name).singular_points
    assert len(points) == collinear(draw_four_bar(rg.load(name)).lengths)
    for point in points:
        sines = np.sin([point.q[0], point.q[0] + point.q[1], point.q[2]])
        np.testing.assert_allclose(sines, 0.0, atol=1e-10)
        assert (point.kind, len(point.modes)) == ("singular", 2)


@pytest.mark.parametrize(
    "lengths",
    [
        (4.0, 1.0, 3.5, 2.5),
        (2.0, 3.0, 3.3, 3.1),
        (3.0, 2.5, 1.0, 2.0),
        (3.0, 2.0, 2.2, 2.6),
        (1.5, 1.6, 1.7, 2.9),
    ],
)
def test_regular_four_bars_have_one_or_two_modes_by_grashof(lengths: tuple[float, ...]) -> None:
    space = traced_four_bar(*lengths)
    assert len(space.modes) == components(lengths)
    assert space.singular_points == ()


@pytest.mark.parametrize(
    "gap", [1e-2, -1e-2, *(pytest.param(gap, marks=pytest.mark.campaign) for gap in (1e-4, -1e-4))]
)
def test_modes_that_veer_are_not_taken_to_meet(gap: float) -> None:
    lengths = (1.0, 1.0, 1.0, 1.0 + gap)
    space = traced_four_bar(*lengths)
    assert len(space.modes) == components(lengths)
    assert space.singular_points == ()


@pytest.mark.parametrize(
    ("name", "turns"),
    {
        # METHOD: a, the parallelogram, b, q1 = 0 with links 2 and 3 folded, c, q2 = q3 = π
        "rhombus": {(1, -1, 1), (0, 1, 1), (1, 0, 0)},
        # the parallelogram keeps q12 = 0; on the antiparallelogram the short coupler turns twice
        "parallelogram": {(1, -1, 1), (1, 1, 1)},
        # one curve: S2 = 2 √(l0 l1) cos(y/2) changes sign with each turn, so it closes after two
        "change_point": {(2, -2, 0)},
        # the deltoid rocks about q1 = 0 while links 2 and 3 turn against each other; folded, with each other
        "kite": {(0, -1, 1), (0, 1, 1)},
        # coupler above and below
        "crank_rocker": {(1, -1, 0)},
        "slider_crank": {(1, -1, 0)},
    }.items(),
)
def test_turns_of_the_modes(name: str, turns: set[tuple[int, ...]]) -> None:
    def one_way(n: tuple[int, ...]) -> tuple[int, ...]:
        return max(n, tuple(-x for x in n))

    assert {one_way(mode.turns) for mode in traced(name).modes} == {one_way(n) for n in turns}


def test_the_rhombus_modes_of_the_paper_meet_where_it_says() -> None:
    space = traced("rhombus")
    assert [mode.name for mode in space.modes] == ["a", "b", "c"]
    a, b, c = space.modes
    np.testing.assert_allclose(a.q, a.q[:, :1] * [1.0, -1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(b.q[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cos(c.q[:, 1:]), -1.0, atol=1e-12)
    found = {
        tuple(np.round(p.q / np.pi, 9).tolist()): set(space.meeting(i))
        for i, p in enumerate(space.singular_points)
    }
    assert found == {(0, 0, 0): {"a", "b"}, (1, -1, 1): {"a", "c"}, (0, -1, 1): {"b", "c"}}


@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point", "crank_rocker"])
def test_rows_lie_on_the_closed_form(name: str) -> None:
    linkages = [FourBar(*draw_four_bar(rg.load(name)).lengths, assembly) for assembly in (1, -1)]
    for mode in traced(name).modes:
        if np.abs(mode.tangents[:, 0]).max() < 1e-9:
            continue  # y rests: there is no γ(y)
        for q, t in zip(mode.q[::7], mode.tangents[::7], strict=True):
            errors = []
            for linkage in linkages:
                for turn in (0.0, 2.0 * np.pi):
                    theta, rate, _ = linkage.evaluate(q[0] + turn, q)
                    off = (theta - q + np.pi) % (2.0 * np.pi) - np.pi
                    errors.append(max(np.abs(off).max(), np.abs(rate - t / t[0]).max()))
            assert min(errors) < 1e-9


# --------------------------------------------------------------------------- singular points


@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point", "kite"])
def test_modes_pass_singular_points_along_the_tangents_that_analyse_lists(name: str) -> None:
    space = traced(name)
    torus = Torus(space.mechanism)
    for mode in space.modes:
        for visit in mode.visits:
            point = space.singular_points[visit.point]
            assert torus.distance(mode.q[visit.row], point.q) < 1e-9
            listed = point.modes[visit.tangent] / np.linalg.norm(point.modes[visit.tangent])
            assert abs(mode.tangents[visit.row] @ listed) == pytest.approx(1.0, abs=1e-12)
            if 0 < visit.row < len(mode.q) - 1:
                secant = mode.q[visit.row + 1] - mode.q[visit.row - 1]
                assert abs(secant @ listed) / np.linalg.norm(secant) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point", "kite"])
def test_every_tangent_at_a_singular_point_belongs_to_one_mode(name: str) -> None:
    space = traced(name)
    for i, point in enumerate(space.singular_points):
        passing = {(v.tangent, mode.name) for mode in space.modes for v in mode.visits if v.point == i}
        assert sorted(tangent for tangent, _ in passing) == list(range(len(point.modes)))
        assert space.meeting(i) == tuple(name for _, name in sorted(passing))


def test_a_singular_home_gives_the_same_space() -> None:
    m = rg.load("rhombus")
    at_crossing = rg.Mechanism(m.model, m.closures, m.independent, home=np.zeros(3))
    space = rg.trace_modes(at_crossing, seeds=0)
    assert {mode.turns for mode in space.modes} == {mode.turns for mode in traced("rhombus").modes}
    assert len(space.singular_points) == 3


def test_the_space_does_not_depend_on_the_independent_joint() -> None:
    space = rg.trace_modes(rg.load("kite", independent=["q3"]))
    assert len(space.modes) == len(space.singular_points) == 2


@pytest.mark.parametrize("n", (1, 2, pytest.param(3, marks=pytest.mark.slow)))
def test_rhombi_in_a_row_have_a_mode_for_each_run_of_cranks_that_move(n: int) -> None:
    """Cranks i to j turn together, the loops between them are parallelograms, those at both ends fold, and
    all others rest flat: (n + 1)(n + 2)/2 circles, in most of which K lacks the ranks of the loops at rest.
    They meet in n + 2 flat poses, in each of them n + 1."""
    space = rg.trace_modes(linkages.n_four_bar(n, angle=0.0), seeds=4)
    assert len(space.modes) == (n + 1) * (n + 2) // 2
    assert all(mode.closed for mode in space.modes)
    assert [len(set(space.meeting(i))) for i in range(len(space.singular_points))] == [n + 1] * (n + 2)
    runs = {tuple(t > 1e-9 for t in np.ptp(mode.q[:, ::2], axis=0)) for mode in space.modes}
    wanted = {tuple(i <= k <= j for k in range(n + 1)) for i in range(n + 1) for j in range(i, n + 1)}
    assert runs == wanted
    for mode in space.modes:
        assert max(space.mechanism.closure_residual(q) for q in mode.q) < 1e-12


def test_an_isolated_point_has_no_mode() -> None:
    # Three links of 1 m span 3 m of ground only when stretched: that configuration and no other.
    model = pin.Model()
    add_link(model, add_link(model, 0, 0.0, "q1", 1.0), 1.0, "q2", 1.0)
    add_link(model, 0, 3.0, "q3", 1.0)
    m = rg.Mechanism(model, [rg.PointClosure("q2_tip", "q3_tip")], ["q1"], home=[0.0, 0.0, np.pi])
    space = rg.trace_modes(m, seeds=5)
    assert space.modes == ()
    (point,) = space.singular_points
    assert (point.kind, point.modes) == ("isolated", ())


def test_modes_that_touch_are_traced_through(trammel: Callable[..., rg.Mechanism]) -> None:
    """Each by itself, back to where it began."""
    m = trammel(np.pi / 2)
    m.home = m.assemble(m.home + [np.cos(np.pi / 2 + 0.3), -0.3, np.sin(np.pi / 2 + 0.3) - 1.0, 0.4, -0.8])
    space = rg.trace_modes(m, seeds=0)
    (point,) = space.singular_points
    assert (point.kind, point.contacts) == ("singular", ((0, 1, 2),))
    assert [mode.closed for mode in space.modes] == [True, True]
    assert len({float(np.sign(np.sin(mode.q[:, 4]).sum())) for mode in space.modes}) == 2  # the dyad's bend
    for mode in space.modes:
        (visit,) = {(v.point, v.tangent) for v in mode.visits}
        assert visit[0] == 0
        assert max(m.closure_residual(q) for q in mode.q[::10]) < 1e-10
    assert {v.tangent for mode in space.modes for v in mode.visits} == {0, 1}


def test_a_cusp_ends_a_mode(trammel: Callable[..., rg.Mechanism]) -> None:
    m = trammel(1.0)
    space = rg.trace_modes(m, seeds=20)
    assert "cusp" in {point.kind for point in space.singular_points}
    assert any("cusp" in mode.stop for mode in space.modes)


# --------------------------------------------------------------------------- refused


@pytest.mark.parametrize(
    ("name", "words"), [("five_bar", "m = 2"), ("flyball", "m = 4"), ("stewart", "m = 6")]
)
def test_other_mobilities_are_refused(name: str, words: str) -> None:
    with pytest.raises(rg.OptionError, match=f"one degree of freedom.*{words}"):
        rg.trace_modes(rg.load(name))


@pytest.mark.parametrize("seeds", [-1, 1.5, float("nan"), True, "many"])
def test_seeds_are_counted(seeds: object) -> None:
    with pytest.raises(rg.OptionError, match="seeds"):
        rg.trace_modes(rg.load("rhombus"), seeds)  # type: ignore[arg-type]


def test_a_name_is_not_a_mechanism() -> None:
    with pytest.raises(rg.OptionError, match=r"give robust_gcp.load\('rhombus'\)"):
        rg.trace_modes("rhombus")  # type: ignore[arg-type]


# --------------------------------------------------------------------------- assembly modes, and the search


@pytest.mark.parametrize("name", FOUR_BARS)
def test_assembly_modes_are_as_many_as_grashof_says(name: str) -> None:
    space = traced(name)
    lengths = {"rhombus": (1, 1, 1, 1), "parallelogram": (2, 1, 2, 1), "change_point": (4, 2, 3, 3)}
    lengths |= {"kite": (2, 1, 1, 2)}
    expected = components(lengths[name]) if name in lengths else 2
    assert len(space.assemblies) == expected
    assert sorted(mode for names in space.assemblies for mode in names) == [m.name for m in space.modes]
    for i in range(len(space.singular_points)):
        assert any(set(space.meeting(i)) <= set(names) for names in space.assemblies)


def test_the_summary_tells_modes_from_assembly_modes() -> None:
    assert traced("rhombus").summary == "3 modes, 3 singular points"
    assert traced("crank_rocker").summary == "2 assembly modes, no singular points"
    assert traced("change_point").summary == "1 mode, 1 singular point"
    crossed = rg.ConfigurationSpace(
        traced("rhombus").mechanism,
        (*traced("rhombus").modes, replace(traced("crank_rocker").modes[0], name="d")),
        traced("rhombus").singular_points,
    )
    assert crossed.summary == "4 modes in 2 assembly modes, 3 singular points"
    assert crossed.assemblies == (("a", "b", "c"), ("d",))


def test_the_search_says_how_far_it_went() -> None:
    """Starts are counted for the mode that they lie on; a single hit calls for more seeds."""
    few = rg.trace_modes(rg.load("crank_rocker"), seeds=0)
    assert few.search == "only what is connected with home was looked for (seeds = 0)"
    assert few.met == (1,)
    space = traced("crank_rocker")
    assert len(space.met) == 2 and 2 < sum(space.met) <= 41
    assert (
        space.search
        == "searched from home and 40 seeds; assembly modes with few configurations may be missing"
    )
    once = replace(space, met=(20, 1))
    assert once.search.endswith("met by one of them alone: b, so there may be more: use more seeds")
    ended = replace(space, modes=(space.modes[0], replace(space.modes[1], closed=False, stop="a cusp")))
    assert "not followed to the end: b" in ended.search


def test_what_is_printed_is_a_summary() -> None:
    """Not a wall of numbers: a line a mode."""
    space = rg.trace_modes(rg.load("rhombus"))
    head, *modes = str(space).splitlines()
    assert head == "ConfigurationSpace of 'rhombus': 3 modes, 3 singular points"
    assert [line.split(":")[0].strip() for line in modes] == [
        "ModeCurve('a'",
        "ModeCurve('b'",
        "ModeCurve('c'",
    ]
    assert all(f"{len(m.q)} configurations" in line for m, line in zip(space.modes, modes, strict=True))
    told = str(rg.analyse(rg.load("rhombus"), np.zeros(3))).splitlines()
    assert told[0].startswith("LocalAnalysis(singular at q = [0.0, 0.0, 0.0]: rank 1 against 2")
    assert told[1:] == ["  modes[0] = [1.0, -1.0, 1.0]", "  modes[1] = [0.0, 1.0, 1.0]"]
    (alone,) = str(rg.analyse(rg.load("rhombus"), [0.2, -0.2, 0.2])).splitlines()
    assert alone.startswith("LocalAnalysis(regular")
