"""What the kernel looks at after each step to tell that other coordinates may serve better."""

from __future__ import annotations

from typing import NamedTuple

from ..mechanism.tree import Array


class Watch(NamedTuple):
    """Up to where steps go on in the same coordinates; see `simulation/runs/coordinates.py`.

    Attributes
    ----------
    sizes : ndarray (nv,)
        1 / unit of each velocity in its cluster's dimensionless coordinates; 0 where J does not matter.
    limit : float
        Largest entry of J.
    uneven : ndarray (m,)
        Largest unevenness, max |g| / (max |v|)² in radians and lengths, of the cluster of each input.
    """

    sizes: Array
    limit: float
    uneven: Array
