"""Whether the runs of a sweep go to the compiled kernel, which lets threads compute at the same time."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from ..dynamics.tableau import Tableau
from ..errors import OptionError
from ..kernel.library import backends
from ..kernel.simulation.steps import chosen_library
from ..simulation.simulate import simulate

CHOICES = ("backend", "method", "newton_start")
"""Parameters of `simulate` that decide who takes the steps, in the order of `chosen_library`."""

_DEFAULTS = {name: inspect.signature(simulate).parameters[name].default for name in CHOICES}


def runs_natively(parameters: Mapping[str, Any]) -> bool:
    """Whether the kernel is there and is asked to take this run's steps, without calls back to Python."""
    choices = [parameters.get(name, _DEFAULTS[name]) for name in CHOICES]
    if not all(isinstance(choice, str) for choice in choices) or _calls_back(parameters):
        return False
    stepper = parameters.get("stepper", "rk4")
    if stepper != "rk4" and not isinstance(stepper, Tableau):  # SciPy's solvers are Python
        return False
    if not backends()["native"].available:  # asked first: to look for a broken kernel would warn
        return False
    try:
        return chosen_library(*choices) is not None
    except OptionError:  # the run will say so itself
        return False


def _calls_back(parameters: Mapping[str, Any]) -> bool:
    """Whether loads are Python functions, as wrenches are: they turn with the motion; or motions are."""
    torque = parameters.get("torque")
    loads = torque.values() if isinstance(torque, Mapping) else (torque,)
    return any(map(callable, loads)) or bool(parameters.get("wrenches") or parameters.get("drive"))
