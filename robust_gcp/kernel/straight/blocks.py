"""What is written out of a mechanism; and K_d, block by block, by cofactors as small.h has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..loop_arrays import NotNativeError
from ..path_arrays import MUSCLE
from ..structures import Arrays
from .tracing import Tape, Traced, total

REVOLUTE, PRISMATIC = 0, 1
"""As in joints.h."""

LARGEST_BLOCK = 3
"""Rows that are solved by cofactors."""

MOST = 40
"""Velocities above which the code would take longer to compile than it saves."""


@dataclass(frozen=True)
class Numbers:
    """The kernel's description of a mechanism, by name."""

    structure: Any
    arrays: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.arrays[name]


def described(arrays: Arrays) -> Numbers:
    """What can be written out.

    Raises
    ------
    NotNativeError
        Where it has what these lines do not know.
    """
    d, kept = arrays.structure, arrays._kept
    sound = {
        "joints other than revolute and prismatic ones": all(
            kind in (REVOLUTE, PRISMATIC) for kind in kept["kind"]
        ),
        "rows of φ other than of positions along axes": all(axis >= 0 for axis in kept["row_axis"]),
        "couplings": d.couplings == 0,
        "point springs or tendons in space": d.lines == 0 and len(kept["stretch_at"]) == 0,
        "muscles, or actuators that share a range": _plain_pulls(kept["pull_at"].reshape(-1, 4)),
        "rows of φ to spare": not d.redundant,
        "prescribed joints": d.driven == 0,
        "too many joints": d.nv <= MOST and d.m > 0,
        "loops that are solved at once": bool(np.all(np.diff(kept["block_start"]) <= LARGEST_BLOCK)),
    }
    for what, good in sound.items():
        if not good:
            raise NotNativeError(what)
    return Numbers(d, kept)


def _plain_pulls(pulls: Any) -> bool:
    """Whether all are springs and affine laws, each for itself."""
    return bool(np.all((pulls[:, 1] != MUSCLE) & (pulls[:, 3] < 0)))


class Blocks:
    """K_d, block by block, by cofactors as small.h has them."""

    def __init__(self, tape: Tape, numbers: Numbers, K: list[list[Traced]]) -> None:
        self.K, self._tape, self._numbers = K, tape, numbers
        self.blocks: list[tuple[list[int], list[int], list[list[Traced]], list[list[Traced]], Traced]] = []
        self.dets: list[Traced] = []
        for b in range(numbers.structure.blocks):
            at = slice(int(numbers["block_start"][b]), int(numbers["block_start"][b + 1]))
            rows, columns = numbers["block_rows"][at].tolist(), numbers["block_columns"][at].tolist()
            own = [[K[r][j] for j in columns] for r in rows]
            adjugate, det = adjugate_of(tape, own)
            self.dets.append(det)
            self.blocks.append((rows, columns, own, adjugate, tape.constant(1.0) / det))

    def solve(self, right: list[Traced]) -> dict[int, Traced]:
        """x of the dependent velocities with K_d x = right, by velocity."""
        x: dict[int, Traced] = {}
        for rows, columns, _, adjugate, inverse in self.blocks:
            # block lower triangular: only joints of earlier blocks are in these rows besides
            f = [right[r] - total([self.K[r][j] * known for j, known in x.items()]) for r in rows]
            found = [total([a * b for a, b in zip(row, f, strict=True)]) * inverse for row in adjugate]
            x |= dict(zip(columns, found, strict=True))
        return x

    def rconds(self) -> list[Traced]:
        """The conditioning of each block, as small.h has it."""
        tape, found = self._tape, list[Traced]()
        pairs = zip(self.blocks, self.dets, self._numbers["reference"].tolist(), strict=True)
        for (_, _, own, adjugate, inverse), det, reference in pairs:
            if len(own) == 1:
                # of a column whose largest norm is 1
                found.append(det.absolute().or_smaller(tape.constant(1.0)))
            elif len(own) == 2:
                s = total([x * x for row in own for x in row])
                # σ_min/σ_max: |det| = σ₁σ₂, s = σ₁² + σ₂²; rounding may leave a square below zero
                inner = (s * s - det * det * 4.0).or_larger(tape.constant(0.0))
                found.append(det.absolute() * 2.0 / (s + inner.root()).or_larger(tape.constant(1e-300)))
            else:
                # as LAPACK's reciprocal condition number, against the one of generic configurations
                stretch = norm(own) * norm(adjugate) * inverse.absolute() * float(reference)
                found.append((tape.constant(1.0) / stretch).or_smaller(tape.constant(1.0)))
        return found


def norm(rows: list[list[Traced]]) -> Traced:
    """‖A‖₁."""
    sums = [total([row[j].absolute() for row in rows]) for j in range(len(rows))]
    most = sums[0]
    for other in sums[1:]:
        most = most.or_larger(other)
    return most


def adjugate_of(tape: Tape, a: list[list[Traced]]) -> tuple[list[list[Traced]], Traced]:
    """adj A, with A⁻¹ = adj A / det A; and det A."""
    if len(a) == 1:
        return [[tape.constant(1.0)]], a[0][0]
    if len(a) == 2:
        adjugate = [[a[1][1], -a[0][1]], [-a[1][0], a[0][0]]]
        return adjugate, a[0][0] * a[1][1] - a[0][1] * a[1][0]
    adjugate = []
    for i in range(3):
        row = []
        for j in range(3):
            r, s, c, e = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3  # cyclic: no signs
            row.append(a[r][c] * a[s][e] - a[r][e] * a[s][c])
        adjugate.append(row)
    return adjugate, total([a[0][j] * adjugate[j][0] for j in range(3)])
