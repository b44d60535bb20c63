"""Which outputs of a run that goes on and on stay in memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...checks import check_whole, shown
from ...errors import OptionError


@dataclass(frozen=True)
class Keep:
    """Each `every`-th output since the start, none with 0; and the last one, if `last`."""

    every: int
    last: bool = True

    @classmethod
    def of(cls, given: Any) -> Keep:
        """What the argument `keep` of `Simulation` asks for.

        Raises
        ------
        OptionError
            For anything but "all", "last", "none" or a whole number from 1 on.
        """
        words = {"all": ALL, "last": cls(0), "none": cls(0, last=False)}
        if isinstance(given, str):
            if given not in words:
                known = ", ".join(words)
                raise OptionError(
                    f"keep = {shown(given)} is unknown; use one of {known}, or n to keep each n-th step"
                )
            return words[given]
        check_whole("keep", given, 1)
        return cls(int(given))

    @property
    def all(self) -> bool:
        """Whether nothing is ever let go."""
        return self.every == 1

    def among(self, first: int, n: int) -> NDArray[np.int64]:
        """Which of n outputs stay, the first of which has the number `first`."""
        return np.arange(-first % self.every, n, self.every) if self.every else np.arange(0)

    def shown(self, first: int, n: int) -> NDArray[np.int64] | slice:
        """The same, with the last one where that is told of."""
        if self.all:
            return slice(0, n)
        chosen = self.among(first, n)
        if self.last and n and not (len(chosen) and chosen[-1] == n - 1):
            return np.append(chosen, n - 1)
        return chosen


ALL = Keep(1)
