"""Local analysis: ranks, kernels, forms, modes, and answers that are never a guess."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.analysis import local
from robust_gcp.analysis.second_order import second_order_forms
from robust_gcp.examples import linkages, six_bars, spatial
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.cluster.jet import null_pairing
from robust_gcp.maps.cluster.space import ClusterSpace
from robust_gcp.mechanism.constraint.closures import Closure

Array = NDArray[np.float64]
PI = np.pi
TILT = pin.SE3(pin.exp3(np.array([0.3, 0.4, 0.5])), np.array([0.1, 0.2, 0.3]))


def hinge_about_x(frame1: str, frame2: str) -> rg.RevoluteClosure:
    return rg.RevoluteClosure(frame1, frame2, axis=(1.0, 0.0, 0.0))


def linkage(
    l0: float,
    l1: float,
    l2: float,
    l3: float,
    plane: pin.SE3 | None = None,
    kind: Callable[[str, str], Closure] = rg.PointClosure,
) -> rg.Mechanism:
    """A four-bar of any lengths, possible or not, in any plane of space."""
    model = pin.Model()
    crank = linkages.add_link(model, 0, 0.0, "q1", l1)
    linkages.add_link(model, crank, l1, "q2", l2)
    rocker = linkages.add_link(model, 0, l0, "q3", l3)
    for joint in (crank, rocker):
        model.jointPlacements[joint] = (plane or pin.SE3.Identity()) * model.jointPlacements[joint]
    return rg.Mechanism.from_pinocchio(model, [kind("q2_tip", "q3_tip")], ["q1"])


def assert_modes(here: rg.LocalAnalysis, expected: list[list[float]]) -> None:
    """The same directions in any order: largest entry ±1, first non-zero entry positive."""
    found = sorted(np.round(t, 9).tolist() for t in here.modes)
    np.testing.assert_allclose(found, sorted(np.round(t, 9).tolist() for t in expected), atol=1e-8)


def assert_certified(mech: rg.Mechanism, here: rg.LocalAnalysis) -> None:
    """What every analysis claims about itself, whatever its kind."""
    K = mech.K(here.q)
    for basis in (here.kernel, here.left_kernel):
        np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    scale = max(1.0, np.abs(K).max())
    assert np.abs(K @ here.kernel).max(initial=0.0) <= 1e-7 * scale  # RANK 1e-8
    assert np.abs(here.left_kernel.T @ K).max(initial=0.0) <= 1e-7 * scale
    assert here.rank + here.kernel.shape[1] == mech.nv
    assert here.rank + here.left_kernel.shape[1] == mech.nc
    assert here.rank <= here.generic_rank <= min(mech.nc, mech.nv)
    assert here.differential_dof == mech.nv - here.rank
    assert np.all(np.diff(here.singular_values) <= 0.0)
    for tangent in here.modes:
        basis = tangent.reshape(mech.nv, -1)
        assert np.abs(K @ basis).max() <= 1e-7 * scale
        for form in here.forms:  # each mode satisfies the second order
            w = here.kernel.T @ basis
            assert np.abs(np.diag(w.T @ form @ w)).max() <= 1e-6 * np.abs(form).max()


# --------------------------------------------------------------------------- the paper's rhombus


REGULAR = {  # a point of each operation mode of docs/method.md, and its tangent
    "a, parallelogram": ([0.2, -0.2, 0.2], [1.0, -1.0, 1.0]),
    "b, links 2 and 3 folded": ([0.0, 1.0, 1.0], [0.0, 1.0, 1.0]),
    "c, links 1 and 2 folded": ([2.0, PI, PI], [1.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("mode", REGULAR)
def test_regular_points_of_the_three_operation_modes(mode: str) -> None:
    mech, (q, tangent) = rg.load("rhombus"), REGULAR[mode]
    here = rg.analyse(mech, q)
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("regular", 2, 2, 1)
    assert_modes(here, [tangent])
    assert_certified(mech, here)


SINGULAR = {  # where two of these modes meet, and K's only row that is not zero, from (5)
    "a and b": ([0.0, 0.0, 0.0], [2.0, 1.0, -1.0], "ab"),
    "a and c": ([PI, -PI, PI], [0.0, 1.0, 1.0], "ac"),
    "b and c": ([0.0, PI, PI], [0.0, -1.0, 1.0], "bc"),
    "b and c, other turns": ([0.0, -PI, 3 * PI], [0.0, -1.0, 1.0], "bc"),
    "a and c, on the way down": ([-PI, PI, -PI], [0.0, 1.0, 1.0], "ac"),
}


@pytest.mark.parametrize("where", SINGULAR)
def test_flat_poses_where_two_modes_meet(where: str) -> None:
    mech, (q, row, letters) = rg.load("rhombus"), SINGULAR[where]
    np.testing.assert_allclose(mech.K(q), [[0.0, 0.0, 0.0], row], atol=1e-15)
    here = rg.analyse(mech, q)
    assert (here.kind, here.rank, here.generic_rank) == ("singular", 1, 2)
    assert (here.differential_dof, here.local_dof) == (2, 1)
    tangents = {mode[0]: tangent for mode, (_, tangent) in REGULAR.items()}
    assert_modes(here, [tangents[letter] for letter in letters])
    assert_certified(mech, here)
    assert "2 modes" in here.message


@pytest.mark.parametrize("error", (1e-12, 1e-10, 1e-9))
def test_a_singular_configuration_is_recognised_when_typed(error: float) -> None:
    """To 1e-9 rad: σ₂ grows like the distance, and RANK is 1e-8."""
    here = rg.analyse(rg.load("rhombus"), [error, -error, error])
    assert here.kind == "singular"
    assert_modes(here, [[0.0, 1.0, 1.0], [1.0, -1.0, 1.0]])


@pytest.mark.parametrize("distance", (1e-6, 1e-3))
def test_a_regular_configuration_beside_it_is_regular(distance: float) -> None:
    here = rg.analyse(rg.load("rhombus"), [distance, -distance, distance])
    assert here.kind == "regular"
    np.testing.assert_allclose(here.modes[0], [1.0, -1.0, 1.0], atol=1e-9)


# --------------------------------------------------------------------------- other linkages

FLAT = {
    # (l0, l1, l2, l3), flat q. Second order on K v = 0 (see test_modes_of_flat_four_bars):
    # the kite turns, or its coupler and rocker fold about the tip of the crank
    "kite, open": ((2.0, 2.0, 1.0, 1.0), [0.0, 0.0, 0.0]),
    "kite, folded": ((2.0, 2.0, 1.0, 1.0), [0.0, PI, PI]),
    "parallelogram, stretched": ((1.0, 2.0, 1.0, 2.0), [0.0, 0.0, 0.0]),
    "parallelogram, folded": ((1.0, 2.0, 1.0, 2.0), [PI, -PI, PI]),
    # 4 + 2 = 3 + 3: crank to the left, coupler and rocker to the right
    "change point": ((4.0, 2.0, 3.0, 3.0), [PI, -PI, PI]),
    "inner change point": ((1.0, 2.0, 2.5, 3.5), [0.0, 0.0, 0.0]),  # 2 + 2.5 = 1 + 3.5
}


@pytest.mark.parametrize("name", FLAT)
def test_modes_of_flat_four_bars(name: str) -> None:
    """With a_i = l_i (±1 where a link points right or left), φ₂ = 0 to first order reads
    a1 v1 + a2 v12 = a3 v3, and φ₁ = 0 to second order a1 v1² + a2 v12² = a3 v3²."""
    lengths, q = FLAT[name]
    mech = linkage(*lengths)
    here = rg.analyse(mech, q)
    assert (here.kind, here.rank, here.generic_rank) == ("singular", 1, 2)
    assert len(here.modes) == 2
    assert_certified(mech, here)
    a = np.array(lengths[1:]) * np.cos([q[0], q[0] + q[1], q[2]])
    for v in here.modes:
        rates = np.array([v[0], v[0] + v[1], -v[2]])
        assert abs(a @ rates) <= 1e-9
        assert abs(a[:2] @ rates[:2] ** 2 - a[2] * rates[2] ** 2) <= 1e-8


@pytest.mark.parametrize("lengths", ((1.0, 2.0, 1.0, 2.0), (4.0, 2.0, 3.0, 3.0), (1.0, 2.0, 2.5, 3.5)))
def test_modes_are_the_tangents_of_the_closed_form(lengths: tuple[float, float, float, float]) -> None:
    """γ'(y*) of both assemblies, from the closed form, which is smooth through the change point."""
    mech = linkage(*lengths)
    bars = [FourBar(*lengths, s) for s in (1, -1)]
    for y in (0.0, PI):
        q = bars[0].evaluate(y)[0]
        here = rg.analyse(mech, q)
        if here.kind == "regular":  # a change point at one end only
            continue
        tangents = [bar.evaluate(y, near=q)[1] for bar in bars]
        assert_modes(here, [(t / np.abs(t).max()).tolist() for t in tangents])


