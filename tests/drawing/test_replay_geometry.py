"""What is drawn is the mechanism: points where Pinocchio has them, bodies that hang together."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.drawing.replay.geometry import Sticks, face_on, layers, sticks
from robust_gcp.drawing.skeleton import placements, plane_normal
from robust_gcp.examples.linkages import n_four_bar

Array = np.ndarray


def drawn(mechanism: rg.Mechanism, q: Array, trails: list[str] | None = None) -> tuple[Sticks, Array]:
    R, p = placements(mechanism, q)
    made = sticks(mechanism, R, p, trails)
    return made, made.positions(R, p)


def nearby(mechanism: rg.Mechanism) -> Array:
    """Home, and closed configurations around it."""
    found = [mechanism.home]
    rng = np.random.default_rng(3)
    for _ in range(6):
        try:
            found.append(
                mechanism.assemble(
                    mechanism.tree.integrate(mechanism.home, rng.uniform(-0.05, 0.05, mechanism.nv))
                )
            )
        except rg.ClosureError:
            continue
    return np.array(found)


def test_points_are_where_pinocchio_has_the_frames(mechanisms: dict[str, rg.Mechanism]) -> None:
    for mechanism in mechanisms.values():
        q = nearby(mechanism)
        made, positions = drawn(mechanism, q)
        data = mechanism.model.createData()
        for i, configuration in enumerate(q):
            pin.framesForwardKinematics(mechanism.model, data, configuration)
            for name, point in made.trails.items():
                at = data.oMf[mechanism.model.getFrameId(name)].translation
                np.testing.assert_allclose(positions[i, point], at, atol=1e-12)


def test_what_is_drawn_hangs_together(mechanisms: dict[str, rg.Mechanism]) -> None:
    """Links that meet at a joint or a closure form one piece in every shipped mechanism."""
    for name in rg.model_names():
        mechanism = mechanisms[name]
        made, positions = drawn(mechanism, nearby(mechanism))
        start = positions[0]
        joined = {i: {i} for i in range(len(start))}
        pairs = [(a, b) for a, b, _ in (*made.links, *made.slides)] + [rail[:2] for rail in made.rails]
        pairs += [(a, slider) for a, _, slider, _ in made.rails]
        pairs += [  # coincident: joints and closed loops
            (i, j)
            for i in made.ends()
            for j in made.ends()
            if np.linalg.norm(start[i] - start[j]) < 1e-9 * mechanism.length
        ]
        for a, b, body in made.links:  # points on the way
            along = start[b] - start[a]
            pairs += [
                (a, i)
                for i in made.ends()
                if made.points[i][0] == body
                and np.linalg.norm(np.cross(along, start[i] - start[a])) < 1e-9 * mechanism.length**2
            ]
        for a, b in pairs:
            piece = joined[a] | joined[b]
            for i in piece:
                joined[i] = piece
        ends = {i for a, b, _ in (*made.links, *made.slides) for i in (a, b) if made.points[i][0] > 0}
        pieces = {frozenset(joined[i]) for i in ends}
        # the base points of separate legs or pivots are joined by the ground's own outline
        assert len(pieces) == 1, name


def test_a_rod_is_one_stick_from_joint_to_joint() -> None:
    made, positions = drawn(rg.load("rhombus"), np.array([[0.3, -0.3, 0.3]]))
    moving = [link for link in made.links if link[2] > 0]
    assert sorted(body for _, _, body in moving) == [1, 2, 3]
    for a, b, _ in moving:
        assert np.linalg.norm(positions[0, a] - positions[0, b]) == pytest.approx(1.0, abs=1e-15)


def test_a_slider_runs_on_its_rail() -> None:
    mechanism = rg.load("slider_crank")
    run = rg.simulate(mechanism, duration=1.0, step=1e-2)
    made, positions = drawn(mechanism, run.q)
    ((low, high, slider, body),) = made.rails
    assert mechanism.model.names[body] == "q3"
    rail = positions[:, high] - positions[:, low]
    assert np.ptp(rail, axis=0).max() == 0.0
    share = np.einsum("ij,ij->i", positions[:, slider] - positions[:, low], rail) / np.sum(rail**2, axis=1)
    np.testing.assert_allclose(positions[:, slider], positions[:, low] + share[:, None] * rail, atol=1e-12)
    assert 0.0 < share.min() < share.max() < 1.0


def test_a_platform_has_a_rim_and_legs_are_telescopes() -> None:
    mechanism = rg.load("stewart")
    made, positions = drawn(mechanism, nearby(mechanism))
    (platform,) = (rim for rim, body in made.faces if body > 0)
    assert len(platform) == 6
    assert len(made.slides) == 6
    for base, tip, _ in made.slides:
        assert np.ptp(np.linalg.norm(positions[:, base] - positions[:, tip], axis=1)) > 1e-4


@pytest.mark.parametrize("name", ["rhombus", "strandbeest", "andrews"])
def test_bodies_on_one_joint_lie_in_different_layers(name: str) -> None:
    mechanism = rg.load(name)
    made, positions = drawn(mechanism, nearby(mechanism))
    layer = layers(made, positions)
    model = mechanism.model
    for joint in range(2, model.njoints):
        if model.parents[joint] > 0:
            assert layer[joint] != layer[model.parents[joint]]
    for closure in mechanism.closures:
        one, other = (model.frames[model.getFrameId(n)].parentJoint for n in (closure.frame1, closure.frame2))
        if one and other:
            assert layer[one] != layer[other]


def test_many_loops_need_few_layers() -> None:
    mechanism = n_four_bar(8)
    made, positions = drawn(mechanism, mechanism.home[None])
    assert max(layers(made, positions)) <= 2


def test_planes_are_recognised_by_their_axes(mechanisms: dict[str, rg.Mechanism]) -> None:
    for name in ("rhombus", "slider_crank", "strandbeest"):
        normal = plane_normal(mechanisms[name])
        assert normal is not None
        np.testing.assert_allclose(np.abs(normal), [1, 0, 0], atol=1e-12)
    for name in ("bricard", "stewart", "tripod"):
        assert plane_normal(mechanisms[name]) is None


@pytest.mark.parametrize(
    ("normal", "gravity", "view", "up"),
    [
        ([-1, 0, 0], [0, 0, -9.81], [1, 0, 0], [0, 0, 1]),  # y to the right, z up
        ([0, 1, 0], [0, 0, -9.81], [0, -1, 0], [0, 0, 1]),  # x to the right, z up
        ([0, 0, -1], [0, -9.81, 0], [0, 0, 1], [0, 1, 0]),  # x to the right, y up
        ([0, 0, 1], [0, 0, -9.81], [0, 0, 1], [0, 1, 0]),  # a table seen from above
        ([1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1]),
    ],
)
def test_planes_are_seen_face_on_and_the_right_way_round(
    normal: list[float], gravity: list[float], view: list[float], up: list[float]
) -> None:
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(5, 4, 3)) * (1.0 - np.abs(normal))
    for given in (np.array(normal, dtype=float), None):  # from the axes; from the points alone
        found = face_on(given, np.array(gravity, dtype=float), flat)
        np.testing.assert_allclose(found["view"], view, atol=1e-12)
        np.testing.assert_allclose(found["up"], up, atol=1e-12)


def test_space_is_seen_from_a_raised_corner() -> None:
    rng = np.random.default_rng(0)
    found = face_on(None, np.array([0.0, 0.0, -9.81]), rng.normal(size=(50, 4, 3)) * [3.0, 1.0, 2.0])
    view = np.array(found["view"])
    assert np.linalg.norm(view) == pytest.approx(1.0)
    assert view[2] == pytest.approx(np.sin(np.radians(22.0)))
    assert abs(view[1]) > abs(view[0]) > 0.1  # mostly along the direction of least extent
    assert found["up"] == [0.0, 0.0, 1.0]


def test_an_unknown_trail_is_refused_with_near_names() -> None:
    mechanism = rg.load("strandbeest")
    with pytest.raises(rg.ModelError, match="trails: the model has no frame 'fot'; did you mean 'foot'"):
        drawn(mechanism, mechanism.home[None], ["fot"])
