"""USD files: units, scales, loops, couplings, masses of colliders, and what is refused."""

import contextlib
import random
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.io.usd.reader import read_usd

pytest.importorskip("pxr")

FOUR_BAR = """#usda 1.0
(
    defaultPrim = "bar"
    metersPerUnit = {metres}
    kilogramsPerUnit = {kilograms}
    upAxis = "{up}"
)
def PhysicsScene "scene" {{ vector3f physics:gravityDirection = (0, -1, 0)
    float physics:gravityMagnitude = {gravity}
}}
def Xform "bar"
{{
{bodies}
{joints}
}}
"""
BODY = """
    def Xform "{name}" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"] )
    {{
        double3 xformOp:translate = ({x}, {y}, 0)
        double3 xformOp:scale = ({scale}, {scale}, {scale})
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        float physics:mass = {mass}
        point3f physics:centerOfMass = ({centre}, 0, 0)
        float3 physics:diagonalInertia = ({thin}, {moment}, {moment})
    }}
"""
JOINT = """
    def PhysicsRevoluteJoint "{name}" {api}
    {{
        uniform token physics:axis = "Z"
        {ends}
        point3f physics:localPos0 = ({at0}, 0, 0)
        point3f physics:localPos1 = ({at1}, 0, 0)
        {more}
    }}
"""
LENGTHS = {"crank": 1.0, "coupler": 3.0, "rocker": 2.5}


def four_bar(metres=1.0, kilograms=1.0, scale=1.0, up="Y", cut="", more="", api="") -> str:
    """Lengths 1, 3, 2.5 and 2.5 m, each link along its x axis from where it hangs; drawn apart."""
    unit = 1.0 / metres
    places = {"crank": (0.0, 0.0), "coupler": (1.0, 0.0), "rocker": (2.5, 0.0)}
    bodies = "".join(
        BODY.format(
            name=name,
            x=places[name][0] * unit,
            y=places[name][1] * unit,
            scale=scale,
            mass=1.0 / kilograms,
            centre=0.5 * length * unit / scale,
            thin=1e-3 * unit**2 / kilograms,
            moment=length**2 / 12.0 * unit**2 / kilograms,
        )
        for name, length in LENGTHS.items()
    )
    spots = {
        "q1": (None, "crank", 0.0, 0.0),
        "q2": ("crank", "coupler", 1.0, 0.0),
        "q3": (None, "rocker", 2.5, 0.0),
        "q4": ("coupler", "rocker", 3.0, 2.5),
    }
    joints = ""
    for name, (one, two, at0, at1) in spots.items():
        ends = "" if one is None else f"rel physics:body0 = </bar/{one}>\n        "
        ends += f"rel physics:body1 = </bar/{two}>"
        extra = "bool physics:excludeFromArticulation = 1" if name == cut else ""
        joints += JOINT.format(
            name=name,
            ends=ends,
            at0=at0 * unit / (scale if one else 1.0),
            at1=at1 * unit / scale,
            more=extra + (more if name == "q3" else ""),
            api=api if name == "q3" else "",
        )
    return FOUR_BAR.format(
        metres=metres, kilograms=kilograms, up=up, gravity=9.81 * unit, bodies=bodies, joints=joints
    )


def written(folder: Path, text: str, name: str = "bar.usda") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def by_hand() -> rg.Mechanism:
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    z = pin.JointModelRZ()
    q1 = model.addJoint(0, z, pin.SE3.Identity(), "q1")
    q2 = model.addJoint(q1, z, pin.SE3(np.eye(3), np.array([1.0, 0, 0])), "q2")
    q3 = model.addJoint(0, z, pin.SE3(np.eye(3), np.array([2.5, 0, 0])), "q3")
    for joint, length in zip((q1, q2, q3), LENGTHS.values(), strict=True):
        moments = np.diag([1e-3, length**2 / 12.0, length**2 / 12.0])
        model.appendBodyToJoint(
            joint, pin.Inertia(1.0, np.array([length / 2, 0.0, 0.0]), moments), pin.SE3.Identity()
        )
    for joint, at, name in ((q2, 3.0, "a"), (q3, 2.5, "b")):
        model.addFrame(pin.Frame(name, joint, pin.SE3(np.eye(3), np.array([at, 0, 0])), pin.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, [rg.RevoluteClosure("a", "b")], ["q1"])


GUESS = {"q1": 1.0, "q2": -0.5, "q3": 1.5}


@pytest.mark.parametrize(
    "written_as",
    [
        {},
        {"metres": 0.01},
        {"metres": 0.01, "kilograms": 1e-3, "scale": 2.0},
        {"scale": 0.1, "up": "Z"},
    ],
)
def test_units_and_scales_do_not_change_the_motion(tmp_path, written_as):
    wanted = by_hand()
    mechanism = rg.load(written(tmp_path, four_bar(**written_as)), independent=["q1"])
    assert mechanism.joint_names == ("q1", "q2", "q3")
    assert isinstance(mechanism.closures[0], rg.RevoluteClosure)
    q0 = wanted.assemble(GUESS)
    np.testing.assert_allclose(mechanism.assemble(GUESS), q0, atol=2e-7)  # single precision of the file
    runs = [rg.simulate(m, q0, duration=0.5, step=1e-3) for m in (wanted, mechanism)]
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=3e-6)