def test_mobility_two_gives_planes() -> None:
    """A rhombus on a swinging base: each mode of the rhombus, and the swing along with it."""
    mech = linkages.swinging_four_bar(1.0, 1.0, 1.0, 1.0, swing=0.3, y=0.5)
    here = rg.analyse(mech, [0.3, 0.0, 0.0, 0.0])
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("singular", 1, 2, 2)
    assert_certified(mech, here)
    expected = [np.array([[1.0, 0, 0, 0], [0, *t]]).T for t in ([1, -1, 1], [0, 1, 1])]
    spans = [Q @ Q.T for Q in (np.linalg.qr(t)[0] for t in expected)]
    found = [t @ t.T for t in here.modes]  # orthonormal bases: projectors
    assert all(t.shape == (4, 2) for t in here.modes)
    assert len(found) == 2
    for span in spans:
        assert min(np.abs(span - other).max() for other in found) < 1e-9


@pytest.mark.parametrize("n", (2, 3))
def test_loops_in_a_row_are_taken_loop_by_loop(n: int) -> None:
    """All n rhombi flat. Loop i, between cranks i and i + 1 with coupler i, is on mode a
    (crank i + 1 turns as crank i, the coupler keeps its direction) or on b (crank i rests); after
    a loop on b all cranks before must rest: n + 1 different modes, one for each crank that moves
    first, and each of them once."""
    mech = linkages.n_four_bar(n, angle=0.0)
    here = rg.analyse(mech, mech.home)
    assert (here.kind, here.rank, here.generic_rank) == ("singular", n, 2 * n)
    assert_certified(mech, here)
    expected = []
    for first in range(n + 1):
        rates = dict.fromkeys(mech.joint_names, 0.0)
        for i in range(n + 1):
            if i >= first:
                rates[f"crank{i}"] = 1.0
                if i < n:
                    rates[f"coupler{i}"] = -1.0
            elif i == first - 1:
                rates[f"coupler{i}"] = 1.0  # 2 v_i + w_i = v_{i+1} with v_i = 0
        expected.append([rates[name] for name in mech.joint_names])
    assert_modes(here, expected)


