"""Every way to a run beside the plain one of the same mechanism and steps, for `derivative_paths`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from .. import Batch, Event, Mechanism, Motion, Simulation, Wrench, analyse, load, simulate, simulate_many
from ..examples.linkages import four_bar, n_four_bar
from ..mechanism.parts import JointFriction, Stop
from ..mechanism.tree.tree import Array

STEPS, STEP = 500, 1e-3
"""Of each run; s."""

REFERENCE = "the Python reference"
FOLDED = "corank 5"

REASONS = {
    REFERENCE: "asked for: backend='python'",
    "DOP853": "SciPy's solver in Python, at rtol = 1e-9",
    "step by step": "a call of Python for each step",
    "a wrench": "bodies are placed in Python at each evaluation",
    "past a near miss": "error control for a third of the steps, one of them in other coordinates",
    FOLDED: "five ranks are lost at once: 32 modes are told apart",
}
"""Why ways take long, as they were asked for."""

MANY = 1024
"""States in one call."""

EACH = f"each of {MANY} states"
"""Where a call is of all of them, and the share of one is told."""

Call = Callable[[], object]


def groups() -> Iterator[tuple[str, Call, dict[str, Call]]]:
    """What is called, plainly and otherwise."""
    rocker, bars, walker = load("crank_rocker"), load("rhombus"), load("walker")
    missing = four_bar(1.0, 2.0 + 1e-4, 1.5, 1.5, y=2.2)
    v, tau = rocker.lift(rocker.home, [6.0]), np.full(3, 0.1)
    plain = _of(rocker, v)
    push = [Wrench("q2", np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))]
    start = float(rocker.home[0])

    def follow(t: float, q: Array, v: Array) -> Array:
        return -0.1 * v

    many = np.tile(rocker.home, (64, 1)), np.tile(v, (64, 1))
    several = partial(simulate_many, rocker, list(zip(*many, strict=True)), STEPS * STEP, STEP)
    yield (
        f"simulate, {STEPS} steps",
        plain,
        {
            "constant torques": partial(plain, torque=tau),
            "a torque function": partial(plain, torque=follow),
            "held over the steps": partial(plain, torque=follow, hold=True),
            "a wrench": partial(plain, wrenches=push),
            "a prescribed joint": partial(plain, drive={"q1": Motion(lambda t: start + 6.0 * t)}),
            "an event": partial(plain, events=[Event(lambda t, q, v: float(q[2] - 2.0))]),
            "a and energy recorded": partial(plain, record=("a", "energy")),
            "multipliers recorded": partial(plain, record="multipliers"),
            "dry friction": partial(plain, joints=[JointFriction("q1", 0.5)]),
            "stops that are not met": partial(plain, joints=[Stop("q1", lower=-50.0, upper=50.0)]),
            "DOP853": partial(plain, stepper="DOP853", rtol=1e-9, atol=1e-11),
            "past a near miss": _of(missing, missing.lift(missing.home, [3.0])),
            REFERENCE: partial(plain, backend="python"),
            "step by step": partial(_stepped, rocker, v),
        },
    )
    through, walks = _of(bars, np.zeros(3), np.array([0.2, -0.2, 0.2])), _of(walker, np.zeros(walker.nv))
    yield f"simulate through flat, {STEPS} steps", through, {REFERENCE: partial(through, backend="python")}
    yield f"simulate a walker, {STEPS} steps", walks, {"a torque function": partial(walks, torque=follow)}
    yield (
        f"64 runs of {STEPS} steps one by one",
        lambda: [plain() for _ in range(64)],
        {
            "simulate_many": several,
            "simulate_many, a torque function": partial(several, torque=follow),
            "Batch": partial(_batched, rocker, many),
        },
    )


def analyses() -> Iterator[tuple[str, Call, dict[str, Call]]]:
    """Calls about configurations alone."""
    bars, five = load("rhombus"), n_four_bar(5)
    beside = bars.assemble([0.4, -0.4, 0.4], hold=["q1"])
    others: dict[str, Call] = {
        "where two modes cross": partial(analyse, bars, np.zeros(3)),
        FOLDED: partial(analyse, five, np.zeros(five.nq)),
    }
    yield "analyse", partial(analyse, bars, beside), others
    off = beside + [0.0, 0.01, -0.01]
    near = bars.assemble([1e-3, -1e-3, 1e-3], hold=["q1"]) + [0.0, 1e-5, -1e-5]
    closed = partial(bars.assemble, hold=["q1"])
    yield (
        "assemble",
        partial(closed, off),
        {
            "beside a crossing of modes": partial(closed, near),
            EACH: partial(closed, np.tile(off, (MANY, 1))),
        },
    )


def _of(mechanism: Mechanism, v: Array, q: Array | None = None) -> Callable[..., object]:
    """The plain run of a mechanism."""
    home = mechanism.home if q is None else q
    return partial(simulate, mechanism, home, v, duration=STEPS * STEP, step=STEP)


def _stepped(mechanism: Mechanism, v: Array) -> object:
    sim = Simulation(mechanism, mechanism.home, v, step=STEP)
    for _ in range(STEPS):
        sim.step()
    return sim


def _batched(mechanism: Mechanism, many: tuple[Array, Array]) -> object:
    batch = Batch(mechanism, len(many[0]), *many, step=STEP)
    batch.step(n=STEPS)
    return batch
