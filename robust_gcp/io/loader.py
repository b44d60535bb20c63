"""Robots' files and model folders to a `Mechanism`."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pinocchio as pin

from ..checks import hint, shown
from ..errors import ModelError, OptionError, RobustGcpError, missing_file
from ..mechanism.actuation.actuators import Actuator
from ..mechanism.assembly.assembly import FEW_STARTS, MANY_STARTS
from ..mechanism.assembly.ranges import ranged, tell_outside
from ..mechanism.constraint.rounding import IMPLIED, ROUNDED, without_rounded_rows, without_unmoved_rows
from ..mechanism.contents import FileContents, check_base, named, tell_left_out
from ..mechanism.coordinates.independent import regular_near
from ..mechanism.loops import ClosedLoops
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import parts_of_file, rubbing
from ..mechanism.tolerances import NEARLY_CLOSED
from ..mechanism.tree.joints import joints_of
from .gepetto import joint_changes, with_changed_forces, with_joint_changes
from .home import closed_home, with_coordinates
from .own_block import (
    couplings_of,
    forces_of,
    home_of,
    independent_of,
    own_block,
    recommended_of,
    set_gravity,
    with_axes,
)
from .robot_file import (
    READERS,
    UNREAD,
    has_yaml,
    is_mjcf,
    others_beside,
    read_robot,
    require_read,
    robot_file,
)
from .robot_packages import named_path
from .robot_yaml import closures_of, is_list_of_str, settings_of
from .text_file import files_in, inside, is_file, is_link, path_of

log = logging.getLogger(__name__)

FREE = 6
"""Velocities of a floating body."""

NEARLY_SINGULAR = 1e-3
"""Conditioning of K below which a pose that nobody chose is left: G has lost three digits there."""


class _Asked(NamedTuple):
    """What a caller of `load` asked for."""

    independent: Sequence[str] | Literal["auto"] | None
    strict: bool
    limits: bool
    friction: bool


def models_folder() -> Path:
    """Where the shipped models are: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def model_names() -> list[str]:
    """Names of the shipped models, for `load`."""
    return sorted(p.parent.name for p in models_folder().glob("*/robot.yaml"))


