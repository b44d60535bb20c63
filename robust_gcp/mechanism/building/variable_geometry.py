"""A mechanism whose geometry can change: placements as further coordinates, which a motion holds still.

The placement of a joint in its parent changes by joints without bodies just before it, that of a frame by
such joints just after the one that carries it. In the coordinates of that mechanism ∂u̇/∂y by their numbers,
their velocities and accelerations held at zero, is the derivative by the geometry; G and ∂v/∂y say how the
dependent joints follow, y and u of the others held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...checks import hint, shown
from ...errors import OptionError, PartitionError
from ..constraint.closures import Closure
from ..forces.forces import JointDamper, JointSpring, JointTorque, PointSpring
from ..mechanism import Mechanism
from ..tolerances import RANK
from ..tree.joints import Array, Index, Joint

MARK = ".placement."

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Along the axes of the joint that carries it, m, and about these, at the origin, rad."""

KINDS = (
    pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ,
    pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ,
)  # fmt: skip

SINGULAR = 1e-6
"""Smallest singular value of K_d, dimensionless, from which a configuration tells."""

OPEN = 1e-8
"""Relative: what is left of K's column of a placement beside those of the joints is rounding up to here."""


def is_geometry(name: object) -> bool:
    """Whether a parameter's name is one of a placement."""
    return isinstance(name, str) and MARK in name


@dataclass(frozen=True)
class Varied:
    """A mechanism with some placements as further coordinates.

    Attributes
    ----------
    plain, mechanism : Mechanism
        As it is, and with the further coordinates; their names are those of the parameters.
    names : tuple of str
    iq, iv : ndarray of int (nq,), (nv,)
        Where the numbers of the plain one are in q and v.
    own, more : ndarray of int (m,), (k,)
        Where its independent coordinates are in y, and the further ones.
    """

    plain: Mechanism
    mechanism: Mechanism
    names: tuple[str, ...]
    iq: Index
    iv: Index
    own: Index
    more: Index

    def q(self, q: Array) -> Array:
        """Configurations (…, nq) with the further coordinates at zero."""
        return _within(q, self.iq, self.mechanism.nq)

    def v(self, v: Array) -> Array:
        """Velocities, torques or the like (…, nv) with the further ones at zero."""
        return _within(v, self.iv, self.mechanism.nv)

    def require_closed(self, configurations: Array) -> None:
        """An OptionError where loops do not stay closed when a placement changes, judged at (N, nq)."""
        mech = self.mechanism
        columns = mech.velocities_named(self.names)
        left: Array = np.full(len(columns), np.inf)
        dependent = self.iv[self.plain.iv_dependent]
        for q in configurations:
            K = mech.scaled(mech.K(self.q(q)))
            if np.linalg.svd(K[:, dependent], compute_uv=False).min(initial=np.inf) < SINGULAR:
                continue  # there K reaches less
            reached, apart = K[:, self.iv], K[:, columns]
            # what no joint makes up for
            apart = apart - reached @ np.linalg.lstsq(reached, apart, rcond=RANK)[0]
            # the least over all places: conditioning makes rounding larger at some
            left = np.minimum(left, np.abs(apart).max(axis=0, initial=0.0) / np.abs(K).max(initial=1e-300))
        for name, far in zip(self.names, left.tolist(), strict=True):
            if OPEN < far < np.inf:
                raise _opened(name)


def _within(numbers: Array, places: Index, size: int) -> Array:
    found = np.zeros((*numbers.shape[:-1], size))
    found[..., places] = numbers
    return found


def _opened(name: str) -> OptionError:
    return OptionError(
        f"parameters: loops do not stay closed when {name} changes: the mechanism moves only as its geometry "
        "is (planar, say, or with special dimensions); name placements that keep it so"
    )


def varied(mechanism: Mechanism, names: Sequence[str]) -> Varied:
    """The mechanism with these placements as further coordinates, made once.

    Raises
    ------
    OptionError
        For names of no placement, forces of the user's own classes, and loops that do not stay closed.
    """
    key = ("varied", *names)
    made: Varied = mechanism.memo.once(key, lambda: _varied(mechanism, tuple(names)))
    return made


def still_inputs(mechanism: Mechanism) -> tuple[int, ...]:
    """Which of y are held still."""
    held = mechanism.velocities_named(mechanism.still).tolist()
    return tuple(k for k, i in enumerate(mechanism.iv_independent.tolist()) if i in held)


def still_rows(mechanism: Mechanism) -> Array | None:
    """The rows of v that are held at rest, (k, nv); None where none are."""
    if not mechanism.still:
        return None
    rows: Array = np.eye(mechanism.nv)[mechanism.velocities_named(mechanism.still)]
    return rows


