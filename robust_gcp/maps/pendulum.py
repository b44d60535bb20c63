"""The exact pendulum, which the parallelogram mode of a four-bar is too: in Jacobi's elliptic functions."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import OptionError
from ..mechanism.tree.tree import Array

Triple = tuple[Array, Array, Array]
PI = math.pi


def parallelogram_pendulum(
    l1: float, l3: float, m1: float, m2: float, m3: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Give A (kg m²) and B (N m) of A ÿ = −B cos y for a parallelogram of uniform slender rods.

    A = m1 l1²/3 + m2 l1² + m3 l3²/3, B = (m1 l1/2 + m2 l1 + m3 l3/2) gravity; lengths in m, masses
    in kg, gravity along −y in m/s². Source: docs/method.md.
    """
    moment = (m1 * l1 / 2.0 + m2 * l1 + m3 * l3 / 2.0) * gravity
    return m1 * l1**2 / 3.0 + m2 * l1**2 + m3 * l3**2 / 3.0, moment


def pendulum(t: ArrayLike, y0: float, ydot0: float, A: float, B: float) -> Triple:
    """Exact solution of A ÿ = −B cos y, y(0) = y0, ẏ(0) = ẏ0.

    θ = y + (π/2) sign B, ω² = |B|/A, m = sin²(θ0/2) + (ẏ0/2ω)². Swing, m < 1: sin(θ/2) = √m sn and
    ẏ = 2ω √m cn of ωt + u0; turn, m ≥ 1: θ/2 = am, ẏ = ±2ω √m dn of √m ωt + u0, parameter 1/m.
    1 − m = (cos(θ0/2) − |ẏ0|/2ω)(cos(θ0/2) + |ẏ0|/2ω) is used as such: near m = 1 the result is as
    good as its data. No float is upright at rest: it falls, after about 37/ω.
    Source: DLMF 22.19(i); 19.25.5 for u0; Bulirsch 1965 for sn, cn, dn.

    Parameters
    ----------
    t : array_like
        Times, s, of any shape and sign.
    y0, ydot0, A, B : float
        Start, rad, rad/s; inertia, kg m² (OptionError if A ≤ 0); moment, N m, of any sign.

    Returns
    -------
    y, ydot, yddot : ndarray, shape of t
        rad (unwrapped, through any number of turns), rad/s, rad/s².
    """
    if not (A > 0.0 and all(math.isfinite(x) for x in (y0, ydot0, A, B))):
        raise OptionError(f"pendulum needs A > 0 and finite values, got {(y0, ydot0, A, B)}")
    time = np.asarray(t, dtype=float)
    b, omega = math.copysign(1.0, B), math.sqrt(abs(B) / A)
    theta0 = math.atan2(b * math.cos(y0), -b * math.sin(y0))
    down = round((y0 + 0.5 * b * PI - theta0) / (2.0 * PI)) * 2.0 * PI - 0.5 * b * PI
    short = abs(math.atan2(math.cos(y0), b * math.sin(y0)))  # π − |θ0|, exact near upright
    sine, cosine = math.sin(0.5 * theta0), math.sin(0.5 * short)
    rate = ydot0 / (2.0 * omega) if omega else math.inf
    k = math.hypot(sine, rate)
    if k in (0.0, math.inf):  # hangs at rest, or no moment
        return y0 + ydot0 * time, np.full_like(time, ydot0), np.zeros_like(time)
    rest = (cosine - abs(rate)) * (cosine + abs(rate))  # 1 − m
    if rest > 0.0:
        _, sn, cn, dn = _jacobi(omega * time + _first_kind(sine / k, rate / k, rest), rest)
        angle = 2.0 * np.arctan2(k * sn, dn)
        return down + angle, 2.0 * k * omega * cn, -2.0 * omega**2 * k * sn * dn
    turn, m1 = math.copysign(1.0, rate), abs(rest) / k**2  # parameter above 1: DLMF 22.17
    half, sn, cn, dn = _jacobi(k * omega * time + _first_kind(turn * sine, cosine, m1), m1)
    return down + 2.0 * turn * half, 2.0 * k * omega * turn * dn, -2.0 * omega**2 * turn * sn * cn


def _first_kind(sine: float, cosine: float, m1: float) -> float:
    """F(φ | 1 − m1) for φ = atan2(sine, cosine); DLMF 19.25.5."""
    value = sine * float(scipy.special.elliprf(cosine**2, cosine**2 + m1 * sine**2, 1.0))
    return value if cosine >= 0.0 else math.copysign(2.0 * float(scipy.special.ellipkm1(m1)), sine) - value


def _jacobi(u: Array, m1: float) -> tuple[Array, Array, Array, Array]:
    """Amplitude (unwrapped), sn, cn, dn of u for the parameter 1 − m1, 0 ≤ m1 ≤ 1.

    Bulirsch's Landen recursion on √m1, u brought into [−K, K]. `scipy.special.ellipj` takes m,
    which near 1 has lost the digits that decide the period.
    """
    if m1 == 0.0:
        sech = 1.0 / np.cosh(np.clip(u, -700.0, 700.0))
        return 2.0 * np.arctan(np.tanh(0.5 * u)), np.tanh(u), sech, sech
    period = 2.0 * float(scipy.special.ellipkm1(m1))
    count = np.round(u / period)  # sn, cn change sign each 2 K: far times lose no digits to the recursion
    u = u - count * period
    u = np.where(np.abs(u) < 1e-60, 1e-60, u)  # its cotangent squared must not overflow
    means = [(1.0, math.sqrt(m1))]
    while abs(means[-1][0] - means[-1][1]) > 1e-8 * means[-1][0]:  # the next agree to 1e-17
        a, b = means[-1]
        means.append((0.5 * (a + b), math.sqrt(a * b)))
    c = 0.5 * sum(means[-1])
    cot = np.cos(c * u) / np.sin(c * u)
    ratio, dn = c * cot, np.ones_like(u)
    for a, b in reversed(means):
        cot, ratio = cot * ratio, ratio * dn
        dn = (b + cot) / (a + cot)
        cot = ratio / a
    sn = np.copysign(1.0 / np.hypot(1.0, ratio), u)
    cn, sign = np.abs(ratio * sn), 1.0 - 2.0 * np.mod(count, 2.0)
    return np.arctan2(sn, cn) + PI * count, sign * sn, sign * cn, dn
