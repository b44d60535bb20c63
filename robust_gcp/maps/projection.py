"""Robust GCP as published: the projection of Eq. (7) where K_d is rank deficient."""

from __future__ import annotations

import numpy as np

from ..errors import BranchError, NonFiniteError
from ..mechanism.coordinates.partition import numerical_rank
from ..mechanism.tree.tree import Array
from .explicit import Charted, Crossing, Point, Stretch
from .regular_path import RegularPath

PROJECTION_THRESHOLD = 1e-3
"""Relative size below which a singular value counts as zero in Eq. (7).

At distance δ from a crossing classical GCP loses ε/δ³ of g and the projection errs by the first
order of δ on a curved mode; 1e-3 keeps the loss near 1e-7 of g for a step or two."""


class ProjectionMap(Charted):
    """Classical GCP with G from the kernel of K beside singular configurations, Eq. (7).

    With N an orthonormal basis of ker K (rank by relative singular values) and G⁻ the map's last G,
    G = N Nᵀ G⁻ (G_independent)⁻¹, so that the independent rows are the identity. The direction lives
    in G⁻, not in a velocity that may be zero. The paper leaves g open at the singularity; it is 0
    there. On straight modes (the rhombus and parallelogram) this is exact, on curved ones of first
    order in the threshold.

    Parameters
    ----------
    path : RegularPath
    start : Point
    threshold : float
        Relative singular value below which K is rank deficient.
    """

    def __init__(self, path: RegularPath, start: Point, threshold: float = PROJECTION_THRESHOLD) -> None:
        self.path, self.anchor, self.threshold = path, start, threshold

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y; projected where K_d is rank deficient.

        Raises
        ------
        BranchError
            When Newton does not converge beside the singularity, or y cannot parametrise the kernel.
        """
        point = self.path.step(self.anchor, y, ydot)
        if point is None or point.conditioning < self.threshold:
            point = self._project(y, ydot)
        self.anchor = point
        return point

    @property
    def met(self) -> bool:
        """Always: a step may pass the narrow zone of the projection without a point in it."""
        return True

    def passed(self, before: Point, after: Point, stretch: Stretch) -> list[Crossing]:
        """Each change of a determinant's sign: where it is zero linearly, at the time at which y is there."""
        tree, found, towards = self.path.tree, [], stretch.y(stretch.t1) - stretch.y(stretch.t0)
        dets = zip(before.det.tolist(), after.det.tolist(), strict=True)
        for share in sorted(a / (a - b) for a, b in dets if a * b < 0.0 or b == 0.0 != a):
            residual = self.path.mechanism.closure_residual(after.q)
            q = tree.integrate(before.q, share * tree.difference(before.q, after.q))
            y = before.y + share * (after.y - before.y)

            def ahead(t: float, y: Array = y) -> float:
                return float((stretch.y(t) - y) @ towards)

            found.append(Crossing(stretch.zero(ahead), y, q, "projected", residual))
        return sorted(found, key=lambda crossing: crossing.time)

    def _project(self, y: Array, ydot: Array) -> Point:
        path, mechanism = self.path, self.path.mechanism
        q, _ = path.predict(self.anchor, y)
        q[path.iq] = y
        q = self._close(q)
        scaled_K = mechanism.scaled(mechanism.K(q))
        _, s, Vt = np.linalg.svd(scaled_K)
        self.counters.svds += 1
        self.counters.zone_evaluations += 1
        N = Vt[numerical_rank(s, self.threshold) :].T
        scale = mechanism.column_scale[:, None]
        # dimensionless: an orthogonal projection of radians beside metres would depend on the units
        projected = scale * (N @ (N.T @ (self.anchor.G / scale)))
        try:
            G = projected @ np.linalg.inv(projected[path.independent])
        except np.linalg.LinAlgError as error:
            raise BranchError(
                f"Eq. (7) at y = {y}: the projected motion leaves the independent joints at rest",
                y,
            ) from error
        zero = np.zeros(mechanism.nv)
        det, rcond = path.conditioning(q)
        curvature = zero if path.m == 1 else None  # the paper's g = 0, Eq. (7)
        return Point(y, ydot, q, G, zero, curvature, det, rcond, float(rcond.min(initial=1.0)))

    def _close(self, q: Array) -> Array:
        """Minimum-norm Newton on the dependent joints, singular directions left where predicted."""
        path, mechanism = self.path, self.path.mechanism
        for _ in range(8):
            if not np.all(np.isfinite(q)):
                raise NonFiniteError(
                    "Eq. (7) left the finite numbers: beside a singular configuration its patch may have "
                    'thrown the motion off; use a smaller step, or method="bridge"'
                )
            phi = mechanism.phi(q) / mechanism.row_scale
            if np.abs(phi).max(initial=0.0) <= 1e-15:
                break
            K = mechanism.scaled(mechanism.K(q))[:, path.dependent]
            step = np.linalg.pinv(K, rcond=self.threshold) @ phi  # K⁻¹ would leap where rank is lost
            dv = np.zeros(mechanism.nv)
            dv[path.dependent] = -step * mechanism.column_scale[path.dependent]
            q = mechanism.tree.integrate(q, dv)
            if np.abs(step).max() <= 1e-15:
                break
        return q
