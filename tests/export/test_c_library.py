"""The C library: the same bits as Python, and typed refusals of all that is no mechanism."""

from __future__ import annotations

import platform
import random
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

if not rg.backends()["native"].available:
    pytest.skip("no compiled kernel", allow_module_level=True)

from robust_gcp.export.description import described
from robust_gcp.kernel.library import NAME, _installed

from .c_library import LIB, CMotion, Exported, StoppedError
from .spoilt import spoilt

STILL = ("andrews", "flyball", "five_bar", "kite")
"""Too stiff for the step here, or in other coordinates after a while."""
SCENES = [name for name in rg.model_names() if name not in STILL]


def _torques(mech: rg.Mechanism, rng: np.random.Generator) -> Any:
    tau = np.zeros(mech.nv)
    tau[mech.iv_independent] = rng.normal(size=mech.m) * (1.0 if mech.m == 1 else 0.1)
    return tau


@pytest.mark.parametrize("name", SCENES)
def test_the_same_bits_as_python(name: str, tmp_path: Path) -> None:
    mech, rng = rg.load(name), np.random.default_rng(1)
    exported = Exported(mech.export(tmp_path / f"{name}.rgcp"))
    c = exported.counts
    assert (c.nq, c.nv, c.m, c.controls) == (mech.nq, mech.nv, mech.m, len(mech.actuators))
    assert LIB.rgcp_joints(exported.handle).decode().split("\n") == list(mech.joint_names)
    there, here = CMotion(exported).begin(t=0.5), rg.Simulation(mech, t0=0.5, keep="last")
    for k in range(12):
        tau = _torques(mech, rng)
        there.step(1e-3, 60, tau)
        here.step(tau, 60)
        for name_, ours in (("q", here.q), ("v", here.v), ("G", here._run.toward)):
            np.testing.assert_array_equal(getattr(there, name_), ours)
        if k == 5:
            saved = there.save()
    assert there.crossings == len(here.crossings) and there.time == here.t
    end = there.q
    rng = np.random.default_rng(1)
    for _ in range(6):
        _torques(mech, rng)
    again = CMotion(exported).restore(saved)
    for _ in range(6):
        again.step(1e-3, 60, _torques(mech, rng))
    np.testing.assert_allclose(again.q, end, rtol=0.0, atol=1e-12 if there.crossings else 0.0)


@pytest.mark.parametrize("name", SCENES)
def test_motions_hang_on_the_state_alone(name: str) -> None:
    """However the steps are told, and from bytes: what was done on the way leaves no trace."""
    mech = rg.load(name)
    exported, u = Exported(described(mech)), np.full(mech.m, 0.5)
    once = CMotion(exported).begin(mech.home, u).step(1e-3, 600)
    here = rg.Simulation(mech, mech.home, mech.lift(mech.home, u), keep="last")
    batch = rg.Batch(mech, 1, mech.home, mech.lift(mech.home, u), specialise=False)
    one, again = CMotion(exported).begin(mech.home, u), CMotion(exported).begin(mech.home, u)
    for _ in range(12):
        one.step(1e-3, 50)
        again = CMotion(exported).restore(again.save()).step(1e-3, 50)
        here.step(None, 50), batch.step(None, 50)
    for found in (one.q, again.q, here.q, batch.q[0]):
        np.testing.assert_array_equal(found, once.q)


