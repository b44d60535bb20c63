"""Error types. Each says what was wrong, names the culprit and the remedy, and carries the figures.

They travel between processes (pickle, copy) with their message, notes and attributes, the partial
trajectory among them; what Python itself drops on the way, `__cause__` and the traceback, is dropped.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray


class RobustGcpError(Exception):
    """Base of every error raised by this package.

    Attributes
    ----------
    trajectory : Trajectory or None
        What had been simulated when a run stopped; None outside a run.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.trajectory: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Rebuilt from `args` and attributes: subclasses take arguments that `args` does not hold."""
        return _rebuilt, (type(self), self.args), self.__dict__.copy()


def _rebuilt(kind: type[RobustGcpError], args: tuple[Any, ...]) -> RobustGcpError:
    """An error with these `args` whose attributes are still to be set."""
    error = kind.__new__(kind, *args)
    RobustGcpError.__init__(error, "".join(map(str, args[:1])))
    error.args = args
    return error


class OptionError(RobustGcpError, ValueError):
    """An argument of a call lies outside what the call accepts."""


class ModelError(RobustGcpError, ValueError):
    """A mechanism's description (URDF, YAML, closures, joint names) is wrong."""


class MissingFileError(ModelError, OptionError, FileNotFoundError):
    """There is no file where a call, or another file, says that it is."""

    def __new__(cls, *args: Any) -> MissingFileError:
        """Made as Python makes its own: an OSError has room for more than other errors."""
        return FileNotFoundError.__new__(cls, *args)


def missing_file(path: Any) -> MissingFileError:
    """The error for a path where nothing is."""
    where = "" if path.is_absolute() else f", in the folder {path.cwd()}"
    return MissingFileError(f"{path}: cannot be read: there is no such file{where}; check its path and name")


class ModelWarning(UserWarning):
    """Parts of a robot's file are not simulated, or its home is unusual; the message says what.

    `Mechanism.left_out` keeps the parts.
    """


class PerformanceWarning(UserWarning):
    """The compiled kernel does not take a mechanism, or its derivatives: Python does the work, far slower.

    The message names the reason and the remedy.
    """


class PartitionError(ModelError):
    """The chosen independent joints cannot serve as minimal coordinates anywhere.

    Attributes
    ----------
    choices : list of tuple of str
        Sets of joints that would serve, best conditioned first.
    """

    def __init__(self, message: str, choices: list[tuple[str, ...]] | None = None) -> None:
        super().__init__(message)
        self.choices = choices or []


class StateError(RobustGcpError, ValueError):
    """A configuration or velocity has the wrong shape, is not finite, or breaks the constraint."""


class ClosureError(StateError):
    """The loops are not closed, or cannot be closed.

    Attributes
    ----------
    residual : float
        Largest entry of φ (m or rad).
    loop : str
        The closure that is worst.
    nearest : ndarray (nq,) or None
        The configuration that was found, where one was looked for; (N, nq) of many guesses, NaN where none.
    failed : tuple of int
        Which of many guesses no configuration was found for.
    """

    nearest: NDArray[Any] | None = None
    failed: tuple[int, ...] = ()

    def __init__(self, message: str, residual: float, loop: str) -> None:
        super().__init__(message)
        self.residual = residual
        self.loop = loop


class MissingExtraError(RobustGcpError, ImportError):
    """An optional dependency is needed and is not installed."""


def missing_extra(needed: str, packages: str, extra: str) -> MissingExtraError:
    """The error where an optional dependency is missing, with a remedy for checkouts and installations.

    Parameters
    ----------
    needed : str
        What needs what, such as "figures need matplotlib".
    packages : str
        As pip takes them.
    extra : str
        The extra of robust_gcp that brings them.
    """
    return MissingExtraError(
        f"{needed}, which is not installed: pip install {packages}, or in a checkout of robust_gcp "
        f'pip install ".[{extra}]"'
    )


class SweepError(RobustGcpError, RuntimeError):
    """The workers of a sweep cannot start, or the executor it was given broke."""


class SimulationError(RobustGcpError, RuntimeError):
    """A run had to stop.

    Attributes
    ----------
    y : ndarray (m,) or None
        Independent coordinates where it stopped.
    details : dict
        Figures that led to the decision.
    """

    def __init__(self, message: str, y: NDArray[Any] | None = None, **details: Any) -> None:
        super().__init__(message)
        self.y = None if y is None else y.copy()
        self.details = details


class NonFiniteError(SimulationError):
    """The state left the finite numbers."""


class BranchError(SimulationError):
    """The dependent joints could not be followed on their branch, however small the marching step."""


class ToggleError(SimulationError):
    """K_d is singular while K is not: the independent coordinates turn back here.

    Attributes
    ----------
    choices : list of tuple of str
        Sets of joints that parametrise the motion here, best conditioned first.
    """

    def __init__(
        self,
        message: str,
        y: NDArray[Any] | None = None,
        choices: list[tuple[str, ...]] | None = None,
        **details: Any,
    ) -> None:
        super().__init__(message, y, **details)
        self.choices = choices or []


class NotDifferentiableError(SimulationError):
    """The end of a run is no smooth function of its start: a stop is grazed, or several are met at once."""


class SingularStartError(SimulationError):
    """The start is a singular configuration and neither mode nor velocity says where to go."""


class NotCertifiedError(SimulationError):
    """A singularity whose local structure is not decided: going on would be a guess."""


class CuspError(NotCertifiedError):
    """The mode ends in a cusp: both its branches leave to one side, and the equations of motion end there.

    Attributes
    ----------
    time : float or None
        When the motion arrives, s; None where it was not followed there.
    q : ndarray (nq,)
        The cusp.
    v : ndarray (nv,)
        The velocity of arrival; None as `time`.
    joints : tuple of str
        Of the loops that have the cusp.
    branches : tuple of two ndarray (nq,)
        A configuration on each branch, the one that the motion came by first.
    """

    def __init__(self, message: str, y: NDArray[Any] | None = None, **details: Any) -> None:
        super().__init__(message, y, **details)
        self.time: float | None = None
        self.q: Any = None
        self.v: Any = None
        self.branches: Any = ()
        self.joints: tuple[str, ...] = ()
        self.met: Any = None
        self.arrival: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Without what belongs to its mechanism."""
        kind, args, state = super().__reduce__()
        return kind, args, {**state, "met": None, "arrival": None}
