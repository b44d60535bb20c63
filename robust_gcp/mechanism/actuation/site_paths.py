"""Paths of actuators on sites: a force and moment, and a slider that a rod joins to a crank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...checks import check_positive, check_text, checked_vector
from ..frames import place_of
from ..tree.tree import Array, Tree
from ..tree.vectors import cross
from .paths import BoundPath, Load, Path, PathOnBodies

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


class _OnSite(PathOnBodies):
    def __init__(self, tree: Tree, path: SiteForce, owner: str) -> None:
        super().__init__(tree)
        self._path, self._gear = path, np.array(path.gear)
        self._site, self._reference = place_of(tree.model, path.site, owner), None
        if path.reference is not None:
            self._reference = place_of(tree.model, path.reference, owner)

    def _placed(self, frame: Placed) -> tuple[Array, Array]:
        R, p = self._tree.R[frame[0]], self._tree.p[frame[0]]
        return R @ frame[1].rotation, p + R @ frame[1].translation

    def pulled(self) -> tuple[float, list[Load]]:
        """See `PathOnBodies`."""
        R, p = self._placed(self._site)
        if self._reference is None:
            return 0.0, [(self._path.site, self._site[0], p, R @ self._gear[:3], R @ self._gear[3:])]
        axes, origin = self._placed(self._reference)
        length = float(self._gear @ np.concatenate([axes.T @ (p - origin), pin.log3(axes.T @ R)]))
        force, moment = axes @ self._gear[:3], axes @ self._gear[3:]
        return length, [
            (self._path.site, self._site[0], p, force, moment),
            (str(self._path.reference), self._reference[0], p, -force, -moment),
        ]


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


class _Cranked(PathOnBodies):
    def __init__(self, tree: Tree, path: SliderCrank, owner: str) -> None:
        super().__init__(tree)
        self._path, self._rod = path, float(path.rod)
        self._crank, self._slider = (place_of(tree.model, name, owner) for name in (path.crank, path.slider))

    def pulled(self) -> tuple[float, list[Load]]:
        """ℓ = a·d − √((a·d)² + rod² − d·d), d from the slider's site to the crank's; a·d beyond its reach."""
        tree, (i, on_crank), (j, on_slider) = self._tree, self._crank, self._slider
        axis = tree.R[j] @ on_slider.rotation[:, 2]
        at_crank = tree.p[i] + tree.R[i] @ on_crank.translation
        at_slider = tree.p[j] + tree.R[j] @ on_slider.translation
        d = at_crank - at_slider
        along = length = float(axis @ d)
        by_d, by_axis = axis, d
        square = along**2 + self._rod**2 - float(d @ d)  # negative where the rod does not reach the axis
        if square > 0.0:
            root = float(np.sqrt(square))
            share = 1.0 - along / root
            length, by_d, by_axis = along - root, share * axis + d / root, share * d
        return length, [
            (self._path.crank, i, at_crank, by_d, np.zeros(3)),
            (self._path.slider, j, at_slider, -by_d, cross(axis, by_axis)),  # the axis turns by ω × axis
        ]
