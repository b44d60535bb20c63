"""Sensors that a rigid mechanism can answer: what each is attached to, and its numbers at a state.

Kinds, numbers and signs are MJCF's. A sensor knows the joints that carry it by name, and places on them, so
that it serves whatever the coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...checks import hint, shown
from ...errors import ModelError
from ..tree.tree import Array
from ..tree.vectors import cross
from .instant import Branch, Instant, Spot


@dataclass(frozen=True)
class Sensor:
    """A sensor of a robot's file.

    Attributes
    ----------
    name, kind : str
        `kind` as MJCF has it: "gyro", "framepos", …
    joint, tendon : str or None
        Whose position, velocity, or force it reads.
    actuators : tuple of str
        Of "actuator…" the one that it reads, of "tendonactuatorfrc" all that pull at the tendon.
    spot, reference : Spot or None
        The frame that it measures, and the one that it measures in; None: the world's.
    branch : Branch or None
        Of "subtree…", "force" and "torque"; of "e_potential" the bodies that stand still.
    numbers : tuple of float
        "magnetometer": the field (3,); "jointlimit…", "tendonlimit…": lower, upper and margin.
    cutoff : float
        Numbers are clipped to ± cutoff where it is positive.
    """

    name: str
    kind: str
    joint: str | None = None
    tendon: str | None = None
    actuators: tuple[str, ...] = ()
    spot: Spot | None = None
    reference: Spot | None = None
    branch: Branch | None = None
    numbers: tuple[float, ...] = ()
    cutoff: float = 0.0

    @property
    def dim(self) -> int:
        """How many numbers it has."""
        return KINDS[self.kind].dim

    @property
    def needs(self) -> str:
        """What it depends on: "q", "v", "a", "u" of actuators, or forces: "f" in joints, "s" of stops."""
        return KINDS[self.kind].needs


class Sensors(dict[str, Sensor]):
    """Sensors by name; a ModelError for a name that there is not."""

    def __missing__(self, name: object) -> Sensor:
        known = ", ".join(self) or "none"
        raise ModelError(f"there is no sensor {shown(name)}{hint(str(name), list(self))}; it has {known}")


def sensor_from(plain: Mapping[str, Any]) -> Sensor:
    """A sensor from its fields as JSON has them.

    Raises
    ------
    LookupError, TypeError
        For what is none.
    """
    fields = _tuples(plain)
    if fields["kind"] not in KINDS:
        raise LookupError(f"sensors of the kind {fields['kind']!r} are not known")
    for name, kind in (("spot", Spot), ("reference", Spot), ("branch", Branch)):
        part = fields.get(name)
        fields[name] = None if part is None else kind(**_tuples(part))
    return Sensor(**fields)


def _tuples(plain: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()}


def read(sensor: Sensor, here: Instant) -> Array:
    """The sensor's numbers at a state, (dim,)."""
    found = np.asarray(KINDS[sensor.kind].read(here, sensor), dtype=float).reshape(-1)
    return np.clip(found, -sensor.cutoff, sensor.cutoff) if sensor.cutoff > 0.0 else found


def _seen(here: Instant, sensor: Sensor, vector: Array) -> Array:
    """A world vector in the axes of the reference."""
    return vector if sensor.reference is None else here.placed(sensor.reference)[2].rotation.T @ vector


def _own(here: Instant, sensor: Sensor, vector: Array) -> Array:
    """A world vector in the axes of the sensor's own frame."""
    assert sensor.spot is not None
    return np.asarray(here.placed(sensor.spot)[2].rotation.T @ vector)


def _pose(here: Instant, sensor: Sensor) -> pin.SE3:
    """The frame's pose in its reference."""
    assert sensor.spot is not None
    pose = here.placed(sensor.spot)[2]
    return pose if sensor.reference is None else here.placed(sensor.reference)[2].actInv(pose)


