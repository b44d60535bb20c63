"""The bridge: the explicit map interpolated across a singular surface, with its certificate.

Along one operation mode γ is smooth through a crossing although K cannot show it there. Nodes are
solved on both sides where K_d is well conditioned; q and G are interpolated between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...analysis.second_order import transversality
from ...checks import check_between, check_number, check_positive
from ...errors import BranchError, OptionError, SimulationError
from ...mechanism.tree import Array
from ..explicit import CrossingKind
from ..march import march
from ..point import Point
from ..regular_path import RegularPath
from .line import Line


@dataclass(frozen=True)
class BridgeOptions:
    """The few choices of the method, all dimensionless.

    Attributes
    ----------
    zone : float
        Conditioning of K_d (σ_min/σ_max of a 2 × 2 block) below which the bridge takes over. Also
        sets its half width: the distance at which that conditioning is reached. Rounding errors
        grow as ε/zone³, the interpolation error falls as zone¹².
    nodes : tuple of float
        Distances of the nodes from the singular surface in half widths, ascending from 1.
    closure_tolerance : float
        Largest max |φ| / length over the bridge for a certificate: some thousand roundings.
    geometric_tolerance : float
        Gap between modes, in lengths, below which a near miss counts as a crossing and is reported.
        A gap of e lets the modes veer within √e, and double precision loses ε/e^1.5 of g there.
    transversality : float
        Smallest second-order separation of modes that is certified.
    """

    zone: float = 0.05
    nodes: tuple[float, ...] = (1.0, 1.6, 2.2)
    closure_tolerance: float = 1e-12
    geometric_tolerance: float = 1e-9
    transversality: float = 1e-4

    def __post_init__(self) -> None:
        """Refuse values that make no bridge (`OptionError`)."""
        check_between("BridgeOptions: zone", self.zone, 0.0, 0.5)
        try:
            nodes = tuple(self.nodes)
        except TypeError as error:
            raise OptionError(f"BridgeOptions: nodes = {self.nodes!r} must be a tuple of numbers") from error
        for i, node in enumerate(nodes):
            check_positive(f"BridgeOptions: nodes[{i}]", node)
        if len(nodes) < 2 or nodes[0] < 1.0 or any(b <= a for a, b in pairwise(nodes)):
            raise OptionError(
                f"BridgeOptions: nodes = {nodes} must be at least two distances, ascending from 1 half width"
            )
        object.__setattr__(self, "nodes", nodes)
        check_positive("BridgeOptions: closure_tolerance", self.closure_tolerance)
        check_positive("BridgeOptions: transversality", self.transversality)
        check_number("BridgeOptions: geometric_tolerance", self.geometric_tolerance)
        if not 0.0 <= self.geometric_tolerance < np.inf:
            raise OptionError(
                f"BridgeOptions: geometric_tolerance = {self.geometric_tolerance} must be finite, 0 or more"
            )


SHRINKS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08)
"""Half widths tried, relative to the zone's: a mode with much curvature needs a shorter bridge."""

GOOD = 1e-9
"""Relative error of γ'' over the bridge at which no shorter one is tried."""


class NoBridgeError(SimulationError):
    """No certified bridge exists here; `residual` is what is left of φ on the best attempt."""

    def __init__(self, reason: str, residual: float = np.inf, separation: float = np.nan) -> None:
        super().__init__(reason)
        self.residual = residual
        self.separation = separation


@dataclass
class Bridge:
    """A line whose nodes stand on both sides of a singular surface, with its certificate.

    Attributes
    ----------
    line : Line
    left, right : float
        Where the bridge is used: s between the innermost nodes.
    zeros : list of float
        s of each singular surface between them.
    residual : float
        The certificate: max |φ| / length between the nodes.
    separation : float
        Second-order transversality at the first singular surface.
    kind : {"transversal", "near miss"}
    error : float
        Estimated relative error of the second derivative over the bridge.
    """

    line: Line
    left: float
    right: float
    zeros: list[float]
    residual: float
    separation: float
    kind: CrossingKind
    error: float

    def parameter(self, y: Array) -> float:
        """s of y on the line."""
        d = self.line.direction
        return float((y - self.line.origin) @ d) / float(d @ d)

    def contains(self, s: float) -> bool:
        """Whether the bridge serves at s."""
        return self.left <= s <= self.right

    def reaches(self, s: float) -> bool:
        """Whether s lies between the outermost nodes, where the interpolant still holds."""
        return bool(self.line.s[0] <= s <= self.line.s[-1])