# --------------------------------------------------------------------------- no guesses


def test_a_definite_form_is_an_isolated_point() -> None:
    """A stretched triangle of 1 + 1 + 1 on a ground link of 3: K has rank 1, yet nothing moves."""
    mech = linkage(3.0, 1.0, 1.0, 1.0)
    here = rg.analyse(mech, [0.0, 0.0, PI])
    assert (here.kind, here.modes, here.local_dof, here.differential_dof) == ("isolated", (), 0, 2)
    assert "isolated" in here.message
    assert np.all(np.linalg.eigvalsh(here.forms[0]) * np.sign(here.forms[0][0, 0]) > 0.0)


def test_a_form_of_rank_one_is_decided_beyond_second_order() -> None:
    """Both cranks on one pivot, l0 = 0 and l1 + l2 = l3: a flat triangle that can only turn.
    Σ a_i v_i² on Σ a_i v_i = 0 is degenerate for Σ a_i = l0 = 0: the mode lies in the singular set."""
    mech = linkage(0.0, 1.0, 1.5, 2.5)
    for y in (0.0, 0.3):
        here = rg.analyse(mech, [y, 0.0, y])
        assert (here.kind, here.local_dof) == ("inside", 1)
        assert here.modes[0] == pytest.approx([1.0, 0.0, 1.0], abs=1e-9)
        assert len(here.forms) == 1
        values = np.linalg.eigvalsh(here.forms[0])
        assert np.abs(values).min() < 1e-9 * np.abs(values).max()


