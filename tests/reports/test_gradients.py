"""The test set of derivatives: what it holds, and how it scores."""

from __future__ import annotations

import json
from collections import Counter
from importlib.util import find_spec

import numpy as np
import pytest

from robust_gcp.reports.gradients import scores
from robust_gcp.reports.gradients.scores import PROBLEMS, Problem, problems

from ..dynamics import gradient_problems


@pytest.mark.parametrize("every", [17, pytest.param(1, marks=pytest.mark.campaign)])
def test_all_of_ours_are_right(every: int) -> None:
    given = problems()
    assert Counter(p.kind for p in given) == {"regular": 66, "near": 128, "at": 32}
    for score in scores.scored("robust_gcp", given[::every]):
        assert score.right == score.count, score
        assert score.worst < 1e-11, score


def test_it_is_what_the_digits_give() -> None:
    """The first problems in the plane and in space again, from seventy digits."""
    stored = json.loads(PROBLEMS.read_text())
    for made, kept in zip(gradient_problems.regular(), stored[:6], strict=False):
        assert made == kept
    for made, kept in zip(gradient_problems.regular_in_space(), stored[-9:-5], strict=False):
        assert made == kept


def test_what_is_not_right_is_said() -> None:
    """A sign that is flipped, digits that are missing, no answer, and answers that are no numbers."""
    given = problems()[:20]

    def answered(*factors: float) -> list[int]:
        def answer(problem: Problem) -> scores.Answer:
            exact = problem.udot, problem.da_dy, problem.da_dv, problem.da_dtau
            udot, da_dy, da_dv, da_dtau = (f * part for f, part in zip(factors, exact, strict=True))
            return udot, da_dy, da_dv, da_dtau

        score = scores.scored("theirs", given, answer)[0]
        return [score.right, score.inaccurate, score.wrong, score.refused]

    assert answered(1.0, 1.0, 1.0, 1.0) == [20, 0, 0, 0]
    assert answered(1.0, 1.0, 1.0, 1.0 + 1e-6) == [0, 20, 0, 0]
    assert answered(1.0, 1.0, 1.0, -1.0)[2] == 20
    assert answered(1.0, 1.0, 1.0, np.nan)[2] == 20

    def refuses(problem: Problem) -> scores.Answer:
        raise ValueError("no loops here")

    assert scores.scored("theirs", given, refuses)[0].refused == 20


def test_pinocchio_s_columns() -> None:
    """Its accelerations and their slopes by v and τ are right; those by q were not when this was written."""
    for problem in (*problems()[:10], *problems()[-9:]):
        udot, _, _, da_dtau = scores.of_pinocchio(problem)
        np.testing.assert_allclose(udot, problem.udot, rtol=0, atol=1e-9 * np.abs(problem.udot).max())
        np.testing.assert_allclose(
            da_dtau, problem.da_dtau, rtol=0, atol=1e-9 * np.abs(problem.da_dtau).max()
        )


@pytest.mark.skipif(find_spec("mujoco") is None, reason="MuJoCo comes with the extra bench")
def test_mujoco_is_right_to_its_softness(monkeypatch: pytest.MonkeyPatch) -> None:
    """At regular states its error falls as its closures are made harder, in each of the four matrices."""
    from robust_gcp.reports.peers import mujoco

    problem = problems()[0]
    exact = problem.udot, problem.da_dy, problem.da_dv, problem.da_dtau
    off = []
    for hardness in (0.9, 0.99, 0.999):
        monkeypatch.setattr(mujoco, "HARDEST", hardness)
        mujoco.compiled.cache_clear()
        found = scores.of_mujoco(problem)
        off.append([float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, exact, strict=True)])
    mujoco.compiled.cache_clear()
    assert np.all(np.array(off[1]) < 0.2 * np.array(off[0]))
    assert np.all(np.array(off[2]) < 0.2 * np.array(off[1]))