def test_a_joint_outside_the_articulation_is_the_one_that_is_cut(tmp_path):
    path = written(tmp_path, four_bar(cut="q2"))
    contents = read_usd(path)
    assert sorted(list(contents.model.names)[1:]) == ["q1", "q3", "q4"]
    mechanism, other = rg.load(path, independent=["q1"]), rg.load(written(tmp_path, four_bar(), "b.usda"))
    q0 = other.assemble(GUESS)
    run = rg.simulate(other.with_independent(["q1"]), q0, duration=0.3, step=1e-3)
    again = mechanism.assemble({"q1": q0[0], "q3": q0[2], "q4": q0[2] - q0[0] - q0[1]}, hold=["q1"])
    twin = rg.simulate(mechanism, again, duration=0.3, step=1e-3)
    np.testing.assert_allclose(twin["q3"], run["q3"], atol=1e-10)


def test_colliders_have_the_masses_that_a_body_lacks(tmp_path):
    def collider(shape):
        return f"""#usda 1.0
( metersPerUnit = 0.01 )
def Xform "arm" ( prepend apiSchemas = ["PhysicsRigidBodyAPI"] )
{{
    def {shape}
}}
def PhysicsRevoluteJoint "hinge" {{ rel physics:body1 = </arm>
    uniform token physics:axis = "Z"
}}
"""

    api = '( prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMassAPI"] )'
    shapes = {
        f'Cube "a" {api} {{ double size = 10\n'
        " double3 xformOp:scale = (3, 1, 1)\n uniform token[] xformOpOrder "
        '= ["xformOp:scale"]\n float physics:density = 0.002\n }': pin.Inertia.FromBox(6.0, 0.3, 0.1, 0.1),
        f'Sphere "a" {api} {{ double radius = 10\n float physics:mass = 2\n }}': pin.Inertia.FromSphere(
            2.0, 0.1
        ),
        f'Cylinder "a" {api} {{ double radius = 5\n double height = 40\n uniform token axis = "X"\n '
        "float physics:mass = 2\n }": pin.Inertia.FromCylinder(2.0, 0.05, 0.4).se3Action(
            pin.SE3(pin.rpy.rpyToMatrix(0, np.pi / 2, 0), np.zeros(3))
        ),
        f'Capsule "a" {api} {{ double radius = 5\n double height = 40\n uniform token axis = "Y"\n '
        "float physics:mass = 2\n }": pin.Inertia.FromCapsule(2.0, 0.05, 0.4).se3Action(
            pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0, 0), np.zeros(3))
        ),
    }
    for i, (shape, wanted) in enumerate(shapes.items()):
        found = read_usd(written(tmp_path, collider(shape), f"{i}.usda")).model.inertias[1]
        np.testing.assert_allclose(found.toDynamicParameters(), wanted.toDynamicParameters(), atol=1e-7)
    mesh = written(tmp_path, collider(f'Mesh "a" {api} {{\n}}'), "mesh.usda")
    with pytest.raises(rg.ModelError, match=r"/arm/a: the mass of a Mesh is not known; give physics:mass"):
        read_usd(mesh)


def test_mimic_joints_are_couplings(tmp_path):
    newton = '( prepend apiSchemas = ["NewtonMimicAPI"] )'
    more = "\n rel newton:mimicJoint = </bar/q1>\n float newton:mimicCoef0 = 90\n float newton:mimicCoef1 = 2"
    found = read_usd(written(tmp_path, four_bar(api=newton, more=more))).closures[-1]
    assert (found.joint1, found.joint2, found.ratio) == ("q3", "q1", 2.0)
    assert found.offset == pytest.approx(np.pi / 2)
    physx = '( prepend apiSchemas = ["PhysxMimicJointAPI:rotZ"] )'
    more = (
        "\n rel physxMimicJoint:rotZ:referenceJoint = </bar/q1>\n float physxMimicJoint:rotZ:gearing = -2"
        "\n float physxMimicJoint:rotZ:offset = -90"
    )
    assert read_usd(written(tmp_path, four_bar(api=physx, more=more), "b.usda")).closures[-1] == found
    with pytest.raises(rg.ModelError, match="q3: NewtonMimicAPI names no joint that it follows"):
        read_usd(written(tmp_path, four_bar(api=newton), "c.usda"))