def load(
    name_or_folder: str | Path,
    independent: Sequence[str] | Literal["auto"] | None = None,
    base: str | None = None,
    strict: bool = False,
    root: str | Path | None = None,
    limits: bool = False,
    friction: bool = False,
    moving: Mapping[str, Sequence[str]] | None = None,
) -> Mechanism:
    """A mechanism from a shipped model's name, a folder, or a robot's file: URDF, MJCF, SDF, USD.

    "robot_descriptions:NAME" and "example_robot_data:NAME" stand for robots of these packages, where they
    are on this machine.

    A folder holds robot.yaml and robot.urdf, or robot.xml (MJCF) in its place; without robot.yaml, one such
    file. A file beside a robot.yaml that belongs to it is read with it. The YAML's keys are those of the
    parallel-robot community around Pinocchio: `closed_loop` (pairs of frame names), `type` ('3d', '6d',
    'revolute' or 'prismatic'), `name_mot` (motors, or "auto"),
    `joint_name` and `joint_type` (joints of the URDF that stand for SPHERICAL, UJOINT_XY, … or FIXED ones);
    the block `robust_gcp` is this package's own and optional: `schema`, `description`, `home`
    (configuration by joint), `guess` (the same, closed on loading), `gravity`, `axes` (of revolute and
    prismatic closures), `springs`, `dampers`, `point_springs`, `torques`, `couplings`, `independent` (in
    place of the motors), `recommended` (duration, step and velocity of a run from home). Other keys are left
    to other programs.

    Home is closed on loading, from the file's pose: `home`, `guess`, the keyframe "home" or the first one, or
    else the neutral configuration (moved to a regular one beside it where it is singular, or nearly). Where
    that leaves the ranges of joints, but for `home`, an assembly inside them is looked for; a home outside is
    told. A pose that is singular is kept, with coordinates of the motions beside it.

    Parameters
    ----------
    name_or_folder : str or Path
    independent : sequence of str or "auto", optional
        Joints, or components of joints (`joint.x`), that serve as minimal coordinates. Left out: the motors
        of the file as far as they can serve, completed by the best conditioned ones; "auto": without them.
    base : "fixed", "free" or None
        What the robot stands on; None: as the file says.
    strict : bool
        Refuse a file with parts that are not simulated (`Mechanism.left_out`), of which a ModelWarning tells
        else.
    root : str or Path, optional
        A folder besides the model's own whose files a MJCF file may include, attach or take meshes from.
    limits, friction : bool
        Have `simulate` stop joints at their ranges, by rigid stops without restitution, and brake them by the
        dry friction of the file: `Mechanism.parts`.
    moving : mapping of str to sequence of str, optional
        Of MJCF: bodies that stand on the ground, mocap bodies among them, and the axes x, y, z, rx, ry, rz
        that they are moved along and about, one after the other. `{"table": ("x", "rz")}` makes the joints
        table_x and table_rz, which `drive=` prescribes; those that it does not hold still.

    Raises
    ------
    ModelError
        Naming the file, the key and the remedy.
    ClosureError
        When a home that the file gives leaves a loop open by more than rounding, or no configuration is
        found that closes them all; each is named.
    """
    check_base(base)
    for flag, value in (("strict", strict), ("limits", limits), ("friction", friction)):
        if not isinstance(value, bool):
            raise OptionError(f"{flag} = {shown(value)} must be True or False")
    asked = _Asked(independent, strict, limits, friction)
    name_or_folder = named_path(name_or_folder)
    path = path_of(name_or_folder, "load")
    if path.suffix in UNREAD:
        raise ModelError(f"{path}: {UNREAD[path.suffix]}")
    if path.suffix.lower() in (".yaml", ".yml") and not path.is_dir():
        if not path.exists() and not is_link(path):
            raise missing_file(path)
        if path.name != "robot.yaml":
            raise ModelError(f"{path}: give the folder that it is in; read there is robot.yaml")
        path = path.parent
    if path.suffix in READERS and not has_yaml(path):
        contents = read_robot(path, base, root, moving, False)
        return _mechanism(contents, path, path, path.stem, {}, {}, asked)
    folder, path = _folder(path.parent if path.suffix in READERS else path, name_or_folder)
    if path.suffix in READERS:
        contents = read_robot(inside(folder, path.name), base, root, moving, False)
        contents.left_out += named("files beside it", others_beside(path))
        return _mechanism(contents, path, path, folder.name, {}, {}, asked)
    settings = settings_of(path)
    own = own_block(settings, path)
    closures = with_axes(own.get("axes"), closures_of(settings, path), path)
    changes = joint_changes(settings, path)
    robot = inside(folder, robot_file(folder))
    if changes and is_mjcf(robot):
        raise ModelError(f"{path}: joint_name is for URDF; write the joint as it is in {robot.name}")
    contents = read_robot(robot, base, root, moving, True)
    contents.model = with_joint_changes(contents.model, changes, path)
    contents.forces = with_changed_forces(contents.forces, changes)
    contents.close([*closures, *couplings_of(own, path)])
    contents.forces += forces_of(own, path)
    if independent is None:
        asked = asked._replace(independent=independent_of(own, path))
    set_gravity(own.get("gravity"), contents.model, path)
    return _mechanism(contents, path, robot, folder.name, settings, own, asked)


def _tell_floating(model: pin.Model, path: Path) -> None:
    """Log which bodies stand on nothing, by the file or as base="free" asks."""
    for index in range(1, model.njoints):
        if model.parents[index] == 0 and model.nvs[index] == FREE:
            links = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == index]
            log.info("%s: %s floats, by the joint %s", path, ", ".join(links[:3]), model.names[index])


def _folder(path: Path, given: str | Path) -> tuple[Path, Path]:
    """The folder that is meant, and what to read in it first: robot.yaml or, without it, one robot's file."""
    # a folder of the user's goes before a shipped model of its name
    if not is_file(path / "robot.yaml") and str(given) in model_names():
        path = models_folder() / str(given)
    if str(given) and (is_file(path / "robot.yaml") or is_link(path / "robot.yaml")):
        return path, inside(path, "robot.yaml")
    require_read(path)
    files = [f for f in files_in(path) if f.suffix in READERS] if str(given) else []
    preferred = [f for f in files if f.stem == "robot"] or files
    if len(preferred) == 1:
        return path, preferred[0]
    names = model_names()
    found = f" (it holds {', '.join(sorted(f.name for f in files))}: name one)" if files else ""
    raise ModelError(
        f"{shown(str(given))} is neither a folder with robot.yaml or one robot's file{found} nor one of the "
        f"shipped models {', '.join(names)}{hint(given, names)}"
    )


