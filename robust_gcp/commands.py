"""What the subcommands `simulate`, `analyse` and `models` do, and how all commands print."""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .analysis import local
from .analysis.local import LocalAnalysis
from .drawing.figures.style import require_file
from .drawing.replay.replay import replay, require_page
from .dynamics.linearise import StabilityWarning
from .errors import OptionError, SimulationError, SingularStartError
from .maps.classical import SingularityWarning
from .mechanism.folders.loader import load, model_names, models_folder
from .mechanism.folders.yaml_text import parsed_yaml
from .mechanism.joints import Component, components_of, in_v
from .mechanism.mechanism import Mechanism
from .simulation.coarse import CoarseStepWarning
from .simulation.simulate import simulate as run_simulation
from .simulation.trajectory import Trajectory

OURS = (SingularityWarning, StabilityWarning, CoarseStepWarning)

LONGEST_TABLE = 12
"""Rows of a printed table; the rest is counted, and is in the CSV."""

# --------------------------------------------------------------------------- printing


def complain(message: str) -> None:
    """Print one line on stderr."""
    print(f"robust_gcp: {message}", file=sys.stderr)


def table(header: Sequence[str], rows: Sequence[Sequence[str]], longest: int = LONGEST_TABLE) -> str:
    """Set rows in indented columns; a long table ends with a count of the rest.

    A column whose header begins with a space is aligned to the right, others to the left.
    """
    columns = zip(header, *rows[:longest], strict=True)
    set_columns = []
    for column in columns:
        width = max(map(len, column))
        right = column[0].startswith(" ")
        set_columns.append([c.rjust(width) if right else c.ljust(width) for c in column])
    lines = ["  " + "  ".join(line).rstrip() for line in zip(*set_columns, strict=True)]
    if len(rows) > longest:
        lines.append(f"  … and {len(rows) - longest} more")
    return "\n".join(lines)


def fixed(value: float, digits: int = 8) -> str:
    """Write fixed digits; what rounds to zero has no sign."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def listed(values: Iterable[float], digits: int = 8) -> str:
    """Write (a, b, …), as short as the digits allow."""
    return "(" + ", ".join(f"{round(float(x), digits) + 0.0:.{digits}g}" for x in values) + ")"


@contextmanager
def clean_warnings() -> Iterator[None]:
    """Show this package's warnings as one line each on stderr, others as Python does."""
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            for kind in OURS:
                warnings.simplefilter("always", kind)
            yield
    finally:
        for w in caught:
            if issubclass(w.category, OURS):
                complain(f"warning: {w.message}")
            else:
                warnings.showwarning(w.message, w.category, w.filename, w.lineno)


