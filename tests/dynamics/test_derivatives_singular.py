"""Derivatives at and beside singular configurations, on every mode, against many digits and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.modes.map_rates import ClusterRates
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.linkages import four_bar, swinging_four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum
from robust_gcp.mechanism.constraint.extended_precision import EPS

from ..exact import ONE, Exact, pi
from ..simulation.test_floating import CHANGE_POINT
from ..simulation.test_floating import floating as on_a_base
from .test_derivatives import TENTH

Array = NDArray[np.float64]

SWING = 0.375

PLACES: dict[str, tuple[Callable[[], rg.Mechanism], list[float], list[float]]] = {
    "rhombus, stretched": (lambda: rg.load("rhombus"), [0, 0, 0], [0, 0, 0]),
    "rhombus, folded": (lambda: rg.load("rhombus"), [1, -1, 1], [0, 0, 0]),
    "parallelogram, stretched": (lambda: rg.load("parallelogram"), [0, 0, 0], [0, 0, 0]),
    "parallelogram, folded": (lambda: rg.load("parallelogram"), [1, -1, 1], [0, 0, 0]),
    "change point": (lambda: four_bar(4.0, 2.0, 3.5, 2.5, y=2.5), [1, 1, 1], [0, 0, 0]),
    "kite": (lambda: four_bar(2.0, 2.0, 1.0, 1.0, y=0.5), [0, 0, 0], [0, 0, 0]),
    "another change point": (lambda: four_bar(3.0, 2.0, 2.5, 2.5, y=1.0), [1, 1, 1], [0, 0, 0]),
    "scissor lift of two stages": (
        lambda: scissor_lift(2), [0, 1, 0, 1, -1], [0, 0, 1, 0, 0],
    ),
    "swinging four-bar": (
        lambda: swinging_four_bar(1.0, 1.0, 1.0, 1.0, SWING, 0.5), [0, 0, 0, 0], [SWING, 0, 0, 0],
    ),
    "two flat loops": (
        lambda: four_bars([(1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 1.0, 2.0)], [0.5, 0.4]), [0] * 6, [0] * 6,
    ),
}  # fmt: skip
"""Name: mechanism, q in units of π, and what is added to it."""


def placed(name: str) -> tuple[rg.Mechanism, list[Decimal]]:
    make, turns, shift = PLACES[name]
    return make(), [Decimal(a) * pi() + Decimal(b) for a, b in zip(turns, shift, strict=True)]


def modes(name: str) -> list[tuple[rg.Mechanism, Array]]:
    """All modes at the place, each in coordinates that move on it."""
    return modes_at(*placed(name))


def modes_at(mech: rg.Mechanism, q: list[Decimal]) -> list[tuple[rg.Mechanism, Array]]:
    found = rg.analyse(mech, [float(x) for x in q])
    assert found.kind == "singular", found.message
    made = []
    for mode in found.modes:
        tangent = mode.reshape(mech.nv, -1)
        single = [j.name for j in mech.joints]
        names: list[str] = []
        rest = tangent / mech.column_scale[:, None]
        for _ in range(mech.m):  # the joints that move most, one after the other
            best = int(np.argmax(np.linalg.norm(rest, axis=1)))
            names.append(single[best])
            way = rest[best] / np.linalg.norm(rest[best])
            rest = rest - np.outer(rest @ way, way)
        made.append((mech.with_independent(sorted(names, key=single.index)), tangent))
    return made


def off(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("name", PLACES)
def test_at_ten_singular_configurations_on_every_mode(name: str) -> None:
    _, q = placed(name)
    there = modes(name)
    assert len(there) >= 2, name
    for mech, tangent in there:
        m = mech.m
        G = tangent @ np.linalg.inv(tangent[mech.iv_independent])
        u = np.array([1.25, -0.75])[:m]
        udot, by_y, by_u, by_tau = Exact(mech).at_singularity(q, tangent, u, np.array([1.0, 0.7])[:m])
        found = rg.derivatives(mech, [float(x) for x in q], G @ u, mode=tangent)
        size = max(np.abs(udot).max(), np.abs(by_y).max(), np.abs(by_u).max())
        label = f"{name}: {np.round(tangent.T, 3)}"
        assert off(found.da_dtau, by_tau) < 1e-12, label
        assert np.abs(found.udot - udot).max() < 1e-11 * size, label
        assert np.abs(found.da_dy - by_y).max() < 1e-11 * size, label
        assert np.abs(found.da_dv - by_u).max() < 1e-11 * size, label


@pytest.mark.parametrize("distance", (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.03, 0.06, 0.1, 0.2))
@pytest.mark.parametrize("y", (0.0, np.pi))
def test_beside_a_singular_configuration(y: float, distance: float) -> None:
    """The rhombus is a pendulum at any distance from flat: A ÿ = −B cos y."""
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    mech, mode, y = rg.load("rhombus"), np.array([1.0, -1.0, 1.0]), y + distance
    found = rg.derivatives(mech, y * mode, 1.3 * mode, mode=mode)
    assert abs(found.da_dy[0, 0] - B * np.sin(y) / A) < 1e-11 * B / A
    assert abs(found.da_dv[0, 0]) < 1e-11
    assert off(found.da_dtau, mode[None] / A) < 1e-12


def test_many_states_of_both_modes_at_once() -> None:
    """What was found around one state serves others of its own mode alone; both pass the same y."""
    mech, both = rg.load("rhombus"), (np.array([1.0, -1.0, 1.0]), np.array([0.0, 1.0, 1.0]))
    for name in ("q3", "q1"):
        made = mech.with_independent([name])
        passing = [mode for mode in both if mode[mech.velocities_of(name)[0]]]
        q = np.array([y * mode for y in (-0.03, 0.01, 0.02, 0.04) for mode in passing])
        v = np.array([1.3 * mode for _ in range(4) for mode in passing])
        together = rg.derivatives(made, q, v)
        for i in range(len(q)):
            alone = rg.derivatives(made, q[i], v[i])
            for part in ("da_dy", "da_dv", "da_dtau", "dv_dy"):
                one, other = getattr(together, part)[i], getattr(alone, part)
                assert np.abs(one - other).max() < 1e-10 * max(1.0, np.abs(other).max()), (name, i, part)


def test_a_mode_is_named_by_its_number_too() -> None:
    """As in simulate, at one state or several, and at the start of a run."""
    mech, flat = rg.load("rhombus").with_independent(["q2"]), np.zeros(3)
    for number, mode in enumerate(rg.analyse(mech, flat).modes):
        for call in (rg.forward_dynamics, rg.inverse_dynamics, rg.regressor):
            given = (flat,) if call is rg.forward_dynamics else (flat, flat, [1.0])
            one, other = (call(mech, *given, mode=named) for named in (number, mode))
            np.testing.assert_array_equal(getattr(one, "matrix", one), getattr(other, "matrix", other))
        A, _ = rg.step_jacobians(mech, [flat, flat], None, None, 1e-3, mode=np.int64(number))
        np.testing.assert_array_equal(A[1], rg.step_jacobians(mech, flat, None, None, 1e-3, mode=mode)[0])
        np.testing.assert_array_equal(
            rg.linearise(mech, flat, mode=number).A, rg.linearise(mech, flat, mode=mode).A
        )
        run = rg.simulate(mech, flat, duration=0.02, step=2e-3, mode=number)
        one, other = (rg.gradient(run, rg.Cost(lambda q, v: q[1]), mode=named) for named in (number, mode))
        np.testing.assert_array_equal(one.dtau, other.dtau)
    with pytest.raises(rg.OptionError, match="mode = 2 names none of the 2 modes"):
        rg.derivatives(mech, flat, mode=2)


class TestOnAFreeBase:
    """A flat linkage on a floating body, on both of its modes, seven coordinates."""

    MECH = on_a_base(pin.JointModelFreeFlyer(), CHANGE_POINT, gravity=True)
    FLAT = np.concatenate([MECH.home[:-3], np.zeros(3)])

    @pytest.mark.parametrize(("number", "step"), ((0, 0.1), (1, 0.06)))
    def test_along_the_mode(self, number: int, step: float) -> None:
        """What is left of the differences of u̇ across the flat position falls with the tenth power of h.

        The steps are such that it is far above the rounding of the derivatives, which have nine digits.
        """
        mech, q = self.MECH, self.FLAT
        mode = rg.analyse(mech, q).modes[number].reshape(mech.nv, -1)
        G = mode @ np.linalg.inv(mode[mech.iv_independent])
        u = np.linspace(-1.0, 1.5, mech.m)
        exact = rg.derivatives(mech, q, G @ u, mode=mode).da_dy[:, -1]

        def error(h: float) -> float:
            values = [self.udot(mode, G @ u, s * k * h) for k in range(1, 6) for s in (1.0, -1.0)]
            pairs = np.array(values[::2]) - np.array(values[1::2])
            return float(np.abs(TENTH @ pairs / h - exact).max() / np.abs(exact).max())

        assert error(step) < 1e-3 and error(0.5 * step) < error(step) / 300.0
        assert error(0.015) < 1e-9

    def test_a_run_takes_the_mode_of_a_number(self) -> None:
        for number, mode in enumerate(rg.analyse(self.MECH, self.FLAT).modes):
            one, other = (
                rg.simulate(self.MECH, self.FLAT, duration=0.01, step=2e-3, mode=named)
                for named in (number, mode)
            )
            np.testing.assert_array_equal(one.q, other.q)

    def udot(self, mode: Array, v: Array, s: float) -> Array:
        """u̇ where the crank has moved by s along the mode, u held."""
        motion = initial_value_problem(self.MECH, self.FLAT, v, mode)
        start, crank = motion.start.point, np.eye(self.MECH.m)[-1]
        for share in np.linspace(0.2, 1.0, 5):
            point = motion.explicit.point_at(start.y + share * s * crank, start.ydot)
        return motion.equations.at_point(0.0, point).ydd


def beside_a_change_point(gap: float, beside: float) -> tuple[float, float]:
    """Errors of ∂ÿ/∂y and ∂ÿ/∂ẏ of a four-bar that misses its change point, against many digits."""
    mech, h = four_bar(4.0, 2.0, 3.0, 3.0 + gap, y=np.pi + beside), Decimal("1e-16")
    found = rg.derivatives(mech, mech.home, mech.lift(mech.home, [1.0]))
    exact, G = Exact(mech), [Decimal(float(x)) for x in mech.G(mech.home)[:, 0]]
    q = exact.closed([Decimal(float(x)) for x in mech.home], [Decimal(float(mech.home[0]))])
    ends = [exact.closed([a + s * h * b for a, b in zip(q, G, strict=True)], [q[0] + s * h]) for s in (1, -1)]
    ahead, behind = (exact.forward(end, [ONE])[0][0] for end in ends)
    by_y = float((ahead - behind) / (2 * h))
    by_u = float((exact.forward(q, [ONE + ONE])[0][0] - exact.forward(q, [ONE - ONE])[0][0]) / 2)
    largest = max(abs(by_y), abs(by_u))
    return abs(found.da_dy[0, 0] - by_y) / abs(by_y), abs(found.da_dv[0, 0] - by_u) / largest


@pytest.mark.parametrize("gap", (1e-2, 1e-3, 1e-4))
@pytest.mark.parametrize("beside", (-0.03, 0.02))
def test_modes_that_pass_each_other(gap: float, beside: float) -> None:
    """Links off by the gap: modes veer within its root, and their derivatives grow as its inverse."""
    assert max(beside_a_change_point(gap, beside)) < 1e-10


@pytest.mark.parametrize("gap", (1e-6, 1e-7, 1e-8, 1e-9))
@pytest.mark.parametrize("beside", (-0.3, -0.1, 0.06, 0.2))
def test_beside_gaps_that_can_hardly_be_seen(gap: float, beside: float) -> None:
    assert max(beside_a_change_point(gap, beside)) < 1e-9


@pytest.mark.skipif(EPS > 1e-18, reason="no wider floating-point type here")
def test_q_is_closed_to_its_own_rounding() -> None:
    """Not to ε over the conditioning of K_d, which is 2e-4 here."""
    mech = four_bar(4.0, 2.0, 3.0, 3.0 + 1e-7, y=np.pi + 1e-4)
    exact = Exact(mech).closed([Decimal(float(x)) for x in mech.home], [Decimal(float(mech.home[0]))])

    def off(q: Array) -> float:
        return max(abs(float(a - Decimal(float(b)))) for a, b in zip(exact, q, strict=True))

    rates = ClusterRates(mech.clusters[0])
    apart = mech.home + 1e-12 * np.array([0.0, 1.0, -1.0])
    assert off(apart) > 5e-13 and off(rates.closed(apart)) < 5e-16


RIGHT = {1e-5: 3, 1e-6: 3, 1e-7: 2, 1e-8: 0, 1e-9: 0}
"""How many of the places below a gap at least leaves derivatives, where φ has more digits than q."""


@pytest.mark.parametrize(
    "gap", [1e-7, *(pytest.param(gap, marks=pytest.mark.campaign) for gap in RIGHT if gap != 1e-7)]
)
def test_right_to_nine_digits_or_refused(gap: float) -> None:
    """Nearer than the gap's root K_d says less at every place, and its inverse stands in them cubed."""
    right = 0
    for beside in (1e-2, -1e-3, 1e-4, -1e-4, -1e-6):
        try:
            error = max(beside_a_change_point(gap, beside))
        except rg.NotCertifiedError:
            continue
        assert error < 1e-9, f"{beside} beside: {error:.1e}"
        right += 1
    assert right >= RIGHT[gap] or EPS > 1e-18


def test_where_rounding_has_eaten_the_digits() -> None:
    """Modes that pass each other at 3e-8 m: no circle about them serves, and q says too little."""
    mech = four_bar(4.0, 2.0, 3.0, 3.0 + 3e-8, y=np.pi - 0.01)
    with pytest.raises(rg.NotCertifiedError, match=r"has none that could be certified"):
        rg.derivatives(mech, mech.home, mech.lift(mech.home, [1.0]))
    assert np.isfinite(rg.linearise(mech, mech.home).A).all(), "by differences, as far as they tell"
