"""One step of RK4 from a state, or from many, with nothing kept: a function of its arguments alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_finite, check_mechanism, check_positive, is_table
from ...dynamics.loads import Torques
from ...errors import OptionError
from ...kernel.derivatives.derivations import left_to_python
from ...kernel.derivatives.step_derivatives import Derivation
from ...mechanism.building.variable_geometry import still_rows
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..simulate import simulate
from .accelerations import answered, is_alone, learned
from .at_states import AtStates, on_threads
from .serving_coordinates import parametrises, those_that_served
from .step_derivatives import differentiated, parts_by_kernel, step_by_kernel
from .step_of_motion import Acting, Moved


class Stepped(NamedTuple):
    """States after a step, and its derivatives where they were asked for; N is the first axis of many.

    Attributes
    ----------
    q, v : ndarray (nq,), (nv,)
    A : ndarray (2m, 2m) or None
        δ(η, u) after the step by δ(η, u) before it: η along the velocities G e_j at either end, u the
        independent velocities.
    B : ndarray (2m, nv) or None
        By torques that are added over the step.
    """

    q: Array
    v: Array
    A: Array | None
    B: Array | None

    def first(self) -> Stepped:
        """That from the first of many states."""
        slopes = (None if part is None else part[0] for part in (self.A, self.B))
        return Stepped(self.q[0], self.v[0], *slopes)


def step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    h: float = 1e-3,
    jacobians: bool = False,
    mode: ArrayLike | None = None,
    t: float = 0.0,
    threads: int = 1,
) -> Stepped:
    """One step of RK4 on the explicit equations (3) from each state, the one that `simulate` takes.

    In the mechanism's coordinates as long as these serve: beside their dead points, where `simulate` takes
    others in which its steps are more accurate, with the larger error that they have there.

    Beside singular configurations that no series of the mode is known of, it is followed by parts, as
    `simulate` follows it with error control there; where rounding leaves G uncertain, by `simulate` or, with
    derivatives, by the reference.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,), or (N, nq), (N, nv)
        Closed, and K v = 0; at rest when v is left out.
    tau : optional
        Torques as in `simulate`, asked at the stages where they are functions; of many states also (N, nv).
    h : float
        s.
    jacobians : bool
        Whether A and B are wanted; torques are numbers then.
    mode : array_like, optional
        As in `simulate`, where q is singular.
    t : float
        Time at the start, s.
    threads : int
        On which many states are shared out.

    Returns
    -------
    Stepped

    Raises
    ------
    StateError, SimulationError
        As `simulate`.
    ModelError
        For ellipsoid joints, with derivatives.
    """
    check_mechanism(mechanism, Mechanism, "step")
    check_positive("h", h)
    check_finite("t", t)
    states = AtStates.of(mechanism, q, v, tau, mode=mode)
    if states.function is not None and jacobians:
        raise OptionError(
            "step: jacobians=True goes with torques that are held; give tau as numbers, such as what the "
            "function says at the state"
        )
    found = on_threads(states, threads, lambda part: _stepped(part, float(h), jacobians, mode, t), _joined)
    return found.first() if states.one else found


def step_jacobians(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: ArrayLike | None,
    step: float,
    mode: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Jacobians of one step of RK4, the torques held over it.

    δ(η, u) after the step = A δ(η, u) before it + B δτ, η along the velocities G e_j at either end and u the
    independent velocities.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,), or (N, nq), (N, nv)
        Closed, and K v = 0; at rest where v is None.
    tau : array_like (nv,), (N, nv) or mapping {joint: torque}, optional
        N m and N, besides the mechanism's own forces; None: none.
    step : float
        s.
    mode : array_like, optional
        As in `simulate`, where q is singular.

    Returns
    -------
    A : ndarray (2m, 2m) or (N, 2m, 2m)
    B : ndarray (2m, nv) or (N, 2m, nv)

    Raises
    ------
    StateError, SimulationError, ModelError
        As `derivatives` does.
    """
    check_mechanism(mechanism, Mechanism, "step_jacobians")
    check_positive("step", step)
    held: Any = tau if tau is None or is_table(tau) else mechanism.velocity(tau, "tau")
    states = AtStates.of(mechanism, q, v, held, mode=mode)
    found = _stepped(states, float(step), True, mode, 0.0)
    assert found.A is not None and found.B is not None  # they were asked for
    return (found.A[0], found.B[0]) if states.one else (found.A, found.B)