@contextmanager
def progress_bar(duration: float, what: str) -> Iterator[Callable[[float], None] | None]:
    """Offer a bar over simulated seconds, or a count, on stderr; None where that is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    shape = "{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} [{elapsed}<{remaining}]"
    with tqdm(total=duration, desc=what, bar_format=shape, leave=False, delay=0.5) as bar:
        yield lambda fraction: bar.update(fraction * duration - bar.n)


# --------------------------------------------------------------------------- simulate


def simulate(args: argparse.Namespace) -> int:
    """Simulate, summarise on stdout, write what was asked for."""
    mechanism = load(args.model)
    csv: Path | None = args.out
    if csv is not None and csv.suffix != ".csv":
        csv = csv / f"{mechanism.name}_{args.method}.csv"
    if args.plot is not None:
        require_file(args.plot)
    if args.replay is not None:
        require_page(args.replay)
    q0 = mechanism.home if args.q0 is None else args.q0
    mode = None if args.mode is None else _mode(mechanism, q0, args.mode)
    if csv is not None:
        csv.parent.mkdir(parents=True, exist_ok=True)
    stop: SimulationError | None = None
    with clean_warnings(), progress_bar(args.duration, mechanism.name) as progress:
        try:
            trajectory = run_simulation(
                mechanism,
                q0,
                args.v0,
                args.duration,
                args.step,
                args.method,
                args.stepper,
                record=args.record,
                mode=mode,
                rtol=args.rtol,
                atol=args.atol,
                on_toggle=args.on_toggle,
                newton_start=args.newton_start,
                progress=progress,
            )
        except SimulationError as error:
            if isinstance(error, SingularStartError) and args.mode is None:
                error.args = (f"{error} (here: --mode INDEX)",)
            if error.trajectory is None or len(error.trajectory.t) == 0:
                raise
            trajectory, stop = error.trajectory, error
    tell: Callable[[str], None] = print if stop is None else complain
    if stop is None:
        newton = f", Newton from {args.newton_start}" if args.method == "classical" else ""
        tell(f"{mechanism!r}\nmethod {args.method}{newton}; {args.stepper}, step {args.step:g} s\n")
        tell(summary(trajectory))
    else:
        tell(str(stop))
        tell(f"simulated until t = {trajectory.t[-1]:.6g} s ({len(trajectory.t)} rows)")
    if csv is not None:
        tell(f"wrote {trajectory.to_csv(csv)}")
    if args.plot is not None:
        trajectory.plot(("q", "v"), args.plot)
        tell(f"drew {args.plot}")
    if args.replay is not None:
        tell(f"wrote {replay(trajectory, args.replay, trails=args.trails)}")
    return 0 if stop is None else 2


def summary(trajectory: Trajectory) -> str:
    """Tell end state, certificates, cost and crossings in lines to print."""
    stats, q, v = trajectory.stats, trajectory.q[-1], trajectory.v[-1]
    state = [
        [
            c.name,
            fixed(q[c.iq]) if c.iq >= 0 else "",
            fixed(v[c.iv]) if c.iv >= 0 else "",
            _units(c),
        ]
        for c in components_of(trajectory.mechanism.joints)
    ]
    figures = {
        "max closure error": f"{trajectory.closure_error().max(initial=0.0):.1e}",
        "max |energy error|": f"{np.abs(trajectory.energy_error()).max(initial=0.0):.1e} J",
        "right-hand sides": str(stats.rhs),
        "wall time": f"{stats.wall_seconds:.3g} s",
        "crossings": str(len(trajectory.crossings) or "none"),
    }
    lines = [
        f"state at t = {trajectory.t[-1]:g} s",
        table(["joint", " q", " v", ""], state),
        "",
        *(f"{name:<20}{value}" for name, value in figures.items()),
    ]
    if trajectory.crossings:
        rows = [
            [f"{c.time:.6f}", " ".join(fixed(y, 6) for y in c.y), c.kind, f"{c.certificate:.1e}"]
            for c in trajectory.crossings
        ]
        lines.append(table(["t [s]", " y", "kind", "certificate"], rows))
    lines += [f"from t = {t:.6g} s: y = {', '.join(names)}" for t, names in stats.repartitions]
    return "\n".join(lines)


def _units(component: Component) -> str:
    """Of what is shown of it: "rad, rad/s" where it has both."""
    if not component.unit:
        return ""
    shown = [component.unit] * (component.iq >= 0) + [f"{component.unit}/s"] * (component.iv >= 0)
    return ", ".join(shown)


def _mode(mechanism: Mechanism, q: ArrayLike, index: int) -> Any:
    modes = local.analyse(mechanism, q).modes
    if not 0 <= index < len(modes):
        raise OptionError(f"--mode {index}: analyse lists {len(modes)} modes at q0, from 0 on")
    return modes[index]


# --------------------------------------------------------------------------- analyse, models


def analyse(args: argparse.Namespace) -> int:
    """Print the local picture."""
    mechanism = load(args.model)
    here = local.analyse(mechanism, mechanism.home if args.q is None else args.q)
    print(_as_json(mechanism, here) if args.json else _as_text(mechanism, here))
    return 0


def _as_json(mechanism: Mechanism, here: LocalAnalysis) -> str:
    picture = {
        "model": mechanism.name,
        "q": here.q.tolist(),
        "K": mechanism.K(here.q).tolist(),
        "kind": here.kind,
        "message": here.message,
        "rank": here.rank,
        "generic_rank": here.generic_rank,
        "differential_dof": here.differential_dof,
        "local_dof": here.local_dof,
        "singular_values": here.singular_values.tolist(),
        "kernel": here.kernel.tolist(),
        "modes": [mode.tolist() for mode in here.modes],
    }
    return json.dumps(picture, indent=2, ensure_ascii=False)


def _as_text(mechanism: Mechanism, here: LocalAnalysis) -> str:
    names = [component.name for component in in_v(mechanism.joints)]
    figures = {
        "kind": here.kind,
        "": here.message,
        "rank of K": f"{here.rank} of {mechanism.nc} rows; generic rank {here.generic_rank}",
        "singular values": f"{listed(here.singular_values, 6)} of K, dimensionless",
        "δ_diff": f"{here.differential_dof}, dimension of the tangent space ker K",
        "δ_loc": f"{here.local_dof}, largest dimension of a mode"
        if here.local_dof is not None
        else "not certified",
    }
    lines = [f"{mechanism!r}", f"q = {listed(here.q)}", ""]
    lines += [f"{name:<17}{value}" for name, value in figures.items()]
    if len(names) <= LONGEST_TABLE:
        rows = [
            [label, *(fixed(x, 4) for x in row)]
            for label, row in zip(mechanism.implicit.labels, mechanism.K(here.q), strict=True)
        ]
        lines += ["", table(["K", *(f" {name}" for name in names)], rows)]
    columns = {f" kernel {i}": vector for i, vector in enumerate(here.kernel.T)}
    for i, mode in enumerate(here.modes):
        vectors = mode.reshape(len(names), -1).T
        for k, vector in enumerate(vectors):
            columns[f" mode {i}" + (f"[{k}]" if len(vectors) > 1 else "")] = vector
    rows = [[n, *(fixed(c[j], 4) for c in columns.values())] for j, n in enumerate(names)]
    return "\n".join([*lines, "", table(["tangents", *columns], rows)])


def models(args: argparse.Namespace) -> int:
    """List the shipped models."""
    rows = []
    for name in model_names():
        mechanism = load(name)
        own = parsed_yaml(models_folder() / name / "robot.yaml").get("robust_gcp") or {}
        about = own.get("description", "")
        closures = [f"{c.frame1} – {c.frame2} ({c.kind})" for c in mechanism.closures]
        columns = (
            (mechanism.joint_names, 4, "joints"),
            (mechanism.independent, 4, "joints"),
            (closures, 1, "closures"),
        )
        cells = (counted(words, len(words) if args.full else most, what) for words, most, what in columns)
        rows.append([name, *cells, about])
    header = ["name", "joints", "independent", "closures", "description"]
    print(table(header, rows, longest=len(rows)))
    return 0


def counted(words: Sequence[str], most: int, what: str) -> str:
    """The words, or how many there are where they are more than `most`."""
    return ", ".join(words) if len(words) <= most else f"{len(words)} {what}"