def _take_parts(contents: FileContents, asked: _Asked) -> None:
    """What acts as asked is not left out: no range without inside, no joint of several numbers."""
    model = contents.model
    joints = joints_of(model)
    acting = {"limits": ranged(model, joints)} if asked.limits else {}
    acting |= {"dry friction": rubbing(model, joints)} if asked.friction else {}
    kinds = {kind: {joint.name for joint in found} for kind, found in acting.items()}
    left = []
    for part in contents.left_out:
        what, _, names = part.partition(" (")
        kind, _, of = what.partition(" of ")
        if kind not in kinds or of not in ("joints", "tendons"):
            left.append(part)
        elif of == "joints":
            listed = f", {names.removesuffix(')')}, "
            for name in kinds[kind]:
                listed = listed.replace(f", {name}, ", ", ")
            left += named(what, [listed[2:-2]] if listed != ", " else [])
    contents.left_out = left


def _mechanism(
    contents: FileContents,
    path: Path,
    source: Path,
    name: str,
    settings: dict[str, Any],
    own: dict[str, Any],
    asked: _Asked,
) -> Mechanism:
    """Home closed, coordinates completed, what is left out told."""
    _take_parts(contents, asked)
    if asked.strict:
        tell_left_out(contents.left_out, str(path), True)
    model = contents.model
    _tell_floating(model, path)
    motors = settings.get("name_mot")
    if motors is not None and motors != "auto" and not is_list_of_str(motors):
        raise ModelError(f"{path}: name_mot must be a list of joint names or 'auto', not {shown(motors)}")
    given, guess = (home_of(own, key, model, path) for key in ("home", "guess"))
    guess = contents.pose() if guess is None else guess
    try:
        loops, implied = without_unmoved_rows(ClosedLoops(model, contents.closures, ROUNDED))
        if given is not None:
            home = given
            if loops.closure_residual(home) <= ROUNDED:
                loops, rounded = without_rounded_rows(loops, home)
                implied += rounded
        else:
            spreads = MANY_STARTS if guess is None else FEW_STARTS
            start = loops.home if guess is None else guess
            loops, home, rounded = closed_home(loops, start, spreads)
            implied += rounded
        if isinstance(motors, list):
            known = set(loops.joint_names)
            contents.actuated = tuple(m for m in motors if m in known)
            for motor in motors:
                loops.velocities_of(motor)  # refuses what is not there
        if not contents.actuators:
            single = {joint.name for joint in loops.joints if joint.single}
            contents.actuators = [Actuator.motor(n, n) for n in contents.actuated if n in single]
        contents.left_out += named(IMPLIED, implied)
        tell_left_out(contents.left_out, str(path), asked.strict)
        wanted = motors if isinstance(motors, list) else () if motors == "auto" else contents.wanted()
        if given is None and guess is None:
            # a pose that nobody chose may be singular, where no motion starts by itself
            to_serve = asked.independent if isinstance(asked.independent, (list, tuple)) else wanted
            home = regular_near(loops, home, NEARLY_SINGULAR, to_serve)
        choice = asked.independent, wanted, given is not None
        mechanism = with_coordinates(contents, loops, home, name, *choice)
    except RobustGcpError as error:
        error.args = (f"{path}: {error.args[0]}", *error.args[1:])  # its type and attributes stay
        raise
    if given is not None:
        mechanism.require_closed(mechanism.home, NEARLY_CLOSED, f"{path}: home")
        mechanism.home = mechanism.polish(mechanism.home, mechanism.iv_dependent)
    tell_outside(mechanism, mechanism.home, f"{path}: home")
    mechanism.source = source
    mechanism.parts = tuple(
        parts_of_file(mechanism, contents.parts, contents.bounce, asked.limits, asked.friction)
    )
    mechanism.recommended = recommended_of(own, mechanism, path)
    return mechanism
