"""MJCF's compiler settings and options: frames that cannot be read are refused by name."""

from __future__ import annotations

import numpy as np

from ...errors import ModelError
from ..tree import Array
from .mjcf_parts import Element, vector, words

IN_FULL = "let MuJoCo write the model out in full (mujoco.mj_saveLastXML after loading it) and load that file"
REFUSED_COMPILER = {
    "coordinate": ("local", IN_FULL),
    "alignfree": ("false", "leave it out: it moves the frame of a floating body"),
}

STANDARD = np.array([0.0, 0.0, -9.81])
"""Gravity where the file says nothing, m/s²."""


def check_compiler(compiler: dict[str, str], name: str) -> None:
    """A ModelError for a setting that would change frames."""
    for key, (harmless, remedy) in REFUSED_COMPILER.items():
        value = compiler.get(key, harmless)
        if value.split() != harmless.split() and not (value == "0" and harmless == "false"):
            raise ModelError(f"{name}: compiler {key}={value!r} cannot be read; {remedy}")


def gravity_of(root: Element, name: str) -> Array:
    """Gravity, m/s²."""
    gravity: Array = STANDARD
    for option in root.findall("option"):
        if option.get("gravity"):
            gravity = vector(option, "gravity", 3, name)
    return np.zeros(3) if "gravity" in disabled(root) else gravity


def disabled(root: Element) -> set[str]:
    """Parts of the simulation that the options switch off."""
    flags = [flag for option in root.findall("option") for flag in option.findall("flag")]
    return {key for flag in flags for key, value in flag.attrib.items() if value == "disable"}


def drag_of(root: Element, name: str) -> list[str]:
    """Options of a medium that moves or resists, where they are not zero."""
    keys = ("density", "viscosity", "wind")
    return [key for key in keys for option in root.findall("option") if words(option, key, name).any()]
