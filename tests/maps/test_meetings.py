"""Modes that touch, cusps, modes within the singular set: against closed forms and twenty digits."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import meetings
from robust_gcp.maps.cluster.options import USUAL
from robust_gcp.maps.cluster.space import ClusterSpace
from robust_gcp.maps.cluster.touching import meeting_ahead
from robust_gcp.maps.cluster.touching.meeting import MANY, half_width, meeting
from robust_gcp.mechanism.coordinates.clusters import loop_clusters
from robust_gcp.mechanism.loops import ClosedLoops
from tests.compiled import needs_kernel

REFERENCE = (
    Path(os.environ.get("ROBUST_GCP_REFERENCE", Path(__file__).parents[3] / "shared" / "reference"))
    / "tangential_meetings.json"
)
A, B = meetings.RODS
BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]


class Second:
    """A number with its first and second derivative."""

    def __init__(self, value: float, first: float = 0.0, second: float = 0.0) -> None:
        self.value, self.first, self.second = value, first, second

    def __add__(self, other: Second | float) -> Second:
        o = _second(other)
        return Second(self.value + o.value, self.first + o.first, self.second + o.second)

    def __mul__(self, other: Second | float) -> Second:
        o = _second(other)
        return Second(
            self.value * o.value,
            self.value * o.first + self.first * o.value,
            self.value * o.second + 2.0 * self.first * o.first + self.second * o.value,
        )

    __radd__, __rmul__ = __add__, __mul__

    def of(self, value: float, slope: float, bend: float) -> Second:
        """f of it, by f, f' and f''."""
        return Second(value, slope * self.first, slope * self.second + bend * self.first**2)


def _second(x: Second | float) -> Second:
    return x if isinstance(x, Second) else Second(x)


def sqrt(x: Second) -> Second:
    r = math.sqrt(x.value)
    return x.of(r, 0.5 / r, -0.25 / r**3)


def arcsin(x: Second) -> Second:
    r = 1.0 / math.sqrt(1.0 - x.value**2)
    return x.of(math.asin(x.value), r, x.value * r**3)


def sin(x: Second) -> Second:
    return x.of(math.sin(x.value), math.cos(x.value), -math.sin(x.value))


def cos(x: Second) -> Second:
    return x.of(math.cos(x.value), -math.sin(x.value), -math.cos(x.value))


def arctan2(y: Second, x: Second) -> Second:
    r2 = x.value**2 + y.value**2
    first = (x.value * y.first - y.value * x.first) / r2
    turn = 2.0 * (x.value * x.first + y.value * y.first)
    second = (x.value * y.second - y.value * x.second) / r2 - first * turn / r2
    return Second(math.atan2(y.value, x.value), first, second)


def power(x: Second, n: int) -> Second:
    found = Second(1.0)
    for _ in range(n):
        found = found * x
    return found


Closed = Callable[[Second], list[Second]]


def on_cam(k: int, side: int) -> Closed:
    """q = (x, z, crank, rod) of `touching_cams(k)` at x."""

    def at(x: Second) -> list[Second]:
        depth = 0.8 * power(x, 2 * k)
        bend = 2.0 * arcsin(side * power(x, k) * sqrt((2.0 * (A + B) + -1.0 * depth) * (0.8 / (4.0 * A * B))))
        return [x, A + B + -1.0 * depth, arctan2(-B * sin(bend), A + B * cos(bend)), bend]

    return at


def on_trammel(side: int, share: float = 0.55) -> Closed:
    """q = (foot, ladder, head, upper, lower) of `trammel()` at the ladder's angle."""
    a, b = 0.7, 0.3

    def at(psi: Second) -> list[Second]:
        d = 0.5 * math.pi + -1.0 * psi
        e, reach = 2.0 * power(sin(0.5 * d), 2), a * a / b
        l1, l2 = share * reach, (1.0 - share) * reach
        bend = 2.0 * arcsin(side * math.sqrt((a * a - b * b) / (4.0 * l1 * l2)) * e)
        upper = arctan2(reach + -b * e, -a * sin(d)) + -1.0 * arctan2(l2 * sin(bend), l1 + l2 * cos(bend))
        return [-1.0 * sin(d), psi, cos(d), upper, bend]

    return at


