"""Meetings and cusps unfolded at random: nothing is certified that is not there."""

from __future__ import annotations

import numpy as np
import pytest

from ..maps.test_meetings import false_certificates
from .conftest import Block

SEED, COUNT = 7, 10000


@pytest.mark.campaign
def test_no_false_certificate(block: Block) -> None:
    told = [false_certificates(np.random.default_rng((block.seed, i)), 1) for i in block.indices]
    assert [words for case in told for words in case] == []
