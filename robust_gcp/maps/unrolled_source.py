"""Python source for the regular path of one mechanism: φ, K, Newton, G and g over plain floats."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .cut_points import CutPoints, Entries
from .regular_path import CONVERGED, MAX_NEWTON, STAGNANT, RegularPath
from .scalar_code import Lines, Scalar, negative, nested, signed, text


@dataclass(frozen=True)
class _Block:
    """A diagonal block of K_d: rows, velocities, entries row by row, determinant and 1 / that."""

    rows: list[int]
    columns: list[int]
    entries: list[Scalar]
    det: Scalar
    inverse: Scalar


class Generator:
    """Writes the source for one mechanism."""

    def __init__(self, path: RegularPath) -> None:
        self.path, self.out = path, Lines()
        self.points = CutPoints(path, self.out)
        self.scale = self.points.scale.tolist()

    def source(self) -> str:
        """Both functions."""
        return "\n".join([*self._predict(), *nested(self._solve()), ""])

    def _predict(self) -> list[str]:
        """q + G Δy + w c with the new y put in exactly, the size of that step and how far it turns."""
        path, m = self.path, self.path.m
        nv = path.tree.nv
        new = {int(v): f"y{j}" for j, v in enumerate(path.independent)}
        counts = {"q": nv, "G": nv * m, "c": nv, "y": m, "a": m, "s": m}
        lines = [f"def predict({', '.join(counts)}):"]
        lines += [f" {_names(name, count)} = {name}" for name, count in counts.items()]
        lines += [f" d{j} = y{j} - a{j}" for j in range(m)]
        if m == 1:
            lines.append(" w = 0.5 * d0 * d0")
        else:
            lines.append(f" speed = {_sum(f's{j} * s{j}' for j in range(m))}")
            lines.append(f" along = ({_sum(f'd{j} * s{j}' for j in range(m))}) / speed if speed else 0.0")
            lines.append(" w = 0.5 * along * along")
        lines += [f" v{i} = {_sum(f'G{i * m + j} * d{j}' for j in range(m))} + w * c{i}" for i in range(nv)]
        moved = ", ".join(new.get(i, f"q{i} + v{i}") for i in range(nv))
        size, turn = (
            ", ".join(
                f"abs(v{i})" if s == 1.0 else f"abs(v{i} * {s!r})" for i, s in enumerate(scale.tolist())
            )
            for scale in (path._length_scale, path._turn_scale)
        )
        return [*lines, f" return [{moved}], max({size}), max({turn})"]

    def _solve(self) -> list[str]:
        """Newton's method, then G, g and the conditioning: what `close` and `derivatives` do."""
        path, out = self.path, self.out
        nv, m = path.tree.nv, path.m
        dependent = path.dependent.tolist()
        phi = self.points.phi()
        K: Entries = {}
        for row in range(len(phi)):
            K |= self.points.row_of_K(row)
        self._measure(K)
        closing, known = out.lines, dict(out.names)
        out.lines = []
        u = self._substitute(K, phi)
        moves = [f"q{v} -= {text(out.product(self.scale[v], u[v]))}" for v in dependent]
        newton, out.lines = out.lines, []
        out.names = known  # what a Newton step computed is stale after it

        G: list[list[Scalar]] = [[0.0] * m for _ in range(nv)]
        for j, independent in enumerate(path.independent.tolist()):
            G[independent][j] = 1.0
            column = self._substitute(K, [K.get((row, independent), 0.0) for row in range(len(phi))])
            for v in dependent:
                G[v][j] = negative(out.product(self.scale[v], column[v]))
        rates: list[Scalar] = [f"s{j}" for j in range(m)]
        v = [row[0] if m == 1 else out.dot(row, rates) for row in G]
        k = self.points.bias(v)
        g: list[Scalar] = [0.0] * nv
        for i, e in self._substitute(K, k).items():
            g[i] = out.product(self.scale[i], e)
        bend: list[Scalar] = []
        if m == 1:
            square = out.product("s0", "s0")
            g, bend = [out.product(e, square) for e in g], g
        dets, rconds = self._conditioning()
        result = [f"q{i}" for i in range(nv)]
        result += map(text, [*(e for row in G for e in row), *g, *bend, *dets, *rconds])
        worst = f"min({', '.join(map(text, rconds))}, 1.0)"

        steps = [signed(e)[1] for e in u.values()]
        sizes = [f"abs({signed(e)[1]})" for e in phi]
        return [
            "def solve(q, ydot, contracting):",
            f" {_names('q', nv)} = q",
            f" {_names('s', m)} = ydot",
            f" if not isfinite({_sum(f'q{i}' for i in range(nv))}): raise FloatingPointError",
            " last_size = last_step = inf",
            " correction = 0.0",
            f" for i in range({MAX_NEWTON}):",
            *(f"  {line}" for line in closing),
            f"  size = max({', '.join(sizes)}, 0.0)",
            f"  if size <= {CONVERGED!r} or (size <= {STAGNANT!r} and size >= 0.25 * last_size): break",
            *(f"  {line}" for line in newton),
            f"  if not isfinite({_sum(steps)}): raise FloatingPointError",
            f"  step = max({', '.join(f'abs({e})' for e in steps)}, 0.0)",
            "  if i == 0: correction = step",
            f"  elif contracting and step > 0.5 * last_step and size > {STAGNANT!r}:",
            "   return None, 0.0, 0.0, i",
            "  last_size, last_step = size, step",
            *(f"  {line}" for line in moves),
            f" else: return None, 0.0, 0.0, {MAX_NEWTON}",
            *(f" {line}" for line in out.lines),
            f" return [{', '.join(result)}], {worst}, correction, i",
        ]

    # --------------------------------------------------------------------- K_d

    def _measure(self, K: Entries) -> None:
        """Entries, determinant and its inverse of each block of K_d."""
        out, dependent = self.out, self.path.dependent.tolist()
        self.blocks: list[_Block] = []
        for block in self.path.blocks:
            rows, columns = block.rows.tolist(), [dependent[c] for c in block.columns.tolist()]
            entries = [K.get((row, v), 0.0) for row in rows for v in columns]
            det = entries[0]
            if len(rows) == 2:
                a, b, c, d = entries
                det = out.total([out.product(a, d), negative(out.product(b, c))])
            inverse = 1.0 / det if isinstance(det, float) else out.let(f"1.0 / {det}")
            self.blocks.append(_Block(rows, columns, entries, det, inverse))

    def _substitute(self, K: Entries, rhs: list[Scalar]) -> dict[int, Scalar]:
        """K_d⁻¹ rhs by blocks: dimensionless dependent velocities."""
        out, u = self.out, dict[int, Scalar]()
        for block in self.blocks:
            left = [
                out.total([rhs[row], *(negative(out.product(K[row, v], u[v])) for v in u if (row, v) in K)])
                for row in block.rows
            ]
            if len(left) == 1:
                u[block.columns[0]] = out.product(left[0], block.inverse)
                continue
            a, b, c, d = block.entries
            x = out.total([out.product(d, left[0]), negative(out.product(b, left[1]))])
            y = out.total([out.product(a, left[1]), negative(out.product(c, left[0]))])
            u[block.columns[0]], u[block.columns[1]] = (out.product(e, block.inverse) for e in (x, y))
        return u

    def _conditioning(self) -> tuple[list[Scalar], list[Scalar]]:
        """det and rcond of each block as in `BlockFactor`."""
        out, rconds = self.out, list[Scalar]()
        for block in self.blocks:
            size = f"abs({text(block.det)})"
            if len(block.rows) == 1:
                rconds.append(out.let(f"min({size}, 1.0)"))
                continue
            s = text(out.dot(block.entries, block.entries))
            root = out.let(f"sqrt(max({s} * {s} - 4.0 * {text(block.det)} * {text(block.det)}, 0.0))")
            rconds.append(out.let(f"2.0 * {size} / ({s} + {root})"))
        return [block.det for block in self.blocks], rconds


def _names(letter: str, count: int) -> str:
    """Target of an unpacking assignment."""
    return "".join(f"{letter}{i}, " for i in range(count))


def _sum(names: Iterable[str]) -> str:
    return " + ".join(names)
