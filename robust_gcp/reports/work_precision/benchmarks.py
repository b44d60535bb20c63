"""Hand-written equations of three mechanisms of the IFToMM benchmark: Andrews', Bricard's, the flyball.

Parameters and starts are the benchmark's own (A03, A04, A05), typed here once more and not read from the
models, so that a slip in a model shows as an error.
"""

from __future__ import annotations

import numpy as np

from ... import SimulationError
from ...mechanism.tree.tree import Array
from .reduced import GRAVITY, OneDof, Planar, Reduced, Weights

# --------------------------------------------------------------------------- A03, Andrews

ANDREWS_JOINTS = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
"""In the order of the Test Set for IVP Solvers: β, Θ, γ, Φ, δ, Ω, ε."""

ANDREWS_START = np.array([
    -0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885,
    0.487364979543842550, -0.222668390165885885, 1.23054744454982119,
])  # fmt: skip
DRIVE, STIFFNESS, RELAXED = 0.033, 4530.0, 0.07785
"""N m on β, N/m, m."""

FARTHEST = 10.0
"""rad: the crank does not turn farther in one step of any stepper that is near the motion."""

_A, _B, _C = -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
_RR, _D, _SS, _E, _ZT, _ZF, _U = 0.007, 0.028, 0.035, 0.02, 0.04, 0.02, 0.04
_SPRING_ARM = 0.02 - 0.018j

# angles: β, β + Θ, γ, δ, Φ + δ, ε, Ω + ε
_SUMS = ((0,), (0, 1), (2,), (4,), (3, 4), (6,), (5, 6))
_S = np.array([np.eye(7)[[*joints]].sum(axis=0) for joints in _SUMS])
_ARMS = np.array(
    [
        [0.00092, 0, 0, 0, 0, 0, 0],
        [_RR, -0.0115, 0, 0, 0, 0, 0],
        [0, 0, np.hypot(0.01874, 0.01043), 0, 0, 0, 0],
        [0, 0, 0, _ZT, -1j * (_E - 0.01421), 0, 0],
        [0, 0, 0, np.hypot(0.02308, 0.00916), 0, 0, 0],
        [0, 0, 0, 0, 0, -1j * _U, _ZF - 0.01421],
        [0, 0, 0, 0, 0, np.hypot(0.01228, 0.00449), 0],
    ],
    dtype=complex,
)
_MASS = np.array([0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498])
_MOMENT = np.array([2.194e-6, 4.41e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5])
_BODIES = Planar(_S, _ARMS, np.array([0, 1, 2, 4, 3, 6, 5]), _MASS, _MOMENT, up=0.0)

# E by way of K2, less E by way of K3, of K5 and K4, of K7 and K6
_CLOSE = np.array(
    [
        [_RR, -_D, 1j * _SS, 0, 0, 0, 0],
        [_RR, -_D, 0, -_ZT, 1j * _E, 0, 0],
        [_RR, -_D, 0, 0, 0, 1j * _U, -_ZF],
    ],
    dtype=complex,
)
_OPEN = -np.array([_B, _A, _A])


def _pairs(z: np.ndarray) -> Array:
    return np.concatenate([z.real, z.imag])


def _closure(q: Array) -> tuple[Array, Array]:
    """φ (6,), m, and K (6, 7)."""
    e = np.exp(1j * (_S @ q))
    return _pairs(_CLOSE @ e + _OPEN), _pairs((_CLOSE * (1j * e)) @ _S)


def _bias(q: Array, v: Array) -> Array:
    """−K̇ v, (6,)."""
    return _pairs(_CLOSE @ ((_S @ v) ** 2 * np.exp(1j * (_S @ q))))


def _closed(near: Array, beta: float) -> Array:
    """The angles at β, by Newton's method from those near by."""
    q = near.copy()
    q[0] = beta
    for _ in range(20):
        phi, K = _closure(q)
        step = np.linalg.solve(K[:, 1:], phi)
        q[1:] -= step
        if np.abs(step).max() < 1e-9:  # quadratic: the next one is below rounding
            return q
    raise SimulationError(f"Andrews' loops do not close at beta = {beta}")


def _stretch(gamma: float) -> tuple[float, float]:
    """Length of the spring, m, and its derivative by γ."""
    line = _B + _SPRING_ARM * np.exp(1j * gamma) - _C
    along = 1j * _SPRING_ARM * np.exp(1j * gamma)
    length = abs(line)
    return float(length), float((line.conjugate() * along).real / length)


