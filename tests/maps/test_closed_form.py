"""The closed forms against the constraint they solve, finite differences, and integrated motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from robust_gcp.errors import OptionError
from robust_gcp.maps.closed_form import FourBar, parallelogram_pendulum, pendulum

Array = NDArray[np.float64]
Lengths = tuple[float, float, float, float]
PI = math.pi

FULL_TURN: dict[str, Lengths] = {  # y turns fully: reach is the real line
    "rhombus": (1.0, 1.0, 1.0, 1.0),
    "parallelogram": (1.0, 2.0, 1.0, 2.0),
    "parallelogram_short_crank": (2.0, 1.0, 2.0, 1.0),
    "deltoid": (1.0, 2.0, 2.0, 1.0),
    "deltoid_short_crank": (2.0, 1.0, 1.0, 2.0),
    "crank_rocker": (4.0, 1.0, 3.5, 3.0),
    "change_point": (4.0, 2.0, 3.0, 3.0),
    "change_point_inner": (1.0, 2.0, 2.5, 3.5),  # |l0 − l1| = |l2 − l3|, l2 < l3
    "change_point_outer": (3.0, 2.0, 4.0, 1.0),  # l0 + l1 = l2 + l3
    "kite_turning": (1.0, 1.0, 1.7, 1.7),  # l0 = l1, l2 = l3 > l0
    "double_crank": (1.0, 2.0, 2.2, 1.9),
}
PARTIAL: dict[str, Lengths] = {
    "kite": (2.0, 2.0, 1.0, 1.0),  # |y| ≤ π/3
    "equal_pair": (1.0, 1.0, 1.5, 1.1),  # l0 = l1 only
    "double_rocker": (2.0, 2.5, 1.0, 2.4),
    "inner_with_dead_points": (3.0, 4.0, 1.0, 2.0),
}
CASES = [
    pytest.param(lengths, s, id=f"{name}{s:+d}")
    for name, lengths in {**FULL_TURN, **PARTIAL}.items()
    for s in (1, -1)
]


def phi(lengths: Lengths, q: Array) -> Array:
    """φ of docs/method.md, m."""
    l0, l1, l2, l3 = lengths
    tip = l1 * np.exp(1j * q[0]) + l2 * np.exp(1j * (q[0] + q[1])) - l0 - l3 * np.exp(1j * q[2])
    return np.array([tip.real, tip.imag])


def constraint(lengths: Lengths, q: Array, v: Array) -> tuple[Array, Array]:
    """K = ∂φ/∂q (2, 3) and k = −K̇ v (2,), differentiated by hand from φ."""
    _, l1, l2, l3 = lengths
    a, b, c = (l * np.exp(1j * x) for l, x in ((l1, q[0]), (l2, q[0] + q[1]), (l3, q[2])))
    columns = 1j * np.array([a + b, b, -c])
    bias = a * v[0] ** 2 + b * (v[0] + v[1]) ** 2 - c * v[2] ** 2
    return np.array([columns.real, columns.imag]), np.array([bias.real, bias.imag])


def grid(bar: FourBar, count: int, margin: float = 0.0) -> Array:
    """Angles over [−4π, 4π] in reach, at least `margin` from its ends; 0 and ±π among them."""
    low, high = bar.reach
    y = np.union1d(np.linspace(-4 * PI, 4 * PI, count), PI * np.arange(-4, 5))
    near_zero = np.abs(np.remainder(y + PI, 2 * PI) - PI)
    inside = near_zero >= (low + margin if low > 0.0 else 0.0)
    return y[inside & (near_zero <= (high - margin if high < PI else PI))]


def differences(f: list[Array], h: float) -> Array:
    """f' from f at −4h, −3h, …, 4h: central, of eighth order."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    return np.tensordot(weights, np.array(f), 1) / h


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_loop_closes_everywhere_without_jumps(lengths: Lengths, s: int) -> None:
    bar = FourBar(*lengths, s)
    y = grid(bar, 4001, 1e-12)
    q = np.array([bar.evaluate(angle)[0] for angle in y])
    assert np.max(np.abs(phi(lengths, q.T))) <= 1e-14 * sum(lengths)
    steps = np.diff(q, axis=0)[np.diff(y) < 0.01]  # the others leap over what is out of reach
    assert np.max(np.abs(steps)) < 1.0  # a wrong turn would be 2π


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_derivatives_against_finite_differences(lengths: Lengths, s: int) -> None:
    """Without `near`, so that a jump of 2π anywhere in the interval would show as well."""
    bar = FourBar(*lengths, s)
    h = 4e-3
    for y in grid(bar, 101, 0.25):
        values = [bar.evaluate(y + i * h) for i in range(-4, 5)]
        _, G, g1 = values[4]
        # γ varies over the distance from y to where r, S1 or S2 vanishes, in the complex plane
        # too: 0.25 or more here, against h = 0.004.
        assert np.max(np.abs(differences([v[0] for v in values], h) - G)) <= 1e-9
        assert np.max(np.abs(differences([v[1] for v in values], h) - g1)) <= 1e-8


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_velocity_and_acceleration_identities(lengths: Lengths, s: int) -> None:
    """K G = 0 and K g = k hold at crossings too; they fix G and g wherever K_d is regular."""
    bar = FourBar(*lengths, s)
    perimeter, speed, regular = sum(lengths), -3.0, 0
    for y in grid(bar, 401, 1e-3):
        q, G, g1 = bar.evaluate(y)
        K, k = constraint(lengths, q, G * speed)
        size = max(1.0, float(np.max(np.abs(g1))), float(np.max(G**2)))
        assert np.max(np.abs(K @ G)) <= 1e-14 * perimeter * np.max(np.abs(G))
        assert np.max(np.abs(K @ g1 * speed**2 - k)) <= 1e-13 * perimeter * size * speed**2
        K_d = K[:, 1:]
        if np.linalg.cond(K_d) < 100.0:
            regular += 1
            assert np.max(np.abs(G[1:] + np.linalg.solve(K_d, K[:, 0]))) <= 1e-11
            assert np.max(np.abs(g1[1:] - np.linalg.solve(K_d, k) / speed**2)) <= 1e-10 * size
    assert regular > 50


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_smooth_through_change_points(lengths: Lengths, s: int) -> None:
    bar = FourBar(*lengths, s)
    low, high = bar.reach
    crossings = [n * PI for n in range(-4, 5) if (low == 0.0 if n % 2 == 0 else high == PI)]
    for y in crossings:
        left, here, right = (bar.evaluate(y + d) for d in (-1e-7, 0.0, 1e-7))
        for a, b, c in zip(left, here, right, strict=True):
            # 2e-7 times the next derivative: the third is 170 where (3, 4, 1, 2) passes y = 0.
            assert np.max(np.abs(c - a)) <= 5e-5
            np.testing.assert_allclose(b, 0.5 * (a + c), atol=1e-10)


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_near_chooses_the_turns_only(lengths: Lengths, s: int) -> None:
    bar = FourBar(*lengths, s)
    y = float(grid(bar, 401, 0.1)[7])
    q, G, g1 = bar.evaluate(y)
    away = q + np.array([0.0, 6 * PI, -10 * PI])
    other, G2, g2 = bar.evaluate(y, near=away + np.array([1e3, 3.0, -3.0]))
    np.testing.assert_allclose(other, away, atol=1e-13)
    np.testing.assert_array_equal(G, G2)
    np.testing.assert_array_equal(g1, g2)


