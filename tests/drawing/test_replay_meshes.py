"""Shapes of the bodies: told as they are, and where Pinocchio puts them."""

from __future__ import annotations

import base64
import json
import pickle
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.drawing.replay.geometry import sticks
from robust_gcp.drawing.replay.meshes import bare_bodies, mesh_data
from robust_gcp.drawing.skeleton import placements
from robust_gcp.examples import linkages

CORNERS = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1]])
TETRAHEDRON = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


def tetrahedron() -> coal.CollisionGeometry:
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(4, 4)
    shape.addVertices(CORNERS)
    for a, b, c in TETRAHEDRON:
        shape.addTriangle(*CORNERS[[a, b, c]])
    shape.endModel()
    return shape


def visual_of(mechanism: rg.Mechanism, *shapes: coal.CollisionGeometry) -> pin.GeometryModel:
    visual = pin.GeometryModel()
    rng = np.random.default_rng(1)
    for i, shape in enumerate(shapes):
        joint = i % mechanism.model.njoints
        at = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        visual.addGeometryObject(pin.GeometryObject(f"shape{i}", joint, at, shape))
    return visual


def test_sizes_are_full_sizes() -> None:
    mechanism = rg.load("rhombus")
    R, p = placements(mechanism, mechanism.home[None])
    made = sticks(mechanism, R, p, None)
    shapes = (
        coal.Box(1.0, 2.0, 3.0),
        coal.Sphere(0.5),
        coal.Cylinder(0.1, 0.8),
        coal.Capsule(0.1, 0.6),
        coal.Cone(0.2, 0.4),
    )
    told = [item["shape"] for item in mesh_data(mechanism, made, visual_of(mechanism, *shapes))]
    assert told == [
        {"kind": "box", "size": [1.0, 2.0, 3.0]},
        {"kind": "sphere", "radius": 0.5},
        {"kind": "cylinder", "radius": 0.1, "length": 0.8},
        {"kind": "capsule", "radius": 0.1, "length": 0.6},
        {"kind": "cone", "radius": 0.2, "length": 0.4},
    ]


def test_a_mesh_keeps_its_triangles() -> None:
    mechanism = rg.load("rhombus")
    R, p = placements(mechanism, mechanism.home[None])
    made = sticks(mechanism, R, p, None)
    (item,) = mesh_data(mechanism, made, visual_of(mechanism, tetrahedron()))
    corners = np.frombuffer(base64.b64decode(item["shape"]["corners"]), dtype="<f4").reshape(-1, 3)
    index = np.frombuffer(base64.b64decode(item["shape"]["index"]), dtype="<u4").reshape(-1, 3)
    # six times the volume, as the sum over the triangles, is a b c of the right-angled corner
    volume = np.einsum("ij,ij->i", corners[index[:, 0]], np.cross(corners[index[:, 1]], corners[index[:, 2]]))
    assert len(index) == 4
    assert abs(volume.sum()) == pytest.approx(0.3 * 0.2 * 0.1, rel=1e-6)


def test_three_points_carry_the_pose_of_each_body() -> None:
    mechanism = rg.load("bricard")
    run = rg.simulate(mechanism, duration=0.1, step=1e-2)
    R, p = placements(mechanism, run.q)
    made = sticks(mechanism, R, p, None)
    count = len(made.points)
    visual = visual_of(mechanism, *(coal.Sphere(0.1) for _ in range(2 * mechanism.model.njoints)))
    told = mesh_data(mechanism, made, visual)
    assert len(made.points) == count + 3 * mechanism.model.njoints  # once for each body
    positions = made.positions(R, p)
    for item, shape in zip(told, visual.geometryObjects, strict=True):
        o, x, y = (positions[:, item["frame"] + k] for k in range(3))
        np.testing.assert_allclose(o, p[:, shape.parentJoint], atol=1e-15)
        for column, tip in ((0, x), (1, y)):
            np.testing.assert_allclose(
                tip - o, mechanism.length * R[:, shape.parentJoint, :, column], atol=1e-15
            )
        np.testing.assert_array_equal(np.reshape(item["placement"], (4, 4)).T, shape.placement.homogeneous)


def test_what_cannot_be_drawn_is_refused() -> None:
    mechanism = rg.load("rhombus")
    run = rg.Trajectory(mechanism, np.zeros(1), mechanism.home[None], np.zeros((1, 3)))
    with pytest.raises(rg.OptionError, match=r"pin\.GeometryModel, not a int"):
        rg.replay(run, visual=3)
    with pytest.raises(rg.OptionError, match=r"there is no file robot\.urdf"):
        rg.replay(run, visual="robot.urdf")
    with pytest.raises(rg.OptionError, match="'shape0' is a Halfspace"):
        rg.replay(run, visual=visual_of(mechanism, coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)))
    foreign = visual_of(rg.load("strandbeest"), *(coal.Sphere(0.1) for _ in range(8)))
    with pytest.raises(rg.OptionError, match="joint 4, and the mechanism has 4"):
        rg.replay(run, visual=foreign)


def test_sticks_stay_where_no_shape_shows_the_body() -> None:
    """The coupler without a shape, and the rocker whose shape ends before its cut point: both stay sticks."""
    mechanism = rg.load("rhombus")
    R, p = placements(mechanism, mechanism.home[None])
    made = sticks(mechanism, R, p, None)

    def visual(length: float) -> pin.GeometryModel:
        model = pin.GeometryModel()
        for joint, y in ((1, 1.0), (3, length)):
            at = pin.SE3(np.eye(3), np.array([0.0, 0.5 * y, 0.0]))
            model.addGeometryObject(pin.GeometryObject(f"bar{joint}", joint, at, coal.Box(0.1, y, 0.1)))
        return model

    assert bare_bodies(made, visual(1.0)) == [2]
    assert bare_bodies(made, visual(0.5)) == [2, 3]


def test_the_shapes_of_the_file_that_was_loaded(tmp_path: Path) -> None:
    """By asking once, in other coordinates and after pickling too, or by the file's path."""
    mechanism = rg.load("five_bar")
    source = mechanism.source
    assert source is not None and source.name == "robot.urdf"
    shapes = pin.buildGeomFromUrdf(mechanism.model, str(source), pin.VISUAL).ngeoms
    other = pickle.loads(pickle.dumps(mechanism.with_independent(["q2", "q4"])))
    for made, visual in ((mechanism, True), (other, True), (mechanism, source), (mechanism, str(source))):
        run = rg.Trajectory(made, np.zeros(1), made.home[None], np.zeros((1, 4)))
        data = json.loads(
            rg.replay(run, visual=visual).html.split('type="application/json">')[1].split("</script>")[0]
        )
        assert len(data["runs"][0]["meshes"]) == shapes > 3
    built = linkages.four_bar(4.0, 2.0, 3.0, 3.0)
    run = rg.Trajectory(built, np.zeros(1), built.home[None], np.zeros((1, 3)))
    with pytest.raises(rg.OptionError, match="was not loaded from a URDF"):
        rg.replay(run, visual=True)
    bare = tmp_path / "bare.urdf"
    bare.write_text('<robot name="r"><link name="ground"/></robot>')
    with pytest.raises(rg.OptionError, match="no <visual> shapes"):
        rg.replay(run, visual=bare)
    bare.write_text("<robot")
    with pytest.raises(rg.OptionError, match="cannot be read"):
        rg.replay(run, visual=bare)
