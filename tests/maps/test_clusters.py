"""The same motion, whatever the description: loop clusters, any corank, zones that overlap."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import families, linkages, six_bars
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.cluster.jet import jet
from robust_gcp.maps.cluster.space import space_of

CHANGE_POINT = (4.0, 2.0, 3.0, 3.0)


def assert_same(one: rg.Trajectory, other: rg.Trajectory, tolerance: float = 1e-9) -> None:
    """The same motion to `tolerance`, the same crossings to 1e-6 s."""
    assert np.abs(one.q - other.q).max() < tolerance
    assert len(one.crossings) == len(other.crossings)
    for a, b in zip(one.crossings, other.crossings, strict=True):
        assert abs(a.time - b.time) < 1e-6
        assert (a.cluster, a.corank, a.kind) == (b.cluster, b.corank, b.kind)


def assert_at_their_place(run: rg.Trajectory) -> None:
    """Each crossing lies on the singular set, where `analyse` finds the modes that meet."""
    for crossing in run.crossings:
        assert crossing.cluster is not None
        cluster = run.mechanism.clusters[crossing.cluster]
        K = cluster.loops.scaled(cluster.loops.K(crossing.q[cluster.iq]))
        sigma = np.linalg.svd(K, compute_uv=False)
        expected = cluster.loops.nv - cluster.m - crossing.corank
        assert np.sum(sigma > 1e-9) == expected
        here = rg.analyse(run.mechanism, crossing.q)
        assert here.kind in ("singular", "not certified")


# --------------------------------------------------------------------------- zones that overlap


@pytest.mark.parametrize("angles", [(2.6, 2.65), (2.6, 2.6), (2.6, 3.0), (2.6, np.pi - 1e-3)])
def test_two_four_bars_in_one_model_move_as_each_alone(angles: tuple[float, float]) -> None:
    both = families.four_bars([CHANGE_POINT] * 2, angles)
    run = rg.simulate(both, v0=both.lift(both.home, [3.0, 3.0]), duration=0.4, step=1e-3)
    assert run.closure_error().max() < 1e-12
    assert sorted(c.cluster for c in run.crossings) == [0, 1]
    for i, angle in enumerate(angles):
        alone = linkages.four_bar(*CHANGE_POINT, y=angle)
        v0 = alone.lift(alone.home, [3.0])
        exact = rg.simulate(alone, v0=v0, duration=0.4, step=1e-3, method="closed_form")
        assert np.abs(run.q[:, 3 * i : 3 * i + 3] - exact.q).max() < 1e-12
    assert_at_their_place(run)


def test_the_distance_to_singular_places_does_not_depend_on_the_joint() -> None:
    """Near a dead point of the crank: by the crank itself, which turns back there, as by the others."""
    lengths = (1.8, 2.75, 1.525, 0.575)  # a change point at 0; the crank turns back at −0.8605
    mechanism = linkages.four_bar(*lengths, y=-0.857)
    (cluster,) = mechanism.clusters
    space = space_of(mechanism, cluster, mechanism.home)
    x = space.x(mechanism.home)
    found = [jet(space, x, space.chart(np.array([i]))).nearest()[0] for i in range(3)]
    np.testing.assert_allclose(found, found[0], rtol=1e-9)
    assert found[0] > 0.3


def test_error_controlled_steppers_take_both_zones_at_once() -> None:
    both = families.four_bars([CHANGE_POINT] * 2, (2.6, 2.65))
    v0 = both.lift(both.home, [3.0, 3.0])
    options = {"v0": v0, "duration": 0.4, "step": 2e-2, "rtol": 1e-10, "atol": 1e-12}
    fixed = rg.simulate(both, v0=v0, duration=0.4, step=1e-3)
    for stepper in ("DOP853", "Radau"):
        run = rg.simulate(both, stepper=stepper, **options)
        assert np.abs(run.q - fixed.q[::20]).max() < 1e-7
        assert len(run.crossings) == 2


def test_a_chain_of_change_point_linkages_keeps_order_four() -> None:
    """The second stands on the first one's coupler: coupled dynamics, separate clusters."""
    chain = families.four_bars([CHANGE_POINT] * 2, (2.6, 2.65), parents=[-1, 0])
    v0 = chain.lift(chain.home, [3.0, 3.0])
    runs = [rg.simulate(chain, v0=v0, duration=0.4, step=h) for h in (4e-3, 2e-3, 1e-3)]
    errors = [np.abs(a.q - b.q[::2]).max() for a, b in itertools.pairwise(runs)]
    assert 3.5 < np.log2(errors[0] / errors[1]) < 4.6
    assert [c.cluster for c in runs[-1].crossings] == [0, 1]
    assert_at_their_place(runs[-1])