def _varied(mechanism: Mechanism, names: tuple[str, ...]) -> Varied:
    model = mechanism.own_model
    wanted = _wanted(mechanism, names)
    made, at = pin.Model(), {0: 0}
    made.name, made.gravity = model.name, model.gravity
    # Joints without bodies move no mass: rotors keep M regular, and do nothing as these joints are held.
    size = sum(body.mass for body in list(model.inertias)[1:]) or 1.0
    rotors: list[tuple[str, float]] = []

    def more(target: str, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """Joints that move a placement; the last one, and the placement in it."""
        for i, direction in enumerate(wanted.get(target, ())):
            start = pin.SE3(np.eye(3), placement.translation if i == 0 else np.zeros(3))
            name = f"{target}{MARK}{direction}"
            parent = made.addJoint(parent, KINDS[DIRECTIONS.index(direction)](), start, name)
            # of the mechanism's own order, so that M is as well conditioned as before
            rotors.append((name, size * (mechanism.length**2 if direction.startswith("r") else 1.0)))
        still = target not in wanted
        # the rotation comes last, as directions are axes of the carrying joint
        return parent, placement if still else pin.SE3(placement.rotation, np.zeros(3))

    joints = {str(name) for name in list(model.names)[1:]}
    frames: dict[int, list[pin.Frame]] = {}
    for frame in list(model.frames)[1:]:
        frames.setdefault(frame.parentJoint, []).append(frame)

    def add_frames(joint: int) -> None:
        for frame in frames.get(joint, ()):
            place = at[joint], frame.placement
            if str(frame.name) not in joints:  # a joint's own frame moves with the joint
                place = more(str(frame.name), *place)
            made.addFrame(pin.Frame(frame.name, place[0], place[1], frame.type))

    add_frames(0)
    for joint in mechanism.joints:
        parent, placement = more(
            joint.name, at[model.parents[joint.index]], model.jointPlacements[joint.index]
        )
        at[joint.index] = made.addJoint(parent, model.joints[joint.index], placement, joint.name)
        made.appendBodyToJoint(at[joint.index], model.inertias[joint.index], pin.SE3.Identity())
        add_frames(joint.index)
    iq, iv = _places(mechanism.joints, made)
    armature = np.zeros(made.nv)
    armature[iv] = model.armature
    for name, rotor in rotors:
        armature[made.joints[made.getJointId(name)].idx_v] = rotor
    made.armature = armature
    home = _within(mechanism.home, iq, made.nq)
    independent = (*mechanism.independent, *names)
    try:
        whole = Mechanism(made, mechanism.closures, independent, home, mechanism.name, mechanism.forces)
    except PartitionError as error:
        raise _opened(", ".join(names)) from error
    whole.still = names
    # generic ones of the whole would move the placements too, and judge another mechanism
    whole.judged_at = [_within(q, iq, made.nq) for q in mechanism.generic_configurations()]
    _scale_alike(mechanism, whole, iv)
    of_y = {i: k for k, i in enumerate(whole.iv_independent.tolist())}
    own = np.array([of_y[i] for i in iv[mechanism.iv_independent].tolist()], dtype=np.int64)
    further = np.array([of_y[i] for i in whole.velocities_named(names).tolist()], dtype=np.int64)
    return Varied(mechanism, whole, names, iq, iv, own, further)


def _scale_alike(plain: Mechanism, whole: Mechanism, iv: Index) -> None:
    """Scale the velocities that both have as the plain one does, so that both judge places alike."""
    whole.column_scale[iv] = plain.column_scale
    of_loops = plain.column_scale.copy()
    for cluster in plain.clusters:
        of_loops[cluster.iv] = cluster.loops.column_scale
    place = np.full(whole.nv, -1)
    place[iv] = np.arange(plain.nv)
    for cluster in whole.clusters:
        own = place[cluster.iv]
        cluster.loops.column_scale[own >= 0] = of_loops[own[own >= 0]]


def _places(joints: Sequence[Joint], model: pin.Model) -> tuple[Index, Index]:
    """Where the numbers of joints in q and v are in another model that has them too."""
    there = [model.joints[model.getJointId(joint.name)] for joint in joints]
    q = [np.arange(joint.idx_q, joint.idx_q + joint.nq) for joint in there]
    v = [np.arange(joint.idx_v, joint.idx_v + joint.nv) for joint in there]
    return np.concatenate(q), np.concatenate(v)


def _wanted(mechanism: Mechanism, names: tuple[str, ...]) -> dict[str, list[str]]:
    """Directions by the joint or frame that is to move, in their order.

    Raises
    ------
    OptionError
    """
    joints = [joint.name for joint in mechanism.joints]
    frames = set(frames_used(mechanism)) - set(joints)
    known = [
        f"{target}{MARK}{direction}" for target in (*joints, *sorted(frames)) for direction in DIRECTIONS
    ]
    found: dict[str, list[str]] = {}
    for name in names:
        if name not in known:
            raise OptionError(
                f"parameters: {shown(name)} is none{hint(name, known)}; joints and the frames of closures "
                "and springs have placement.x, .y, .z, .rx, .ry, .rz in the joint that carries them"
            )
        target, _, direction = name.rpartition(MARK)
        if direction in found.setdefault(target, []):
            raise OptionError(f"parameters: {name} is named twice")
        found[target].append(direction)
    for force in mechanism.forces:
        if not isinstance(force, JointSpring | JointDamper | JointTorque | PointSpring):
            raise OptionError(
                f"parameters: {names[0]} changes the geometry, and {type(force).__name__} is a force that "
                "may depend on it in ways not known here; take differences of whole runs, or leave it out"
            )
    # in one order, as a chain's later joints turn with its earlier ones
    return {target: sorted(moves, key=DIRECTIONS.index) for target, moves in found.items()}


def frames_used(mechanism: Mechanism) -> list[str]:
    """Frames of closures and of springs between points."""
    closures = [(c.frame1, c.frame2) for c in mechanism.closures if isinstance(c, Closure)]
    springs = [(s.frame1, s.frame2) for s in mechanism.forces if isinstance(s, PointSpring)]
    return [frame for pair in (*closures, *springs) for frame in pair]