@pytest.mark.parametrize(("lengths", "s"), CASES)
def test_angles_start_in_the_principal_turn(lengths: Lengths, s: int) -> None:
    bar = FourBar(*lengths, s)
    low, high = bar.reach
    start = 0.0 if low == 0.0 else PI if high == PI else 0.5 * (low + high)
    q = bar.evaluate(start)[0]
    assert np.all(q[1:] > -PI)
    assert np.all(q[1:] <= PI + 1e-9)


# --- the modes by name ---------------------------------------------------------------------------


def test_rhombus_published_values() -> None:
    """docs/method.md: K at (0.2, −0.2, 0.2), G = (1, −1, 1), g = 0, also at both crossings."""
    lengths = FULL_TURN["rhombus"]
    bar = FourBar(*lengths, 1)
    for y, K_published in (
        (0.2, [[-0.1987, 0.0, 0.1987], [1.9801, 1.0, -0.9801]]),
        (0.0, [[0.0, 0.0, 0.0], [2.0, 1.0, -1.0]]),
        (PI, [[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]),
        (-PI, [[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]),
    ):
        q, G, g1 = bar.evaluate(y)
        np.testing.assert_array_equal(q, [y, -y, y])
        np.testing.assert_array_equal(G, [1.0, -1.0, 1.0])
        np.testing.assert_array_equal(g1, 0.0)
        np.testing.assert_allclose(constraint(lengths, q, G)[0], K_published, atol=5e-5)


def test_rhombus_other_assembly_is_mode_c() -> None:
    """Links 1 and 2 folded, q3 = π, tangent (1, 0, 0); it meets mode a at (π, −π, π)."""
    for y in (-PI, 0.3, PI):
        q, G, g1 = FourBar(1.0, 1.0, 1.0, 1.0, -1).evaluate(y, near=[y, -PI, PI])
        np.testing.assert_allclose(q, [y, -PI, PI], atol=1e-15)
        np.testing.assert_array_equal(G, [1.0, 0.0, 0.0])
        np.testing.assert_array_equal(g1, 0.0)


def test_lengths_off_by_a_rounding_are_a_change_point() -> None:
    """0.1 + 0.2 ≠ 0.3 in floats: still the parallelogram mode, through both crossings."""
    lengths = (0.3, 0.1 + 0.2, 0.3, 0.1 + 0.2)
    for y in np.linspace(-7.0, 7.0, 57):
        q, G, _ = FourBar(*lengths, 1).evaluate(float(y))
        np.testing.assert_array_equal(q, [y, -y, y])
        np.testing.assert_array_equal(G, [1.0, -1.0, 1.0])
        assert np.max(np.abs(phi(lengths, q))) <= 1e-14 * sum(lengths)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_true_gap_is_not_rounded_away(gap: float) -> None:
    """A coupler too long by `gap`: the loop still closes to rounding, and the modes veer at π."""
    lengths = (1.0, 1.0, 1.0 + gap, 1.0)
    bar = FourBar(*lengths, 1)
    low, high = bar.reach
    assert high == PI
    assert low == pytest.approx(gap, rel=1e-3)
    for y in (1.01 * low, 0.1, PI - gap, PI, PI + gap, 4.0):
        assert np.max(np.abs(phi(lengths, bar.evaluate(y)[0]))) <= 1e-14 * sum(lengths)
    # Across π, at many times the gap's width √gap, it has veered from mode a (q3' = 1) to mode c.
    if gap < 1e-4:
        np.testing.assert_allclose(bar.evaluate(PI - 0.2)[1], [1.0, -1.0, 1.0], atol=1e-3)
        np.testing.assert_allclose(bar.evaluate(PI + 0.2)[1], [1.0, 0.0, 0.0], atol=1e-3)


@pytest.mark.parametrize(("lengths", "factor"), [((1.0, 2.0, 1.0, 2.0), 3.0), ((2.0, 1.0, 2.0, 1.0), -3.0)])
def test_antiparallelogram(lengths: Lengths, factor: float) -> None:
    """tan(q3/2) = (r + 1)/(r − 1) tan(q1/2), r = l1/l0; written so that it holds at π too."""
    assert factor == pytest.approx((lengths[1] / lengths[0] + 1) / (lengths[1] / lengths[0] - 1))
    bar = FourBar(*lengths, -1)
    for y in grid(bar, 801):
        q, G, _ = bar.evaluate(y)
        cross = np.sin(q[2] / 2) * np.cos(y / 2) - factor * np.cos(q[2] / 2) * np.sin(y / 2)
        assert abs(cross) <= 1e-14 * abs(factor)
        # its derivative: q3' = factor (1 + tan²(q1/2)) / (1 + factor² tan²(q1/2))
        rate = factor / (np.cos(y / 2) ** 2 + factor**2 * np.sin(y / 2) ** 2)
        assert G[2] == pytest.approx(rate, abs=1e-13)
    # q3 turns with q1, or against it: once per turn.
    turned = bar.evaluate(1.0 + 2 * PI)[0] - bar.evaluate(1.0)[0]
    np.testing.assert_allclose(turned[2], math.copysign(2 * PI, factor), atol=1e-13)


def test_one_equality_swaps_assemblies_every_turn() -> None:
    """At change_point (4, 2, 3, 3) the modes cross once per turn, at y = π."""
    lengths = FULL_TURN["change_point"]
    plus, minus = FourBar(*lengths, 1), FourBar(*lengths, -1)
    for y in (0.0, 1.0, PI, 5.0):
        q = plus.evaluate(y)[0]
        np.testing.assert_allclose(np.exp(1j * minus.evaluate(y + 2 * PI)[0]), np.exp(1j * q), atol=1e-14)
    assert np.max(np.abs(plus.evaluate(1.0)[0] - minus.evaluate(1.0)[0])) > 0.1


def test_kite_reach() -> None:
    """l0 = l1 = 2, l2 = l3 = 1: r = 4 sin(|y|/2) ≤ 2, so |y| ≤ π/3; smooth through r = 0."""
    bar = FourBar(*PARTIAL["kite"], 1)
    assert bar.reach == pytest.approx((0.0, PI / 3))
    with pytest.raises(OptionError, match=r"out of reach.*1\.0471975511"):
        bar.evaluate(1.05)
    # At y = 0 coupler and output link lie on one another at ±90° from link 1.
    np.testing.assert_allclose(bar.evaluate(0.0)[0], [0.0, 0.0, 0.0], atol=1e-15)


# --- hypothesis: change-point linkages of all three kinds -----------------------------------------

length = st.floats(0.3, 3.0)


@st.composite
def change_point_lengths(draw: st.DrawFn) -> Lengths:
    """Grashof equality: the sum of the longest and the shortest is that of the other two."""
    l0, l1, l2 = draw(length), draw(length), draw(length)
    kind = draw(st.sampled_from(["outer", "inner same", "inner opposite"]))
    l3 = {
        "outer": l0 + l1 - l2,  # l0 + l1 = l2 + l3
        "inner same": l2 - (l0 - l1),  # l0 − l1 = l2 − l3
        "inner opposite": l2 + (l0 - l1),  # l0 − l1 = l3 − l2
    }[kind]
    assume(l3 > 0.1)
    assume(l0 == l1 or abs(l0 - l1) > 1e-3)  # where r is small G has errors of ε l1 / |l0 − l1|
    return l0, l1, l2, l3


@settings(max_examples=300, deadline=None)
@given(change_point_lengths(), st.sampled_from([1, -1]), st.data())
def test_random_change_point_linkages(lengths: Lengths, s: int, data: st.DataObject) -> None:
    bar = FourBar(*lengths, s)
    low, high = bar.reach
    inside = data.draw(st.floats(0.01, 0.99)) * (high - low) + low
    angles = [inside, -inside, inside + 4 * PI, 2 * PI - inside]
    if low == 0.0:
        angles += [0.0, 2 * PI, -2 * PI]
    if high == PI:
        angles += [PI, -PI, 3 * PI]
    perimeter = sum(lengths)
    for y in angles:
        q, G, g1 = bar.evaluate(y)
        assert np.max(np.abs(phi(lengths, q))) <= 1e-14 * perimeter
        K, k = constraint(lengths, q, G)
        # Close to a second equality r, S1 or S2 is small without vanishing: γ bends sharply there.
        size = max(1.0, float(np.max(np.abs(G))))
        bend = max(size**2, float(np.max(np.abs(g1))))
        assert np.max(np.abs(K @ G)) <= 1e-13 * perimeter * size
        assert np.max(np.abs(K @ g1 - k)) <= 1e-12 * perimeter * bend
        step = 1e-7 / bend  # small beside the distance to a dead point, 0.01 (high − low)
        before, after = (bar.evaluate(y + d) for d in (-step, step))
        assert np.max(np.abs(after[0] - before[0])) <= 2.5e-7
        change = np.abs(after[1] - before[1])
        assert np.max(change) <= 2.5e-7 + 1e-12 * size


@settings(max_examples=200, deadline=None)
@given(change_point_lengths(), st.sampled_from([1, -1]), st.floats(0.05, 0.95))
def test_assembly_is_recognised(lengths: Lengths, s: int, fraction: float) -> None:
    bar = FourBar(*lengths, s)
    low, high = bar.reach
    q = bar.evaluate(low + fraction * (high - low))[0]
    other = FourBar(*lengths, -s).evaluate(q[0], near=q)[0]
    assume(np.max(np.abs(q - other)) > 1e-5)
    assert FourBar.assembly_of(*lengths, q + np.array([0.0, 2 * PI, -4 * PI])) == bar


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        (0.0, 1.0, 1.0, 1.0, 1),
        (1.0, -1.0, 1.0, 1.0, 1),
        (1.0, math.nan, 1.0, 1.0, 1),
        (math.inf, math.inf, 1.0, 1.0, 1),
        (3.0, 1.0, 1.0, 1.0, 1),  # rigid: just reaches
        (1.0, 1.0, 4.0, 1.0, 1),
        (1.0, 1.0, 1.0, 1.0, 0),
    ],
)
def test_bad_linkages_are_refused(arguments: tuple[float, float, float, float, int]) -> None:
    with pytest.raises(OptionError):
        FourBar(*arguments)


