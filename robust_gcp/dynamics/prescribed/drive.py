"""Some independent joints that move as prescribed: what they are told, and where that has kinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...checks import shown
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn
from .motion import Motion

KINK = 1e-6
"""Jump of ṗ, as a share of the largest, that is told."""


class Drive:
    """The prescribed motions of some independent joints.

    Parameters
    ----------
    mechanism : Mechanism
        Whose independent joints include the driven ones.
    motions : mapping of str to Motion
    start : float
        When they begin, s.

    Attributes
    ----------
    names : tuple of str
    motions : dict of str to Motion
    driven, free : ndarray of int
        Which entries of y are prescribed, in the order of `names`, and which are not.
    """

    def __init__(self, mechanism: Mechanism, motions: Mapping[str, Motion], start: float = 0.0) -> None:
        self.names, self.start = tuple(motions), start
        order = mechanism.iv_independent.tolist()
        self.driven: NDArray[np.int64] = np.array(
            [order.index(mechanism.joint(name).idx_v) for name in motions], dtype=np.int64
        )
        self.free: NDArray[np.int64] = np.setdiff1d(np.arange(mechanism.m), self.driven)
        self.motions = dict(motions)
        self._motions = list(motions.values())

    def motion_at(self, t: float) -> tuple[Array, Array, Array]:
        """y, ẏ and ÿ of the driven joints at time t."""
        p, r, s = np.array([motion.at(t) for motion in self._motions]).T
        return p, r, s

    def stages(self, times: Array, shares: Sequence[float]) -> Array:
        """y, ẏ and ÿ at t + c h of the steps h between times, (n, s, 3, driven); of the last one at c = 0.

        Ends before a step in which a motion cannot be told, which is for the step itself to say.

        Parameters
        ----------
        times : ndarray (n,)
        shares : sequence of float (s,)
            c of the stages, the first 0.
        """
        rows = np.zeros((len(times), len(shares), 3, len(self.names)))
        steps = np.append(np.diff(times), 0.0)
        asked = times[:, None] + np.multiply.outer(steps, np.array(shares))
        try:
            for k, motion in enumerate(self._motions):
                rows[..., k] = motion.over(asked.ravel()).T.reshape(*asked.shape, 3)
            return rows
        except Exception:  # somewhere on the way: see where
            pass
        for i, t in enumerate(times.tolist()):
            h = float(times[i + 1]) - t if i + 1 < len(times) else 0.0
            try:
                for k, share in enumerate(shares if i + 1 < len(times) else shares[:1]):
                    rows[i, k] = self.motion_at(t + share * h)
            except Exception:  # whatever a function of the user's raises
                return rows[:i]
        return rows

    def kink(self, times: Array) -> tuple[str, float, float, float] | None:
        """The driven joint whose velocity jumps between times, when, s, and its velocity before and after.

        None where none does. Looked at is where it changes most beyond what the changes before and after
        would have it.
        """
        if len(times) < 4:
            return None
        for name, motion in zip(self.names, self._motions, strict=True):
            rates = motion.over(times)[1]
            change = np.diff(rates)
            beyond = np.abs(
                change - 0.5 * (np.append(change[1:], change[-2]) + np.append(change[1], change[:-1]))
            )
            i = int(np.argmax(beyond))
            least = KINK * max(1e-300, float(np.abs(rates).max()))
            if beyond[i] > 0.1 * least:  # a jump is beyond by half of it at least
                found = motion.kink(float(times[i]), float(times[i + 1]))
                if found is not None and abs(found[2] - found[1]) > least:
                    return name, *found
        return None


def checked_motions(mechanism: Mechanism, drive: Any, times: Array) -> dict[str, Motion]:
    """What `simulate` was given as drive, or an OptionError that names the culprit."""
    if not isinstance(drive, Mapping) or not drive:
        raise OptionError(f"drive = {shown(drive)} must be {{joint: rg.Motion(position)}}")
    for name, motion in drive.items():
        joint = mechanism.joint(name)
        if not joint.single:
            raise OptionError(
                f"drive: joint {name!r} ({joint.type}) has {joint.nq} numbers in q; only joints with one "
                "number can be driven: replace it by a chain of revolute or prismatic joints"
            )
        if not isinstance(motion, Motion):
            raise OptionError(f"drive[{name!r}] = {shown(motion)} is no Motion; give rg.Motion(position)")
        motion.require_consistent(name, float(times[0]), float(times[-1]))
    return dict(drive)


class KinkedDriveWarning(RuntimeWarning):
    """A driven joint's velocity jumps, which takes an impulse that no torque of the run has."""


def warned_of_kink(drive: Drive, times: Array) -> bool:
    """Whether a prescribed motion jumps in its velocity between outputs, which is told.

    The work of the impulse is missing in the energies whatever the step is.
    """
    found = drive.kink(times)
    if found is None:
        return False
    name, t, before, after = found
    warn(
        f"drive[{name!r}]: the velocity jumps at t = {t:.6g} s, from {before:.4g} to {after:.4g}: that takes "
        "an impulse, which is in no recorded torque, and free joints do not get it, whatever the step; give "
        "a motion that can be differentiated twice, or split the run there",
        KinkedDriveWarning,
    )
    return True