@pytest.mark.parametrize(
    "names", list(itertools.product(("crank0", "coupler0", "rocker0"), ("crank1", "rocker1")))
)
def test_every_choice_of_coordinates_of_the_chain(names: tuple[str, str]) -> None:
    chain = families.four_bars([CHANGE_POINT] * 2, (2.7, 2.75), parents=[-1, 0])
    v0 = chain.lift(chain.home, [3.0, 3.0])
    reference = rg.simulate(chain, v0=v0, duration=0.3, step=1e-3)
    run = rg.simulate(chain.with_independent(names), v0=v0, duration=0.3, step=1e-3)
    assert_same(run, reference)


def lamp(names: tuple[str, str]) -> rg.Mechanism:
    """Two parallelograms, the second on the first one's plate: mobility 2, both nearly flat."""
    model = pin.Model()
    arm = linkages.add_link(model, 0, 0.0, "p1", 1.0)
    plate = linkages.add_link(model, arm, 1.0, "m1", 0.3)
    upper = linkages.add_link(model, plate, 0.0, "p2", 1.0)
    linkages.add_link(model, upper, 1.0, "m2", 0.3)
    linkages.add_link(model, plate, 0.3, "r2", 1.0)
    linkages.add_link(model, 0, 0.3, "r1", 1.0)
    closures = [rg.PointClosure("m1_tip", "r1_tip"), rg.PointClosure("m2_tip", "r2_tip")]
    return rg.Mechanism(model, closures, names, home=[0.3, -0.3, 0.25, -0.25, 0.25, 0.3])


def test_a_lamp_crosses_at_the_same_times_in_all_coordinates() -> None:
    first = lamp(("p1", "p2"))
    v0 = first.lift(first.home, [-2.0, -2.2])
    reference = rg.simulate(first, v0=v0, duration=0.2, step=1e-3)
    assert [c.cluster for c in reference.crossings] == [0, 1]
    assert_at_their_place(reference)
    for names in (("r1", "r2"), ("m1", "m2"), ("p1", "m2")):
        run = rg.simulate(lamp(names), v0=v0, duration=0.2, step=1e-3)
        assert_same(run, reference)
        for one, two in zip(run.crossings, reference.crossings, strict=True):
            assert abs(one.time - two.time) < 1e-12


def test_multipliers_are_nan_where_they_have_no_value() -> None:
    """Flat, with its links moving against each other, the antiparallelogram needs reactions without bound."""
    linkage = linkages.four_bar(1, 2, 1, 2, y=0.0, assembly=-1)
    mode = next(t for t in rg.analyse(linkage, linkage.home).modes if np.isclose(t[2], 3.0 * t[0]))
    with pytest.warns(rg.SingularityWarning, match="no constraint forces"):
        run = rg.simulate(linkage, v0=3.0 * mode, mode=mode, duration=0.03, step=1e-2, record="multipliers")
    assert run.multipliers is not None
    assert np.all(np.isnan(run.multipliers[0]))
    sizes = np.abs(run.multipliers[1:, 0])
    assert np.all(np.isfinite(sizes)) and sizes[0] > 1.5 * sizes[1] > 2.0 * sizes[2]  # falling as 1/t


# --------------------------------------------------------------------------- any corank


def lift_motion(stages: int, joint: str, step: float = 1e-3) -> rg.Trajectory:
    first = families.scissor_lift(stages)
    lift = families.scissor_lift(stages, independent=joint)
    return rg.simulate(lift, v0=first.lift(first.home, [-2.0]), duration=0.8, step=step)


def test_scissor_lift_through_flat_in_every_coordinate() -> None:
    """Folded at −π/2 and flat at 0 all three loops are singular at once, with coranks 2 and 3."""
    reference = lift_motion(3, "a1")
    assert [c.corank for c in reference.crossings] == [2, 3]
    angle = np.array([c.q[0] for c in reference.crossings])
    np.testing.assert_allclose(angle, [0.0, -np.pi / 2], atol=1e-9)
    for joint in reference.mechanism.joint_names[1:]:
        run = lift_motion(3, joint)
        assert_same(run, reference)
        index = run.mechanism.joint_names.index(joint)
        np.testing.assert_array_equal(run.y[:, 0], run.q[:, index])  # in the coordinates that were named