def test_bad_angles_are_refused() -> None:
    for y in (math.nan, math.inf):
        with pytest.raises(OptionError, match="out of reach"):
            FourBar(1.0, 1.0, 1.0, 1.0).evaluate(y)
    # The end of the kite's reach is a dead point: G is beyond bounds just inside, refused at it.
    bar = FourBar(2.0, 2.0, 1.0, 1.0)
    end = bar.reach[1]
    try:
        _, G, _ = bar.evaluate(end)
        assert np.max(np.abs(G)) > 1e6
    except OptionError:
        pass
    with pytest.raises(OptionError, match="out of reach"):
        bar.evaluate(end + 1e-12)


def test_assembly_of_refuses_change_points_and_open_loops() -> None:
    with pytest.raises(OptionError, match="both"):
        FourBar.assembly_of(1.0, 1.0, 1.0, 1.0, [PI, -PI, PI])
    with pytest.raises(OptionError, match="neither"):
        FourBar.assembly_of(1.0, 1.0, 1.0, 1.0, [0.2, -0.2, 0.3])
    assert FourBar.assembly_of(1.0, 1.0, 1.0, 1.0, [0.2, -0.2, 0.2]).assembly == 1
    assert FourBar.assembly_of(1.0, 1.0, 1.0, 1.0, [0.0, 0.0, 0.0]).assembly == 1
    assert FourBar.assembly_of(1.0, 1.0, 1.0, 1.0, [-4.0, PI, -PI]).assembly == -1