def state(closed: Closed, y: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    q = closed(Second(y, 1.0))
    return np.array([x.value for x in q]), rate * np.array([x.first for x in q])


def floor(mechanism: rg.Mechanism, closed: Closed, y: float, rate: float, h: float, n: int) -> np.ndarray:
    """RK4 on the reduced equation with the closed form as its map: (y, ẏ) at the steps' ends."""
    model, data = mechanism.model, mechanism.model.createData()

    def f(x: np.ndarray) -> np.ndarray:
        jet = closed(Second(x[0], 1.0))
        q, G, g = (np.array([getattr(j, name) for j in jet]) for name in ("value", "first", "second"))
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        return np.array([x[1], -(G @ pin.rnea(model, data, q, G * x[1], g * x[1] ** 2)) / (G @ M @ G)])

    x = np.array([y, rate])
    rows = [x]
    for _ in range(n):
        k1 = f(x)
        k2 = f(x + 0.5 * h * k1)
        k3 = f(x + 0.5 * h * k2)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + f(x + h * k3))
        rows.append(x)
    return np.array(rows)


MOTIONS = {
    "cam 1": (lambda: meetings.touching_cams(1, 0.5), lambda side: on_cam(1, side), 0.5, -3.0, 0.22, 1),
    "cam 2": (lambda: meetings.touching_cams(2, 0.5), lambda side: on_cam(2, side), 0.5, -2.0, 0.34, 2),
    "cam 3": (lambda: meetings.touching_cams(3, 0.5), lambda side: on_cam(3, side), 0.5, -1.0, 0.44, 3),
    "cam 4": (lambda: meetings.touching_cams(4, 0.5), lambda side: on_cam(4, side), 0.5, -0.5, 0.5, 4),
    "trammel": (meetings.trammel, on_trammel, 0.5 * np.pi + 0.5, -3.5, 0.5, 2),
}


