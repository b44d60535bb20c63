"""What a picture of a motion shows: panels, and the columns of the trajectory that are their lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...checks import hint, names_given, shown
from ...errors import OptionError
from ...mechanism.actuation.paths import FixedTendon, Path, TurningJoint
from ...mechanism.actuation.site_paths import SiteForce
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import Component, components_of
from ...simulation.trajectories.access import SENSOR
from ...simulation.trajectories.reactions import row_names
from ...simulation.trajectories.trajectory import Trajectory

RECORDED = {
    "a": "accelerations were",
    "tau": "torques and forces were",
    "multipliers": "constraint forces were",
}
"""Panels of what `simulate` records when asked to."""

PANELS = ("q", "v", *RECORDED, "drive", "energy", "closure")
"""What can be drawn besides single columns, from above."""

MANY = 20
"""Numbers of a mechanism beyond which only the independent ones are drawn, unless joints are named."""

JOINTS = ("q", "v", "a", "tau", "drive")
"""Beginnings of columns that go on with the name of a joint's number."""

LAMBDA = "λ"
"""Quantity of constraint forces, whose names are long."""

Asked = Sequence[str] | str | None


class Line(NamedTuple):
    """One number of every run: its name in the legend, and its column."""

    name: str
    column: str


class Panel(NamedTuple):
    """One quantity in one unit; no lines: one error over time."""

    quantity: str
    unit: str
    lines: tuple[Line, ...] = ()


Runs = Mapping[str, Trajectory]
"""By label; the first one decides what is drawn."""


