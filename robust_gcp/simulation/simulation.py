"""`Simulation`: a mechanism that is simulated one step at a time, as controllers and games need it."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_choice, check_finite, check_mechanism, check_positive, check_whole, shown
from ..dynamics.loads import Wrench, one_torque, wrenches_given
from ..dynamics.prescribed.control import Controls, held_controls
from ..dynamics.prescribed.motion import Motion
from ..dynamics.prescribed.zero_order_hold import HeldTorque
from ..errors import ClosureError, NonFiniteError, OptionError, SimulationError, SingularStartError
from ..kernel.simulation.steps import BACKENDS, chosen_library
from ..maps.choice import METHODS, MapChoice, Method
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import Part, parts_given
from ..mechanism.tree.tree import Array
from .current_state import Present
from .events import EventFunction, checked_events
from .runs.course import OVERFLOWN
from .runs.initial_state import Given
from .runs.schedule import Keep
from .runs.too_long_steps import Coarse
from .saved_state import SavedState, StartState
from .simulate import checked_record
from .simulation_plan import ROOM, StepwisePlan
from .trajectories.files import ARRAYS
from .trajectories.trajectory import Trajectory


class Simulation(Present):
    """A mechanism simulated by RK4, step by step, with torques held over each step.

    The same digits as `simulate` with the same torques, through singular configurations too.

    Parameters
    ----------
    mechanism : Mechanism
    q0, v0 : array_like (nq,), (nv,), optional
        As in `simulate`; home, and at rest, when left out.
    step : float
        s.
    method : {"bridge", "projection", "classical", "closed_form"}
    backend : {"auto", "python", "native"}
    mode : array_like, optional
        As in `simulate`, where q0 is singular.
    wrenches : sequence of Wrench
        Forces and moments on frames; their functions are called once a step and held over it.
    events : callable (t, q, v) -> float, or sequence of such, optional
        As in `simulate`: `t_events`, `q_events`, `v_events`. One that is terminal ends the simulation, whose
        state is then the one there; `reset` and `restore` lead on.
    joints : sequence of Stop, JointFriction, Lock, optional
        As in `simulate`; a step goes through all that happens in it: `happenings`, `dissipated`,
        `sim["stop.q3"]`. Those of the mechanism's file when left out.
    record : sequence of {"a", "energy", "multipliers", "tau"}
        What `trajectory` holds besides q and v.
    drive : mapping of str to Motion, optional
        Joints that move as prescribed, as in `simulate`; `trajectory["drive.q1"]` is what that takes.
    t0 : float
        Time at the start, s.
    ctrl : mapping of str or array_like (n,), optional
        Controls of the actuators that are held until `step` is given others, each a number. Without them the
        actuators have no power.
    keep : {"all", "last", "none"} or int
        Which steps `trajectory` holds: all, which takes 8 (nq + nv) bytes and more a step; each n-th since
        the start and the last; the last alone; none. Crossings and `stats` are of all steps.

    Raises
    ------
    OptionError, StateError, SimulationError
        As `simulate` does for a start.

    Warns
    -----
    StabilityWarning
        Where the step lies outside the region of stability at the start, under torques that are held.
    CoarseStepWarning
        Once, where a step takes a joint too far; and where `trajectory` tells of too much energy.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        step: float = 1e-3,
        method: Method = "bridge",
        backend: Literal["auto", "python", "native"] = "auto",
        *,
        mode: ArrayLike | None = None,
        wrenches: Sequence[Wrench] = (),
        events: EventFunction | Sequence[EventFunction] | None = None,
        record: Sequence[str] = (),
        joints: Sequence[Part] | None = None,
        drive: Mapping[str, Motion] | None = None,
        t0: float = 0.0,
        keep: Literal["all", "last", "none"] | int = "all",
        ctrl: Controls | None = None,
    ) -> None:
        check_mechanism(mechanism, Mechanism, "Simulation")
        check_positive("step", step)
        check_choice("method", method, METHODS)
        check_choice("backend", backend, BACKENDS)
        record = checked_record(record)
        check_finite("t0", t0)
        kernel = chosen_library(backend, method, "tangent"), backend == "native"
        self._step, self._none = float(step), np.zeros(mechanism.nv)
        self._wrenches = tuple(wrenches_given(wrenches))
        parts = parts_given(mechanism.parts if joints is None else joints)
        asked = record, checked_events(events), self._wrenches, drive, Keep.of(keep), parts
        held = self._held = HeldTorque(mechanism)
        self._plan = StepwisePlan(mechanism, self._step, float(t0), held, MapChoice(method), *asked, *kernel)
        loads = one_torque(mechanism, None, self._wrenches)
        self._loads = loads if callable(loads) else None
        self._ctrl = None if ctrl is None else held_controls(mechanism, ctrl)
        # controls of NaN: no power
        self._idle = held.row(self._none, None, (0.0, 0.0))[mechanism.nv :]
        self._places = {joint.name: joint.idx_v for joint in mechanism.joints if joint.single}
        self.reset(q0, v0, mode=mode)

    def reset(
        self, q0: ArrayLike | None = None, v0: ArrayLike | None = None, *, mode: ArrayLike | None = None
    ) -> Simulation:
        """Begin anew at t0, from a start as for a new simulation; returns itself.

        Controls stay those given last. What `save` gave before still leads back.

        Parameters
        ----------
        q0, v0, mode : array_like, optional
            Home, and at rest, when left out.

        Raises
        ------
        OptionError, StateError, SimulationError
            As `simulate` does for a start; the simulation is then as it was.
        """
        return self._reset((q0, v0, mode), self._ctrl)

    def _reset(self, start: Given, ctrl: Array | None, saved: StartState | None = None) -> Simulation:
        plan, begun = self._plan, time.perf_counter()
        plan.mechanism.require_unchanged()
        was, held = dict(vars(self)), self._held.value
        self.mechanism, run = plan.run(start, ctrl, saved)
        self._begun, self._run, self._ctrl = begun, run, ctrl
        self._coarse = Coarse(self.mechanism, self._step) if plan.choice.method == "bridge" else None
        try:
            run.recall(None if saved is None else saved.phase)
            run.begin()
        except Exception as error:
            if isinstance(error, SimulationError | ClosureError):
                error.trajectory = self.trajectory
            vars(self).update(was)
            self._held.value = held
            raise
        return self

    def step(
        self, tau: ArrayLike | Mapping[str, Any] | None = None, n: int = 1, *, ctrl: Controls | None = None
    ) -> Simulation:
        """Take n steps under the torque tau, which is held over all of them; returns itself.

        Parameters
        ----------
        tau : array_like (nv,) or mapping {joint: torque}, optional
            N m and N; none when left out.
        n : int
        ctrl : mapping of str or array_like (n,), optional
            Controls of the actuators from now on, numbers; those that are not named go on as they were, at
            first 0.

        Raises
        ------
        OptionError, StateError
            For arguments that are none.
        SimulationError
            Where the motion must stop; `error.trajectory` holds it. Only `restore` leads on from there.
        """
        check_whole("n", n, 1)
        self._plan.mechanism.require_unchanged()
        held = self._none if tau is None else self._asked(tau)
        run, left = self._run, int(n)
        if run.ended:
            raise OptionError(f"event {run.events.ended_by} ended this simulation; go on by reset or restore")
        if ctrl is not None:
            self._ctrl = held_controls(self._plan.mechanism, ctrl, self._ctrl)
        powered = self._ctrl is not None
        # wrenches follow the state, and activations go on from step to step: held anew at each
        single = self._loads is not None or (powered and self._held.stride)
        at_once = 1 if single else left if self._plan.keep.all else ROOM
        try:
            while left and not run.ended:
                now = min(left, at_once)
                run.room_for(now, self._step)
                loads = self._loads
                value = held if loads is None else held + np.asarray(loads(run.time, *run.state))
                if powered:
                    value = self._held.row(value, self._ctrl, (run.time, run.time + self._step))
                elif len(self._idle):
                    value = np.concatenate((value, self._idle))
                run.take(value, now)
                left -= now
        except (SimulationError, ClosureError) as error:
            error.trajectory = self.trajectory
            raise
        except OverflowError as overflow:
            stop = NonFiniteError(OVERFLOWN)
            stop.trajectory = self.trajectory
            raise stop from overflow
        if self._coarse is not None:
            self._coarse.look(run.time, run.state[1])
        return self

    def _asked(self, tau: ArrayLike | Mapping[str, Any]) -> Array:
        """What `step` was given, (nv,); what is plainly right in a fraction of the time of all checks."""
        none = self._none
        if type(tau) is np.ndarray and tau.dtype == none.dtype and tau.shape == none.shape:
            return tau.copy() if tau.dot(none) == 0.0 else self.mechanism.velocity(tau, "tau")  # all finite
        if type(tau) is dict:
            held = self._none.copy()
            for name, value in tau.items():
                place = self._places.get(name)
                if place is None or not isinstance(value, float) or not math.isfinite(value):
                    break
                held[place] = value
            else:
                return held
        given = tau.values() if isinstance(tau, Mapping) else (tau,)
        if any(map(callable, given)):
            raise OptionError(
                f"tau = {shown(tau)}: a step holds numbers; call the function and give what it returns, "
                "f(sim.t, sim.q, sim.v)"
            )
        return self.mechanism.velocity(tau, "tau")

    @property
    def trajectory(self) -> Trajectory:
        """The motion so far, as far as it is kept; a copy."""
        run = self._run.trajectory(self._begun)
        for name in ARRAYS:
            values = getattr(run, name)
            setattr(run, name, None if values is None else values.copy())
        if self._coarse is not None:
            self._coarse.weigh(run)
        return run

    def save(self) -> SavedState:
        """All that steps change, to be given to `restore` as often as one likes.

        Pickled, it is where another simulation may begin.
        """
        run, place = self._run, (self.t, self.q, self.v)
        driven = None if self._ctrl is None else (self._ctrl.copy(), self._held.activations(self.t))
        names, phase = self.mechanism.joint_names, run.remembered()
        start = StartState(names, *place, run.toward, driven, phase, run.independent)
        return SavedState(self, run, start)

    def restore(self, state: SavedState | StartState) -> Simulation:
        """Go back, to the last bit, to where `save` of this simulation gave the state; returns itself.

        From one that was pickled it begins anew, at that state and time, whichever simulation gave it.

        Raises
        ------
        OptionError
            For what is no such state, or another simulation's.
        """
        if isinstance(state, StartState):
            return self._begin_at(state)
        if not isinstance(state, SavedState):
            raise OptionError(f"state = {shown(state)} is not what save() returned")
        self._run = state.run_of(self)
        self._ctrl = self._held.powered
        return self

    def _begin_at(self, start: StartState) -> Simulation:
        """Begin anew at a state, on its mode where it is singular."""
        if start.joints != self.mechanism.joint_names:
            raise OptionError(f"state is one of the joints {', '.join(start.joints)}, not of {self!r}")
        ctrl = None if start.driven is None else start.driven[0]
        try:
            return self._reset((start.q, start.v, None), ctrl, start)
        except SingularStartError:
            return self._reset((start.q, start.v, start.mode), ctrl, start)

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        raise OptionError(
            f"{self!r} cannot be copied or pickled, as it goes on in the kernel's memory; for another one "
            "from here: Simulation(mechanism, sim.q, sim.v, t0=sim.t); trajectory.save(path) keeps the motion"
        )
