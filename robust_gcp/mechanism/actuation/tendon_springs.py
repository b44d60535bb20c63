"""Springs and dampers along tendons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_finite, shown
from ...errors import ModelError
from ..forces.forces import Force, Vector
from ..tree.tree import Array
from .paths import BoundPath, Path, SumOfJoints

if TYPE_CHECKING:
    from ..mechanism import Mechanism


@dataclass(frozen=True)
class TendonSpring(Force):
    """A spring along a path, slack between two lengths, and a damper: −stiffness x − damping ℓ̇ along it.

    Parameters
    ----------
    path : Path
        x is by how much ℓ is above `upper`, or below `lower`, where negative.
    stiffness, damping : float
        N/m and N s/m, or of angles N m/rad and N m s/rad; not negative.
    lower, upper : float
        m or rad.
    """

    path: Path
    stiffness: float
    lower: float = 0.0
    upper: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.path, Path):
            raise ModelError(f"TendonSpring: path = {shown(self.path)} is no path, such as FixedTendon")
        for name in ("stiffness", "lower", "upper", "damping"):
            check_finite(f"TendonSpring: {name}", getattr(self, name))
        if self.stiffness < 0.0 or self.damping < 0.0 or self.lower > self.upper:
            raise ModelError(
                "TendonSpring: stiffness and damping are not negative, and lower not above upper"
            )

    def bound(self, mechanism: Mechanism) -> BoundPath:
        """Its path in a mechanism."""
        made: BoundPath = mechanism.memo.once(
            ("path", self.path), lambda: self.path.on(mechanism.tree, "TendonSpring")
        )
        return made

    def _stretch(self, length: float) -> float:
        return length - min(max(length, self.lower), self.upper)

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> ArrayLike:
        """τ(q, v), (nv,)."""
        return self.pulls(mechanism, q, v)[0]

    def force(self, mechanism: Mechanism, q: Array, v: Array) -> float:
        """Along the path, N or N m."""
        return self._at(mechanism, q, v)[0]

    def pulls(self, mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,), and the power of the damper, W."""
        force, moment, rate = self._at(mechanism, q, v)
        return force * moment, -self.damping * rate**2

    def _at(self, mechanism: Mechanism, q: Array, v: Array) -> tuple[float, Array, float]:
        """The force along the path, its moment arms (nv,), and its rate."""
        path = self.bound(mechanism)
        mechanism.tree.jacobians(q)
        length, moment = path.length_at(q)
        rate = float(moment @ v)
        return -(self.stiffness * self._stretch(length) + self.damping * rate), moment, rate

    def energy(self, mechanism: Mechanism, q: Array) -> float:
        """½ stiffness x², J."""
        path = self.bound(mechanism)
        mechanism.tree.jacobians(q)
        return 0.5 * self.stiffness * self._stretch(path.length_at(q)[0]) ** 2

    def derivatives(self, mechanism: Mechanism, q: Vector, v: Vector) -> tuple[ArrayLike, ArrayLike]:
        """∂τ/∂q and ∂τ/∂v, (nv, nv) each: exact where the moment arms are constant, else by differences."""
        path = self.bound(mechanism)
        if not isinstance(path, SumOfJoints):
            return super().derivatives(mechanism, q, v)
        length, moment = path.length_at(q)
        outer = np.outer(moment, moment)
        pulls = self.stiffness if self._stretch(length) else 0.0  # slack between both lengths
        return -pulls * outer, -self.damping * outer
