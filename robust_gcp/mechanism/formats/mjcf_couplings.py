"""MJCF's equalities of joints and of fixed tendons as couplings."""

from __future__ import annotations

import pinocchio as pin

from ...checks import hint
from ...errors import ModelError
from ..couplings import CouplingClosure
from ..tree import Array
from .mjcf_parts import Element, Reduced, words

POLYNOMIAL = (0.0, 1.0, 0.0, 0.0, 0.0)
"""MuJoCo's default: the first follows the second one to one."""


def coupling_of(model: pin.Model, item: Element, parts: Reduced, home: Array, name: str) -> CouplingClosure:
    """q₁ − q₁⁰ = Σ polycoefᵢ (q₂ − q₂⁰)ⁱ, with q⁰ of qpos0; of tendons, lengths in place of q.

    Raises
    ------
    ModelError
        For a joint or tendon that is not there, a spatial tendon, or a curved relation between tendons.
    """
    where = f"{name}: equality <{item.tag}> {item.get('name', '')!r}"
    given = list(words(item, "polycoef", where)) if item.get("polycoef") else list(POLYNOMIAL)
    coefficients = (given + [0.0] * 5)[:5]
    if item.tag == "tendon":
        return _of_tendons(model, item, coefficients, parts, home, where)
    first, second = item.get("joint1", ""), item.get("joint2")
    q1 = _at(model, first, home, where)
    if second is None:
        return CouplingClosure(first, None, 0.0, q1 + coefficients[0])
    q2 = _at(model, second, home, where)
    return CouplingClosure.from_polynomial(first, second, coefficients, q1, q2)


def _of_tendons(
    model: pin.Model, item: Element, coefficients: list[float], parts: Reduced, home: Array, where: str
) -> CouplingClosure:
    arms: dict[str, float] = {}
    if item.get("tendon2") and any(coefficients[2:]):
        raise ModelError(
            f"{where}: a curved relation between two tendons cannot be read; only polycoef 'a b'"
        )
    for key, sign in (("tendon1", 1.0), ("tendon2", -coefficients[1])):
        tendon = item.get(key)
        if tendon is None and key == "tendon2":
            continue
        if tendon not in parts.tendons:
            near = hint(tendon, list(parts.tendons))
            raise ModelError(
                f"{where}: there is no fixed tendon {tendon!r}; spatial ones cannot be read{near}"
            )
        for joint, arm in parts.tendons[tendon]:
            arms[joint] = arms.get(joint, 0.0) + sign * arm
    arms = {joint: arm for joint, arm in arms.items() if arm != 0.0}
    if not arms:
        raise ModelError(f"{where}: its tendons pull at no joint; remove it")
    offset = coefficients[0] + sum(arm * _at(model, joint, home, where) for joint, arm in arms.items())
    (first, lead), *others = arms.items()
    further = [(joint, -arm / lead) for joint, arm in others]
    if not further:
        return CouplingClosure(first, None, 0.0, offset / lead)
    (second, ratio), *more = further
    return CouplingClosure(first, second, ratio, offset / lead, more=tuple(more))


def _at(model: pin.Model, joint: str, home: Array, where: str) -> float:
    names = [str(n) for n in model.names][1:]
    if joint not in names:
        raise ModelError(f"{where}: there is no joint {joint!r}{hint(joint, names)}")
    return float(home[model.joints[model.getJointId(joint)].idx_q])
