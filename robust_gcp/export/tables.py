"""A mechanism of one coordinate as C tables: M(y) u̇ + M'(y) u²/2 + D(y) u = Q(y) + τ, for micro-controllers.

Along its mode a mechanism is analytic in y, through singular configurations too: what was a linkage is three
functions of one number there. They are sampled over a period of the mode, and become polynomials on cells.
Where y turns back the number is the mode's arc length s, and τ is multiplied by W = dy/ds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from ..checks import shown
from ..dynamics.prescribed.motion import Motion
from ..errors import ModelError, OptionError, RobustGcpError
from ..mechanism.assembly.assemblies import way_between
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..simulation.simulate import simulate
from .arc_length import by_arc_length
from .description import identifier, require_compiled

DEGREE = 7
CELLS = (32, 64, 128, 256, 512)
POINTS = 4096
"""Samples of a period; half of them have to tell the others."""

TURNS = (1, 2, 3, 4)
"""Turns of y after which a mode may close."""

CLOSED, EXACT = 1e-9, 1e-11
"""What q may be off after a period, rad or m; error of a table, relative to its largest value."""


def header_and_code(mechanism: Mechanism, stem: str) -> dict[str, str]:
    """The texts of stem.h and stem.c, by suffix; along y where it goes all the way round, else by arc length.

    Raises
    ------
    ModelError
        For more than one coordinate, modes that do not close, and what the compiled kernel does not do alone.
    """
    require_compiled(mechanism)
    called = mechanism.name or "the mechanism"
    if mechanism.m != 1 or len(mechanism.numbers) != 1:
        told = f"{called} has y = {', '.join(mechanism.independent)}"
        raise ModelError(f"export: tables are of one coordinate that is a joint's of one freedom; {told}")
    if re.search(r'["\\\n]', stem):
        raise OptionError(f"export: {shown(stem)} cannot be included in C; give a name without quotes")
    name = identifier(stem)
    fill = {"NAME": name, "UPPER": name.upper(), "DEGREE": str(DEGREE), "FILE": stem}
    # a name in a comment must not end it
    fill |= {"CALLED": called.replace("*", "_"), "JOINT": mechanism.independent[0].replace("*", "_")}
    fill["HOME"] = repr(_home(mechanism))
    found = _along(mechanism)
    if found is None:
        period, samples, more = _by_arc(mechanism)
        fill |= more | BY_ARC
    else:
        period, samples = found
        fill |= BY_ANGLE
    table, error = _fitted(samples, called)
    fill |= {"CELLS": str(len(table)), "ROWS": str(samples.shape[1]), "ERROR": f"{error:.0e}"}
    fill |= {"PERIOD": repr(period), "TABLE": ",\n".join(map(_row, table))}
    return {suffix: _filled(text, fill) for suffix, text in ((".h", HEADER), (".c", CODE))}


def _home(mechanism: Mechanism) -> float:
    return float(mechanism.home[mechanism.iq_independent[0]])


def _along(mechanism: Mechanism) -> tuple[float, Array] | None:
    """The mode's period, and M, D and Q at equal steps of y, (POINTS, 3); None where y does not go round."""
    if not mechanism.tree.periodic[mechanism.iv_independent[0]]:
        return None
    joint, y0 = mechanism.independent[0], _home(mechanism)
    for turns in TURNS:
        period = 2.0 * np.pi * turns
        drive = {joint: Motion(lambda t: y0 + t)}  # at unit speed v is G
        try:
            run = simulate(mechanism, duration=period, step=period / POINTS, drive=drive)
        except RobustGcpError:
            return None
        apart = way_between(mechanism, run.q[0], run.q[-1]) * mechanism.units
        off = np.abs(run.v[-1] - run.v[0]).max() / np.abs(run.v).max()  # home may lie on two modes
        if np.abs(apart).max() <= CLOSED and off <= CLOSED:
            return period, _terms_around(mechanism, run.q, run.v)
    return None


