"""The result of a simulation, which certifies itself."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...maps.explicit import Crossing
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.stats import Stats
from .access import UNRECORDED, FrameMotion, Named, Sample, frame_motion, recorded_columns
from .acted import Acted, powered_columns
from .files import ARRAYS, data_frame, write_archive, write_csv
from .interpolant import Interpolant, sampled_accelerations, times_within
from .pictures import Pictures
from .reactions import Loaded, Reaction
from .sensing import sensed
from .summary import told

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..phases.happening import Happening
    from ..phases.transitions import Forgotten, Passed


@dataclass(repr=False)
class Trajectory(Named, Pictures):
    """A simulated motion.

    `traj["q1"]` gives a joint's numbers in q, `traj["v.q1"]` those in v, `traj["sensor.imu"]` what a sensor
    of the mechanism's file reads (N + 1, dim); see `Named`.

    Attributes
    ----------
    mechanism : Mechanism
    t, q, v : ndarray (N + 1,), (N + 1, nq), (N + 1, nv)
    a : ndarray (N + 1, nv) or None
        Accelerations, when recorded.
    energy : ndarray (N + 1,) or None
        Kinetic energy plus that of gravity and springs, J, when recorded.
    multipliers : ndarray (N + 1, nc) or None
        Constraint forces λ, N and N m, when recorded; `reactions.row_names` says what each is.
    work : ndarray (N + 1,) or None
        Work done by torques, drives, dampers, elastic stops since the start, J; None without any.
    crossings : list of Crossing
    stats : Stats
    drive_torque : ndarray (N + 1, nv) or None
        What prescribed motions take, N m and N; NaN at joints that are not driven. `traj["drive.q1"]`.
    t_events, q_events, v_events : list of ndarray (k,), (k, nq), (k, nv)
        When each event happened, s, in the order that `simulate` was given them, and the states then.
    ended_by : int or None
        Number of the terminal event that ended the run, whose time is the last in t.
    tau : ndarray (N + 1, nv) or None
        All that acts besides gravity, N m and N, when recorded: torques, wrenches, forces, drives, `joints`.
    happenings : list of Happening
        Of stops, friction and locks (`joints=`): impacts, holds, releases and so on, in the order of time.
    dissipated : ndarray (N + 1,) or None
        Energy lost since the start by impacts, friction and dampers of stops, J.
    part_forces, part_names : ndarray (N + 1, k) or None, tuple of str
        Generalised force of each of `joints`, N m and N: `traj["stop.q3"]`, "friction.q1", "lock.q2".
    u : ndarray (N + 1, n) or None
        Controls of the actuators, or activations where they have some, clipped; None without power.
    passed : Passed or None
        Phases of a run with `joints=`, for its derivatives; files and pickles do not hold them.
    acted : Acted or None
        What it was simulated with: torques, wrenches, what was held over the steps, driven joints.
    """

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array | None = None
    energy: Array | None = None
    multipliers: Array | None = None
    work: Array | None = None
    crossings: list[Crossing] = field(default_factory=list)
    stats: Stats = field(default_factory=Stats)
    drive_torque: Array | None = None
    t_events: list[Array] = field(default_factory=list)
    q_events: list[Array] = field(default_factory=list)
    v_events: list[Array] = field(default_factory=list)
    ended_by: int | None = None
    tau: Array | None = None
    acted: Acted | None = None
    happenings: list[Happening] = field(default_factory=list)
    dissipated: Array | None = None
    part_names: tuple[str, ...] = ()
    part_forces: Array | None = None
    u: Array | None = None
    passed: Passed | Forgotten | None = None

    _absent = UNRECORDED

    @property
    def y(self) -> Array:
        """Independent coordinates, (N + 1, m); a PartitionError where some are on groups."""
        return self.q[:, self.mechanism.iq_independent]

    def closure_error(self) -> Array:
        """max |φ(q)| at each time, (N + 1,), m or rad."""
        return np.array([np.abs(self.mechanism.phi(q)).max(initial=0.0) for q in self.q])

    def velocity_error(self) -> Array:
        """max |K v| at each time, (N + 1,), m/s or rad/s."""
        return np.array(
            [np.abs(self.mechanism.K(q) @ v).max(initial=0.0) for q, v in zip(self.q, self.v, strict=True)]
        )

    def energy_error(self) -> Array:
        """Energy minus its start and the work of torques, drives, dampers, plus `dissipated`, (N + 1,), J."""
        return energy_drift(self._energy, self.work_left)

    @property
    def work_left(self) -> Array | None:
        """Work done less what was dissipated, (N + 1,), J."""
        return self.work if self.work is None or self.dissipated is None else self.work - self.dissipated

    @cached_property
    def _energy(self) -> Array:
        if self.energy is not None:
            return self.energy
        energy = self.mechanism.energy
        return np.array([energy(q, v) for q, v in zip(self.q, self.v, strict=True)])

    # ----------------------------------------------------------------- by name and by time

    def columns(self) -> dict[str, Array]:
        """Every number recorded, (N + 1,) each, by name.

        t, q.…, v.…, a.…, energy, work, dissipated, tau.…, drive.…, lambda.…, stop.…: as they are there.
        The numbers of a joint are called `q.joint` and `v.joint`, or `q.joint.component` where it has
        several, such as `q.ball.qw` and `v.ball.rx`; constraint forces by `reactions.row_names`.
        """
        return self._recorded() | self._powered

    @cached_property
    def _powered(self) -> dict[str, Array]:
        return powered_columns(self.mechanism, self.q, self.v, self.u)

    def _recorded(self) -> dict[str, Array]:
        return recorded_columns(self)

    def accelerations(self) -> Array:
        """The recorded accelerations, (N + 1, nv), or else estimates from q and v.

        Estimates are second derivatives of polynomials through three times, with an error O(step⁴); where
        a torque jumped they are wrong by a share of the jump (record "a" then), and for a run of a single
        time NaN.
        """
        return self._accelerations

    def at(self, t: ArrayLike) -> Sample:
        """The motion at any time, or times, between the first and the last.

        Interpolated with an error O(step⁶) in q and O(step⁵) in v, less than RK4's own; at the output times
        what was recorded, to rounding. The loops are closed to that error, not to rounding. Where
        accelerations were not recorded, see `accelerations`.

        Parameters
        ----------
        t : float or array_like (k,)
            s.

        Returns
        -------
        Sample
            t, q, v, a; `sample["q1"]`, `sample.frame("tip")`.

        Raises
        ------
        OptionError
            For times outside the motion.
        """
        times = times_within(t, self.t)
        q, v, a = Interpolant(self.mechanism.tree, self.t, self.q, self.v, self._accelerations)(
            np.atleast_1d(times)
        )
        if times.ndim == 0:
            q, v, a = q[0], v[0], a[0]
        return Sample(self.mechanism, times, q, v, a)

    def frame(self, name: str) -> FrameMotion:
        """Position, orientation, velocity and acceleration of a frame at all times, in world axes.

        Parameters
        ----------
        name : str
            A frame of the model: a link, a joint, a cut point.

        Raises
        ------
        ModelError
            For a frame that the model does not have.
        """
        return frame_motion(self.mechanism, name, self.q, self.v, self._accelerations)

    def reaction(self, joint: str | int) -> Reaction:
        """Force and moment that a joint transmits, at all times, in world axes.

        In a joint of the tree by the recursive Newton–Euler algorithm, from `accelerations`.

        Parameters
        ----------
        joint : str or int
            Of a loop's cut joint a frame, "frame1-frame2", or its number in `mechanism.closures`; or a joint
            of the tree.

        Raises
        ------
        OptionError
            Where `record` did not hold "multipliers" and there are loops, for a joint that is none, and where
            wrenches acted that a file does not hold.
        """
        return self._loaded.reaction(joint)

    def _sensed(self, name: str) -> Array:
        return sensed(self._loaded, name)

    @property
    def _loaded(self) -> Loaded:
        acted = Acted() if self.acted is None else self.acted
        known = None if acted.pushed else acted.wrenches
        state = self.mechanism, self.t, self.q, self.v, self.accelerations
        forces = () if self.part_forces is None else self.part_forces.T
        stops = dict(zip(self.part_names, forces, strict=False))
        return Loaded(*state, self.multipliers, known, self.u, stops=stops)

    @cached_property
    def _accelerations(self) -> Array:
        if self.a is not None:
            return self.a
        return sampled_accelerations(self.mechanism.tree, self.t, self.q, self.v)

    # ----------------------------------------------------------------- elsewhere

    def to_csv(self, path: str | Path) -> Path:
        """Write `columns`, one row a time, every digit kept; returns the path."""
        return write_csv(self.columns(), path)

    def to_dataframe(self) -> DataFrame:
        """`columns` as a pandas.DataFrame with t as its index; needs pandas."""
        return data_frame(self.columns(), "t")

    def save(self, path: str | Path) -> Path:
        """Write everything to a .npz file, which `load_trajectory` reads back; returns the path.

        Stored: t, q, v and whatever else was recorded, crossings, events, happenings, stats, torques that
        were numbers, and the mechanism (tree, closures, forces, coordinates). Not stored: torque functions,
        but that some acted, classes of your own forces, options of the run, and shapes for replay.
        """
        arrays = {name: getattr(self, name) for name in ARRAYS}
        for what in "tqv":
            found = getattr(self, f"{what}_events")
            arrays |= {f"{what}_event_{k}": values for k, values in enumerate(found)}
        stats, happenings = asdict(self.stats), [list(asdict(x).values()) for x in self.happenings]
        parts = {"names": self.part_names, "happenings": happenings}
        told = self.crossings, stats, self.ended_by, self.acted, parts
        return write_archive(path, self.mechanism, arrays, *told)

    def __repr__(self) -> str:
        """A summary in a few lines."""
        return told(self, [name for name in ARRAYS if getattr(self, name) is not None])


def energy_drift(energy: Array, work: Array | None) -> Array:
    """Energy (N + 1,) minus its start, and minus the work done since, J."""
    drift: Array = energy - energy[:1]
    return drift if work is None else drift - (work - work[:1])