def _quaternion(here: Instant, sensor: Sensor) -> Array:
    """(w, x, y, z) with w ≥ 0."""
    x, y, z, w = pin.Quaternion(_pose(here, sensor).rotation).coeffs()
    return np.array([w, x, y, z]) * (-1.0 if w < 0.0 else 1.0)


def _velocity(here: Instant, sensor: Sensor) -> tuple[Array, Array]:
    """v and ω as the reference sees them: v − v_r − ω_r × (p − p_r) and ω − ω_r, in its axes."""
    assert sensor.spot is not None
    v, w = here.velocity(sensor.spot)
    if sensor.reference is None:
        return v, w
    moving, turning = here.velocity(sensor.reference)
    apart = here.placed(sensor.spot)[2].translation - here.placed(sensor.reference)[2].translation
    return _seen(here, sensor, v - moving - cross(turning, apart)), _seen(here, sensor, w - turning)


def _joint(here: Instant, sensor: Sensor) -> tuple[Array, Array]:
    """A joint's numbers in q and in v."""
    joint = here.model.joints[here.index(str(sensor.joint))]
    return here.q[joint.idx_q :][: joint.nq], here.v[joint.idx_v :][: joint.nv]


def _limit(here: Instant, sensor: Sensor) -> tuple[float, float]:
    """How far a joint or tendon is within the limit that is reached, less its margin, and the rate.

    Zeros within all limits. Of a spherical joint its angle counts, at most half a turn, and `upper` alone.
    """
    lower, upper, margin = sensor.numbers
    if sensor.tendon is not None:
        length, rate = here.tendon(sensor.tendon)
        q, v = np.array([length]), np.array([rate])
    else:
        q, v = _joint(here, sensor)
    ends = [(q[0] - lower, v[0]), (upper - q[0], -v[0])]
    if len(q) > 1:
        size = float(np.linalg.norm(q[:3]))
        # of the shorter way round
        axis = q[:3] / size * (-1.0 if q[3] < 0.0 else 1.0) if size else np.zeros(3)
        ends = [(upper - 2.0 * np.arctan2(size, abs(q[3])), -axis @ v)]  # acos errs by 1e-8 near no rotation
    return next(((gap - margin, rate) for gap, rate in ends if gap < margin), (0.0, 0.0))


def _carried(here: Instant, sensor: Sensor) -> tuple[Array, Array]:
    """Force and moment about its frame that a branch receives from what carries it, in the frame's axes."""
    assert sensor.spot is not None and sensor.branch is not None
    total = here.placed(sensor.spot)[2].actInv(here.wrench(sensor.branch))  # moments about the frame's origin
    return total.linear, total.angular


def _spinning(here: Instant, sensor: Sensor) -> Array:
    """Angular momentum of a branch about its own centre."""
    _, centre, total = here.momentum(_branch(sensor))
    return np.asarray(total.angular - cross(centre, total.linear))


def _drifting(here: Instant, sensor: Sensor) -> Array:
    """Velocity of a branch's centre."""
    mass, _, total = here.momentum(_branch(sensor))
    return np.asarray(total.linear / mass)


def _potential(here: Instant, sensor: Sensor) -> float:
    """Energy of gravity, of bodies that stand still too, and of springs."""
    energy = here.mechanism.energies(here.q, np.zeros(here.model.nv))[1]
    if sensor.branch is not None:
        mass, centre = here.centre(sensor.branch)
        energy -= mass * float(here.gravity @ centre)  # bodies on the ground are in no inertia of the model
    return energy


def _branch(sensor: Sensor) -> Branch:
    assert sensor.branch is not None
    return sensor.branch


def _spot(sensor: Sensor) -> Spot:
    assert sensor.spot is not None
    return sensor.spot


def _pulling(here: Instant, sensor: Sensor) -> float:
    """Sum of what its actuators pull with."""
    return sum(here.actuator(name)[2] for name in sensor.actuators)


