"""Parts of MJCF: what is kept of a file, default classes, and the many ways to write an orientation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ..tree import Array

Element = ElementTree.Element

TURNED = frozenset(("quat", "axisangle", "euler", "xyaxes", "zaxis"))
"""Ways to write an orientation: one of an element's own replaces that of its class."""

PARALLEL = 1e-9
"""Sine of the angle between two axes below which they do not span a plane."""


@dataclass
class Site:
    """A site: the body that it is fixed to, and where."""

    body: str
    place: pin.SE3


@dataclass
class Reduced:
    """What a MJCF file says, in the parts that a mechanism needs.

    Attributes
    ----------
    xml : str
        Text for Pinocchio's parser.
    bodies, joints : list of str
        Names, in the order of the file.
    free : dict of str to pin.SE3
        Pose of each floating body, by its joint.
    sites : dict of str to Site
    equalities : list of Element
        Active equality constraints, defaults resolved.
    springs : list of (joint, stiffness, rest)
    dampers : list of (joint, damping)
    oscillators : list of (joint, time constant, damping ratio, rest)
        Springs and dampers that are given so.
    ranges : dict of str to (lowest, highest)
        Of limited joints with one number, rad or m.
    tendons : dict of str to list of (joint, coefficient)
        The fixed ones.
    unread : dict of str to list of str
        What is not simulated, a kind each, and where it is.
    left_out : list of str
        Other parts that are not simulated.
    gravity : ndarray (3,)
        m/s².
    """

    xml: str = ""
    bodies: list[str] = field(default_factory=list)
    joints: list[str] = field(default_factory=list)
    free: dict[str, pin.SE3] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    equalities: list[Element] = field(default_factory=list)
    springs: list[tuple[str, float, float]] = field(default_factory=list)
    dampers: list[tuple[str, float]] = field(default_factory=list)
    oscillators: list[tuple[str, float, float, float]] = field(default_factory=list)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    tendons: dict[str, list[tuple[str, float]]] = field(default_factory=dict)
    unread: dict[str, list[str]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))

    def leave_out(self, kind: str, where: str) -> None:
        """Take note of a part that is not simulated."""
        self.unread.setdefault(kind, []).append(where)


class Defaults:
    """The default classes of a document: each inherits its parent's attributes."""

    def __init__(self, root: Element, name: str) -> None:
        self._name = name
        self._classes: dict[str, dict[str, dict[str, str]]] = {"": {}}
        for section in root.findall("default"):
            self._read(section, "", "")
            if section.get("class"):  # the top class may have a name and applies everywhere all the same
                self._classes[section.get("class", "")] = self._classes[""]

    def resolved(self, element: Element, inherited: str, kind: str = "") -> Element:
        """A copy with every attribute that its class, or the inherited one, gives by default.

        Parameters
        ----------
        inherited : str
            The nearest `childclass`; an element's own class replaces it as a whole.
        kind : str
            Whose defaults apply; the element's tag unless given.
        """
        name = element.get("class", inherited)
        if name not in self._classes:
            raise ModelError(f"{self._name}: <{element.tag}> is of class {name!r}, which <default> lacks")
        given = self._classes[name].get(kind or element.tag, {})
        if not TURNED.isdisjoint(element.attrib):
            given = {key: value for key, value in given.items() if key not in TURNED}
        return ElementTree.Element(element.tag, given | element.attrib)

    def _read(self, section: Element, parent: str, name: str) -> None:
        known = dict(self._classes[parent])
        for item in section:
            if item.tag != "default":
                known[item.tag] = known.get(item.tag, {}) | item.attrib
        self._classes[name] = known
        for item in section.findall("default"):
            inner = item.get("class")
            if not inner:
                raise ModelError(f"{self._name}: a nested <default> has no class; name it")
            self._read(item, name, inner)


def flag(element: Element, key: str, default: bool) -> bool:
    """A true/false attribute."""
    return element.get(key, str(default).lower()) in ("true", "1")


def number(element: Element, key: str, where: str, default: float = 0.0) -> float:
    """A finite number, or a ModelError."""
    return float(vector(element, key, 1, where, (default,))[0])


def text_of(values: Iterable[float]) -> str:
    """Numbers as an attribute: all digits."""
    return " ".join(repr(float(value)) for value in values)


def words(element: Element, key: str, where: str) -> Array:
    """However many finite numbers an attribute holds; one zero where it is absent."""
    return vector(element, key, len(element.get(key, "0").split()), where, (0.0,))


def vector(
    element: Element, key: str, size: int, where: str, default: Sequence[float] | None = None
) -> Array:
    """As many finite numbers as `size` says, or a ModelError."""
    text = element.get(key)
    if text is None and default is not None:
        return np.array(default, dtype=float)
    try:
        values = np.array([float(x) for x in (text or "").split()])
    except ValueError as error:
        raise ModelError(f"{where}: {key}={text!r} is not {size} number(s)") from error
    if values.shape != (size,) or not np.all(np.isfinite(values)):
        raise ModelError(f"{where}: <{element.tag}> needs {size} finite number(s) in {key}, not {text!r}")
    return values


def direction(values: Array, where: str, key: str) -> Array:
    """The values divided by their norm, or a ModelError where they have none to speak of."""
    size = math.hypot(*values.tolist())
    if not 1e-100 < size < 1e100:
        raise ModelError(f"{where}: {key} {values.tolist()} is no direction; give one of about unit length")
    return values / size


def placement(element: Element, radians: bool, sequence: str, where: str) -> pin.SE3:
    """`pos` with quat, axisangle, euler, xyaxes or zaxis; the identity where they are absent.

    Parameters
    ----------
    radians : bool
        Whether angles are in radians.
    sequence : str
        Euler axes: lower case turn with the body, upper case in the parent.
    """
    place = pin.SE3.Identity()
    place.translation = vector(element, "pos", 3, where, (0.0, 0.0, 0.0))
    unit = 1.0 if radians else math.pi / 180.0
    if element.get("quat"):
        w, x, y, z = direction(vector(element, "quat", 4, where), where, "quat")
        place.rotation = pin.Quaternion(float(w), float(x), float(y), float(z)).toRotationMatrix()
    elif element.get("axisangle"):
        turn = vector(element, "axisangle", 4, where)
        place.rotation = pin.exp3(direction(turn[:3], where, "axisangle") * float(turn[3]) * unit)
    elif element.get("euler"):
        R = np.eye(3)
        if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
            raise ModelError(f"{where}: eulerseq {sequence!r} must be three of x, y, z, X, Y, Z")
        for letter, angle in zip(sequence, vector(element, "euler", 3, where) * unit, strict=True):
            turned = pin.exp3(np.eye(3)["xyz".index(letter.lower())] * angle)
            R = R @ turned if letter.islower() else turned @ R
        place.rotation = R
    elif element.get("xyaxes"):
        axes = vector(element, "xyaxes", 6, where)
        x, y = (direction(part, where, "xyaxes") for part in (axes[:3], axes[3:]))
        y = y - x * float(x @ y)
        if np.linalg.norm(y) < PARALLEL:
            raise ModelError(f"{where}: xyaxes={element.get('xyaxes')!r} are parallel; give two directions")
        y /= np.linalg.norm(y)
        place.rotation = np.column_stack([x, y, np.cross(x, y)])
    elif element.get("zaxis"):
        z = direction(vector(element, "zaxis", 3, where), where, "zaxis")
        place.rotation = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z).toRotationMatrix()
    return place
