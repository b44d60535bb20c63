"""Constraint forces by name: what each row of λ is, and the force and moment in each cut joint.

λ belongs to the rows of φ, which acts on the joints as Kᵀ λ. With φ = p₁ − p₂ in world axes, the three
position rows of a closure are the force, in world axes, that the body of its first frame receives at the cut
point from the body of its second frame; the second body receives the opposite. A row n · (p₁ − p₂) gives
the force λ n at p₁ to the first body, the opposite there to the second. A rotation row
Σ w (u · n) gives the first body the moment λ Σ w (u × n), the second the opposite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checks import shown
from ..dynamics.equations import UNBALANCED_WORDS, constraint_forces
from ..errors import OptionError
from ..kernel.measures import reactions
from ..maps.classical import SingularityWarning
from ..mechanism.closures import Closure
from ..mechanism.mechanism import Mechanism
from ..mechanism.rows import ALONG, ROTATION, Row, rows_of
from ..mechanism.tree import Array
from ..warning import warn


def multipliers_of(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None) -> Array:
    """λ (N, nc) of each state: by the kernel where it is there, else by `constraint_forces`.

    NaN, with a warning, where nothing balances the motion.
    """
    found = reactions(mechanism, q, v, a, tau)
    if found is None:
        every = [None] * len(q) if tau is None else tau
        states = zip(q, v, a, every, strict=True)
        found = np.array([constraint_forces(mechanism, *state) for state in states])
        return found.reshape(len(q), mechanism.nc)
    if np.isnan(found).any():
        warn(UNBALANCED_WORDS, SingularityWarning)
    return found


def row_names(mechanism: Mechanism) -> list[str]:
    """A name for each row of φ and each constraint force, (nc,): "frame1-frame2.y", "….rx", "….r1".

    x, y, z: position rows, along the world's axes; n1, n2: those of a `PrismaticClosure`, across its axis;
    rx, ry, rz: rotation rows of a `FrameClosure`, about the axes of its second frame where the loop is
    closed; r1, r2: the two of a `RevoluteClosure`. The second of
    two closures between the same frames is called "frame1-frame2#2". The row of a coupling is called by its
    joints, "joint1-joint2"; its λ is the torque or force on the first.
    """
    labels: list[str] = []
    for closure in mechanism.loops:
        label = f"{closure.frame1}-{closure.frame2}"
        again = sum(other.partition("#")[0] == label for other in labels)
        labels.append(f"{label}#{again + 1}" if again else label)
    names = [f"{labels[row.closure]}.{row.name}" for row in _rows(mechanism)]
    coupled = mechanism.implicit.labels[len(names) :]
    return [*names, *(label.replace(" – ", "-") for label in coupled)]


def _rows(mechanism: Mechanism) -> list[Row]:
    """Each row of φ that belongs to a loop; those of couplings come after."""
    full = rows_of(mechanism.loops)
    return [full[row] for row in mechanism.implicit.rows if row < len(full)]


@dataclass(frozen=True, eq=False)
class Reaction:
    """What a closed loop's cut joint transmits, N times.

    Attributes
    ----------
    closure : closure
    force : ndarray (N, 3)
        On the body of frame1, at that frame, from the body of frame2; world axes, N. Zero along axes
        whose row of φ is zero in every configuration, as across the plane of a planar mechanism: what
        acts there, rigid bodies do not determine.
    moment : ndarray (N, 3)
        Likewise, N m.
    """

    closure: Closure
    force: Array
    moment: Array


def reaction(mechanism: Mechanism, number: int, q: Array, multipliers: Array) -> Reaction:
    """Force and moment in the cut joint of closure `number` at the configurations q (N, nq)."""
    closure, tree = mechanism.loops[number], mechanism.tree
    force, moment = np.zeros((len(q), 3)), np.zeros((len(q), 3))
    own = [(i, row) for i, row in enumerate(_rows(mechanism)) if row.closure == number]
    for i, row in own:
        if row.axis >= 0:
            force[:, row.axis] = multipliers[:, i]
    turning = [(i, row) for i, row in own if row.axis < 0]
    for at in range(len(q) if turning else 0):
        tree.jacobians(q[at])
        first, second = tree.frame_R[number], tree.frame_R[len(mechanism.loops) + number]
        for i, row in turning:
            for weight, u, n in row.terms:
                if row.axis == ALONG:
                    force[at] += multipliers[at, i] * (second @ n)
                elif row.axis == ROTATION:
                    moment[at] += multipliers[at, i] * weight * np.cross(first @ u, second @ n)
    return Reaction(closure, force, moment)


def closure_number(mechanism: Mechanism, name: str | int) -> int:
    """Which closure is meant: its number, or a frame of it, or both as "frame1-frame2".

    Raises
    ------
    OptionError
        For none or several.
    """
    closures = mechanism.loops
    if isinstance(name, int) and not isinstance(name, bool) and 0 <= name < len(closures):
        return name
    names = [{c.frame1, c.frame2, f"{c.frame1}-{c.frame2}", f"{c.frame1} – {c.frame2}"} for c in closures]
    found = [i for i, known in enumerate(names) if isinstance(name, str) and name in known]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{i}: {c.frame1}-{c.frame2}" for i, c in enumerate(closures)) or "none"
    raise OptionError(
        f"closure {shown(name)} is {'not one' if found else 'none'} of this mechanism's: {listed}"
    )