class Kind(NamedTuple):
    """A kind of sensor: how many numbers, what they depend on (`Sensor.needs`), and how they are read."""

    dim: int
    needs: str
    read: Callable[[Instant, Sensor], Array | float]


KINDS: dict[str, Kind] = {
    "jointpos": Kind(1, "q", lambda here, s: _joint(here, s)[0]),
    "jointvel": Kind(1, "v", lambda here, s: _joint(here, s)[1]),
    "ballquat": Kind(4, "q", lambda here, s: np.roll(_joint(here, s)[0], 1)),  # w first
    "ballangvel": Kind(3, "v", lambda here, s: _joint(here, s)[1]),
    "jointlimitpos": Kind(1, "q", lambda here, s: _limit(here, s)[0]),
    "jointlimitvel": Kind(1, "v", lambda here, s: _limit(here, s)[1]),
    "jointlimitfrc": Kind(1, "s", lambda here, _: here.stop),
    "jointactuatorfrc": Kind(1, "u", lambda here, s: here.driving(str(s.joint))),
    "actuatorpos": Kind(1, "q", lambda here, s: here.actuator(s.actuators[0])[0]),
    "actuatorvel": Kind(1, "v", lambda here, s: here.actuator(s.actuators[0])[1]),
    "actuatorfrc": Kind(1, "u", _pulling),
    "tendonpos": Kind(1, "q", lambda here, s: here.tendon(str(s.tendon))[0]),
    "tendonvel": Kind(1, "v", lambda here, s: here.tendon(str(s.tendon))[1]),
    "tendonactuatorfrc": Kind(1, "u", _pulling),
    "tendonlimitpos": Kind(1, "q", lambda here, s: _limit(here, s)[0]),
    "tendonlimitvel": Kind(1, "v", lambda here, s: _limit(here, s)[1]),
    "tendonlimitfrc": Kind(1, "s", lambda here, _: here.stop),
    "framepos": Kind(3, "q", lambda here, s: _pose(here, s).translation),
    "framequat": Kind(4, "q", _quaternion),
    "framexaxis": Kind(3, "q", lambda here, s: _pose(here, s).rotation[:, 0]),
    "frameyaxis": Kind(3, "q", lambda here, s: _pose(here, s).rotation[:, 1]),
    "framezaxis": Kind(3, "q", lambda here, s: _pose(here, s).rotation[:, 2]),
    "framelinvel": Kind(3, "v", lambda here, s: _velocity(here, s)[0]),
    "frameangvel": Kind(3, "v", lambda here, s: _velocity(here, s)[1]),
    "framelinacc": Kind(3, "a", lambda here, s: here.acceleration(_spot(s))[0]),
    "frameangacc": Kind(3, "a", lambda here, s: here.acceleration(_spot(s))[1]),
    "accelerometer": Kind(3, "a", lambda here, s: _own(here, s, here.acceleration(_spot(s))[0])),
    "velocimeter": Kind(3, "v", lambda here, s: _own(here, s, here.velocity(_spot(s))[0])),
    "gyro": Kind(3, "v", lambda here, s: _own(here, s, here.velocity(_spot(s))[1])),
    "magnetometer": Kind(3, "q", lambda here, s: _own(here, s, np.array(s.numbers))),
    "subtreecom": Kind(3, "q", lambda here, s: here.centre(_branch(s))[1]),
    "subtreelinvel": Kind(3, "v", _drifting),
    "subtreeangmom": Kind(3, "v", _spinning),
    "force": Kind(3, "f", lambda here, s: _carried(here, s)[0]),
    "torque": Kind(3, "f", lambda here, s: _carried(here, s)[1]),
    "e_potential": Kind(1, "q", _potential),
    "e_kinetic": Kind(1, "v", lambda here, _: here.mechanism.energies(here.q, here.v)[0]),
    "clock": Kind(1, "q", lambda here, _: here.t),
}
"""By MJCF's names; another one is one more entry."""