def test_a_joint_that_its_loop_holds_fast(tmp_path: Path) -> None:
    """By more rows than it has velocities."""
    model, body = pin.Model(), pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4)
    at = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
    turning = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "turning")
    held = model.addJoint(turning, pin.JointModelRX(), at, "held")
    for joint in (turning, held):
        model.appendBodyToJoint(joint, body, at)
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    model.addFrame(pin.Frame("end", held, at, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("start", turning, at * at, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(model, [rg.PrismaticClosure("end", "start")])
    assert mech.nc > len(mech.dependent)
    there = CMotion(Exported(mech.export(tmp_path / "held.rgcp"))).begin(mech.home, [0.5]).step(1e-3, 100)
    here = rg.Simulation(mech, v0=mech.lift(mech.home, [0.5]), keep="last").step(None, 100)
    np.testing.assert_array_equal(there.q, here.q)


def test_joints_that_turn_without_bounds(tmp_path: Path) -> None:
    """Independent ones whose numbers in q are cosine and sine."""
    model, body = pin.Model(), pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4)
    at, joint = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3])), 0
    for i, kind in enumerate((pin.JointModelRUBY(), pin.JointModelRX(), pin.JointModelRUBZ())):
        joint = model.addJoint(joint, kind, at, f"j{i}")
        model.appendBodyToJoint(joint, body, at)
    mech, v = rg.Mechanism.from_pinocchio(model), [0.3, 0.2, 0.1]
    there = CMotion(Exported(mech.export(tmp_path / "free.rgcp"))).begin(mech.home, v).step(1e-3, 200)
    here = rg.Simulation(mech, v0=v, keep="last").step(None, 200)
    np.testing.assert_array_equal(there.q, here.q)


def test_springs_along_tendons_have_no_derivatives(tmp_path: Path) -> None:
    base = rg.load("five_bar")
    spring = rg.TendonSpring(rg.FixedTendon({"q1": 1.0, "q3": 0.5}), 200.0, 0.0, 0.0, 3.0)
    mech = rg.Mechanism.from_pinocchio(
        base.model, base.closures, base.independent, base.home, forces=[spring]
    )
    motion = CMotion(Exported(mech.export(tmp_path / "sprung.rgcp"))).begin(mech.home)
    udot = rg.forward_dynamics(mech, mech.home)
    np.testing.assert_allclose(np.linalg.solve(*motion.reduced()), udot, rtol=1e-9)
    with pytest.raises(StoppedError, match="springs along tendons"):
        motion.derivatives()


@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point"])
@pytest.mark.parametrize("beside", [-6, -1, 0, 3])
def test_beginning_beside_a_singular_place(name: str, beside: int) -> None:
    mech = rg.load(name)
    run = rg.simulate(mech, mech.home, mech.lift(mech.home, [3.0]), duration=3.0, step=1e-3)
    k = int(np.searchsorted(run.t, run.crossings[0].time)) + beside
    u = run.v[k, mech.iv_independent]
    here = rg.Simulation(rg.load(name), run.q[k], run.v[k], keep="last").step(None, 400)
    there = CMotion(Exported(described(mech))).begin(run.q[k], u)
    again = CMotion(there.of).restore(there.save()).step(1e-3, 400)
    there.step(1e-3, 400)
    np.testing.assert_array_equal(there.q, here.q)
    np.testing.assert_array_equal(again.q, here.q)
    assert there.crossings == len(here.crossings) == (beside < 0)


def test_crossings_are_passed(tmp_path: Path) -> None:
    mech = rg.load("rhombus")
    motion = CMotion(Exported(mech.export(tmp_path / "rhombus.rgcp"))).begin(mech.home, [3.0])
    run = rg.simulate(mech, mech.home, mech.lift(mech.home, [3.0]), duration=3.0, step=1e-3)
    assert motion.step(1e-3, 3000).crossings == len(run.crossings) > 2
    np.testing.assert_allclose(motion.q, run.q[-1], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "delta", "walker"])
