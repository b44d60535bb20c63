"""Stiff cases: springs and dampers up to 1e8 of gravity, across singularities, and the flyball governor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from ... import JointSpring, Mechanism, Stats, linearise, simulate
from ...examples.linkages import four_bar
from ...mechanism.tree.tree import Array
from .bound import KICK, systems
from .case import Case, Families, Setting, at_rest, family, made, row
from .extreme_tools import EXACT
from .truth import SHAFT, TANGENT, A, B, Servo, governor, of_run, with_forces

FAMILIES: Families = {}

RTOL, ATOL = 1e-6, 1e-8
WITHIN = 100.0
"""Global error of an adaptive stepper, in units of rtol, that counts as right."""

LARGEST_FLOOR = 1e-3
"""rad: an RK4 that errs by more on the scalar equation cannot be called right."""

CLASSICAL_LOSS = 1e-7
"""rad: classical GCP warns from a conditioning of 1e-3 on, where g may be wrong by ε/1e-9 for a moment."""

SHARES = (0.5, 0.9, 0.98, 1.02, 1.1, 2.0, 10.0)
"""Steps of the columns about RK4's bound, in largest stable steps."""


@family("RK4's bound", FAMILIES)
def around(quick: bool) -> Iterator[Case]:
    """RK4 with steps around the predicted bound: bounded inside, warned and growing outside."""
    for name, build in systems(quick).items():
        mechanism, q0, v0 = start = build()
        largest = linearise(*start).largest_stable_step
        duration = 200.0 * largest
        fine = {"step": duration / 2000, "stepper": "DOP853", "rtol": 1e-9, "atol": 1e-9}
        settings = tuple(Setting(step=s * largest, name=f"{s:g} h*") for s in SHARES)
        exact = of_run(mechanism, duration, q0=q0, v0=v0, **fine)
        yield row(name, made(start), duration, settings, 3.0 * KICK, exact)


# --------------------------------------------------------------------------- a stiff drive


def _servo_case(name: str, servo: Servo, settings: Sequence[Setting]) -> Case:
    duration = 0.5
    mechanism = servo.mechanism()
    floors = cache(servo.floor)

    @cache
    def exact(times: bytes) -> Array:
        """Columns of the row share their output times."""
        return servo.exact(np.frombuffer(times))

    def allowed(setting: Setting, stats: Stats) -> float:
        if setting.stepper != "rk4":
            return WITHIN * setting.rtol
        floor = floors(setting.step, duration)
        return 1.5 * floor + 1e-9 if floor <= LARGEST_FLOOR else 0.0

    return row(
        name,
        lambda: at_rest(mechanism),
        duration,
        tuple(settings),
        allowed,
        lambda t: exact(t.tobytes()),
        mode_kept=lambda q: bool(np.abs(q - q[:, :1] * TANGENT).max() < 1e-6),
        energy_scale=max(B, servo.k * servo.r0**2, servo.c * servo.nu * servo.r0**2),
        more={"torque": servo.torque},
    )


def _columns(*steppers: str, steps: Sequence[float] = (1e-3, 2e-4)) -> tuple[Setting, ...]:
    fixed = tuple(Setting(step=step) for step in steps)
    return fixed + tuple(Setting("bridge", s, 5e-3, RTOL, ATOL) for s in steppers)


@family("stiff springs", FAMILIES)
def springs(quick: bool) -> Iterator[Case]:
    """A spring on the crank whose rest moves slowly through q1 = 0, undamped."""
    for exponent in (0, 4, 8) if quick else (-2, 0, 2, 4, 6, 8):
        # undamped, BDF and LSODA resolve every oscillation: at 1e8 that takes them minutes
        all_of_them = ("Radau", "BDF", "LSODA", "DOP853") if exponent < 8 else ("Radau", "DOP853")
        columns = _columns("Radau", steps=(1e-3,)) if quick else _columns(*all_of_them)
        if exponent == 8 and not quick:
            columns += (Setting(step=2e-5),)
        yield _servo_case(f"k = 1e{exponent} B", Servo(10.0**exponent * B, 0.0), columns)


@family("stiff dampers", FAMILIES)
def dampers(quick: bool) -> Iterator[Case]:
    """A damper between the crank and a slowly moving hand, from soft to stiff."""
    for exponent in (0, 4, 8) if quick else (-2, 0, 2, 4, 6, 8):
        radau = () if quick and exponent == 8 else ("Radau",)  # seconds: see `docs/stability.md`
        steppers = (*radau, "BDF", "LSODA", *(("DOP853",) if exponent <= 4 and not quick else ()))
        servo = Servo(0.0, 10.0**exponent * np.sqrt(A * B))
        yield _servo_case(f"c = 1e{exponent} √(AB)", servo, _columns(*steppers))


