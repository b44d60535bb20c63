"""Equalities of a compiled MJCF model as closures and couplings."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element

from ...errors import ModelError
from ...mechanism.actuation.paths import FixedTendon
from ...mechanism.constraint.closures import Closure, FrameClosure, PointClosure
from ...mechanism.constraint.couplings import AnyClosure, CouplingClosure
from ...mechanism.constraint.pin_constraints import close_between
from .compiled import is_off
from .tendons import CompiledTendons
from .tree import CompiledTree

CONNECT, WELD, JOINT, TENDON = range(4)
KINDS = ("connect", "weld", "joint", "tendon", "flex", "flexvert", "flexstrain", "distance")
SITE = 6
"""MuJoCo's mjOBJ_SITE."""


def equalities_of(
    compiled: Any, tree: CompiledTree, tendons: CompiledTendons, document: Element
) -> list[AnyClosure]:
    """The active ones; frames are added to the tree's model.

    Raises
    ------
    ModelError
        For one of flexible parts or spatial tendons, a curved relation between tendons, or one that MuJoCo
        drops without a word: it refers to a replicated element and to another one.
    """
    found: list[AnyClosure] = []
    if is_off(compiled, "CONSTRAINT") or is_off(compiled, "EQUALITY"):
        return found
    known = {*tree.bodies, *tree.joints, *tree.sites} | {
        compiled.tendon(t).name for t in range(compiled.ntendon)
    }
    for item in document.iterfind("equality/*"):
        ends = [
            v
            for k, v in item.items()
            if k.rstrip("12") in ("body", "joint", "site", "tendon") and v != "world"
        ]
        if 0 < sum(end in known for end in ends) < len(ends):
            raise ModelError(
                f"{tree.name}: <{item.tag}> {item.get('name', '')!r} refers to a replicated element and to "
                f"another one ({', '.join(map(repr, ends))}); write the replicas out"
            )
    for e in range(compiled.neq):
        if not compiled.eq_active0[e]:
            continue
        kind = int(compiled.eq_type[e])
        label = compiled.equality(e).name
        where = f"{tree.name}: equality <{KINDS[kind]}> {label!r}"
        if kind in (CONNECT, WELD):
            found.append(_closure(compiled, e, tree, label or f"{KINDS[kind]}_{len(found)}"))
        elif kind == JOINT:
            found.append(_of_joints(compiled, e, tree))
        elif kind == TENDON:
            found.append(_of_tendons(compiled, e, tree, tendons, where))
        else:
            raise ModelError(
                f"{where} cannot be read; only {', '.join(KINDS[:4])} are: model it with bodies, or remove it"
            )
    return found


def _closure(m: Any, e: int, tree: CompiledTree, label: str) -> Closure:
    """MuJoCo's numbers of a connect: the point on body 1 and on body 2; of a weld: on body 2, pose on body 1.

    It scales the rotation rows of a weld by its torquescale: zero leaves its point alone.
    """
    data, one, two = m.eq_data[e], int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
    if m.eq_objtype[e] == SITE:
        ends = (tree.site(one), tree.site(two))
    elif m.eq_type[e] == CONNECT:
        ends = (tree.on(one, data[:3]), tree.on(two, data[3:6]))
    else:
        ends = (tree.on(one, data[3:6], data[6:10]), tree.on(two, data[:3]))
    holds_frame = m.eq_type[e] == WELD and data[10] != 0.0
    kind: type[PointClosure] | type[FrameClosure] = FrameClosure if holds_frame else PointClosure
    if m.eq_objtype[e] == SITE and tree.sites[one] and tree.sites[two]:
        return kind(tree.sites[one], tree.sites[two])
    return close_between(tree.model, kind, label, ends)


def _of_joints(m: Any, e: int, tree: CompiledTree) -> CouplingClosure:
    """q₁ − q₁⁰ = Σ polycoefᵢ (q₂ − q₂⁰)ⁱ, with q⁰ of qpos0."""
    one, two = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
    coefficients = m.eq_data[e][:5].tolist()
    q1 = _drawn(m, one)
    if two < 0:
        return CouplingClosure(tree.joints[one], None, 0.0, q1 + coefficients[0])
    names = tree.joints[one], tree.joints[two]
    return CouplingClosure.from_polynomial(*names, coefficients, q1, _drawn(m, two))


def _of_tendons(m: Any, e: int, tree: CompiledTree, tendons: CompiledTendons, where: str) -> CouplingClosure:
    """The same of lengths Σ coefᵢ qᵢ of fixed tendons."""
    one, two = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
    a, b, *curved = m.eq_data[e][:5].tolist()
    if two >= 0 and any(curved):
        raise ModelError(f"{where}: two tendons in a curved relation cannot be read; only polycoef 'a b'")
    arms: dict[str, float] = {}
    for tendon, sign in ((one, 1.0), (two, -b)):
        if tendon < 0:
            continue
        path = tendons.paths[tendon]
        if not isinstance(path, FixedTendon):
            raise ModelError(f"{where}: {m.tendon(tendon).name!r} is no fixed tendon; only those can be read")
        for joint, arm in path.coefficients.items():
            arms[joint] = arms.get(joint, 0.0) + sign * arm
    arms = {joint: arm for joint, arm in arms.items() if arm != 0.0}
    if not arms:
        raise ModelError(f"{where}: its tendons pull at no joint; remove it")
    # MuJoCo counts lengths from those at qpos0
    offset = a + sum(arm * _drawn(m, tree.joints.index(joint)) for joint, arm in arms.items())
    (first, lead), *others = arms.items()
    further = [(joint, -arm / lead) for joint, arm in others]
    if not further:
        return CouplingClosure(first, None, 0.0, offset / lead)
    (second, ratio), *more = further
    return CouplingClosure(first, second, ratio, offset / lead, more=tuple(more))


def _drawn(m: Any, joint: int) -> float:
    """A joint's number in qpos0."""
    return float(m.qpos0[m.jnt_qposadr[joint]])