def test_an_open_loop_is_not_analysed() -> None:
    with pytest.raises(rg.ClosureError, match=r"analyse: q: the loop coupler_tip – rocker_tip .*assemble"):
        rg.analyse(rg.load("rhombus"), [0.2, -0.1, 0.2])


def test_without_loops_everything_is_one_smooth_mode() -> None:
    mech = rg.Mechanism.from_pinocchio(pin.buildSampleModelManipulator())
    here = rg.analyse(mech, np.zeros(mech.nq))
    assert (here.kind, here.rank, here.local_dof) == ("regular", 0, mech.nv)


def test_a_structure_has_no_mode() -> None:
    """A triangle of two hinged rods, closed on the ground: 2 joints, 2 rows."""
    model = pin.Model()
    first = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, first, 1.0, "q2", 1.0)
    base = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    model.addFrame(pin.Frame("base", 0, base, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(model, [rg.PointClosure("q2_tip", "base")], [])
    here = rg.analyse(mech, [PI / 3, -2 * PI / 3])
    assert (here.kind, here.rank, here.modes, here.local_dof) == ("regular", 2, (), 0)


# --------------------------------------------------------------------------- redundant closures


@pytest.mark.parametrize("kind", (rg.PointClosure, hinge_about_x))
@pytest.mark.parametrize("lengths", ((1.0, 1.0, 1.0, 1.0), (4.0, 1.0, 3.5, 3.0)))
def test_a_planar_loop_closed_in_space_is_redundant(
    kind: Callable[[str, str], Closure], lengths: tuple[float, float, float, float]
) -> None:
    """In a tilted plane all rows move, with a constant rank of 2: no alarm, the same mode."""
    mech, flat = linkage(*lengths, TILT, kind), linkage(*lengths)
    q, G, _ = FourBar(*lengths).evaluate(1.0)
    here = rg.analyse(mech, q)
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("redundant", 2, 2, 1)
    assert_modes(here, [(G / np.abs(G).max()).tolist()])
    assert_modes(rg.analyse(flat, q), [here.modes[0].tolist()])
    assert_certified(mech, here)


@pytest.mark.parametrize("kind", (rg.PointClosure, hinge_about_x))
@pytest.mark.parametrize("where", ("a and b", "a and c", "b and c"))
def test_a_crossing_of_modes_is_seen_through_redundant_rows(
    kind: Callable[[str, str], Closure], where: str
) -> None:
    """The rhombus of the paper in a tilted plane: the row out of the plane changes nothing."""
    q, _, letters = SINGULAR[where]
    mech = linkage(1.0, 1.0, 1.0, 1.0, TILT, kind)
    here = rg.analyse(mech, q)
    assert (here.kind, here.rank, here.generic_rank) == ("singular", 1, 2)
    tangents = {mode[0]: tangent for mode, (_, tangent) in REGULAR.items()}
    assert_modes(here, [tangents[letter] for letter in letters])
    assert_certified(mech, here)


def test_a_planar_chain_welded_in_space_is_redundant() -> None:
    """Four hinges in a ring, cut through a body: 6 rows of rank 3 in a tilted plane."""
    model = pin.Model()
    joint = 0
    for i, length in enumerate((1.0, 3.5, 3.0)):
        joint = linkages.add_link(model, joint, (0.0, 1.0, 3.5)[i], f"q{i + 1}", length)
    joint = linkages.add_link(model, joint, 3.0, "q4", 0.1)
    model.jointPlacements[1] = TILT * model.jointPlacements[1]
    model.addFrame(pin.Frame("end", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    base = TILT * pin.SE3(np.eye(3), np.array([0.0, 4.0, 0.0]))
    model.addFrame(pin.Frame("base", 0, base, pin.FrameType.OP_FRAME))
    mech = rg.Mechanism.from_pinocchio(model, [rg.FrameClosure("end", "base")], ["q1"])
    # the four-bar 4, 1, 3.5, 3 with the rocker seen from its tip: q12 + q3' = θ3 + π, then q4 back
    (q1, q2, theta3), G, _ = FourBar(4.0, 1.0, 3.5, 3.0).evaluate(1.0)
    q3 = theta3 + PI - q1 - q2
    here = rg.analyse(mech, [q1, q2, q3, -q1 - q2 - q3])
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("redundant", 3, 3, 1)
    G4 = np.array([1.0, G[1], G[2] - 1.0 - G[1], -G[2]])
    assert_modes(here, [(G4 / np.abs(G4).max()).tolist()])


def test_a_mode_that_a_weld_leaves_is_redundant() -> None:
    """The rhombus with coupler and rocker welded at their tips: mode b alone is left, on which they
    coincide, with rank 2 of 3 rows. There φ'' vanishes along the mode, and so do the forms."""
    mech = linkage(1.0, 1.0, 1.0, 1.0, kind=rg.FrameClosure)
    for t in (0.2, 1.0, -2.9):
        here = rg.analyse(mech, [0.0, t, t])
        assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("redundant", 2, 2, 1)
        assert_modes(here, [[0.0, 1.0, 1.0]])


def bricard() -> rg.Mechanism:
    """The orthogonal Bricard six-hinge loop of the benchmark A04, cut at its sixth hinge.

    Hinges at (0,0,0), (1,0,0), (1,−1,0), (1,−1,1), (0,−1,1), (0,0,1) m with axes y, z, x, y, z, x
    (shared reference/benchmark_parameters.json, A04_bricard).
    """
    points = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1.0]])
    model = pin.Model()
    joint = 0
    for i, kind in enumerate("YZXYZ"):
        offset = points[i] - (points[i - 1] if i else points[0])
        joint = model.addJoint(
            joint, getattr(pin, f"JointModelR{kind}")(), pin.SE3(np.eye(3), offset), f"q{i + 1}"
        )
        rod = pin.Inertia(1.0, 0.5 * (points[i + 1] - points[i]), 0.01 * np.eye(3))
        model.appendBodyToJoint(joint, rod, pin.SE3.Identity())
    end = pin.SE3(np.eye(3), points[5] - points[4])
    model.addFrame(pin.Frame("end", joint, end, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("base", 0, pin.SE3(np.eye(3), points[5]), pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, [hinge_about_x("end", "base")], ["q1"])


def test_bricard_is_overconstrained_and_moves() -> None:
    """5 rows of constant rank 4 for 5 velocities: mobility 1 where counting says 0."""
    mech = bricard()
    here = rg.analyse(mech, np.zeros(5))
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("redundant", 4, 4, 1)
    assert_certified(mech, here)
    traj = rg.simulate(mech, duration=0.2, step=0.01)  # and so it does when let go
    assert np.abs(traj.q[-1]).max() > 0.05
    assert traj.closure_error().max() < 1e-12
    assert {rg.analyse(mech, q).kind for q in traj.q[::5]} == {"redundant"}


# --------------------------------------------------------------------------- second order


@pytest.mark.parametrize("name", ("rhombus", "kite", "tripod", "spherical loop", "seven hinges"))
def test_forms_against_finite_differences(
    mechanisms: dict[str, rg.Mechanism], derivative: Callable[..., Array], name: str
) -> None:
    """wᵀ Q_u w = uᵀ d²φ(q ⊕ s N w)/ds² = uᵀ d/ds [K(q ⊕ s N w) N w], any u, any q."""
    mech = mechanisms[name]
    rng = np.random.default_rng(0)
    q = mech.tree.integrate(mech.home, rng.uniform(-1, 1, mech.nv))
    left, kernel = rng.normal(size=(mech.nc, 2)), rng.normal(size=(mech.nv, 3))
    forms = second_order_forms(mech, q, left, kernel)
    assert len(forms) == 2
    for _ in range(3):
        w = rng.normal(size=3)
        v = kernel @ w
        rate = derivative(lambda s, v=v: mech.K(mech.tree.integrate(q, s * v)) @ v, 3e-3)
        for u, form in zip(left.T, forms, strict=True):
            np.testing.assert_allclose(form, form.T, atol=1e-12)
            expected = u @ (rate / mech.row_scale)
            assert w @ form @ w == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_transversality() -> None:
    """1 where K has its rank; between 0 and 1 at a crossing; 0 where the modes touch."""
    a, b = np.array([1.0, -1.0, 1.0]), np.array([0.0, 1.0, 1.0])

    def pairing(mechanism: rg.Mechanism, q: np.ndarray, tangent: np.ndarray) -> tuple[int, float]:
        (cluster,) = mechanism.clusters
        space = ClusterSpace(cluster, q)
        way = tangent / space.D
        return null_pairing(space, np.eye(space.rows), space.x(q), way, way[:, None] / np.linalg.norm(way))

    rhombus = rg.load("rhombus")
    assert pairing(rhombus, np.array([0.2, -0.2, 0.2]), a) == (0, 1.0)
    for tangent in (a, b):
        corank, crossing = pairing(rhombus, np.zeros(3), tangent)
        assert corank == 1
        assert 0.1 < crossing <= 1.0
        assert pairing(rhombus, np.zeros(3), -3.0 * tangent) == (1, pytest.approx(crossing, rel=1e-12))
    triangle = linkage(0.0, 1.0, 1.5, 2.5)  # Q(w, ·) = 0 on the motion that there is
    assert pairing(triangle, np.zeros(3), np.array([1.0, 0.0, 1.0]))[1] < 1e-9


@pytest.mark.parametrize("legs", [3, 4])
def test_redundant_legs_flat_keep_the_mode_on_which_all_turn_alike(legs: int) -> None:
    """Two forms ask for the same direction: second order cannot say that it moves, the loops nearby do."""
    flat = six_bars.parallel_legs(legs, 0.0)
    here = rg.analyse(flat, flat.home)
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("singular", legs - 1, legs, 1)
    (mode,) = here.modes
    np.testing.assert_allclose(mode, [1.0, -1.0, *[1.0] * (legs - 1)], atol=1e-9)


def test_many_loops_singular_at_once_are_counted_and_not_taken_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine have 512 combinations of modes; so have 60, whose forms alone would take minutes."""
    model = pin.Model()
    for i in range(9):
        crank = linkages.add_link(model, 0, 0.0, f"a{i}", 1.0)
        linkages.add_link(model, crank, 1.0, f"b{i}", 2.0)
        linkages.add_link(model, 0, 2.0, f"c{i}", 1.0)
    closures = [rg.PointClosure(f"b{i}_tip", f"c{i}_tip") for i in range(9)]
    flat = rg.Mechanism.from_pinocchio(model, closures, [f"a{i}" for i in range(9)])
    monkeypatch.setattr(local, "second_order_forms", None)  # not called
    here = rg.analyse(flat, np.zeros(27))
    assert (here.kind, here.modes, here.local_dof) == ("not certified", (), None)
    assert "more than 8 loops are singular at once" in here.message


def test_sarrus_flat_has_its_own_mode_and_one_of_idle_legs() -> None:
    """Folded, each pair of rods swings about two hinges that coincide: dimension 2, the platform at rest."""
    up = spatial.sarrus(0.8)
    run = rg.simulate(up, v0=up.lift(up.home, [2.0]), duration=0.3, step=1e-3)
    flat = run.crossings[0].q
    here = rg.analyse(up, flat)
    assert (here.kind, here.rank, here.generic_rank, here.local_dof) == ("singular", 2, 4, 2)
    idle, lift = here.modes
    np.testing.assert_allclose(idle[[1, 4]], 0.0, atol=1e-9)
    np.testing.assert_allclose(idle[0], -idle[2], atol=1e-9)
    np.testing.assert_allclose(lift, [0.5, -1.0, 0.5, 0.5, -1.0], atol=1e-9)
    with pytest.raises(rg.NotCertifiedError, match="dimension 2"):
        rg.simulate(up, flat, v0=idle @ [1.0, 0.0], duration=0.1)