def _stepped(states: AtStates, h: float, jacobians: bool, mode: ArrayLike | None, t: float) -> Stepped:
    """A step from each of many states."""
    mechanism, n = states.mechanism, len(states)
    m, nv = mechanism.m, mechanism.nv
    kernel = states.kernel()
    after = Stepped(np.empty_like(states.q), np.empty_like(states.v), None, None)
    if jacobians:
        after = after._replace(A=np.empty((n, 2 * m, 2 * m)), B=np.empty((n, 2 * m, nv)))

    def ask(which: NDArray[np.intp]) -> NDArray[np.bool_]:
        assert kernel is not None  # asked only where there is one
        some = states.some(which)
        acting = some.tau, h, jacobians, states.function, t
        good, *found = kernel.step_each(some.q, some.v, *acting, states.mode)
        for whole, part in zip(after, found, strict=True):
            if whole is not None and part is not None:
                whole[which] = part
        return good

    def by_others(which: NDArray[np.intp]) -> Iterator[int]:
        if states.function is None:
            yield from (i for i in which.tolist() if _by_others(states, i, h, after))

    missing = np.arange(n) if kernel is None else answered(kernel, states, ask, by_others, h)
    for i in missing.tolist():
        with states.naming(i):
            if kernel is None or not _where_poor(states, kernel, i, h, after):
                _by_reference(states, i, h, mode, t, after)
    return after


def _by_others(states: AtStates, i: int, h: float, after: Stepped) -> bool:
    """Whether the kernel took the step from a state in other coordinates that served before."""
    mechanism, state = states.mechanism, (states.q[i], states.v[i])
    acting = Acting(None if states.tau is None else states.tau[i], held=still_rows(mechanism))
    for other in those_that_served(mechanism):
        moved = step_by_kernel(other, state, None, acting, h, None)
        if moved is not None and parametrises(mechanism, moved.first.G):
            _write(moved.told_in(mechanism), i, after)
            return True
    return False


def _where_poor(states: AtStates, kernel: Derivation, i: int, h: float, after: Stepped) -> bool:
    """Whether the kernel took the step from a state where K_d is poor: in other coordinates, or by parts.

    By parts where neither these nor a series of the mode are known, and `simulate` controls its error.
    """
    mechanism, state = states.mechanism, (states.q[i], states.v[i])
    if states.function is not None or states.mode is not None:
        return False
    alone = is_alone(kernel, mechanism, *state)
    if not alone:
        learned(kernel, mechanism, *state, h)
        alone = is_alone(kernel, mechanism, *state)
    if not alone:
        return _by_others(states, i, h, after)
    acting = Acting(None if states.tau is None else states.tau[i], held=still_rows(mechanism))
    moved = parts_by_kernel(mechanism, state, None, acting, h, None)
    if moved is not None:
        _write(moved, i, after)
    return moved is not None


def _write(moved: Moved, i: int, after: Stepped) -> None:
    after.q[i], after.v[i] = moved.q, moved.v
    if after.A is not None and after.B is not None:
        after.A[i], after.B[i] = moved.A, moved.B


def _by_reference(
    states: AtStates, i: int, h: float, mode: ArrayLike | None, t: float, after: Stepped
) -> None:
    """Write the step from a state as `simulate` or the reference take it."""
    mechanism, state, torque = states.mechanism, (states.q[i], states.v[i]), states.torque_at(i)
    function = states.function
    if after.A is not None and after.B is not None:
        held = None if torque is None else mechanism.velocity(torque, "tau")
        acts = Acting(held, held=still_rows(mechanism))
        _write(differentiated(mechanism, state, mode, acts, t, h), i, after)
        return
    left_to_python(mechanism, "single steps")
    # from 0 on: between t and t + h lies h but for rounding, which would be another step
    acting = torque if function is None else lambda s, q, v: function(t + s, q, v)
    run = simulate(mechanism, *state, duration=h, step=h, torque=acting, mode=mode)
    after.q[i], after.v[i] = run.q[-1], run.v[-1]


def _joined(parts: list[Stepped]) -> Stepped:
    q, v, A, B = zip(*parts, strict=True)
    slopes = (None if part[0] is None else np.concatenate(part) for part in (A, B))
    return Stepped(np.concatenate(q), np.concatenate(v), *slopes)
