"""The set of motions through singular configurations: what it holds, how it was made, how it scores."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.maps.pendulum import pendulum
from robust_gcp.mechanism.tree import Array
from robust_gcp.reports.contender import Outcome, Scene
from robust_gcp.reports.singular.motions import Motion, motions
from robust_gcp.reports.singular.scores import cells, scene_of, scored
from robust_gcp.reports.work_precision.reduced import GRAVITY

from ..compiled import needs_kernel
from ..exact import Exact
from ..exact_in_space import ExactInSpace
from .singular_motions import Motion as Quadrature

SET = motions()


@pytest.mark.parametrize("motion", SET, ids=lambda motion: motion.name)
def test_states_are_those_of_one_motion(motion: Motion) -> None:
    """Closed, of one energy, y on its way all the time, and what a run of ours passes through."""
    mech = motion.mechanism
    energies = [mech.energy(q, v) for q, v in zip(motion.q, motion.v, strict=True)]
    assert np.ptp(energies) < 1e-12 * max(1.0, np.abs(energies).max())
    for q, v in zip(motion.q, motion.v, strict=True):
        assert np.abs(mech.phi(q)).max() < 1e-14
        assert np.abs(mech.K(q) @ v).max() < 1e-13 * np.abs(v).max()
    own = mech.iv_independent[0]
    assert np.ptp(np.sign(np.append(motion.v[:, own], np.diff(motion.q[:, own])))) == 0.0
    scene, fine = scene_of(motion)
    assert np.abs(fine[:: (len(scene.times) - 1) // 20] - motion.q).max() < 5e-11
    run = rg.simulate(
        mech, scene.q0, scene.v0, duration=float(motion.times[-1]), step=float(motion.times[-1]) / 400
    )
    assert run.crossings


@pytest.mark.parametrize("name", ["rhombus", "in space 4, mode 1"])
def test_how_it_was_made(name: str) -> None:
    """Again from its start, to the last digit of a double."""
    kept = next(motion for motion in SET if motion.name == name)
    mech = kept.mechanism
    exact = (ExactInSpace if name.startswith("in space") else Exact)(mech)
    rate = Decimal(float(kept.v[0, mech.iv_independent[0]]))
    again = Quadrature(exact, [Decimal(float(x)) for x in kept.q[0]], rate)
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
        q = self._q[: self._keep] + self._off * (np.arange(self._keep) >= 200)[:, None]
        return Outcome(q, np.zeros_like(q), 0.0, 0)


def test_scores() -> None:
    motion = SET[0]
    scene, exact = scene_of(motion)
    middle = float(motion.times[10])
    tools = [
        Replayed("good", exact),
        Replayed("gone", exact, off=1.0),
        Replayed("stopped", exact, keep=201),
        Replayed("no", exact, refusal="no loops"),
    ]
    found = [scored(tool, motion, scene, 1.0) for tool in tools]
    assert found[0].error < 1e-11
    assert [cell for _, cell in cells(found)[2:]] == [
        f"lost at {middle:.3g} s",
        f"lost at {float(motion.times[11]):.3g} s",
        "refused",
    ]


@needs_kernel
def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reports", "singular", "--method", "bridge compiled", "--cap", "0.01"]) == 0
    assert "two crossed parallelograms" in capsys.readouterr().out