def test_a_mimic_between_a_slide_and_a_hinge_is_in_the_units_of_the_file(tmp_path):
    """Metres per degree there, metres per radian here."""
    newton = '( prepend apiSchemas = ["NewtonMimicAPI"] )'
    more = "\n rel newton:mimicJoint = </bar/q1>\n float newton:mimicCoef0 = 10\n float newton:mimicCoef1 = 2"
    text = four_bar(metres=0.01, api=newton, more=more)
    slide = text.replace('PhysicsRevoluteJoint "q3"', 'PhysicsPrismaticJoint "q3"')
    found = read_usd(written(tmp_path, slide)).closures[-1]
    assert found.offset == pytest.approx(0.1)
    assert found.ratio == pytest.approx(2.0 * 0.01 * 180.0 / np.pi)


def test_generic_joints_are_what_their_locked_axes_leave(tmp_path):
    def lock(*axes):
        listed = "".join(f'"PhysicsLimitAPI:{axis}", ' for axis in axes)
        bounds = "".join(
            f"\n float limit:{a}:physics:low = 1\n float limit:{a}:physics:high = -1" for a in axes
        )
        text = four_bar(api=f"( prepend apiSchemas = [{listed}] )", more=bounds)
        return text.replace('PhysicsRevoluteJoint "q3"', 'PhysicsJoint "q3"')

    hinge = lock("transX", "transY", "transZ", "rotX", "rotY")
    runs = [
        rg.simulate(
            m := rg.load(written(tmp_path, text, name), independent=["q1"]), m.assemble(GUESS), duration=0.3
        )
        for text, name in ((hinge, "a.usda"), (four_bar(), "b.usda"))
    ]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)
    with pytest.raises(rg.ModelError, match="q3: a generic joint cannot be read"):
        read_usd(written(tmp_path, lock("transX"), "c.usda"))


def test_what_lies_outside_the_folder_is_not_opened(tmp_path):
    inside, outside = tmp_path / "in", tmp_path / "out"
    inside.mkdir()
    outside.mkdir()
    written(outside, four_bar())
    text = "#usda 1.0\n(\n subLayers = [ @../out/bar.usda@ ]\n)\n"
    with pytest.raises(rg.ModelError, match=r"refers to '\.\./out/bar\.usda', outside its folder"):
        rg.load(written(inside, text))
    assert rg.load(written(inside, text), root=outside).nv == 3


def test_faults_are_told_by_prim(tmp_path):
    def refused(text, match):
        with pytest.raises(rg.ModelError, match=match):
            read_usd(written(tmp_path, text, f"{abs(hash(text))}.usda"))

    refused("no usd", "not a USD file")
    refused(four_bar().replace("</bar/rocker>", "</bar/roker>"), "q3: body1 names /bar/roker")
    refused(four_bar(scale=-1.0), "mirrors")
    refused(four_bar().replace("float physics:mass = 1.0", "float physics:mass = 0"), "gives its mass")
    refused(four_bar().replace("(2.5, 0", "(nan, 0"), "not finite")
    with pytest.raises(rg.MissingFileError):
        read_usd(tmp_path / "none.usda")


def test_kinematic_bodies_stand_still_and_are_told(tmp_path):
    text = four_bar().replace(
        "float physics:mass = 1.0\n        point3f physics:centerOfMass = (1.25",
        "bool physics:kinematicEnabled = 1\n        point3f physics:centerOfMass = (1.25",
    )
    contents = read_usd(written(tmp_path, text))
    assert contents.model.nv == 2
    assert "motion of kinematic bodies (rocker)" in contents.left_out


def test_a_body_that_has_the_name_of_a_kinematic_one_moves(tmp_path):
    fixture = """    def Xform "fixture"
    {
        def Xform "crank" ( prepend apiSchemas = ["PhysicsRigidBodyAPI"] )
        {
            bool physics:kinematicEnabled = 1
        }
    }
"""
    text = four_bar()
    at = text.index("    def PhysicsRevoluteJoint")
    contents = read_usd(written(tmp_path, text[:at] + fixture + text[at:]))
    assert contents.model.nv == 3
    assert "motion of kinematic bodies (/bar/fixture/crank)" in contents.left_out


def test_spoilt_files_are_refused_by_typed_errors(tmp_path):
    rng, base = random.Random(0), four_bar()
    numbers = ("nan", "-1", "1e300", "0", "inf")
    for count in range(150):
        lines = base.split("\n")
        at = rng.randrange(len(lines))
        if count % 3 == 0:
            del lines[at]
        elif count % 3 == 1:
            lines[at] = re.sub(r"-?\d+\.?\d*", lambda m: rng.choice((m.group(), *numbers)), lines[at])
        else:
            lines[at] = re.sub("float|point3f|token|rel|double3", rng.choice(("string", "int")), lines[at])
        with contextlib.suppress(rg.RobustGcpError):
            rg.load(written(tmp_path, "\n".join(lines), f"{count}.usda"))
