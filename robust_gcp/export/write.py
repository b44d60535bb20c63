"""`Mechanism.export`: by the suffix of the path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..checks import check_positive, path_given, shown
from ..errors import ModelError, OptionError
from ..mechanism.mechanism import Mechanism
from ..simulation.trajectories.archive import write_whole
from .description import described


def export(
    mechanism: Mechanism, path: str | Path, charts: Sequence[Sequence[str]], step: float, fmi: int
) -> Path:
    """See `Mechanism.export`."""
    place = path_given("path", path)
    check_positive("step", step)
    if fmi not in (2, 3):
        raise OptionError(f"fmi = {shown(fmi)}: units for co-simulation are of version 2 or 3")
    if place.suffix == ".rgcp":
        data = described(mechanism, charts)
    elif place.suffix == ".fmu":
        from .fmu import unit

        data = unit(mechanism, charts, float(step), fmi)
    elif place.suffix in (".c", ".h"):
        from .tables import header_and_code

        if charts:
            raise OptionError(
                f"charts = {shown(charts)} do not go with {place.suffix}: tables have one coordinate"
            )
        for suffix, text in header_and_code(mechanism, place.stem).items():
            _written(place.with_suffix(suffix), text.encode())
        return place
    else:
        what = f"the suffix {place.suffix}" if place.suffix else "a path without a suffix"
        raise ModelError(f"export: {what} is unknown; there are .rgcp, .fmu and .c")
    return _written(place, data)


def _written(place: Path, data: bytes) -> Path:
    """The path, with these bytes."""
    try:
        return write_whole(place, lambda file: file.write(data))
    except OptionError as error:
        raise ModelError(str(error)) from error