class Builder:
    """Builds bridges from a point beside a singular surface."""

    def __init__(self, path: RegularPath, options: BridgeOptions) -> None:
        self.path, self.options = path, options

    def build(self, anchor: Point, direction: Array) -> Bridge:
        """A certified bridge over the surface that lies ahead of or behind `anchor` along `direction`.

        Raises
        ------
        NoBridgeError
            When no attempt earns a certificate.
        """
        best: Bridge | None = None
        failures: list[NoBridgeError] = []
        for shrink in SHRINKS:
            try:
                bridge = self._attempt(anchor, direction, shrink)
            except NoBridgeError as failure:
                failures.append(failure)
                continue
            if best is None or bridge.error < best.error:
                best = bridge
            if best.kind == "transversal" and best.error <= GOOD:
                break
        if best is None:
            raise min(failures, key=lambda failure: failure.residual)
        self.path.counters.bridges_built += 1
        return best

    def _attempt(self, anchor: Point, d: Array, shrink: float) -> Bridge:
        center, width, singular = self._locate(anchor, d)
        width *= shrink
        for _ in range(4):
            line, inner = self._nodes(anchor, d, center, width, singular)
            zeros = {b: line.zero(b, *inner) for b in singular}
            found = [z for z in zeros.values() if z is not None]
            if len(found) < len(singular):
                raise NoBridgeError("the determinant of K_d does not change sign across the zone")
            # every zone |s − zero| ≤ own width must lie between the inner nodes
            halves = {b: self._half_width(line, b, z, shrink) for b, z in zeros.items() if z is not None}
            low = min(z - halves[b] for b, z in zeros.items() if z is not None)
            high = max(z + halves[b] for b, z in zeros.items() if z is not None)
            new_center, new_width = 0.5 * (low + high), 0.5 * (high - low)
            settled = abs(new_center - center) <= 0.2 * width and 0.7 * width <= new_width <= 1.4 * width
            if settled:
                return self._certify(line, inner, sorted(found))
            center, width = new_center, new_width
        raise NoBridgeError("the singular surface could not be located")

    def _half_width(self, line: Line, block: int, zero: float, shrink: float) -> float:
        """Distance from the zero at which the block's conditioning reaches the zone's."""
        nearest = min(line.nodes, key=lambda node: abs(node[0] - zero))
        rate = float(nearest[1].rcond[block]) / max(abs(nearest[0] - zero), 1e-300)
        return shrink * self.options.zone / rate

    def _locate(self, anchor: Point, d: Array) -> tuple[float, float, list[int]]:
        """First guess of the surface, half width and the blocks that become singular, by secants."""
        worst = int(np.argmin(anchor.rcond))
        slope = self._slope(anchor, d, worst)
        reach = abs(float(anchor.det[worst]) / slope)
        probe = 0.3 * reach * (-1.0 if anchor.det[worst] / slope > 0.0 else 1.0)
        near = self._march(anchor, anchor.y + probe * d, anchor.ydot)
        zeros, singular, widths = [], [], []
        for b in range(len(anchor.det)):
            change = float(near.det[b] - anchor.det[b])
            if anchor.rcond[b] > 4.0 * self.options.zone or change == 0.0:
                continue
            zero = -float(anchor.det[b]) * probe / change
            if abs(zero) > 6.0 * reach:
                continue
            distance = abs(zero - probe)
            zeros.append(zero)
            widths.append(self.options.zone * distance / max(float(near.rcond[b]), 1e-300))
            singular.append(b)
        low = min(z - w for z, w in zip(zeros, widths, strict=True))
        high = max(z + w for z, w in zip(zeros, widths, strict=True))
        return 0.5 * (low + high), 0.5 * (high - low), singular

    def _slope(self, anchor: Point, d: Array, block: int) -> float:
        """d det/ds at the anchor by a small central step that stays on the branch."""
        size = self.path.size(anchor.G @ d)
        eps = 1e-3 * max(float(anchor.rcond[block]), 1e-9) / max(size, 1e-300)
        forward = self._march(anchor, anchor.y + eps * d, anchor.ydot)
        backward = self._march(anchor, anchor.y - eps * d, anchor.ydot)
        slope = float(forward.det[block] - backward.det[block]) / (2.0 * eps)
        if slope == 0.0 or not np.isfinite(slope):
            raise NoBridgeError("the determinant of K_d does not vary along the line")
        return slope

    def _nodes(
        self, anchor: Point, d: Array, center: float, width: float, singular: list[int]
    ) -> tuple[Line, tuple[float, float]]:
        """Solve the near nodes by marching, the first beyond the surface from the line that they make."""
        path, origin = self.path, anchor.y
        side = -1.0 if center > 0.0 else 1.0  # where the anchor stands, seen from the surface
        nodes: list[tuple[float, Point]] = []
        here = anchor
        for factor in self.options.nodes:
            s = center + side * factor * width
            here = self._march(here, origin + s * d, anchor.ydot)
            nodes.append((s, here))
        expected = np.sign(here.det)
        expected[singular] *= -1.0
        first, *others = (center - side * factor * width for factor in self.options.nodes)
        guess = Line(path, origin, d, nodes).configuration(first)
        far = path.settle(guess, origin + first * d, anchor.ydot)
        if far is None:
            raise NoBridgeError("there is no configuration beyond the singular surface on this mode")
        if np.any(np.sign(far.det) != expected):
            raise NoBridgeError("beyond the singular surface Newton found another mode")
        if far.correction > 0.3 * path.size(far.G @ d) * self.options.nodes[0] * width:
            raise NoBridgeError("beyond the singular surface the mode does not go on smoothly")
        nodes.append((first, far))
        for s in others:
            far = self._march(far, origin + s * d, anchor.ydot)
            nodes.append((s, far))
        line = Line(path, origin, d, nodes)
        return line, (center - width, center + width)

    def _march(self, here: Point, y: Array, ydot: Array) -> Point:
        try:
            return march(self.path, here, y, ydot)
        except BranchError as error:
            raise NoBridgeError(f"a node beside the surface is out of reach ({error})") from error

    def _certify(self, line: Line, inner: tuple[float, float], zeros: list[float]) -> Bridge:
        path, options = self.path, self.options
        mechanism = path.mechanism
        samples = np.linspace(*inner, 15)[1:-1]
        residual = max(map(mechanism.closure_residual, line.configurations(samples)))
        if residual > max(options.closure_tolerance, options.geometric_tolerance):
            raise NoBridgeError("the interpolated mode does not close the loops", residual)
        point = line.at(zeros[0], np.zeros(path.m))
        separation = transversality(mechanism, point.q, point.G, path.nd)
        path.counters.svds += 1
        path.counters.second_order += 1
        if separation < options.transversality:
            raise NoBridgeError("the modes part at higher than second order", residual, separation)
        certified = residual <= options.closure_tolerance
        kind: CrossingKind = "transversal" if certified else "near miss"
        error = max(self._held_out(line, inner), residual)
        return Bridge(line, *inner, zeros, residual, separation, kind, error)

    def _held_out(self, line: Line, inner: tuple[float, float]) -> float:
        """Error of γ'' (G for m > 1) over the bridge, from solved points that the line does not know.

        The points lie between the two inner nodes of each side, where K_d still gives digits; the
        polynomial's error is larger in the middle by the ratio of its node products.
        """
        path = self.path
        middle, power = 0.5 * (inner[0] + inner[1]), 3 if path.m == 1 else 2
        worst = 0.0
        for i in (len(line.nodes) // 2 - 1, len(line.nodes) // 2):
            s_node, node = line.nodes[i]
            s = 0.5 * (s_node + line.nodes[i + (1 if s_node > middle else -1)][0])
            known = self._march(node, line.origin + s * line.direction, node.ydot)
            guess = line.at(s, node.ydot)
            if known.curvature is not None and guess.curvature is not None:
                a, b = known.curvature, guess.curvature
            else:
                a, b = known.G.ravel(), guess.G.ravel()
            off = float(np.abs(a - b).max()) / (1.0 + float(np.abs(a).max()))
            growth = float(np.prod(np.abs((line.s - middle) / (line.s - s)))) ** (power - 1)
            worst = max(worst, off * min(growth, 1e3))
        return worst
