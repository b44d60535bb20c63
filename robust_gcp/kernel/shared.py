"""The numbers that Python and the kernel both read and write."""

from __future__ import annotations

from ..mechanism.mechanism import Mechanism
from .structures import Request, side_by_side


class Shared:
    """Buffers side by side, which a request points to.

    Parameters
    ----------
    request : Request
    mechanism : Mechanism
    n : int
        Numbers of a state.
    size : int
        Of a point.

    Attributes
    ----------
    time : ndarray (1,)
        Pointed to where a single time is given; see `at_time`.
    x, rate : ndarray (n,)
    anchor : ndarray (size,)
    safe : ndarray (size + n,)
    ydd, tau, origin : ndarray (m,), (nv,), (nq,)
    at_time : int
        The address of `time`.
    """

    def __init__(self, request: Request, mechanism: Mechanism, n: int, size: int) -> None:
        sizes = {"x": n, "rate": n, "anchor": size, "safe": size + n}
        sizes |= {"ydd": mechanism.m, "tau": mechanism.nv, "origin": mechanism.nq, "time": 1}
        arrays, places = side_by_side(sizes)
        self.x, self.rate, self.anchor, self.safe, self.ydd, self.tau, self.origin, self.time = arrays
        self.at_time = places.pop("time")
        for name, place in places.items():
            setattr(request, name, place)
