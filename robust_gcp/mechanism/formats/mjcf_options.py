"""MJCF's compiler settings and options: what changes the mechanism and is not read is refused by name."""

from __future__ import annotations

import numpy as np

from ...errors import ModelError
from ..tree import Array
from .mjcf_parts import Element, vector, words

IN_FULL = "let MuJoCo write the model out in full (mujoco.mj_saveLastXML after loading it) and load that file"
REFUSED_COMPILER = {
    "settotalmass": ("-1", "give the masses in full"),
    "boundmass": ("0", "give the masses in full"),
    "boundinertia": ("0", "give the inertias in full"),
    "coordinate": ("local", IN_FULL),
    "alignfree": ("false", "leave it out: it moves the frame of a floating body"),
}

STANDARD = np.array([0.0, 0.0, -9.81])
"""Gravity where the file says nothing, m/s²."""


def check_compiler(compiler: dict[str, str], name: str) -> None:
    """A ModelError for a setting that would change masses or frames."""
    for key, (harmless, remedy) in REFUSED_COMPILER.items():
        value = compiler.get(key, harmless)
        if value.split() != harmless.split() and not (value == "0" and harmless == "false"):
            raise ModelError(f"{name}: compiler {key}={value!r} cannot be read; {remedy}")


def group_range(compiler: dict[str, str], name: str) -> tuple[float, float]:
    """The first and the last group of geoms whose masses count."""
    given = Element("compiler", {"inertiagrouprange": compiler.get("inertiagrouprange", "0 5")})
    first, last = vector(given, "inertiagrouprange", 2, name).tolist()
    return first, last


def gravity_of(root: Element, name: str) -> Array:
    """Gravity, m/s², of the options, whose drag and switches are refused."""
    gravity: Array = STANDARD
    for option in root.findall("option"):
        if option.get("gravity"):
            gravity = vector(option, "gravity", 3, name)
        for key in ("density", "viscosity", "wind"):
            if words(option, key, name).any():
                raise ModelError(f"{name}: option {key} cannot be read; put drag into torque= and remove it")
        for switches in option.findall("flag"):
            if switches.get("gravity") == "disable":
                gravity = np.zeros(3)
            for key in ("equality", "spring", "damper", "passive", "constraint"):
                if switches.get(key) == "disable":
                    raise ModelError(
                        f"{name}: flag {key}='disable' cannot be read; remove the elements instead"
                    )
    return gravity
