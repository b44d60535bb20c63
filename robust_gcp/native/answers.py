"""What acts in the kernel besides the mechanism's own forces: a torque held, or a function of the user's."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..dynamics.equations import CheckedTorque
from ..dynamics.held import HeldTorque
from ..mechanism.tree import Array
from .structures import Request, TorqueCallback, side_by_side

NO_CALLBACK, NOTHING = TorqueCallback(), np.zeros(0)


class Acting:
    """The buffers by which the kernel learns of a torque.

    Parameters
    ----------
    request : Request
    nq, nv : int
    torque : callable, ndarray (nv,) or None

    Attributes
    ----------
    held : bool
        Whether it is a `HeldTorque`.
    tau : ndarray (nv,)
        Empty where nothing acts.
    raised : list of BaseException
        What the function raised since `listen`.
    """

    def __init__(self, request: Request, nq: int, nv: int, torque: CheckedTorque | Array | None) -> None:
        self._held = torque if isinstance(torque, HeldTorque) else None
        self.held = self._held is not None
        self._supplied = torque if callable(torque) and not self.held else None
        self._request, self._callback = request, NO_CALLBACK
        self.raised: list[BaseException] = []
        self.tau: Array = NOTHING
        if torque is None:
            return
        (self._q, self._v, self.tau), places = side_by_side({"q": nq, "v": nv, "tau": nv})
        request.torque_q, request.torque_v, request.torque_tau = places["q"], places["v"], places["tau"]
        if self._supplied is None:
            request.held = places["tau"]
        if not callable(torque):
            self.tau[:] = torque

    def listen(self) -> None:
        """The torque held, or a callback for the next batch, and where it leaves an exception."""
        self.raised = []
        if self._held is not None:
            self.tau[:] = self._held.value
        if self._supplied is not None:
            answers = answering(self._supplied, (self._q, self._v, self.tau), self.raised)
            next(answers)
            self._callback = TorqueCallback(answers.send)
            self._request.torque = self._callback


def answering(
    supplied: CheckedTorque, shared: tuple[Array, Array, Array], raised: list[BaseException]
) -> Generator[int, float, None]:
    """Takes a time, writes τ and gives 0; gives 1 after an exception, which cannot pass through C++.

    A signal that arrives while the kernel works is handled by the first Python that runs after it.
    In a function that would be its entry, outside any `try`, and ctypes would swallow what the
    handler raises. A generator is resumed inside its `try`. It knows nothing of the workspace, which
    would otherwise outlive its run until the collector runs.
    """
    q, v, tau = shared
    asked = False
    try:
        while True:
            t = yield 0
            asked = True
            tau[:] = supplied(t, q, v)
            asked = False
    except BaseException as error:
        if isinstance(error, GeneratorExit) and not asked:  # nobody will ask again
            raise
        raised.append(error)
    yield 1
