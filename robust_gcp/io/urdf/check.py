"""The faults of a URDF that its parser reports on stderr only, or takes for zero."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import hypot
from xml.etree.ElementTree import Element

from ...checks import hint
from ...errors import ModelError
from .numbers import number_in, numbers_in

MOVING = ("revolute", "continuous", "prismatic", "planar")
"""Types of joints that have an axis."""

SPHERICAL = ("spherical", "ball")
"""Types of Bullet and MuJoCo, and of Drake."""

TYPES = (*MOVING, *SPHERICAL, "floating", "fixed")

MOMENTS = ("ixx", "iyy", "izz")
PRODUCTS = ("ixy", "ixz", "iyz")
LIMITS = ("lower", "upper", "effort", "velocity")

SINGLE = ("inertial", "origin", "mass", "inertia", "parent", "child", "axis", "limit", "dynamics", "mimic")
"""Elements of which a link, an inertial or a joint has one at most."""

WORLD = "world"
"""A link of that name that no joint carries is the ground; other roots beside it are floating bodies."""

GROUND = "universe"
"""Pinocchio's name of the ground."""

ROUNDED = 1e-9
"""Share of a link's largest moment of inertia that rounding may leave of one that is zero."""

SMALL = 1e-3
"""m: links smaller than that are judged as if they were that large."""

LONGEST_CHAIN = 1000
"""Joints from the root to a link; Pinocchio's parser calls itself for each and crashes at some thousand."""


def check_urdf(root: Element, name: str) -> None:
    """Refuse a URDF that is no tree, or whose numbers are none.

    Parameters
    ----------
    root : Element
        <robot>.
    name : str
        What to call it in errors: the file's path.

    Raises
    ------
    ModelError
        Naming the file, the element and the remedy.
    """
    links = _names(root, "link", name)
    if not links:
        raise ModelError(f"{name}: <robot> has no link; a URDF has at least its root <link name=...>")
    _names(root, "joint", name)
    for link in root.findall("link"):
        _check_link(link, f"{name}: link {link.get('name')!r}")
    for joint in root.findall("joint"):
        _check_joint(joint, f"{name}: joint {joint.get('name')!r}")
    _check_tree(root, links, name)


def _names(root: Element, tag: str, name: str) -> list[str]:
    """Names of all links or joints: each has one, and no two the same."""
    names: dict[str, None] = {}
    for element in root.findall(tag):
        label = element.get("name")
        if not label:
            raise ModelError(f"{name}: <{tag}> number {len(names) + 1} has no name; give it one")
        if label in names:
            raise ModelError(f"{name}: two {tag}s are named {label!r}; rename one of them")
        if label == GROUND:
            raise ModelError(f"{name}: a {tag} is named {GROUND!r}, which is the ground; rename it")
        names[label] = None
    return list(names)


def _require_single(element: Element, owner: str) -> None:
    for tag, count in Counter(child.tag for child in element).items():
        if count > 1 and tag in SINGLE:
            raise ModelError(f"{owner}: <{element.tag}> has {count} times <{tag}>; leave one")


# --------------------------------------------------------------------------- numbers


def _check_link(link: Element, owner: str) -> None:
    _require_single(link, owner)
    for origin in link.iter("origin"):
        _check_origin(origin, owner)
    for inertial in link.findall("inertial"):
        _require_single(inertial, owner)
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or inertia is None:
            lacking = "<mass>" if mass is None else "<inertia>"
            raise ModelError(
                f"{owner}: its <inertial> lacks {lacking}; add it, or leave out all of <inertial> "
                "for a massless link"
            )
        value = number_in(mass, "value", owner)
        if value < 0.0:
            raise ModelError(f"{owner}: <mass value={mass.get('value')!r}> is negative; give it in kg")
        numbers = [number_in(inertia, key, owner) for key in (*MOMENTS, *PRODUCTS)]
        size = max(*map(abs, numbers), value * SMALL**2)
        for key, moment in zip(MOMENTS, numbers, strict=False):
            if moment < -ROUNDED * size:
                raise ModelError(
                    f"{owner}: <inertia {key}={inertia.get(key)!r}> is negative; a moment of inertia, kg m², "
                    "is not"
                )


