"""Prescribed motions: where a driven joint is at each time, how fast it moves, and how it accelerates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...checks import check_callable, real_array, shown
from ...errors import NonFiniteError, OptionError
from ...mechanism.tree.tree import Array
from .time_rates import rates

LOOKED_AT = (0.0, 0.137, 0.389, 0.618, 0.911)
"""Shares of a run at which given rates are compared with differences of the position."""

LOOKED_AT_AGAIN = 5
"""Times of many at which what functions gave for all at once is compared with what they give for one."""

NUDGE = 1e-5
"""Step of these differences, s."""

SPLINE = ("t", "x", "c", "k", "axis", "extrapolate")
"""What scipy's splines are made of."""

HALVINGS, JUMP = 25, 0.01
"""Of an interval in which ṗ may jump, and the share of its change that is a jump if it is left then: a smooth
motion leaves 3e-8."""

UNLIKE = 1e-3
"""Relative difference at which a given rate is taken for wrong."""


class Motion:
    """A joint's position as a function of time: p(t), ṗ(t) and p̈(t).

    Parameters
    ----------
    position : callable (t) -> float, number, (times, positions) or spline
        rad or m. A function of NumPy's functions and of operators; a number is held; a table is joined by a
        spline of degree five, with four continuous derivatives; a spline is one of scipy's, which
        differentiates itself.
    velocity, acceleration : callable (t) -> float, optional
        Its first and second derivative. Where left out, the functions are differentiated to rounding.

    Raises
    ------
    OptionError
        For what is no motion.
    """

    def __init__(
        self,
        position: Any,
        velocity: Callable[[float], float] | None = None,
        acceleration: Callable[[float], float] | None = None,
    ) -> None:
        check_callable("Motion: velocity", velocity, "(t)")
        check_callable("Motion: acceleration", acceleration, "(t)")
        if acceleration is not None and velocity is None:
            raise OptionError("Motion: an acceleration needs the velocity beside it; give both, or neither")
        given = {"position": position, "velocity": velocity, "acceleration": acceleration}
        self._given = {name: part for name, part in given.items() if part is not None}
        self.position, self.velocity, self.acceleration = position, velocity, acceleration
        self.span: tuple[float, float] | None = None
        if not callable(position):
            self.position = _held(position) if _is_single(position) else self._joined(position)
        if hasattr(self.position, "derivative") and velocity is None:
            try:
                self.velocity, self.acceleration = self.position.derivative(1), self.position.derivative(2)
            except ValueError as error:  # of degree 1, or 0
                raise OptionError(
                    f"Motion: position = {shown(position)} has no second derivative ({error}); give a spline "
                    "of degree 3 or more, or the table itself"
                ) from error

    def recipe(self) -> dict[str, Any]:
        """What it was made of by name, a spline by its knots, coefficients and degree."""
        found = dict(self._given)
        if not callable(found["position"]):
            return found
        spline = found["position"]
        parts = {name: getattr(spline, name) for name in SPLINE if hasattr(spline, name)}
        return found | {"position": parts or spline}

    def kink(self, t0: float, t1: float) -> tuple[float, float, float] | None:
        """Where between two times ṗ jumps, s, and ṗ before and after; None where it does not.

        The half in which ṗ changes more is halved again, until a smooth motion would change no more.
        """
        first, last = self.at(t0)[1], self.at(t1)[1]
        whole = abs(last - first)
        for _ in range(HALVINGS):
            middle = 0.5 * (t0 + t1)
            rate = self.at(middle)[1]
            if abs(rate - first) >= abs(last - rate):
                t1, last = middle, rate
            else:
                t0, first = middle, rate
        return (t1, first, last) if abs(last - first) > JUMP * whole else None

    def _joined(self, table: Any) -> Any:
        """The spline through (times, positions)."""
        from scipy.interpolate import make_interp_spline

        try:
            times, values = (real_array(part) for part in table)
        except (TypeError, ValueError) as error:
            raise OptionError(
                f"Motion: position = {shown(table)} is no function, number or (times, positions)"
            ) from error
        sound = times.ndim == 1 and times.shape == values.shape and len(times) > 3
        if not sound or not np.all(np.isfinite(values)) or not np.all(np.diff(times) > 0.0):
            raise OptionError(
                "Motion: a table is (times, positions) of one length, at least 4, finite, the times ascending"
            )
        self.span = float(times[0]), float(times[-1])
        return make_interp_spline(times, values, k=5 if len(times) > 5 else 3)

    def at(self, t: float) -> tuple[float, float, float]:
        """p, ṗ and p̈ at time t, s.

        Raises
        ------
        OptionError
            Where it cannot be differentiated, with the remedy; outside the table.
        NonFiniteError
        """
        if self.span is not None and not self.span[0] - 1e-12 <= t <= self.span[1] + 1e-12:
            raise OptionError(
                f"the table of a Motion ends: it lasts from {self.span[0]:g} to {self.span[1]:g} s, and the "
                f"run asks for t = {t:g} s; give a longer one, or a shorter duration"
            )
        if self.velocity is None:
            found = _derived(self.position, t, "position")
        elif self.acceleration is None:
            found = (_number(self.position, t, "position"), *_derived(self.velocity, t, "velocity")[:2])
        else:
            given = zip(("position", "velocity", "acceleration"), self._functions, strict=True)
            one, two, three = (_number(f, t, name) for name, f in given)
            found = one, two, three
        if not np.all(np.isfinite(found)):
            raise NonFiniteError(f"a Motion is not finite at t = {t:.6g} s: p, ṗ, p̈ = {found}")
        return found

    def over(self, times: Array) -> Array:
        """p, ṗ and p̈ at each time, (3, n): at once where its functions take arrays, else one by one.

        Raises
        ------
        OptionError, NonFiniteError
            As `at`.
        """
        found = self._at_once(times) if len(times) > LOOKED_AT_AGAIN else None
        return np.array([self.at(t) for t in times.tolist()]).T if found is None else found

    def _at_once(self, times: Array) -> Array | None:
        """The same by arrays, of which some entries are looked at; None where its functions take none."""
        found: Array = np.empty((3, len(times)))
        try:
            with np.errstate(all="ignore"):
                if self.velocity is None:
                    found[:] = np.broadcast_arrays(*rates(self.position, times), times)[:3]
                elif self.acceleration is None:
                    found[0] = self.position(times)
                    found[1:] = np.broadcast_arrays(*rates(self.velocity, times)[:2], times)[:2]
                else:
                    found[:] = [np.broadcast_to(f(times), times.shape) for f in self._functions]
        except Exception:  # whatever a function that takes numbers alone does with an array
            return None
        # a function with branches may take an array and mean something else by it
        some = np.linspace(0, len(times) - 1, LOOKED_AT_AGAIN).astype(int)
        wanted = np.array([self.at(t) for t in times[some].tolist()]).T
        same = np.allclose(found[:, some], wanted, rtol=1e-13, atol=1e-13 * np.abs(found).max())
        return found if same and np.all(np.isfinite(found)) else None

    @property
    def _functions(self) -> tuple[Any, Any, Any]:
        return self.position, self.velocity, self.acceleration

    def require_consistent(self, label: str, t0: float, t1: float) -> None:
        """An OptionError where a given velocity or acceleration is not the derivative that it should be."""
        if self.velocity is None:
            return
        for t in (t0 + share * (t1 - t0 - 2.0 * NUDGE) + NUDGE for share in LOOKED_AT):
            before, here, after = self.at(t - NUDGE), self.at(t), self.at(t + NUDGE)
            for i, what in enumerate(("velocity", "acceleration")):
                slope = (after[i] - before[i]) / (2.0 * NUDGE)
                # at a kink one side agrees
                sided = [(after[i] - here[i]) / NUDGE, (here[i] - before[i]) / NUDGE]
                scale = abs(slope) + abs(here[i + 1]) + abs(here[i]) + 1e-6
                if min(abs(s - here[i + 1]) for s in (slope, *sided)) > UNLIKE * scale:
                    raise OptionError(
                        f"drive[{label!r}]: the {what} given is {here[i + 1]:.6g} at t = {t:.4g} s, where "
                        f"{('the position', 'the velocity')[i]} changes by {slope:.6g} a second; correct "
                        "it, or leave it out"
                    )