def test_equations_and_derivatives(name: str) -> None:
    mech, rng = rg.load(name), np.random.default_rng(2)
    u = rng.normal(size=mech.m) * 0.3
    motion = CMotion(Exported(described(mech))).begin(mech.home, u)
    q, v, tau = motion.q, motion.v, rng.normal(size=mech.nv)
    np.testing.assert_allclose(v, mech.G(q) @ u, atol=1e-13)
    np.testing.assert_allclose(motion.g, mech.g(q, v), atol=1e-11)
    motion.step(1e-9, 1, tau)
    q, v = motion.q, motion.v
    M, b = motion.reduced()
    G, point = mech.G(q), rg.motion_point(mech, q, v, tau)
    full = mech.tree.crba(q)
    full = np.triu(full) + np.triu(full, 1).T
    np.testing.assert_allclose(M, G.T @ full @ G, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(M, b), point.udot, rtol=1e-9, atol=1e-9)
    a, rows = motion.derivatives(tau)
    slopes = rg.derivatives(mech, q, v, tau)
    m = mech.m
    np.testing.assert_allclose(a, point.udot, rtol=1e-9, atol=1e-9)
    for part, ours in (
        (rows[:, :m], slopes.da_dy),
        (rows[:, m : 2 * m], slopes.da_dv),
        (rows[:, 2 * m :], slopes.da_dtau),
    ):
        np.testing.assert_allclose(part, ours, rtol=1e-7, atol=1e-8)


def test_controls_are_held() -> None:
    mech = rg.load("crank_rocker")
    motion, here = CMotion(Exported(described(mech))).begin(), rg.Simulation(mech, keep="last")
    for value in (0.3, -0.2):
        motion.step(1e-3, 50, None, [value])
        here.step(None, 50, ctrl=[value])
    np.testing.assert_array_equal(motion.q, here.q)


def test_coordinates_change_among_those_exported() -> None:
    mech = rg.load("kite")
    fine = rg.Simulation(mech, step=5e-4, keep="last").step({"q1": 0.05}, 4000)
    motion = CMotion(Exported(described(mech, [["q2"], ["q3"]]))).begin()
    motion.step(1e-3, 2000, [0.05, 0.0, 0.0])
    assert motion.chart > 0 or fine.trajectory.stats.repartitions
    np.testing.assert_allclose(motion.q, fine.q, rtol=0.0, atol=1e-6)
    alone = CMotion(Exported(described(mech))).begin()
    with pytest.raises(StoppedError, match="turn back"):
        alone.step(1e-3, 2000, [0.05, 0.0, 0.0])
    assert 0.5 < alone.time < 1.0


def test_threads_with_a_motion_each() -> None:
    exported = Exported(described(rg.load("rhombus")))

    def run(k: int) -> Any:
        return CMotion(exported).begin(None, [1.0 + k % 4]).step(1e-3, 2000).q

    with ThreadPoolExecutor(16) as pool:
        found = list(pool.map(run, range(16)))
    for k in range(16):
        np.testing.assert_array_equal(found[k], found[k % 4])


class TestMemory:
    """Motions in a block of their own."""

    EXPORTED = Exported(described(rg.load("rhombus")))
    ROOM = 1 << 20

    def test_the_same_bits_and_saved_ones(self) -> None:
        within, free = (CMotion(self.EXPORTED, size).begin(None, [3.0]) for size in (self.ROOM, 0))
        for _ in range(8):
            np.testing.assert_array_equal(within.step(1e-3, 100).q, free.step(1e-3, 100).q)
            saved = within.save()  # within a zone, too
            assert saved == free.save()
            within.restore(saved), free.restore(saved)
        assert within.crossings == free.crossings == 1 and free.used == 0
        used = within.used
        assert within.step(1e-3, 20000).crossings > 20
        assert 0 < used <= within.used < 200_000  # does not grow with time
        once = within.used
        assert within.step(1e-3, 20000).used == once

    def test_too_few_bytes(self) -> None:
        with pytest.raises(ValueError, match="too few bytes"):
            CMotion(self.EXPORTED, 1000)
        regular = CMotion(self.EXPORTED, self.ROOM).begin(None, [3.0]).step(1e-3, 10)
        small = CMotion(self.EXPORTED, regular.used + 256).begin(None, [3.0]).step(1e-3, 10)
        np.testing.assert_array_equal(small.q, regular.q)
        with pytest.raises(StoppedError, match="used up") as stop:
            small.step(1e-3, 1000)
        assert stop.value.status == 5
        with pytest.raises(StoppedError, match="begun"):
            small.step(1e-3, 1)
        np.testing.assert_array_equal(small.begin(None, [3.0]).step(1e-3, 10).q, regular.q)

    @pytest.mark.parametrize("name", ["rhombus", "change_point", "crank_rocker", "delta", "walker"])
    def test_prepared_motions_are_the_same_to_rounding(self, name: str) -> None:
        exported = Exported(described(rg.load(name)))
        one, other = CMotion(exported).begin(), CMotion(exported, 4 * self.ROOM).begin().prepare()
        assert other.crossings == 0
        np.testing.assert_allclose(other.step(1e-3, 1000).q, one.step(1e-3, 1000).q, rtol=0.0, atol=1e-11)
        assert one.crossings == other.crossings

    def test_preparing_within_a_zone(self) -> None:
        one, other = (CMotion(self.EXPORTED).begin(None, [3.0]).step(1e-3, 640) for _ in range(2))
        other.prepare().step(1e-3, 1000)
        np.testing.assert_allclose(other.q, one.step(1e-3, 1000).q, rtol=0.0, atol=1e-11)
        assert one.crossings == other.crossings > 1
        with pytest.raises(StoppedError, match="begun"):
            CMotion(self.EXPORTED).prepare()