# --- the pendulum ---------------------------------------------------------------------------------

INERTIA, MOMENT = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
OMEGA = math.sqrt(MOMENT / INERTIA)


def test_parallelogram_inertia_from_kinetic_energy() -> None:
    """Rods of 2, 3, 5 kg: ½ A ẏ² and B sin y from rod by rod sums over thin slices."""
    l1, l3, m1, m2, m3, g = 1.5, 1.5, 2.0, 3.0, 5.0, 1.6
    A, B = parallelogram_pendulum(l1, l3, m1, m2, m3, gravity=g)
    n = 2000
    middle = (np.arange(n) + 0.5) / n
    assert pytest.approx(np.sum((m1 + m3) / n * (l1 * middle) ** 2) + m2 * l1**2, rel=1e-6) == A
    assert pytest.approx((np.sum((m1 + m3) / n * l1 * middle) + m2 * l1) * g, rel=1e-12) == B
    assert pytest.approx((5.0 / 3.0, 2.0 * 9.81)) == (INERTIA, MOMENT)


STARTS = [
    (0.2, 0.0), (0.2, 3.0), (-1.5, 1e-3), (1.5, 0.0), (0.2, -9.0), (1.0, 15.0),
    (20.0, 1.0), (-100.0, -8.0), (0.3, 5.2), (-PI / 2, 6.8), (-PI / 2, -6.9),
]  # fmt: skip


