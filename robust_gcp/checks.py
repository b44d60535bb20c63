"""Checks of what a caller hands over: each error names the argument, its value and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from .errors import ModelError, OptionError


def check_number(name: str, value: Any) -> None:
    """Refuse what is not a real number; NaN and infinity pass."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise OptionError(f"{name} = {value!r} must be a number")


def check_positive(name: str, value: Any) -> None:
    """Refuse what is not a positive, finite number."""
    check_number(name, value)
    if not np.isfinite(value) or value <= 0.0:
        raise OptionError(f"{name} = {value} must be positive and finite")


def check_between(name: str, value: Any, low: float, high: float) -> None:
    """Refuse what is not a number in the open interval (low, high)."""
    check_number(name, value)
    if not low < value < high:
        raise OptionError(f"{name} = {value} must lie between {low:g} and {high:g}")


def check_choice(name: str, value: Any, allowed: Sequence[str]) -> None:
    """Refuse what is not one of the words allowed."""
    if not isinstance(value, str) or value not in allowed:
        raise OptionError(f"{name} = {value!r} is unknown; use one of {', '.join(allowed)}")


def check_mechanism(value: Any, kind: type[Any], function: str) -> None:
    """Refuse a model's name or a `pin.Model` where a mechanism (of type `kind`) is needed."""
    if isinstance(value, kind):
        return
    if isinstance(value, str):
        remedy = f"{value!r} is a name: give robust_gcp.load({value!r})"
    elif isinstance(value, pin.Model):
        remedy = "a pinocchio Model has no closures yet: give Mechanism.from_pinocchio(model, ...)"
    else:
        remedy = f"not {type(value).__name__}: give what robust_gcp.load(...) returns"
    raise OptionError(f"{function} needs a Mechanism; {remedy}")


def listed(value: Any, what: str, items: str) -> list[Any]:
    """The items of a list, or a ModelError where one item was given without its list."""
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        hint = f"; write [{value!r}]" if value is not None and not isinstance(value, Mapping) else ""
        raise ModelError(f"{what} must be a list of {items}, not {value!r}{hint}")
    return list(value)


def check_model(model: Any) -> None:
    """Refuse what is not a `pin.Model`, and a model with masses or placements that are not finite.

    Raises
    ------
    ModelError
        Naming the joint that carries the body.
    """
    if not isinstance(model, pin.Model):
        what = repr(model) if model is None or isinstance(model, str) else type(model).__name__
        raise ModelError(
            f"model: {what} is not a pin.Model; use robust_gcp.load(...) for a shipped model or a folder, "
            "Mechanism.from_urdf(...) for a URDF file"
        )
    for name, inertia, placement in zip(model.names, model.inertias, model.jointPlacements, strict=True):
        if not np.all(np.isfinite(inertia.toDynamicParameters())):
            raise ModelError(
                f"the body that joint {name!r} carries has mass {inertia.mass:g} kg and centre "
                f"{inertia.lever.tolist()} m: mass, centre and inertia must be finite"
            )
        if not np.all(np.isfinite(placement.homogeneous)):
            raise ModelError(
                f"joint {name!r} has a placement that is not finite; correct model.jointPlacements"
            )
