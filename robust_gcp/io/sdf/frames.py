"""Numbers of SDF, and where its frames are: poses relative to one another, resolved."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...checks import hint
from ...errors import ModelError
from ...mechanism.building.bodies import WORLD
from ...mechanism.tree.tree import Array
from ..urdf.numbers import finite_numbers

MODEL = "__model__"


def numbers_of(text: str | None, count: int, where: str) -> list[float]:
    """So many finite numbers, or a ModelError."""
    values = finite_numbers(text or "", count)
    if values is None:
        raise ModelError(f"{where} is {text!r}; write {count} finite number{'s' * (count > 1)}")
    return values


def number_of(parent: Element | None, path: str, default: float, where: str) -> float:
    """The number of an element below another one."""
    element = None if parent is None else parent.find(path)
    return default if element is None else numbers_of(element.text, 1, f"{where}: <{path}>")[0]


def pose_of(element: Element | None, where: str) -> pin.SE3:
    """<pose>: x y z, then roll pitch yaw or a quaternion x y z w."""
    if element is None or not (element.text or "").strip():
        return pin.SE3.Identity()
    if element.get("rotation_format") == "quat_xyzw":
        values = numbers_of(element.text, 7, f"{where}: <pose>")
        if not np.any(values[3:]):
            raise ModelError(f"{where}: <pose> has the quaternion zero; give one of norm 1")
        turn = pin.Quaternion(np.array(values[3:])).normalized().toRotationMatrix()
    else:
        values = numbers_of(element.text, 6, f"{where}: <pose>")
        unit = np.pi / 180.0 if element.get("degrees") in ("true", "1") else 1.0
        turn = pin.rpy.rpyToMatrix(*(unit * np.array(values[3:])))
    return pin.SE3(turn, np.array(values[:3]))


@dataclass
class Placed:
    """A frame: its pose in another one, and what it is fixed to; a link is fixed to itself."""

    relative_to: str
    pose: pin.SE3
    attached_to: str


class Frames:
    """Frames by name, with `::` between the names of models within one another."""

    def __init__(self, name: str) -> None:
        self._name, self._placed = name, dict[str, Placed]()
        self._placed[WORLD] = Placed("", pin.SE3.Identity(), "")

    def add(self, label: str, relative_to: str, pose: pin.SE3, attached_to: str) -> None:
        """Place a frame; a ModelError where the name is taken."""
        if label in self._placed:
            raise ModelError(f"{self._name}: two frames are called {label!r}; rename one of them")
        self._placed[label] = Placed(relative_to, pose, attached_to)

    def world(self, label: str, where: str) -> pin.SE3:
        """Where a frame is in the world."""
        place = pin.SE3.Identity()
        for one in self._way(label, "relative_to", where):
            place = self._placed[one].pose * place
        return place

    def body(self, label: str, where: str) -> str:
        """The link that a frame is fixed to, or the ground."""
        return self._way(label, "attached_to", where)[-1]

    def turn(self, label: str, where: str) -> Array:
        """How a frame is turned in the world."""
        return np.asarray(self.world(label, where).rotation)

    def _way(self, label: str, key: str, where: str) -> list[str]:
        """From a frame by the one that it names to the last."""
        way: list[str] = []
        if not label:
            raise ModelError(f"{where} names no frame; name one")
        while label:
            if label not in self._placed:
                near = hint(label, self._placed)
                raise ModelError(f"{where} names {label!r}, which is not there{near}")
            if label in way:
                raise ModelError(
                    f"{self._name}: {' – '.join([*way, label])} name each other in a circle; cut it"
                )
            way.append(label)
            label = getattr(self._placed[label], key)
        return way
