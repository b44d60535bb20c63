"""Trees of change-point four-bars by the hundred, against the closed forms of their loops.

Each linkage stands on the ground or on the coupler of another one, so that dynamics are coupled and zones of
several loops overlap. The oracle takes the same steps in the same coordinates, with error control where the
run took them so, with q = γ(y) of every loop in closed form.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from robust_gcp.dynamics.equations import EquationsOfMotion
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.errors import NonFiniteError, RobustGcpError
from robust_gcp.examples.families import Lengths, four_bars
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array
from robust_gcp.reports.stepping import same_steps
from robust_gcp.simulation.runs.stats import Stats
from robust_gcp.simulation.simulate import simulate

from .loops_in_closed_form import LoopsInClosedForm
from .random_cases import RandomCase, passed

WITHIN = 1.1
"""Error of the bridges over that of the same steps on the closed forms."""

LARGEST_OFFSET = 0.3
"""rad between the places where two loops cross, as seen by their cranks."""

MOST_CALLS = 4000
"""Right-hand sides of the exact motion; one that comes near a dead point takes more, and is drawn anew."""


@dataclass(frozen=True)
class Tree(RandomCase):
    """One random tree and how it went.

    Attributes
    ----------
    lengths : tuple of (l0, l1, l2, l3)
        m, of each loop; l0 + l1 = l2 + l3 crosses at π, |l0 − l1| = |l2 − l3| at 0.
    centers : tuple of float
        Crank angles of the crossings, rad.
    starts, speeds : tuple of float
        Of the cranks, rad and rad/s.
    parents : tuple of int
        Which loop's coupler carries each one, −1 for the ground.
    assembly : int
    step : float
        s.
    steps : int
    expected, crossings : tuple of int
        How often each loop crosses, and how often that was logged.
    changes : int
        How often the run changed its coordinates.
    refined : int
        Steps that it took with error control.
    floor, error : float
        Largest of q on the closed forms and by bridges, rad.
    failure : str
        The message of an error, else empty.
    told : str
        The first warning, else empty.
    """

    lengths: tuple[Lengths, ...]
    centers: tuple[float, ...]
    starts: tuple[float, ...]
    speeds: tuple[float, ...]
    parents: tuple[int, ...]
    assembly: int
    step: float
    steps: int
    expected: tuple[int, ...] = ()
    crossings: tuple[int, ...] = ()
    changes: int = 0
    refined: int = 0
    floor: float = np.nan
    error: float = np.nan
    failure: str = ""
    told: str = ""

    @property
    def good(self) -> bool:
        """No failure, the error within 1.1 floors, and each crossing logged."""
        return not self.failure and self.ratio <= WITHIN and self.crossings == self.expected

    @property
    def silently_wrong(self) -> bool:
        """Not good, and neither an error nor a warning says so."""
        return not (self.good or self.failure or self.told)


def drawn(seed: int, index: int) -> tuple[Tree, EquationsOfMotion, Array]:
    """A tree whose loops stay in reach, its equations on the closed forms, and its first state."""
    rng = np.random.default_rng([seed, index])
    while True:
        tree = draw(rng)
        try:
            mechanism = mechanism_of(tree)
            problem = initial_value_problem(mechanism, v0=mechanism.lift(mechanism.home, tree.speeds))
            start = problem.start
            explicit = LoopsInClosedForm(start.path, start.point, tree.lengths, mechanism)
            equations = EquationsOfMotion(mechanism, explicit, None)
            exact = _exactly(equations, problem.x, _times(tree))
        except RobustGcpError:
            continue
        if exact is not None:
            return tree, equations, exact


def draw(rng: np.random.Generator) -> Tree:
    n = int(rng.integers(2, 6))
    lengths, centers = zip(*(_change_point(rng) for _ in range(n)), strict=True)
    side = 1.0 if rng.random() < 0.5 else -1.0
    base = float(rng.uniform(0.15, 0.35))
    offsets = [base, *(base + rng.uniform(0.0, LARGEST_OFFSET, n - 1)).tolist()]
    if rng.random() < 0.1:  # alike in all: singular at one time
        lengths, centers, offsets = (lengths[0],) * n, (centers[0],) * n, [base] * n
    paces = rng.uniform(2.0, 4.0, n) if rng.random() < 0.5 else np.full(n, 3.0)
    parents = tuple(int(rng.integers(-1, i)) if i else -1 for i in range(n))
    starts = tuple(float(c + side * o) for c, o in zip(centers, offsets, strict=True))
    speeds = tuple((-side * paces).tolist())
    step = float(10.0 ** rng.uniform(-2.7, -2.1))
    steps = int(np.ceil((max(offsets) + 0.2) / float(paces.min()) / step))
    assembly = 1 if rng.random() < 0.5 else -1
    return Tree(lengths, centers, starts, speeds, parents, assembly, step, steps)


def _change_point(rng: np.random.Generator) -> tuple[Lengths, float]:
    """Lengths of a change-point linkage, no two of them alike, and where its crank crosses."""
    while True:
        l1, l2, l3 = rng.uniform(0.5, 3.0, 3).tolist()
        at_pi = bool(rng.random() < 0.5)
        l0 = l2 + l3 - l1 if at_pi else l1 + abs(l2 - l3) * (1.0 if rng.random() < 0.5 else -1.0)
        lengths = (l0, l1, l2, l3)
        pairs = [abs(a - b) for i, a in enumerate(lengths) for b in lengths[i + 1 :]]
        if l0 > 0.3 and min(pairs) > 0.1 and max(lengths) < 0.95 * (sum(lengths) - max(lengths)):
            return lengths, np.pi if at_pi else 0.0


def mechanism_of(tree: Tree) -> Mechanism:
    return four_bars(tree.lengths, tree.starts, tree.parents, tree.assembly, spacing=8.0)


def _times(tree: Tree) -> Array:
    return np.asarray(tree.step * np.arange(tree.steps + 1))


def _exactly(f: EquationsOfMotion, x: Array, times: Array) -> Array | None:
    """The states at the times by small steps; None where the loops come near the end of their reach."""

    def followed(t: float, x: Array) -> Array:
        if f.explicit.counters.rhs > MOST_CALLS:
            raise NonFiniteError("beside a dead point the cranks' rates grow without bound")
        return f(t, x)

    span = (float(times[0]), float(times[-1]))
    found = scipy.integrate.solve_ivp(followed, span, x, "DOP853", times, rtol=1e-13, atol=1e-13)
    return np.asarray(found.y.T) if found.success else None


def measured(tree: Tree, equations: EquationsOfMotion, exact: Array) -> Tree:
    """The tree with what its run came to."""
    mechanism = mechanism_of(tree)
    m, times = mechanism.m, _times(tree)
    truth = _configurations(equations, exact)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            v0 = mechanism.lift(mechanism.home, tree.speeds)
            run = simulate(mechanism, v0=v0, duration=float(times[-1]), step=tree.step)
        except RobustGcpError as error:
            return replace(tree, failure=f"{type(error).__name__}: {error}")
    order = [int(cluster.inputs[0]) for cluster in mechanism.clusters]
    logged = np.bincount([order[c.cluster] for c in run.crossings if c.cluster is not None], minlength=m)
    expected, found = passed(exact[:, :m], np.array(tree.centers), logged)
    return replace(
        tree,
        expected=tuple(expected.tolist()),
        crossings=tuple(found.tolist()),
        changes=len(run.stats.repartitions),
        refined=run.stats.refined_steps,
        floor=float(np.abs(_floor_steps(tree, equations, exact[0], run.stats) - truth).max()),
        error=float(np.abs(run.q - truth).max()),
        told=str(caught[0].message) if caught else "",
    )


def _floor_steps(tree: Tree, equations: EquationsOfMotion, x: Array, stats: Stats) -> Array:
    """q of the run's steps on the closed forms, in the coordinates that it changed to."""

    def other(f: EquationsOfMotion, x: Array, names: Sequence[str]) -> tuple[EquationsOfMotion, Array]:
        return _in_other(tree, f, x, names)

    return np.array(list(same_steps(equations, x, _times(tree), stats, other)))


def _in_other(
    tree: Tree, equations: EquationsOfMotion, x: Array, names: Sequence[str]
) -> tuple[EquationsOfMotion, Array]:
    """The equations and the state in other coordinates."""
    m, path = equations.m, equations.explicit.path
    point = equations.explicit.point_at(x[:m], x[m:])
    mechanism = equations.mechanism.with_independent(names)
    explicit = LoopsInClosedForm(path, point, tree.lengths, mechanism)
    rates = (point.G @ point.ydot)[mechanism.iv_independent]
    x = np.concatenate([point.q[mechanism.iq_independent], rates])
    return EquationsOfMotion(mechanism, explicit, None), x


def _configurations(equations: EquationsOfMotion, states: Array) -> Array:
    m = equations.m
    return np.array([equations.explicit.point_at(x[:m], x[m : 2 * m]).q for x in states])
