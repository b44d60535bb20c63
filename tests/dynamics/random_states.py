"""Random mechanisms beside toggles of their coordinates and beside singular places, with truth of their own.

`python -m tests.dynamics.random_states --count 1000` holds derivatives and Jacobians of steps against
differences in coordinates that are good there, and prints what failed, by seed.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.cluster.chart import best, smallest
from robust_gcp.mechanism.tree.joints import in_v

from ..kernel.random_links import anywhere, carry

Array = NDArray[np.float64]

BASES = (pin.JointModelFreeFlyer, pin.JointModelPlanar, pin.JointModelSpherical)
AWAY = (1e-1, 1e-2, 1e-3, 1e-4)
"""From a toggle or a singular place, dimensionless along the motion or rad."""

WEIGHTS = {
    2: (1 / 2,),
    4: (2 / 3, -1 / 12),
    6: (3 / 4, -3 / 20, 1 / 60),
    8: (4 / 5, -1 / 5, 4 / 105, -1 / 280),
}
"""Central differences by their order: Σ w_k (f(kh) − f(−kh)) / h."""


class Truth:
    """The motions about a closed configuration in coordinates that are good there.

    Parameters
    ----------
    mech : Mechanism
        In these coordinates.
    q : ndarray (nq,)
    """

    def __init__(self, mech: rg.Mechanism, q: Array) -> None:
        self.mech, self.q = mech, q

    def moved(self, eta: Array) -> Truth:
        """Where η along the velocities G e_j leads to."""
        mech = self.mech
        q = mech.tree.integrate(self.q, self.G @ eta)
        return Truth(mech, mech.polish(q, mech.iv_dependent))

    @cached_property
    def G(self) -> Array:
        return self.mech.G(self.q)

    def g(self, u: Array) -> Array:
        """a at u̇ = 0."""
        mech, g = self.mech, np.zeros(self.mech.nv)
        if mech.nc:
            K, d = mech.K(self.q), mech.iv_dependent
            g[d] = np.linalg.lstsq(K[:, d], mech.k(self.q, self.G @ u), rcond=None)[0]
        return g

    def acceleration(self, u: Array, tau: Array) -> Array:
        """a (nv,)."""
        model, q, G = self.mech.model, self.q, self.G
        data, g = model.createData(), self.g(u)
        M = np.triu(pin.crba(model, data, q))
        M += np.triu(M, 1).T
        C = pin.rnea(model, data, q, G @ u, np.zeros(model.nv))
        return G @ np.linalg.solve(G.T @ M @ G, G.T @ (tau - C - M @ g)) + g


class Flat(Truth):
    """Four-bars by their closed form, through the places where their modes meet, on a free base.

    Parameters
    ----------
    cranks : dict {crank: (FourBar, angle)}
    """

    def __init__(self, mech: rg.Mechanism, base: Array, cranks: dict[str, tuple[FourBar, float]]) -> None:
        q, self.cranks = base.copy(), cranks
        self._found = {}
        for name, (bar, angle) in cranks.items():
            self._found[name] = theta, *_ = bar.evaluate(angle)
            for joint, number in zip(_links(name), theta, strict=True):
                q[mech.joint(joint).idx_q] = number
        super().__init__(mech, q)

    def moved(self, eta: Array) -> Flat:
        mech, dv = self.mech, np.zeros(self.mech.nv)
        dv[mech.iv_independent] = eta
        turned = {
            name: (bar, angle + dv[mech.joint(name).idx_v]) for name, (bar, angle) in self.cranks.items()
        }
        return Flat(mech, mech.tree.integrate(self.q, dv), turned)

    @cached_property
    def G(self) -> Array:
        G = np.zeros((self.mech.nv, self.mech.m))
        G[self.mech.iv_independent] = np.eye(self.mech.m)
        for name, (_, rate, _) in self._found.items():
            for joint, number in zip(_links(name), rate, strict=True):
                G[self.mech.joint(joint).idx_v, self._column(name)] = number
        return G

    def g(self, u: Array) -> Array:
        g = np.zeros(self.mech.nv)
        for name, (_, _, second) in self._found.items():
            for joint, number in zip(_links(name), second, strict=True):
                g[self.mech.joint(joint).idx_v] = number * u[self._column(name)] ** 2
        return g

    def _column(self, name: str) -> int:
        return self.mech.iv_independent.tolist().index(self.mech.joint(name).idx_v)


def _links(crank: str) -> tuple[str, str, str]:
    return crank, f"coupler{crank[5:]}", f"rocker{crank[5:]}"


@dataclass
class State:
    """A state in coordinates that may be close to a toggle, with truth in good ones."""

    truth: Truth
    poor: rg.Mechanism
    u: Array  # of the good ones
    tau: Array

    @property
    def q(self) -> Array:
        return self.truth.q

    @property
    def v(self) -> Array:
        return self.truth.G @ self.u

    @property
    def share(self) -> float:
        """How well the coordinates serve."""
        T = np.linalg.qr(self.truth.G / self.poor.units[:, None])[0]
        return smallest(T, self.poor.iv_independent)

    def derivatives(self, order: int, h: float) -> tuple[Array, Array, Array]:
        """∂u̇/∂y, ∂u̇/∂u and ∂u̇/∂τ in the poor coordinates."""
        mech, C, w, tau = self.truth.mech, self.poor.iv_independent, self.u, self.tau
        m = mech.m

        def rates(eta: Array) -> Array:
            at = self.truth.moved(eta)
            return np.concatenate([(at.G @ w)[C], at.acceleration(w, tau)[C]])

        units = mech.units[mech.iv_independent]
        by_eta = (
            np.array([_difference(lambda s, e=e: rates(s * e), order, h) for e in np.diag(units)]).T / units
        )
        a = self.truth.acceleration
        by_w = np.array([a(w + e, tau)[C] - a(w - e, tau)[C] for e in np.eye(m)]).T / 2  # quadratic in u
        by_tau = np.array([a(w, tau + e)[C] - a(w, tau - e)[C] for e in np.eye(mech.nv)]).T / 2
        W = np.linalg.inv(self.truth.G[C])
        by_u = by_w @ W
        return by_eta[m:] @ W - by_u @ by_eta[:m] @ W, by_u, by_tau

    def step(self, h: float, order: int, size: float = 1e-3) -> tuple[Array, Array]:
        """How a step takes displacements, (2m, 2m) each, in the poor coordinates: before it and after it.

        By differences of steps of RK4 in the good coordinates; in others RK4 ends elsewhere by its error's
        h⁵. A takes the first to the second. It is not made from them: beside a toggle the first are all but
        singular, and their inverse would enlarge what rounding left in both.
        """
        C, tree, m = self.poor.iv_independent, self.truth.mech.tree, self.truth.mech.m
        q1, _ = self._end(self.truth, self.u, h)

        def both(z: Array) -> Array:
            at, u = self.truth.moved(z[:m]), self.u + z[m:]
            q_end, v_end = self._end(at, u, h)
            parts = (tree.difference(self.q, at.q), at.G @ u, tree.difference(q1, q_end), v_end)
            return np.concatenate([part[C] for part in parts])

        sizes = np.concatenate([self.truth.mech.units[self.truth.mech.iv_independent], np.ones(m)])
        found = np.array([_difference(lambda s, e=e: both(s * e), order, size) for e in np.diag(sizes)]).T
        return found[: 2 * m], found[2 * m :]

    def _end(self, at: Truth, u: Array, h: float) -> tuple[Array, Array]:
        """q and v after a step: by own stages, closed to rounding, where coordinates are numbers of q."""
        if not at.mech.tree.vector_space:
            run = rg.simulate(at.mech, at.q, at.G @ u, duration=h, step=h, torque=self.tau)
            return run.q[-1], run.v[-1]
        own, slopes, moved, fast = at.mech.iv_independent, [], at, u
        for share in (0.5, 0.5, 1.0, 0.0):
            slopes.append((fast, moved.acceleration(fast, self.tau)[own]))
            moved, fast = at.moved(share * h * slopes[-1][0]), u + share * h * slopes[-1][1]
        by_y, by_u = (sum(w * k[i] for w, k in zip((1, 2, 2, 1), slopes, strict=True)) / 6 for i in (0, 1))
        end = at.moved(h * by_y)
        return end.q, end.G @ (u + h * by_u)


def _difference(f: Callable[[float], Array], order: int, h: float) -> Array:
    return sum(c * (f(k * h) - f(-k * h)) for k, c in enumerate(WEIGHTS[order], 1)) / h


def linkage(seed: int) -> rg.Mechanism:
    """One or two loops of mobility 1 to 4, planar or in space, perhaps tied, perhaps on a moving base."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear[:] = rng.normal(size=3) * rng.choice([0.0, 5.0])

    def link(parent: int, joint: pin.JointModel, name: str, place: pin.SE3) -> int:
        added = int(model.addJoint(parent, joint, place, name))
        carry(model, added, rng)
        return added

    def in_plane() -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([0.0, *rng.normal(size=2)]))

    root = link(0, rng.choice(BASES)(), "base", anywhere(rng)) if rng.random() < 0.3 else 0
    planar, m, ends = rng.random() < 0.5, int(rng.integers(1, 5)), [root]
    closed = 2 if planar else 3
    hinge = pin.JointModelRX if planar else pin.JointModelRZ
    while (free := sum(model.joints[j].nv for j in ends[1:])) < m + closed:
        kind, joint = rng.random(), hinge()
        if kind < 0.15:
            joint = pin.JointModelPY() if planar else pin.JointModelPZ()
        elif kind > 0.85 and not planar and m + closed - free >= 3:
            joint = pin.JointModelSpherical()
        place = in_plane() if planar else anywhere(rng)
        ends.append(link(ends[-1], joint, f"j{len(ends)}", place))
    other = ends[1] if len(ends) > 3 and rng.random() < 0.3 else root
    if rng.random() < 0.3:
        other = link(other, hinge(), "leg", in_plane())
    model.armature = np.where(rng.random(model.nv) < 0.2, rng.uniform(0.0, 1.0, model.nv), 0.0)
    q, data = pin.integrate(model, pin.neutral(model), 0.7 * rng.normal(size=model.nv)), model.createData()
    pin.forwardKinematics(model, data, q)
    there = data.oMi[ends[-1]] * in_plane()
    for side, joint in (("a", ends[-1]), ("b", other)):
        place = data.oMi[joint].actInv(there)
        model.addFrame(pin.Frame(side, joint, place, pin.FrameType.OP_FRAME))
    closures: list[rg.Closure] = [rg.PointClosure("a", "b")]
    hinges = [j for j in ends[1:] if model.joints[j].nq == 1]
    if m > 1 and len(hinges) > 1 and rng.random() < 0.25:
        one, two = (int(j) for j in rng.choice(hinges, 2, replace=False))
        ratio = float(rng.normal())
        offset = q[model.joints[one].idx_q] - ratio * q[model.joints[two].idx_q]
        closures.append(rg.CouplingClosure(model.names[one], model.names[two], ratio, float(offset)))
    return rg.Mechanism.from_pinocchio(model, closures, "auto", home=q)


