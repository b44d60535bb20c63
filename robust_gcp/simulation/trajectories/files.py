"""Trajectories as files: tables for other programs, and .npz archives that are read back to the last digit.

An archive is plain arrays and one JSON text; nothing in it is pickled, nothing is executed. The spanning tree
is stored as Pinocchio's own archive text, whose reader trusts what it reads: open files of people you trust.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ...checks import path_given, shown
from ...dynamics.equations import does_work
from ...errors import OptionError, missing_extra
from ...maps.explicit import Crossing
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .acted import Acted
from .archive import read_arrays, reading, write_whole
from .stored_mechanism import mechanism_as_plain, mechanism_from

if TYPE_CHECKING:
    from pandas import DataFrame

FORMAT = "robust_gcp trajectory 1"

ARRAYS = (
    *("t", "q", "v", "a", "energy", "multipliers", "work", "drive_torque", "tau", "dissipated"),
    *("part_forces", "u"),
)
"""What a trajectory holds, one row a time; the first three always."""

SAME = 1e-9
"""Relative difference at the start that two ways to build one mechanism may make."""

MEANING = {"check_M": "inertias are", "check_K": "loops are", "check_force": "gravity or forces are"}


def write_csv(columns: Mapping[str, Array | list[Any]], path: str | Path) -> Path:
    """Write the columns, row by row, every digit kept; returns the path."""

    def fill(file: io.BufferedWriter) -> None:
        with io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True) as text:
            writer = csv.writer(text)
            writer.writerow(columns)
            values = [c.tolist() if isinstance(c, np.ndarray) else c for c in columns.values()]
            writer.writerows(zip(*values, strict=True))

    return write_whole(path_given("path", path), fill)


def data_frame(columns: Mapping[str, Array | list[Any]], index: str) -> DataFrame:
    """The columns as a pandas.DataFrame, one of them as its index.

    Raises
    ------
    MissingExtraError
        When pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise missing_extra("to_dataframe needs pandas", "pandas", "data") from error
    values = dict(columns)
    rows = pandas.Index(values.pop(index), name=index)
    return pandas.DataFrame(values, index=rows, copy=True)


def write_archive(
    path: str | Path, mechanism: Mechanism, arrays: Mapping[str, Array | None], crossings: Sequence[Crossing],
    stats: Mapping[str, Any], ended_by: int | None, acted: Acted | None, parts: Mapping[str, Any],
) -> Path:  # fmt: skip
    """Write a trajectory; see `Trajectory.save`."""
    path = path_given("path", path)
    if path.suffix != ".npz":
        raise OptionError(f"{path}: give a name that ends in .npz")
    model = np.frombuffer(mechanism.own_model.saveToString().encode(), dtype=np.uint8)
    meta = {
        "format": FORMAT,
        "pinocchio": pin.__version__,
        "digest": hashlib.sha256(model.tobytes()).hexdigest(),
        "crossings": [c.kind for c in crossings],
        "stats": stats,
        "ended_by": ended_by,
        "parts": parts,
        "acted": None if acted is None else acted.told(),
        **mechanism_as_plain(mechanism),
    }
    arrays = {**arrays, **({} if acted is None else acted.arrays())}
    kept: dict[str, Any] = {name: values for name, values in arrays.items() if values is not None}
    kept |= {
        f"crossing_{field.name}": np.array([_number(getattr(c, field.name)) for c in crossings])
        for field in fields(Crossing)
        if field.name != "kind"
    }
    text = np.frombuffer(json.dumps(meta, ensure_ascii=False).encode(), dtype=np.uint8)
    kept |= _fingerprint(mechanism, kept["q"], kept["v"])
    return write_whole(path, lambda file: np.savez(file, meta=text, model=model, home=mechanism.home, **kept))


def _number(value: Any) -> Any:
    """A crossing's cluster as a number where it has none."""
    return -1 if value is None else value