def _is_single(value: Any) -> bool:
    """Whether it is one number, if any."""
    try:
        return np.ndim(value) == 0
    except ValueError:  # of lists of different lengths
        return False


def _held(value: Any) -> Callable[[Any], float]:
    try:
        number = float(real_array(value))
    except TypeError as error:
        raise OptionError(f"Motion: position = {shown(value)} is no number, function or table") from error
    return lambda t: number


def _number(f: Callable[[float], Any], t: float, what: str) -> float:
    try:
        value = real_array(f(t))
        if value.size != 1:
            raise TypeError
    except TypeError as error:
        raise OptionError(f"Motion: {what}(t) returned no number at t = {t:g} s") from error
    return float(value.reshape(()))


def _derived(f: Callable[[float], Any], t: float, what: str) -> tuple[float, float, float]:
    try:
        with np.errstate(all="ignore"):  # what is not finite is told by the caller
            return rates(f, t)
    except (TypeError, AttributeError, ValueError) as error:
        _number(f, t, what)  # says so if the function itself is at fault
        raise OptionError(
            f"Motion: {what}(t) cannot be differentiated by itself ({error}); write it with operators and "
            "NumPy's functions (np.sin instead of math.sin), or give "
            + ("velocity= and acceleration=" if what == "position" else "acceleration=")
            + ", or a table (times, positions)"
        ) from error
