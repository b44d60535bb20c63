"""Every shipped model says how it is run: from the command line and from Python alike, to a motion."""

from __future__ import annotations

import copy
import math
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.examples.linkages import four_bar, n_four_bar
from robust_gcp.io.loader import models_folder


def kinetic_peak(run: rg.Trajectory) -> float:
    """Largest kinetic energy of a run, J: what its error in energy is to be seen against."""
    rest = np.zeros(run.mechanism.nv)
    return max(
        run.mechanism.energy(q, v) - run.mechanism.energy(q, rest)
        for q, v in zip(run.q[::50], run.v[::50], strict=True)
    )


@pytest.mark.parametrize("name", rg.model_names())
def test_every_model_runs_as_it_recommends(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", name]) == 0
    out, err = capsys.readouterr()
    assert "warning" not in err
    mechanism = rg.load(name)
    run = rg.simulate(mechanism)
    assert f"state at t = {mechanism.recommended.duration:g} s" in out
    assert run.t[-1] == mechanism.recommended.duration
    assert run.t[1] == mechanism.recommended.step
    assert f"right-hand sides    {run.stats.rhs}\n" in out
    assert np.ptp(run.q, axis=0).max() > 0.1  # rad or m: it moves
    assert run.closure_error().max(initial=0.0) < 1e-12
    assert np.abs(run.energy_error()).max() < 1e-6 * kinetic_peak(run)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_row_of_four_bars_starts_as_the_benchmark_does(n: int) -> None:
    """A02: tips at 1 m/s along the ground line; all cranks turn alike and pass y = 0 and π flat."""
    mechanism = n_four_bar(n, length=0.5)
    run = rg.simulate(mechanism, duration=2.0)
    assert run.v[0, 0] == -2.0  # rad/s
    assert np.ptp(run.q[:, 0]) > math.pi
    assert len(run.crossings) >= 1
    assert n_four_bar(n, 0.3).recommended.v0 is None  # falls by itself


def test_what_the_caller_names_wins() -> None:
    flyball = rg.load("flyball")
    assert rg.simulate(flyball, duration=2e-3).t[-1] == 2e-3
    assert rg.simulate(flyball, duration=2e-3, step=5e-5).t[1] == 5e-5
    recommended = flyball.recommended.v0
    assert recommended is not None
    assert recommended.tolist() == [2.0 * math.pi, 0.0, 0.0, 0.0]
    assert rg.simulate(flyball, duration=1e-3).v[0].tolist() == recommended.tolist()
    assert not rg.simulate(flyball, v0=np.zeros(4), duration=1e-3).v[0].any()
    assert not rg.simulate(flyball, flyball.home, duration=1e-3).v[0].any()  # a start is q0 and v0


def test_without_a_word_a_run_takes_a_second_in_milliseconds() -> None:
    run = rg.simulate(four_bar(4.0, 1.0, 3.5, 3.0, y=1.0))
    assert (run.t[-1], run.t[1], len(run.t)) == (1.0, 1e-3, 1001)
    assert not run.v[0].any()


def test_copies_recommend_the_same() -> None:
    mechanism = n_four_bar(2)
    for other in (
        copy.copy(mechanism),
        copy.deepcopy(mechanism),
        pickle.loads(pickle.dumps(mechanism)),
        mechanism.with_independent(["crank2"]),
    ):
        assert other.recommended.duration == 20.0
        np.testing.assert_array_equal(other.recommended.v0, mechanism.recommended.v0)


# --------------------------------------------------------------------------- in robot.yaml


def folder_with(tmp_path: Path, name: str, recommended: str) -> Path:
    folder = Path(shutil.copytree(models_folder() / name, tmp_path / name))
    lines = (folder / "robot.yaml").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if not line.startswith("  recommended:")] + [
        f"  recommended: {recommended}"
    ]
    (folder / "robot.yaml").write_text("\n".join(lines), encoding="utf-8")
    return folder


@pytest.mark.parametrize(("name", "named"), [("crank_rocker", 2), ("slider_crank", 2), ("andrews", 1)])
def test_velocities_of_some_joints_take_the_others_along(name: str, named: int, tmp_path: Path) -> None:
    """v = G ẏ, whatever joints are named."""
    mechanism = rg.load(name)
    v = 2.0 * mechanism.G(mechanism.home)[:, 0]
    joint, speed = mechanism.joint_names[named], float(v[named])
    recommended = rg.load(folder_with(tmp_path, name, f"{{velocity: {{{joint}: {speed!r}}}}}")).recommended
    assert (recommended.duration, recommended.step) == (1.0, 1e-3)
    np.testing.assert_allclose(recommended.v0, v, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("recommended", "words"),
    [
        ("5", "recommended must be a mapping"),
        ("{duraton: 5}", "did you mean 'duration'"),
        ("{duration: -1}", "duration = -1 must be positive"),
        ("{duration: long}", "duration = 'long' must be a number"),
        ("{step: .nan}", "step = nan must be positive"),
        ("{step: null}", "step = None must be a number"),
        ("{velocity: 3}", "velocity must map joint names"),
        ("{velocity: {q1: fast}}", "velocity must map joint names"),
        ("{velocity: {crank: 1}}", "'crank'"),
        ("{velocity: {q1: 1, q2: 1}}", "the loops do not let q1, q2 move so"),
    ],
)
def test_what_is_wrong_in_the_file_is_named(recommended: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(rg.ModelError, match=r"robot\.yaml") as error:
        rg.load(folder_with(tmp_path, "crank_rocker", recommended))
    assert words in str(error.value)
    assert "recommended" in str(error.value)
