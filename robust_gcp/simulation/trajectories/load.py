"""`load_trajectory`: what `Trajectory.save` wrote, as a trajectory again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...mechanism.mechanism import Mechanism
from ..runs.stats import Stats
from .archive import reading
from .files import ARRAYS, read_archive
from .trajectory import Trajectory

if TYPE_CHECKING:
    from ..phases.happening import Happening


def load_trajectory(path: str | Path, mechanism: Mechanism | None = None) -> Trajectory:
    """Read what `Trajectory.save` wrote.

    Parameters
    ----------
    path : str or Path
        Open files from people you trust: the model in it is read by Pinocchio, which trusts it too.
    mechanism : Mechanism, optional
        Taken instead of the stored one, after a check that inertias, loops and forces agree at the start;
        for files whose model this version of Pinocchio cannot read.

    Raises
    ------
    MissingFileError
        Where there is no such file; a FileNotFoundError too.
    OptionError
        For another kind of file, a damaged one, or a mechanism that is not the one that moved.
    """
    mechanism, arrays, crossings, stats, ended_by, acted, parts = read_archive(path, mechanism)
    with reading(Path(path)):
        changes = [(float(t), tuple(map(str, names))) for t, names in stats.pop("repartitions")]
        refined = [(float(t0), float(t1)) for t0, t1 in stats.pop("refined", [])]  # files of 0.1.0 lack it
        t, q, v = (arrays[name] for name in ("t", "q", "v"))
        read = Stats(**stats, repartitions=changes, refined=refined)
        found = Trajectory(mechanism, t, q, v, crossings=crossings, stats=read)
        for name in ARRAYS[3:]:
            setattr(found, name, arrays.get(name))
        for k in range(sum(name.startswith("t_event_") for name in arrays)):
            found.t_events.append(arrays[f"t_event_{k}"])
            found.q_events.append(arrays[f"q_event_{k}"])
            found.v_events.append(arrays[f"v_event_{k}"])
        found.part_names = tuple(map(str, parts.get("names", ())))
        if parts.get("happenings"):
            found.happenings = _happenings(parts["happenings"])
        found.ended_by, found.acted = None if ended_by is None else int(ended_by), acted
    return found


def _happenings(rows: list[Any]) -> list[Happening]:
    from ..phases.happening import Happening

    return [
        Happening(float(t), str(kind), tuple(map(str, joints)), float(loss)) for t, kind, joints, loss in rows
    ]
