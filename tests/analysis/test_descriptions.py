"""The analysis of a place does not depend on the tree, the cut joints or the independent ones."""

from __future__ import annotations

import robust_gcp as rg

from ..campaigns.descriptions.choices import Refused, descriptions
from ..campaigns.descriptions.scenes import SCENES


def test_three_legs_in_line_have_one_mode_however_they_are_cut() -> None:
    """Two second-order forms on two directions; in some cuts one of them is a square."""
    scene = next(scene for scene in SCENES if scene.name == "parallel legs")
    seen = 0
    for description in descriptions(scene, 4, 1):
        if isinstance(description, Refused):
            continue
        run = rg.simulate(description.mechanism, None, description.v0, duration=0.12, step=scene.step)
        found = rg.analyse(description.mechanism, run.crossings[0].q)
        assert found.kind == "singular", description.name
        assert (found.rank, found.generic_rank, len(found.modes)) == (2, 3, 1), description.name
        seen += 1
    assert seen > 10
