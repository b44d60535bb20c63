"""One run's workspace in the compiled kernel: batches of RK4 steps on the regular path."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics.equations import CheckedTorque, Evaluation
from ..dynamics.held import HeldTorque
from ..maps.cluster.options import BridgeOptions
from ..maps.point import Point
from ..maps.regular_path import RegularPath
from ..mechanism.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .answers import answering
from .batch import Batch, Outputs, Trackers
from .description import NotNativeError, describe
from .layout import Layout
from .library import Library
from .prepared import Prepared
from .results import bridging, counted, crossings
from .structures import Arrays, Beginning, Reason, Request, TorqueCallback, address


class Workspace:
    """A mechanism in the kernel, with buffers of its own; for one thread at a time.

    Parameters
    ----------
    library : Library
    mechanism : Mechanism
    path : RegularPath
        Its rows and blocks are taken over; that of the rest where there are joints on groups.
    torque : callable, array_like (nv,) or None
        A callable is called with shared buffers, in the thread that runs the batch.
    works : bool
        Whether the state ends with the work done.

    Raises
    ------
    NotNativeError
        When the kernel cannot take the mechanism.
    """

    def __init__(
        self,
        library: Library,
        mechanism: Mechanism,
        path: RegularPath,
        torque: CheckedTorque | ArrayLike | None = None,
        works: bool = False,
    ) -> None:
        self._library, self.path, self._groups = library, path, groups_of(mechanism)
        self._held = torque if isinstance(torque, HeldTorque) else None
        supplied = torque if callable(torque) and self._held is None else None
        self._acts = mechanism.applied is not None or torque is not None
        arrays = describe(mechanism, path, None if callable(torque) else torque, works)
        why = ctypes.create_string_buffer(200)
        self._handle: int | None = library.create(ctypes.byref(arrays.structure), why, len(why))
        if not self._handle:
            raise NotNativeError(why.value.decode(errors="replace"))
        self._nq, self._nv, self._m = mechanism.nq, mechanism.nv, mechanism.m
        self._numbers_in_q = mechanism.iq_numbers
        self._numbers = np.arange(self._m) if self._groups is None else self._groups.rest_inputs
        n = 2 * self._m + int(works)
        self._layout = Layout(mechanism, path, self._groups)
        self._x, self._ydd, self._tau = np.zeros(n), np.zeros(self._m), np.zeros(self._nv)
        self._anchor = np.zeros(self._layout.size)
        self._safe = np.zeros(self._layout.size + n)
        self._bridging: tuple[BridgeOptions, Arrays] | None = None
        self._latest: Point | None = None
        self._handed: weakref.ref[Trackers] | None = None
        self._raised: list[BaseException] = []
        self._request = Request()
        self._by_reference = ctypes.byref(self._request)
        self._keep = Arrays(self._request)
        self._share(supplied)
        for name in ("x", "anchor", "ydd", "tau", "safe"):
            setattr(self._request, name, getattr(self, f"_{name}").ctypes.data)

    def __del__(self) -> None:
        """Free the kernel's memory."""
        handle = getattr(self, "_handle", None)
        if handle:
            self._library.destroy(handle)

    def _share(self, supplied: CheckedTorque | None) -> None:
        """The buffers that a torque callback reads and writes."""
        q, v, tau = np.zeros(self._nq), np.zeros(self._nv), np.zeros(self._nv)
        self._shared = q, v, tau
        self._request.torque_q, self._request.torque_v = q.ctypes.data, v.ctypes.data
        self._request.torque_tau = tau.ctypes.data
        self._callback = TorqueCallback()
        self._supplied = supplied
        if self._held is not None:
            self._request.held = tau.ctypes.data

    def _listen(self) -> None:
        """The torque held, or a callback for the next batch, and where it leaves an exception."""
        self._raised = []
        if self._held is not None:
            self._shared[2][:] = self._held.value
        if self._supplied is not None:
            answers = answering(self._supplied, self._shared, self._raised)
            next(answers)
            self._callback = TorqueCallback(answers.send)
            self._request.torque = self._callback

    def run(
        self,
        times: Array,
        x: Array,
        now: Evaluation,
        outputs: Outputs,
        zone: float,
        options: BridgeOptions | None = None,
        trackers: Callable[[], Array] | None = None,
        every: int = 1,
        chart: tuple[Array, float] | None = None,
    ) -> Batch:
        """Steps from times[0] to times[-1], or until something rare happens.

        Parameters
        ----------
        times : ndarray (n + 1,)
            s.
        x, now : ndarray, Evaluation
            The state at times[0] and its evaluation.
        outputs : Outputs
            n // every rows.
        zone : float
            Conditioning below which the regular path ends.
        options : BridgeOptions, optional
            Of the bridges; without them the kernel stops where the regular path ends, and does not look
            whether Newton left the branch.
        trackers : callable () -> ndarray, optional
            Where `now` is in a zone, and not the last state of this workspace's last batch.
        chart : (ndarray (nv,), float), optional
            1 / unit of each velocity, and the largest entry of J up to which the steps go on.
        """
        r = self._request
        times = np.ascontiguousarray(times, dtype=float)
        r.steps, r.every, r.first, r.times = len(times) - 1, every, 0, address(times)
        r.power = now.power
        self._choose(zone, options, chart)
        self._x[:], self._ydd[:] = x, now.ydd
        self._tau[:] = 0.0 if now.tau is None else now.tau
        if self.at(now.point):
            r.beginning = Beginning.GO_ON
        else:
            r.beginning = Beginning.REGULAR if trackers is None else Beginning.IN_ZONE
            numbers = None if trackers is None else np.ascontiguousarray(trackers())
            r.trackers = None if numbers is None else numbers.ctypes.data
            self._layout.pack(now.point, self._anchor)
        self._put_out(outputs)
        self._fetch_handed()
        self._listen()
        self._library.run(self._handle, self._by_reference)
        if r.reason == Reason.TORQUE and not self._raised:
            self._raised.append(KeyboardInterrupt())  # raised between two lines of the generator
        return self._batch(0, int(r.completed), outputs.first(int(r.completed) // every))

    def at(self, point: Point) -> bool:
        """Whether this is where the kernel can go on as it is: the last batch's last point."""
        return point is self._latest

    def prepared(
        self,
        times: Array,
        outputs: Outputs,
        zone: float,
        options: BridgeOptions | None,
        chart: tuple[Array, float] | None,
    ) -> Prepared:
        """Steps to come from the last batch's last point on, under a torque that is held.

        Parameters
        ----------
        times : ndarray (N + 1,)
            s, contiguous; as all arrays here to be kept by the caller as long as steps are taken.
        outputs : Outputs
            N + 1 rows, of which those reached are written.
        zone, options, chart
            As for `run`.
        """
        r = self._request
        r.every, r.times, r.steps, r.first = 1, address(times), 0, 0
        self._choose(zone, options, chart)
        self._put_out(outputs.between(1, len(times)))
        self._fetch_handed()
        self._listen()
        r.beginning = Beginning.GO_ON
        self._library.run(self._handle, self._by_reference)  # no step: counts begin
        return Prepared(self._library.run, self._handle, r, self._by_reference, self._shared[2])

    def settled(self, begun: int, reached: int) -> Batch:
        """What prepared steps came to, from one time to another; their outputs are where they belong."""
        return self._batch(begun, reached - begun, Outputs.room(0, self._nq, self._nv))

    def _choose(self, zone: float, options: BridgeOptions | None, chart: tuple[Array, float] | None) -> None:
        r = self._request
        r.zone = zone
        r.bridging = None if options is None else ctypes.pointer(self._options(options))
        sizes, r.limit = (None, 0.0) if chart is None else chart
        r.sizes = address(sizes)

    def _put_out(self, outputs: Outputs) -> None:
        r = self._request
        r.q_out, r.v_out = address(outputs.q), address(outputs.v)
        r.a_out, r.tau_out = address(outputs.a), address(outputs.tau)
        r.energy_out, r.work_out = address(outputs.energy), address(outputs.work)

    def _fetch_handed(self) -> None:
        """Take the trackers handed out last while they are what they were."""
        handed = None if self._handed is None else self._handed()
        if handed is not None:
            handed()

    def look(self, t: float, now: Evaluation) -> Evaluation | None:
        """The last batch's last state under the torque that is held now; None where that is not known."""
        if not self.at(now.point) or self._held is None:
            return None
        r, time = self._request, np.array([t])
        r.times, r.first, r.beginning = address(time), 0, Beginning.GO_ON
        self._shared[2][:] = self._held.value
        self._library.look(self._handle, self._by_reference)
        if r.reason != Reason.DONE:
            return None
        return Evaluation(now.point, now.v, self._ydd.copy(), self._tau.copy(), float(r.power))

    def begin(self, q: Array, u: Array, zone: float, t: float = 0.0) -> tuple[Array, Evaluation] | None:
        """The state and its evaluation at q, closed by Newton's method at its own y, with velocities u.

        None where the regular path has no such point, or K_d is conditioned below `zone` there.
        """
        r, times = self._request, np.array([t])
        r.times, r.zone, r.power = times.ctypes.data, zone, 0.0
        self._x[:], self._anchor[:] = 0.0, 0.0
        self._x[self._numbers] = q[self._numbers_in_q]
        self._x[self._m : 2 * self._m] = u
        self._anchor[self._layout.q] = q
        self._library.begin(self._handle, self._by_reference)
        if r.reason != Reason.DONE:
            return None
        return self._x.copy(), self._evaluation(self._layout.point(self._anchor))

    def time_pinocchio(self, q: Array, v: Array, repeats: int) -> float:
        """Seconds per right-hand side of Pinocchio's own algorithms, best of five rounds."""
        q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
        return float(self._library.time_pinocchio(self._handle, q.ctypes.data, v.ctypes.data, repeats))

    def _batch(self, begun: int, steps: int, outputs: Outputs) -> Batch:
        r = self._request
        point = self._layout.point(self._anchor)
        self._latest = point if r.reason in (Reason.DONE, Reason.CHART) else None
        trackers = Trackers(self._trackers) if r.in_zone else None
        self._handed = None if trackers is None else weakref.ref(trackers)
        now = self._evaluation(point)
        safe = None
        if 0 <= r.safe_step == begun + steps:
            safe = steps, self._x.copy(), point
        elif r.safe_step >= 0:
            x, at = self._safe[self._layout.size :].copy(), int(r.safe_step) - begun
            safe = at, x, self._layout.point(self._safe)
        return Batch(
            steps,
            Reason(r.reason),
            self._x.copy(),
            now,
            trackers,
            outputs,
            crossings(r, self._nq, self._numbers_in_q),
            safe,
            int(r.rhs),
            {"native_steps": steps, **counted(r)},
            self._raised[0] if self._raised else None,
        )

    def _evaluation(self, point: Point) -> Evaluation:
        """What the kernel left at its anchor, which is this point."""
        tau = self._tau.copy() if self._acts else None
        return Evaluation(point, point.G.dot(point.ydot), self._ydd.copy(), tau, float(self._request.power))

    def _options(self, options: BridgeOptions) -> ctypes.Structure:
        if self._bridging is None or self._bridging[0] is not options:
            self._bridging = options, bridging(options)
        return self._bridging[1].structure

    def _trackers(self) -> Array:
        """The state of the trackers after the last batch."""
        count = ctypes.c_int64()
        numbers = self._library.trackers(self._handle, ctypes.byref(count))
        return np.ctypeslib.as_array(numbers, (count.value,)).copy()