def units(mechanism: Mechanism, parts: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Quantity and unit of each column that a trajectory may have, with those of its stops and the like."""
    found = {"t": ("t", "s")} | {name: (name, "J") for name in ("energy", "work", "dissipated")}
    for c in components_of(mechanism.joints):
        unit = c.unit or "1"
        if c.iq >= 0:
            found[f"q.{c.name}"] = ("q", unit)
        if c.iv >= 0:
            force = "N" if c.unit == "m" else "N m"
            found |= {f"v.{c.name}": ("v", f"{unit}/s"), f"a.{c.name}": ("a", f"{unit}/s²")}
            found |= {f"tau.{c.name}": ("τ", force), f"drive.{c.name}": ("drive", force)}
    lengths = mechanism.implicit.is_length
    for name, length in zip(row_names(mechanism), lengths, strict=True):
        found[f"lambda.{name}"] = (LAMBDA, "N" if length else "N m")
    by_joint = {c.name: c.unit for c in components_of(mechanism.joints) if c.iq >= 0}
    for name in parts:
        quantity, _, joint = name.partition(".")
        first = max((own for own in by_joint if f"{joint}-".startswith(f"{own}-")), key=len)
        found[name] = (quantity, "N" if by_joint[first] == "m" else "N m")
    for actuator in mechanism.actuators:
        found[f"actuator.{actuator.name}"] = ("actuator", _units_along(actuator.along, by_joint)[1])
        if actuator.dynamics != "none":
            found[f"activation.{actuator.name}"] = ("activation", "1")
    for name, path in mechanism.tendons.items():
        found[f"tendon.{name}"] = ("tendon", _units_along(path, by_joint)[0])
    return found


def _units_along(path: Path, by_joint: Mapping[str, str]) -> tuple[str, str]:
    """Of a path's length and of a force along it."""
    turns = False
    if isinstance(path, FixedTendon):
        turns = "rad" in {by_joint[joint] for joint in path.joints}
        if turns and any(abs(value) != 1.0 for value in path.coefficients.values()):
            return "m or rad", "N or N m"  # coefficients are m/rad or pure numbers
    elif isinstance(path, SiteForce | TurningJoint):
        turns = len(path.gear) == 3 or not any(path.gear[:3])
    return ("rad", "N m") if turns else ("m", "N")


def panels_of(runs: Runs, what: Asked, joints: Asked, over: str | None = None) -> tuple[list[Panel], str]:
    """The panels asked for, one for each unit, and what the legend says where they show some of many.

    Left out, `what` is all for which there is something to see. "energy" is the error of the energy, but
    beside single columns, or over another one than time (`over`), the column of that name.

    Raises
    ------
    OptionError
        For what is neither a quantity nor a column, or is not there in one of the runs.
    """
    first = next(iter(runs.values()))
    components, title = _components(first.mechanism, joints)
    if what is None:
        words = [word for word in PANELS if _is_shown(runs, word)]
    else:
        words = [what] if isinstance(what, str) else names_given("what", what)
    if not words:
        raise OptionError(f"what is empty; use some of {', '.join(PANELS)}, or columns such as v.joint")
    quantities = [word for word in PANELS if word in words]
    if over is not None or len(quantities) < len(set(words)):
        quantities = [word for word in quantities if word != "energy"]
    drawn = [_lines_of_quantity(runs, word, components, joints) for word in quantities]
    if what is None:
        drawn = [[line for line in lines if _acts(first, line)] for lines in drawn]
    elif "drive" in quantities and not drawn[quantities.index("drive")]:
        raise OptionError(
            'what = "drive": no joint that is drawn is driven; simulate with drive={joint: Motion}'
        )
    columns = dict.fromkeys(word for word in words if word not in quantities)
    drawn.append([line for word in columns for line in lines_of_column(first, word)])
    for run in runs.values():
        there = run.columns()
        for line in (line for lines in drawn for line in lines):
            if line.column and line.column not in there:
                lines_of_column(run, line.column, "overlay")
    known = units(first.mechanism, first.part_names)
    panels = [panel for lines in drawn for panel in _by_unit(lines, known)]
    return panels, title


def lines_of_column(run: Trajectory, name: str, argument: str = "what") -> list[Line]:
    """What `run[name]` answers: one number, or those of a joint that has several."""
    columns = run.columns()
    owned = {joint.name: joint.components for joint in run.mechanism.joints}
    letter, _, joint = ("q", "", name) if name in owned else name.partition(".")
    names = [name, f"q.{name}"]
    if letter in JOINTS and joint in owned:
        names = [f"{letter}.{component.name}" for component in owned[joint]]
        names = [each for each in names if each in columns] or [name]
    found = [each for each in names if each in columns]
    if name in columns or not found:
        try:
            if name.startswith(SENSOR) and name not in columns:
                raise OptionError("sensors are not drawn: draw run[…] over run.t by Matplotlib")
            run[name]
        except OptionError as error:
            quantities = f"; quantities are {', '.join(PANELS)}" if argument == "what" else ""
            raise OptionError(f"{argument} = {shown(name)} is unknown{quantities}; {error}") from error
        found = [name]
    return [Line(short_name(each), each) for each in found]


def known_names(mechanism: Mechanism) -> list[str]:
    """Whatever may be drawn of a motion, recorded or not."""
    from ...simulation.phases.rows import columns_of  # pictures of other motions need not load it

    columns = list(units(mechanism, columns_of(mechanism.parts)))
    joints = [joint.name for joint in mechanism.joints]
    short = [short_name(name) for name in columns if name.startswith("q.")]
    whole = [f"{letter}.{joint}" for letter in JOINTS for joint in joints]
    return list(dict.fromkeys([*joints, *PANELS, *short, *columns, *whole]))


def short_name(column: str) -> str:
    """Of a column in a legend, where its quantity stands at the axis."""
    quantity, _, rest = column.partition(".")
    return rest if quantity in (*JOINTS, "lambda") and rest else column


def _is_shown(runs: Runs, word: str) -> bool:
    """Whether there is something to see without being asked for it."""
    first = next(iter(runs.values()))
    if word == "closure":
        return first.mechanism.nc > 0
    if word == "energy":
        return all(run.energy is not None for run in runs.values())
    if word == "multipliers":  # for the asking: their labels are long
        return False
    return all(_has(run, word) for run in runs.values())


def _acts(run: Trajectory, line: Line) -> bool:
    """Whether there is more to see than a torque that is none."""
    return not line.column.startswith("tau.") or bool(run.columns()[line.column].any())


def _has(run: Trajectory, word: str) -> bool:
    beginning = "lambda." if word == "multipliers" else f"{word}."
    return any(name.startswith(beginning) for name in run.columns())


def _lines_of_quantity(runs: Runs, word: str, components: Sequence[Component], joints: Asked) -> list[Line]:
    """The lines of one word; an error has a single one without a column."""
    first = next(iter(runs.values()))
    columns = first.columns()
    if word in ("energy", "closure"):
        return [Line(word, "")]
    if word == "multipliers" and first.mechanism.nc == 0:
        raise OptionError('what = "multipliers": a mechanism without loops has no constraint forces')
    if word in RECORDED and not all(_has(run, word) for run in runs.values()):
        remedy = f'not recorded; simulate with record=("{word}",)'
        raise OptionError(f'what = "{word}": {RECORDED[word]} {remedy}')
    if word == "multipliers":
        names = [name for name in columns if name.startswith("lambda.")]
    elif word == "drive" and joints is None:
        names = [name for name in columns if name.startswith("drive.")]
    else:
        names = [f"{word}.{c.name}" for c in components]
    return [Line(short_name(name), name) for name in names if name in columns]


def _by_unit(lines: Sequence[Line], known: Mapping[str, tuple[str, str]]) -> list[Panel]:
    groups: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        groups.setdefault(known[line.column] if line.column else (line.name, ""), []).append(line)
    return [
        Panel(quantity, unit, tuple(line for line in group if line.column))
        for (quantity, unit), group in groups.items()
    ]


def _components(mechanism: Mechanism, joints: Asked) -> tuple[list[Component], str]:
    """The numbers to draw, and what the legend says where they are some of many."""
    every = components_of(mechanism.joints)
    if (isinstance(joints, str) and joints == "all") or (joints is None and len(every) <= MANY):
        return every, ""
    if joints is None:
        asked = list(mechanism.independent)
        title = f"independent of {len(mechanism.joints)} joints"
    else:
        asked, title = [joints] if isinstance(joints, str) else names_given("joints", joints), ""
    owned = {joint.name: joint.components for joint in mechanism.joints}
    owned |= {component.name: (component,) for component in every if component.name not in owned}
    unknown = [name for name in asked if name not in owned]
    if unknown or not asked:
        names = [joint.name for joint in mechanism.joints]
        raise OptionError(
            f"joints = {asked!r}: {'name some of' if not asked else f'no {unknown[0]!r} among'} the joints "
            f'{", ".join(names)}{hint(unknown[0], owned) if unknown else ""}, or "all"'
        )
    wanted = {component for name in asked for component in owned[name]}
    return [component for component in every if component in wanted], title