def _placed(order: Array, *values: Array) -> tuple[Array, Array]:
    """q and v with their numbers at these places."""
    q, v = np.empty(len(order)), np.empty(len(order))
    q[order], v[order] = values
    return q, v


def andrews_implicit(order: Array) -> Reduced:
    """All seven angles and the loops' index-1 equations [[M, Kᵀ], [K, 0]] [a; −λ] = [Q − h; k].

    `order` (7,) tells where each of `ANDREWS_JOINTS` stands among the joints of the scene.
    """
    matrix, right = np.zeros((13, 13)), np.zeros(13)

    def rate(t: float, x: Array) -> Array:
        q, v = x[:7], x[7:]
        matrix[:7, :7], h = _BODIES.inertia(q, v)
        _, K = _closure(q)
        matrix[7:, :7], matrix[:7, 7:] = K, K.T
        length, slope = _stretch(q[2])
        right[:7], right[7:] = -h, _bias(q, v)
        right[0] += DRIVE
        right[2] -= STIFFNESS * (length - RELAXED) * slope
        return np.concatenate([v, np.linalg.solve(matrix, right)[:7]])

    def read(x: Array) -> tuple[Array, Array]:
        return _placed(order, x[:7], x[7:])

    return Reduced(np.concatenate([ANDREWS_START, np.zeros(7)]), rate, read)


def andrews_reduced(order: Array) -> Reduced:
    """The crank's angle alone: the six others by Newton's method from the last ones, then ½ m ẏ² + V."""
    last = [ANDREWS_START.copy()]

    def shape(y: float) -> tuple[Array, Array, Array]:
        q = min(last[0], ANDREWS_START, key=lambda known: abs(y - float(known[0])))
        if not abs(y - q[0]) < FARTHEST:
            raise SimulationError(f"Andrews' crank cannot be followed from {q[0]} to {y} rad")
        for target in np.linspace(q[0], y, 2 + int(abs(y - q[0]) / 0.02))[1:]:
            q = _closed(q, float(target))
        last[0] = q
        _, K = _closure(q)
        G = np.concatenate([[1.0], np.linalg.solve(K[:, 1:], -K[:, 0])])
        return q, G, np.concatenate([[0.0], np.linalg.solve(K[:, 1:], _bias(q, G))])

    def weigh(q: Array, G: Array, Gp: Array) -> Weights:
        w = _BODIES.weigh(q, G, Gp)
        length, slope = _stretch(q[2])
        pull = STIFFNESS * (length - RELAXED)
        potential = 0.5 * pull * (length - RELAXED) - DRIVE * float(q[0])
        return w._replace(potential=potential, moment=pull * slope * float(G[2]) - DRIVE)

    def read(x: Array) -> tuple[Array, Array]:
        q, G, _ = shape(float(x[0]))
        return _placed(order, q, G * x[1])

    return Reduced(np.array([ANDREWS_START[0], 0.0]), OneDof(shape, weigh).rate, read)


# --------------------------------------------------------------------------- A04, Bricard

_AXES = (1, 2, 0, 1, 2)
_RODS = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0], [-1.0, 0, 0], [0, 1.0, 0]])


