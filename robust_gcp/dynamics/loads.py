"""What a user applies, as one torque: torques on joints (array, function, by name), wrenches on frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_choice, checked_vector, listed, real_array, shown
from ..errors import OptionError, StateError
from ..mechanism.frames import place_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.named_numbers import places_of
from ..mechanism.tree.tree import Array
from ..user_functions import returned
from .equations import Torque

Load = float | ArrayLike | Callable[[float, Array, Array], ArrayLike]
"""A number or an array, or a function (t, q, v) of one."""

Torques = Torque | ArrayLike | Mapping[str, Load]
"""Torques as `simulate` takes them."""


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force and a moment on a frame: τ = Jᵀ F.

    Parameters
    ----------
    frame : str
        A frame, link or joint of the model; the force acts at the frame's origin.
    force : array_like (6,) or callable (t, q, v) -> (6,)
        Force, N, and moment, N m, about the frame's origin.
    reference : {"world", "local"}
        Whose axes the six numbers are given in: the world's, so that a constant force keeps its direction, or
        the frame's own, so that it turns with the body.
    """

    frame: str
    force: ArrayLike | Callable[[float, Array, Array], ArrayLike]
    reference: Literal["world", "local"] = "world"

    def __post_init__(self) -> None:
        check_choice("Wrench: reference", self.reference, ("world", "local"))
        if not callable(self.force):
            checked_vector(self.force, 6, f"Wrench on {shown(self.frame)}: force", "6")


def wrenches_given(wrenches: Any) -> list[Wrench]:
    """A list of wrenches, or an OptionError."""
    made = listed(wrenches, "wrenches", "rg.Wrench(frame, force)", OptionError, Wrench)
    for wrench in made:
        if not isinstance(wrench, Wrench):
            raise OptionError(f"wrenches: {shown(wrench)} is no Wrench; give rg.Wrench(frame, force)")
    return made


def one_torque(
    mechanism: Mechanism, torque: Torques | None, wrenches: Sequence[Wrench] = ()
) -> Torque | Array | None:
    """All loads as one torque: None, a constant (nv,), or a function (t, q, v) -> (nv,).

    Parameters
    ----------
    torque : callable (t, q, v) -> (nv,), array_like (nv,), or mapping, optional
        A mapping gives each joint, or one of its numbers such as "ball.rx", a number, or an array for a
        joint of several, or a function (t, q, v) of one; the other joints get none.
    wrenches : sequence of Wrench

    Raises
    ------
    OptionError, StateError
        For names that are no joints, and loads that are none.
    ModelError
        For a frame that the model does not have.
    """
    wrenches = wrenches_given(wrenches)
    if not (torque is None or callable(torque) or isinstance(torque, Mapping)):
        torque = _constant(mechanism, torque)
    if not (wrenches or isinstance(torque, Mapping)):
        return torque
    functions: dict[str, Any] = {}
    places: dict[str, list[int]] = {}
    numbers: Any = torque
    if isinstance(torque, Mapping):
        functions = {name: load for name, load in torque.items() if callable(load)}
        numbers = {name: load for name, load in torque.items() if name not in functions}
        places = places_of(mechanism.joints, torque, "v", "torque")
    parts: list[_Part] = [_JointFunction(places[n], f, f"torque[{n!r}]") for n, f in functions.items()]
    constant: Array = mechanism.tree.zero
    if callable(torque):
        parts.append(_JointFunction(list(range(mechanism.nv)), torque, "torque"))
    elif torque is not None:
        constant = mechanism.velocity(numbers, "torque")
    parts += [_FrameLoad(mechanism, wrench) for wrench in wrenches]
    return _Sum(constant, parts) if parts else constant


def without_wrenches(torque: Torque | ArrayLike | None) -> Torque | ArrayLike | None:
    """What `one_torque` made, without the wrenches in it."""
    if not isinstance(torque, _Sum):
        return torque
    return _Sum(torque.constant, [part for part in torque.parts if not isinstance(part, _FrameLoad)])


def _constant(mechanism: Mechanism, torque: ArrayLike) -> Array:
    """A torque that stays, (nv,), or an error that tells what else one may be."""
    try:
        return mechanism.velocity(torque, "torque")
    except StateError as error:
        among = torque if isinstance(torque, list | tuple) else (torque,)
        if any(isinstance(part, Wrench) for part in among):
            raise OptionError(f"torque: {shown(torque)} is a wrench; those go to wrenches=[...]") from error
        raise StateError(
            f"{error}; a torque is that, a function (t, q, v) of it, or {{joint: number or function}}"
        ) from error


_Part = Callable[[float, Array, Array, Array], None]
"""Adds its share at (t, q, v) to τ (nv,)."""


class _Sum:
    """τ = constant + all parts."""

    def __init__(self, constant: Array, parts: Sequence[_Part]) -> None:
        self.constant, self.parts = constant, parts

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        tau = self.constant.copy()
        for part in self.parts:
            part(t, q, v, tau)
        return tau


class _JointFunction:
    """A torque on one joint, or on all, by a function of the user's, which is handed copies of the state."""

    def __init__(self, place: list[int], supplied: Callable[..., Any], label: str) -> None:
        self._place, self._supplied, self._label = place, supplied, label
        self._shape = (len(place),) if len(place) > 1 else ()

    def __call__(self, t: float, q: Array, v: Array, tau: Array) -> None:
        given = self._supplied(t, q.copy(), v.copy())
        tau[self._place] += returned(given, self._shape, f"{self._label}(t, q, v)", t=t)


class _FrameLoad:
    """Jᵀ F of one wrench."""

    def __init__(self, mechanism: Mechanism, wrench: Wrench) -> None:
        self._tree = mechanism.tree
        model = mechanism.own_model
        self._label = f"Wrench on {wrench.frame!r}"
        self._joint, place = place_of(model, wrench.frame, "Wrench")
        self._offset = np.array(place.translation)
        self._turn = np.array(place.rotation) if wrench.reference == "local" else None
        self._supplied = wrench.force if callable(wrench.force) else None
        self._constant = np.split(np.zeros(6) if callable(wrench.force) else real_array(wrench.force), 2)

    def __call__(self, t: float, q: Array, v: Array, tau: Array) -> None:
        tau += self._tree.lifted(*self.load_at(t, q, v))

    def load_at(self, t: float, q: Array, v: Array) -> tuple[int, Array, Array, Array]:
        """The joint that carries the frame, its origin, force and moment there, in world axes."""
        force, moment = self._constant
        if self._supplied is not None:
            given = self._supplied(t, q.copy(), v.copy())
            force, moment = np.split(returned(given, (6,), f"{self._label}: force(t, q, v)", t=t), 2)
        tree = self._tree
        tree.jacobians(q)  # after the user's function, which may have used the mechanism
        R = tree.R[self._joint]
        if self._turn is not None:
            axes = R @ self._turn
            force, moment = axes @ force, axes @ moment
        return self._joint, tree.p[self._joint] + R.dot(self._offset), force, moment


def wrench_of(
    mechanism: Mechanism, wrench: Wrench, t: float, q: Array, v: Array
) -> tuple[int, Array, Array, Array]:
    """What a wrench is at a state: joint that carries it, point, force and moment about it, in world axes."""
    joint, point, force, moment = _FrameLoad(mechanism, wrench).load_at(t, q, v)
    return joint, point + mechanism.standpoint, force, moment
