"""Blocks of random cases: the seed and the indices name each case, so that a block can be run alone."""

from __future__ import annotations

from typing import NamedTuple

import pytest

SIZE = 25


class Block(NamedTuple):
    """Some of a campaign's cases."""

    seed: int
    indices: range


@pytest.hookimpl(trylast=True)
def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Blocks and seeds as they are asked for, else by SEED and COUNT of the campaign's file."""
    option = metafunc.config.option
    if not {"seed", "block"} & set(metafunc.fixturenames):
        return
    seed = metafunc.module.SEED if option.seed is None else option.seed
    if "seed" in metafunc.fixturenames:
        metafunc.parametrize("seed", [seed], ids=[f"seed{seed}"])
    if "block" in metafunc.fixturenames:
        count = metafunc.module.COUNT if option.count is None else option.count
        blocks = [Block(seed, range(i, min(i + SIZE, count))) for i in range(0, count, SIZE)]
        ids = [f"seed{seed}-cases{block.indices[0]}to{block.indices[-1]}" for block in blocks]
        metafunc.parametrize("block", blocks, ids=ids)
