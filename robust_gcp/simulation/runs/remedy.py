"""What helps where a run stops at a toggle, which depends on how it was asked for."""

from __future__ import annotations

from ...dynamics.prescribed.drive import Drive
from ...errors import ToggleError


def add_remedy(error: Exception, drive: Drive | None, may_change: bool) -> None:
    """Add to a ToggleError, whose trajectory is known, what helps.

    Parameters
    ----------
    error : Exception
        Others are left as they are.
    drive : Drive or None
        A driven joint stays independent, so that no change of coordinates helps.
    may_change : bool
        Whether coordinates would be changed if `on_toggle` were left out.
    """
    if not isinstance(error, ToggleError) or error.trajectory is None:
        return
    run = error.trajectory
    if drive is not None and len(run.t):
        t, moving = float(run.t[-1]), " and ".join(drive.names)
        rates = zip(drive.names, drive.at(t)[1].tolist(), strict=True)
        where = ", ".join(f"{name} = {run[name][-1]:.9g} at {rate:.3g} a second" for name, rate in rates)
        error.args = (
            f"{error}; the drive takes {moving} there after t = {t:.6g} s ({where}), and no motion of the "
            "others goes further: give a motion that turns before, or drive another joint that can",
        )
    elif drive is None and may_change:
        error.args = (
            f'{error} (or leave out on_toggle: by default, "repartition", coordinates are changed)',
        )