@family("stiff servos", FAMILIES)
def servos(quick: bool) -> Iterator[Case]:
    """Spring and critical damper together, as a stiff position controller."""
    for exponent in (2, 8) if quick else (0, 2, 4, 6, 8):
        k = 10.0**exponent * B
        steppers = ("Radau", "BDF", "LSODA", *(("DOP853",) if exponent <= 6 and not quick else ()))
        yield _servo_case(f"k = 1e{exponent} B", Servo(k, 2.0 * np.sqrt(k * A)), _columns(*steppers))


# --------------------------------------------------------------------------- across a singularity


@family("stiff across a singularity", FAMILIES)
def across(quick: bool) -> Iterator[Case]:
    """Two swings about a spring's rest 0.1 rad behind q1 = π, from 0.4 rad before it."""
    rows = [
        ("rhombus", (1.0, 1.0, 1.0, 1.0), "q1"),
        ("change point", (4.0, 2.0, 3.0, 3.0), "q1"),
        ("change point", (4.0, 2.0, 3.0, 3.0), "q3"),
    ]
    for name, lengths, joint in rows[1:2] if quick else rows:
        for exponent in (4, 8) if quick else (0, 2, 4, 6, 8):
            bare, target = (four_bar(*lengths, y=np.pi + off) for off in (-0.4, 0.1))
            k = 10.0**exponent * 9.81 * (lengths[1] / 2.0 + lengths[1] + lengths[3] / 2.0)
            rest = float(target.home[list(bare.joint_names).index(joint)])
            mechanism = with_forces(bare, [JointSpring(joint, k, rest)])
            yield _across_case(f"{name}, k on {joint} = 1e{exponent}", mechanism)


def _across_case(name: str, mechanism: Mechanism) -> Case:
    duration = 2.0 * _period(mechanism)
    exact = of_run(mechanism, duration, step=duration / 4000, method="closed_form", **EXACT)

    @cache
    def floor(setting: Setting) -> float:
        """Error of the same stepper on the closed form, rad."""
        run = simulate(mechanism, duration=duration, **setting.options | {"method": "closed_form"})
        return float(np.abs(run.q - exact(run.t)).max())

    def allowed(setting: Setting, stats: Stats) -> float:
        lost = CLASSICAL_LOSS if setting.method == "classical" else 1e-10
        return 3.0 * floor(setting) + (lost if setting.stepper == "rk4" else WITHIN * setting.rtol)

    coarse, fine = duration / 200, duration / 800
    settings = (
        Setting(step=coarse, name="RK4 T/100"),
        Setting(step=fine, name="RK4 T/400"),
        *(Setting("bridge", s, coarse, 1e-8, 1e-10) for s in ("Radau", "LSODA", "DOP853")),
        Setting("projection", step=fine, name="RK4 T/400 projection"),
        Setting("classical", step=fine, name="RK4 T/400 classical"),
    )
    return row(name, lambda: at_rest(mechanism), duration, settings, allowed, exact)


def _period(mechanism: Mechanism) -> float:
    """Of the swing, s: found from a run on the closed form, scaled by the start's own acceleration."""
    run = simulate(mechanism, duration=1e-9, step=1e-9, method="closed_form", record="a")
    assert run.a is not None
    # from rest at 0.5 rad from the spring's rest ÿ = ω² 0.5
    return float(2.0 * np.pi * np.sqrt(0.5 / abs(run.a[0, 0])))


@family("flyball governor", FAMILIES)
def flyball(quick: bool) -> Iterator[Case]:
    """IFToMM's A05, its spring-dampers as they are and a hundred times softer and stiffer."""
    duration = 0.1 if quick else 0.3
    for factor in (1.0,) if quick else (1e-2, 1.0, 1e2):
        mechanism = governor(factor)
        v0 = mechanism.lift(mechanism.home, SHAFT)
        # where an explicit method is too slow for the truth, Radau at a tolerance that rounding permits
        stepper, rtol = ("DOP853", 1e-11) if factor <= 1.0 else ("Radau", 1e-9)
        options = {"step": 1e-3, "stepper": stepper, "rtol": rtol, "atol": 0.1 * rtol}
        exact = of_run(mechanism, duration, v0=v0, **options)
        steppers = ("Radau", "BDF", "LSODA", *(("DOP853",) if factor <= 1.0 else ()))
        settings = _columns(*steppers, steps=(1e-4, 3e-4, 4e-4, 1e-3))
        name = f"λ = −{8117 * factor:.3g} 1/s"
        build = made((mechanism, mechanism.home, v0))
        yield row(name, build, duration, settings, WITHIN * RTOL, exact)
