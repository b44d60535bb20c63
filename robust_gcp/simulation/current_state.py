"""Where a simulation is: its state, and what follows from that, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.loads import Wrench
from ..dynamics.prescribed.zero_order_hold import HeldTorque
from ..maps.explicit import Crossing
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .trajectories.access import SENSOR, FrameMotion, Sample, as_name, force_columns
from .trajectories.acted import powered_columns
from .trajectories.reactions import Loaded, Reaction, multipliers_of, row_names
from .trajectories.sensing import sensed

if TYPE_CHECKING:
    from .phases.happening import Happening
    from .phases.phased_simulation import PhasedRun
    from .runs.stepped import SteppedRun


@dataclass(frozen=True)
class Here:
    """q, v, a and all that acts besides gravity, (nv,) or None; what drives take; more numbers by name."""

    q: Array
    v: Array
    a: Array
    tau: Array | None
    drive: Array | None = None
    more: Mapping[str, Array | float] = field(default_factory=dict)


class Present:
    """The present state of a `Simulation`."""

    mechanism: Mechanism
    _run: SteppedRun | PhasedRun
    _held: HeldTorque
    _wrenches: tuple[Wrench, ...]
    _step: float

    def __repr__(self) -> str:
        """What moves, where time is, what happened."""
        what = f"{self.mechanism.name!r}: t = {self.t:g} s, step {self._step:g} s"
        return f"Simulation of {what}, {len(self.crossings)} crossings"

    @property
    def t(self) -> float:
        """s."""
        return self._run.time

    @property
    def q(self) -> Array:
        """Configuration (nq,)."""
        return self._run.state[0].copy()

    @property
    def v(self) -> Array:
        """Velocity (nv,)."""
        return self._run.state[1].copy()

    @property
    def y(self) -> Array:
        """Independent coordinates (m,); a PartitionError where some are on groups."""
        return self._run.state[0][self.mechanism.iq_independent]

    @property
    def a(self) -> Array:
        """Acceleration (nv,) under the torque that was held last."""
        return self._run.here.a.copy()

    @property
    def energy(self) -> float:
        """Kinetic energy plus that of gravity and springs, J."""
        return self.mechanism.energy(*self._run.state)

    def __getitem__(self, name: str) -> Array:
        """A number of the present state: "q1", "v.q1", "sensor.imu" and whatever `now` has."""
        name = as_name(name)
        if name in self.mechanism.joint_names or name.startswith(("q.", "v.")):
            q, v = self._run.state
            # no name of these asks for a, which would have to be computed: v stands in its place
            return Sample(self.mechanism, np.array(self.t), q.copy(), v.copy(), v)[name]
        if name.startswith(SENSOR):
            return self._sensed(name.removeprefix(SENSOR))
        return self.now[name]

    def _sensed(self, name: str) -> Array:
        """What a sensor reads now, (dim,)."""
        needs = self.mechanism.sensors[name].needs
        if needs in "fus":
            return sensed(self._loaded(balanced=needs == "f"), name)[0]
        q, v = self._run.state
        a = self._run.here.a if needs == "a" else v
        return Sample(self.mechanism, np.array(self.t), q, v, a)._sensed(name)

    @property
    def now(self) -> Sample:
        """The present state with all that is known of it, under the torque that was held last.

        `now["q1"]`, `now["a.q1"]`, "energy", "tau.q1", "drive.q1", "lambda.…": the names of
        `Trajectory.columns`.
        """
        mechanism, last, here = self.mechanism, self._run.here, self._loaded()
        more = {"energy": np.array(self.energy)}
        more |= force_columns(mechanism, "tau", mechanism.tree.zero if last.tau is None else last.tau)
        if last.drive is not None:
            more |= force_columns(mechanism, "drive", last.drive)
        powered = powered_columns(mechanism, here.q, here.v, here.u)
        more |= {name: values[0] for name, values in powered.items()}
        if mechanism.nc and here.multipliers is not None:
            found = here.multipliers[0]
            more |= {f"lambda.{name}": found[i] for i, name in enumerate(row_names(mechanism))}
        more |= {name: np.array(value) for name, value in last.more.items()}
        return Sample(mechanism, here.t[0], here.q[0], here.v[0], last.a, more)

    def frame(self, name: str) -> FrameMotion:
        """How a frame moves now; see `Trajectory.frame`."""
        return Sample(self.mechanism, np.array(self.t), self.q, self.v, self.a).frame(name)

    def reaction(self, joint: str | int) -> Reaction:
        """Force (3,) and moment (3,) that a joint transmits now; see `Trajectory.reaction`."""
        return self._loaded().reaction(joint).at(0)

    def _loaded(self, balanced: bool = True) -> Loaded:
        """With the constraint forces, where they are asked for."""
        mechanism, last = self.mechanism, self._run.here
        q, v, a, multipliers = last.q[None], last.v[None], last.a[None], None
        if balanced:
            multipliers = multipliers_of(mechanism, q, v, a, None if last.tau is None else last.tau[None])
        state = mechanism, np.array([self.t]), q, v, lambda: a
        stops = {name: np.array([value]) for name, value in last.more.items()}
        return Loaded(*state, multipliers, self._wrenches, self._held.now(self.t), stops=stops)

    @property
    def happenings(self) -> list[Happening]:
        """Of `joints`, so far: impacts, holds, releases and so on, in the order of time."""
        return list(self._run.happenings)

    @property
    def dissipated(self) -> float:
        """Energy lost so far by impacts, friction and dampers of stops, J."""
        return self._run.dissipated

    @property
    def t_events(self) -> list[Array]:
        """When each event happened so far, s."""
        return self._run.events.found(self.mechanism)[0]

    @property
    def q_events(self) -> list[Array]:
        """q then, (k, nq) each."""
        return self._run.events.found(self.mechanism)[1]

    @property
    def v_events(self) -> list[Array]:
        """v then, (k, nv) each."""
        return self._run.events.found(self.mechanism)[2]

    @property
    def ended_by(self) -> int | None:
        """Number of the event that ended the simulation."""
        return self._run.events.ended_by

    @property
    def crossings(self) -> list[Crossing]:
        """Singular configurations passed so far."""
        return self._run.crossings
