"""Random linkages with stops, friction and locks: the same happenings whatever the coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from .conftest import Block
from .phases import Outcome, drawn, measured, ran, told

SEED, COUNT = 30, 200


def figures(outcomes: list[Outcome]) -> dict[str, float]:
    """What the cases came to."""
    kinds: Counter[str] = Counter()
    for outcome in outcomes:
        kinds.update(outcome.kinds)
    return {
        "cases": len(outcomes),
        "happenings": sum(outcome.happenings for outcome in outcomes),
        **kinds,
        "largest difference of times": max(outcome.apart for outcome in outcomes),
        "largest penetration": max(outcome.deepest for outcome in outcomes),
        "largest opening": max(outcome.open for outcome in outcomes),
        "largest energy error": max(outcome.energy for outcome in outcomes),
        "undecided": sum(outcome.undecided for outcome in outcomes),
        "refused": sum(bool(outcome.refused) for outcome in outcomes),
        "silently wrong": sum(bool(outcome.wrong) for outcome in outcomes),
    }


def wrong(outcomes: list[Outcome]) -> str:
    """Those that are wrong, a line each."""
    return "\n".join(str(outcome) for outcome in outcomes if outcome.wrong)


@pytest.mark.campaign
def test_happenings_do_not_depend_on_coordinates(block: Block, record_property: Callable[..., None]) -> None:
    outcomes = [measured(block.seed, index) for index in block.indices]
    record_property(f"phases, seed {block.seed}", figures(outcomes))
    assert not wrong(outcomes)


def test_some_happenings_do_not_depend_on_coordinates() -> None:
    outcomes = [measured(30, index, most=2) for index in (0, 1, 2)]
    assert not wrong(outcomes) and sum(outcome.happenings for outcome in outcomes) > 5


def test_a_break_just_before_the_end_of_a_step_is_one_break() -> None:
    """Over the 3 µs that are left of the step the rounding of q1 would be a rate, and end the slip again."""
    scene = drawn(31, 836)
    run = ran(scene, scene.choices[1], 1e-3)
    assert not isinstance(run, str) and len(run.happenings) == 8
    assert run.happenings[-1].kind == "release" and run.t[-1] == 1.0


def test_a_case_is_drawn_alike() -> None:
    assert drawn(3, 4).parts == drawn(3, 4).parts and (drawn(3, 4).v == drawn(3, 4).v).all()


def test_legs_that_begin_near_a_turn_of_their_coordinates_keep_their_digits() -> None:
    """Where q2 nearly turns back its rate tells the velocity to nine digits less."""
    scene = drawn(31, 1108)
    runs = [ran(scene, names, 1e-3) for names in scene.choices]
    assert not any(isinstance(run, str) for run in runs)
    times = [[t for t, _, _ in told(run)][:20] for run in runs if not isinstance(run, str)]
    assert max(abs(a - b) for other in times[1:] for a, b in zip(times[0], other, strict=True)) < 1e-10
