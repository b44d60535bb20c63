"""Random linkages with stops, friction and locks: drawn by seed and index, run in several descriptions."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import robust_gcp as rg
from robust_gcp.examples import families, linkages
from robust_gcp.mechanism.tree.tree import Array
from robust_gcp.simulation.phases.rows import Kind, Rows

DURATION, STEP = 1.0, 2e-3
"""s; each case is run in steps of STEP and of half of it."""

AT_ONCE = 1e-8
"""s between happenings that may be told in any order."""

SAME_TIME = 1e-8
"""s by which times may differ between coordinates, besides the stepper's own error.

The slowest bounces, 1e-6 m/s or rad/s, are by that apart where places are rounded at 1e-14.
"""

DYING = 1e-6
"""s between bounces that die out: where they are slower than 1e-6 they end, be it one sooner or later."""

DEEPEST, OPEN = 1e-12, 1e-11
"""m or rad: penetration, and loops."""

RESTITUTIONS = (0.0, 0.3, 0.7, 0.9, 1.0)

Told = list[tuple[float, str, tuple[str, ...]]]


@dataclass
class Scene:
    """A start, what is in the joints, and names of independent joints to choose from."""

    name: str
    mechanism: rg.Mechanism
    q: Array
    v: Array
    parts: list[Any]
    torque: Array
    choices: list[list[str]]


@dataclass
class Outcome:
    """What a case came to.

    Attributes
    ----------
    happenings : int
    apart : float
        Largest difference of times between coordinates, s; `floor` between steps.
    deepest, open, energy : float
        Worst penetration, m or rad; closure; share of the energy at work by which the balance of the finer
        steps is off, which is that of the coarse ones over 6 or rounding.
    refused : str
        What a run was refused with, all alike; "" where none was.
    undecided : bool
        Whether the happenings differ between steps: compared as far as they agree.
    wrong : list of str
    """

    index: int
    name: str
    happenings: int = 0
    kinds: dict[str, int] = field(default_factory=dict)
    apart: float = 0.0
    floor: float = 0.0
    deepest: float = 0.0
    open: float = 0.0
    energy: float = 0.0
    refused: str = ""
    undecided: bool = False
    wrong: list[str] = field(default_factory=list)


# --------------------------------------------------------------------- drawing


def _four_bar(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    while True:
        try:
            mech = linkages.four_bar(*rng.uniform(0.5, 2.5, 4), y=rng.uniform(0.2, 3.0))
        except rg.RobustGcpError:
            continue
        return mech, [[name] for name in mech.joint_names]


def _slider_crank(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    return rg.load("slider_crank"), [["q1"], ["q2"], ["q3"]]


def _change_point(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    return rg.load("change_point"), [["q1"], ["q3"], ["q2"]]


def _rhombus(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    mech, angle = rg.load("rhombus"), rng.uniform(0.2, 1.5)
    mech = rg.Mechanism.from_pinocchio(mech.model, mech.closures, ["q1"], np.array([1.0, -1.0, 1.0]) * angle)
    return mech, [["q1"], ["q3"], ["q2"]]


def _five_bar(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    return rg.load("five_bar"), [["q1", "q4"], ["q1", "q2"], ["q2", "q3"]]


def _swinging(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    mech = linkages.swinging_four_bar(2.0, 1.0, 1.8, 1.6, rng.uniform(-1.0, 1.0), rng.uniform(0.4, 2.6))
    first, *others = mech.joint_names
    return mech, [[first, name] for name in others]


def _four_bars(rng: np.random.Generator) -> tuple[rg.Mechanism, list[list[str]]]:
    n = int(rng.integers(2, 5))
    parents = [-1, *(int(rng.integers(-1, i)) for i in range(1, n))]
    lengths = [(2.0, 1.0, 1.8, 1.6)] * n
    mech = families.four_bars(lengths, rng.uniform(0.4, 2.6, n), parents if rng.random() < 0.5 else None)
    kinds = ("crank", "rocker", "coupler")
    return mech, [[f"{kinds[(i * k) % 3 if k < 2 else 2]}{i}" for i in range(n)] for k in range(3)]


Draw = Callable[[np.random.Generator], tuple[rg.Mechanism, list[list[str]]]]
DRAWS: dict[str, Draw] = {
    "four-bar": _four_bar, "slider-crank": _slider_crank, "change point": _change_point,
    "rhombus": _rhombus, "five-bar": _five_bar, "swinging four-bar": _swinging, "four-bars": _four_bars,
}  # fmt: skip


def drawn(seed: int, index: int) -> Scene:
    """A case."""
    rng = np.random.default_rng([seed, index])
    name = list(DRAWS)[int(rng.integers(len(DRAWS)))]
    mech, choices = DRAWS[name](rng)
    q = mech.home
    v = mech.lift(q, rng.normal(scale=1.5, size=mech.m))
    joints = list(mech.joint_names)
    parts: list[Any] = []
    for joint in rng.choice(joints, size=min(len(joints), int(rng.integers(1, 5))), replace=False):
        parts += _of_joint(rng, str(joint), float(q[joints.index(str(joint))]))
    if rng.random() < 0.3:
        parts.append(_of_sum(rng, joints, q))
    torque = rng.normal(scale=3.0, size=mech.nv) * (rng.random(mech.nv) < 0.3)
    return Scene(name, mech, q, v, parts, torque, choices)


@dataclass(frozen=True)
class Passing:
    """q_i − place."""

    i: int
    place: float

    def __call__(self, t: float, q: Array, v: Array) -> float:
        """Its value."""
        return float(q[self.i]) - self.place


def _of_sum(rng: np.random.Generator, joints: list[str], q: Array) -> Any:
    """A stop or friction on q_i + q_j, or a lock of q_i where q_j passes a place."""
    i, j = (int(k) for k in rng.choice(len(joints), size=2, replace=False))
    names = {"joint": joints[i], "other": joints[j], "ratio": -1.0}
    draw = rng.random()
    if draw < 0.4:
        return rg.Stop(**names, upper=float(q[i] + q[j]) + float(rng.uniform(0.0, 0.5)), restitution=0.5)
    if draw < 0.7:
        return rg.JointFriction(**names, bound=float(rng.uniform(0.2, 4.0)))
    return rg.Lock(joints[i], when=Passing(j, float(q[j]) + rng.uniform(-0.4, 0.4)), end=0.9)


def _of_joint(rng: np.random.Generator, joint: str, here: float) -> list[Any]:
    parts: list[Any] = []
    if rng.random() < 0.7:
        e = float(rng.choice(RESTITUTIONS)) if rng.random() < 0.7 else float(rng.random())
        down, up = rng.uniform(0.1, 1.2, 2) if rng.random() < 0.9 else (0.0, 0.8)  # closed at the start
        ends = {"lower": here - down, "upper": here + up}
        if rng.random() < 0.5:
            del ends["lower" if rng.random() < 0.5 else "upper"]
        if rng.random() < 0.1:
            if down == 0.0 and "lower" in ends:
                ends["lower"] = here - 0.1  # where a rigid one ends too, rounding says whether it is touched
            parts.append(rg.Stop(joint, stiffness=3e3, damping=0.2, **ends))
        else:
            parts.append(rg.Stop(joint, restitution=e, **ends))
    if rng.random() < 0.6:
        parts.append(rg.JointFriction(joint, float(rng.uniform(0.2, 8.0))))
    if rng.random() < 0.25 or not parts:
        start = float(rng.uniform(0.0, 0.8))
        parts.append(rg.Lock(joint, start=start, end=start + float(rng.uniform(0.05, 0.4))))
    return parts


# --------------------------------------------------------------------- running and judging


def told(run: rg.Trajectory) -> Told:
    """Happenings by time, those at once by kind and joints; bounces that die out as the first of them."""
    found = sorted(_without_dying(sorted((x.time, x.kind, x.joints) for x in run.happenings)))
    result: Told = []
    while found:
        until = found[0][0] + AT_ONCE
        now = [x for x in found if x[0] <= until]
        result += sorted(now, key=lambda x: (x[1], x[2]))
        found = found[len(now) :]
    return result


def _without_dying(found: Told) -> Told:
    """The same without impacts within DYING after another; what they end in is told when they began to."""
    result: Told = []
    last: dict[str, tuple[float, float]] = {}  # of a joint: its last impact, and the first of those that die
    for t, kind, joints in found:
        before = max((last[joint] for joint in joints if joint in last), default=(-np.inf, -np.inf))
        dies = t - before[0] <= DYING
        if kind == "impact":
            last |= dict.fromkeys(joints, (t, before[1] if dies else t))
        if not (dies and kind == "impact"):
            result.append((before[1] if dies and kind == "hold" else t, kind, joints))
    return result


def alike(one: Told, two: Told) -> int:
    """How many happenings from the first on are the same."""
    same = [a[1:] == b[1:] for a, b in zip(one, two, strict=False)]
    return same.index(False) if False in same else len(same)


def apart(one: Told, two: Told, n: int) -> float:
    """Largest difference of times of the first n."""
    return max((abs(a[0] - b[0]) for a, b in zip(one[:n], two[:n], strict=True)), default=0.0)


def ran(scene: Scene, names: Sequence[str], step: float) -> rg.Trajectory | str:
    """Its run in these coordinates, or what that was refused with."""
    mech = scene.mechanism.with_independent(list(names))
    try:
        return rg.simulate(mech, scene.q, scene.v, DURATION, step, torque=scene.torque, joints=scene.parts)
    except rg.SimulationError as error:
        return f"{type(error).__name__}: {error}"


def _stepwise(scene: Scene) -> rg.Trajectory:
    """The coarse run step by step, saved and restored in the middle, by the reference."""
    sim = rg.Simulation(
        scene.mechanism.with_independent(scene.choices[0]), scene.q, scene.v, STEP, joints=scene.parts
    )
    n = round(DURATION / STEP)
    sim.step(scene.torque, n=n // 3)
    state = sim.save()
    sim.step(scene.torque, n=7)
    sim.restore(state)
    for _ in range(n - n // 3):
        sim.step(scene.torque)
    return sim.trajectory


def measured(seed: int, index: int, most: int = 3) -> Outcome:
    """A case, run and judged."""
    scene = drawn(seed, index)
    outcome = Outcome(index, scene.name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        coarse = ran(scene, scene.choices[0], STEP)
        fine = [ran(scene, names, 0.5 * STEP) for names in scene.choices[:most]]
    refused = [run for run in (coarse, *fine) if isinstance(run, str)]
    if refused:
        outcome.refused = refused[0]
        if len(refused) < len(fine) + 1:
            outcome.undecided = True
        return outcome
    _judge(scene, outcome, coarse, fine)  # type: ignore[arg-type]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _judge_steps(outcome, coarse, _stepwise(scene), fine[0])  # type: ignore[arg-type]
    return outcome


def _judge_steps(outcome: Outcome, whole: rg.Trajectory, steps: rg.Trajectory, finer: rg.Trajectory) -> None:
    """The run and the same one step by step: happenings and motion, to what these amplify.

    Where it is saved a leg ends, and the next one may begin in other coordinates: then the two are apart by
    less than either errs, which the run in finer steps tells.
    """
    one, two = told(whole), told(steps)
    error = float(np.abs(whole.q[-1] - finer.q[-1]).max())
    n = alike(one, two)
    if not n == len(one) == len(two):
        outcome.wrong.append(f"step by step: {two[n : n + 2]} instead of {one[n : n + 2]}")
    elif apart(one, two, n) > SAME_TIME + 3.0 * outcome.floor:  # legs may begin in other coordinates
        outcome.wrong.append(f"step by step: times {apart(one, two, n):.1e} s apart")
    elif np.abs(whole.q[-1] - steps.q[-1]).max() > 1e-8 + 1e2 * outcome.floor + error:
        outcome.wrong.append(f"step by step: {np.abs(whole.q[-1] - steps.q[-1]).max():.1e} apart")


def _judge(scene: Scene, outcome: Outcome, coarse: rg.Trajectory, fine: list[rg.Trajectory]) -> None:
    first, other = told(fine[0]), told(coarse)
    n = alike(first, other)
    outcome.undecided = not n == len(first) == len(other)
    outcome.happenings, outcome.floor = len(first), apart(first, other, n)
    for _, kind, _ in first:
        outcome.kinds[kind] = outcome.kinds.get(kind, 0) + 1
    for names, run in zip(scene.choices[1:], fine[1:], strict=False):
        these = told(run)
        m = alike(first, these)
        k = min(n, m)
        between = apart(first, these, k)
        outcome.apart = max(outcome.apart, between)
        floor = outcome.floor
        if between > SAME_TIME + 3.0 * floor:  # the steps may be coarse in these coordinates alone
            again = ran(scene, list(names), STEP)
            if not isinstance(again, str):
                floor += apart(told(again), these, min(k, alike(told(again), these)))
        if between > SAME_TIME + 3.0 * floor:
            outcome.wrong.append(f"{names}: times {between:.1e} s apart, floor {floor:.1e}")
        if m < n or (not outcome.undecided and m < max(len(first), len(these))):
            outcome.wrong.append(f"{names}: {these[m : m + 2]} instead of {first[m : m + 2]}")
    rows = Rows(scene.mechanism, scene.parts)
    stops = rows.of(Kind.STOP)
    for run in (coarse, *fine):
        outcome.deepest = max(outcome.deepest, -float(rows.gaps(run.q)[:, stops].min(initial=0.0)))
        outcome.open = max(outcome.open, float(run.closure_error().max()))
    if outcome.deepest > DEEPEST:
        outcome.wrong.append(f"penetration {outcome.deepest:.1e}")
    if outcome.open > OPEN:
        outcome.wrong.append(f"loops open by {outcome.open:.1e}")
    size = (
        float(np.ptp([scene.mechanism.energy(q, v) for q, v in zip(coarse.q, coarse.v, strict=True)])) + 1.0
    )
    before, after = (float(np.abs(run.energy_error()).max()) / size for run in (coarse, fine[0]))
    outcome.energy = 0.0 if outcome.undecided else after
    if not outcome.undecided and after > max(before / 6.0, 1e-9):
        outcome.wrong.append(f"energy off by {before:.1e}, then {after:.1e}")
