"""A torque function of the user's, asked by the kernel."""

from __future__ import annotations

from collections.abc import Generator

from ..dynamics.equations import CheckedTorque
from ..mechanism.tree import Array


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