def beside_toggle(seed: int) -> State | None:
    """A random linkage at a distance of `AWAY` from where chosen coordinates turn back, or where none do."""
    rng, mech = np.random.default_rng([seed, 1]), linkage(seed)
    q, m, every = mech.home, mech.m, np.arange(mech.nv)

    def motions(q: Array) -> Array:
        return np.linalg.svd(mech.scaled(mech.K(q)))[2][mech.nv - m :].T if mech.nc else np.eye(mech.nv)

    tied = [int(i) for c in mech.clusters for i in c.iv]
    free = [i for i in every if i not in tied]
    U = motions(q)
    for _ in range(30):
        chosen = np.sort(np.append(free, rng.choice(tied, m - len(free), replace=False))).astype(int)
        if smallest(U, chosen) > 1e-3:
            break
    else:
        return None

    def side(T: Array, of: Array) -> float:
        """Changes its sign where the chosen ones turn back, with the basis made continuous."""
        return float(np.linalg.det(T[chosen]) * np.linalg.det(T.T @ of))

    way, stride = U @ rng.normal(size=m), 0.05
    for _ in range(120):
        way = U @ (U.T @ way)
        way /= np.linalg.norm(way)

        def along(s: float, q: Array = q, way: Array = way) -> Array:
            return mech.polish(mech.tree.integrate(q, s * way * mech.units), every)

        new = along(stride)
        if mech.closure_residual(new) > 1e-11:
            break
        if side(motions(new), U) * side(U, U) < 0.0:
            low, high = 0.0, stride
            for _ in range(50):
                middle = 0.5 * (low + high)
                same = side(motions(along(middle)), U) * side(U, U) > 0.0
                low, high = (middle, high) if same else (low, middle)
            q = along(low + float(rng.choice(AWAY) * rng.choice([-1, 1])))
            break
        q, U = new, motions(new)
    return _state(mech, q, chosen, rng)


