"""Error against run time: contenders, points, resumption and the command, on a small selection.

Orders, floors and who is lost are asserted; seconds are not.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.reports import machine
from robust_gcp.reports.contender import Contender, Outcome, Scene
from robust_gcp.reports.work_precision import command, measure, ours, scenes, verdicts
from robust_gcp.reports.work_precision.looks import Labels, looks
from robust_gcp.reports.work_precision.measure import Judge, Point
from robust_gcp.reports.work_precision.ours import Equations, Implicit, TunedImplicit
from robust_gcp.reports.work_precision.references import Reference

SMALL = ["bridge, RK4", "bridge, DOP853", "classical GCP, RK4", "KKT (2), RK4"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command's output for the antiparallelogram and four contenders."""
    pytest.importorskip("matplotlib")
    out = tmp_path_factory.mktemp("study")
    assert main(arguments(out)) == 0
    return out


def arguments(out: Path, *more: str) -> list[str]:
    given = [
        "reports",
        "work-precision",
        "--quick",
        "--scene",
        "antiparallelogram",
        "--out",
        str(out),
        "--cap",
        "60",
    ]
    return [*given, "--method", *SMALL, *more]


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command measures in this process only when the number of threads is set."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")


def curves(folder: Path) -> verdicts.Curves:
    lines = (folder / "points.jsonl").read_text(encoding="utf-8").splitlines()[1:]
    return verdicts.curves_of(map(measure.point_of, map(json.loads, lines)), "antiparallelogram")


@pytest.fixture(scope="module")
def antiparallelogram() -> tuple[scenes.Motion, Reference]:
    motion = scenes.MOTIONS["antiparallelogram"]()
    return motion, motion.solve()


# --------------------------------------------------------------------------- what the study shows


def test_the_bridge_stays_on_the_floor_at_full_order(
    folder: Path, antiparallelogram: tuple[scenes.Motion, Reference]
) -> None:
    """Through six crossings the error is RK4's own, of order 4, at every step; DOP853's too."""
    found, accuracy = curves(folder), antiparallelogram[1].accuracy
    assert found["bridge, RK4"][0].error < 1e-5
    assert verdicts.order(found["bridge, RK4"], accuracy) == pytest.approx(4.0, abs=0.1)
    ratio = verdicts.over_floor(found, "bridge, RK4", accuracy)
    assert ratio == pytest.approx(1.0, abs=1e-2)
    assert verdicts.over_floor(found, "bridge, DOP853", accuracy) == pytest.approx(1.0, abs=0.1)
    assert max(p.closure for p in found["bridge, RK4"] if p.good) < 1e-12


def test_others_are_lost_at_the_first_crossings_and_say_when(folder: Path) -> None:
    """Classical GCP from the previous q_d and the unstabilised implicit equations leave the mode."""
    for name in ("classical GCP, RK4", "KKT (2), RK4"):
        tried = [p for p in curves(folder)[name] if p.timed]
        assert tried
        assert all(p.lost is not None and 0.0 < p.lost < 2.5 for p in tried), name