@pytest.mark.parametrize("signed", [False, True])
def test_spoilt_files_are_refused_or_stop(signed: bool) -> None:
    rng = random.Random(5)
    files = [described(rg.load(name)) for name in ("rhombus", "five_bar", "delta", "andrews")]
    refused = 0
    for _ in range(300):
        whole = rng.choice(files)
        data = spoilt(whole, rng, signed)
        try:
            exported = Exported(data)
        except ValueError as error:
            assert "file" in str(error) or "mechanism" in str(error)
            refused += 1
            continue
        assert signed or data == whole
        try:
            CMotion(exported).begin().step(1e-3, 2)
        except StoppedError as stop:
            assert len(str(stop)) > 10
    assert refused > (100 if signed else 270)


class TestRefusals:
    MECH = rg.load("rhombus")

    def test_arguments(self, tmp_path: Path) -> None:
        with pytest.raises(ValueError, match="opened"):
            Exported(tmp_path / "none.rgcp")
        motion = CMotion(Exported(described(self.MECH)))
        for call in (lambda: motion.step(1e-3, 1), motion.reduced, motion.save, motion.derivatives):
            with pytest.raises(StoppedError, match="begun"):
                call()
        with pytest.raises(StoppedError, match="no start"):
            motion.begin(np.zeros(3))
        motion.begin()
        for h, n in ((np.nan, 1), (0.0, 1), (1e-3, -1)):
            with pytest.raises(StoppedError, match="h must be"):
                motion.step(h, n)
        with pytest.raises(StoppedError, match="finite"):
            motion.step(1e-3, 1, [np.nan, 0.0, 0.0])
        with pytest.raises(StoppedError, match="no state"):
            motion.restore(motion.save()[:-8])

    def test_what_cannot_be_exported(self, tmp_path: Path) -> None:
        with pytest.raises(rg.ModelError, match=r"\.rgcp"):
            self.MECH.export(tmp_path / "rhombus.txt")
        with pytest.raises(rg.ModelError, match="charts"):
            self.MECH.export(tmp_path / "rhombus.rgcp", charts=[["q1", "q2"]])
        with pytest.raises(rg.ModelError, match=r"charts: 'q2' .* write \['q2'\]"):
            self.MECH.export(tmp_path / "rhombus.rgcp", charts=["q2"])  # type: ignore[list-item]
        with pytest.raises(rg.OptionError, match=r"charts = .* tables have one coordinate"):
            self.MECH.export(tmp_path / "rhombus.c", charts=[["q2"]])


COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
PACKAGE = Path(rg.__file__).parent