def _turn(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((3, 3))
    R[axis, axis] = 1.0
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def _bricard_shape(x: float) -> tuple[Array, Array, Array]:
    """Every other revolute joint turns alike, (x, z, x, z, x) with sin z = −sin x/(1 + sin x).

    That is the threefold-symmetric Bricard linkage with right-angled twists,
    cos ξ cos ζ + cos ξ + cos ζ = 0, in ξ = x + π/2 and ζ = z + π/2.
    """
    s, c = np.sin(x), np.cos(x)
    sz = -s / (1.0 + s)
    cz = np.sqrt(1.0 - sz * sz)
    first = -c / (1.0 + s) ** 2
    second = (s * (1.0 + s) + 2.0 * c * c) / (1.0 + s) ** 3
    dz = first / cz
    ddz = (second + sz * dz * dz) / cz
    z = np.arcsin(sz)
    return np.array([x, z, x, z, x]), np.array([1.0, dz, 1.0, dz, 1.0]), np.array([0, ddz, 0, ddz, 0])


def _bricard_weights(q: Array, G: Array, Gp: Array) -> Weights:
    """Forward kinematics along the chain at ẏ = 1, ÿ = 0: ½ m' = Σ mass v·a + ω·I α."""
    R = np.eye(3)
    omega, alpha, p, v, a = (np.zeros(3) for _ in range(5))
    inertia = half_slope = potential = moment = 0.0
    for axis, rod, angle, rate, bend in zip(_AXES, _RODS, q, G, Gp, strict=True):
        n = R[:, axis]
        alpha = alpha + n * bend + np.cross(omega, n) * rate
        omega = omega + n * rate
        R = R @ _turn(axis, angle)
        arm = R @ rod
        spin = np.cross(omega, arm)
        bent = np.cross(alpha, arm) + np.cross(omega, spin)
        vc, ac = v + 0.5 * spin, a + 0.5 * bent
        # a slender rod of 1 kg and 1 m: I = (1 − arm armᵀ)/12
        inertia += vc @ vc + (omega @ omega - (omega @ arm) ** 2) / 12.0
        half_slope += vc @ ac + (omega @ alpha - (omega @ arm) * (alpha @ arm)) / 12.0
        potential += GRAVITY * (p + 0.5 * arm)[1]
        moment += GRAVITY * vc[1]
        p, v, a = p + arm, v + spin, a + bent
    return Weights(float(inertia), float(half_slope), float(potential), float(moment))


def bricard() -> OneDof:
    """Bricard's mechanism with slender rods in the angle of its first revolute joint."""
    return OneDof(_bricard_shape, _bricard_weights)


# --------------------------------------------------------------------------- A05, flyball governor

FLYBALL_START = np.array([0.0, np.pi / 6.0, 0.5])
"""Shaft and rods, rad; slider, m."""

OMEGA = 2.0 * np.pi
_M, _CENTRE = 5.3, (0.3 * 0.5 + 5.0) / 5.3
_ROD = 0.3 * (1.0 + 0.01**2) / 12.0 + 0.3 * (_CENTRE - 0.5) ** 2 + 5.0 * (1.0 - _CENTRE) ** 2
_THIN = 0.3 * 2.0 * 0.01**2 / 12.0
_SLIDER, _AXLE = 3.0, 3.0 * 2.0 * 0.1**2 / 12.0 + _THIN
_HINGE = 0.05


def _spin_inertia(alpha: float) -> tuple[float, float]:
    """Moment of inertia about the shaft, kg m², and its derivative by α."""
    c, s = np.cos(alpha), np.sin(alpha)
    reach = _HINGE + _CENTRE * c
    J = _AXLE + 2.0 * (_M * reach**2 + _ROD * c * c + _THIN * s * s)
    return J, 2.0 * (-2.0 * _M * reach * _CENTRE * s + 2.0 * (_THIN - _ROD) * s * c)


def _coupler(alpha: float, s: float, dalpha: float, ds: float) -> tuple[float, float, float]:
    """Force in each spring-damper, N, and derivatives of its length by α and s."""
    x, z = 0.5 * np.cos(alpha), 1.0 - 0.5 * np.sin(alpha) - s
    length = np.hypot(x, z)
    by_alpha = (-x * 0.5 * np.sin(alpha) - z * 0.5 * np.cos(alpha)) / length
    by_s = -z / length
    rate = by_alpha * dalpha + by_s * ds
    return 8e5 * (length - 0.5) + 4e4 * rate, by_alpha, by_s


def flyball(order: Array, conserving: bool) -> Reduced:
    """The symmetric motion in (φ, α, s); `conserving` takes φ̇ from the angular momentum.

    `order` (4,) tells where shaft, both rods and slider stand among the joints of the scene.
    """
    momentum = _spin_inertia(float(FLYBALL_START[1]))[0] * OMEGA
    swing = 2.0 * (_M * _CENTRE**2 + _ROD)

    def rate(t: float, x: Array) -> Array:
        alpha, s, dalpha, ds = x[1], x[2], x[-2], x[-1]
        J, slope = _spin_inertia(alpha)
        spin = momentum / J if conserving else x[3]
        force, by_alpha, by_s = _coupler(alpha, s, dalpha, ds)
        lift = 2.0 * _M * GRAVITY * _CENTRE * np.cos(alpha)
        ddalpha = (0.5 * slope * spin**2 + lift - 2.0 * force * by_alpha) / swing
        dds = -GRAVITY - 2.0 * force * by_s / _SLIDER
        rest = [ddalpha, dds] if conserving else [-slope * dalpha * spin / J, ddalpha, dds]
        return np.array([spin, dalpha, ds, *rest])

    def read(x: Array) -> tuple[Array, Array]:
        spin = momentum / _spin_inertia(x[1])[0] if conserving else x[3]
        return _placed(order, x[[0, 1, 1, 2]], np.array([spin, x[-2], x[-2], x[-1]]))

    speeds = [0.0, 0.0] if conserving else [OMEGA, 0.0, 0.0]
    return Reduced(np.concatenate([FLYBALL_START, speeds]), rate, read)
