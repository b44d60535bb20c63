"""First derivatives at many states in the compiled kernel, on regular ground and on modes that it knows.

What the kernel has not, it says state by state; the reference in `dynamics` has it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...dynamics.derivatives import Accelerations, Derivatives
from ...dynamics.modes.mode_rates import SPARED, STEADY, UNSTEADY, ZONE, ModeRates
from ...dynamics.modes.taylor_series import Around, circles_of
from ...errors import ClosureError
from ...maps.regular_path import RegularPath
from ...maps.start import Start
from ...maps.start_check import apart
from ...mechanism.building.variable_geometry import still_inputs
from ...mechanism.constraint.closed_check import require_proper
from ...mechanism.constraint.rows import ROTATION, rows_of
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import NEARLY_CLOSED, RANK, SAME_MODE
from ...mechanism.tree.tree import Array
from ..description import describe
from ..library import Library
from ..loop_arrays import NotNativeError
from ..structures import Arrays, ModeSeries, States
from .returned import Slopes


def mode_series(cluster: LoopCluster, around: Around) -> Arrays:
    """For `rg_learn`."""
    terms = around.terms.copy()
    terms[0, 0] = around.q
    sizes = dict(zip(("inputs", "first", "second"), (len(around.center), *terms.shape[:2]), strict=True))
    told = Arrays(ModeSeries(count=len(cluster.iv), **sizes))
    told.integers(velocities=cluster.iv)
    told.reals(center=around.center, shares=around.inverse, terms=terms)
    return told


CLOSED = 1e-8
"""How far q may be from a closed one, dimensionless, and v from G u, relative to its largest entry; beyond it
the reference says what is wrong."""


class StateDerivatives:
    """A mechanism's derivatives at states; for one thread at a time.

    Parameters
    ----------
    library : Library
    mechanism : Mechanism
    path : RegularPath
        Of a regular start, which picked the rows of φ.
    driven : sequence of int
        Which of y move as prescribed.

    Attributes
    ----------
    m, nv : int

    Raises
    ------
    NotNativeError
        When the kernel cannot take the mechanism.
    """

    def __init__(
        self, library: Library, mechanism: Mechanism, path: RegularPath, driven: Sequence[int] = ()
    ) -> None:
        self._library, self._mechanism, self.m, self.nv = library, mechanism, mechanism.m, mechanism.nv
        several = any(len(cluster.inputs) > 1 for cluster in mechanism.clusters)
        # a torus takes a second or two, a circle a third of one
        self._zone, self._steady = (SPARED, UNSTEADY) if several else (ZONE, STEADY)
        self._left_over = mechanism.nc > path.nd  # rows that the square K_d leaves out
        self._turns = any(row.axis == ROTATION for row in rows_of(mechanism.loops))
        still = still_inputs(mechanism)
        if len(still) < len(mechanism.still):
            raise NotNativeError("a placement that may change is no independent coordinate")
        description = describe(mechanism, path, False, tuple(dict.fromkeys((*driven, *still))))
        why = ctypes.create_string_buffer(200)
        self._handle: int | None = library.derive(ctypes.byref(description.structure), why, len(why))
        if not self._handle:
            raise NotNativeError(why.value.decode(errors="replace"))
        for cluster in mechanism.clusters:
            for around in circles_of(mechanism).get(cluster.index, ()):
                self.learn(cluster, around)

    def learn(self, cluster: LoopCluster, around: Around) -> bool:
        """Whether it could be told of a cluster's mode about a place, whose states are good from then on."""
        told = mode_series(cluster, around)
        return bool(self._library.learn(self._handle, ctypes.byref(told.structure)))

    def learn_beside(self, start: Start, places: Iterable[Array]) -> bool:
        """Whether there is something to learn about the mode of a start at places on it, (nq,) each.

        Raises
        ------
        SimulationError
            Where the mode cannot be followed there.
        """
        made = ModeRates(start, circles_of(self._mechanism)).beside(places)
        return any([self.learn(cluster, around) for cluster, around in made])

    def __del__(self) -> None:
        """Free the kernel's memory."""
        handle = getattr(self, "_handle", None)
        if handle:
            self._library.derived(handle)

    def forward_dynamics(
        self, q: Array, v: Array, tau: Array | None, known: bool = False, mode: Array | None = None
    ) -> tuple[NDArray[np.bool_], Array]:
        """Which of N states are good, and u̇ (N, m); see `slopes`."""
        udot, status = np.empty((len(q), self.m)), np.empty(len(q), dtype=np.int32)
        G = np.empty((len(q), self.nv, self.m))
        wanted: dict[str, Array] = {"ydd": udot, "G": G}
        states = self._states(q, v, tau, status, wanted, mode=mode, steady=self._steady)
        self._library.slopes(self._handle, ctypes.byref(states.structure))
        return status == 0 if known else self._sound(status, q, G, mode), udot

    def G_where_poor(self, q: Array, v: Array) -> Array | None:
        """G (nv, m) at a state that is good because rounding was looked at; None at others."""
        found: list[Array | None] = []
        for steady in (0.0, self._steady):
            G, status = np.empty((1, self.nv, self.m)), np.empty(1, dtype=np.int32)
            states = self._states(q[None], v[None], None, status, {"G": G}, steady=steady)
            self._library.slopes(self._handle, ctypes.byref(states.structure))
            found.append(G[0] if status[0] == 0 else None)
        return found[1] if found[0] is None else None

    def slopes(
        self,
        q: Array,
        v: Array,
        tau: Array | None,
        known: bool = False,
        whole: bool = False,
        mode: Array | None = None,
    ) -> Slopes:
        """The derivatives at N states.

        Parameters
        ----------
        q, v : ndarray (N, nq), (N, nv)
        tau : ndarray (N, nv) or None
        known : bool
            Whether the states are those of a motion: rows of φ that the kernel does not have are closed.
        whole : bool
            Whether the accelerations of all joints are wanted too.
        mode : ndarray (nv, m), optional
            Tangent of the mode that all of them are on; states on others are not good.
        """
        n, nv, m = len(q), self.nv, self.m
        udot, rows, status = np.empty((n, m)), np.empty((n, m, 2 * m + nv)), np.empty(n, dtype=np.int32)
        G, v_y = np.empty((n, nv, m)), np.empty((n, nv, m))
        every = Accelerations(np.empty((n, nv)), *np.empty((2, n, nv, m))) if whole else None
        wanted: dict[str, Array] = {"ydd": udot, "rows": rows, "G": G, "v_y": v_y}
        if every is not None:
            wanted |= {"a": every.a, "a_y": every.by_y, "a_u": every.by_u}
        states = self._states(q, v, tau, status, wanted, mode=mode, steady=self._steady)
        self._library.slopes(self._handle, ctypes.byref(states.structure))
        good = status == 0 if known else self._sound(status, q, G, mode)
        return Slopes(good, udot, rows, G, v_y, every)

    def at_state(self, q: Array, v: Array, tau: Array | None) -> tuple[Derivatives, Accelerations] | None:
        """The derivatives at one state of a motion; None where it is not good."""
        found = self.slopes(q[None], v[None], None if tau is None else tau[None], known=True, whole=True)
        if not found.good[0] or found.whole is None:
            return None
        every = found.whole
        return found.of_state(0), Accelerations(every.a[0], every.by_y[0], every.by_u[0])

    def _sound(
        self, status: NDArray[np.int32], q: Array, G: Array, mode: Array | None = None
    ) -> NDArray[np.bool_]:
        """Which states are good, those rows of φ included that the kernel does not have, and on a mode."""
        good = np.asarray(status == 0)
        if mode is not None:
            for i in np.flatnonzero(good):
                good[i] = apart(self._mechanism, mode, G[i]) < SAME_MODE
        if not (self._left_over or self._turns):
            return good
        mechanism, columns = self._mechanism, self._mechanism.column_scale
        for i in np.flatnonzero(good):
            try:
                if self._turns:
                    require_proper(mechanism, q[i])
            except ClosureError:
                good[i] = False
            if self._left_over:
                K = mechanism.scaled(mechanism.K(q[i]))
                moved = G[i] / columns[:, None] * columns[mechanism.iv_independent]  # G, dimensionless
                open_rate = np.abs(K @ moved).max(initial=0.0) / np.abs(moved).max()
                good[i] &= mechanism.closure_residual(q[i]) <= NEARLY_CLOSED and open_rate <= RANK
        return good

    def _states(
        self, q: Array, v: Array, tau: Array | None, status: NDArray[np.int32], results: dict[str, Array],
        at_rest: float = 0.0, same: float = 0.0, mode: Array | None = None, zone: float | None = None,
        steady: float = 0.0,
    ) -> Arrays:  # fmt: skip
        """A request, which keeps what is given, as rows in a row; the results must outlive it."""
        places = {name: part.ctypes.data for name, part in {"status": status, **results}.items()}
        zone = self._zone if zone is None else zone
        limits = {"zone": zone, "steady": steady, "close": CLOSED, "same": same, "at_rest": at_rest}
        request = Arrays(States(count=len(q), **limits, **places))
        own = self._mechanism.iv_independent
        # as G, with I in the independent rows
        along = None if mode is None else mode @ np.linalg.inv(mode[own])
        given = {"q": q, "v": v, "tau": tau, "mode": along}
        request.reals(**{name: part for name, part in given.items() if part is not None})
        return request