def test_the_command_leaves_data_tables_and_figures(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert {"points.csv", "points.json", "points.jsonl", "report.md", "table.md"} <= names
    assert {f"work_precision_antiparallelogram{suffix}" for suffix in (".png", ".pdf")} <= names
    data = json.loads((folder / "points.json").read_text(encoding="utf-8"))
    assert len(data["points"]) == sum(len(curve) for curve in curves(folder).values())
    assert {"cpu", "cores", "os", "packages", "threads", "commit"} <= set(data["machine"])
    assert "1.000 (Python)" in (folder / "table.md").read_text(encoding="utf-8")


def test_a_second_run_goes_on_from_the_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that is there is run again; what was cut off while being written is."""
    path = folder / "points.jsonl"
    whole = path.read_text(encoding="utf-8")
    monkeypatch.setattr(command, "tell", lambda *_: None)  # drawn once is enough
    monkeypatch.setattr(ours.Ours, "run", lambda *_: pytest.fail("measured again"))
    monkeypatch.setattr(Implicit, "run", lambda *_: pytest.fail("measured again"))
    monkeypatch.setattr(ours.Floor, "run", lambda *_: pytest.fail("measured again"))
    assert main(arguments(folder)) == 0
    assert path.read_text(encoding="utf-8") == whole
    monkeypatch.undo()
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setattr(command, "tell", lambda *_: None)
    path.write_text(whole[: len(whole) - 40], encoding="utf-8")
    assert main(arguments(folder)) == 0
    again, before = path.read_text(encoding="utf-8").splitlines(), whole.splitlines()
    assert again[:-1] == before[:-1]
    last, lost = json.loads(again[-1]), json.loads(before[-1])
    assert (last["contender"], last["setting"], last["error"]) == (
        lost["contender"], lost["setting"], lost["error"],
    )  # fmt: skip


def test_points_of_other_settings_are_not_mixed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments(folder, "--repeats", "2")) == 2
    message = capsys.readouterr().err
    assert "repeats" in message
    assert "--fresh" in message


def test_unknown_methods_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reports", "work-precision", "--quick", "--method", "magic", "--out", str(tmp_path)]) == 2
    assert "magic" in capsys.readouterr().err


def test_the_command_measures_with_one_thread(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where the number of BLAS threads is not set, it runs itself again in a process where it is."""
    for name in machine.THREADS:
        monkeypatch.delenv(name, raising=False)
    seen: dict[str, Any] = {}

    def called(given: list[str], env: dict[str, str], check: bool) -> subprocess.CompletedProcess[str]:
        seen.update(given=given, env=env)
        return subprocess.CompletedProcess(given, 7)

    monkeypatch.setattr(command.subprocess, "run", called)
    assert (
        main(
            [
                "reports",
                "work-precision",
                "--quick",
                "--scene",
                "kite",
                "--cap",
                "0.5",
                "--out",
                str(tmp_path),
            ]
        )
        == 7
    )
    assert all(seen["env"][name] == "1" for name in machine.THREADS)
    assert seen["given"][2:] == [
        "robust_gcp", "reports", "work-precision", "--out", str(tmp_path),
        "--scene", "kite", "--quick", "--cap", "0.5",
    ]  # fmt: skip


# --------------------------------------------------------------------------- judging


def outcome_of(reference: Reference, n: int = 401) -> Outcome:
    return Outcome(reference.q[:n].copy(), reference.v[:n].copy(), 1.0, 100)


def test_the_exact_motion_has_no_error(antiparallelogram: tuple[scenes.Motion, Reference]) -> None:
    motion, reference = antiparallelogram
    found = Judge(motion.scene, reference).judge(outcome_of(reference))
    assert found["error"] == 0.0
    assert found["lost"] is None
    assert found["closure"] < 1e-14
    assert found["energy"] == 0.0


def test_surviving_on_another_mode_is_a_failure(antiparallelogram: tuple[scenes.Motion, Reference]) -> None:
    """A run that goes on smoothly but elsewhere is lost, from the time it left; so is one a turn off."""
    motion, reference = antiparallelogram
    judge = Judge(motion.scene, reference)
    for shift in (1.0, 2.0 * np.pi):
        outcome = outcome_of(reference)
        outcome.q[200:, 1] += shift
        found = judge.judge(outcome)
        assert found["lost"] == motion.scene.times[200]
        assert found["error"] == pytest.approx(shift)


def test_a_run_that_stops_is_lost_where_it_stopped(
    antiparallelogram: tuple[scenes.Motion, Reference],
) -> None:
    motion, reference = antiparallelogram
    judge = Judge(motion.scene, reference)
    assert judge.lost(outcome_of(reference, 100)) == motion.scene.times[100]
    broken = outcome_of(reference)
    broken.q[300:] = np.nan
    assert judge.lost(broken) == motion.scene.times[300]


def test_a_slide_is_compared_in_lengths() -> None:
    motion = scenes.flyball()
    mechanism = motion.scene.mechanism
    reference = Reference(np.zeros((401, 4)), np.zeros((401, 4)), 0.0, "")
    q = np.zeros((401, 4))
    q[:, mechanism.joint("s").idx_q] = 0.2 * mechanism.length
    assert Judge(motion.scene, reference).errors(q)[0] == pytest.approx(0.2)


class Slow:
    """A contender whose time is 1 s at the coarsest of its steps."""

    name, family, stepper, kind, tuning = "slow", "test", "rk4", "fixed", ""

    def __init__(self, reference: Reference) -> None:
        self.calls: list[float] = []
        self._reference = reference

    def refuses(self, scene: Scene) -> str:
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        self.calls.append(setting)
        outcome = outcome_of(self._reference)
        outcome.seconds = float(scene.times[1]) / setting
        return outcome


def test_runs_beyond_the_cap_are_left_out_and_say_so(
    antiparallelogram: tuple[scenes.Motion, Reference],
) -> None:
    """1 s at one step an interval, a cap of 2.5 s: four are among the first six settings, eight too long."""
    motion, reference = antiparallelogram
    contender: Any = Slow(reference)
    settings = [float(motion.scene.times[1]) / k for k in (1, 2, 4, 8)]
    judge = Judge(motion.scene, reference)
    points = list(measure.climb(contender, motion, judge, settings, {}, 3, 2.5))
    assert [p.timed for p in points] == [True, True, True, False]
    assert points[3].why == "not run: 8.0 s predicted, 7.5 s allowed"
    assert contender.calls == [settings[0], *(s for s in settings[:3] for _ in range(2))]


# --------------------------------------------------------------------------- contenders


def test_the_implicit_equations_are_those_of_the_package() -> None:
    """Without gains a is `implicit_dynamics`'; with them φ̈ + 2 α φ̇ + α² φ = 0 at an open loop."""
    mechanism = rg.load("crank_rocker")
    q, v = mechanism.home, mechanism.lift(mechanism.home, [2.0])
    a = Equations(mechanism, 0.0, False)(0.0, np.concatenate([q, v]))[3:]
    np.testing.assert_allclose(a, rg.implicit_dynamics(mechanism, q, v)[0], rtol=1e-12)
    q, v = q + [0.0, 1e-3, -2e-3], v + [0.0, 0.3, 0.1]
    a = Equations(mechanism, 3.0, False)(0.0, np.concatenate([q, v]))[3:]
    defect = mechanism.K(q) @ a - mechanism.k(q, v) + 6.0 * (mechanism.K(q) @ v) + 9.0 * mechanism.phi(q)
    np.testing.assert_allclose(defect, 0.0, atol=1e-12)


def test_tuned_gains_are_the_best_of_the_scan(antiparallelogram: tuple[scenes.Motion, Reference]) -> None:
    motion, reference = antiparallelogram
    calls = []

    def exact(scene: Scene) -> Any:
        calls.append(scene.name)
        return reference.q

    tuned = TunedImplicit("tuned", "rk4", exact)
    best = tuned.gain(motion.scene)
    assert tuned.gain(motion.scene) == best
    assert calls == ["antiparallelogram"]
    step = float(motion.scene.times[1]) / 2
    judge = Judge(motion.scene, reference)

    def error(gain: float) -> float:
        outcome = Implicit("fixed", "rk4", gain).run(motion.scene, step)
        return float(judge.errors(outcome.q).max()) if len(outcome.q) == 401 else np.inf

    assert error(best) <= min(error(0.5 * best / 1.5), error(3.0 * best))


def test_methods_that_do_not_apply_say_why() -> None:
    flyball, andrews = scenes.flyball().scene, scenes.andrews().scene
    made: dict[str, Contender] = {c.name: c for c in ours.contenders(lambda _: np.zeros(0))}
    assert made["bridge, RK4"].refuses(flyball) == ""
    assert "no loop" in made["classical GCP, RK4"].refuses(flyball)
    assert "no loop" in made["KKT (2) Baumgarte tuned, RK4"].refuses(flyball)
    assert "four-bar" in made["closed form, RK4"].refuses(andrews)
    assert made["KKT (2), RK4"].refuses(andrews) == ""
    assert len(made) == len(ours.contenders(lambda _: np.zeros(0)))  # names are unique


def test_a_coarse_adaptive_run_keeps_count_of_turns() -> None:
    """Steps of several radians: the dependent joints are followed, not caught a turn off."""
    motion = scenes.MOTIONS["crank_rocker"]()
    times = motion.scene.times[::40]
    options: Any = {"stepper": "DOP853", "rtol": 1e-3, "atol": 1e-3}
    scene = motion.scene
    run = rg.simulate(scene.mechanism, scene.q0, scene.v0, float(times[-1]), float(times[1]), **options)
    fine = rg.simulate(
        scene.mechanism, scene.q0, scene.v0, float(times[-1]), float(times[1]),
        stepper="DOP853", rtol=1e-9, atol=1e-9,
    )  # fmt: skip
    assert np.abs(run.q - fine.q).max() < 0.1


# --------------------------------------------------------------------------- labels


def test_labels_keep_clear_of_markers_lines_and_each_other() -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    labels = Labels(ax)
    written = sum(labels.put(0.5, 0.5, "12.5 ms", "k") for _ in range(20))
    assert 1 <= written <= 6
    boxes = [text.get_window_extent() for text in ax.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[i + 1 :])
    for y in np.linspace(0.1, 0.9, 60):
        labels.block_line((0.0, y), (0.3, y))
    assert not labels.put(0.15, 0.5, "12.5 ms", "k")


# --------------------------------------------------------------------------- verdicts


def ladder(name: str, family: str, errors: list[float], kind: str = "fixed") -> list[Point]:
    """Points at h = 0.1, 0.05, …, 1 s at the coarsest and twice as long at each next."""
    return [
        Point("s", name, family, "rk4", kind, 0.1 / 2**i, 2.0**i, 2.0**i, 2.0**i, 1, 100 * 2**i, error,
              lost=None if error < 0.3 else 0.7)
        for i, error in enumerate(errors)
    ]  # fmt: skip


def test_time_to_an_error_is_read_between_points() -> None:
    """Order 4, twice the time a step: 16^-½ of the error takes 2^½ of the time."""
    curve = ladder("a", "bridge", [1e-2, 1e-2 / 16, 1e-2 / 256])
    reached = verdicts.reach(curve, 1e-2 / 16**1.5)
    assert reached is not None
    assert reached.seconds == pytest.approx(2.0**1.5)
    assert reached.rhs == pytest.approx(100 * 2.0**1.5)
    assert verdicts.reach(curve, 1e-9) is None
    assert verdicts.reach(curve, 0.1) == ("a", 1.0, 100.0)


def test_a_failure_before_a_good_point_is_not_interpolated() -> None:
    assert verdicts.reach(ladder("a", "x", [5.0, 1e-7]), 1e-6) == ("a", 2.0, 200.0)


def test_an_error_that_rises_again_was_luck() -> None:
    """Rounding may lift a curve a little; a finer setting that is lost or far off unmakes it."""
    assert verdicts.reach(ladder("a", "x", [1e-4, 1e-7, 9e-6]), 1e-6) is not None
    assert verdicts.reach(ladder("a", "x", [1e-4, 1e-7, 2e-5]), 1e-6) is None
    assert verdicts.reach(ladder("a", "x", [1e-4, 1e-7, 5.0]), 1e-6) is None
    assert verdicts.reach(ladder("a", "x", [1e-4, 1e-7, 5.0, 1e-7]), 1e-6) == ("a", 8.0, 800.0)


def test_the_observed_order_is_the_slope() -> None:
    assert verdicts.order(ladder("a", "x", [9.0, 0.01, 0.01 / 8, 0.01 / 64]), 1e-13) == pytest.approx(3.0)
    assert verdicts.order(ladder("a", "x", [0.01, 0.001]), 1e-13) is None
    assert verdicts.order(ladder("a", "x", [0.01, 0.001, 1e-4], "adaptive"), 1e-13) is None


def test_the_table_says_plainly_where_a_peer_is_faster() -> None:
    reference = Reference(np.zeros((1, 1)), np.zeros((1, 1)), 1e-13, "")
    found = {
        "bridge, RK4": ladder("bridge, RK4", "bridge", [1e-5, 1e-7, 1e-11]),
        "tool": ladder("tool", "Tool", [1e-7, 1e-8]),
        "floor, RK4": ladder("floor, RK4", "floor", [1e-5, 1e-7, 1e-11]),
    }
    row = verdicts.ratios([("scene", found, reference)]).splitlines()[2]
    assert row.startswith("| 1e-06, 1e-08 | scene | 1 (tool) | 1.4 (tool) | 1.2 (tool) |")
    assert "| ours alone (best 1e-08, tool) | 1.000 (Python) | 1e-13 |" in row
    row = verdicts.seconds([("scene", found, reference)]).splitlines()[2]
    assert row.startswith("| scene | 1.4 s, 1.4e+02 ev., RK4 | 1 s, 1e+02 ev., tool |")
    assert "not reached (1e-08, tool)" in row
    found["bridge, RK4"][1].error = 1.2e-7
    assert "1.200 (Python)" in verdicts.ratios([("scene", found, reference)])
    found["bridge, RK4"] = found["bridge, RK4"][:1]
    row = verdicts.ratios([("scene", found, reference)]).splitlines()[2]
    assert row.startswith("| 1e-06, 1e-08 | scene |")
    assert "not reached, tool does" in row


def test_a_run_that_went_beyond_all_numbers_is_judged_as_lost(
    antiparallelogram: tuple[scenes.Motion, Reference],
) -> None:
    motion, reference = antiparallelogram
    outcome = outcome_of(reference)
    outcome.q, outcome.v = outcome.q.copy(), outcome.v.copy()
    outcome.q[200:], outcome.v[200:] = 1e200, -1e200
    found = Judge(motion.scene, reference).judge(outcome)
    assert found["lost"] == motion.scene.times[200]
    assert found["error"] > 1e199
    assert found["energy"] == np.inf


def test_any_number_of_contenders_can_be_drawn() -> None:
    found = looks([(f"tuning {i}", "Pinocchio") for i in range(60)])
    assert len(found) == 60
    assert len({look["color"] for look in found.values()}) == 1