def _check_joint(joint: Element, owner: str) -> None:
    kind = joint.get("type")
    if kind not in TYPES:
        raise ModelError(
            f"{owner} is of unknown type {kind!r}, not one of {', '.join(TYPES)}{hint(kind, TYPES)}"
        )
    _require_single(joint, owner)
    for origin in joint.findall("origin"):
        _check_origin(origin, owner)
    for dynamics in joint.findall("dynamics"):
        for key in ("damping", "friction", "armature", "spring_stiffness"):
            if key == "armature" and len(dynamics.get(key, "").split()) > 1:
                continue  # one a velocity, read where they are known
            if dynamics.get(key) is not None and number_in(dynamics, key, owner) < 0.0:
                raise ModelError(f"{owner}: <dynamics {key}={dynamics.get(key)!r}> is negative")
    axis = joint.find("axis")
    if axis is not None and kind in MOVING:
        direction = numbers_in(axis, "xyz", owner)
        if not 1e-100 < hypot(*direction) < 1e100:
            raise ModelError(
                f"{owner}: <axis xyz={axis.get('xyz')!r}> is no direction in space; give one, such as '0 0 1'"
            )
    for limit in joint.findall("limit"):
        for key in LIMITS:
            if limit.get(key) is not None:
                number_in(limit, key, owner)


def _check_origin(origin: Element, owner: str) -> None:
    for key in ("xyz", "rpy"):
        if origin.get(key) is not None:
            numbers_in(origin, key, owner)


# --------------------------------------------------------------------------- tree


def _check_tree(root: Element, links: Sequence[str], name: str) -> None:
    """Every link but one has exactly one parent, and all hang on that one."""
    parent_of: dict[str, tuple[str, str]] = {}  # link: its parent link and joint
    known = {*links, WORLD}  # a ground that is not declared is there all the same
    for joint in root.findall("joint"):
        label = str(joint.get("name"))
        ends = {}
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if link not in known:
                raise ModelError(
                    f"{name}: joint {label!r} names the {end} link {link!r}, which is not there"
                    + hint(link, links)
                )
            ends[end] = str(link)
        child = ends["child"]
        if child in parent_of:
            raise ModelError(
                f"{name}: link {child!r} has two parent joints, {parent_of[child][1]!r} and {label!r}; a "
                "URDF is a tree: cut the loop at one of them and close it with a pair of frames in robot.yaml"
            )
        parent_of[child] = ends["parent"], label
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1 and WORLD not in roots:
        raise ModelError(
            f"{name}: {len(roots)} links have no parent joint ({', '.join(map(repr, roots[:5]))}), and a "
            f"URDF has one root: join the others to it, with fixed joints where they do not move; beside a "
            f"link {WORLD!r}, which is the ground, the others float"
        )
    _check_chains(parent_of, links, name)


def _check_chains(parent_of: dict[str, tuple[str, str]], links: Sequence[str], name: str) -> None:
    """All links hang on the root, none too far from it."""
    depth = dict.fromkeys((link for link in links if link not in parent_of), 0)  # joints above a link
    for link in links:
        way: dict[str, None] = {}
        while link not in depth:
            if link in way:
                cycle = list(way)[list(way).index(link) :]
                joints = ", ".join(repr(parent_of[one][1]) for one in cycle)
                raise ModelError(
                    f"{name}: the joints {joints} form a cycle that hangs on no root link; a URDF is a tree: "
                    "cut the loop at one of them and close it with a pair of frames in robot.yaml"
                )
            way[link] = None
            link = parent_of[link][0]
        for below in reversed(way):
            depth[below] = depth[parent_of[below][0]] + 1
    deepest = max(links, key=lambda link: depth[link])
    if depth[deepest] > LONGEST_CHAIN:
        raise ModelError(
            f"{name}: {depth[deepest]} joints lie between the root and link {deepest!r}, more than "
            f"{LONGEST_CHAIN}; build the pin.Model by hand and give it to Mechanism.from_pinocchio"
        )
