"""MJCF (MuJoCo XML) to a spanning tree with closures, by MuJoCo's own compiler."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...checks import shown
from ...errors import ModelError, OptionError
from ...mechanism.contents import FileContents, check_base
from ..names import all_named
from ..text_file import path_of
from ..xml_text import is_xml_text, parsed_xml
from .actuators import CompiledActuators
from .compiled import compiled
from .document import Document
from .equalities import equalities_of
from .left_out import actuated_by, forces_of, left_out_of
from .sensors import sensors_of
from .stops import restitution_of
from .tendons import CompiledTendons
from .tree import CompiledTree


def read_mjcf(
    mjcf: str | Path,
    base: str | None = None,
    root: str | Path | None = None,
    moving: Mapping[str, Sequence[str]] | None = None,
) -> FileContents:
    """What a MJCF file describes: spanning tree, loops and couplings, springs and dampers of joints.

    MuJoCo compiles the file: its defaults, frames, replicates, attachments and inertias are MuJoCo's. Of its
    model bodies, joints (`hinge`, `slide`, `ball`, `free`), masses, armature, joint stiffness and damping,
    gravity, and of equalities `connect`, `weld`, `joint` and `tendon` (fixed ones) are simulated. Equality
    constraints are rigid whatever their `solref` says. Home is qpos0, where every `connect` of two bodies is
    closed by definition; bodies and sites are frames of the same name (NAME_site where a body elsewhere has
    it). Actuators, tendons, keyframes and the sensors that rigid bodies answer are read, limits and dry
    friction for `load`. Contacts, other sensors, plugins, flexible parts, drag and springs of free joints are
    left out and listed, mocap bodies stand still but those in `moving`. Files of meshes are read where a mass
    comes from them, other shapes and pictures never.

    Parameters
    ----------
    mjcf : str or Path
        A file, or the XML text itself.
    base : "fixed", "free" or None
        "fixed": bodies with a free joint are fixed where they are at qpos0. "free": the body that stands on
        the ground floats.
    root : str or Path, optional
        A folder besides the file's own that holds files which it includes, attaches or takes meshes from.
    moving : mapping of str to sequence of str, optional
        Bodies that stand on the ground, mocap bodies among them, and the axes x, y, z, rx, ry, rz that they
        are moved along and about, one after the other: `{"table": ("x", "rz")}` makes the joints table_x and
        table_rz, which `drive=` prescribes and which hold still else.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy, in MuJoCo's words where MuJoCo refuses the file.
    MissingExtraError
        Without MuJoCo.
    """
    check_base(base)
    _check_moving(base, moving)
    allowed = None if root is None else path_of(root, "root")
    if allowed is not None and not allowed.is_dir():
        raise ModelError(f"root: there is no folder {allowed}; name one that holds meshes or includes")
    xml, name = parsed_xml(mjcf, "MJCF")
    source = Document(xml, name, None if is_xml_text(mjcf) else Path(mjcf).parent, allowed)
    m = compiled(source, base == "free")
    tree = CompiledTree(m, name, base, moving)
    if tree.model.njoints == 1:
        raise ModelError(f"{name}: no body has a joint; a mechanism needs one at least")
    tree.model.name = xml.get("model", "mjcf")
    names = all_named([m.key(k).name for k in range(m.nkey)], [f"key{k}" for k in range(m.nkey)], 0, "_")
    keys = {name: tree.configuration(m.key_qpos[k]) for k, name in enumerate(names)}
    rated = {name: k for k, name in enumerate(names) if np.any(m.key_qvel[k])}
    rates = {name: tree.velocity(m.key_qpos[k], m.key_qvel[k]) for name, k in rated.items()}
    tendons = CompiledTendons(m, tree)
    closures = equalities_of(m, tree, tendons, xml)
    drives = CompiledActuators(m, tree, tendons)
    sensors, unanswered = sensors_of(m, tree, tendons, drives, bool(source.meshes))
    source.told.setdefault("sensors", []).extend(unanswered)
    return FileContents(
        tree.model,
        closures,
        [*forces_of(m, tree), *tendons.springs, *drives.springs],
        tree.home,
        keys,
        actuated=actuated_by(m, tree, tendons),
        left_out=left_out_of(m, tree, drives.left_out | tendons.left_out | source.told),
        actuators=drives.actuators,
        tendons=tendons.by_name,
        parts=tendons.parts,
        bounce={label: restitution_of(m.jnt_solref[j]) for j, label in enumerate(tree.joints)},
        velocities=rates,
        sensors=sensors,
        moved=tuple(tree.moved),
    )


def _check_moving(base: str | None, moving: Any) -> None:
    """Refuse what is no mapping of names to lists of axes."""
    if moving is None:
        return
    lists = list(moving.values()) if isinstance(moving, Mapping) else [None]
    if not all(isinstance(axes, (list, tuple)) and all(isinstance(a, str) for a in axes) for axes in lists):
        raise OptionError(f'moving = {shown(moving)} must be such as {{"table": ("x", "rz")}}')
    if base == "free":
        raise OptionError("moving: a body that is moved stands on the ground; leave out base='free'")