@pytest.mark.parametrize(
    ("name", "side", "backend"),
    [
        pytest.param(name, side, backend, marks=chosen)
        for name in MOTIONS
        for side in (1, -1)
        for backend, chosen in (
            ("native", needs_kernel),
            ("python", pytest.mark.campaign if side < 0 or name in ("cam 3", "trammel") else ()),
        )
    ],
)
def test_full_order_through_a_meeting_of_any_order(name: str, side: int, backend: str) -> None:
    """The error is the stepper's own on the exact map, within a tenth, and falls with h⁴."""
    made, closed_at, y, rate, T, order = MOTIONS[name]
    mechanism, closed = made(), closed_at(side)
    truth = floor(mechanism, closed, y, rate, T / 1024, 1024)
    errors = []
    for n in (64, 128):
        run = rg.simulate(
            mechanism, *state(closed, y, rate), duration=T, step=T / n, backend=backend, on_toggle="error"
        )
        least = np.abs(floor(mechanism, closed, y, rate, T / n, n) - truth[:: 1024 // n]).max()
        own = np.column_stack([run.y[:, 0], run.v[:, mechanism.iv_independent[0]]])
        errors.append(np.abs(own - truth[:: 1024 // n]).max())
        assert errors[-1] < 1.1 * least
        (crossing,) = run.crossings
        assert (crossing.kind, crossing.order) == ("tangential" if order > 1 else "transversal", order)
        assert crossing.certificate < 1e-12
        assert run.closure_error().max() < 1e-13
    assert 3.8 < math.log2(errors[0] / errors[1]) < 4.35


@pytest.mark.skipif(not REFERENCE.exists(), reason="the reference numbers are not here")
@pytest.mark.parametrize("backend", BACKENDS)
def test_twenty_digits(backend: str) -> None:
    """Each motion passes its places at the referenced times and speeds."""
    told = json.loads(REFERENCE.read_text())["motions"]
    for name, motion in told.items():
        side = 1 if name.endswith("+1") else -1
        k = int(name.split("k=")[1].split()[0]) if name.startswith("cam") else 0
        closed = on_cam(k, side) if k else on_trammel(side)
        y, rate = (float(x) for x in motion["start"])
        mechanism = meetings.touching_cams(k, y) if k else meetings.trammel()
        passes = np.array(motion["passes"], dtype=float)
        run = rg.simulate(
            mechanism,
            *state(closed, y, rate),
            stepper="DOP853",
            rtol=1e-12,
            atol=1e-13,
            outputs=passes[:, 1],
            step=5e-3,
            backend=backend,
        )
        off = np.abs(run.q[:, mechanism.iq_independent[0]] - passes[:, 0])
        assert off.max() < 2e-10, name


@pytest.mark.parametrize("joint", ["ladder", "foot", "upper", "lower", "head"])
def test_any_coordinates(joint: str) -> None:
    """Others, some of which turn back at the meeting: the same motion to the stepper's order."""
    closed = on_trammel(1)
    q, v = state(closed, 0.5 * np.pi + 0.5, -3.5)
    reference = floor(meetings.trammel(), closed, 0.5 * np.pi + 0.5, -3.5, 0.5 / 2048, 2048)[-1]
    run = rg.simulate(meetings.trammel().with_independent([joint]), q, v, duration=0.5, step=0.5 / 512)
    assert abs(run.q[-1, 1] - reference[0]) < 5e-9
    (crossing,) = run.crossings
    assert (crossing.kind, crossing.order) == ("tangential", 2)
    assert crossing.q[1] == pytest.approx(0.5 * np.pi, abs=3e-11)


def test_the_log_is_told_and_kept(tmp_path: Path) -> None:
    run = rg.simulate(meetings.trammel(), *state(on_trammel(1), 2.0, -3.5), duration=0.4, step=2e-3)
    again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert [(c.kind, c.order) for c in again.crossings] == [("tangential", 2)]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("k", [2, 3])
def test_starts_where_modes_touch(k: int, backend: str) -> None:
    """Both modes are had by their number: each is one of the closed forms."""
    mechanism, rate, T, n = meetings.touching_cams(k), -2.0, 0.3, 64
    ends = []
    for number in (0, 1):
        run = rg.simulate(
            mechanism, mechanism.home, [rate, 0, 0, 0], duration=T, step=T / n, mode=number, backend=backend
        )
        ends.append(run.q[-1])
    for side in (1, -1):
        x = floor(mechanism, on_cam(k, side), 1e-300, rate, T / n, n)[-1, 0]
        expected = state(on_cam(k, side), x, 0.0)[0]
        assert min(np.abs(end - expected).max() for end in ends) < 1e-11
    with pytest.raises(rg.SingularStartError, match="more than one"):
        rg.simulate(mechanism, mechanism.home, [rate, 0, 0, 0], duration=T, step=T / n)
    with pytest.raises(rg.OptionError, match="by its number"):
        rg.simulate(mechanism, mechanism.home, duration=T, step=T / n, mode=[1.0, 0.0, 0.0, 0.0])
    with pytest.raises(rg.OptionError, match="numbered from 0"):
        rg.simulate(mechanism, mechanism.home, duration=T, step=T / n, mode=2)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("x", [1e-2, 1e-3, 1e-4, 1e-6])
def test_starts_beside_where_modes_touch(x: float, side: int, backend: str) -> None:
    """The place tells the mode, which is x² away from the other one, without being asked."""
    mechanism, closed = meetings.touching_cams(2), on_cam(2, side)
    run = rg.simulate(mechanism, *state(closed, x, -2.0), duration=0.05, step=1e-3, backend=backend)
    assert np.abs(run.y[:, 0] - floor(mechanism, closed, x, -2.0, 1e-3, 50)[:, 0]).max() < 1e-13
    (crossing,) = run.crossings
    assert (crossing.kind, crossing.order) == ("tangential", 2)
    assert crossing.time == pytest.approx(0.5 * x, rel=0.02)


def test_gradients_across_a_meeting() -> None:
    mechanism, closed = meetings.touching_cams(2, 0.5), on_cam(2, 1)

    def end(y: float, rate: float) -> tuple[float, rg.Trajectory]:
        run = rg.simulate(mechanism, *state(closed, y, rate), duration=0.34, step=0.34 / 128)
        return float(run.q[-1, 0] + 0.3 * run.v[-1, 0]), run

    run, h = end(0.5, -2.0)[1], 1e-3
    assert [c.order for c in run.crossings] == [2]
    found = rg.gradient(run, rg.Cost(terminal=lambda q, v: float(q[0] + 0.3 * v[0])))
    weights = ((1, 8.0), (2, -1.0))
    by_y, by_rate = (
        sum(
            w * (end(0.5 + i * h * a, -2.0 + i * h * b)[0] - end(0.5 - i * h * a, -2.0 - i * h * b)[0])
            for i, w in weights
        )
        / (12.0 * h)
        for a, b in ((1, 0), (0, 1))
    )
    assert found.dy[0] == pytest.approx(by_y, rel=1e-7)
    assert found.dv[0] == pytest.approx(by_rate, rel=1e-7)


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_analyse_tells_the_order_of_contact(k: int) -> None:
    here = rg.analyse(meetings.touching_cams(k), [0.0, 1.0, 0.0, 0.0])
    assert (here.kind, len(here.modes), here.contacts) == ("singular", 2, ((0, 1, k),))
    away = meetings.cam([0.0] * (2 * k) + [-0.8])
    assert rg.analyse(away, [0.0, 1.0, 0.0, 0.0]).kind == "isolated"


def test_analyse_tells_cusps_and_modes_within_the_singular_set() -> None:
    for mechanism in (meetings.trammel(1.0), meetings.cusp_cam(0.0)):
        here = rg.analyse(mechanism, mechanism.home)
        assert (here.kind, here.rank, len(here.modes)) == ("cusp", mechanism.nv - 2, 1)
    dyad = meetings.stretched_dyad()
    here = rg.analyse(dyad, dyad.home)
    assert (here.kind, here.local_dof) == ("inside", 1)
    assert here.modes[0] == pytest.approx([1.0, 1.0, 0.0], abs=1e-12)


ARRIVAL, ENERGY, BACK = 0.040516446090717446103, 2.494508910409478497, 0.082705171138343676998
"""Of the cusp's cam from x = 0.1 with 2 J: time and kinetic energy there, and the time back at 0.1; 30 digits
by the energy integral."""


def _to_the_cusp() -> tuple[rg.Mechanism, np.ndarray, np.ndarray]:
    mechanism = meetings.cusp_cam(0.1)
    v = mechanism.lift(mechanism.home, [-1.0])
    return mechanism, mechanism.home, v * math.sqrt(2.0 / mechanism.tree.kinetic(mechanism.home, v))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("step", [4e-3, 1e-3])
def test_a_cusp_ends_the_motion_with_all_that_is_known(step: float, backend: str) -> None:
    mechanism, q, v = _to_the_cusp()
    with pytest.raises(rg.CuspError, match="on_cusp") as caught:
        rg.simulate(mechanism, q, v, duration=0.2, step=step, backend=backend)
    error = caught.value
    assert error.time == pytest.approx(ARRIVAL, abs=1e-12)
    assert mechanism.tree.kinetic(error.q, error.v) == pytest.approx(ENERGY, abs=1e-11)
    assert error.q == pytest.approx([0.0, 1.0, 0.0, 0.0], abs=1e-14)
    came, other = error.branches
    assert mechanism.closure_residual(came) < 1e-13
    assert (came[3] > 0.0) and (other[3] < 0.0)
    assert 0.0 <= error.time - error.trajectory.t[-1] < 1e-15


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_motion_that_does_not_come_to_its_cusp_is_not_stopped(backend: str) -> None:
    """By the end of its time, or by an event of the user's; the energy is kept until there."""
    mechanism, q, v = _to_the_cusp()
    begun = mechanism.energy(q, v)

    def low(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[0] - 0.01)

    low.terminal = True  # type: ignore[attr-defined]
    run = rg.simulate(mechanism, q, v, duration=0.04, step=1e-3, backend=backend, record=["energy"])
    assert run.t[-1] == 0.04 and len(run.t) == 41
    assert run.energy == pytest.approx(begun, abs=1e-10)
    how = {"backend": backend, "events": [low], "record": ["energy"]}
    run = rg.simulate(mechanism, q, v, duration=0.1, step=1e-3, **how)
    assert run.q[-1, 0] == pytest.approx(0.01, abs=1e-13)
    assert run.energy == pytest.approx(begun, abs=1e-10)


def test_round_a_cusp_and_back_at_full_order() -> None:
    """v⁺ = −v⁻ on the other branch; the way back takes the time that the energy integral says."""
    mechanism, q, v = _to_the_cusp()

    def back(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[0] - 0.1)

    errors = []
    for step in (4e-3, 2e-3):
        run = rg.simulate(mechanism, q, v, duration=0.2, step=step, on_cusp="turn", events=back)
        (happening,) = run.happenings
        assert (happening.kind, happening.loss) == ("cusp", 0.0)
        assert happening.time == pytest.approx(ARRIVAL, abs=1e-12)
        assert run.q[-1, 3] < 0.0 < run.q[0, 3]
        assert np.all(np.diff(run.t) > 0.0)
        assert run.closure_error().max() < 1e-13
        errors.append(abs(run.t_events[0][-1] - BACK))
    assert errors[0] < 1e-9
    assert errors[1] < max(errors[0] / 8.0, 1e-12)


def test_a_cusp_ends_motions_with_stops_too() -> None:
    mechanism, q, v = _to_the_cusp()
    far = [rg.Stop("x", upper=0.3)]
    with pytest.raises(rg.CuspError) as caught:
        rg.simulate(mechanism, q, v, duration=0.2, step=2e-3, joints=far)
    assert caught.value.time == pytest.approx(ARRIVAL, abs=1e-12)
    with pytest.raises(rg.OptionError, match="joints="):
        rg.simulate(mechanism, q, v, duration=0.2, step=2e-3, joints=far, on_cusp="turn")


def test_a_motion_that_turns_back_before_a_cusp_goes_on_where_it_may() -> None:
    """Too slow to climb to the cusp against a spring: back on the branch that it came by, energy kept."""
    mechanism = meetings.cusp_cam(0.1)
    spring = rg.JointSpring("x", 400.0, 0.1)
    made = rg.Mechanism(mechanism.own_model, mechanism.closures, ["x"], home=mechanism.home, forces=[spring])
    v = made.lift(made.home, [-0.5])
    run = rg.simulate(made, made.home, v, duration=0.2, step=1e-3, on_cusp="turn")
    assert run.happenings == []
    assert run.q[:, 0].min() > 0.02
    assert np.all(run.q[:, 3] > 0.0)
    assert np.abs(run.energy_error()).max() < 1e-7


@pytest.mark.parametrize("backend", BACKENDS)
def test_starts_beside_a_cusp_arrive_turn_and_leave(backend: str) -> None:
    """As a motion does that was there before, by its time, place and velocity."""
    mechanism, q, v = _to_the_cusp()
    long = rg.simulate(mechanism, q, v, duration=0.08, step=1e-3, on_cusp="turn", backend=backend)
    (cusp,) = long.happenings
    for since in (0.03, 0.06):  # before it and after it
        here, how = long.at(since), {"step": 1e-3, "t0": since, "backend": backend}
        rest = rg.simulate(mechanism, here.q, here.v, duration=0.08 - since, on_cusp="turn", **how)
        assert rest.q[-1] == pytest.approx(long.q[-1], abs=1e-9)
        assert [x.time for x in rest.happenings] == pytest.approx([cusp.time][: since < cusp.time], abs=1e-10)
        assert np.abs(rest.energy_error()).max() < 1e-10
    here = long.at(0.03)
    with pytest.raises(rg.CuspError) as caught:
        rg.simulate(mechanism, here.q, here.v, duration=0.05, step=1e-3, t0=0.03, backend=backend)
    assert caught.value.time == pytest.approx(cusp.time, abs=1e-10)
    assert caught.value.trajectory.t[-1] == pytest.approx(cusp.time, abs=1e-10)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("record", [(), ("a",)])
def test_motions_are_known_between_outputs_beside_a_cusp(record: tuple[str, ...]) -> None:
    """The acceleration is infinite there; what is drawn asks between outputs too."""
    mechanism, q, v = _to_the_cusp()
    run, fine = (
        rg.simulate(mechanism, q, v, 0.05, step, on_cusp="turn", record=record) for step in (1e-3, 1e-4)
    )
    times = np.linspace(0.0, 0.05, 501)
    assert run.at(times).q == pytest.approx(fine.at(times).q, abs=2e-5)
    assert np.isfinite(run.at(times).v).all()
    with pytest.raises(rg.NotDifferentiableError, match="cusp"):
        rg.gradient(run, rg.Cost(terminal=lambda q, v: q[0]))


def test_a_turn_at_a_cusp_under_held_torques_is_refused() -> None:
    mechanism, q, v = _to_the_cusp()
    how = {"duration": 0.1, "step": 1e-3, "hold": True, "torque": {"x": lambda t, q, v: 0.0}}
    with pytest.raises(rg.OptionError, match="hold=True"):
        rg.simulate(mechanism, q, v, on_cusp="turn", **how)
    with pytest.raises(rg.CuspError) as caught:
        rg.simulate(mechanism, q, v, **how)
    assert caught.value.time is None and len(caught.value.branches) == 2


def test_restitution_at_a_cusp() -> None:
    mechanism, q, v = _to_the_cusp()
    run = rg.simulate(mechanism, q, v, duration=0.1, step=1e-3, on_cusp=0.5)
    (happening,) = run.happenings
    assert happening.loss == pytest.approx(0.75 * ENERGY, rel=1e-9)
    assert np.abs(run.energy_error()).max() < 1e-7
    for bad in ("bounce", 1.5, -0.1):
        with pytest.raises(rg.OptionError, match="on_cusp"):
            rg.simulate(mechanism, q, v, duration=0.1, step=1e-3, on_cusp=bad)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_mode_within_the_singular_set_moves_at_the_floor(backend: str) -> None:
    """A dyad stretched in every position swings as the pendulum that it is."""
    dyad = meetings.stretched_dyad()

    def pendulum(y: Second) -> list[Second]:
        return [y, y, Second(0.0)]

    truth = floor(dyad, pendulum, 0.7, 1.0, 2.0 / 2048, 2048)[-1]
    for n in (64, 128):
        run = rg.simulate(dyad, dyad.home, [1.0, 1.0, 0.0], duration=2.0, step=2.0 / n, backend=backend)
        least = np.abs(floor(dyad, pendulum, 0.7, 1.0, 2.0 / n, n)[-1] - truth)[0]
        assert abs(run.q[-1, 0] - truth[0]) < 1.05 * least + 1e-13
        assert np.abs(run.q[:, 2]).max() < 1e-12


@pytest.mark.parametrize("bends", [(1, 1), (1, -1)])
@pytest.mark.parametrize("amplitudes", [(1.0, 0.5), (1.0, 1.0)])
def test_several_loops_that_touch_at_once(amplitudes: tuple[float, float], bends: tuple[int, int]) -> None:
    """Corank 2, four modes with one tangent: the mode goes on, at the stepper's error on the closed form."""
    mechanism = meetings.cranks_on_one_slide(amplitudes, 0.35, bends)

    def closed(x: Second) -> list[Second]:
        rows = [x]
        for amplitude, side in zip(amplitudes, bends, strict=True):
            depth = 0.8 * amplitude * power(x, 4)
            inner = (2.0 * (A + B) + -1.0 * depth) * (0.8 * amplitude / (4.0 * A * B))
            bend = 2.0 * arcsin(side * power(x, 2) * sqrt(inner))
            rows += [A + B + -1.0 * depth, arctan2(-B * sin(bend), A + B * cos(bend)), bend]
        return rows

    truth = floor(mechanism, closed, 0.35, -2.0, 0.3 / 1024, 1024)[-1]
    least = np.abs(floor(mechanism, closed, 0.35, -2.0, 0.3 / 64, 64)[-1] - truth)[0]
    run = rg.simulate(mechanism, *state(closed, 0.35, -2.0), duration=0.3, step=0.3 / 64)
    assert abs(run.y[-1, 0] - truth[0]) < 1.1 * least
    (crossing,) = run.crossings
    assert (crossing.kind, crossing.order, crossing.corank) == ("tangential", 4, 2)
    assert crossing.certificate < 1e-14


def test_a_place_is_judged_by_the_options_of_each_run() -> None:
    """Whatever runs of other options found there before: modes that pass with a gap of 1e-11."""
    strict, usual = rg.BridgeOptions(geometric_tolerance=1e-12), rg.BridgeOptions()
    told: list[dict[rg.BridgeOptions, str]] = []
    for order in ((usual, strict), (strict, usual)):
        mechanism = meetings.cam([1e-11, 0.0, 0.0, 0.0, 0.8])
        q, v = state(on_cam(2, 1), 0.5, -2.0)
        q = mechanism.assemble(q, hold=mechanism.independent)
        v = mechanism.lift(q, v[mechanism.iv_independent])
        told.append({})
        for options in order:
            with pytest.raises(rg.NotCertifiedError) as refusal:
                rg.simulate(mechanism, q, v, duration=0.34, step=0.34 / 128, options=options)
            told[-1][options] = str(refusal.value)
    assert told[0] == told[1]
    assert "digits do not suffice" in told[0][usual]
    assert "digits do not suffice" not in told[0][strict]


@needs_kernel
def test_what_one_run_built_serves_the_next() -> None:
    """Which the kernel takes from its start on."""
    mechanism = meetings.trammel()
    (tangent, _) = rg.analyse(mechanism, mechanism.home).modes
    q = mechanism.assemble(mechanism.home + 0.3 * tangent, hold=mechanism.independent)
    v = mechanism.lift(q, -3.0 * tangent[mechanism.iv_independent])
    first, second = (rg.simulate(mechanism, q, v, 0.3, 0.3 / 128, backend="native") for _ in range(2))
    assert [(c.kind, c.order) for c in second.crossings] == [("tangential", 2)]
    assert first.stats.native_steps < second.stats.native_steps == 128
    assert second.q == pytest.approx(first.q, abs=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["rhombus", "parallelogram", "change_point"])
def test_crossings_ask_for_nothing_of_this(name: str, backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run without a touching place looks for none: no mid curve, no extrapolated mode."""

    def asked(*_: object) -> None:
        raise AssertionError("a meeting was looked at")

    for function in ("meeting", "extrapolated", "bridge_through"):
        monkeypatch.setattr(meeting_ahead, function, asked)
    run = rg.simulate(rg.load(name), duration=2.0, step=2e-3, backend=backend)
    assert run.crossings and all(c.kind == "transversal" for c in run.crossings)


def test_perturbed_copies_are_never_certified_falsely(copies: int = 40) -> None:
    """Cams whose g is known: what is certified is there, to a gap of 1e-12."""
    assert false_certificates(np.random.default_rng(7), copies) == []


def false_certificates(rng: np.random.Generator, copies: int) -> list[str]:
    """Copies of meetings and cusps, unfolded at random, that were certified though their gap is larger."""
    wrong = []
    poly = np.polynomial.polynomial
    for _ in range(copies):
        n, c, x0 = int(rng.integers(2, 10)), rng.uniform(0.3, 1.2), rng.uniform(-0.5, 0.5)
        eta, kind = 10.0 ** rng.uniform(-16.0, -2.0), rng.integers(0, 4)
        P = c * poly.polyfromroots([0.0] * n)
        if kind == 0:  # any unfolding
            P = poly.polyadd(P, eta * rng.standard_normal(n) * rng.integers(0, 2, n))
        elif kind == 1:  # meetings of lower order beside each other
            roots = np.repeat(np.sqrt(eta) * rng.standard_normal(n // 2), 2)
            P = c * poly.polyfromroots(np.r_[roots, [0.0] * (n % 2)])
        elif kind == 2:  # a plain gap
            P = poly.polyadd(P, [eta * rng.choice([-1, 1])])
        P = poly.polyadd(P, np.r_[np.zeros(n + 1), rng.uniform(-0.2, 0.2)])
        shifted, unit = np.zeros(1), np.ones(1)
        for a in P:  # P(x − x0)
            shifted, unit = poly.polyadd(shifted, a * unit), poly.polymul(unit, [-x0, 1.0])
        space = _cam_space(shifted)
        x = np.array([x0, A + B, 0.0, 0.0]) / space.D
        U = np.linalg.svd(space.K(x))[0]
        try:
            found = meeting(space, x, U[:, : space.nd].T, np.zeros(4), USUAL)
        except rg.SimulationError:
            continue
        many = [(u, p) for u, p in found.places if p > 1]
        if not many:
            continue
        places = [(float(found.curve.values_at(u)[0][0] * space.D[0]) - x0, p) for u, p in many]
        most = max(p for _, p in many)
        half = min(0.8 * found.curve.R, half_width(most // 2) if most >= MANY else np.inf)
        half *= space.D[0] * abs(found.curve.surface.t[0])
        gap, allowed = _true_gap(P, places, half), 1e-12 if found.gap <= 1e-12 else 1e-9
        if gap > 3.0 * allowed:
            wrong.append(
                f"n = {n}, kind {kind}, η = {eta:.1e}: {found.kind}, told {found.gap:.1e}, true {gap:.1e}"
            )
    return wrong


def _cam_space(profile: np.ndarray) -> ClusterSpace:
    """The loops of a cam whatever its profile, which may leave x = 0 open."""
    mechanism = meetings.touching_cams(2)
    P = np.r_[profile, np.zeros(max(0, 3 - len(profile)))]
    follows = rg.CouplingClosure("z", "x", -float(P[1]), A + B - float(P[0]), tuple(-P[2:]))
    loops = ClosedLoops(mechanism.own_model, [mechanism.loops[0], follows])
    (cluster,) = loop_clusters(loops, (), np.empty(0, np.int64))
    return ClusterSpace(replace(cluster, chosen=np.zeros(1, np.int64)), mechanism.home)


def _true_gap(profile: np.ndarray, places: list[tuple[float, int]], half: float) -> float:
    """max over |x| ≤ half of the profile mod Π(x − x_i)^p_i, the least over x_i, by Gauss–Newton."""
    poly = np.polynomial.polynomial
    ps, grid = [p for _, p in places], np.linspace(-half, half, 41)

    def left(xs: np.ndarray) -> np.ndarray:
        d = poly.polyfromroots(np.repeat(xs, ps))
        return np.asarray(
            poly.polyval(grid, poly.polydiv(profile, d)[1] if len(d) <= len(profile) else profile)
        )

    xs, best = np.array([x for x, _ in places]), np.inf
    for _ in range(6):
        r = left(xs)
        best = min(best, float(np.abs(r).max()))
        J = np.column_stack([(left(xs + 1e-7 * e) - r) / 1e-7 for e in np.eye(len(xs))])
        dx = -np.linalg.lstsq(J, r, rcond=1e-12)[0]
        if not np.all(np.isfinite(dx)):
            break
        xs = xs + dx
    return best


def test_examples_refuse_what_they_cannot_be() -> None:
    with pytest.raises(rg.OptionError, match=r"P\(0\.9\)"):
        meetings.cam([0.0, 0.0, 2.0], 0.9)
    with pytest.raises(rg.OptionError, match="order"):
        meetings.touching_cams(9)
    with pytest.raises(rg.OptionError, match="share"):
        meetings.trammel(share=2.0)
