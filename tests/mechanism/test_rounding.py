"""Loops whose redundant rows are so up to the rounding of a file's numbers; rows of part of a cut joint."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.constraint.partial_closure import PartialClosure
from robust_gcp.mechanism.loops import ClosedLoops

RIGHT = "1.570796326794897 0 0"


def link(name: str, length: float) -> str:
    about = length**2 / 12.0
    return f"""<link name="{name}"><inertial><origin xyz="{length / 2.0} 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="{about}" izz="{about}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def four_bar(rpy: str, kind: str = "revolute", lengths: tuple[float, ...] = (0.5, 1.0, 0.8, 0.9)) -> str:
    """A four-bar closed by a hinge, of which three rows are redundant; one axis is turned by rpy."""
    a, b, c, d = lengths
    return f"""<robot name="r"><link name="base"/>{link("a", a)}{link("b", b)}{link("c", c)}
    <joint name="q1" type="continuous"><parent link="base"/><child link="a"/><origin rpy="{rpy}"/>
    <axis xyz="0 0 1"/></joint>
    <joint name="q2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="{a} 0 0"/>
    <axis xyz="0 0 1"/></joint>
    <joint name="q3" type="continuous"><parent link="base"/><child link="c"/>
    <origin xyz="{d} 0 0" rpy="{RIGHT}"/><axis xyz="0 0 1"/></joint>
    <loop name="l" type="{kind}"><predecessor link="b"><origin xyz="{b} 0 0"/></predecessor>
    <successor link="c"><origin xyz="{c} 0 0"/></successor><axis xyz="0 0 1"/></loop></robot>"""


def loaded(tmp_path: Path, text: str) -> rg.Mechanism:
    file = tmp_path / "robot.urdf"
    file.write_text(text, encoding="utf-8")
    return rg.load(file)


@pytest.mark.parametrize("apart", [1e-11, 1e-8, 1e-6])
@pytest.mark.parametrize("turn", ["0 0 0", "0.3 0.5 -0.7"])
def test_frames_that_rounding_leaves_apart_across_the_plane_close_in_any_plane(
    apart: float, turn: str, tmp_path: Path
) -> None:
    """Axes are parallel to the last digit; what no joint moves is told, in an oblique plane too."""
    exact = four_bar(RIGHT, "spherical").replace('<link name="base"/>', f"""<link name="ground"/>
    <joint name="mount" type="fixed"><parent link="ground"/><child link="base"/><origin rpy="{turn}"/></joint>
    <link name="base"/>""")  # fmt: skip
    wanted = rg.simulate(loaded(tmp_path, exact), duration=0.3, step=1e-3)
    with pytest.warns(rg.ModelWarning, match=r"that others imply up to rounding \(l_1 – l_2 \(1 of 3 rows\)"):
        mech = loaded(tmp_path, exact.replace('xyz="0.8 0 0"', f'xyz="0.8 0 {apart}"'))
    run = rg.simulate(mech, mech.assemble(wanted.q[0]), duration=0.3, step=1e-3)
    assert (mech.nc, mech.m) == (2, 1)
    assert run.closure_error().max() < 1e-13
    assert np.ptp(run["q1"]) > 0.3
    np.testing.assert_allclose(run.q, wanted.q, atol=1e-10)
    with pytest.raises((rg.ClosureError, rg.ModelError), match=r"open by|stay .* apart"):
        loaded(tmp_path, exact.replace('xyz="0.8 0 0"', 'xyz="0.8 0 0.001"'))


@pytest.mark.parametrize("rpy", ["1.5708 0 0", "1.57080 0.00001 0", "1.570796 0 0"])
def test_a_right_angle_of_few_digits_leaves_a_loop_its_freedom(rpy: str, tmp_path: Path) -> None:
    """It moves as the same loop with all digits does, but for that rounding."""
    exact = loaded(tmp_path, four_bar(RIGHT))
    assert exact.left_out == ()
    with pytest.warns(rg.ModelWarning, match=r"rows of loops that others imply up to rounding \(l_1 – l_2"):
        mech = loaded(tmp_path, four_bar(rpy))
    assert (exact.m, mech.m) == (1, 1)
    assert mech.closure_residual(mech.home) < 1e-11
    starts = (exact.home, mech.assemble(exact.home))
    runs = [rg.simulate(m, q, duration=0.3, step=1e-3) for m, q in zip((exact, mech), starts, strict=True)]
    assert runs[1].closure_error().max() < 1e-13
    assert np.ptp(runs[0]["q1"]) > 0.4
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=2e-4)
    again = rg.load_trajectory(runs[1].save(tmp_path / "run.npz")).mechanism
    np.testing.assert_array_equal(again.K(mech.home), mech.K(mech.home))


