"""A mechanism of one coordinate as C tables: M(y) u̇ + M'(y) u²/2 + D(y) u = Q(y) + τ, for micro-controllers.

Along its mode a mechanism is analytic in y, through singular configurations too: what was a linkage is three
functions of one number there. They are sampled over a period of the mode, and become polynomials on cells.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..dynamics.motion import Motion
from ..errors import ModelError, RobustGcpError
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..simulation.simulate import simulate
from .description import require_compiled

DEGREE = 7
CELLS = (32, 64, 128, 256)
POINTS = 2048
"""Samples of a period; half of them have to tell the others."""

TURNS = (1, 2, 3, 4)
"""Turns of y after which a mode may close."""

CLOSED, EXACT = 1e-9, 1e-11
"""What q may be off after a period, rad or m; error of a table, relative to its largest value."""


def header_and_code(mechanism: Mechanism, stem: str) -> dict[str, str]:
    """The texts of stem.h and stem.c, by suffix.

    Raises
    ------
    ModelError
        For more than one coordinate, one that is no hinge's, modes that do not close or on which y turns
        back, and what the compiled kernel does not do alone.
    """
    require_compiled(mechanism)
    called = mechanism.name or "the mechanism"
    hinge = mechanism.tree.periodic[mechanism.iv_independent[0]]
    if mechanism.m != 1 or len(mechanism.numbers) != 1 or not hinge:
        told = f"{called} has y = {', '.join(mechanism.independent)}"
        raise ModelError(f"export: tables are of one coordinate that is a hinge's; {told}")
    period, samples = _along(mechanism, called)
    table, error = _fitted(samples, called)
    name = re.sub(r"\W", "_", stem)
    name = name if name[:1].isalpha() else f"m{name}"
    home = float(mechanism.home[mechanism.iq_independent[0]])
    fill = {"NAME": name, "UPPER": name.upper(), "CELLS": str(len(table)), "DEGREE": str(DEGREE)}
    fill |= {"JOINT": mechanism.independent[0], "CALLED": called, "ERROR": f"{error:.0e}"}
    fill |= {"PERIOD": repr(period), "HOME": repr(home), "TABLE": ",\n".join(map(_row, table))}
    return {suffix: _filled(text, fill) for suffix, text in ((".h", HEADER), (".c", CODE))}


def _along(mechanism: Mechanism, called: str) -> tuple[float, Array]:
    """The mode's period, and M, D and Q at equal steps of it, (POINTS, 3)."""
    joint, y0 = mechanism.independent[0], float(mechanism.home[mechanism.iq_independent[0]])
    for turns in TURNS:
        period = 2.0 * np.pi * turns
        drive = {joint: Motion(lambda t: y0 + t)}
        try:
            run = simulate(mechanism, duration=period, step=period / POINTS, drive=drive)
        except RobustGcpError as error:
            raise ModelError(
                f"export: {called} has no table by {joint}: on the way round {error}; another independent "
                "joint may go all the way round, or export .rgcp"
            ) from error
        apart = run.q[-1] - run.q[0]
        turned = 2.0 * np.pi * np.round(apart / (2.0 * np.pi))
        apart = np.where(mechanism.tree.periodic, apart - turned, apart)
        off = np.abs(run.v[-1] - run.v[0]).max() / np.abs(run.v).max()
        if np.abs(apart).max() <= CLOSED and off <= CLOSED:
            return period, np.array(list(_terms(mechanism, run.q[:-1], run.v[:-1])))
    raise ModelError(f"export: the mode of {called} does not close after {TURNS[-1]} turns of {joint}")


def _terms(mechanism: Mechanism, q: Array, G: Array) -> Iterator[tuple[float, float, float]]:
    """M = Gᵀ M G, D, and Q = Gᵀ (τ − C) at rest: forces of dampers grow with the velocity."""
    zero, tree, forces = np.zeros(mechanism.nv), mechanism.tree, mechanism.applied
    for here, way in zip(q, G, strict=True):
        full = np.triu(tree.crba(here))
        inertia = full + np.triu(full, 1).T
        at_rest = zero if forces is None else forces.tau(here, zero)
        moving = zero if forces is None else forces.tau(here, way)
        pull = float(way @ (at_rest - tree.rnea(here, zero, zero)))
        yield float(way @ inertia @ way), float(way @ (at_rest - moving)), pull