@pytest.mark.parametrize("stages", [1, 2, 4, 5])
def test_scissor_lifts_keep_their_symmetry(stages: int) -> None:
    """All bars a are parallel on this mode, all bars b too."""
    run = lift_motion(stages, "a1", 2e-3)
    theta = run.q[:, 0]
    expected = {"foot": np.cos(theta), "b1": np.pi - theta}
    for name, value in expected.items():
        index = run.mechanism.joint_names.index(name)
        assert np.abs(run.q[:, index] - value).max() < 1e-8
    assert run.closure_error().max() < 1e-11


def row_flat_at_once(assembly: tuple[int, int], crank: float) -> rg.Mechanism:
    """Loops 2, 3.25, 4, 1.25 and 1.25, 2.5, 2.25, 1.5; the first one's rocker is the second one's crank.

    Both are change-point linkages, and both fold flat where c0 and c1 point to −y: K has corank 2 there.
    """
    model = pin.Model()
    c0 = linkages.add_link(model, 0, 0.0, "c0", 3.25)
    linkages.add_link(model, c0, 3.25, "k0", 4.0)
    c1 = linkages.add_link(model, 0, 2.0, "c1", 2.5)
    hinge = pin.SE3(np.eye(3), np.array([0.0, 1.25, 0.0]))
    model.addFrame(pin.Frame("c1_hinge", c1, hinge, pin.FrameType.OP_FRAME))
    linkages.add_link(model, c1, 2.5, "k1", 2.25)
    linkages.add_link(model, 0, 3.25, "c2", 1.5)
    closures = [rg.PointClosure("k0_tip", "c1_hinge"), rg.PointClosure("k1_tip", "c2_tip")]
    first = FourBar(2.0, 3.25, 4.0, 1.25, assembly[0]).evaluate(crank)[0]
    second = FourBar(1.25, 2.5, 2.25, 1.5, assembly[1]).evaluate(float(first[2]))[0]
    return rg.Mechanism(model, closures, ["c0"], home=[*first, second[1], second[2]])


@pytest.mark.parametrize("assembly", list(itertools.product((1, -1), repeat=2)))
def test_two_loops_flat_at_once_in_every_mode_and_coordinate(assembly: tuple[int, int]) -> None:
    row = row_flat_at_once(assembly, 2.9)
    v0 = row.lift(row.home, [1.0])
    reference = rg.simulate(row, v0=v0, duration=0.4, step=1e-3)
    assert [c.corank for c in reference.crossings] == [2]
    assert_at_their_place(reference)
    for joint in ("k1", "c2"):
        other = row.with_independent([joint])
        assert_same(rg.simulate(other, v0=v0, duration=0.4, step=1e-3), reference)
    flat = reference.crossings[0].q
    modes = rg.analyse(row, flat).modes
    assert len(modes) == 4
    for joint in ("k1", "c2"):
        for one, two in zip(modes, rg.analyse(row.with_independent([joint]), flat).modes, strict=True):
            np.testing.assert_allclose(one, two, atol=1e-9)


# --------------------------------------------------------------------------- nothing left unwatched


def three_legs(third: float) -> rg.Mechanism:
    """A platform on two upright legs of 1 m and a third whose foot fits its length at home."""
    model = pin.Model()
    leg = linkages.add_link(model, 0, 0.0, "a", 1.0)
    platform = linkages.add_link(model, leg, 1.0, "platform", 2.0)
    middle = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    model.addFrame(pin.Frame("middle", platform, middle, pin.FrameType.OP_FRAME))
    linkages.add_link(model, 0, 2.0, "b", 1.0)
    foot = pin.SE3(np.eye(3), np.array([0.0, 1.0, 1.0 - third]))
    joint = model.addJoint(0, pin.JointModelRX(), foot, "c")
    model.appendBodyToJoint(joint, linkages.rod(third), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, third, 0.0]))
    model.addFrame(pin.Frame("c_tip", joint, tip, pin.FrameType.OP_FRAME))
    closures = [rg.PointClosure("platform_tip", "b_tip"), rg.PointClosure("middle", "c_tip")]
    up = 0.5 * np.pi
    return rg.Mechanism(model, closures, ["a"], home=[up, -up, up, up])