def _state(mech: rg.Mechanism, q: Array, chosen: Array, rng: np.random.Generator) -> State:
    names = [each.name for each in in_v(mech.joints)]
    K = mech.scaled(mech.K(q))
    T = np.linalg.svd(K)[2][mech.nv - mech.m :].T
    good = mech.with_independent([names[i] for i in best(T)])
    truth = Truth(good, good.polish(q, good.iv_dependent))
    u = rng.normal(size=good.m)
    u /= np.abs(truth.G @ u / good.units).max()
    return State(truth, mech.with_independent([names[i] for i in chosen]), u, rng.normal(size=mech.nv))


def beside_flat(seed: int) -> State:
    """Up to two four-bars that can lie flat, perhaps on a moving base, `AWAY` from flat."""
    rng, model = np.random.default_rng([seed, 2]), pin.Model()
    base = 0
    if rng.random() < 0.4:
        base = model.addJoint(0, rng.choice(BASES)(), anywhere(rng), "base")
        carry(model, base, rng)
    carriers, tips, cranks, chosen = [base], [], {}, ["base"] if base else []
    for i in range(int(rng.integers(1, 3))):
        a, b = rng.uniform(1.0, 3.0, 2)
        c = rng.uniform(0.5, 1.5) * a
        lengths = [(a, b, a, b), (a, b, b, a), (4.0, 2.0, 3.0, 3.0), (a + b, a, b + c, c + a)][
            rng.integers(3)
        ]
        on, at = int(rng.choice(carriers)), rng.normal()
        crank = linkages.add_link(model, on, at, f"crank{i}", lengths[1])
        linkages.add_link(model, crank, lengths[1], f"coupler{i}", lengths[2])
        carriers.append(linkages.add_link(model, on, at + lengths[0], f"rocker{i}", lengths[3]))
        bar, flat = FourBar(*lengths, 1), float(rng.choice([np.pi] if lengths[0] == 4.0 else [0.0, np.pi]))
        cranks[f"crank{i}"] = bar, flat + float(rng.choice(AWAY) * rng.choice([-1, 1]))
        tips.append(rg.PointClosure(f"coupler{i}_tip", f"rocker{i}_tip"))
        chosen.append(str(rng.choice([f"crank{i}", f"rocker{i}", f"coupler{i}"])))
    start = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    own = ["base", *cranks] if base else list(cranks)
    for name, (bar, _) in cranks.items():
        for joint, number in zip(_links(name), bar.evaluate(1.3)[0], strict=True):
            start[model.joints[model.getJointId(joint)].idx_q] = number
    mech = rg.Mechanism(model, tips, own, home=start)
    truth = Flat(mech, start, cranks)
    u = rng.choice([-1.0, 1.0], mech.m) * rng.uniform(0.5, 1.5, mech.m)
    return State(truth, mech.with_independent(chosen), u, rng.normal(size=mech.nv))


