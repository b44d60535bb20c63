"""The set of motions through singular configurations: what it holds, how it was made, how it scores."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.maps.pendulum import pendulum
from robust_gcp.mechanism.tree.tree import Array
from robust_gcp.reports.contender import Outcome, Scene
from robust_gcp.reports.singular.scores import Motion, cells, followed, motions, scored
from robust_gcp.reports.work_precision.reduced import GRAVITY

from ..compiled import needs_kernel
from .singular_motions import quadrature

SET = motions()


@pytest.mark.parametrize("motion", SET, ids=lambda motion: motion.name)
def test_states_are_those_of_one_motion(motion: Motion) -> None:
    """Closed, of one energy less what was lost, y on its way to a stop and back, and what a run passes."""
    mech, own = motion.mechanism, motion.mechanism.iv_independent[0]
    for q, v in zip(motion.q, motion.v, strict=True):
        assert np.abs(mech.phi(q)).max() < 1e-14
        assert np.abs(mech.K(q) @ v).max() < 1e-13 * np.abs(v).max()
    ways = np.sign(motion.v[:, own])
    hits = np.flatnonzero(np.diff(ways))
    assert len(hits) == len(motion.linkage.get("stops", []))
    for part, way in zip(np.split(motion.q[:, own], hits + 1), ways[[0, *(hits + 1)]], strict=True):
        assert np.all(np.sign(np.diff(part)) == way)
    energies = np.array([mech.energy(q, v) for q, v in zip(motion.q, motion.v, strict=True)])
    for joint, bound in motion.linkage.get("friction", {}).items():
        energies += bound * np.abs(motion.q - motion.q[0])[:, mech.joint(joint).idx_q]
    for part in np.split(energies, hits + 1):
        assert np.ptp(part) < 1e-12 * max(1.0, np.abs(energies).max())
    scene, fine = motion.scene, followed(motion.scene)
    assert np.abs(fine[:: (len(scene.times) - 1) // 20] - motion.q).max() < 5e-11


@pytest.mark.parametrize("motion", SET, ids=lambda motion: motion.name)
def test_each_passes_what_it_is_there_for(motion: Motion) -> None:
    """One crossing at least; the cusp is told of with its time, and the stop is hit where energy says."""
    duration = float(motion.times[-1])
    given = motion.mechanism, motion.q[0], motion.v[0], duration, duration / 400
    if np.isfinite(motion.end):
        with pytest.raises(rg.CuspError) as caught:
            rg.simulate(*given)
        assert caught.value.time == pytest.approx(motion.end, abs=1e-12)
        return
    run = rg.simulate(*given, joints=list(motion.joints) or None)
    assert run.crossings
    assert [x.kind for x in run.happenings] == ["impact"] * len(motion.linkage.get("stops", []))
    if motion.name == "trammel":
        assert [(x.kind, x.order) for x in run.crossings] == [("tangential", 2)]
    assert motion.name != "collapsing cell" or run.crossings[0].corank == 2


@pytest.mark.parametrize(
    "name",
    ["rhombus", "in space 4, mode 1", "flat-foldable vertex", "trammel", "cusp", "over centre, stop",
     "kite, dry friction"],
)  # fmt: skip
def test_how_it_was_made(name: str) -> None:
    """Again from its start, to the last digit of a double."""
    kept = next(motion for motion in SET if motion.name == name)
    rate = float(kept.v[0, kept.mechanism.iv_independent[0]])
    again = quadrature(kept.linkage, kept.q[0], rate, bool(np.isfinite(kept.end)))
    assert not again.cusp or float(again.end) == kept.end
    states = list(again.states(Decimal(float(kept.times[-1]))))
    np.testing.assert_array_equal([[float(x) for x in q] for q, _ in states], kept.q)
    np.testing.assert_array_equal([[float(x) for x in v] for _, v in states], kept.v)


def test_the_rhombus_is_a_pendulum() -> None:
    """(5/3) ÿ = −2 g cos y as a parallelogram."""
    kept = SET[0]
    times, (y, rate) = kept.times, (kept.q[0, 0], kept.v[0, 0])
    exact, speed, _ = pendulum(times, y, rate, 5.0 / 3.0, 2.0 * GRAVITY)
    np.testing.assert_allclose(kept.q[:, 0], exact, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(kept.v[:, 0], speed, rtol=0.0, atol=1e-11)


class Replayed:
    """A tool that follows a motion, or leaves it, or stops."""

    family, stepper, kind, tuning = "none", "none", "fixed", ""

    def __init__(self, name: str, q: Array, keep: int = 401, off: float = 0.0, refusal: str = "") -> None:
        self.name, self._q, self._keep, self._off, self._refusal = name, q, keep, off, refusal

    def refuses(self, scene: Scene) -> str:
        return self._refusal

    def run(self, scene: Scene, setting: float) -> Outcome:
        q = self._q[: self._keep] + self._off * (np.arange(len(self._q)) >= 200)[: self._keep, None]
        return Outcome(q, np.zeros_like(q), 0.0, 0)


def test_scores() -> None:
    motion = SET[0]
    exact = followed(motion.scene)
    middle = float(motion.times[10])
    tools = [
        Replayed("good", exact),
        Replayed("gone", exact, off=1.0),
        Replayed("stopped", exact, keep=201),
        Replayed("no", exact, refusal="no loops"),
    ]
    found = [scored(tool, motion, 1.0) for tool in tools]
    assert found[0].error < 1e-11
    assert [cell for _, cell in cells(found)[2:]] == [
        f"lost at {middle:.3g} s",
        f"lost at {float(motion.times[11]):.3g} s",
        "refused",
    ]


def test_who_goes_on_after_an_end_is_told() -> None:
    motion = next(motion for motion in SET if np.isfinite(motion.end))
    scene, exact = motion.scene, followed(motion.scene)
    assert len(exact) < len(scene.times)
    on = np.concatenate([exact, np.tile(exact[-1], (len(scene.times) - len(exact), 1))])
    tools = [Replayed("stops", exact), Replayed("goes on", on)]
    found = [scored(tool, motion, 1.0) for tool in tools]
    assert [score.past for score in found] == [False, True]
    assert cells(found)[2][1].endswith(", goes on")


@needs_kernel
def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reports", "singular", "--method", "bridge compiled", "--cap", "0.01"]) == 0
    assert "two crossed parallelograms" in capsys.readouterr().out