def test_a_file_with_such_loops_is_refused_where_all_is_to_be_simulated(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(four_bar("1.5708 0 0"), encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"strict=True.*up to rounding"):
        rg.load(file, strict=True)


def test_axes_that_are_not_parallel_are_told(tmp_path: Path) -> None:
    with pytest.raises(rg.ClosureError, match=r"the loop l_1 – l_2 is open by 0\.000204 rad") as caught:
        loaded(tmp_path, four_bar("1.571 0 0"))
    assert caught.value.nearest is not None


def test_a_shaky_structure_stays_rigid(tmp_path: Path) -> None:
    """Two bars nearly in line: a singular value of 1e-6 too, and no freedom."""
    text = f"""<robot name="r"><link name="base"/>{link("a", 0.5)}{link("b", 0.5)}
    <joint name="q1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
    <joint name="q2" type="continuous"><parent link="base"/><child link="b"/><origin xyz="{1.0 - 1e-12} 0 0"/>
    <axis xyz="0 0 1"/></joint>
    <loop name="l" type="continuous"><predecessor link="a"><origin xyz="0.5 0 0"/></predecessor>
    <successor link="b"><origin xyz="-0.5 0 0"/></successor><axis xyz="0 0 1"/></loop></robot>"""
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.ModelWarning)
        mech = loaded(tmp_path, text)
    assert mech.m == 0
    with pytest.raises(rg.PartitionError, match="rigid"):
        rg.simulate(mech, duration=0.1)


def test_rows_of_a_part_are_those_of_the_whole() -> None:
    """Rotation rows are the same; position rows are along the axes of frame 2, which moves; K is ∂φ/∂q."""
    base = rg.load("bricard")
    whole = [rg.FrameClosure(c.frame1, c.frame2) for c in base.loops]
    full = ClosedLoops(base.model, [PartialClosure.of(c) for c in whole])
    parts = [PartialClosure(c.frame1, c.frame2, along=(0, 2), turns=(1,)) for c in whole]
    some = ClosedLoops(base.model, parts)
    rng = np.random.default_rng(0)
    q = base.home + rng.uniform(-0.3, 0.3, base.nv)
    np.testing.assert_allclose(some.phi(q), full.phi(q)[[0, 2, 4]], atol=1e-15)
    np.testing.assert_allclose(some.K(q), full.K(q)[[0, 2, 4]], atol=1e-14)
    for i in range(base.nv):
        e = 1e-6 * np.eye(base.nv)[i]
        np.testing.assert_allclose((some.phi(q + e) - some.phi(q - e)) / 2e-6, some.K(q)[:, i], atol=1e-8)


Kind = type[rg.PointClosure] | type[rg.RevoluteClosure]


def planar(
    tilt: float, turned: float, kind: Kind, sizes: tuple[float, ...] = (4.0, 1.0, 3.5, 3.0)
) -> rg.Mechanism:
    """A four-bar with a tilted joint, in a plane that is turned against the world's axes."""
    ground, lengths = sizes[0], dict(zip(("q1", "q2", "q3"), sizes[1:], strict=True))
    model = pin.Model()
    plane = pin.SE3(pin.exp3(turned * np.array([0.3, 0.5, 0.2])), np.zeros(3))
    for name, parent, at in (("q1", 0, 0.0), ("q2", 1, sizes[1]), ("q3", 0, ground)):
        place = pin.SE3(np.eye(3), np.array([0.0, at, 0.0]))
        place = place if parent else plane * place
        place.rotation = place.rotation @ pin.exp3(np.array([0.0, 0.0, tilt * (name == "q2")]))
        joint = model.addJoint(parent, pin.JointModelRX(), place, name)
        about, tip = lengths[name] ** 2 / 12.0, np.array([0.0, lengths[name], 0.0])
        inertia = pin.Inertia(1.0, 0.5 * tip, np.diag([about, 1e-4, about]))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_tip", joint, pin.SE3(np.eye(3), tip), pin.FrameType.OP_FRAME))
    axis = {} if kind is rg.PointClosure else {"axis": (1.0, 0.0, 0.0)}
    return rg.Mechanism.from_pinocchio(model, [kind("q2_tip", "q3_tip", **axis)], ["q1"])