def _by_arc(mechanism: Mechanism) -> tuple[float, Array, dict[str, str]]:
    """The mode's length, M, D, Q, W = dy/ds and y without whole turns, (POINTS, 5); and what fills texts."""
    length, q, way = by_arc_length(mechanism, POINTS)
    y = q[:, mechanism.iq_independent[0]] - _home(mechanism)
    turned, share = float(y[-1]), np.arange(POINTS + 1) / POINTS
    pace = way[:, mechanism.iv_independent[0]]
    samples = np.column_stack([_terms_around(mechanism, q, way), pace[:-1], (y - turned * share)[:-1]])
    return length, samples, {"TURNED": repr(2.0 * np.pi * round(turned / (2.0 * np.pi)))}


def _terms_around(mechanism: Mechanism, q: Array, G: Array) -> Array:
    """M, D and Q at all places but the last, (POINTS, 3), which is the first again."""
    terms = np.array(list(_terms(mechanism, q, G)))
    if np.any(np.abs(terms[-1] - terms[0]) > CLOSED * np.abs(terms).max(axis=0)):
        raise ModelError(
            f"export: what acts on {mechanism.name or 'the mechanism'} is another after a turn, as of a "
            "spring at a joint that turns on and on; export .rgcp"
        )
    return terms[:-1]


def _terms(mechanism: Mechanism, q: Array, G: Array) -> Iterator[tuple[float, float, float]]:
    """M = Gᵀ M G, D, and Q = Gᵀ (τ − C) at rest: forces of dampers grow with the velocity."""
    zero, tree, forces = np.zeros(mechanism.nv), mechanism.tree, mechanism.applied
    for here, way in zip(q, G, strict=True):
        inertia = tree.crba(here)
        at_rest = zero if forces is None else forces.tau(here, zero)
        moving = zero if forces is None else forces.tau(here, way)
        pull = float(way @ (at_rest - tree.rnea(here, zero, zero)))
        yield float(way @ inertia @ way), float(way @ (at_rest - moving)), pull