@pytest.mark.parametrize("third", [0.7, 0.99, 1.3])
def test_a_platform_that_cannot_move_is_refused(third: float) -> None:
    legs = three_legs(third)
    rates = np.array([1.0, -1.0, 1.0, 1.0 / third])  # all tips move alike: K v = 0
    with pytest.raises(rg.RobustGcpError, match="no mobility"):
        rg.simulate(legs, v0=rates, duration=0.1)


def test_two_bars_flat_between_their_pins_are_a_structure() -> None:
    model = pin.Model()
    linkages.add_link(model, 0, 0.0, "a", 1.0)
    linkages.add_link(model, 0, 2.0, "b", 1.0)
    bars = rg.Mechanism(model, [rg.PointClosure("a_tip", "b_tip")], ["a"], home=[0.0, np.pi])
    with pytest.raises(rg.RobustGcpError, match="no mobility"):
        rg.simulate(bars, duration=0.1)


def test_rows_that_rounded_lengths_leave_open_are_told() -> None:
    legs = three_legs(1.0)
    foot = legs.model.copy()
    foot.jointPlacements[4].translation = foot.jointPlacements[4].translation + [0.0, 0.0, 5e-7]
    longer = rg.Mechanism(foot, legs.closures, ["a"], home=legs.home)
    with pytest.raises(rg.ClosureError):
        rg.simulate(longer, v0=[-1.0, 1.0, -1.0, -1.0], duration=0.3)


@pytest.mark.parametrize("stepper", ["rk4", "Radau", "LSODA", "BDF", "RK45"])
def test_redundant_legs_pass_flat_with_every_stepper(stepper: str) -> None:
    legs = three_legs(1.0)
    v0 = legs.lift(legs.home, [-3.0])
    step = 1e-3 if stepper == "rk4" else 1e-2
    run = rg.simulate(legs, v0=v0, duration=0.6, step=step, stepper=stepper, rtol=1e-9, atol=1e-11)
    assert run.closure_error().max() < 1e-12
    (crossing,) = run.crossings
    assert crossing.time == pytest.approx(0.39684, abs=1e-5)
    assert np.abs(np.sin(crossing.q[0])) < 1e-12
    assert_at_their_place(run)


# --------------------------------------------------------------------------- other descriptions


def change_point_drawn(
    cuts: tuple[str, ...] = (), independent: str = "A", rotation: float = 0.0, unit: float = 1.0
) -> rg.Mechanism:
    """The change-point four-bar by its points at q1 = 2.6, with any cut."""
    q = linkages.four_bar(*CHANGE_POINT, y=2.6).home
    tip = 2.0 * np.array([np.cos(q[0]), np.sin(q[0])])
    end = tip + 3.0 * np.array([np.cos(q[0] + q[1]), np.sin(q[0] + q[1])])
    points = {"O": (0.0, 0.0), "P": tuple(tip), "Q": tuple(end), "R": (4.0, 0.0)}
    links = {"ground": ("O", "R"), "crank": ("O", "P"), "coupler": ("P", "Q"), "rocker": ("R", "Q")}
    joints = [
        ("A", "ground", "crank"),
        ("B", "crank", "coupler"),
        ("C", "coupler", "rocker"),
        ("D", "ground", "rocker"),
    ]
    return families.planar_linkage(points, links, joints, [independent], cuts, rotation=rotation, unit=unit)


def crank_of(names: tuple[str, ...], q: np.ndarray) -> np.ndarray:
    """The crank's angle or rate: the joint A, or, where that is cut, the sum of the rest of the chain."""
    if "A" in names:
        return np.asarray(q[..., names.index("A")])
    return np.asarray(q[..., [names.index(n) for n in "DCB"]].sum(axis=-1))


def test_cuts_trees_rotations_and_units_do_not_matter() -> None:
    drawn = change_point_drawn()
    reference = rg.simulate(drawn, v0=drawn.lift(drawn.home, [3.0]), duration=0.4, step=1e-3)
    assert len(reference.crossings) == 1
    variants = [
        {"cuts": ("A",), "independent": "B"},
        {"cuts": ("B",), "independent": "C"},
        {"cuts": ("C",), "independent": "D"},
        {"cuts": ("D",), "independent": "C"},
        {"rotation": 1.0},
        {"unit": 1000.0},
    ]
    for variant in variants:
        other = change_point_drawn(**variant)
        pace = crank_of(other.joint_names, other.lift(other.home, [1.0]))
        v0 = other.lift(other.home, [3.0 / float(pace)])
        run = rg.simulate(other, v0=v0, duration=0.4, step=1e-3)
        assert (
            np.abs(crank_of(other.joint_names, run.q) - crank_of(drawn.joint_names, reference.q)).max() < 1e-9
        )
        (one,), (two,) = run.crossings, reference.crossings
        assert abs(one.time - two.time) < 1e-6


