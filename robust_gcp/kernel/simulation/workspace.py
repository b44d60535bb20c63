"""One run's workspace in the compiled kernel: batches of RK4 steps on the regular path."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import CheckedTorque, Evaluation
from ...dynamics.prescribed.drive import Drive
from ...dynamics.tableau import Tableau
from ...maps.cluster.options import LAST_RESORT, PRESCRIBED, BridgeOptions
from ...maps.explicit import Crossing, Point
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..dynamics.acting import Acting, Driving
from ..handles import Handle, Layout, Shared
from ..library import Library
from ..structures import Beginning, Reason, Request, address
from .batch import Batch, Begun, Choices, Looked, Outputs, counted, crossings, one_by_one
from .guard import ErrorControl, Guard, Watch
from .prepared import Prepared
from .rates import Rates


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
    drive : Drive, optional
        Coordinates that move as prescribed.
    tableau : Tableau, optional
        Of the steps, when it is not the classical one.
    guard : Guard, optional
        Batches end where it is met.

    Raises
    ------
    NotNativeError
        When the kernel cannot take the mechanism.

    Attributes
    ----------
    shares : tuple of float
        Of a step, its stages at which something may be prescribed.
    latest : Point or None
        Where the kernel can go on as it is: the last batch's last point.
    looks_within : bool
        Whether it takes outputs within steps.
    library, handle, request, reference, shared, acting, handed, unit
        How the kernel is called, and the units of y, for `Rates` and `Prepared`.
    """

    def __init__(
        self,
        library: Library,
        mechanism: Mechanism,
        path: RegularPath,
        torque: CheckedTorque | ArrayLike | None = None,
        works: bool = False,
        drive: Drive | None = None,
        tableau: Tableau | None = None,
        guard: Guard | None = None,
    ) -> None:
        self.library, self.path = library, path
        self._acts = mechanism.applied is not None or torque is not None or drive is not None
        self._nq, self._nv, self._m = mechanism.nq, mechanism.nv, mechanism.m
        self.unit = mechanism.units[mechanism.iv_independent]
        self._numbers, self._numbers_in_q = mechanism.numbers, mechanism.iq_numbers
        self._layout: Layout = mechanism.memo.once(
            ("layout in the kernel", *path.rows.tolist()), lambda: Layout(mechanism, path)
        )
        self._packed: Point | None = None  # that `anchor` holds, where it is known
        self.latest: Point | None = None
        self.request = Request()
        self._driving = None if drive is None else Driving(self.request, mechanism, drive)
        driven: tuple[int, ...] = () if drive is None else tuple(drive.driven.tolist())
        self._taken = Handle(library, mechanism, path, works, driven)
        self.handle, self.handed = self._taken.address, self._taken.handed
        self.shared = Shared(self.request, mechanism, 2 * self._m + int(works), self._layout.size)
        resort = PRESCRIBED if len(driven) == self._m > 0 else LAST_RESORT
        self._choices = Choices(self.request, resort, tableau, guard)
        self.shares, self.reference = self._choices.shares, ctypes.byref(self.request)
        self.acting = Acting(self.request, mechanism, torque, self._driving)
        self.looks_within = len(mechanism.numbers) == mechanism.m  # charts are renewed at ends of steps alone

    def run(
        self,
        times: Array,
        x: Array,
        now: Evaluation,
        outputs: Outputs,
        zone: float,
        options: BridgeOptions | None = None,
        trackers: Callable[[], Array] | None = None,
        watch: Watch | None = None,
        best: float = 0.0,
        prescribed: Array | None = None,
        control: ErrorControl | None = None,
        looked: Looked | None = None,
    ) -> Batch:
        """Steps from times[0] to times[-1], or until something rare happens.

        Parameters
        ----------
        times : ndarray (n + 1,)
            s.
        x, now : ndarray, Evaluation
            At times[0].
        outputs : Outputs
            n rows.
        zone, options : float, BridgeOptions, optional
            Where the regular path ends; without options the kernel stops there, and looks at no branches.
        trackers : callable () -> ndarray, optional
            Where `now` is in a zone, and not where the last batch ended.
        watch, looked : Watch, Looked, optional
            Up to where the steps go on.
        best : float, optional
            Largest conditioning of an output so far; see `runs.recovery`.
        prescribed : ndarray (n + 1, s, 3, driven), optional
            See `Drive.stages`.
        control : ErrorControl, optional
            In place of fixed steps.
        """
        r, self._prescribed = self.request, prescribed  # which it points to
        r.prescribed = address(prescribed)
        times = np.ascontiguousarray(times, dtype=float)
        self.acting.prescribe_over(times, self.shares, outputs.within.times if outputs.within else None)
        r.steps, r.first, r.times = len(times) - 1, 0, address(times)
        r.power, r.best = now.power, best
        self._choices.make(zone, options, watch, control=control)
        self.shared.x[:], self.shared.ydd[:] = x, now.ydd
        self.shared.tau[:] = 0.0 if now.tau is None else now.tau
        if now.point is self.latest:  # the very point: nobody has used the kernel since
            r.beginning = Beginning.GO_ON
        else:
            self._begin_at(now.point, trackers)
        outputs.written_by(r)
        self.handed.secure()  # before the kernel moves on from them
        self.acting.listen(control is not None, looked and one_by_one(looked, outputs))
        self.library.run(self.handle, self.reference)
        return self._batch(0, int(r.completed), outputs.first(int(r.completed)))

    def _begin_at(self, point: Point, trackers: Callable[[], Array] | None) -> None:
        """Begin the request at a point, in a zone where there are trackers."""
        r = self.request
        r.beginning = Beginning.REGULAR if trackers is None else Beginning.IN_ZONE
        self._trackers = None if trackers is None else np.ascontiguousarray(trackers())
        r.trackers = address(self._trackers)  # which are kept as long as the request may be read
        if point is not self._packed:
            self._layout.pack(point, self.shared.anchor)
            self._packed = point
        self.shared.origin[:] = self._layout.origin(point)

    def prepared(
        self,
        times: Array,
        outputs: Outputs,
        zone: float,
        options: BridgeOptions | None,
        watch: Watch | None,
        best: float,
        looked: Callable[[float], bool] | None,
    ) -> Prepared:
        """Steps to come from the last batch's last point on, under a torque that is held; as `run` else.

        Parameters
        ----------
        times : ndarray (N + 1,)
            s, contiguous; as all arrays here to be kept by the caller as long as steps are taken.
        outputs : Outputs
            N + 1 rows.
        """
        r, self._packed = self.request, None
        r.times, r.beginning, r.steps, r.first, r.best = address(times), Beginning.GO_ON, 0, 0, best
        self._choices.make(zone, options, watch)
        outputs.between(1, len(times)).written_by(r)
        self.handed.secure()
        self.acting.listen(looked=looked)
        self.library.run(self.handle, self.reference)  # no step: counts begin
        return Prepared(self)

    def settled(self, begun: int, reached: int) -> Batch:
        """What prepared steps came to, from one time to another."""
        return self._batch(begun, reached - begun, Outputs.room(0, self._nq, self._nv))

    def rates(
        self,
        now: Evaluation,
        x: Array,
        zone: float,
        options: BridgeOptions | None,
        watch: Watch | None,
        trackers: Callable[[], Array] | None = None,
    ) -> Rates:
        """ẋ from an evaluation at x on; parameters as for `run`.

        The solver controls its error: uncertified zones are followed on the true curve.
        """
        r, self.latest = self.request, None
        self._choices.make(zone, options, watch, error_controlled=True)
        r.power, r.first, r.times = now.power, 0, self.shared.at_time
        self._begin_at(now.point, trackers)
        self.shared.x[:], self.shared.ydd[:] = x, now.ydd
        self.handed.secure()
        self.acting.listen()
        self.library.follow_from(self.handle, self.reference)
        return Rates(self)

    def told(self) -> Evaluation:
        """The evaluation that the kernel was asked to tell last."""
        self._packed = None
        return self._evaluation(self._layout.point(self.shared.anchor, self.shared.origin))

    @property
    def passed(self) -> list[Crossing]:
        """Singular places that were passed last."""
        return crossings(self.request, self._nq, self._numbers_in_q) if self.request.logged else []

    def look(self, t: float, now: Evaluation) -> Evaluation | None:
        """The last batch's last state under the torque that is held now; None where that is not known."""
        if now.point is not self.latest or not self.acting.held:
            return None
        r, time = self.request, np.array([t])
        r.times, r.first, r.beginning = address(time), 0, Beginning.GO_ON
        self.acting.listen()
        self.acting.prescribe(t)
        self.library.look(self.handle, self.reference)
        self.acting.require_answered()
        return self._evaluation(now.point) if r.reason == Reason.DONE else None

    def begin(self, q: Array, u: Array, zone: float, t: float, options: BridgeOptions | None) -> Begun | None:
        """The state and its evaluation at q, closed by Newton's method at its own y, with velocities u.

        None where it finds no point, or K_d is conditioned below `zone` there and no cluster is followed.
        """
        r, self.shared.time[0] = self.request, t
        r.times, r.power, self.latest, self._packed = self.shared.at_time, 0.0, None, None
        self._choices.make(zone, options, None)
        self.handed.secure()
        if not self.acting.asks:
            self.acting.listen()
        self.acting.prescribe(t)
        self.shared.x[:] = self.shared.anchor[:] = 0.0  # what an earlier motion left
        self.shared.x[self._numbers] = q[self._numbers_in_q]
        self.shared.x[self._m : 2 * self._m] = u
        self.shared.anchor[self._layout.q] = q
        self.library.begin(self.handle, self.reference)
        self.acting.require_answered()
        if r.reason != Reason.DONE:
            return None
        point = self._packed = self._layout.point(self.shared.anchor)
        trackers = self.handed.new() if r.in_zone else None
        return Begun(self.shared.x.copy(), self._evaluation(point), trackers, counted(r))

    def _batch(self, begun: int, steps: int, outputs: Outputs) -> Batch:
        r = self.request
        point = self._packed = self._layout.point(self.shared.anchor, self.shared.origin)
        self.latest = point if r.reason in (Reason.DONE, Reason.CHART, Reason.MET) else None
        trackers = self.handed.new() if r.in_zone else None
        now = self._evaluation(point)
        safe = None
        if 0 <= r.safe_step == begun + steps:
            safe = steps, self.shared.x.copy(), point
        elif r.safe_step >= 0:
            x, at = self.shared.safe[self._layout.size :].copy(), int(r.safe_step) - begun
            safe = at, x, self._layout.point(self.shared.safe)
        return Batch(
            steps,
            Reason(r.reason),
            self.shared.x.copy(),
            now,
            trackers,
            outputs,
            self.passed,
            safe,
            float(r.best),
            {"native_steps": steps, **counted(r)},
            self.acting.failure(),
            (float(r.uncertain), float(r.nearest)),
        )

    def _evaluation(self, point: Point) -> Evaluation:
        """What the kernel left at its anchor, which is this point."""
        tau = self.shared.tau.copy() if self._acts else None
        v, power = point.G.dot(point.ydot), float(self.request.power)
        effort = None if self._driving is None else self._driving.effort()
        return Evaluation(point, v, self.shared.ydd.copy(), tau, power, effort)