def off(found: Array, wanted: Array) -> float:
    """Largest error, relative to the largest entry where that is above 1."""
    return float(np.abs(found - wanted).max() / max(np.abs(wanted).max(), 1.0))


Judgement = tuple[str, str]
"""right, wrong, refused or left out, and words."""


def judged(state: State) -> Judgement:
    """What `derivatives` answers where `forward_dynamics` does."""
    at = state.poor, state.q, state.v, state.tau
    try:
        udot = rg.forward_dynamics(*at)
    except rg.RobustGcpError as error:
        return "left out", f"{type(error).__name__}: {error}"
    words = f"m={state.poor.m} share={state.share:.1e}"
    try:
        d = rg.derivatives(*at)
    except rg.RobustGcpError as error:
        return "refused", f"{words} {type(error).__name__}: {error}"
    for h in (1e-2, 1e-3, 1e-4):
        try:
            wanted = state.derivatives(8, h)
        except rg.RobustGcpError:  # so far away the loops do not close
            continue
        errors = [off(a, b) for a, b in zip((d.da_dy, d.da_dv, d.da_dtau), wanted, strict=True)]
        if max(errors) < 1e-9:
            sure = [0.0] * 3
            break
        sure = [off(a, b) for a, b in zip(state.derivatives(6, h), wanted, strict=True)]
        if max(sure) < 1e-9:
            break
    errors.append(off(d.udot, udot))
    errors.append(off(d.udot, state.truth.acceleration(state.u, state.tau)[state.poor.iv_independent]))
    good = all(e < max(1e-9, s) for e, s in zip(errors, [*sure, 0.0, 0.0], strict=True))
    return "right" if good else "wrong", f"{words} {errors} {sure}"


