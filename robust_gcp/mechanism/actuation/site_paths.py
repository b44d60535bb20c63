"""Paths of actuators on sites: a force and moment, and a slider that a rod joins to a crank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...checks import check_positive, check_text, checked_vector
from ..tree.joints import support
from ..tree.tree import Array, Tree
from ..tree.vectors import cross
from .paths import BoundPath, Load, Path, placed_frame

Placed = tuple[int, pin.SE3]


@dataclass(frozen=True)
class SiteForce(Path):
    """A force and moment fixed in a site: ℓ̇ = gear · its velocity (linear, angular) in its own axes.

    Parameters
    ----------
    site : str
    gear : sequence of 6 floats
    reference : str, optional
        A site from which position and rotation are seen; ℓ is then gear · (position, rotation vector) in its
        axes, else 0.
    """

    site: str
    gear: Sequence[float]
    reference: str | None = None

    def __post_init__(self) -> None:
        check_text("SiteForce: site", self.site)
        if self.reference is not None:
            check_text("SiteForce: reference", self.reference)
        gear = checked_vector(self.gear, 6, "SiteForce: gear", "6")
        object.__setattr__(self, "gear", tuple(gear.tolist()))

    def on(self, tree: Tree, owner: str) -> BoundPath:
        """See `Path`."""
        return _OnSite(tree, self, owner)


class _OnSite(BoundPath):
    def __init__(self, tree: Tree, path: SiteForce, owner: str) -> None:
        self._tree, self._path, self._carried = tree, path, np.zeros(tree.nv)
        self._gear = np.array(path.gear)
        self._site, self._reference = placed_frame(tree, path.site, owner), None
        self._carried[support(tree.model, self._site[0])] = 1.0
        if path.reference is not None:
            self._reference = placed_frame(tree, path.reference, owner)
            self._carried[support(tree.model, self._reference[0])] -= 1.0

    def _placed(self, frame: Placed) -> tuple[Array, Array]:
        R, p = self._tree.R[frame[0]], self._tree.p[frame[0]]
        return R @ frame[1].rotation, p + R @ frame[1].translation

    def length_at(self, q: Array) -> tuple[float, Array]:
        """See `BoundPath`."""
        R, p = self._placed(self._site)
        axes, length = R, 0.0
        if self._reference is not None:
            axes, origin = self._placed(self._reference)
            length = float(self._gear @ np.concatenate([axes.T @ (p - origin), pin.log3(axes.T @ R)]))
        force, torque = axes @ self._gear[:3], axes @ self._gear[3:]
        return length, (self._tree.J @ np.concatenate([force, torque + cross(p, force)])) * self._carried

    def loads(self) -> list[Load]:
        """See `BoundPath`."""
        R, p = self._placed(self._site)
        axes = R if self._reference is None else self._placed(self._reference)[0]
        force, moment = axes @ self._gear[:3], axes @ self._gear[3:]
        found: list[Load] = [(self._path.site, self._site[0], p, force, moment)]
        if self._reference is not None:
            found.append((str(self._path.reference), self._reference[0], p, -force, -moment))
        return found


@dataclass(frozen=True)
class SliderCrank(Path):
    """ℓ of a slider on a site's z axis, which a rod joins to a crank's site.

    Parameters
    ----------
    crank, slider : str
        Sites.
    rod : float
        Length of the rod, m.
    """

    crank: str
    slider: str
    rod: float

    def __post_init__(self) -> None:
        check_text("SliderCrank: crank", self.crank)
        check_text("SliderCrank: slider", self.slider)
        check_positive("SliderCrank: rod", self.rod)

    def on(self, tree: Tree, owner: str) -> BoundPath:
        """See `Path`."""
        return _Cranked(tree, self, owner)


class _Cranked(BoundPath):
    def __init__(self, tree: Tree, path: SliderCrank, owner: str) -> None:
        self._tree, self._path, self._rod = tree, path, float(path.rod)
        self._crank, self._slider = (placed_frame(tree, name, owner) for name in (path.crank, path.slider))
        self._of_crank, self._of_slider = np.zeros(tree.nv), np.zeros(tree.nv)
        self._of_crank[support(tree.model, self._crank[0])] = 1.0
        self._of_slider[support(tree.model, self._slider[0])] = 1.0

    def _found(self) -> tuple[float, Array, Array, Array, Array]:
        """ℓ, its derivatives by the crank's point and the slider's axis, and these points."""
        tree, (i, on_crank), (j, on_slider) = self._tree, self._crank, self._slider
        axis = tree.R[j] @ on_slider.rotation[:, 2]
        at_crank = tree.p[i] + tree.R[i] @ on_crank.translation
        at_slider = tree.p[j] + tree.R[j] @ on_slider.translation
        d = at_crank - at_slider
        along = float(axis @ d)
        square = along**2 + self._rod**2 - float(d @ d)
        if square <= 0.0:
            return along, axis, cross(axis, d), at_crank, at_slider
        root = float(np.sqrt(square))
        share = 1.0 - along / root
        return along - root, share * axis + d / root, share * cross(axis, d), at_crank, at_slider

    def length_at(self, q: Array) -> tuple[float, Array]:
        """ℓ = a·d − √((a·d)² + rod² − d·d), d from the slider's site to the crank's; a·d beyond its reach."""
        length, by_d, turning, at_crank, at_slider = self._found()
        J = self._tree.J
        moment = (J @ np.concatenate([by_d, cross(at_crank, by_d)])) * self._of_crank
        moment -= (J @ np.concatenate([by_d, cross(at_slider, by_d) - turning])) * self._of_slider
        return length, moment

    def loads(self) -> list[Load]:
        """See `BoundPath`."""
        _, by_d, turning, at_crank, at_slider = self._found()
        none = np.zeros(3)
        return [
            (self._path.crank, self._crank[0], at_crank, by_d, none),
            (self._path.slider, self._slider[0], at_slider, -by_d, turning),
        ]
