"""A model that was handed out to be read: nothing that follows from a mechanism would know of a change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import ModelError

CHANGEABLE = (
    *("gravity", "inertias", "jointPlacements", "armature", "joints", "frames", "nframes"),
    *("lowerPositionLimit", "upperPositionLimit", "damping", "friction", "names"),
)
"""Parts of a model that one may have changed, as an error names them."""


def require_equal(shown: pin.Model, own: pin.Model) -> None:
    """Refuse to go on where the model that was handed out is not the mechanism's own any more.

    Raises
    ------
    ModelError
        Naming what is no more as it was.
    """
    if shown == own:
        return
    changed = [what for what in CHANGEABLE if not _same(getattr(shown, what), getattr(own, what))]
    if not changed and own != own.copy():  # it holds what is no number, such as a limit, and equals nothing
        return
    raise ModelError(
        f"the model of this mechanism was changed ({', '.join(changed) or 'in other parts'}), which its "
        "motion would not know of; change a copy, model = mech.model.copy(), and make another mechanism: "
        "Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)"
    )


def _same(one: Any, other: Any) -> bool:
    """Whether two parts of models are equal: numbers, arrays, or Pinocchio's vectors of either."""
    if isinstance(one, np.ndarray):
        return bool(np.array_equal(one, other, equal_nan=True))
    if hasattr(one, "__len__"):
        return len(one) == len(other) and all(a == b for a, b in zip(one, other, strict=True))
    return bool(one == other)