def judged_step(state: State, h: float = 5e-4) -> Judgement:
    """What `step_jacobians` answers where `simulate` takes the step."""
    try:
        rg.simulate(state.poor, state.q, state.v, duration=h, step=h, torque=state.tau)
    except rg.RobustGcpError as error:
        return "left out", f"{type(error).__name__}: {error}"
    words = f"m={state.poor.m} share={state.share:.1e}"
    try:
        A, _ = rg.step_jacobians(state.poor, state.q, state.v, state.tau, h)
    except rg.RobustGcpError as error:
        begun = isinstance(error, rg.ToggleError) and "start at a toggle" in str(error)
        return "left out" if begun else "refused", f"{words} {type(error).__name__}: {error}"
    exact = state.truth.mech.tree.vector_space
    # on moving bases the differences are those of runs, which close loops to 1e-12
    allowed = 1e-9 if exact else 1e-7
    error, unsure = _step_error(state, A, h)
    if error < max(allowed, unsure):
        return "right", f"{words} {error}"
    # RK4 ends elsewhere in other coordinates: by h⁵, so that it goes away with the step
    shorter, unsure = _step_error(
        state, rg.step_jacobians(state.poor, state.q, state.v, state.tau, h / 4)[0], h / 4
    )
    good = shorter < max(error / 64.0, 2.0 * allowed, unsure)
    return "right" if good else "wrong", f"{words} {error} {shorter}"


def _step_error(state: State, A: Array, h: float) -> tuple[float, float]:
    """Of the Jacobian of a step of h, by differences over displacements; and what those leave open.

    What is left of A over two displacements that both tell is the same.
    """
    exact, left = state.truth.mech.tree.vector_space, []
    for size in (1e-3, 1e-4, 1e-2, 3e-5, 1e-5) if exact else (1e-3, 2e-4, 1e-4, 4e-5):
        try:
            before, after = state.step(h, 6 if exact else 4, size)
        except rg.RobustGcpError:  # so far away the loops do not close
            continue
        left.append((A @ before - after) / max(np.abs(A).max(), 1.0))
    sizes = sorted(float(np.abs(part).max()) for part in left) or [np.inf]
    apart = [float(np.abs(a - b).max()) for i, a in enumerate(left) for b in left[:i]]
    return sizes[0], min(apart, default=0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=["toggle", "flat", "step", "step_flat"])
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    kinds = {
        "toggle": (beside_toggle, judged),
        "flat": (beside_flat, judged),
        "step": (beside_toggle, judged_step),
        "step_flat": (beside_flat, judged_step),
    }
    bad = 0
    for kind, (make, judge) in kinds.items():
        if given.only not in (None, kind):
            continue
        counts: Counter[str] = Counter()
        for seed in range(given.seed, given.seed + given.count):
            try:
                state = make(seed)
            except rg.PartitionError:  # none that moves, or home at a singular place
                state = None
            if state is None:
                counts["no mechanism"] += 1
                continue
            verdict, words = judge(state)
            counts[verdict] += 1
            if verdict in ("wrong", "refused"):
                print(kind, seed, verdict, words, flush=True)
        print(kind, dict(counts), flush=True)
        bad += counts["wrong"] + counts["refused"]
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
