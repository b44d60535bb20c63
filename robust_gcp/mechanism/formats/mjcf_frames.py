"""`<frame>` and `<replicate>` in MJCF: their children in the place where they are named, with where they are.

MuJoCo applies a frame to its children, joints included, and forgets it. A replicate stands for many frames,
turned by multiples of euler and moved on by offset in axes of the one before, whose names end in a number;
elements of other sections that refer to replicated names alone are replicated too.
"""

from __future__ import annotations

import copy
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ..tree import Array
from .mjcf_parts import Element, direction, number, placement, text_of, vector
from .xml_text import require_shallow

FRAME = "in frame"
"""Attribute that holds a child's frame, position and quaternion; no XML can write a name with a space."""

MOST = 100_000
"""Elements that a document may have once replicates are written out."""

INHERITED = {"body": "childclass", "frame": "childclass"}
"""Where a frame's childclass goes; of other elements to their class."""

POSED = ("body", "joint", "geom", "site", "camera", "light")


def with_frames_applied(root: Element, name: str, radians: bool, sequence: str) -> Element:
    """The document without frames and replicates, in place; `frame_of` tells where its elements were.

    Raises
    ------
    ModelError
        For inertias and free joints in a frame, or a replicate too large.
    """
    expander = _Expander(root, name, radians, sequence)
    for section in root.findall("worldbody"):
        expander.write_out(section)
        expander.apply(section)
    require_shallow(root, name)
    return root


def frame_of(element: Element) -> pin.SE3:
    """Where the frames of an element are in its body; the identity where there are none."""
    text = element.get(FRAME)
    return pin.SE3.Identity() if text is None else pin.XYZQUATToSE3(np.array(text.split(), dtype=float))


class _Expander:
    def __init__(self, root: Element, name: str, radians: bool, sequence: str) -> None:
        self._root, self._name = root, name
        self._radians, self._sequence = radians, sequence
        self._left = MOST

    def write_out(self, parent: Element) -> None:
        """Frames in place of replicates, innermost first."""
        position = 0
        while position < len(parent):
            child = parent[position]
            self.write_out(child)
            if child.tag == "replicate":
                copies = self._copies(child)
                parent[position : position + 1] = copies
                position += len(copies)
            else:
                position += 1

    def _copies(self, source: Element) -> list[Element]:
        where = f"{self._name}: replicate"
        count = number(source, "count", where)
        size = sum(1 for _ in source.iter())
        if not 1 <= count <= self._left / size or count != int(count):
            raise ModelError(f"{where}: count={source.get('count')!r} of {size} elements cannot be read")
        self._left -= int(count) * size
        offset, angles = (vector(source, key, 3, where, (0.0, 0.0, 0.0)) for key in ("offset", "euler"))
        place, made = pin.SE3.Identity(), []
        names = {e.get("name", "") for e in source.iter()} - {""}
        digits = len(str(int(count) - 1))
        ends = [f"{source.get('sep', '')}{i:0{digits}d}" for i in range(int(count))]
        for i, end in enumerate(ends):
            frame = ElementTree.Element("frame", {FRAME: text_of(pin.SE3ToXYZQUAT(place))})
            if source.get("childclass"):
                frame.set("childclass", source.get("childclass", ""))
            frame.extend(copy.deepcopy(list(source)))
            for element in frame.iter():
                if element.get("name"):
                    element.set("name", element.get("name", "") + end)
            made.append(frame)
            place.translation = place.act(offset)
            turn = ElementTree.Element("frame", {"euler": text_of((i + 1) * angles)})
            place.rotation = placement(turn, self._radians, self._sequence, where).rotation
        self._follow(names, ends)
        return made

    def _follow(self, names: set[str], ends: list[str]) -> None:
        """Replicate what refers to replicated names, such as equalities."""
        for section in self._root:
            if section.tag in ("worldbody", "default", "compiler", "option", "asset"):
                continue
            position = 0
            while position < len(section):
                item = section[position]
                if self._refers(item, names):
                    copies = [_renamed(item, names, end) for end in ends]
                    section[position : position + 1] = copies
                    position += len(copies)
                else:
                    position += 1

    def _refers(self, item: Element, names: set[str]) -> bool:
        """Whether an element refers to replicated names; an error where it refers to others too."""
        own = [e.get(key) for e in item.iter() for key in e.attrib if _is_reference(key)]
        hits = [one in names for one in own]
        if any(hits) and not all(hits) and item.tag in ("connect", "weld", "joint", "tendon"):
            raise ModelError(
                f"{self._name}: <{item.tag}> {item.get('name', '')!r} refers to a replicated element and to "
                f"another one ({', '.join(map(repr, own))}); write the replicas out"
            )
        return any(hits)

    def apply(self, parent: Element) -> None:
        """Children in place of their frames."""
        position = 0
        while position < len(parent):
            child = parent[position]
            if child.tag != "frame":
                self.apply(child)
                position += 1
                continue
            parent[position : position + 1] = [self._framed(child, inner) for inner in child]

    def _framed(self, frame: Element, child: Element) -> Element:
        if child.tag not in (*POSED, "frame"):
            raise ModelError(f"{self._name}: <{child.tag}> in <frame> cannot be read; put it into the body")
        place = frame_of(frame) * placement(frame, self._radians, self._sequence, f"{self._name}: frame")
        child.set(FRAME, text_of(pin.SE3ToXYZQUAT(place * frame_of(child))))
        given = frame.get("childclass")
        if given is not None:
            key = INHERITED.get(child.tag, "class")
            child.set(key, child.get(key, given))
        return child


def framed_ends(element: Element, where: str) -> Array:
    """The two points (6,) of `fromto` in body axes."""
    place, ends = frame_of(element), vector(element, "fromto", 6, where)
    return np.concatenate([place.act(ends[:3]), place.act(ends[3:])])


def pose_between(site: Element, name: str) -> pin.SE3:
    """Where MuJoCo puts a site with `fromto`: half way, z towards the first point."""
    where = f"{name}: site {site.get('name')!r}"
    ends = vector(site, "fromto", 6, where)
    along = direction(ends[:3] - ends[3:], where, "fromto")
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along)
    return frame_of(site) * pin.SE3(turn.toRotationMatrix(), 0.5 * (ends[:3] + ends[3:]))


def _is_reference(key: str) -> bool:
    """Whether an attribute names a body, joint, site, geom or tendon."""
    return key.rstrip("12") in ("body", "joint", "site", "geom", "tendon", "jointinparent", "objname")


def _renamed(item: Element, names: set[str], end: str) -> Element:
    made = copy.deepcopy(item)
    if made.get("name"):
        made.set("name", made.get("name", "") + end)
    for element in made.iter():
        for key in element.attrib:
            if _is_reference(key) and element.get(key) in names:
                element.set(key, element.get(key, "") + end)
    return made
