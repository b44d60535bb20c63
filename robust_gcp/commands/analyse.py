"""The command `analyse`: the local picture at a configuration."""

from __future__ import annotations

import argparse
import json

from ..analysis.local import LocalAnalysis
from ..analysis.local import analyse as analysis_at
from ..arguments import NUMBERS, Arguments, number
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import in_v
from ..printing import LONGEST_TABLE, fixed, listed, say, table
from .model import add_model, loaded


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    text = f"{NUMBERS}; default: the model's home"
    add_to.add("--q", nargs="+", type=number, metavar="Q", help=text)
    add_to.add("--json", action="store_true", help="print JSON, all digits")


def run(args: argparse.Namespace) -> int:
    """Print the local picture."""
    mechanism = loaded(args)
    here = analysis_at(mechanism, mechanism.home if args.q is None else args.q)
    say(_as_json(mechanism, here) if args.json else _as_text(mechanism, here))
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
