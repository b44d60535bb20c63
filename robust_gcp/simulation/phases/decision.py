"""What is held from an instant on: Gauss's principle, min ½ fᵀ W f + bᵀ f over the rows that rest.

f ∈ [0, ∞) of stops, [−F, F] of dry friction, ℝ of locks; w = W f + b are the rows' accelerations.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...errors import SimulationError
from ...mechanism.tree.tree import Array
from .admissible import Frame, Seen, admissible
from .bearings import ALIKE, MOST, REMEDY, FrictionBounds
from .impact import REST, Tell, balanced, require_way, settled_impacts
from .quadratic_programs import DEPENDENT, ZERO, independent_rows
from .rows import Kind, Rows

if TYPE_CHECKING:
    from .phase_run import Steps

ON_STOP = 1e-13
"""m or rad: a stop this near to its place is held at it, so that its phase is the same each time."""

STILL = 1e-9
"""m/s² or rad/s² below which what is driven rests."""

ROUNDING = 1e-14
"""Share of the velocity before below which what is left of it is 0."""

Acting = Callable[[float, Array, Array, Array], Array]
"""(t, q, v, F of each row) -> (nv,)."""


@dataclass(frozen=True)
class State:
    """An instant: t, q (nq,), v (nv,), and how it moves."""

    t: float
    q: Array
    v: Array
    seen: Seen

    @classmethod
    def of(cls, steps: Steps, k: int, before: Seen) -> State:
        """At the end of a step."""
        q, v = steps.q[k], steps.v[k]
        return cls(float(steps.t[k]), q, v, Seen.of(v, steps.a[k], before))


@dataclass
class Phase:
    """A phase of smooth motion.

    Attributes
    ----------
    held : list of int
        Rows at rest: resting stops, sticking joints, locks.
    basis : list of int
        Independent ones of them, which the phase's mechanism holds.
    offsets : dict of int to float
        r of these.
    slip : dict of int to float
        Slipping joints and the signs of their rates.
    touching : frozenset of int
        Springy stops that are touched.
    latched : frozenset of int
        Locks whose event was.
    carried : list of int
        Rows at rest that the basis does not keep so: what is driven moves them, or a joint that leaves its
        dead point.
    """

    held: list[int] = field(default_factory=list)
    basis: list[int] = field(default_factory=list)
    offsets: dict[int, float] = field(default_factory=dict)
    slip: dict[int, float] = field(default_factory=dict)
    touching: frozenset[int] = frozenset()
    latched: frozenset[int] = frozenset()
    carried: list[int] = field(default_factory=list)

    @property
    def key(self) -> Hashable:
        """What tells it from others while it lasts."""
        slip, at = sorted(self.slip.items()), sorted(self.offsets.items())
        held = tuple(self.held), tuple(self.basis), tuple(self.carried)
        return *held, tuple(at), tuple(slip), self.touching

    def successor(self) -> Phase:
        """One with the same springs and latches, of which nothing else is known."""
        return Phase(touching=self.touching, latched=self.latched)

    def push(self, rows: Rows, q: Array, v: Array, bounds: Array) -> Array:
        """Forces (..., n) of slipping joints and touched springs at q (..., nq), v (..., nv), F (..., n)."""
        f = np.zeros((*q.shape[:-1], len(rows.rows)))
        for i, sign in self.slip.items():
            f[..., i] = -bounds[..., i] * sign
        if self.touching:
            gaps = rows.gaps(q)
            for i in self.touching:
                row, side = rows.rows[i], rows.side[i]
                depth, rate = -gaps[..., i], -side * (v @ rows.E[i])
                # as of Hunt and Crossley: no jump of the force where the spring is touched or left
                f[..., i] = side * row.stiffness * depth * (1.0 + row.damping * rate)
        return f


def candidates(rows: Rows, phase: Phase, state: State, bounds: Array) -> tuple[list[int], Array, Array]:
    """Rows that rest, and the bounds of their forces in the direction `side`."""
    rates, closed = rows.E @ state.v, set(rows.closed(state.q))
    locked = set(rows.locked(state.t, phase.latched))
    limits: dict[int, tuple[float, float]] = {}
    for i, row in enumerate(rows.rows):
        resting = abs(rates[i]) <= REST
        if i in locked:
            limits[i] = -np.inf, np.inf
        elif row.rubs and resting:
            limits[i] = -bounds[i], bounds[i]
        elif i in closed and resting:
            limits[i] = 0.0, np.inf
    lower, upper = np.array(list(limits.values())).reshape(-1, 2).T
    return list(limits), lower, upper


def decided(bounds: FrictionBounds, acting: Acting, phase: Phase, state: State) -> list[int]:
    """The rows that stay at rest; `phase.slip` is set to those that slip, with their directions.

    Where F is a share of reactions, by iteration.

    Raises
    ------
    SimulationError
        Where that finds none.
    """
    F, rubs = bounds.constant, bounds.rows.rubs
    for _ in range(MOST):
        held, acceleration = _decided_with(bounds.rows, F, acting, phase, state)
        if acceleration is None or not bounds.vary:
            return held
        before, F = F, bounds.bounds_at(state.t, state.q, state.v, *acceleration)
        if np.abs(F[rubs] - before[rubs]).max() <= ALIKE * F[rubs].max():
            return held
    raise SimulationError(
        f"JointFriction(coefficient=): at t = {state.t:.6g} s it is open which joints stick, as the friction "
        f"grows through the reactions that it causes (Painlevé's paradox); {REMEDY}"
    )


def _decided_with(
    rows: Rows, bounds: Array, acting: Acting, phase: Phase, state: State
) -> tuple[list[int], tuple[Array, Array] | None]:
    """What stays at rest under these bounds, and a with all that acts besides gravity and the loops."""
    t, q, v = state.t, state.q, state.v
    chosen, lower, upper = candidates(rows, phase, state, bounds)
    rates = rows.E @ v
    # before `acting` is called, which has the friction of what slips from the phase
    phase.slip = {i: float(np.sign(rates[i])) for i in np.flatnonzero(rows.rubs).tolist() if i not in chosen}
    if not chosen:
        return [], None
    tau = acting(t, q, v, bounds)
    frame = Frame(rows.mechanism, q, v, state.seen, tau, rows.driven(t))
    E = rows.side[chosen][:, None] * rows.E[chosen]
    B = frame.rows(E)
    b = B.T @ frame.free + E @ frame.p
    size = float(np.abs(frame.acceleration).max(initial=np.abs(b).max(initial=0.0)))
    if rows.drive is not None:  # where that rests, all there is of accelerations may be rounding
        size = max(size, STILL / ZERO)
    require_way(rows, chosen, B, b, size)
    f, w = balanced(rows, chosen, B, b, lower, upper, size)
    held = []
    for k, i in enumerate(chosen):
        kind, moves = rows.rows[i].kind, abs(w[k]) > ZERO * size
        if kind is Kind.FRICTION and moves:
            phase.slip[i] = float(np.sign(w[k]))
        # a stop pushes or opens: where it does neither it is not held, and is watched
        elif kind is not Kind.STOP or (f[k] > 0.0 and not moves):
            held.append(i)
    return held, (frame.p + frame.kick(frame.free + B @ f), tau + f @ E)


def settled(
    bounds: FrictionBounds, acting: Callable[[Phase], Acting], before: Phase, state: State,
    ahead: Iterable[State] | None, tell: Tell,
) -> tuple[Phase, Array]:  # fmt: skip
    """The phase that begins at an instant, and its velocity.

    Parameters
    ----------
    bounds : FrictionBounds
    acting : callable
        All that acts besides gravity and what is held, of a phase.
    before : Phase
        That ends, with `touching` as it is from now on.
    ahead : iterable of State, optional
        States a moment later on the phase that ends, where what was held breaks: its rows have no
        acceleration yet, and their signs are told by what they would have then.
    """
    rows = bounds.rows
    locks = rows.locked(state.t, before.latched)
    # Impulses first: what is held is decided at the velocity that they leave.
    v = _still(settled_impacts(rows, state.t, state.q, state.v, locks, state.seen, tell), state.v)
    phase = before.successor()
    if ahead is None:
        phase.held = decided(bounds, acting(phase), phase, State(state.t, state.q, v, state.seen))
    # At the instant itself what is held still balances: only a moment later tells which way it gives.
    elif not _broken(bounds, acting, before, phase, ahead):
        raise SimulationError(f"at t = {state.t:.6g} s a joint ought to break loose and does not")
    for kind, here, there in (("hold", phase.held, before.held), ("release", before.held, phase.held)):
        if changed := sorted(set(here) - set(there)):
            tell(kind, changed, 0.0)
    if phase.held:  # at rest to the last digit: the phase's mechanism begins with closed rows
        v = _still(_at_rest(rows, phase, state.q, v, state.seen), state.v)
    return phase, v


def _still(v: Array, before: Array) -> Array:
    """v, or 0 where it is the rounding of the velocity before: that breaks the loops by as much as it is."""
    size = float(np.abs(v).max(initial=0.0))
    return v if size > ROUNDING * float(np.abs(before).max(initial=0.0)) else np.zeros_like(v)


def _broken(
    bounds: FrictionBounds, acting: Callable[[Phase], Acting], before: Phase, phase: Phase,
    ahead: Iterable[State],
) -> bool:  # fmt: skip
    """Whether the phase differs from the one before at one of the states ahead."""
    for state in ahead:
        phase.held = decided(bounds, acting(phase), phase, state)
        if sorted(phase.held) != sorted(before.held):
            return True
    return False


def _at_rest(rows: Rows, phase: Phase, q: Array, v: Array, seen: Seen) -> Array:
    """v with the rates of what is held to rounding 0; the phase's independent rows, and those carried."""
    frame = Frame(rows.mechanism, q, v, seen, None, rows.driven())
    E = rows.E[phase.held]
    B = frame.rows(E)
    phase.basis = [phase.held[k] for k in independent_rows(B)]
    values, gaps = rows.values(q), rows.gaps(q)
    for i in phase.basis:
        on = rows.rows[i].kind is Kind.STOP and abs(gaps[i]) <= ON_STOP
        phase.offsets[i] = float(rows.at[i] if on else values[i])
    # what is driven moves too
    N = frame.N if rows.drive is None else admissible(rows.mechanism, q, v, seen)[0]
    phase.carried = _carried(phase, E @ N, rows.E[phase.basis] @ N)
    # rows may depend on each other; of all corrections that of the least kinetic energy
    return v + frame.kick(np.linalg.lstsq(B.T, -E @ v, rcond=ZERO)[0])


def _carried(phase: Phase, A: Array, basis: Array) -> list[int]:
    """Rows at rest that the phase's independent ones do not keep so, and that may come to move.

    Parameters
    ----------
    A, basis : ndarray (n, m), (k, m)
        E N of what is held, and of the independent rows.
    """
    left = A - np.linalg.lstsq(basis.T, A.T, rcond=DEPENDENT)[0].T @ basis if len(basis) else A
    # of a row at its dead point, which is 0, too: it has a rate as soon as others move
    moved = np.linalg.norm(left, axis=1) >= DEPENDENT * np.linalg.norm(A, axis=1)
    return [i for i, free in zip(phase.held, moved.tolist(), strict=True) if free]
