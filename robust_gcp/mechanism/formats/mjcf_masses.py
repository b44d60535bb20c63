"""Masses and inertias of MJCF bodies: given, or from the solids of their geoms; bounded, balanced, rescaled.

As MuJoCo compiles them: `boundmass` and `boundinertia` first, then `balanceinertia` for moments that break
the triangle inequality, and `settotalmass` at the end, over all bodies, those of the ground included.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ..tree import Array
from .mjcf_frames import framed_ends
from .mjcf_parts import Defaults, Element, direction, flag, number, text_of, vector, words

SOLIDS = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
"""Shapes whose inertia is computed, and how many sizes each has."""

WATER = 1000.0
"""MuJoCo's density of a geom, kg/m³."""


@dataclass(frozen=True)
class Body:
    """Mass (kg), centre (3,) and inertia about it (3, 3), in one frame's axes."""

    mass: float
    centre: Array
    inertia: Array

    def placed(self, at: pin.SE3) -> Body:
        """The same where its frame is elsewhere."""
        R = np.asarray(at.rotation)
        return Body(self.mass, np.asarray(at.act(self.centre)), R @ self.inertia @ R.T)


def together(bodies: list[Body]) -> Body:
    """Several bodies as one, by Steiner's theorem; a sum without mass is at the origin."""
    mass = sum(body.mass for body in bodies)
    centre, inertia = np.zeros(3), np.zeros((3, 3))
    if mass != 0.0:
        centre = np.sum([body.mass * body.centre for body in bodies], axis=0) / mass
    for body in bodies:
        d = body.centre - centre
        inertia += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Body(mass, centre, inertia)


