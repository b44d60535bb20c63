"""What acts in the kernel besides forces that it knows: torques held or asked for, prescribed motions."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import CheckedTorque
from ...dynamics.prescribed.control import Actuated, Control
from ...dynamics.prescribed.drive import Drive
from ...dynamics.prescribed.zero_order_hold import ROWS_HELD, HeldTorque
from ...mechanism.forces.applied_forces import OwnForces
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..structures import Arrays, Reason, Request, TorqueCallback, address, side_by_side


class Driving:
    """Buffers for motions that are prescribed, which a request points to.

    Parameters
    ----------
    request : Request
    mechanism : Mechanism
    drive : Drive
    """

    def __init__(self, request: Request, mechanism: Mechanism, drive: Drive) -> None:
        self._request, self._drive, self._nv = request, drive, mechanism.nv
        self._columns = mechanism.iv_independent[drive.driven]
        n = len(drive.driven)
        (self._now, self._effort), places = side_by_side({"now": 3 * n, "effort": n})
        request.effort = places["effort"]

    def prescribe(self, t: float) -> None:
        """Tell what is prescribed at a time, s."""
        self._now[:] = np.concatenate(self._drive.motion_at(t))
        self._request.prescribed = address(self._now)

    def effort(self) -> Array:
        """What the kernel found last that this takes, (nv,), NaN at other joints."""
        found: Array = np.full(self._nv, np.nan)
        found[self._columns] = self._effort
        return found


NO_CALLBACK, NOTHING = TorqueCallback(), np.zeros(0)  # a null pointer: ctypes takes no None here


class Acting:
    """The buffers by which the kernel learns of a torque, and of forces that say by themselves what they do.

    Parameters
    ----------
    request : Request
    mechanism : Mechanism
        Its `OwnForces` act as well.
    torque : callable, array_like (nv,) or None
    driving : Driving or None
        What moves as prescribed.

    Attributes
    ----------
    held : bool
        Whether it is a `HeldTorque`.
    asks : bool
        Whether it is a function of the user's.
    tau : ndarray (nv,)
        Where the kernel reads a torque that is held; empty where none is.
    raised : list of BaseException
        What a function or a force raised since `listen`.
    """

    def __init__(
        self,
        request: Request,
        mechanism: Mechanism,
        torque: CheckedTorque | ArrayLike | None,
        driving: Driving | None,
    ) -> None:
        self._driving = driving
        nq, nv, n = mechanism.nq, mechanism.nv, len(mechanism.actuators)
        forces = None if mechanism.applied is None else mechanism.applied.own
        self._held = torque if isinstance(torque, HeldTorque) else None
        self.held = self._held is not None
        self._control: Control | None = None
        if isinstance(torque, Actuated) and not torque.asks:
            self._control, torque = torque.control, torque.constant
        supplied = torque if callable(torque) and not self.held else None
        self.asks = supplied is not None
        constant = self._control is None or self._control.constant is not None
        self._varying = None if constant else self._control
        changes = self._held is not None and bool(self._held.stride)  # within the step that it is held over
        self._changes = changes or self._varying is not None or driving is not None
        self._supplied, self._forces, self._nv = supplied, forces, nv
        self._request, self._callback = request, NO_CALLBACK
        self.raised: list[BaseException] = []
        self.tau: Array = NOTHING
        if torque is not None and supplied is None:
            held = nv if self._held is None else len(self._held.value)
            (self.tau,), places = side_by_side({"tau": held})
            request.held = places["tau"]
            self.tau[:] = 0.0 if callable(torque) else mechanism.velocity(torque, "torque")
            if self._held is not None and held > nv:
                # controls follow the torques, doubles of 8 bytes
                request.control, request.control_stride = places["tau"] + 8 * nv, self._held.stride
                request.control_rows = ROWS_HELD
        if self._control is not None:
            self._now = np.zeros(n) if self._control.constant is None else self._control.constant.copy()
            request.control, request.control_rows = address(self._now), 1
        if supplied is not None or forces is not None:
            self._shared, places = side_by_side({"q": nq, "v": nv, "tau": nv, "stored": 2})
            for name, place in places.items():
                setattr(request, f"torque_{name}", place)

    def prescribe(self, t: float) -> None:
        """Tell what moves as prescribed, and controls and activations that change, at a single time, s."""
        if self._driving is not None:
            self._driving.prescribe(t)
        if self._varying is not None:
            self._now[:] = self._varying.over(np.array([t]))[0]
            self._request.control, self._request.control_stride = address(self._now), 0
            self._request.control_rows = 1
        elif self._held is not None and self._held.stride:
            n = self._held.stride
            self.tau[self._nv : self._nv + n] = self._held.u(t)

    def prescribe_over(self, times: Array, shares: tuple[float, ...], within: Array | None = None) -> None:
        """Tell them at all stages of steps that end at these times, and at times within, if they change."""
        self._inside = None
        if within is not None and self._held is not None and self._held.stride:
            self._inside = np.array([self._held.u(t) for t in within.tolist()])
        if self._varying is not None:
            self._inside = None if within is None else np.ascontiguousarray(self._varying.over(within))
            self._rows = self._varying.stages(times, shares)
            self._request.control, self._request.control_stride = address(self._rows), self._rows.shape[2]
            self._request.control_rows = self._rows.shape[0] * self._rows.shape[1]
        self._request.control_within = address(self._inside)

    def listen(self, at_any_time: bool = False, looked: Callable[[float], bool] | None = None) -> None:
        """The torque held, or a callback for the next batch, and where it leaves an exception.

        Parameters
        ----------
        at_any_time : bool
            Whether the batch asks at times of its own what moves as prescribed, and what controls are.
        looked : callable (t), optional
            Told when each step ends; the batch ends there where it says so.
        """
        self.raised = []
        self._looked = NO_CALLBACK if looked is None else answering(looked, self.raised)
        self._request.looked = self._looked
        if self._held is not None:
            self.tau[:] = self._held.value
        if at_any_time and self._changes:
            self._telling = answering(self.prescribe, self.raised)
            self._request.tell = self._telling
        if self._supplied is not None or self._forces is not None:
            energy = bool(self._request.ends.energy)
            answer = torque_answer(self._supplied, self._forces, self._shared, energy)
            self._callback = answering(answer, self.raised)
            self._request.torque = self._callback

    def failure(self) -> BaseException | None:
        """What the user's functions raised since `listen`, or stopped the kernel by; None for nothing."""
        if self.raised:
            return self.raised[0]
        stopped = self._request.reason == Reason.TORQUE  # between two lines of the generator
        return KeyboardInterrupt() if stopped else None

    def require_answered(self) -> None:
        """Raise it."""
        failure = self.failure()
        if failure is not None:
            raise failure