@pytest.mark.parametrize("turned", [0.0, 1.0])
@pytest.mark.parametrize(("kind", "lost"), [(rg.PointClosure, "1 of 3"), (rg.RevoluteClosure, "3 of 5")])
def test_rows_that_a_planar_loop_cannot_close_are_told_or_refused(
    turned: float, kind: type[rg.PointClosure] | type[rg.RevoluteClosure], lost: str
) -> None:
    """Whatever the plane: nothing to tell at rounding, told up to 2e-5, refused for the axes beyond."""
    exact = planar(0.0, turned, kind)
    assert exact.left_out == ()
    ends = [rg.simulate(exact, exact.assemble([1.0, -0.4, 1.8]), duration=0.1, step=1e-3).q[-1]]
    for tilt in (1e-10, 1e-8, 1e-6):
        with pytest.warns(rg.ModelWarning, match=rf"q2_tip – q3_tip \({lost} rows\): \d\.\de-"):
            mech = planar(tilt, turned, kind)
        assert (mech.nc, mech.m, len(mech.left_out)) == (2, 1, 1)
        q = mech.assemble([1.0, -0.4, 1.8])
        ends.append(rg.simulate(mech, q, duration=0.1, step=1e-3).q[-1])
        np.testing.assert_allclose(ends[-1], ends[0], atol=10.0 * tilt + 1e-12)
    for tilt in (1e-4, 1e-2):
        with pytest.raises(rg.ClosureError, match="axes of a planar loop are parallel but for such an angle"):
            planar(tilt, turned, kind).assemble([1.0, -0.4, 1.8])


@pytest.mark.parametrize("turned", [0.0, 1.0])
@pytest.mark.parametrize("kind", [rg.PointClosure, rg.RevoluteClosure])
@pytest.mark.parametrize("tilt", [0.0, 1e-8, 1e-6])
@pytest.mark.filterwarnings("ignore:.*up to rounding:robust_gcp.ModelWarning")
def test_redundant_rows_and_a_flat_pose_are_told_apart(tilt: float, turned: float, kind: Kind) -> None:
    """All links of a parallelogram in line: mobility 1, two modes, whatever rows are redundant everywhere."""
    base = planar(tilt, turned, kind, (2.0, 1.0, 2.0, 1.0))
    mech = rg.Mechanism.from_pinocchio(base.model, base.closures)
    here = rg.analyse(mech, np.zeros(3))
    assert (mech.m, here.kind, here.rank, here.generic_rank, len(here.modes)) == (1, "singular", 1, 2, 2)
    for mode in here.modes:
        run = rg.simulate(mech, np.zeros(3), mode=mode, duration=0.05, step=1e-3)
        assert run.closure_error().max() < 1e-11
        assert np.abs(run.energy_error()).max() < 1e-9


def test_a_small_loop_beside_a_large_one_is_not_taken_for_rounding() -> None:
    """A four-bar of some micrometres on the coupler of one of metres keeps its rows."""
    model = pin.Model()
    sizes = {"a": 1.0, "b": 3.5, "c": 3.0, "x": 1e-6, "y": 3.5e-6, "z": 3e-6}
    places = {"a": (0, 0), "b": (1, 1), "x": (2, 1), "y": (3, 1e-6), "z": (2, 1 + 4e-6), "c": (0, 4)}
    for name, (parent, at) in places.items():
        joint = model.addJoint(parent, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, at, 0.0])), name)
        tip = pin.SE3(np.eye(3), np.array([0.0, sizes[name], 0.0]))
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_tip", joint, tip, pin.FrameType.OP_FRAME))
    closures = [rg.PointClosure("b_tip", "c_tip"), rg.PointClosure("y_tip", "z_tip")]
    mech = rg.Mechanism.from_pinocchio(model, closures, ["a", "x"])
    assert (mech.nc, mech.left_out) == (4, ())


def test_a_spring_acts_along_a_slide_whose_rows_are_left_out() -> None:
    """A cylinder out of its plane by a file's rounding is a slide still: its frames do not stay together."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    for name, parent, place, tilt in (
        ("crank", 0, 0.0, 0.0),
        ("rod", 1, 0.3, 0.0),
        ("cylinder", 0, 1.0, 1e-6),
    ):
        at = pin.SE3(pin.exp3(np.array([tilt, 0.0, 0.0])), np.array([place, 0.0, 0.0]))
        joint = model.addJoint(parent, pin.JointModelRZ(), at, name)
        body = pin.Inertia(1.0, np.array([0.25, 0.0, 0.0]), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_end", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))

    def made(closure: rg.Closure) -> rg.Mechanism:
        spring = rg.PointSpring("rod_end", "cylinder_end", 10.0, 0.5, 1.0)
        return rg.Mechanism.from_pinocchio(model, [closure], home=np.array([0.5, 2.9, 2.4]), forces=[spring])

    with pytest.warns(rg.ModelWarning, match=r"3 of 5 rows"):
        mech = made(rg.PrismaticClosure("rod_end", "cylinder_end", (1.0, 0.0, 0.0)))
    assert [closure.joins for closure in mech.closures] == [False]
    run = rg.simulate(mech, duration=0.2)
    assert run.energy_error().max() < 1e-6
    with pytest.raises(rg.ModelError, match="no length and no direction"), warnings.catch_warnings():
        warnings.simplefilter("ignore", rg.ModelWarning)
        made(rg.FrameClosure("rod_end", "cylinder_end"))
