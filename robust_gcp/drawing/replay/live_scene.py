"""A mechanism as meshcat's commands: cylinders and balls, and where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import umsgpack  # type: ignore[import-untyped, import-not-found, unused-ignore]
from meshcat import geometry
from meshcat.commands import SetObject, SetProperty, SetTransform
from meshcat.path import Path

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...simulation.trajectories.trajectory import Trajectory
from ..skeleton import placements
from .data import link_radius, scene_data
from .frames import pictures
from .geometry import sticks

COLOURS = (0x0072B2, 0xD9822B, 0x009E73, 0xA8508B, 0x3F8FC4, 0x8A7A00, 0xB5442E, 0x5B5EA6)
GROUND, PIN = 0x8A939C, 0x20262D

DISTANCE = 0.8
"""From the camera to the middle of the scene, in sizes of the scene: meshcat's camera sees 75°."""

CAMERA = "Cameras/default/rotated/<object>"
"""Path of the camera in meshcat's tree."""


class LiveScene:
    """What meshcat draws of a mechanism.

    Parameters
    ----------
    shown : Mechanism or Trajectory
        A trajectory's whole motion fits the picture.
    """

    def __init__(self, shown: Mechanism | Trajectory) -> None:
        if isinstance(shown, Mechanism):
            self.mechanism, q = shown, shown.home[None]
        else:
            self.mechanism = shown.mechanism
            q = pictures(shown, _coarse(shown))
        R, p = placements(self.mechanism, q)
        self._made = sticks(self.mechanism, R, p, None)
        positions = self._made.positions(R, p)
        self._radius = link_radius(self._made, positions)
        low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
        self._size = float(np.linalg.norm(high - low)) or 1.0
        look = scene_data(self.mechanism, [positions], None)
        view, up = np.array(look["view"]), np.array(look["up"])
        up = up - view * (view @ up) if abs(view @ up) < 0.3 else up
        # meshcat orbits its origin, z up: the middle of the scene goes there, our up to z
        level = np.cross(up, np.cross(view, up))
        level /= np.linalg.norm(level)
        self._turn = np.array([level, np.cross(up, level), up])
        self._middle = 0.5 * (low + high)
        self._camera = DISTANCE * self._turn @ view

    def commands(self) -> list[bytes]:
        """Build the scene, in meshcat's wire format."""
        made: list[Any] = [
            SetProperty("top_color", [1.0, 1.0, 1.0], _path("Background")),
            SetProperty("bottom_color", [0.93, 0.95, 0.97], _path("Background")),
            SetProperty("visible", False, _path("Grid")),
            SetProperty("visible", False, _path("Axes")),
        ]
        for name, _, _, radius, colour in self._sticks():
            material = geometry.MeshLambertMaterial(color=colour)
            made.append(SetObject(geometry.Cylinder(1.0, radius / self._size), material, _path(name)))
        for name, _ in self._balls():
            material = geometry.MeshLambertMaterial(color=PIN)
            made.append(SetObject(geometry.Sphere(1.3 * self._radius / self._size), material, _path(name)))
        x, y, z = self._camera
        camera = SetProperty("position", [float(x), float(z), float(-y)], _path(CAMERA))
        return [umsgpack.packb(command.lower()) for command in [*made, camera]]

    def poses(self, q: Array) -> dict[str, bytes]:
        """Where every part is at q (nq,), by name, in meshcat's wire format."""
        R, p = placements(self.mechanism, q[None])
        at = (self._made.positions(R, p)[0] - self._middle) @ self._turn.T / self._size
        found = {}
        for name, a, b, _, _ in self._sticks():
            found[name] = _stick(at[a], at[b])
        for name, i in self._balls():
            found[name] = np.eye(4)
            found[name][:3, 3] = at[i]
        return {name: umsgpack.packb(SetTransform(T, _path(name)).lower()) for name, T in found.items()}

    def _sticks(self) -> list[tuple[str, int, int, float, int]]:
        """Name, ends, radius (m) and colour."""
        made, r = self._made, self._radius
        sticks = [(a, b, 0.5 * r if body == 0 else r, body) for a, b, body in made.links]
        sticks += [(a, b, 0.5 * r, body) for a, b, body in made.slides]
        sticks += [(a, b, 0.35 * r, 0) for a, b, _, _ in made.rails]
        return [
            (f"mechanism/stick{i}", a, b, radius, COLOURS[(body - 1) % len(COLOURS)] if body else GROUND)
            for i, (a, b, radius, body) in enumerate(sticks)
        ]

    def _balls(self) -> list[tuple[str, int]]:
        points = [i for i, _, _ in self._made.pins] + [i for _, _, i, _ in self._made.rails]
        return [(f"mechanism/ball{k}", i) for k, i in enumerate(points)]


def _path(name: str) -> Any:
    return Path(tuple(name.split("/")))


def _coarse(trajectory: Trajectory) -> float:
    """A speed at which the whole motion is some hundred pictures: enough to find its size."""
    return max(float(np.ptp(trajectory.t)) / 10.0, 1e-12) if len(trajectory.t) else 1.0


def _stick(a: Array, b: Array) -> Array:
    """The map of meshcat's unit cylinder, along y about the origin, onto the one from a to b."""
    along = b - a
    length = float(np.linalg.norm(along))
    y = along / length if length > 0.0 else np.eye(3)[1]
    x = np.cross(y, np.eye(3)[np.argmin(np.abs(y))])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, length * y, np.cross(x, y), 0.5 * (a + b)
    return T
