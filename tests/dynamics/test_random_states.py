"""What forward dynamics answers, derivatives do, and what `simulate` steps over, Jacobians of steps do."""

from __future__ import annotations

import pytest

from .random_states import Judgement, beside_flat, beside_toggle, judged, judged_step

FEW = range(12)


def require_right(judgement: Judgement) -> None:
    verdict, words = judgement
    assert verdict in ("right", "left out"), words


@pytest.mark.parametrize("seed", FEW)
def test_derivatives_beside_toggles(seed: int) -> None:
    state = beside_toggle(seed)
    assert state is not None
    require_right(judged(state))


@pytest.mark.parametrize("seed", (1, 2, 5, 6, 8, 11, 20524))
def test_derivatives_beside_singular_places(seed: int) -> None:
    require_right(judged(beside_flat(seed)))


@pytest.mark.parametrize("seed", (0, 2, 4, 6, 10, 12, 15, 18))
def test_steps_beside_toggles(seed: int) -> None:
    state = beside_toggle(seed)
    assert state is not None
    require_right(judged_step(state))


@pytest.mark.parametrize("seed", (2, 8, 81))
def test_steps_beside_singular_places(seed: int) -> None:
    require_right(judged_step(beside_flat(seed)))
