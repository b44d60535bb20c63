"""Paths of tendons and actuators: lengths, moment arms, what they do to bodies, wrapping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.actuation.paths import Path
from robust_gcp.mechanism.actuation.wrapping import wrapped
from robust_gcp.mechanism.tree.tree import Array, Tree


def _model() -> pin.Model:
    """A floating body that carries a hinge, a ball and a slide, each with two sites."""
    model = pin.Model()
    pin.seed(5)
    kinds = (pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPZ())
    parent, rng = 0, np.random.default_rng(5)
    for i, kind in enumerate(kinds):
        place = pin.SE3.Random() if parent else pin.SE3.Identity()
        place.translation = rng.normal(size=3)
        parent = model.addJoint(parent, kind, place, f"j{i}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        for which in "ab":
            at = pin.SE3(np.eye(3), rng.normal(size=3))
            model.addFrame(pin.Frame(f"{which}{i}", parent, at, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("ground", 0, pin.SE3(np.eye(3), np.ones(3)), pin.FrameType.OP_FRAME))
    return model


MODEL = _model()
TILT = tuple(map(tuple, pin.exp3(np.array([0.3, -0.7, 0.4])).tolist()))
PATHS: dict[str, Path] = {
    "fixed": rg.FixedTendon({"j1": 2.0, "j3": -0.5}),
    "straight": rg.SpatialTendon(["ground", "a0", "b1", "a3"]),
    "pulley": rg.SpatialTendon(["ground", "a1", rg.Pulley(2.0), "a1", "b2", rg.Pulley(3.0), "b0", "b3"]),
    "sphere": rg.SpatialTendon(["ground", rg.Wrap("a1", 0.9, position=(0.2, 0.1, -0.3)), "b2"]),
    "cylinder": rg.SpatialTendon(["b0", rg.Wrap("a2", 0.8, "cylinder", rotation=TILT), "a3"]),
    "beside": rg.SpatialTendon(["b0", rg.Wrap("b1", 0.5, "cylinder", side="a1"), "a3"]),
    "inside": rg.SpatialTendon(["b0", rg.Wrap("b1", 0.3, "sphere", side="b1"), "a3"]),
    "site beside a site": rg.SiteForce("a3", (1.0, 0.5, -2.0, 0.0, 0.0, 0.0), reference="b1"),
    "slider crank": rg.SliderCrank("a1", "b2", 6.0),
}
"""Those with a length, whose change the moment arms are."""


def _states(count: int) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(7)
    return [
        (pin.integrate(MODEL, pin.neutral(MODEL), rng.normal(size=MODEL.nv)), rng.normal(size=MODEL.nv))
        for _ in range(count)
    ]


@pytest.mark.parametrize("name", PATHS)
def test_moment_arms_are_how_the_length_changes(name: str) -> None:
    tree = Tree(MODEL)
    path = PATHS[name].on(tree, "test")

    def length(q: Array) -> float:
        tree.jacobians(q)
        return path.length_at(q)[0]

    for q, v in _states(40):
        h = 1e-5
        ahead = [length(pin.integrate(MODEL, q, k * h * v)) for k in (-2, -1, 1, 2)]
        slope = np.array([1.0, -8.0, 8.0, -1.0]) @ ahead / (12.0 * h)
        tree.jacobians(q)
        assert path.length_at(q)[1] @ v == pytest.approx(slope, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(
    "name",
    ["straight", "pulley", "sphere", "cylinder", "beside", "inside", "slider crank", "site", "site beside"],
)
def test_what_a_path_does_to_bodies_has_the_power_of_its_force(name: str) -> None:
    more = {
        "site": rg.SiteForce("a2", (1.0, 0.5, -2.0, 0.3, 0.1, 0.7)),
        "site beside": rg.SiteForce("a3", (1.0, 0.5, -2.0, 0.3, 0.1, 0.7), "b1"),
    }
    tree, data = Tree(MODEL), MODEL.createData()
    path = (PATHS | more)[name].on(tree, "test")
    for q, v in _states(20):
        tree.jacobians(q)
        pin.forwardKinematics(MODEL, data, q, v)
        power = 0.0
        for _, joint, point, force, moment in path.loads():
            V = data.oMi[joint].act(data.v[joint]) if joint else pin.Motion.Zero()
            power += force @ (V.linear + np.cross(V.angular, point)) + moment @ V.angular
        assert path.length_at(q)[1] @ v == pytest.approx(power, rel=1e-12, abs=1e-12)


class TestWrapping:
    R = pin.exp3(np.array([0.4, -1.1, 0.2]))
    centre = np.array([0.3, -0.2, 0.5])

    def _wrapped(self, a: Any, b: Any, radius: float, cylinder: bool, side: Any = None) -> float | None:
        """Length between points given in the shape's own axes."""
        start, end = (self.centre + self.R @ np.array(p) for p in (a, b))
        beside = None if side is None else self.centre + self.R @ np.array(side)
        found = wrapped(start, end, self.centre, self.R, radius, cylinder, beside)
        if found is None:
            return None
        for point in found[:2]:
            assert np.linalg.norm((self.R.T @ (point - self.centre))[: 2 if cylinder else 3]) == (
                pytest.approx(radius, abs=1e-14)
            )
        return float(np.linalg.norm(found.first - start) + found.length + np.linalg.norm(end - found.last))

    def test_a_sphere_by_its_great_circle(self) -> None:
        """Ends at distances d and e from the centre, an angle between them: tangents and an arc."""
        d, e, r, angle = 2.0, 1.5, 1.0, 2.8
        a = np.array([d, 0.0, 0.0])
        b = e * np.array([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
        arc = angle - np.arccos(r / d) - np.arccos(r / e)
        wanted = np.sqrt(d**2 - r**2) + np.sqrt(e**2 - r**2) + r * arc
        assert self._wrapped(a, b, r, False) == pytest.approx(wanted, rel=1e-14)

    def test_a_cylinder_unrolled(self) -> None:
        r, climb = 1.0, 3.0
        flat = 2.0 * np.sqrt(3.0) + r * (np.pi - 2.0 * np.arccos(0.5))
        found = self._wrapped([2.0, 0.0, 0.0], [-2.0, 1e-12, climb], r, True)
        assert found == pytest.approx(np.hypot(flat, climb), rel=1e-12)

    def test_the_side_decides_which_way(self) -> None:
        a, b = [-2.0, 0.5, 0.0], [2.0, 0.5, 0.0]
        above = self._wrapped(a, b, 1.0, True, side=[0.0, 2.0, 0.0])
        below = self._wrapped(a, b, 1.0, True, side=[0.0, -2.0, 0.0])
        assert above is not None and below is not None and below > above + 0.9
        assert self._wrapped([-2.0, 1.5, 0.0], [2.0, 1.5, 0.0], 1.0, True, side=[0.0, 2.0, 0.0]) is None
        assert self._wrapped([-2.0, 1.5, 0.0], [2.0, 1.5, 0.0], 1.0, True, side=[0.0, -2.0, 0.0]) is not None

    def test_inside_it_is_reflected_where_it_is_shortest(self) -> None:
        a, b = np.array([2.0, 1.0, 0.0]), np.array([-1.0, 2.0, 0.0])
        found = self._wrapped(a, b, 0.7, True, side=[0.1, 0.0, 0.0])
        ways = np.linspace(0.0, 2.0 * np.pi, 200_001)
        points = 0.7 * np.stack([np.cos(ways), np.sin(ways), 0.0 * ways], axis=1)
        shortest = (np.linalg.norm(points - a, axis=1) + np.linalg.norm(points - b, axis=1)).min()
        assert found == pytest.approx(shortest, rel=1e-9)


class TestTendonSpring:
    @staticmethod
    def _rhombus(path: Path, backend: Any, **more: Any) -> rg.Trajectory:
        shipped = rg.load("rhombus")
        spring = rg.TendonSpring(path, 20.0, **more)
        mech = rg.Mechanism.from_pinocchio(
            shipped.model, shipped.closures, shipped.independent, shipped.home, forces=[spring]
        )
        return rg.simulate(mech, duration=0.2, step=1e-3, record=("energy", "tau"), backend=backend)

    @pytest.mark.parametrize(
        "path",
        [
            rg.FixedTendon({"q1": 1.0, "q3": -0.5}),
            rg.SpatialTendon(["universe", "coupler", "rocker_tip"]),
            rg.SpatialTendon(["universe", rg.Wrap("coupler", 0.2), "coupler_tip"]),
        ],
    )
    def test_both_backends_and_energy(self, path: Path) -> None:
        runs = [self._rhombus(path, backend, lower=0.1, upper=0.4) for backend in ("native", "python")]
        assert runs[0].stats.native_steps == 200
        assert np.abs(runs[0].q - runs[1].q).max() < 1e-12
        assert np.abs(runs[0].tau - runs[1].tau).max() < 1e-11  # type: ignore[operator]
        assert np.abs(runs[0].energy_error()).max() < 1e-9

    def test_it_is_the_spring_of_a_joint_where_its_path_is_one(self) -> None:
        shipped = rg.load("rhombus")
        forces: list[list[Any]] = [
            [rg.JointSpring("q1", 12.0, 0.3), rg.JointDamper("q1", 0.7)],
            [rg.TendonSpring(rg.FixedTendon({"q1": 2.0}), 3.0, 0.6, 0.6, 0.175)],
        ]
        runs = [
            rg.simulate(
                rg.Mechanism.from_pinocchio(
                    shipped.model, shipped.closures, shipped.independent, shipped.home, forces=each
                ),
                duration=0.5, step=1e-3,
            )
            for each in forces
        ]  # fmt: skip
        assert np.abs(runs[0].q - runs[1].q).max() < 1e-13
        slopes = [rg.derivatives(run.mechanism, run.q[-1], run.v[-1]).da_dy for run in runs]
        assert slopes[0] == pytest.approx(slopes[1], rel=1e-10)

    @pytest.mark.parametrize("power", ["spring", "motor"])
    def test_over_both_frames_of_a_closure_derivatives_are_those_over_one(self, power: str) -> None:
        shipped, found = rg.load("crank_rocker"), []
        for names in (["coupler_tip", "rocker_tip", "ground"], ["rocker_tip", "ground"]):
            cord = rg.SpatialTendon(names)
            mech = rg.Mechanism.from_pinocchio(
                shipped.model, shipped.closures, shipped.independent, shipped.home,
                forces=[rg.TendonSpring(cord, 50.0, upper=0.5)] if power == "spring" else [],
                actuators=[rg.Actuator.motor("winch", cord)],
            )  # fmt: skip
            ctrl = None if power == "spring" else {"winch": 3.0}
            run = rg.simulate(mech, v0=mech.lift(mech.home, [2.0]), duration=0.02, step=5e-3, ctrl=ctrl)
            g = rg.gradient(run, rg.Cost(terminal=lambda q, v: q[0] + v[0]))
            found.append(np.concatenate([run.q[-1], g.dy, g.dv]))
        assert found[0] == pytest.approx(found[1], rel=1e-8)

    def test_a_damper_takes_what_the_energy_loses(self) -> None:
        run = self._rhombus(rg.SpatialTendon(["universe", "coupler_tip"]), "auto", damping=3.0)
        assert run.work is not None and run.work[-1] < -1e-3
        assert np.abs(run.energy_error()).max() < 1e-9


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rg.FixedTendon({}), "must be {joint: number}"),
        (lambda: rg.FixedTendon({"q1": np.nan}), "coefficient of 'q1'"),
        (lambda: rg.SpatialTendon(["a", rg.Wrap("b", 0.1)]), "between two sites"),
        (lambda: rg.SpatialTendon([3, "a"]), "no site, Pulley or Wrap"),  # type: ignore[list-item]
        (lambda: rg.Pulley(0.0), "must be positive"),
        (lambda: rg.Wrap("a", 0.1, "box"), "no sphere or cylinder"),
        (lambda: rg.TendonSpring("q1", 1.0), "no path"),  # type: ignore[arg-type]
        (lambda: rg.TendonSpring(rg.FixedTendon({"q1": 1.0}), -1.0), "are not negative"),
        (lambda: rg.FixedTendon({"no": 1.0}).on(Tree(MODEL), "tendon 't'"), "tendon 't'.*no joint"),
        (lambda: rg.FixedTendon({"j2": 1.0}).on(Tree(MODEL), "tendon 't'"), "tendon 't'"),
        (lambda: rg.SpatialTendon(["a0", "no"]).on(Tree(MODEL), "tendon 't'"), "no frame 'no'"),
        (lambda: rg.TurningJoint("j1", (1, 0, 0)).on(Tree(MODEL), "x"), "neither spherical nor free"),
    ],
)
def test_what_is_no_path_is_refused_by_name(make: Any, message: str) -> None:
    with pytest.raises(rg.RobustGcpError, match=message):
        make()
