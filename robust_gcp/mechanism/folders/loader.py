"""Model folders: robot.urdf and robot.yaml to a `Mechanism`."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from ...checks import hint, shown
from ...errors import ModelError, RobustGcpError
from ..closures import Closure, closure_kinds
from ..formats.mjcf import model_from_mjcf
from ..formats.text_file import inside, is_file, path_of
from ..formats.urdf import model_from_urdf
from ..mechanism import Mechanism
from ..tolerances import NEARLY_CLOSED
from .gepetto import joint_changes, with_joint_changes
from .own_block import forces_of, home_of, own_block, recommended_of, set_gravity, with_axes
from .yaml_text import parsed_yaml

KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type", "robust_gcp")
"""Keys of robot.yaml that are read."""

ALIKE = 0.85
"""Likeness (difflib's ratio) above which another key is taken for one of them misspelt."""


def models_folder() -> Path:
    """Where the shipped models are: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).parents[2]
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def model_names() -> list[str]:
    """Names of the shipped models, for `load`."""
    return sorted(p.parent.name for p in models_folder().glob("*/robot.yaml"))


def load(name_or_folder: str | Path, independent: Sequence[str] | Literal["auto"] | None = None) -> Mechanism:
    """A mechanism from a shipped model's name, from a folder, or from a MJCF file (*.xml).

    A folder holds robot.yaml and robot.urdf, or robot.xml (MJCF) in its place. The YAML's keys are
    those of the parallel-robot community around Pinocchio: `closed_loop` (pairs of frame names),
    `type` ('3d', '6d', 'revolute' or 'prismatic'), `name_mot` (independent joints), `joint_name` and
    `joint_type` (joints of the URDF that stand for SPHERICAL, UJOINT_XY, … or FIXED ones); the block
    `robust_gcp` is this package's own and optional: `schema`, `description`, `home` (configuration by
    joint), `gravity`, `axes` (of revolute and prismatic closures), `springs`, `dampers`, `point_springs`,
    `torques`, `recommended` (duration, step and velocity of a run from home). Other keys are left to other
    programs.

    Parameters
    ----------
    name_or_folder : str or Path
    independent : sequence of str or "auto", optional
        In place of `name_mot`.

    Raises
    ------
    ModelError
        Naming the file, the key and the remedy.
    ClosureError
        When the home configuration leaves a loop open by more than rounding.
    """
    folder = path_of(name_or_folder, "load")
    if folder.suffix == ".xml":
        return Mechanism.from_mjcf(folder, independent, name=folder.stem)
    if not is_file(folder / "robot.yaml") and str(name_or_folder) in model_names():
        folder = models_folder() / str(name_or_folder)
    if not str(name_or_folder) or not is_file(folder / "robot.yaml"):
        names = model_names()
        raise ModelError(
            f"{shown(str(name_or_folder))} is neither a folder with robot.yaml nor one of the shipped models "
            f"{', '.join(names)}{hint(name_or_folder, names)}"
        )
    path = inside(folder, "robot.yaml")
    settings = _settings(path)
    own = own_block(settings, path)
    closures = with_axes(own.get("axes"), _closures(settings, path), path)
    forces = forces_of(own, path)
    changes = joint_changes(settings, path)
    base = None
    if is_file(folder / "robot.xml") and not is_file(folder / "robot.urdf"):
        parts = model_from_mjcf(inside(folder, "robot.xml"))
        model, base = parts.model, parts.home
        if changes:
            raise ModelError(f"{path}: joint_name is for URDF; write the joint as it is in robot.xml")
        closures, forces = [*parts.closures, *closures], [*parts.forces, *forces]
    else:
        model = with_joint_changes(model_from_urdf(inside(folder, "robot.urdf")), changes, path)
    set_gravity(own.get("gravity"), model, path)
    if independent is None:
        independent = settings.get("name_mot")
        if independent is not None and not _is_list_of_str(independent):
            raise ModelError(f"{path}: name_mot must be a list of joint names, not {shown(independent)}")
        if independent is None and closures:
            raise ModelError(
                f"{path}: name_mot is missing; list the joints that serve as minimal coordinates, or give "
                f"independent='auto'; the model's joints are {', '.join(list(model.names)[1:])}"
            )
    home = base if base is not None and own.get("home") is None else home_of(own.get("home"), model, path)
    try:
        mechanism = Mechanism.from_pinocchio(model, closures, independent, home, folder.name, forces)
    except RobustGcpError as error:
        error.args = (f"{path}: {error.args[0]}", *error.args[1:])
        raise
    if own.get("home") is not None:
        mechanism.require_closed(mechanism.home, NEARLY_CLOSED, f"{path}: home")
        mechanism.home = mechanism.polish(mechanism.home, mechanism.iv_dependent)
    if own.get("recommended") is not None:
        mechanism.recommended = recommended_of(own, mechanism, path)
    return mechanism


def _settings(path: Path) -> dict[str, Any]:
    settings = parsed_yaml(path)
    unknown = [key for key in settings if key not in KEYS]
    for key in KEYS:
        near = [] if key in settings else difflib.get_close_matches(key, map(str, unknown), n=1, cutoff=ALIKE)
        if near:
            raise ModelError(f"{path}: {shown(near[0])} is not a key that is read; did you mean {key!r}?")
    return settings


def _closures(settings: dict[str, Any], path: Path) -> list[Closure]:
    pairs = settings.get("closed_loop") or []
    kinds = settings.get("type") or []
    if not isinstance(pairs, list) or not all(_is_list_of_str(p) and len(p) == 2 for p in pairs):
        raise ModelError(f"{path}: closed_loop must be a list of pairs of frame names, not {shown(pairs)}")
    known = {kind.kind: kind for kind in closure_kinds()}
    if not _is_list_of_str(kinds) or len(kinds) != len(pairs):
        raise ModelError(f"{path}: type must list one of {', '.join(known)} for each of {len(pairs)} loops")
    unknown = [kind for kind in kinds if kind.lower() not in known]
    if unknown:
        raise ModelError(f"{path}: type {shown(unknown[0])} is unknown; use one of {', '.join(known)}")
    return [known[kind.lower()](*pair) for pair, kind in zip(pairs, kinds, strict=True)]


def _is_list_of_str(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
