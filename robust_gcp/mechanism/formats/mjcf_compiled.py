"""MuJoCo's compiler: a MJCF document to its mjModel, files of meshes read only where a mass needs them."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np

from ...errors import ModelError, missing_extra
from ..tree import Array
from .mjcf_document import Document

SIZES = (1.0, 1.5)
"""Of tetrahedra in place of meshes, m: what differs between the two depends on a mesh."""

FINITE = ("body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "eq_data", "qpos0", "key_qpos")
"""Parts of mjModel that are checked; joints are by what is made of them."""

MASSLESS = "write 1e-12 in place of zero, or add a <geom> to the body"
"""What helps where MuJoCo asks for a mass and three moments of inertia."""


def compiled(document: Document, floats: bool) -> Any:
    """The mjModel; a mesh that no mass depends on is a tetrahedron there.

    Parameters
    ----------
    floats : bool
        Whether bodies that MuJoCo has standing on the ground may move.

    Raises
    ------
    ModelError
        With MuJoCo's own words, or naming the bodies whose masses come from meshes that are not there.
    MissingExtraError
        Without MuJoCo.
    """
    absent = document.absent()
    for with_files in (False, True):
        sizes = SIZES if document.meshes and (absent or not with_files) else SIZES[:1]
        try:
            models = [_compiled(document, size, with_files) for size in sizes]
        except ModelError:
            if with_files or len(absent) == len(document.meshes):
                raise
            continue
        unknown = np.any(_masses(models[0]) != _masses(models[-1]), axis=1)
        unknown &= floats | (models[0].body_weldid > 0)
        if not unknown.any():
            break
    else:
        names = [models[0].body(int(b)).name or "unnamed" for b in np.flatnonzero(unknown)]
        try:
            models = [_compiled(document, SIZES[0], True, tuple(absent))]
        except ModelError as error:
            lost = ", ".join(f"{mesh!r} ({why})" for mesh, why in list(absent.items())[:5])
            raise ModelError(
                f"{document.name}: the mass of {', '.join(map(repr, names[:5]))} comes from meshes that "
                f"cannot be read: {lost}; put them there, name their folder by root=, or give an <inertial>"
            ) from error
        document.told["masses of meshes on bodies"] = names
    for key in FINITE:
        if not np.all(np.isfinite(getattr(models[0], key))):
            raise ModelError(f"{document.name}: {key} is not finite once it is compiled; correct its numbers")
    return models[0]


def _masses(model: Any) -> Array:
    """Masses, centres and inertias, a row for each body."""
    columns = (model.body_mass[:, None], model.body_ipos, model.body_iquat, model.body_inertia)
    return np.nan_to_num(np.hstack(columns))


def _compiled(document: Document, filler: float, with_files: bool, massless: tuple[str, ...] = ()) -> Any:
    """The mjModel, without the masses of some meshes."""
    try:
        import mujoco
    except ImportError as error:
        raise missing_extra("MJCF is compiled by MuJoCo", "mujoco", "mjcf") from error
    text, include, assets = document.written(filler, with_files)
    told: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(told.append)  # else MuJoCo prints, and writes a log into the user's folder
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_string(text, include=include, assets=assets)
            for geom in spec.geoms if massless else ():
                if geom.meshname in massless:
                    geom.mass = 0.0
            model = spec.compile()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        words = " ".join(re.sub(r",? line \d+", "", str(error)).split())  # lines of our text, not of the file
        remedy = MASSLESS if "mjMINVAL" in words else "correct the file"
        raise ModelError(f"{document.name}: MuJoCo cannot compile it ({words}); {remedy}") from error
    finally:
        mujoco.set_mju_user_warning(before)
    if any("NaN" in line for line in told):
        raise ModelError(f"{document.name}: MuJoCo finds a number in it that is none (NaN); correct it")
    return model
