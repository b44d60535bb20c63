"""What a motion is made of, by name: joints, columns, frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pinocchio as pin

from ...checks import hint, shown
from ...errors import OptionError
from ...mechanism.frames import place_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import in_q, in_v
from ...mechanism.tree.tree import Array
from ...mechanism.tree.workspace import workspace
from .reactions import Loaded, row_names
from .sensing import sensed

if TYPE_CHECKING:
    from .trajectory import Trajectory

SENSOR = "sensor."
"""What names of sensors begin with."""

UNRECORDED = {
    "a": '; accelerations were not recorded: simulate with record=("a",)',
    "energy": '; energy was not recorded: simulate with record=("energy",)',
    "tau": '; what acts was not recorded: simulate with record=("tau",)',
    "lambda": '; constraint forces were not recorded: simulate with record=("multipliers",)',
    "drive": "; no joint is driven: simulate with drive={joint: Motion}",
    "actuator": "; the actuators had no power: simulate with ctrl={actuator: control}",
    "activation": "; no actuator with an activation had power: simulate with ctrl={actuator: control}",
    "work": "; nothing does work but gravity and springs",
}
"""Why columns that begin so may be missing, and how to have them."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """How a frame moves; all vectors in world axes, N times or one (then without the first dimension).

    Attributes
    ----------
    name : str
    position : ndarray (N, 3)
        Of the frame's origin, m.
    rotation : ndarray (N, 3, 3)
        Its columns are the frame's axes.
    velocity, acceleration : ndarray (N, 3)
        First and second derivative of `position`, m/s and m/s².
    angular_velocity, angular_acceleration : ndarray (N, 3)
        rad/s and rad/s².
    """

    name: str
    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array

    @property
    def placement(self) -> Array:
        """Homogeneous matrices (N, 4, 4): from coordinates in the frame to world coordinates."""
        matrices = np.zeros((*self.position.shape[:-1], 4, 4))
        matrices[..., :3, :3], matrices[..., :3, 3] = self.rotation, self.position
        matrices[..., 3, 3] = 1.0
        return matrices


def frame_motion(mechanism: Mechanism, name: str, q: Array, v: Array, a: Array) -> FrameMotion:
    """The motion of a frame of the model, of a link, a joint or a cut point.

    Parameters
    ----------
    q, v, a : ndarray (N, nq), (N, nv), (N, nv)

    Raises
    ------
    ModelError
        For a frame that the model does not have.
    """
    model = mechanism.own_model
    joint, place = place_of(model, name)
    data, axes = workspace(model), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    n = len(q)
    position, rotation = np.empty((n, 3)), np.empty((n, 3, 3))
    rates = np.empty((4, n, 3))
    for i in range(n):
        pin.forwardKinematics(model, data, q[i], v[i], a[i])
        placement = data.oMi[joint] * place
        velocity = pin.getFrameVelocity(model, data, joint, place, axes)
        acceleration = pin.getFrameClassicalAcceleration(model, data, joint, place, axes)
        position[i], rotation[i] = placement.translation, placement.rotation
        rates[:, i] = velocity.linear, acceleration.linear, velocity.angular, acceleration.angular
    return FrameMotion(name, position, rotation, *rates)


def state_columns(mechanism: Mechanism, q: Array, v: Array, a: Array | None) -> dict[str, Array]:
    """Each number of each joint, such as "q.q1", as a view (...,) into q, v and a (..., n)."""
    joints = mechanism.joints
    columns = {f"q.{c.name}": q[..., c.iq] for c in in_q(joints)}
    columns |= {f"v.{c.name}": v[..., c.iv] for c in in_v(joints)}
    if a is not None:
        columns |= {f"a.{c.name}": a[..., c.iv] for c in in_v(joints)}
    return columns


def force_columns(mechanism: Mechanism, what: str, forces: Array) -> dict[str, Array]:
    """What acts on each number in v, such as "tau.q1", as views into forces (..., nv); none of NaN."""
    known = [c for c in in_v(mechanism.joints) if not np.isnan(forces[..., c.iv]).any()]
    return {f"{what}.{c.name}": forces[..., c.iv] for c in known}


def recorded_columns(run: Trajectory) -> dict[str, Array]:
    """`Trajectory.columns` but for those that are computed when asked for."""
    mechanism = run.mechanism
    columns = {"t": run.t} | state_columns(mechanism, run.q, run.v, run.a)
    single = {"energy": run.energy, "work": run.work, "dissipated": run.dissipated}
    columns |= {name: values for name, values in single.items() if values is not None}
    for what, forces in (("tau", run.tau), ("drive", run.drive_torque)):
        if forces is not None:
            columns |= force_columns(mechanism, what, forces)
    if run.multipliers is not None:
        names = row_names(mechanism)
        columns |= {f"lambda.{name}": run.multipliers[:, i] for i, name in enumerate(names)}
    if run.part_forces is not None:
        columns |= dict(zip(run.part_names, run.part_forces.T, strict=True))
    return columns


def as_name(name: object) -> str:
    """A name as it is; of what is none the words that show it, which no joint or column has."""
    return name if isinstance(name, str) else shown(name)


class Named:
    """Access by name to a motion or to a sample of one, whose last dimensions are nq and nv."""

    mechanism: Mechanism
    q: Array
    v: Array
    _absent: ClassVar[Mapping[str, str]] = {}

    def columns(self) -> dict[str, Array]:
        """Every number recorded, by its name in a table."""
        raise NotImplementedError

    def __getitem__(self, name: str) -> Array:
        """A joint's numbers in q ("q1"), in v ("v.q1") or a ("a.q1"), one of them ("ball.qw"), or a column.

        "sensor.NAME": what a sensor of the mechanism's file reads.

        Returns
        -------
        ndarray (N,), or (N, k) for a joint with k numbers, and for a sensor
            A view; without the first dimension in a sample at one time.

        Raises
        ------
        OptionError
            For a name that is neither a joint nor a column.
        """
        name = as_name(name)
        names = self.mechanism.joint_names
        if name.startswith(SENSOR) and name not in names:
            return self._sensed(name.removeprefix(SENSOR))
        letter, _, joint = name.partition(".") if name not in names else ("q", ".", name)
        values: Array | None = getattr(self, letter) if letter in ("q", "v", "a") and joint in names else None
        if values is None:
            return self._column(name)
        model = self.mechanism.joint(joint)
        first, count = (model.idx_q, model.nq) if letter == "q" else (model.idx_v, model.nv)
        return values[..., first] if count == 1 else values[..., first : first + count]

    def _recorded(self) -> dict[str, Array]:
        """Those of `columns` that need not be computed."""
        return self.columns()

    def _sensed(self, name: str) -> Array:
        """What a sensor reads; each by what it knows of the motion."""
        raise NotImplementedError

    def _column(self, name: str) -> Array:
        recorded = self._recorded()
        columns = recorded if name in recorded or f"q.{name}" in recorded else self.columns()
        for known in (name, f"q.{name}"):
            if known in columns:
                return columns[known]
        names = self.mechanism.joint_names
        beginning = str(name).partition(".")[0]
        there = any(known.partition(".")[0] == beginning for known in columns)
        unrecorded = "" if there else self._absent.get(beginning, "")
        raise OptionError(
            f"{shown(name)} is not in this motion{unrecorded or hint(name, [*names, *columns])}; its joints "
            f"are {', '.join(names)}, its columns {', '.join(columns)}"
        )


@dataclass(frozen=True, eq=False)
class Sample(Named):
    """A motion at one time, or at several: what `Trajectory.at` gives.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray (k,), or () for one time
        s.
    q, v, a : ndarray (k, nq), (k, nv), (k, nv); without the first dimension for one time
    more : dict of str to ndarray
        Other columns, where they are known: of the present state of a `Simulation`.
    """

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array
    more: Mapping[str, Array] = field(default_factory=dict)

    @property
    def y(self) -> Array:
        """Independent coordinates, (k, m) or (m,); a PartitionError where some are on groups."""
        return self.q[..., self.mechanism.iq_independent]

    def columns(self) -> dict[str, Array]:
        """Time and each number of each joint, by name, and what more is known."""
        return {"t": self.t, **state_columns(self.mechanism, self.q, self.v, self.a), **self.more}

    def _sensed(self, name: str) -> Array:
        if self.mechanism.sensors[name].needs in "ufs":
            raise OptionError(
                f"sensor {name!r}: controls and forces are known at the times of the run alone: ask "
                f'run["{SENSOR}{name}"]'
            )
        t, (q, v, a) = np.atleast_1d(self.t), (np.atleast_2d(part) for part in (self.q, self.v, self.a))
        found = sensed(Loaded(self.mechanism, t, q, v, lambda: a, None, None), name)
        return found if self.t.ndim else found[0]

    def frame(self, name: str) -> FrameMotion:
        """The motion of a frame of the model; see `Trajectory.frame`."""
        rows = (np.atleast_2d(part) for part in (self.q, self.v, self.a))
        found = frame_motion(self.mechanism, name, *rows)
        if self.t.ndim:
            return found
        return FrameMotion(name, *(part[0] for key, part in vars(found).items() if key != "name"))
