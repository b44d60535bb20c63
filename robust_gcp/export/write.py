"""`Mechanism.export`: by the suffix of the path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..checks import path_given
from ..errors import ModelError
from ..mechanism.mechanism import Mechanism
from .description import described

Writer = Callable[..., bytes]


def export(mechanism: Mechanism, path: str | Path, charts: Sequence[Sequence[str]] = ()) -> Path:
    """See `Mechanism.export`."""
    place = path_given("path", path)
    if place.suffix != ".rgcp":
        raise ModelError(f"export: {place.suffix or 'no suffix'} is unknown; there are .rgcp")
    data: Any = described(mechanism, charts)
    try:
        place.write_bytes(data)
    except OSError as error:
        raise ModelError(f"{place} cannot be written: {error}") from error
    return place
