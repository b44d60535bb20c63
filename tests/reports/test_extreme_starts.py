"""Beside the singular configuration: the library keeps to the closed form, or says why not."""

import pytest

from robust_gcp.reports.stability import extreme_starts
from robust_gcp.reports.stability.extreme_starts import draw_linkages, grashof
from robust_gcp.reports.stability.judge import judge, judge_all


@pytest.mark.parametrize(
    ("family", "right", "stopped"),
    [
        ("starts", 18, 1),
        pytest.param("near misses", 4, 2, marks=pytest.mark.slow),
        pytest.param("random linkages", 18, 12, marks=pytest.mark.slow),
        pytest.param("coordinates that turn back", 7, 1, marks=pytest.mark.slow),
    ],
)
def test_no_cell_is_wrong_without_saying_so(family, right, stopped):
    cells = judge_all(extreme_starts.FAMILIES[family](True))
    assert [(c.case.name, c.reason) for c in cells if c.verdict == "wrong"] == []
    assert sum(c.verdict in ("right", "coarse") for c in cells) >= right
    assert sum(c.verdict == "stopped" for c in cells) <= stopped


def test_drawing_covers_every_class():
    names = [case.name.split(": ")[1] for case in draw_linkages(80, 7)]
    classes = {"change point", "double crank", "crank-rocker", "double rocker", "rocker-crank"}
    assert classes | {"triple rocker"} == set(names)
    assert names.count("change point") >= 30


@pytest.mark.parametrize(
    ("lengths", "name"),
    [
        ((1.0, 2.0, 2.5, 3.0), "double crank"),
        ((3.0, 1.0, 2.5, 2.0), "crank-rocker"),
        ((3.0, 2.5, 1.0, 2.0), "double rocker"),
        ((3.0, 2.5, 2.0, 1.0), "rocker-crank"),
        ((3.0, 2.0, 2.0, 1.5), "triple rocker"),
        ((4.0, 2.0, 3.0, 3.0), "change point"),
    ],
)
def test_grashof_classes(lengths, name):
    # shortest + longest against the sum of the others; then by the place of the shortest
    assert grashof(lengths) == name


@pytest.mark.parametrize("number", [95, 569, 777])
def test_a_linkage_beside_its_dead_point_is_judged_by_its_own_steps(number: int) -> None:
    """Some of them were taken with error control, or further than a step of fixed length is let pass."""
    (cell,) = judge(draw_linkages(number + 1, 7)[number])
    assert cell.verdict == "right", cell.reason