@pytest.mark.parametrize(("y0", "ydot0"), STARTS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pendulum_against_integration(y0: float, ydot0: float, sign: float) -> None:
    A, B = INERTIA, sign * MOMENT
    t = np.linspace(0.0, 10.0, 101)
    truth = solve_ivp(
        lambda _, x: [x[1], -B / A * math.cos(x[0])],
        (0.0, 10.0), [y0, ydot0], method="DOP853", rtol=1e-13, atol=1e-14, t_eval=t,
    )  # fmt: skip
    y, ydot, yddot = pendulum(t, y0, ydot0, A, B)
    np.testing.assert_allclose(y, truth.y[0], rtol=0, atol=2e-9)  # the integrator's own error
    np.testing.assert_allclose(ydot, truth.y[1], rtol=0, atol=2e-8)
    np.testing.assert_allclose(yddot, -B / A * np.cos(y), atol=1e-11)


@pytest.mark.parametrize(("y0", "ydot0"), STARTS)
def test_pendulum_energy_and_start(y0: float, ydot0: float) -> None:
    t = np.concatenate([np.linspace(-5.0, 5.0, 201), np.geomspace(10.0, 1e5, 50)])
    y, ydot, _ = pendulum(t, y0, ydot0, INERTIA, MOMENT)
    energy = 0.5 * INERTIA * ydot**2 + MOMENT * np.sin(y)
    start = 0.5 * INERTIA * ydot0**2 + MOMENT * math.sin(y0)
    # At late times y itself is rounded: ε |y| moves the potential energy by that much times B.
    slack = 1e-13 * max(abs(start), MOMENT) + MOMENT * 4e-16 * np.abs(y)
    assert np.all(np.abs(energy - start) <= slack)
    y, ydot, yddot = pendulum(0.0, y0, ydot0, INERTIA, MOMENT)
    assert y.shape == ydot.shape == yddot.shape == ()
    assert y == pytest.approx(y0, abs=4e-15 * max(1.0, abs(y0)))
    assert ydot == pytest.approx(ydot0, abs=1e-14 * OMEGA)
    assert pendulum(np.zeros((2, 3)), y0, ydot0, INERTIA, MOMENT)[0].shape == (2, 3)


def test_pendulum_period_and_long_times() -> None:
    """Swing of amplitude θ0 = 0.2 + π/2: period 4 K(sin²(θ0/2))/ω; same phase after 10⁴ of them."""
    period = 4.0 * ellipk(math.sin(0.5 * (0.2 + PI / 2)) ** 2) / OMEGA
    t = np.linspace(0.0, period, 33)
    now, later = (pendulum(t + d, 0.2, 0.0, INERTIA, MOMENT) for d in (0.0, 1e4 * period))
    np.testing.assert_allclose(later[0], now[0], atol=1e-10)
    # Turning: 2π forward in every period 2 K(1/m)/(√m ω).
    m = math.sin(PI / 4) ** 2 + (15.0 / (2 * OMEGA)) ** 2
    period = 2.0 * ellipk(1.0 / m) / (math.sqrt(m) * OMEGA)
    now, later = (pendulum(t + d, 0.0, 15.0, INERTIA, MOMENT) for d in (0.0, 1e3 * period))
    np.testing.assert_allclose(later[0] - now[0], 2e3 * PI, rtol=0, atol=1e-9)


def test_pendulum_at_rest() -> None:
    t = np.linspace(0.0, 50.0, 11)
    y, ydot, yddot = pendulum(t, -PI / 2, 0.0, INERTIA, MOMENT)
    np.testing.assert_allclose(y, -PI / 2, rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.concatenate([ydot, yddot]), 0.0, atol=1e-14)
    # Upright: float(π/2) is 6e-17 short of π/2, and that is what grows, as e^{ωt}/2.
    y, _, _ = pendulum(np.array([1.0, 5.0]), PI / 2, 0.0, INERTIA, MOMENT)
    np.testing.assert_allclose(y, PI / 2, rtol=0, atol=6.2e-17 * math.exp(5.0 * OMEGA))
    drop = pendulum(6.0, 1.5707, 0.0, INERTIA, MOMENT)[0]
    assert drop < 0.0
    np.testing.assert_array_equal(pendulum(2.0, 0.3, 1.5, 1.0, 0.0), [3.3, 1.5, 0.0])


@pytest.mark.parametrize("excess", [0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-9, -1e-9, 1e-6, -1e-6])
def test_pendulum_near_the_separatrix(excess: float) -> None:
    """Until it nears upright it is tan((θ + π)/4) = tan((θ0 + π)/4) e^{ωt}, to the excess."""
    theta0 = 0.7
    rate = 2.0 * OMEGA * math.cos(0.5 * theta0) * (1.0 + excess)
    t = np.linspace(0.0, 0.8, 17)
    for turn in (1.0, -1.0):
        y, _, _ = pendulum(t, turn * theta0 - PI / 2, turn * rate, INERTIA, MOMENT)
        front = math.tan(0.25 * (theta0 + PI)) * np.exp(OMEGA * t)
        theta = 4.0 * np.arctan(front) - PI
        growth = np.exp(OMEGA * t)
        assert np.all(np.abs(turn * (y + PI / 2) - theta) <= 10 * growth * (abs(excess) + 1e-15))


def test_pendulum_started_near_upright_keeps_its_digits() -> None:
    """From δ below upright at rest, δ cosh ωt while small: 1 − m ≈ δ²/4 is not got from m."""
    for delta in (1e-4, 1e-7, 1e-10):
        y0 = PI / 2 - delta
        true_delta = (PI / 2 - y0) + 6.123233995736766e-17
        t = np.linspace(0.0, math.log(1e-5 / delta) / OMEGA if delta < 1e-6 else 0.5, 9)
        y, ydot, _ = pendulum(t, y0, 0.0, INERTIA, MOMENT)
        fall = PI / 2 - y
        np.testing.assert_allclose(fall, true_delta * np.cosh(OMEGA * t), rtol=1e-7, atol=5e-16)
        np.testing.assert_allclose(-ydot, true_delta * OMEGA * np.sinh(OMEGA * t), rtol=1e-7, atol=1e-17)


def test_pendulum_refuses() -> None:
    for arguments in ((0.2, 0.0, 0.0, 1.0), (math.nan, 0.0, 1.0, 1.0), (0.2, math.inf, 1.0, 1.0)):
        with pytest.raises(OptionError):
            pendulum(1.0, *arguments)


def test_rhombus_free_fall_crosses_the_singularity() -> None:
    """The paper's example: 5 s from y = 0.2 at rest, to −π − 0.2 and back, through −π."""
    t = np.linspace(0.0, 5.0, 5001)
    y, _, _ = pendulum(t, 0.2, 0.0, INERTIA, MOMENT)
    assert np.max(y) == pytest.approx(0.2, abs=1e-5)
    assert np.min(y) == pytest.approx(-PI - 0.2, abs=1e-5)
    assert np.count_nonzero(np.diff(np.sign(y + PI))) >= 2
    bar = FourBar(1.0, 1.0, 1.0, 1.0, 1)
    for angle in y[::50]:
        assert np.max(np.abs(phi((1.0, 1.0, 1.0, 1.0), bar.evaluate(float(angle))[0]))) < 4e-15