# --------------------------------------------------------------------------- several coordinates


@pytest.mark.parametrize(
    ("cranks", "rates", "duration", "crossings"),
    [((2.8, 2.5), (3.0, 0.5), 0.2, 1), ((2.9, 2.95), (3.0, 3.0), 0.12, 2)],
)
def test_zones_of_a_cluster_of_two_coordinates_do_not_show(
    cranks: tuple[float, float], rates: tuple[float, float], duration: float, crossings: int
) -> None:
    """Two four-bars that a dyad joins: each has its surface; the motion is that of much narrower zones."""
    joined = six_bars.joined_by_dyad(cranks)
    v0 = joined.lift(joined.home, rates)
    runs = [
        rg.simulate(joined, v0=v0, duration=duration, step=4e-3, options=rg.BridgeOptions(zone=zone))
        for zone in (0.05, 0.02)
    ]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-9
    for run in runs:
        assert run.closure_error().max() < 1e-11
        assert len(run.crossings) == crossings
        assert_at_their_place(run)
    for i in (1, 2):  # each four-bar moves on its closed form
        names = [f"A{i}@O{i}", f"B{i}@P{i}", f"C{i}@Q{i}"]
        q = run.q[:, [run.mechanism.joint_names.index(name) for name in names]]
        linkage = FourBar(*six_bars.CHANGE_POINT)
        home = linkage.evaluate(cranks[i - 1])[0]
        exact = np.array([linkage.evaluate(cranks[i - 1] + angle)[0] for angle in q[:, 0]]) - home
        np.testing.assert_allclose(q[:, 1], exact[:, 1], atol=1e-11)


@pytest.mark.parametrize("stepper", ["DOP853", "LSODA"])
def test_crossings_of_long_steps_close_the_other_loops_too(stepper: str) -> None:
    """Where one loop crosses within a solver's step, the others are where they are at that time."""
    chain = families.four_bars([CHANGE_POINT] * 2, (2.75, 2.8), parents=[-1, 0])
    v0 = chain.lift(chain.home, [3.0, 3.0])
    fine = rg.simulate(chain, v0=v0, duration=0.24, step=1e-3)
    run = rg.simulate(chain, v0=v0, duration=0.24, step=2e-2, stepper=stepper, rtol=1e-9, atol=1e-11)
    for one, two in zip(run.crossings, fine.crossings, strict=True):
        assert np.abs(chain.phi(one.q)).max() < 1e-12
        np.testing.assert_allclose(one.q, two.q, atol=1e-7 if stepper == "LSODA" else 1e-8)
        np.testing.assert_array_equal(one.y, one.q[chain.iq_independent])


def test_a_start_where_modes_meet_is_the_same_in_every_coordinate() -> None:
    """A four-bar and a dyad flat at once, four modes: joints that hardly move on one are replaced."""
    points = {
        "O": (0.0, 0.0),
        "Q": (2.0, 0.0),
        "A": (-0.7, 0.0),
        "B": (1.1, 0.0),
        "P": (2.9, 0.0),
        "G": (-1.6, 0.0),
    }
    links = {"ground": "OQG", "crank": "OA", "coupler": "AB", "rocker": "BQ", "rod": "BP", "arm": "PG"}
    joints = [
        ("o", "ground", "crank"), ("a", "crank", "coupler"), ("b", "coupler", "rocker"),
        ("q", "rocker", "ground"), ("c", "coupler", "rod"), ("p", "rod", "arm"), ("g", "arm", "ground"),
    ]  # fmt: skip
    made = families.planar_linkage(points, links, joints, ["o"])
    modes = rg.analyse(made, np.zeros(made.nq)).modes
    assert len(modes) == 4
    changed = 0
    for mode in modes:
        ends = []
        for name in made.joint_names:
            mechanism = made.with_independent([name])
            run = rg.simulate(mechanism, np.zeros(made.nq), 0.5 * mode, duration=0.05, step=1e-3, mode=mode)
            ends.append(run.q[-1])
            changed += len(run.stats.repartitions)
        np.testing.assert_allclose(ends, ends[0][None].repeat(len(ends), 0), atol=1e-9)
    assert changed > 0