class Masses:
    """The masses of a document's bodies, written for Pinocchio's parser.

    Attributes
    ----------
    meshes : list of str
        Bodies with meshes, whose masses nobody gives: they are left out.
    """

    def __init__(
        self, compiler: dict[str, str], defaults: Defaults, name: str, place: Callable[[Element], pin.SE3]
    ) -> None:
        self._defaults, self._name, self._place = defaults, name, place
        self._from_geom = compiler.get("inertiafromgeom", "auto")
        self._balanced = compiler.get("balanceinertia", "false") == "true"
        given = Element("compiler", {"inertiagrouprange": "0 5"} | compiler)
        self._groups = vector(given, "inertiagrouprange", 2, name).tolist()
        self._lightest, self._least = (number(given, key, name) for key in ("boundmass", "boundinertia"))
        self._total = number(given, "settotalmass", name, -1.0)
        self._written: list[tuple[Element | None, Body]] = []
        self.meshes: list[str] = []

    def read(self, source: Element, target: Element | None, body: str, inherited: str) -> None:
        """The mass of a body into the reduced one; a body of the ground (None) counts for the total alone."""
        if target is None and self._total <= 0.0:
            return
        with np.errstate(all="ignore"):  # numbers beyond reason are told of with the model
            ways = [lambda: self._given(source, body), lambda: self._of_geoms(source, body, inherited)]
            if self._from_geom == "true":  # what is given stands for bodies none of whose geoms counts
                ways.reverse()
            found = ways[0]() or ways[1]()
            if found is None and not (self._lightest or self._least):
                return
            found = self._bounded(found or self._of_nothing(source, body))
        inertial = None if target is None else ElementTree.SubElement(target, "inertial")
        self._written.append((inertial, found))

    def write(self) -> None:
        """All bodies, rescaled to the total that is asked for."""
        scale = 1.0
        if self._total > 0.0:
            if self.meshes:
                raise ModelError(
                    f"{self._name}: compiler settotalmass asks for the masses of the meshes of "
                    f"{', '.join(map(repr, self.meshes[:5]))}; give these bodies an <inertial>"
                )
            mass = sum(body.mass for _, body in self._written)
            scale = self._total / mass if mass > 0.0 else 1.0
        for inertial, body in self._written:
            if inertial is not None:
                I = scale * body.inertia
                full = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
                inertial.attrib.update(
                    pos=text_of(body.centre), mass=repr(float(scale * body.mass)), fullinertia=text_of(full)
                )

    def _given(self, source: Element, body: str) -> Body | None:
        inertial = source.find("inertial")
        if inertial is None:
            return None
        where = f"{self._name}: inertial of body {body!r}"
        keys = [key for key in ("diaginertia", "fullinertia") if key in inertial.attrib]
        if len(keys) != 1:
            raise ModelError(f"{where}: give one of diaginertia and fullinertia")
        moments = vector(inertial, keys[0], 3 if keys[0] == "diaginertia" else 6, where)
        xx, yy, zz, xy, xz, yz = [*moments, 0.0, 0.0, 0.0][:6]
        I = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        mass = float(vector(inertial, "mass", 1, where)[0])
        return Body(mass, np.zeros(3), I).placed(self._place(inertial))

    def _of_nothing(self, source: Element, body: str) -> Body:
        """What bounds start from where nothing weighs: MuJoCo reads the body's own `pos` in its axes."""
        place = vector(source, "pos", 3, f"{self._name}: body {body!r}", (0.0, 0.0, 0.0))
        return Body(0.0, place, np.zeros((3, 3)))

    def _bounded(self, body: Body) -> Body:
        mass, moments = max(body.mass, self._lightest), body.inertia
        if not (self._least or self._balanced) or not np.all(np.isfinite(moments)):
            return Body(mass, body.centre, moments)
        principal, R = np.linalg.eigh(moments)
        raised = np.maximum(principal, self._least)
        if self._balanced and raised[0] + raised[1] < raised[2]:
            raised = np.full(3, raised.mean())
        if np.any(raised != principal):
            moments = R @ np.diag(raised) @ R.T
        return Body(mass, body.centre, moments)

    def _of_geoms(self, source: Element, body: str, inherited: str) -> Body | None:
        found = []
        for geom in source.findall("geom"):
            geom = self._defaults.resolved(geom, inherited)
            where = f"{self._name}: geom {geom.get('name', '')!r} of body {body!r}"
            group = number(geom, "group", where)
            if self._from_geom == "false" or not self._groups[0] <= group <= self._groups[1]:
                continue
            if number(geom, "mass", where, 1.0) == 0.0:
                continue
            if "mass" not in geom.attrib and number(geom, "density", where, WATER) == 0.0:
                continue
            kind = geom.get("type", "sphere")
            if kind in ("plane", "hfield"):
                continue
            if geom.get("mesh") or kind in ("mesh", "sdf"):
                self.meshes.append(body)
                continue
            if kind not in SOLIDS or flag(geom, "shellinertia", False):
                raise ModelError(
                    f"{where}: the inertia of a {'shell' if kind in SOLIDS else kind} cannot be computed; "
                    "give the body an <inertial>"
                )
            found.append(self._solid(geom, kind, where))
        return together(found) if found else None

    def _solid(self, geom: Element, kind: str, where: str) -> Body:
        """A geom of simple shape, checked."""
        sizes = words(geom, "size", where)
        needed, at = SOLIDS[kind], None
        if "fromto" in geom.attrib and kind != "sphere":
            ends = framed_ends(geom, where)
            along = direction(ends[3:] - ends[:3], where, "fromto")
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along)
            at = pin.SE3(turn.toRotationMatrix(), 0.5 * (ends[:3] + ends[3:]))
            needed = 1
        if len(sizes) < needed or not np.all(sizes[:needed] > 0.0):
            raise ModelError(
                f"{where}: size={geom.get('size')!r} is not that of a {kind}; give {needed} positive "
                "number(s)"
            )
        if at is not None:
            half = 0.5 * math.dist(ends[:3], ends[3:])
            sizes = np.array([sizes[0], half] if SOLIDS[kind] == 2 else [sizes[0], sizes[0], half])
        volume, moments = _solid(kind, sizes)
        for key in ("mass", "density"):
            if number(geom, key, where) < 0.0:
                raise ModelError(f"{where}: {key}={geom.get(key)!r} is negative")
        mass = number(geom, "mass", where, number(geom, "density", where, WATER) * volume)
        return Body(mass, np.zeros(3), mass * np.diag(moments)).placed(
            self._place(geom) if at is None else at
        )


def _solid(kind: str, sizes: Array) -> tuple[float, Array]:
    """Volume, m³, and principal moments for a mass of one, m², of MuJoCo's shapes with half sizes."""
    if kind == "box":
        squares = sizes[:3] ** 2
        return 8.0 * float(np.prod(sizes[:3])), (squares.sum() - squares) / 3.0
    if kind == "ellipsoid":
        squares = sizes[:3] ** 2
        return 4.0 / 3.0 * math.pi * float(np.prod(sizes[:3])), (squares.sum() - squares) / 5.0
    r = float(sizes[0])
    ball = 4.0 / 3.0 * math.pi * r**3
    if kind == "sphere":
        return ball, np.full(3, 0.4 * r * r)
    h = float(sizes[1])
    barrel = 2.0 * math.pi * r * r * h
    across, along = r * r / 4.0 + h * h / 3.0, 0.5 * r * r
    if kind == "cylinder":
        return barrel, np.array([across, across, along])
    # caps, half a ball at either end: centre of mass 3 r / 8 beyond the barrel
    share = ball / (ball + barrel)
    capped = 0.4 * r * r + h * h + 0.75 * h * r
    across = (1.0 - share) * across + share * capped
    along = (1.0 - share) * along + share * 0.4 * r * r
    return ball + barrel, np.array([across, across, along])
