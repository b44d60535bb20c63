"""MuJoCo's compiler: a MJCF document to its mjModel, files of meshes read only where a mass needs them."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np

from ...errors import ModelError, missing_extra
from .document import Document

BEFORE = {"SPRING": "PASSIVE", "DAMPER": "PASSIVE"}
"""What older versions have in place of a flag."""


def is_off(m: Any, what: str) -> bool:
    """Whether `<flag what="disable"/>` is set."""
    import mujoco

    flags = mujoco.mjtDisableBit.__members__
    flag = flags.get(f"mjDSBL_{what}", flags.get(f"mjDSBL_{BEFORE.get(what, what)}"))
    return flag is not None and bool(m.opt.disableflags & int(flag))


SIZES = (1.0, 1.5)
"""Of tetrahedra in place of meshes, m: what differs between the two depends on a mesh."""

FINITE = (
    *("body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "jnt_pos", "jnt_axis"),
    *("dof_armature", "site_pos", "site_quat", "eq_data", "qpos0", "key_qpos", "key_qvel"),
    *("cam_pos", "cam_quat", "geom_pos", "geom_quat", "sensor_cutoff", "jnt_margin"),
    "tendon_margin",
)
"""Parts of mjModel that are checked."""

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
        unknown = _unknown(models, floats)
        if not unknown:
            break
    else:
        models = _without_masses(document, unknown, floats)
        document.told["masses of meshes on bodies"] = unknown
    for key in FINITE:
        if not np.all(np.isfinite(getattr(models[0], key))):
            raise ModelError(f"{document.name}: {key} is not finite once it is compiled; correct its numbers")
    return models[0]


def _unknown(models: list[Any], floats: bool) -> list[str]:
    """Moving bodies whose masses, centres or inertias differ between the models."""
    columns = [np.hstack([m.body_mass[:, None], m.body_ipos, m.body_iquat, m.body_inertia]) for m in models]
    # NaN, which is refused afterwards, would differ from itself
    differ = np.any(np.nan_to_num(columns[0]) != np.nan_to_num(columns[-1]), axis=1)
    still = (models[0].body_weldid == 0) | (models[0].body_mocapid[models[0].body_weldid] >= 0)
    return [models[0].body(int(b)).name or "unnamed" for b in np.flatnonzero(differ & (floats | ~still))]


def _without_masses(document: Document, unknown: list[str], floats: bool) -> list[Any]:
    """The models where absent meshes weigh nothing; a ModelError where a body has no other mass."""
    absent, reason = document.absent(), None
    try:
        models = [_compiled(document, size, True, tuple(absent)) for size in SIZES]
        if not _unknown(models, floats):
            return models
    except ModelError as error:
        reason = error
    lost = ", ".join(f"{mesh!r} ({why})" for mesh, why in list(absent.items())[:5])
    raise ModelError(
        f"{document.name}: the mass of {', '.join(map(repr, unknown[:5]))} comes from meshes that cannot be "
        f"read: {lost}; put them there, name their folder by root=, or give an <inertial>"
    ) from reason


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
            spec.compiler.LRopt.mode = 0  # no simulation for the lengths of muscles, which may never end
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