def test_three_coordinates_of_one_cluster_pass_a_singular_surface_alike() -> None:
    """A change-point four-bar, with a chain of four links from its coupler to the ground."""
    q = FourBar(*CHANGE_POINT, 1).evaluate(3.08)[0]
    A = 2.0 * np.exp(1j * q[0])
    B = A + 3.0 * np.exp(1j * (q[0] + q[1]))
    T = 0.5 * (A + B)
    C = T + 1.1 * np.exp(0.6j)
    D = C + 1.3 * np.exp(-0.5j)
    places = {"O": 0j, "Q": 4.0 + 0j, "R": 3.0 - 3.0j, "A": A, "B": B, "T": T, "C": C, "D": D}
    places["E"] = D + 1.2 * np.exp(-2.0j)
    points = {name: (float(z.real), float(z.imag)) for name, z in places.items()}
    names = ("ground", "crank", "coupler", "rocker", "one", "two", "three", "four")
    links = dict(zip(names, ("OQR", "OA", "ATB", "BQ", "TC", "CD", "DE", "ER"), strict=True))
    ends = ("01", "12", "23", "30", "24", "45", "56", "67", "70")
    joints = [(j, names[int(a)], names[int(b)]) for j, (a, b) in zip("oabqtcder", ends, strict=True)]
    first = families.planar_linkage(points, links, joints, ["o", "t", "c"])
    assert [cluster.m for cluster in first.clusters] == [3]
    v0 = first.lift(first.home, [3.0, 0.5, -0.7])
    options = {"v0": v0, "duration": 0.04, "step": 1e-3}
    run = rg.simulate(first, **options)
    assert [c.corank for c in run.crossings] == [1]
    assert_at_their_place(run)
    assert_same(run, rg.simulate(first, backend="python", **options), 1e-10)
    for other in (["b", "t", "c"], ["o", "d", "e"], ["a", "c", "e"]):
        assert_same(run, rg.simulate(first.with_independent(other), **options), 1e-9)


def on_a_gimbal(seed: int, angles: list[pin.JointModel]) -> rg.Mechanism:
    """A body that turns by Euler angles z, y and x, and a slide on it whose end is held."""
    rng, model = np.random.default_rng(seed), pin.Model()
    places = [pin.SE3(pin.exp3(rng.normal(size=3)), 0.4 * rng.normal(size=3)) for _ in range(4)]
    body, joint, place = pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4), 0, places[0]
    for i, angle in enumerate(angles):
        joint, place = model.addJoint(joint, angle, place, f"angle{i}"), pin.SE3.Identity()
    model.appendBodyToJoint(joint, body, places[1])
    slide = pin.JointModelPrismaticUnaligned(np.array([0.6, 0.0, 0.8]))
    joint = model.addJoint(joint, slide, places[2], "slide")
    model.appendBodyToJoint(joint, body, places[1])
    model.addFrame(pin.Frame("end", joint, places[3], pin.FrameType.OP_FRAME))
    q, data = 0.4 * rng.normal(size=model.nq), model.createData()
    pin.forwardKinematics(model, data, q)
    model.addFrame(pin.Frame("start", 0, data.oMi[joint] * places[3], pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("end", "start")], "auto", q)


@pytest.mark.parametrize("seed", [1, 3])
def test_joints_whose_axes_turn_are_the_chains_that_they_amount_to(seed: int) -> None:
    """Beside singular places too, where loops are followed by how K changes, in any of its coordinates."""
    one = on_a_gimbal(seed, [pin.JointModelSphericalZYX()])
    chain = on_a_gimbal(seed, [pin.JointModelRZ(), pin.JointModelRY(), pin.JointModelRX()])
    v = chain.lift(chain.home, [1.0])
    wanted = rg.simulate(chain, v0=v, duration=0.3, step=1e-3)
    beside = 0
    for _, names in one.coordinate_choices(one.home):
        run = rg.simulate(one.with_independent(names), v0=v, duration=0.3, step=1e-3, backend="python")
        assert np.abs(run.q - wanted.q).max() < 1e-9
        assert np.abs(run.energy_error()).max() < 1e-9
        beside += run.stats.zone_evaluations
    assert beside
