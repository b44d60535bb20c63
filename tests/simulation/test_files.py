"""Trajectories written and read back: every digit, the mechanism that moved, and nothing else's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg

EVERYTHING = ("a", "energy", "multipliers")


@pytest.fixture(scope="module")
def swing() -> rg.Trajectory:
    """Through two crossings, with everything recorded."""
    return rg.simulate(
        rg.load("rhombus"), duration=1.0, step=2e-3, record=EVERYTHING, torque=[0.01, 0.0, 0.0]
    )


def same(a: rg.Trajectory, b: rg.Trajectory) -> None:
    for name in ("t", "q", "v", "a", "energy", "multipliers", "work"):
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            np.testing.assert_array_equal(x, y)
    assert a.stats == b.stats
    assert len(a.crossings) == len(b.crossings)
    for one, other in zip(a.crossings, b.crossings, strict=True):
        assert (one.time, one.kind, one.certificate) == (other.time, other.kind, other.certificate)
        assert one.transversality == pytest.approx(other.transversality, nan_ok=True)
        np.testing.assert_array_equal(one.q, other.q)
        np.testing.assert_array_equal(one.y, other.y)


def test_what_is_saved_comes_back(swing: rg.Trajectory, tmp_path: Path) -> None:
    path = swing.save(tmp_path / "swing.npz")
    again = rg.load_trajectory(path)
    assert len(again.crossings) == 2
    same(swing, again)
    mech = again.mechanism
    assert (mech.name, mech.independent, mech.closures) == ("rhombus", ("q1",), swing.mechanism.closures)
    assert mech.model == swing.mechanism.model
    np.testing.assert_array_equal(again.closure_error(), swing.closure_error())


def test_every_mechanism_comes_back(mechanisms: dict[str, rg.Mechanism], tmp_path: Path) -> None:
    """Springs, dampers, all kinds of closures, quaternions."""
    for name, mech in mechanisms.items():
        q = np.stack([mech.home, mech.home])
        run = rg.Trajectory(mech, np.array([0.0, 1.0]), q, np.zeros((2, mech.nv)))
        again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
        same(run, again)
        assert again.mechanism.closures == mech.closures, name
        assert again.mechanism.forces == mech.forces
        assert again.mechanism.model == mech.model
        np.testing.assert_array_equal(again.mechanism.home, mech.home)


def test_what_a_robots_file_told_comes_back(tmp_path: Path) -> None:
    """Motors and what is not simulated, and an idle spin among the coordinates."""
    ends = '<geom type="capsule" size="0.02" fromto="0 0 0 0 1 0"/>'
    text = f"""<mujoco><worldbody><body name="a"><joint name="q1" axis="1 0 0" frictionloss="1"/>{ends}
    <body name="rod" pos="0 1 0"><joint name="ball" type="ball"/>{ends}</body></body>
    <body name="b" pos="0 1 0"><joint name="q3" axis="1 0 0"/>{ends}</body></worldbody>
    <equality><connect body1="rod" body2="b" anchor="0 1 0"/></equality>
    <actuator><motor joint="q1"/></actuator></mujoco>"""
    with pytest.warns(rg.ModelWarning, match="dry friction"):
        mech = rg.Mechanism.from_mjcf(
            text, ["q1", "ball.ry"], home=[0.3, -0.1494381, 0.0, 0.0, 0.9887711, 0.3]
        )
    run = rg.simulate(mech, mech.assemble(mech.home), duration=0.02, step=0.01)
    again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    same(run, again)
    told = again.mechanism
    assert (told.actuated, told.left_out, told.independent) == (
        mech.actuated,
        mech.left_out,
        mech.independent,
    )
    assert told.actuated == ("q1",)
    assert len(told.left_out) > 1


def test_coordinates_that_changed_come_back(swing: rg.Trajectory, tmp_path: Path) -> None:
    stats = rg.Stats(rhs=7, repartitions=[(0.25, ("q2",))], refined=[(0.1, 0.2), (0.3, 0.4)])
    run = rg.Trajectory(swing.mechanism, swing.t, swing.q, swing.v, stats=stats)
    assert rg.load_trajectory(run.save(tmp_path / "run.npz")).stats == stats


def test_a_stopped_run_without_times(swing: rg.Trajectory, tmp_path: Path) -> None:
    run = rg.Trajectory(swing.mechanism, swing.t[:0], swing.q[:0], swing.v[:0])
    same(run, rg.load_trajectory(run.save(tmp_path / "run.npz")))


def test_a_given_mechanism_is_checked(swing: rg.Trajectory, tmp_path: Path) -> None:
    path = swing.save(tmp_path / "swing.npz")
    own = rg.load("rhombus")
    assert rg.load_trajectory(path, own).mechanism is own
    with pytest.raises(rg.OptionError, match=r"(loops|inertias) are at the start not those"):
        rg.load_trajectory(path, rg.load("parallelogram"))
    with pytest.raises(rg.OptionError, match=r"\(nq, nv\) = \(3, 3\)"):
        rg.load_trajectory(path, rg.load("andrews"))
    sprung = rg.Mechanism(own.model, own.closures, ["q1"], own.home, "sprung", [rg.JointTorque("q1", 1.0)])
    with pytest.raises(rg.OptionError, match="gravity or forces are at the start not those"):
        rg.load_trajectory(path, sprung)


def test_files_that_are_none(swing: rg.Trajectory, tmp_path: Path) -> None:
    with pytest.raises(rg.OptionError, match=r"ends in \.npz"):
        swing.save(tmp_path / "swing.csv")
    other = tmp_path / "other.npz"
    np.savez(other, t=swing.t)
    with pytest.raises(rg.OptionError, match="not a trajectory"):
        rg.load_trajectory(other)
    other.write_bytes(b"no archive")
    with pytest.raises(rg.OptionError, match="not a trajectory"):
        rg.load_trajectory(other)
    np.savez(other, meta=np.array([{"format": 1}], dtype=object))  # a pickle is not opened
    with pytest.raises(rg.OptionError, match="not a trajectory"):
        rg.load_trajectory(other)
    with pytest.raises(FileNotFoundError):
        rg.load_trajectory(tmp_path / "none.npz")


def test_damage_is_noticed(swing: rg.Trajectory, tmp_path: Path) -> None:
    """Cut at any place, or with any part missing or changed."""
    path = swing.save(tmp_path / "swing.npz")
    whole = path.read_bytes()
    torn = tmp_path / "torn.npz"
    for length in (0, 10, len(whole) // 2, len(whole) - 1):
        torn.write_bytes(whole[:length])
        with pytest.raises(rg.OptionError):
            rg.load_trajectory(torn)
    with np.load(path) as archive:
        parts = {name: archive[name] for name in archive.files}
    for name in ("model", "home", "q", "crossing_time", "check_K", "meta"):
        np.savez(torn, **{key: value for key, value in parts.items() if key != name})
        with pytest.raises(rg.OptionError):
            rg.load_trajectory(torn)
    model = parts["model"].copy()
    model[100] ^= 1
    np.savez(torn, **{**parts, "model": model})
    with pytest.raises(rg.OptionError, match="the stored model is not what was written"):
        rg.load_trajectory(torn)
    same(swing, rg.load_trajectory(torn, rg.load("rhombus")))


def test_data_frame(swing: rg.Trajectory) -> None:
    pandas = pytest.importorskip("pandas")
    frame = swing.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == [name for name in swing.columns() if name != "t"]
    np.testing.assert_array_equal(frame.index, swing.t)
    np.testing.assert_array_equal(frame["v.q2"], swing.v[:, 1])


def test_without_pandas(swing: rg.Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(rg.MissingExtraError, match="pandas"):
        swing.to_dataframe()