def answering(answer: Callable[[float], bool | None], raised: list[BaseException]) -> Any:
    """A callback that has a time answered and gives 0; 1 where the answer is True, and after an exception.

    An exception cannot pass through C++. A signal that arrives while the kernel works is handled by the
    first Python that runs after it. In a function that would be its entry, outside any `try`, and ctypes
    would swallow what the handler raises. A generator is resumed inside its `try`.
    """
    answers = _answers(answer, raised)
    next(answers)
    return TorqueCallback(answers.send)


def _answers(
    answer: Callable[[float], bool | None], raised: list[BaseException]
) -> Generator[int, float, None]:
    asked, stop = False, 0
    try:
        while True:
            t = yield stop
            asked = True
            stop = int(bool(answer(t)))
            asked = False
    except BaseException as error:
        if isinstance(error, GeneratorExit) and not asked:  # nobody will ask again
            raise
        raised.append(error)
    yield 1  # the kernel stops, and asks no more


def torque_answer(
    supplied: CheckedTorque | None, forces: OwnForces | None, shared: Sequence[Array], energy: bool
) -> Callable[[float], None]:
    """Writes τ at a time; it knows nothing of the workspace, which would otherwise outlive its run."""
    q, v, tau, stored = shared

    def answer(t: float) -> None:
        if forces is None:
            assert supplied is not None  # there is no callback without either
            tau[:] = supplied(t, q, v)
            return
        own, stored[0] = forces.torque_at(q, v)  # the power that potentials give, which is no work
        if energy:
            stored[1] = forces.energy(q)
        tau[:] = own if supplied is None else own + supplied(t, q, v)

    return answer


@contextlib.contextmanager
def asking(mechanism: Mechanism, states: Arrays, function: CheckedTorque | None) -> Iterator[None]:
    """While the kernel may ask a function for torques at states; raises what it raised."""
    if function is None:
        yield
        return
    shared, places = side_by_side({"q": mechanism.nq, "v": mechanism.nv, "tau": mechanism.nv, "stored": 2})
    raised: list[BaseException] = []
    for name, place in places.items():
        setattr(states.structure, f"torque_{name}", place)
    callback = answering(torque_answer(function, None, shared, False), raised)
    setattr(states.structure, "torque", callback)  # noqa: B010 - a structure of `States`, by its field
    yield
    if raised:
        raise raised[0]
