"""Couplings in URDF: joints that move together."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from ...errors import ModelError
from ...mechanism.constraint.couplings import CouplingClosure
from .numbers import number_in


def part(element: Element, tag: str, where: str) -> Element:
    """The element's end of that tag, which names a link, or a ModelError."""
    found = element.find(tag)
    if found is None or not found.get("link"):
        raise ModelError(f"{where} lacks <{tag} link=…>; name the link")
    return found


def coupling(root: Element, element: Element, tags: tuple[str, str, str], where: str) -> CouplingClosure:
    """Σ successors' joints = ratio Σ predecessors' joints, each below the links' nearest common ancestor.

    `tags` are those of the predecessor, the successor and the ratio.
    """
    above = {}
    for joint in root.findall("joint"):
        child, parent = joint.find("child"), joint.find("parent")
        if child is not None and parent is not None:
            above[child.get("link", "")] = (joint, parent.get("link", ""))
    chains = []
    for tag in tags[:2]:
        link = part(element, tag, where).get("link", "")
        chain = []
        while link in above:
            joint, link = above[link]
            chain.append(joint)
        chains.append(chain)
    common = [joint for joint in chains[0] if joint in chains[1]]
    before, after = ([j for j in c if j not in common and j.get("type") != "fixed"] for c in chains)
    if not before or not after:
        raise ModelError(
            f"{where} needs a moving joint on either side, below the links' nearest common ancestor"
        )
    ratio_element = element.find(tags[2])
    if ratio_element is None:
        raise ModelError(f"{where} lacks <{tags[2]} value=…>; give the {tags[1]}'s rate over the {tags[0]}'s")
    ratio = number_in(ratio_element, "value", where)
    names = [j.get("name", "") for j in (*after, *before)]
    # of q₁ = ratio q₂ + Σ c q: the other successors go to the right side
    further = [(n, -1.0) for n in names[1 : len(after)]] + [(n, ratio) for n in names[len(after) + 1 :]]
    return CouplingClosure(names[0], names[len(after)], ratio, more=tuple(further))


def mimic(joint: Element, tag: Element, name: str) -> CouplingClosure:
    """A joint's <mimic>: q = multiplier q of the other + offset."""
    where = f"{name}: joint {joint.get('name')!r}"
    leader = tag.get("joint")
    if not leader:
        raise ModelError(f"{where}: its <mimic> names no joint; give <mimic joint=…>")
    ratio, offset = number_in(tag, "multiplier", where, 1.0), number_in(tag, "offset", where, 0.0)
    return CouplingClosure(joint.get("name", ""), leader, ratio, offset)