def _fitted(samples: Array, called: str) -> tuple[Array, float]:
    """Polynomials on cells, (cells, 3, DEGREE + 1) by rising power of −1 … 1; and their error."""
    size = np.maximum(np.abs(samples).max(axis=0), 1e-300)
    wave = np.fft.rfft(samples, axis=0) / len(samples)
    wave[1:] *= 2.0
    half = np.fft.rfft(samples[::2], axis=0) / (len(samples) // 2)
    half[1:] *= 2.0
    kept = len(half) - 1
    missed = np.abs(wave[kept:]).sum(axis=0) + np.abs(wave[:kept] - half[:kept]).sum(axis=0)
    if (missed / size).max() > EXACT:
        raise ModelError(f"export: the mode of {called} has turns too sharp for tables; export .rgcp")
    wave[np.abs(wave / size).max(axis=1) < 1e-16] = 0.0
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    between = np.linspace(-1.0, 1.0, 5)
    for cells in CELLS:
        table, worst = np.zeros((cells, 3, DEGREE + 1)), 0.0
        for cell in range(cells):
            values = _series(wave, (cell + 0.5 + 0.5 * nodes) / cells)
            fit = np.polynomial.chebyshev.chebfit(nodes, values, DEGREE)
            for k in range(3):
                power = np.polynomial.chebyshev.cheb2poly(fit[:, k])
                table[cell, k, : len(power)] = power
            found = np.array([np.polynomial.polynomial.polyval(between, table[cell, k]) for k in range(3)]).T
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
    for name, value in fill.items():
        text = text.replace(f"@{name}@", value)
    return text


HEADER = """/* @CALLED@ in one coordinate: M(y) u' + M'(y) u^2 / 2 + D(y) u = Q(y) + tau.
 * y is @JOINT@ (rad), tau its torque (N m). Tables of M, D and Q along the mode of home, right to @ERROR@
 * of the largest value in each, through singular configurations; a period is @PERIOD@ rad. */
#ifndef @UPPER@_H
#define @UPPER@_H

#define @UPPER@_HOME @HOME@

double @NAME@_acceleration(double y, double u, double tau);            /* u' */
void @NAME@_step(double* y, double* u, double h, double tau);          /* RK4, the torque held */

#endif
"""

CODE = """#include <math.h>

#include "@NAME@.h"

enum { CELLS = @CELLS@, DEGREE = @DEGREE@ };
static const double PERIOD = @PERIOD@;
static const double TABLE[CELLS][3][DEGREE + 1] = {
@TABLE@
};

double @NAME@_acceleration(double y, double u, double tau) {
    const double turns = (y - @UPPER@_HOME) / PERIOD, at = (turns - floor(turns)) * CELLS;
    const int cell = at < CELLS ? (int)at : CELLS - 1;
    const double s = 2.0 * (at - cell) - 1.0, *m = TABLE[cell][0], *d = TABLE[cell][1], *f = TABLE[cell][2];
    double M = m[DEGREE], slope = 0.0, D = d[DEGREE], Q = f[DEGREE];
    for (int i = DEGREE - 1; i >= 0; --i) {
        slope = slope * s + M;
        M = M * s + m[i];
        D = D * s + d[i];
        Q = Q * s + f[i];
    }
    return (Q + tau - D * u - slope * (CELLS / PERIOD) * u * u) / M;
}

void @NAME@_step(double* y, double* u, double h, double tau) {
    const double v = *u, a = @NAME@_acceleration(*y, v, tau), v2 = v + 0.5 * h * a;
    const double b = @NAME@_acceleration(*y + 0.5 * h * v, v2, tau), v3 = v + 0.5 * h * b;
    const double c = @NAME@_acceleration(*y + 0.5 * h * v2, v3, tau), v4 = v + h * c;
    const double e = @NAME@_acceleration(*y + h * v3, v4, tau);
    *y += h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
    *u += h / 6.0 * (a + 2.0 * (b + c) + e);
}
"""
