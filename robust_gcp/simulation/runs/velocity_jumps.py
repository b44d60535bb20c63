"""A warning where a prescribed motion jumps in its velocity."""

from __future__ import annotations

from ...dynamics.prescribed.drive import Drive
from ...mechanism.tree import Array
from ...warning import warn


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
