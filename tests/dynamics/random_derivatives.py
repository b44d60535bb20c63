"""Derivatives of random mechanisms beside toggles of their coordinates, against differences in others.

`python -m tests.dynamics.random_derivatives --count 1000 --seed 0` prints what failed, by seed; the test of the
same name takes a few.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.maps.cluster.chart import best, smallest

from ..native.random_links import anywhere, carry

Array = NDArray[np.float64]

BASES = (pin.JointModelFreeFlyer, pin.JointModelPlanar, pin.JointModelSpherical)
AWAY = (1e-1, 1e-2, 1e-3, 1e-4)
"""From a toggle, dimensionless along the motion."""

EIGHTH = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""Central differences of order 8: Σ w_k (f(kh) − f(−kh)) / h."""


def mechanism_of(seed: int) -> rg.Mechanism:
    """One or two loops of mobility 1 to 4, planar or in space, perhaps tied, perhaps on a moving base."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear[:] = rng.normal(size=3) * rng.choice([0.0, 5.0])

    def link(parent: int, joint: pin.JointModel, name: str, place: pin.SE3) -> int:
        added = int(model.addJoint(parent, joint, place, name))
        carry(model, added, rng)
        return added

    root = link(0, rng.choice(BASES)(), "base", anywhere(rng)) if rng.random() < 0.4 else 0
    planar, m, ends = rng.random() < 0.5, int(rng.integers(1, 5)), [root]
    joints = m + (2 if planar else 3)
    for i in range(joints):
        kind = rng.random()
        if planar:
            place = pin.SE3(np.eye(3), np.array([0.0, *rng.normal(size=2)]))
            joint = pin.JointModelPY() if kind < 0.15 else pin.JointModelRX()
        else:
            place = anywhere(rng)
            joint = pin.JointModelPZ() if kind < 0.15 else pin.JointModelRZ()
            if kind > 0.85 and joints - i >= 3:
                joint = pin.JointModelSpherical()
        ends.append(link(ends[-1], joint, f"j{i}", place))
        if sum(model.joints[j].nv for j in ends[1:]) >= joints:
            break
    other = root
    if len(ends) > 3 and rng.random() < 0.3:  # the second leg stands on the first
        other = ends[1]
    if rng.random() < 0.3:
        other = link(other, pin.JointModelRX() if planar else pin.JointModelRZ(), "leg", pin.SE3(np.eye(3), np.array([0.0, 0.5, 0.3])))
    model.armature = np.where(rng.random(model.nv) < 0.2, rng.uniform(0.0, 1.0, model.nv), 0.0)
    q, data = pin.integrate(model, pin.neutral(model), 0.7 * rng.normal(size=model.nv)), model.createData()
    pin.forwardKinematics(model, data, q)
    closures: list[rg.Closure] = []

    def close(one: int, two: int) -> None:
        c = len(closures)
        there = data.oMi[one] * pin.SE3(np.eye(3), np.array([0.0, *rng.normal(size=2)]))
        for side, joint in (("a", one), ("b", two)):
            place = data.oMi[joint].actInv(there)
            model.addFrame(pin.Frame(f"{side}{c}", joint, place, pin.FrameType.OP_FRAME))
        closures.append(rg.PointClosure(f"a{c}", f"b{c}"))

    close(ends[-1], other)
    hinges = [j for j in ends[1:] if model.joints[j].nq == 1]
    if rng.random() < 0.25 and len(hinges) > 1 and model.nv - (model.joints[1].nv if root else 0) - (2 if planar else 3) > 1:
        one, two = (int(j) for j in rng.choice(hinges, 2, replace=False))
        ratio = float(rng.normal())
        offset = q[model.joints[one].idx_q] - ratio * q[model.joints[two].idx_q]
        closures.append(rg.CouplingClosure(model.names[one], model.names[two], ratio, float(offset)))
    return rg.Mechanism.from_pinocchio(model, closures, "auto", home=q)


@dataclass
class State:
    """A state in coordinates that are close to a toggle, and those that are good there."""

    good: rg.Mechanism
    poor: rg.Mechanism
    q: Array
    v: Array
    tau: Array


def tangent(mech: rg.Mechanism, q: Array) -> Array:
    return np.linalg.qr(mech.G(q) / mech.units[:, None])[0]


def moved(mech: rg.Mechanism, q: Array, eta: Array) -> Array:
    """The closed configuration whose independent velocities were η along their own."""
    return mech.polish(mech.tree.integrate(q, mech.G(q) @ eta), mech.iv_dependent)


def at_best(mech: rg.Mechanism, q: Array) -> rg.Mechanism:
    """In the components that serve best at q."""
    names = [name for name, _ in components(mech)]
    T = tangent(mech, q)
    return mech.with_independent([names[i] for i in best(T)])


def components(mech: rg.Mechanism) -> list[tuple[str, int]]:
    from robust_gcp.mechanism.joints import in_v

    return [(each.name, i) for i, each in enumerate(in_v(mech.joints))]


def state_of(seed: int) -> State | None:
    """A state at a distance of `AWAY` from where chosen coordinates turn back, or anywhere if they do not."""
    rng = np.random.default_rng([seed, 1])
    mech = mechanism_of(seed)
    q = mech.home
    names = [name for name, _ in components(mech)]
    tied = [i for c in mech.clusters for i in c.iv]
    free = [i for i in range(mech.nv) if i not in tied]
    # random coordinates that determine the motion
    T = tangent(mech, q)
    for _ in range(30):
        chosen = np.sort(np.concatenate([free, rng.choice(tied, mech.m - len(free), replace=False)])).astype(int)
        if smallest(T, chosen) > 1e-3:
            break
    else:
        return None
    way = rng.normal(size=mech.m)

    def sign(q: Array) -> float:
        T = mech.G(q) / mech.units[:, None]
        return float(np.linalg.det(T[chosen]) / np.sqrt(np.linalg.det(T.T @ T)))

    here, before = at_best(mech, q), q
    direction = mech.G(q) @ way
    mech = here
    stride = 0.05
    u = direction / np.linalg.norm(direction / mech.units)
    found = False
    for _ in range(120):
        mech = at_best(mech, q)
        basis = mech.G(q)
        scaled = basis / mech.units[:, None]
        coefficients = np.linalg.lstsq(scaled, u / mech.units, rcond=None)[0]
        u = basis @ coefficients
        u /= np.linalg.norm(u / mech.units)
        new = mech.tree.integrate(q, stride * u)
        try:
            new = mech.polish(new, mech.iv_dependent)
            if mech.closure_residual(new) > 1e-11:
                break
        except rg.RobustGcpError:
            break
        if sign(new) * sign(q) < 0:
            found = True
            break
        q = new
    if found:
        def along(s: float) -> Array:
            return mech.polish(mech.tree.integrate(q, s * u), mech.iv_dependent)

        low, high = 0.0, stride
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if sign(along(middle)) * sign(q) > 0 else (low, middle)
        away = float(rng.choice(AWAY)) * rng.choice([-1, 1])
        q = along(low + away)
    good = at_best(mech, q)
    poor = good.with_independent([names[i] for i in chosen])
    w = rng.normal(size=good.m)
    v = good.G(q) @ w
    return State(good, poor, q, v / np.abs(v / good.units).max(), rng.normal(size=good.nv))


def accelerations(mech: rg.Mechanism, q: Array, v: Array, tau: Array) -> Array:
    """a of M a + C = τ + Kᵀ λ, K a = −k, by the whole system."""
    G = mech.G(q)
    K = mech.K(q)
    model = mech.model
    data = model.createData()
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    C = pin.rnea(model, data, q, v, np.zeros(mech.nv))
    k = mech.k(q, v)
    g = np.zeros(mech.nv)
    d = mech.iv_dependent
    g[d] = np.linalg.lstsq(K[:, d], k, rcond=None)[0]
    udot = np.linalg.solve(G.T @ M @ G, G.T @ (tau - C - M @ g))
    return G @ udot + g


def exact(state: State, h: float) -> tuple[Array, Array, Array]:
    """∂u̇/∂y, ∂u̇/∂u and ∂u̇/∂τ in the poor coordinates, by differences in the good ones."""
    mech, q, v, tau = state.good, state.q, state.v, state.tau
    G, m = mech.G(q), mech.m
    w = v[mech.iv_independent]
    C = state.poor.iv_independent

    def difference(f):
        return sum(c * (f(k * h) - f(-k * h)) for k, c in enumerate(EIGHTH, 1)) / h

    def both(eta: Array, du: Array, dtau: Array) -> Array:
        at = moved(mech, q, eta) if eta.any() else q
        speed = mech.G(at) @ (w + du)
        return np.concatenate([speed[C], accelerations(mech, at, speed, tau + dtau)[C]])

    zero, none = np.zeros(m), np.zeros(mech.nv)
    unit = mech.units[mech.iv_independent]
    by_eta = np.array([difference(lambda s, e=e, u=u: both(s * u * e, zero, none)) / u for e, u in zip(np.eye(m), unit)]).T
    by_w = np.array([both(zero, e, none) - both(zero, -e, none) for e in np.eye(m)]).T / 2  # a is quadratic
    by_tau = np.array([both(zero, zero, e) - both(zero, zero, -e) for e in np.eye(mech.nv)]).T / 2
    W = np.linalg.inv(G[C])
    dw = -W @ by_eta[:m] @ W  # u held
    return by_eta[m:] @ W + by_w[m:] @ dw, by_w[m:] @ W, by_tau[m:]


def off(found: Array, wanted: Array) -> float:
    return float(np.abs(found - wanted).max() / max(np.abs(wanted).max(), 1.0))


def judged(seed: int) -> tuple[str, str]:
    """What came of a seed: a kind and words."""
    try:
        state = state_of(seed)
    except rg.RobustGcpError as error:
        return "no mechanism", f"{type(error).__name__}: {error}"
    if state is None:
        return "no coordinates", ""
    try:
        udot = rg.forward_dynamics(state.poor, state.q, state.v, state.tau)
    except rg.RobustGcpError as error:
        return "no forward dynamics", f"{type(error).__name__}: {error}"
    sigma = smallest(tangent(state.good, state.q), state.poor.iv_independent)
    K = state.good.scaled(state.good.K(state.q))
    s = np.linalg.svd(K, compute_uv=False)
    words = f"m={state.poor.m} share={sigma:.1e} K={s[s > 1e-10 * s[0]].min() / s[0]:.1e}"
    two = [exact(state, h) for h in (2e-2, 1e-2)]
    sure = [off(a, b) for a, b in zip(*two, strict=True)]
    try:
        d = rg.derivatives(state.poor, state.q, state.v, state.tau)
    except rg.RobustGcpError as error:
        return "refused", f"{words} sure={max(sure):.0e} {type(error).__name__}: {error}"
    errors = [off(a, b) for a, b in zip((d.da_dy, d.da_dv, d.da_dtau), two[1], strict=True)]
    u = off(d.udot, udot)
    bad = [e for e, s in zip(errors, sure, strict=True) if e > max(1e-9, 3.0 * s)]
    return ("wrong" if bad or u > 1e-9 else "right"), f"{words} errors={errors} sure={sure} u={u:.1e}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    for seed in range(given.seed, given.seed + given.count):
        kind, words = judged(seed)
        counts[kind] += 1
        if kind in ("refused", "wrong"):
            print(seed, kind, words)
    print(dict(counts))
    return int(counts["wrong"] + counts["refused"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
