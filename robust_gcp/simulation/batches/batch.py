"""`Batch`: many motions of one mechanism that are stepped together, as learning and sampling need them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_finite, check_mechanism, check_positive, check_whole, shown
from ...dynamics.prescribed.control import Controls
from ...errors import OptionError, RobustGcpError, SimulationError, StateError
from ...kernel.simulation.row_state import RowState
from ...kernel.simulation.steps import chosen_library
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import Part, parts_given
from ...mechanism.tree.tree import Array
from ..derivatives.one_step import Stepped
from ..runs.too_long_steps import Coarse
from ..simulation import Simulation
from .arguments import controls_given, require_room, rows_given, slopes_of_step, spread, torques_given
from .rows import BatchRows

Rows = NDArray[np.int64]

AT_ONCE = 1_000_000
"""Steps of all rows times velocities that are taken at once: below a second."""


class Batch:
    """N motions of a mechanism by RK4, each as a `Simulation` of its own, stepped together.

    On regular ground and through singular places the compiled kernel takes all rows in one call; what it
    cannot do alone (a start at a singular place, stops and friction) a `Simulation` of that
    row does, which hands the row back as soon as it can. A row that must stop keeps its last state, and says
    why in `errors`; the others go on.

    Parameters
    ----------
    mechanism : Mechanism
    N : int
        How many.
    q0, v0 : array_like (nq,), (nv,), or (N, nq), (N, nv), optional
        As in `simulate`: home, and at rest, when left out.
    step : float
        s.
    mode : array_like, optional
        As in `simulate`, where q0 is singular.
    joints : sequence of Stop, JointFriction, Lock, optional
        As in `simulate`; those of the mechanism's file when left out.
    t0 : float
        Time at the start, s.
    ctrl : mapping of str or array_like, optional
        Controls of the actuators, as `step` takes them.
    threads : int
        On which the rows are shared out.
    specialise : bool, optional
        Whether steps on regular ground are compiled for this mechanism, with the C++ compiler at hand: some
        20 times as fast as the kernel's, equal to 1e-13. When left out, where that is possible and many steps
        were asked for.

    Attributes
    ----------
    q, v : ndarray (N, nq), (N, nv)
        Where the rows are; not to be written to.
    status : ndarray of int (N,)
        0 for rows that go on, 1 for those that stopped.
    errors : dict of int to RobustGcpError
        Why they did.

    Raises
    ------
    OptionError, StateError, SimulationError
        As `Simulation` does for a start.

    Warns as `Simulation` does, of stability for the first row alone.

    Examples
    --------
    >>> import numpy as np
    >>> import robust_gcp as rg
    >>> batch = rg.Batch(rg.load("rhombus"), 3, step=1e-3)
    >>> q, v, *_ = batch.step(np.diag([1.0, 0.0, 0.0]), 100)
    >>> q.shape, batch.status.tolist()
    ((3, 3), [0, 0, 0])
    """

    def __init__(
        self,
        mechanism: Mechanism,
        N: int,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        step: float = 1e-3,
        *,
        mode: ArrayLike | None = None,
        joints: Sequence[Part] | None = None,
        t0: float = 0.0,
        ctrl: Controls | None = None,
        threads: int = 1,
        specialise: bool | None = None,
    ) -> None:
        check_mechanism(mechanism, Mechanism, "Batch")
        check_whole("N", N, 1)
        check_positive("step", step)
        check_finite("t0", t0)
        check_whole("threads", threads, 1)
        self.mechanism, self._step, self._t0 = mechanism, float(step), float(t0)
        self._joints = mechanism.parts if joints is None else parts_given(joints)
        self._pool = ThreadPoolExecutor(threads, "robust_gcp Batch") if threads > 1 else None
        self._ctrl: Array | None = None
        self.errors: dict[int, RobustGcpError] = {}
        self.status = np.zeros(N, np.int32)
        self._coarse = Coarse(mechanism, self._step)
        width = mechanism.nv + len(mechanism.actuators)
        self._state = RowState.room(int(N), self._step, mechanism.nq, mechanism.nv, width)
        kernel = chosen_library("auto", "bridge", "tangent")
        self._rows = BatchRows(kernel, mechanism, self._simulation, self._state, int(threads))
        self._power(ctrl)  # before rows begin: some do by simulations, under these
        self.reset(None, q0, v0, mode=mode)
        self._rows.specialise(specialise)  # coordinates are known once a row is there

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"Batch of {len(self)} motions of {self.mechanism.name!r}, {len(self.errors)} of them stopped"

    @property
    def q(self) -> Array:
        """Configurations (N, nq)."""
        return self._state.q

    @property
    def v(self) -> Array:
        """Velocities (N, nv)."""
        return self._state.v

    @property
    def t(self) -> Array:
        """Times (N,), s."""
        found: Array = self._state.t0 + self._step * self._state.at
        return found

    @property
    def crossings(self) -> NDArray[np.int64]:
        """How many singular places each row passed since it began, (N,)."""
        return self._rows.crossings()

    def reset(
        self,
        rows: ArrayLike | None = None,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        *,
        mode: ArrayLike | None = None,
    ) -> Batch:
        """Begin some rows anew at t0, under the controls given last; returns itself.

        Parameters
        ----------
        rows : array_like of int or of bool, optional
            All when left out.
        q0, v0 : array_like (nq,), (nv,), or one row for each of them, optional
            Home, and at rest, when left out.
        mode : array_like, optional
            As in `simulate`, which raises what this does; that row and those after it are as they were.
        """
        which = rows_given(rows, len(self))
        mechanism = self.mechanism
        q, v = (spread(x, len(which), size, name) for x, size, name in (
            (q0, mechanism.nq, "q0"), (v0, mechanism.nv, "v0")))  # fmt: skip
        for k, i in enumerate(which.tolist()):
            start = None if q is None else q[k], None if v is None else v[k], mode
            try:
                self._rows.begin(i, start, self._t0)
            except (StateError, SimulationError) as error:
                error.add_note(f"row {i}")
                raise
            self.errors.pop(i, None)
            self.status[i] = 0
        return self

    def step(
        self,
        tau: ArrayLike | Mapping[str, Any] | None = None,
        n: int = 1,
        *,
        ctrl: Controls | ArrayLike | None = None,
        out: tuple[Any, Any] | None = None,
        jacobians: bool = False,
    ) -> Stepped:
        """Take n steps of all rows that go on, under torques that are held over them.

        Parameters
        ----------
        tau : array_like (nv,) or (N, nv), or mapping {joint: torque}, optional
            N m and N; none when left out.
        n : int
        ctrl : mapping or array_like (n_u,), or array_like (N, n_u), optional
            Controls of the actuators from now on; as they were when left out.
        out : (ndarray (N, nq), ndarray (N, nv)), optional
            Where q and v are written, of any float type.
        jacobians : bool
            Whether A and B of the n steps are wanted, as `rg.step` has them; under torques, without `joints`.

        Returns
        -------
        Stepped
            q, v, and A (N, 2m, 2m), B (N, 2m, nv), NaN of rows that stopped.

        Raises
        ------
        OptionError, StateError
            For arguments that are none. No row's motion raises: see `errors`.
        """
        check_whole("n", n, 1)
        mechanism, held = self.mechanism, self._state.held
        mechanism.require_unchanged()
        torques = torques_given(mechanism, tau, len(self))
        require_room(out, self.q, self.v)
        if jacobians and (ctrl is not None or self._ctrl is not None):
            raise OptionError("jacobians=True goes with torques; give tau in place of ctrl")
        if jacobians and self._joints:
            raise OptionError("jacobians=True does not go with stops, friction, locks; rg.sensitivity does")
        if ctrl is not None:
            self._power(ctrl)
        held[:, : mechanism.nv] = torques
        A, B = None, None
        if jacobians:
            A, B = self._with_jacobians(int(n))
        else:
            self._go(int(n))
        if out is None:
            return Stepped(self.q.copy(), self.v.copy(), A, B)
        out[0][...], out[1][...] = self.q, self.v
        return Stepped(*out, A, B)

    def save(self) -> Any:
        """Where all rows are, to be given to `restore` as often as one likes."""
        return self._rows.save(), self.status.copy(), dict(self.errors), self._ctrl

    def restore(self, state: Any) -> Batch:
        """Go back to where `save` of this batch gave the state; returns itself.

        On regular ground and in zones to the last bit; bridges met later are built anew, equal to rounding.

        Raises OptionError for what this batch did not save.
        """
        if not isinstance(state, tuple) or len(state) != 4 or not self._rows.restore(state[0]):
            raise OptionError(f"state = {shown(state)} is not what save() of this batch returned")
        _, status, errors, self._ctrl = state
        self.status[:], self.errors = status, dict(errors)
        return self

    def _power(self, ctrl: Controls | ArrayLike | None) -> None:
        """Hold controls from now on."""
        nv = self.mechanism.nv
        if ctrl is None:
            self._state.held[:, nv:] = np.nan
            return
        self._ctrl, self._state.held[:, nv:] = controls_given(self.mechanism, ctrl, self._ctrl, len(self))

    def _go(self, n: int) -> None:
        """So many steps, some at a time, so that an interrupt is answered."""
        while n > 0:
            going = np.flatnonzero(self.status == 0)
            now = min(n, max(1, AT_ONCE // max(1, len(going) * self.mechanism.nv)))
            for i, error in self._rows.advance(going, now, self._pool):
                self.errors[i], self.status[i] = error, 1
            n -= now if len(going) else n
        if len(going):
            fastest = going[int(np.argmax(np.abs(self.v[going] / self.mechanism.units).max(axis=1)))]
            self._coarse.look(float(self.t[fastest]), self.v[fastest])

    def _with_jacobians(self, n: int) -> tuple[Array, Array]:
        """So many steps, and the derivatives of all of them together."""
        m, nv = self.mechanism.m, self.mechanism.nv
        A, B = np.tile(np.eye(2 * m), (len(self), 1, 1)), np.zeros((len(self), 2 * m, nv))
        for _ in range(n):
            going = np.flatnonzero(self.status == 0)
            states = self.q[going], self.v[going], self._state.held[going, :nv]
            after, by_tau = slopes_of_step(self.mechanism, *states, self._step, self._rows.coordinates(going))
            A[going], B[going] = after @ A[going], after @ B[going] + by_tau
            self._go(1)
        A[self.status != 0] = B[self.status != 0] = np.nan
        return A, B

    def _simulation(self, start: tuple[Any, Any, Any], t0: float, i: int, quiet: bool) -> Simulation:
        """A simulation of one row, from (q0, v0, mode) on."""
        ctrl = None if self._ctrl is None else self._ctrl[i]
        options: dict[str, Any] = {"joints": self._joints, "t0": t0, "ctrl": ctrl, "keep": "last"}
        q0, v0, mode = start
        with warnings.catch_warnings():
            if quiet:
                warnings.simplefilter("ignore")
            return Simulation(self.mechanism, q0, v0, self._step, mode=mode, **options)
