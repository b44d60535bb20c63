"""Mocap bodies and bases that move as prescribed: motions in frames that move, in closed form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf

TABLE = """<mujoco><option><flag contact="disable"/></option><worldbody>
<body name="table" pos="0 0 1"><geom type="box" size="0.5 0.5 0.05"/><site name="corner" pos="0.5 0.5 0"/>
  <body name="arm" pos="0.1 0 0"><joint name="q" axis="0 1 0"/><geom size="0.1" pos="0 0 -1"/></body></body>
</worldbody></mujoco>"""

HELD = """<mujoco><option><flag contact="disable"/></option><worldbody>
<body name="target" mocap="true" pos="0 1 0"><site name="goal"/></body>
<body name="a"><joint name="q1" axis="1 0 0"/><geom type="capsule" size="0.05" fromto="0 0 0 0 1 0"/>
  <body name="b" pos="0 1 0"><joint name="q2" axis="1 0 0"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0 1 0"/><site name="tip" pos="0 1 0"/></body></body>
</worldbody><equality><connect site1="tip" site2="goal"/></equality>
<keyframe><key name="home" qpos="1.0471975511965976 -2.0943951023931953"/></keyframe></mujoco>"""


def test_a_pendulum_on_a_shaken_table_feels_its_acceleration() -> None:
    """In the table's frame gravity is g − ẍ: the same motion as with the force −m ẍ at the bob."""
    shaken = rg.Mechanism.from_mjcf(TABLE, moving={"table": ("x",)})
    still = rg.Mechanism.from_mjcf(TABLE)
    assert shaken.moved == ("table_x",) and shaken.joint_names == ("table_x", "q")
    w, size = 7.0, 0.1
    run = rg.simulate(
        shaken, duration=1.0, step=1e-3, drive={"table_x": rg.Motion(lambda t: size * np.sin(w * t))}
    )
    m = mujoco.MjModel.from_xml_string(TABLE)
    mass = float(m.body("arm").mass[0])

    def felt(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([mass * size * w**2 * np.sin(w * t) * -np.cos(q[0])])

    # the bob is at (−sin q, −cos q): the force F along x has the moment −F cos q about y
    v0 = [0.0]
    apart = rg.simulate(still, v0=v0, duration=1.0, step=1e-3, torque=felt)
    np.testing.assert_allclose(run["q"], apart["q"], atol=1e-9)
    np.testing.assert_allclose(run.frame("corner").position[:, 0], 0.5 + size * np.sin(w * run.t), atol=1e-12)


def test_what_no_drive_moves_holds_still() -> None:
    moved, still = rg.Mechanism.from_mjcf(TABLE, moving={"table": ("z", "ry")}), rg.Mechanism.from_mjcf(TABLE)
    q0 = [0.0, 0.0, 0.5]
    run = rg.simulate(moved, q0, duration=0.3, step=1e-3)
    np.testing.assert_allclose(run["q"], rg.simulate(still, [0.5], duration=0.3, step=1e-3)["q"], atol=1e-12)
    sim = rg.Simulation(moved, q0, step=1e-3).step(n=300)
    np.testing.assert_allclose(sim.q, run.q[-1], atol=1e-12)
    np.testing.assert_allclose(sim.frame("table").position, [0.0, 0.0, 1.0], atol=1e-15)
    for many in rg.simulate_many(moved, 2 * [(q0, None)], 0.3, 1e-3):
        np.testing.assert_array_equal(many.q, run.q)


def test_what_does_not_hold_it_still_says_so(tmp_path: Path) -> None:
    mech = rg.Mechanism.from_mjcf(TABLE, moving={"table": ("x",)})
    for call in (
        lambda: rg.forward_dynamics(mech, [0.0, 0.1]),
        lambda: rg.derivatives(mech, [0.0, 0.1]),
    ):
        with pytest.raises(rg.OptionError, match="table_x move the ground"):
            call()
    with pytest.warns(rg.ModelWarning, match=r"joints move the ground.*\(table_x\)"):
        mech.write(tmp_path / "table.xml")
    run = rg.simulate(mech, duration=0.01, step=1e-3, drive={"table_x": rg.Motion(lambda t: 0.1 * t)})
    assert rg.load_trajectory(run.save(tmp_path / "run.npz")).mechanism.moved == ("table_x",)


def test_a_mocap_body_that_holds_a_loop_leads_it() -> None:
    """A dyad of two unit links whose tip follows the target: its angles are those of a triangle."""
    assert read_mjcf(HELD).left_out == ["motion of mocap bodies (target)"]
    mech = rg.Mechanism.from_mjcf(HELD, home="home", moving={"target": ("y", "z")})
    assert mech.left_out == () and mech.m == 2
    way = {"target_y": rg.Motion(lambda t: 0.3 * np.sin(3 * t)), "target_z": rg.Motion(lambda t: 0.2 * t)}
    run = rg.simulate(mech, mech.home, duration=1.0, step=1e-2, drive=way)
    y, z = 1.0 + 0.3 * np.sin(3 * run.t), 0.2 * run.t
    half = np.arccos(0.5 * np.hypot(y, z))
    np.testing.assert_allclose(run["q1"], np.arctan2(z, y) + half, atol=1e-10)
    np.testing.assert_allclose(run["q2"], -2.0 * half, atol=1e-10)
    np.testing.assert_allclose(run.frame("tip").position[:, 1:], np.stack([y, z]).T, atol=1e-10)


def test_turned_bodies_stand_as_the_file_has_them() -> None:
    """At zero of the joints; the joints move along the ground's axes, each in those before it."""
    text = TABLE.replace('pos="0 0 1"', 'pos="0 0 1" euler="10 20 30"')
    moved, still = (rg.Mechanism.from_mjcf(text, moving=m) for m in ({"table": ("rz", "x", "ry")}, None))
    for frame in ("corner", "arm"):
        poses = [
            rg.Trajectory(m, np.zeros(1), np.zeros((1, m.nq)), np.zeros((1, m.nv)), np.zeros((1, m.nv)))
            .frame(frame)
            .placement[0]
            for m in (moved, still)
        ]
        np.testing.assert_allclose(*poses, atol=1e-14)
    q = np.array([[np.pi / 2, 0.3, 0.0, 0.0]])
    run = rg.Trajectory(moved, np.zeros(1), q, np.zeros((1, 4)), np.zeros((1, 4)))
    np.testing.assert_allclose(run.frame("table").position[0], [0.0, 0.3, 1.0], atol=1e-15)  # x turned by rz


@pytest.mark.parametrize(
    ("moving", "words"),
    [
        ({"tabel": ("x",)}, "no such body.*table"),
        ({"arm": ("x",)}, "has joints"),
        ({"table": ("x", "x")}, "each once"),
        ({"table": ("w",)}, "must be one of x, y, z, rx"),
    ],
)
def test_what_cannot_be_moved_is_refused(moving: dict[str, tuple[str, ...]], words: str) -> None:
    with pytest.raises(rg.ModelError, match=words):
        rg.Mechanism.from_mjcf(TABLE, moving=moving)


@pytest.mark.parametrize("suffix", ["xml", "mjcf"])
def test_what_moves_is_told_to_load_too(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"table.{suffix}"
    file.write_text(TABLE)
    assert rg.load(file, moving={"table": ("x",)}).moved == ("table_x",)


def test_wrong_words_for_what_moves(tmp_path: Path) -> None:
    for moving in (["table"], {"table": "x"}, {"table": (1,)}):
        with pytest.raises(rg.OptionError, match="moving = "):
            rg.Mechanism.from_mjcf(TABLE, moving=moving)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="base='free'"):
        rg.Mechanism.from_mjcf(TABLE, moving={"table": ("x",)}, base="free")
    with pytest.raises(rg.OptionError, match="moving= is for MJCF"):
        rg.load("rhombus", moving={"table": ("x",)})


def test_programs_without_python_and_impulses_do_not_know_it(tmp_path: Path) -> None:
    """There the table was free: written without a word, and pushed away by an impulse."""
    mech = rg.Mechanism.from_mjcf(TABLE, moving={"table": ("x",)})
    for name in ("table.rgcp", "table.fmu"):
        with pytest.raises(rg.ModelError, match="moving="):
            mech.export(tmp_path / name)
    with pytest.raises(rg.OptionError, match="impact does not know"):
        mech.impact([0.0, 0.3], [0.0, 1.0], [rg.Stop("q", upper=0.3)])