def _fitted(samples: Array, called: str) -> tuple[Array, float]:
    """Polynomials on cells, (cells, rows, DEGREE + 1) by rising power of −1 … 1; and their error."""
    size = np.maximum(np.abs(samples).max(axis=0), 1e-300)  # D is 0 all along without dampers
    wave = np.fft.rfft(samples, axis=0) / len(samples)
    wave[1:] *= 2.0  # of real samples: each with its conjugate
    half = np.fft.rfft(samples[::2], axis=0) / (len(samples) // 2)
    half[1:] *= 2.0
    kept = len(half) - 1
    # what half the samples do not hold, and what of it they take for lower waves
    missed = np.abs(wave[kept:]).sum(axis=0) + np.abs(wave[:kept] - half[:kept]).sum(axis=0)
    if (missed / size).max() > EXACT:
        raise ModelError(f"export: the mode of {called} has turns too sharp for tables; export .rgcp")
    wave[np.abs(wave / size).max(axis=1) < 1e-16] = 0.0  # rounding, which would only take time
    # Chebyshev's: through even ones of this degree it errs most at the ends of a cell
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    between = np.linspace(-1.0, 1.0, 5)
    for cells in CELLS:
        table, worst = np.zeros((cells, samples.shape[1], DEGREE + 1)), 0.0
        for cell in range(cells):
            values = _series(wave, (cell + 0.5 + 0.5 * nodes) / cells)
            table[cell] = polynomial.polyfit(nodes, values, DEGREE).T  # through all of them
            found = polynomial.polyval(between, table[cell].T).T
            off = np.abs(found - _series(wave, (cell + 0.5 + 0.5 * between) / cells)) / size
            worst = max(worst, float(off.max()))
        if worst <= EXACT:
            return table, worst
    told = f"{CELLS[-1]} cells do not suffice for tables of {called} to {EXACT:g}"
    raise ModelError(f"export: {told}; export .rgcp")


def _series(wave: NDArray[np.complex128], at: Array) -> Array:
    """The Fourier series at shares of the period."""
    k = np.flatnonzero(np.abs(wave).max(axis=1))
    found: Array = (np.exp(2j * np.pi * np.outer(at, k)) @ wave[k]).real
    return found


def _row(cell: Array) -> str:
    return "    {" + ",\n     ".join("{" + ", ".join(map(repr, row.tolist())) + "}" for row in cell) + "}"


def _filled(text: str, fill: dict[str, str]) -> str:
    for _ in range(2):  # what fills it has places of its own
        for name, value in fill.items():
            text = text.replace(f"@{name}@", value)
    return text


HEADER = """/* @WHAT@ Tables along the mode of home, right to @ERROR@
 * of the largest value in each, through singular configurations; the period is @PERIOD@. */
#ifndef @UPPER@_H
#define @UPPER@_H

#define @UPPER@_HOME @HOME@

double @NAME@_acceleration(double @S@, double u, double tau);            /* u' */
void @NAME@_step(double* @S@, double* u, double h, double tau);          /* RK4, the torque held */
@DECLARED@
#endif
"""

CODE = """#include <math.h>

#include "@FILE@.h"

enum { CELLS = @CELLS@, ROWS = @ROWS@, DEGREE = @DEGREE@ };
static const double PERIOD = @PERIOD@;
static const double TABLE[CELLS][ROWS][DEGREE + 1] = {
@TABLE@
};

/* The cell of a place, and where in it, -1 to 1. */
static int cell_of(double @S@, double* at) {
    const double turns = @TURNS@, all = (turns - floor(turns)) * CELLS;
    const int cell = all < CELLS ? (int)all : CELLS - 1;
    *at = 2.0 * (all - cell) - 1.0;
    return cell;
}

double @NAME@_acceleration(double @S@, double u, double tau) {
    double at;
    const int cell = cell_of(@S@, &at);
    const double *m = TABLE[cell][0], *d = TABLE[cell][1], *f = TABLE[cell][2];
    double M = m[DEGREE], slope = 0.0, D = d[DEGREE], Q = f[DEGREE];
    for (int i = DEGREE - 1; i >= 0; --i) {
        slope = slope * at + M;
        M = M * at + m[i];
        D = D * at + d[i];
        Q = Q * at + f[i];
    }
    return (Q + @PULL@ - D * u - slope * (CELLS / PERIOD) * u * u) / M;
}

void @NAME@_step(double* @S@, double* u, double h, double tau) {
    const double v = *u, a = @NAME@_acceleration(*@S@, v, tau), v2 = v + 0.5 * h * a;
    const double b = @NAME@_acceleration(*@S@ + 0.5 * h * v, v2, tau), v3 = v + 0.5 * h * b;
    const double c = @NAME@_acceleration(*@S@ + 0.5 * h * v2, v3, tau), v4 = v + h * c;
    const double e = @NAME@_acceleration(*@S@ + h * v3, v4, tau);
    *@S@ += h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
    *u += h / 6.0 * (a + 2.0 * (b + c) + e);
}
@DEFINED@"""

BY_ANGLE = {
    "WHAT": "@CALLED@ in one coordinate: M(y) u' + M'(y) u^2 / 2 + D(y) u = Q(y) + tau.\n"
    " * y is @JOINT@ (rad), tau its torque (N m).",
    **{"S": "y", "TURNS": "(y - @UPPER@_HOME) / PERIOD", "PULL": "tau", "DECLARED": "", "DEFINED": ""},
}
"""Of the texts where y goes all the way round."""

BY_ARC = {
    "WHAT": "@CALLED@ along its mode: M(s) u' + M'(s) u^2 / 2 + D(s) u = Q(s) + W(s) tau.\n"
    " * s is the way from home, all joints' together in rad and lengths, u = s'; W = dy/ds, where y is\n"
    " * @JOINT@, which turns back on the mode, and tau its torque or force (N m, N).",
    **{"S": "s", "TURNS": "s / PERIOD", "PULL": "@NAME@_rate(s) * tau"},
    "DECLARED": "double @NAME@_joint(double s);                                       /* y */\n"
    "double @NAME@_rate(double s);                                        /* W, of which y' = W u */\n",
    "DEFINED": """
static double row_at(double s, int row) {
    double at;
    const int cell = cell_of(s, &at);
    double value = TABLE[cell][row][DEGREE];
    for (int i = DEGREE - 1; i >= 0; --i) value = value * at + TABLE[cell][row][i];
    return value;
}

double @NAME@_joint(double s) { return @UPPER@_HOME + @TURNED@ * (s / PERIOD) + row_at(s, 4); }

double @NAME@_rate(double s) { return row_at(s, 3); }
""",
}
"""Of the texts where it turns back."""