def _swings(program: Path, folder: Path) -> None:
    """Whether the example finds what Python does."""
    mech = rg.load("change_point")
    line = [str(program), str(mech.export(folder / "change_point.rgcp"))]
    out = subprocess.run(line, check=True, timeout=60, capture_output=True, text=True).stdout
    run = rg.simulate(mech, duration=5.0, step=1e-3)
    assert f"{len(run.crossings)} crossings" in out
    last = next(line for line in out.splitlines() if line.startswith("q1"))
    assert float(last.split("=")[1].split()[0]) == pytest.approx(float(run["q1"][-1]), abs=1e-8)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_the_example_in_c(tmp_path: Path) -> None:
    words = [
        str(COMPILER),
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        f"-I{PACKAGE / 'include'}",
    ]
    words += [str(EXAMPLES / "swing.c"), str(_installed(NAME)), "-o", str(tmp_path / "swing")]
    subprocess.run(words, check=True, timeout=60)
    _swings(tmp_path / "swing", tmp_path)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="counted by names of glibc")
@pytest.mark.parametrize("name", ["change_point", "rhombus", "walker"])
def test_steps_ask_the_system_for_no_memory(name: str, tmp_path: Path) -> None:
    program, source = tmp_path / "counting", Path(__file__).with_name("counting.c")
    words = [str(COMPILER), "-rdynamic", f"-I{PACKAGE / 'include'}", str(source), str(_installed(NAME))]
    subprocess.run([*words, "-o", str(program)], check=True, timeout=60)
    file = str(rg.load(name).export(tmp_path / f"{name}.rgcp"))

    def run(size: int) -> list[int]:
        line = [str(program), file, str(size)]
        out = subprocess.run(line, check=True, timeout=60, capture_output=True, text=True)
        return [int(word) for word in out.stdout.split()]

    counted, crossings = run(1 << 22)
    assert counted == 0 and (crossings > 0 or name == "walker")
    assert run(0)[0] > 0  # it counts


@pytest.mark.skipif(COMPILER is None or shutil.which("cmake") is None, reason="no CMake")
@pytest.mark.skipif(not (PACKAGE / "kernel" / NAME).is_file(), reason="the kernel is in another folder")
def test_the_example_by_cmake(tmp_path: Path) -> None:
    where = ["-S", str(EXAMPLES), "-B", str(tmp_path / "build"), f"-Drobust_gcp_DIR={PACKAGE / 'cmake'}"]
    for words in (["cmake", *where], ["cmake", "--build", str(tmp_path / "build")]):
        subprocess.run(words, check=True, timeout=120, capture_output=True)
    _swings(tmp_path / "build" / "swing", tmp_path)
    line = [str(tmp_path / "build" / "loop"), str(tmp_path / "change_point.rgcp"), "0.5"]
    out = subprocess.run(line, check=True, timeout=60, capture_output=True, text=True).stdout
    assert "500 steps" in out and "latest start" in out
    line = [str(tmp_path / "build" / "latency"), str(tmp_path / "change_point.rgcp"), "3000"]
    out = subprocess.run(line, check=True, timeout=60, capture_output=True, text=True).stdout
    assert "3000 steps through 2 crossings" in out and "worst" in out


@pytest.mark.skipif(COMPILER is None or shutil.which("pkg-config") is None, reason="no pkg-config")
@pytest.mark.skipif(
    not (PACKAGE / "kernel" / "kernel.so").is_file(), reason="the kernel is in another folder"
)
def test_the_example_by_pkg_config(tmp_path: Path) -> None:
    ask = ["pkg-config", "--cflags", "--libs", str(PACKAGE / "cmake" / "robust_gcp.pc")]
    flags = subprocess.run(ask, check=True, timeout=60, capture_output=True, text=True).stdout.split()
    words = [str(COMPILER), str(EXAMPLES / "swing.c"), *flags, "-o", str(tmp_path / "swing")]
    subprocess.run(words, check=True, timeout=60)
    _swings(tmp_path / "swing", tmp_path)
