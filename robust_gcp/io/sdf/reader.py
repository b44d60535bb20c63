"""SDF (Gazebo, Drake) to a spanning tree with closures."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ...errors import ModelError, ModelWarning
from ...mechanism.building.bodies import WORLD
from ...mechanism.building.body_graph import spanned
from ...mechanism.contents import FileContents, check_base, named
from ...warning import warn
from ..xml_text import parsed_xml
from .frames import numbers_of
from .model import ModelReader

OPEN = re.compile(r"bushing|closing|closed_?loop|loop_?closure", re.I)
"""Words in the names of frames where a program closes a loop."""

GRAVITY = "0 0 -9.8"
"""m/s², of a world that does not say."""


def read_sdf(sdf: str | Path, base: str | None = None, root: str | Path | None = None) -> FileContents:
    """What an SDF file describes: one model, with models within it, its links, joints and frames.

    Poses by `relative_to`, `attached_to` and `expressed_in`, axes of older versions by
    `use_parent_model_frame`. Home is the pose that is drawn. A second joint that carries a link closes a loop
    and becomes the closure of its type; `drake:ball_constraint` and `drake:weld_constraint` too. Where a
    joint names a frame as its parent that is not where it is, this is told, and if nothing draws the joint
    and its child elsewhere, the two are brought together. A model that nothing ties to the world floats.
    Gravity is the world's, and (0, 0, −9.81) m/s² without a world.
    Links without <inertial> weigh 1 kg and have moments of 1 kg m², as SDF has it.

    Parameters
    ----------
    sdf : str or Path
        A file, or the XML text itself.
    base : "fixed", "free" or None
        "fixed": the first link of what floats is held where it is drawn.
    root : str or Path, optional
        Of no meaning: the file names no others that are read.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    check_base(base)
    document, name = parsed_xml(sdf, "SDF")
    if document.tag != "sdf":
        raise ModelError(f"{name}: the root element is <{document.tag}>, an SDF file starts with <sdf>")
    if document.find(".//include") is not None:
        raise ModelError(
            f"{name}: <include> names other models, which are not read; write them into the file"
        )
    # what stands still is scenery: worlds begin with a ground plane
    models = [m for m in (*document.findall("model"), *document.findall("world/model")) if not _is_static(m)]
    if len(models) != 1:
        found = ", ".join(repr(m.get("name")) for m in models) or "none that moves"
        raise ModelError(f"{name}: it has {len(models)} models ({found}); leave the one that is meant")
    gravity = np.array([0.0, 0.0, -9.81])
    if document.find("world") is not None:
        gravity = np.array(numbers_of(document.findtext("world/gravity", GRAVITY), 3, f"{name}: <gravity>"))
    reader = ModelReader(name)
    reader.place(models[0], "", WORLD)
    reader.read(models[0], "")
    reader.tie_gears()
    contents = spanned(models[0].get("name") or "sdf", reader.bodies, reader.joints, gravity, base)
    _tell_apart(name, reader.apart)
    _require_closed(models[0], name, contents)
    contents.closures += reader.couplings
    for kind, where in reader.left_out.items():
        contents.left_out += named(kind, where)
    return contents


def _tell_apart(name: str, apart: list[str]) -> None:
    """Warn of joints that are not where the frames are that they name as parents."""
    if apart:
        warn(
            f"{name}: frames that joints name as parents are not where these are: {', '.join(apart)}; SDF "
            "has a joint where its own <pose>, or its child's, has it",
            ModelWarning,
        )


def _require_closed(model: Element, name: str, contents: FileContents) -> None:
    """Refuse a tree whose frames tell that a program closes it."""
    cut = [f.get("name", "") for f in model.findall("frame") if OPEN.search(f.get("name", ""))]
    if len(cut) > 1 and not contents.closures:
        raise ModelError(
            f"{name}: the frames {' and '.join(map(repr, cut[:2]))} are named as ends of a loop that was "
            "cut, and nothing closes it; add a joint between them"
        )


def _is_static(model: Element) -> bool:
    return (model.findtext("static") or "").strip() in ("true", "1")
