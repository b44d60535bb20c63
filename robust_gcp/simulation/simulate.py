"""`simulate`: from a start to a certified trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

from numpy.typing import ArrayLike

from ..checks import check_between, check_choice, check_mechanism, check_positive, listed, shown
from ..dynamics.equations import Torque
from ..dynamics.loads import Torques, Wrench, one_torque
from ..dynamics.prescribed.control import Controls, with_control
from ..dynamics.prescribed.driven import prescribed
from ..dynamics.prescribed.motion import Motion
from ..dynamics.prescribed.zero_order_hold import HeldTorque
from ..dynamics.tableau import Tableau
from ..errors import CuspError, OptionError
from ..kernel.simulation.steps import BACKENDS, chosen_library
from ..maps.choice import METHODS, MapChoice, Method
from ..maps.classical import NewtonStart
from ..maps.cluster.options import USUAL, BridgeOptions
from ..maps.projection import PROJECTION_THRESHOLD
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import Part, parts_given
from .events import EventFunction, checked_events
from .runs.course import Course
from .runs.schedule import last_output, planned
from .runs.steppers import check_stepper
from .runs.unnamed_steps import is_guarded
from .trajectories.acted import Acted
from .trajectories.trajectory import Trajectory

Toggle = Literal["repartition", "error"]

RECORDS = ("a", "energy", "multipliers", "tau")


def simulate(
    mechanism: Mechanism,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    duration: float | None = None,
    step: float | None = None,
    method: Method = "bridge",
    stepper: str | Tableau = "rk4",
    *,
    torque: Torques | None = None,
    wrenches: Sequence[Wrench] = (),
    ctrl: Controls | None = None,
    joints: Sequence[Part] | None = None,
    drive: Mapping[str, Motion] | None = None,
    events: EventFunction | Sequence[EventFunction] | None = None,
    t0: float = 0.0,
    outputs: ArrayLike | None = None,
    hold: bool = False,
    record: Sequence[str] = (),
    mode: ArrayLike | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    on_toggle: Toggle | None = None,
    on_cusp: Literal["error", "turn"] | float = "error",
    newton_start: NewtonStart = "tangent",
    threshold: float = PROJECTION_THRESHOLD,
    options: BridgeOptions | None = None,
    progress: Callable[[float], None] | bool | None = None,
    backend: Literal["auto", "python", "native"] = "auto",
) -> Trajectory:
    """Simulate a mechanism in minimal coordinates.

    Integrates ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g) with q = γ(y), v = G ẏ.

    Parameters
    ----------
    mechanism : Mechanism
    q0 : array_like (nq,), optional
        A closed configuration (see `Mechanism.assemble`); the mechanism's home when left out.
    v0 : array_like (nv,), optional
        K v0 = 0 (see `Mechanism.lift`). At rest when left out; where q0 and mode are left out too, what
        the mechanism recommends.
    duration, step : float, optional
        s; what the mechanism recommends when left out, 1 and 1e-3 where it says nothing. The step of RK4;
        for the other steppers the spacing of the output. If the duration is no multiple of it, the last
        step is shorter. A step that is left out is only the spacing of the output where RK4 needs shorter
        ones at the start, or turns out to: see `runs.unnamed_steps`.
    method : {"bridge", "projection", "classical", "closed_form"}
        The explicit map: certified bridges through singular configurations (default), the paper's
        Eq. (7), classical GCP (Eq. 4), or the planar four-bar in closed form.
    stepper : {"rk4", "RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"} or Tableau
        Classical Runge–Kutta with fixed step, one of scipy's adaptive solvers, or another explicit
        Runge–Kutta method with fixed step, whose region of stability is not checked.
    torque : callable (t, q, v) -> (nv,), array_like (nv,) or mapping, optional
        Applied joint torques and forces, N m and N. A mapping gives joints by name, or single numbers of
        theirs ("ball.rx"), each a number (an array for a joint of several) or a function (t, q, v) of it.
    wrenches : sequence of Wrench
        Forces and moments on frames.
    ctrl : mapping of str or array_like (n,), optional
        Controls of the mechanism's actuators by name: each a number, a function (t, q, v), or a table
        (times, values), linear between its times; 0 for those that are not named. Without it the actuators
        have no power. `run["actuator.NAME"]` is the force of one, `run["activation.NAME"]` its activation.
    joints : sequence of Stop, JointFriction, Lock, optional
        Stops, dry friction and locks: the motion goes through phases, which begin and end at events that are
        found to rounding; see `traj.happenings`. With fixed steps and method="bridge". Those of the
        mechanism's file when left out; none of them with [].
    drive : mapping of str to Motion, optional
        Joints that move as prescribed, from t = 0 on; `traj["drive.q1"]` is the torque or force that it
        takes. The other independent joints move freely. Where q0 is left out, home is led to where the
        drives begin; where v0 is, the free joints start at rest. Joints that are not independent become so.
        y is not changed on the way, and where it turns back the run stops.
    events : callable (t, q, v) -> float, or sequence of such, optional
        Functions whose zeros are found, as scipy's solve_ivp finds them: `traj.t_events`, `q_events` and
        `v_events`. Attributes, or an `Event`, say which directions count and whether the run ends there;
        the state there is then the last of the trajectory. A zero at the very start ends nothing.
    t0 : float
        Time at the start, s, for torques, motions, events and the record.
    outputs : array_like (n,), optional
        Increasing times to record, s; every step when left out. Steps stay where they are: what lies within
        one is computed from the polynomial through its ends, to the order of the stepper, loops closed. The
        torque function is asked there once more. The duration is to the last of them when left out.
    hold : bool
        Whether functions of torques, wrenches and controls are called once a step, with the state at its
        start, and held over it, as a digital controller does. For fixed steps.
    record : sequence of {"a", "energy", "multipliers", "tau"}
        What to keep besides q and v; "tau" is all that acts besides gravity.
    mode : array_like (nv,) or (nv, m), or int, optional
        Tangent of the mode to take when q0 is singular: one of `analyse(mechanism, q0).modes`, or its number;
        modes that touch share their tangent and are told by number alone.
    rtol, atol : float
        Tolerances of the adaptive steppers.
    on_toggle : {"repartition", "error"}
        What to do where y is about to turn back, or does so at the start: change the independent joints of
        that cluster, report it in `stats.repartitions` and go on, or stop with an error that names better
        joints. When left out, "repartition" with method="bridge" and "error" with the others.
        `Trajectory.y` stays in the joints named at first.
    on_cusp : {"error", "turn"} or float
        What to do where a mode ends in a cusp, beyond which the equations of motion do not say how it goes
        on: stop with a `CuspError`, which tells when and how fast the motion arrives and where both
        branches lie, and has the motion up to there, or go on along the other branch with the opposite
        velocity, as any linkage does that is nearly this one, a number between 0 and 1 being the share of
        the speed that is kept; see `traj.happenings`.
    newton_start : {"tangent", "previous"}
        Start of Newton's method for method="classical".
    threshold : float
        Rank tolerance of method="projection".
    options : BridgeOptions, optional
        Choices of method="bridge".
    progress : bool or callable (fraction), optional
        True shows a bar on a terminal's stderr, elsewhere a line where the run takes more than two seconds.
        A function is called after each step with the fraction of the duration that is done; the compiled
        kernel takes some steps at once, and the calls follow.
    backend : {"auto", "python", "native"}
        "native" takes fixed steps and SciPy's right-hand sides in the compiled kernel (see `backends`)
        for the methods "bridge" and "classical"; "auto" does so where it can; the results are the same to
        rounding.

    Returns
    -------
    Trajectory

    Raises
    ------
    OptionError, StateError
        For bad arguments.
    SimulationError
        When the run must stop; `error.trajectory` holds what was simulated until then.
    """
    check_mechanism(mechanism, Mechanism, "simulate")
    unnamed = step is None
    applied: Torque | ArrayLike | None = one_torque(mechanism, torque, wrenches)
    tableau = check_stepper(stepper)
    fixed = tableau == "rk4" or isinstance(tableau, Tableau)
    duration = last_output(outputs, t0) if duration is None else duration
    duration, step = mechanism.recommended.run(duration, step)
    schedule, step = planned(t0, duration, step, outputs, fixed)
    drives = None
    if drive is not None or mechanism.moved:
        mechanism, drives = prescribed(mechanism, drive, q0, schedule.times)
    v0 = mechanism.recommended.velocity(q0, mode) if v0 is None and drives is None else v0
    check_choice("method", method, METHODS)
    on_toggle = checked_toggle(on_toggle, method, drives is not None)
    check_choice("newton_start", newton_start, ("tangent", "previous"))
    record = checked_record(record)
    _check_flags(progress, hold, stepper, fixed)
    check_positive("rtol", rtol)
    check_positive("atol", atol)
    check_between("threshold", threshold, 0.0, 1.0)
    options = USUAL if options is None else options
    if not isinstance(options, BridgeOptions):
        raise OptionError(f"options = {options!r} must be a BridgeOptions, such as BridgeOptions(zone=0.05)")
    check_choice("backend", backend, BACKENDS)
    kernel = chosen_library(backend, method, newton_start)
    again = None
    if unnamed and not hold and is_guarded(tableau, method, drives, applied, ctrl, backend):
        again = partial(
            simulate, mechanism, q0, v0, duration, step=step, torque=torque, wrenches=wrenches, ctrl=ctrl,
            events=events, t0=t0, outputs=outputs, record=record, mode=mode, rtol=rtol, atol=atol,
            joints=joints, on_toggle=on_toggle, options=options, progress=progress,
        )  # fmt: skip
    all_of_it = drives is not None and not len(drives.free)
    choice = MapChoice(method, options, newton_start, threshold, not fixed, all_of_it)
    acting: Torque | ArrayLike | None = applied
    if hold:
        acting = HeldTorque.of(mechanism, applied, ctrl, schedule.times) or applied
    elif ctrl is not None:
        acting = applied = with_control(mechanism, applied, ctrl, schedule.times)
    solver = None if fixed else (str(stepper), rtol, atol)
    asked = record, checked_events(events)
    parts = mechanism.parts if joints is None else parts_given(joints)
    course = Course(
        mechanism, schedule, duration, step, choice, drives, tableau, solver, Acted(applied, tuple(wrenches)),
        *asked, on_toggle,
        restitution=checked_cusp(on_cusp, parts, isinstance(acting, HeldTorque)),
    )  # fmt: skip
    refused = {
        f"method={method!r}": method != "bridge", f"stepper={stepper!r}": not fixed,
        "drive=": drives is not None and not parts,
    }  # fmt: skip
    given = (q0, v0, mode), acting, kernel, backend == "native"
    if not parts and course.restitution is None:
        try:
            return course.run(*given, again, progress)
        except CuspError as error:
            # taken again by phases the motion is led along the arc to the cusp itself, and ends there
            if error.arrival is None or any(refused.values()):
                raise
    return course.through_phases(parts, *given, refused, progress)  # on a cusp's arc it has no plain steps


def checked_cusp(on_cusp: Any, parts: Sequence[Part], held: bool) -> float | None:
    """The share of the speed that is kept at a cusp; None where a motion ends there. Or an OptionError."""
    other = "joints=" if parts else "hold=True" if held else None
    if other is not None and on_cusp != "error":
        raise OptionError(f"on_cusp: a turn at cusps does not go with {other} yet; leave one of them out")
    if isinstance(on_cusp, str):
        check_choice("on_cusp", on_cusp, ("error", "turn"))
        return None if on_cusp == "error" else 1.0
    check_between("on_cusp", on_cusp, 0.0, 1.0)
    return float(on_cusp)


def checked_toggle(on_toggle: Toggle | None, method: str, driven: bool) -> Toggle:
    """What is done where y turns back, the default where nothing is said, or an OptionError."""
    if on_toggle is None:
        return "repartition" if method == "bridge" and not driven else "error"
    check_choice("on_toggle", on_toggle, ("error", "repartition"))
    if on_toggle == "repartition" and method != "bridge":
        raise OptionError(f'on_toggle="repartition" goes with method="bridge", not with {method!r}')
    if on_toggle == "repartition" and driven:
        raise OptionError('drive: driven joints stay independent; leave on_toggle out, or give "error"')
    return on_toggle


def _check_flags(progress: Any, hold: Any, stepper: Any, fixed: bool) -> None:
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise OptionError(f"progress = {shown(progress)} must be True, or callable, progress(fraction)")
    if not isinstance(hold, bool):
        raise OptionError(f"hold = {shown(hold)} must be True or False")
    if hold and not fixed:
        raise OptionError(f"hold=True goes with fixed steps, not with {stepper!r}; use rk4 or a Tableau")


def checked_record(record: Any) -> list[str]:
    """What to record besides q and v, or an OptionError."""
    if isinstance(record, str):
        record = (record,)
    items = listed(record, "record", f"any of {', '.join(RECORDS)}", OptionError)
    for item in items:
        check_choice("record", item, RECORDS)
    return items
