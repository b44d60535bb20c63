"""A mechanism as an .rgcp file, which robust_gcp.h opens without Python."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..checks import listed, shown
from ..dynamics.problem import initial_value_problem
from ..errors import ModelError, OptionError, SimulationError
from ..kernel.description import describe
from ..kernel.loop_arrays import NotNativeError
from ..kernel.path_arrays import drives_in_kernel
from ..kernel.simulation.batch import bridging
from ..kernel.structures import Arrays, Exported, ExportedChart
from ..maps.cluster.options import LAST_RESORT, USUAL
from ..maps.explicit import Counters
from ..maps.regular_path import RegularPath
from ..mechanism.mechanism import Mechanism
from ..simulation.runs.coordinates import Coordinates
from ..simulation.runs.initial_state import rest_of
from .image import Image


def described(mechanism: Mechanism, charts: Sequence[Sequence[str]] = ()) -> bytes:
    """The bytes of an .rgcp file.

    Parameters
    ----------
    mechanism : Mechanism
    charts : sequence of sequence of str
        Further independent joints, that a motion changes to where those named turn back.

    Raises
    ------
    ModelError
        For what the compiled kernel does not do alone, by name, and charts that are none.
    """
    require_compiled(mechanism)
    named = listed(charts, "charts", "lists of independent joints", OptionError, (list, tuple))
    several = [mechanism, *(in_chart(mechanism, names) for names in named)]
    ranges = [a.ctrl_range or (-np.inf, np.inf) for a in mechanism.actuators]
    root = Arrays(Exported(charts=len(several), controls=len(mechanism.actuators), zone=USUAL.zone))
    root.another("bridging", bridging(USUAL, LAST_RESORT))
    root.structures("chart", [_chart(each, mechanism) for each in several])
    root.reals(ranges=np.array(ranges, dtype=float).ravel())
    root.text("joints", mechanism.joint_names)
    root.text("actuators", [actuator.name for actuator in mechanism.actuators])
    return bytes(Image(root))


def identifier(text: str) -> str:
    """A name in C that is like the text; compilers and units take no letters beyond ASCII for granted."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return name if name[:1].isalpha() else f"m{name}"


def in_chart(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """The mechanism in other independent joints."""
    try:
        found = mechanism.with_independent(names)
    except ModelError as error:
        raise ModelError(f"charts: {shown(names)} cannot be independent: {error}") from error
    if found.m != mechanism.m:
        told = f"{found.m} velocities, of {mechanism.m} that are independent"
        raise ModelError(f"charts: {shown(names)} are {told}")
    return found


def require_compiled(mechanism: Mechanism) -> None:
    """Refuse what the compiled kernel does not do alone.

    Raises
    ------
    ModelError
    """
    own = None if mechanism.applied is None else mechanism.applied.own
    reasons = {
        "forces of your own, which are Python": own is not None,
        "stops and friction of its file (load it without limits=, friction=)": bool(mechanism.parts),
        "joints that move the ground, free there (load it without moving=)": bool(mechanism.moved),
        "paths of actuators that only Python knows": not drives_in_kernel(mechanism),
        "actuators with activations": any(a.dynamics != "none" for a in mechanism.actuators),
    }
    for what, present in reasons.items():
        if present:
            raise ModelError(f"{mechanism.name or 'the mechanism'} cannot be exported: it has {what}")


def _chart(mechanism: Mechanism, named: Mechanism) -> Arrays:
    watch = Coordinates(mechanism, named.independent, Counters()).watch
    chart = Arrays(ExportedChart(limit=watch.limit))
    chart.another("description", _description(mechanism))
    chart.reals(sizes=watch.sizes, uneven=watch.uneven)
    return chart


def _description(mechanism: Mechanism) -> Arrays:
    rest = rest_of(mechanism)
    try:
        if rest.nc == len(rest.iv_dependent):
            path = RegularPath(rest, np.arange(rest.nc), Counters())
        else:  # redundant rows: those that serve at home
            path = initial_value_problem(mechanism, None, None).start.path
        return describe(mechanism, path, False)
    except NotNativeError as error:
        raise ModelError(f"{mechanism.name or 'the mechanism'} cannot be exported: it has {error}") from error
    except SimulationError as error:
        raise ModelError(
            f"{mechanism.name or 'the mechanism'} cannot be exported: rows of φ are redundant, and which "
            f"of them serve is not known at home: {error}"
        ) from error