def read_archive(
    path: str | Path, mechanism: Mechanism | None
) -> tuple[
    Mechanism, dict[str, Array], list[Crossing], dict[str, Any], int | None, Acted | None, dict[str, Any]
]:
    """What `write_archive` was given; the mechanism is rebuilt unless one is given.

    Raises
    ------
    OptionError
        For another kind of file, a damaged one, or a mechanism that is not the stored one.
    """
    path = path_given("path", path)
    arrays = read_arrays(path)
    try:
        meta = json.loads(arrays.pop("meta").tobytes())
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{path} is not a trajectory that save wrote, or is damaged") from error
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise OptionError(f"{path}: not in the format {FORMAT!r}; write it with this version's save")
    with reading(path):
        model, home = arrays.pop("model"), arrays.pop("home")
        if mechanism is None:
            mechanism = mechanism_from(path, meta, model.tobytes(), home)
        arrays.setdefault("crossing_order", np.ones(len(meta["crossings"]), int))  # files of 0.1.0 have none
        places = [arrays.pop(f"crossing_{f.name}") for f in fields(Crossing) if f.name != "kind"]
        crossings = [
            Crossing(
                float(when),
                y,
                q,
                kind,
                float(certificate),
                float(transversality),
                int(cluster) if cluster >= 0 else None,
                int(corank),
                int(order),
            )
            for kind, when, y, q, certificate, transversality, cluster, corank, order in zip(
                meta["crossings"], *places, strict=True
            )
        ]
        _require_rows(arrays)
        _require_same(path, mechanism, arrays)
        if any((c.q.shape, c.y.ndim) != ((mechanism.nq,), 1) for c in crossings):
            raise ValueError("a crossing has another number of coordinates")
        acted = _acted(meta, mechanism, arrays)
        parts = dict(meta.get("parts", {}))  # of stops, friction and locks; files of 0.1.0 have none
        return mechanism, arrays, crossings, dict(meta["stats"]), meta.get("ended_by"), acted, parts


def _require_rows(arrays: Mapping[str, Array]) -> None:
    """A ValueError for arrays of different lengths or without columns, or times that do not increase."""
    t, rows = arrays["t"], {name: arrays[name] for name in ARRAYS if name in arrays}
    if t.ndim != 1 or not np.all(np.diff(t) > 0.0):
        raise ValueError("the times do not increase")
    for name, values in rows.items():
        flat = name in ("t", "energy", "work", "dissipated")
        if values.ndim != (1 if flat else 2) or len(values) != len(t) or values.dtype != np.float64:
            raise ValueError(f"{name} has the shape {values.shape} at {len(t)} times")


def _acted(meta: dict[str, Any], mechanism: Mechanism, arrays: dict[str, Array]) -> Acted | None:
    """What acted; files of 0.1.0 tell of it by the work that it did."""
    torque, held = arrays.pop("acted_torque", None), arrays.pop("acted_held", None)
    told = meta.get("acted")
    if told is None:
        return Acted(lost=True, pushed=True) if "work" in arrays and not does_work(mechanism, None) else None
    lost = bool(told["lost"])
    pushed = bool(told.get("pushed", lost))  # files of 0.2.0 do not tell
    return Acted(torque, held=held, drive=tuple(told["drive"]), lost=lost, pushed=pushed)


def _fingerprint(mechanism: Mechanism, q: Array, v: Array) -> dict[str, Array]:
    """M, K and the force without acceleration at the first time, which another mechanism does not share."""
    if not len(q):
        return {}
    tree = mechanism.tree
    force = tree.rnea(q[0], v[0], tree.zero).copy()
    if mechanism.applied is not None:
        force -= mechanism.applied.tau(q[0], v[0])
    return {"check_M": np.triu(tree.crba(q[0])), "check_K": mechanism.K(q[0]), "check_force": force}


def _require_same(path: Path, mechanism: Mechanism, arrays: dict[str, Array]) -> None:
    q, v = arrays["q"], arrays["v"]
    sizes = (q.shape[1], v.shape[1])
    if sizes != (mechanism.nq, mechanism.nv):
        raise OptionError(
            f"{path} holds a motion with (nq, nv) = {sizes}; {shown(mechanism)} has "
            f"({mechanism.nq}, {mechanism.nv})"
        )
    for name, value in _fingerprint(mechanism, q, v).items():
        stored = arrays.pop(name)
        scale = float(np.abs(stored).max(initial=0.0))
        if value.shape != stored.shape or np.abs(value - stored).max(initial=0.0) > SAME * scale:
            raise OptionError(
                f"{path}: {MEANING[name]} at the start not those of {shown(mechanism)}, so the motion is "
                "another mechanism's"
            )
