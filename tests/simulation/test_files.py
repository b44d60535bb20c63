"""Trajectories written and read back: every digit, the mechanism that moved, and nothing else's."""

from __future__ import annotations

import errno
import io
import zipfile
from collections.abc import Callable
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
    with pytest.raises(rg.MissingFileError, match=r"none\.npz.* there is no such file"):
        rg.load_trajectory(tmp_path / "none.npz")
    assert issubclass(rg.MissingFileError, FileNotFoundError)


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


@pytest.fixture(scope="module")
def short() -> rg.Trajectory:
    """Two outputs and one crossing, so that an archive is mostly structure."""
    return rg.simulate(rg.load("rhombus"), duration=0.3, step=0.15)


def test_spoilt_bytes_are_refused_or_change_nothing(short: rg.Trajectory, tmp_path: Path) -> None:
    """Whatever byte of an archive is changed: an error of ours, or the same motion."""
    whole, spoilt = short.save(tmp_path / "a.npz").read_bytes(), tmp_path / "b.npz"
    central = whole.index(b"PK\1\2")
    places = [*range(central, len(whole)), *range(0, central, 97)]
    rng, refused = np.random.default_rng(3), 0
    for place in places[:: max(1, len(places) // 600)]:
        changed = bytearray(whole)
        changed[place] ^= int(rng.choice([1, 2, 8, 64, 255]))
        spoilt.write_bytes(changed)
        try:
            same(short, rg.load_trajectory(spoilt))
        except rg.OptionError:
            refused += 1
    assert refused > 200


@pytest.mark.parametrize("name", ["t", "q", "v", "energy", "work", "crossing_q", "home"])
@pytest.mark.parametrize("how", ["shorter", "flat", "deep", "text", "none"])
def test_arrays_that_do_not_belong_together(
    short: rg.Trajectory, name: str, how: str, tmp_path: Path
) -> None:
    run = rg.Trajectory(short.mechanism, short.t, short.q, short.v, crossings=short.crossings)
    run.energy = run.work = np.arange(len(run.t), dtype=float)
    with np.load(run.save(tmp_path / "a.npz")) as archive:
        parts = {key: archive[key] for key in archive.files}
    part = parts[name]
    change = {
        "shorter": part[:-1], "flat": part.ravel()[:1], "deep": part[None], "text": np.array(["x"]),
        "none": np.array(None),
    }  # fmt: skip
    np.savez(tmp_path / "b.npz", **{**parts, name: change[how]})
    with pytest.raises(rg.OptionError):
        rg.load_trajectory(tmp_path / "b.npz")


def test_what_unfolds_beyond_its_file_is_refused_unread(short: rg.Trajectory, tmp_path: Path) -> None:
    """A compressed archive, and an array that claims a terabyte in its header."""
    with np.load(short.save(tmp_path / "a.npz")) as archive:
        parts = {key: archive[key] for key in archive.files}
    np.savez_compressed(tmp_path / "b.npz", **{**parts, "q": np.zeros((10_000_000, 3))})
    with pytest.raises(rg.OptionError, match="compressed"):
        rg.load_trajectory(tmp_path / "b.npz")
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**11,)})
    with zipfile.ZipFile(tmp_path / "c.npz", "w") as made:
        made.writestr("meta.npy", header.getvalue())
    with pytest.raises(rg.OptionError, match="100000000000"):
        rg.load_trajectory(tmp_path / "c.npz")
    deep = np.frombuffer(b"[" * 100_000, dtype=np.uint8)
    np.savez(tmp_path / "d.npz", **{**parts, "meta": deep})
    with pytest.raises(rg.OptionError, match="not a trajectory"):
        rg.load_trajectory(tmp_path / "d.npz")


@pytest.mark.parametrize("write", [rg.Trajectory.save, rg.Trajectory.to_csv])
def test_a_full_disk_is_told_and_leaves_the_old_file(
    short: rg.Trajectory, write: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")

    def full(self: Path, target: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(rg.OptionError, match=r"run\.npz cannot be written \(No space left on device\)"):
        write(short, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(rg.OptionError, match="cannot be written"):
        write(short, tmp_path / "no such folder" / "run.npz")
