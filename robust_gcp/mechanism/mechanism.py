"""A mechanism: a spanning tree, loop closures, and the joints chosen as minimal coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..checks import check_text, plain, require_finite
from .actuation.actuation import Actuation
from .actuation.actuators import Actuator, actuators_given
from .actuation.paths import Path as TendonPath
from .actuation.paths import tendons_given
from .assembly.keyframes import Keyframes, keyframes_of
from .constraint.couplings import AnyClosure, closures_given
from .constraint.pin_constraints import with_named_frames
from .constraint.rounding import IMPLIED, ROUNDED, without_unmoved_rows
from .contents import FileContents, named, tell_left_out
from .coordinates.independent import best_at_home, require_determined
from .facade import joint_names
from .forces.applied_forces import AppliedForces
from .forces.forces import Force, forces_given, require_length
from .from_files import FromFiles
from .loops import ClosedLoops, once_more
from .parts import Part
from .recommended import Recommended
from .sensing.sensors import Sensors
from .tree.model import check_model
from .tree.tree import Array

OF_LOOPS = ("column_scale", "joint_inertia", "lifted", "of_loops", "row_scale", "units")
"""What follows from the loops whatever the coordinates, as far as it is known."""

TOLD = ("forces", "actuated", "left_out", "parts", "actuators", "tendons")
"""What acts on a mechanism and what else it is made of, besides loops, coordinates and home."""

BESIDE = ("recommended", "source", "keyframes", "sensors", "moved", "still", "judged_at")
"""What a file tells beside the mechanism itself, whatever its coordinates."""


class Mechanism(FromFiles):
    """A `pin.Model` with closed loops, seen in minimal coordinates.

    Use `load`, `Mechanism.from_urdf`, `Mechanism.from_mjcf` or `Mechanism.from_pinocchio`.

    Attributes
    ----------
    model : pin.Model
        A copy of the spanning tree, to be read; after a change of it every call is refused.
    closures : tuple of closures
    independent, dependent : tuple of str
        Names of the joints y is made of, `joint.component` where it is one of several velocities of a
        joint, and of all joints that are not independent as a whole.
    actuated : tuple of str
        Joints that the robot's file drives.
    left_out : tuple of str
        Parts of the file that are not simulated, one entry a kind.
    parts : tuple of Stop, JointFriction
        What `simulate` takes where `joints` is left out: limits and dry friction of the file, if `load` was
        asked for them.
    actuators : tuple of Actuator
        What `ctrl` drives, by name; without `ctrl` they do nothing.
    tendons : dict of str to Path
        By name, to be recorded (`run["tendon.split"]`) and driven.
    actuation : Actuation or None
        All actuators at once; None where there are none.
    nq, nv, nc, m : int
        Sizes of q, of v, of φ (rows that are zero in every configuration left out), and of y.
    home : ndarray (nq,)
        Seed configuration.
    forces : tuple of Force
        What acts besides gravity and the torques of a simulation.
    applied : AppliedForces or None
        What the forces amount to; None where there are none.
    recommended : Recommended
        Duration, step and velocity at home that `simulate` takes where they are left out.
    length : float
        Characteristic length, m: the largest distance from a joint to its children and cut points in a loop.
    source : Path or None
        The robot's file that it was loaded from.
    keyframes : dict of str to Keyframe
        States that the file names: `mech.keyframes["stand"].q`.
    sensors : dict of str to Sensor
        Sensors of the file; `sense` answers them at a state, `trajectory["sensor.NAME"]` along a run.
    moved : tuple of str
        Joints that move the ground: those that no `drive=` prescribes hold still.
    still : tuple of str
        Joints that stand for a changing geometry and hold still, see `building.variable_geometry`.
    judged_at : sequence of ndarray (nq,) or None
        Where K_d is looked at to judge how well it is conditioned elsewhere, if not just anywhere.
    """

    source: Path | None
    judged_at: Sequence[Array] | None = None

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[AnyClosure],
        independent: Sequence[str] | Literal["auto"],
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
        actuated: Sequence[str] = (),
        left_out: Sequence[str] = (),
        parts: Sequence[Part] = (),
        actuators: Sequence[Actuator] = (),
        tendons: Mapping[str, TendonPath] | None = None,
    ) -> None:
        super().__init__(model, closures)
        driven = {"actuators": actuators, "tendons": {} if tendons is None else tendons}
        acting = SimpleNamespace(forces=forces, actuated=actuated, left_out=left_out, parts=parts, **driven)
        self._made(acting, independent, home, name)

    @classmethod
    def _over(cls, loops: ClosedLoops, *given: Any) -> Mechanism:
        """A mechanism of these loops, all else as `_made` takes it."""
        made, known = once_more(loops, cls), vars(loops)
        vars(made).update({name: known[name] for name in OF_LOOPS if name in known})
        made._made(*given)
        return made

    def _made(
        self,
        acting: Any,
        independent: Sequence[str] | Literal["auto"] | None,
        home: ArrayLike | None,
        name: str,
    ) -> None:
        """Coordinates of the loops, and what acts on them: that of contents, or of another mechanism."""
        self.forces = tuple(forces_given(acting.forces))
        self.applied = AppliedForces(self, self.forces) if self.forces else None
        require_length(self.forces, self.closures)
        check_text("name", name)
        self.name = name or str(self.own_model.name)
        self.recommended, self.source = Recommended(), None
        self.keyframes, self.sensors = Keyframes(), Sensors()
        self.moved: tuple[str, ...] = ()
        self.still: tuple[str, ...] = ()
        self.home = pin.neutral(self.own_model) if home is None else self.configuration(home, "home")
        if independent is None:
            independent = "auto" if self.closures else self.joint_names
        if isinstance(independent, str) and independent == "auto":
            self.home, chosen = best_at_home(self, self.home, self.name)
        else:
            chosen = joint_names(independent, "independent")
        self.choose(chosen)
        self.actuated, self.left_out = tuple(acting.actuated), tuple(acting.left_out)
        self.parts = tuple(acting.parts)
        self.actuators = actuators_given(acting.actuators)
        self.tendons = tendons_given(self.tree, acting.tendons)
        self.actuation = Actuation(self.tree, self.actuators) if self.actuators else None
        require_determined(self)
        # last, as a user's force may ask the mechanism for anything
        if self.applied is not None and self.applied.own is not None:
            self.applied.own.require_sound(self.home)

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        closures: Sequence[Any] = (),
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
        actuators: Sequence[Actuator] = (),
        tendons: Mapping[str, TendonPath] | None = None,
    ) -> Mechanism:
        """A mechanism from any `pin.Model`, which is copied and never written to.

        Parameters
        ----------
        model : pin.Model
            The spanning tree.
        closures : sequence of PointClosure, FrameClosure, RevoluteClosure or CouplingClosure
            Pairs of frame names that close the loops, pairs of joints that move together; also
            Pinocchio's constraint models, see `pin_constraints.with_named_frames`.
        independent : sequence of str or "auto", optional
            Joints that serve as minimal coordinates, one number in q each. "auto" takes the best conditioned
            set at home (assembled first where its loops are open, and beside it where it is singular) and
            logs it. Left out: all joints where there is no loop, else "auto".
        home : array_like (nq,), optional
            Seed configuration; `pin.neutral` when left out.
        forces : sequence of Force
            JointSpring, JointDamper, PointSpring, JointTorque, or one of a class of your own: what acts
            besides gravity and the torques of a simulation.
        actuators : sequence of Actuator
            What `simulate` drives by `ctrl=`.
        tendons : mapping of str to FixedTendon, SpatialTendon, …
            Paths whose lengths are of interest, by name.

        Raises
        ------
        ModelError
            For a joint or frame that does not exist, or a joint order for which `pin.crba` is wrong.
        PartitionError
            When the dependent joints cannot be solved for in any configuration.
        """
        told: Any = {"actuators": actuators, "tendons": {} if tendons is None else tendons}
        contents = FileContents(model, closures_given(closures), forces_given(forces), **told)
        return cls.from_contents(contents, independent, home, name)

    @classmethod
    def from_contents(
        cls,
        contents: FileContents,
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
        loops: ClosedLoops | None = None,
    ) -> Mechanism:
        """A mechanism from what a reader of files found; the parameters are those of `from_pinocchio`.

        Without a name it is called as the file calls itself. `loops` are those of the contents where they
        are known, without what rounding alone holds.
        """
        left_out: list[str] = []
        if loops is None:
            check_model(contents.model)
            model, closures = with_named_frames(contents.model, contents.closures)
            loops, rounded = without_unmoved_rows(ClosedLoops(model, closures, ROUNDED))
            left_out = named(IMPLIED, rounded)
            tell_left_out(left_out, name or str(model.name) or "from_pinocchio", strict=False)
        made = cls._over(loops, contents, independent, home, name or str(contents.model.name))
        made.left_out += tuple(left_out)
        made.parts = ()  # stops and dry friction of a file act where `load` is asked for them
        made.keyframes = keyframes_of(made, contents.keyframes.items(), contents.velocities)
        made.sensors = Sensors({sensor.name: sensor for sensor in contents.sensors})
        made.moved = contents.moved
        return made

    @cached_property
    def lifted(self) -> float:
        """What gravity has of all bodies at `standpoint`, J."""
        mass = sum(body.mass for body in list(self.own_model.inertias)[1:])
        return -float(mass * (self.own_model.gravity.linear @ self.standpoint))

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """Kinetic energy, potential energy of gravity and of the springs together, J."""
        return float(require_finite(np.asarray(sum(self.energies(q, v))), "the energy"))

    def energies(self, q: ArrayLike, v: ArrayLike) -> tuple[float, float]:
        """Kinetic energy, and what gravity and springs have, J."""
        return energies_of(self, self.configuration(q), self.velocity(v))

    def generic_configurations(self, count: int = 5) -> list[Array]:
        """As of `ClosedLoops`, or those that the mechanism is judged at."""
        known = self.judged_at
        return super().generic_configurations(count) if known is None else list(known[:count])

    def with_independent(self, independent: Sequence[str]) -> Mechanism:
        """The same mechanism in other minimal coordinates."""
        self.require_unchanged()
        other = Mechanism._over(self, self, independent, self.home, self.name)
        vars(other).update(self._beside)
        return other

    @property
    def _beside(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in BESIDE}

    def __reduce__(self) -> tuple[type[Mechanism], tuple[Any, ...], dict[str, Any]]:
        """Pickle and copy by the recipe: the workspace holds views that must not be copied."""
        self.require_unchanged()
        recipe = self.own_model, self.closures, self.independent, self.home
        return Mechanism, (*recipe, self.name, *(getattr(self, name) for name in TOLD)), self._beside

    def __repr__(self) -> str:
        sizes = f"{self.nv} velocities, {len(self.closures)} closures with {self.nc} rows"
        return plain(f"Mechanism({self.name!r}: {sizes}, y = {', '.join(self.independent) or 'none'})")


def energies_of(mechanism: Mechanism, q: Array, v: Array) -> tuple[float, float]:
    """`Mechanism.energies` at a state that was checked."""
    kinetic, potential = mechanism.tree.energies(q, v)
    potential += mechanism.lifted
    return kinetic, potential + (0.0 if mechanism.applied is None else mechanism.applied.energy(q))
