"""A mechanism from links and the joints at their points, without a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...checks import check_finite, check_positive, check_text, hint, shown
from ...errors import ModelError
from ..assembly.assembly import FEW_STARTS, MANY_STARTS
from ..assembly.ranges import assembled_within
from ..coordinates.independent import completed, regular_near
from ..forces.forces import Force
from ..loops import ClosedLoops
from ..mechanism import Mechanism
from ..named_numbers import with_numbers
from ..tree.tree import Array
from .bodies import WORLD, Body, BodyJoint, direction, required, rod, vector
from .body_graph import spanned

GROUND = "ground"
END = "end"

NEARLY_SINGULAR = 1e-3
"""Conditioning of K below which a pose that nobody chose is left."""


class Linkage:
    """Links, and joints at their points; `mechanism` closes the loops.

    A slider-crank:

        linkage = rg.Linkage("slider_crank")
        linkage.link("crank", 0.3, at="ground")
        linkage.link("rod", 0.8, at="crank.end")
        linkage.slider("rod.end", along=(1, 0), mass=0.5)
        mechanism = linkage.mechanism({"crank": 0.5})

    A point is called by its link: "rod" is where the rod starts, "rod.end" its tip, "rod.P" one that `point`
    has named; of "ground", which does not move, too. Places are those of the link's own frame, m, (x, y) or
    (x, y, z). Where all joints are at zero the frames of all links are parallel to the world's.

    Parameters
    ----------
    name : str
    gravity : array_like (3,)
        m/s²; along −y, the plane being x, y.
    axis : array_like (3,)
        Of revolute joints that name none.
    density, section : float
        Of rods that name no mass, kg/m³ and m²; steel of one square centimetre.
    """

    def __init__(
        self,
        name: str = "linkage",
        gravity: ArrayLike = (0.0, -9.81, 0.0),
        axis: ArrayLike = (0.0, 0.0, 1.0),
        density: float = 7850.0,
        section: float = 1e-4,
    ) -> None:
        check_text("Linkage: name", name)
        check_positive("Linkage: density", density)
        check_positive("Linkage: section", section)
        self.name, self._gravity = name, vector(gravity, f"{name}: gravity")
        self._axis, self._density, self._section = direction(axis, f"{name}: axis"), density, section
        self._bodies: dict[str, Body] = {}
        self._joints: dict[str, BodyJoint] = {}
        self._points: dict[str, dict[str, Array]] = {GROUND: {"": np.zeros(3)}}

    def link(
        self,
        name: str,
        length: float | None = None,
        at: str | None = None,
        *,
        mass: float | None = None,
        inertia: pin.Inertia | None = None,
        axis: ArrayLike | None = None,
        points: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """A rod along its own x, or a body of other points.

        Parameters
        ----------
        length : float, optional
            m, from its start to its `end`, which a link without a length has not.
        at : str, optional
            A point that its start is hinged to, by a revolute joint of the link's name about `axis`.
        mass : float, optional
            kg, spread along the rod; by density and section when left out.
        inertia : pin.Inertia, optional
            In its own frame, in place of the rod's.
        points : dict, optional
            Further points by name.
        """
        check_text("link: name", name)
        if name in self._points or "." in name or name == WORLD:
            raise ModelError(f"link {name!r}: the name is taken, or has a dot; choose another")
        if inertia is not None and not isinstance(inertia, pin.Inertia):
            raise ModelError(f"link {name!r}: inertia is {shown(inertia)}; give a pin.Inertia")
        mine: dict[str, Array] = {"": np.zeros(3)}
        if length is not None:
            required(check_positive, f"link {name!r}: length", length)
            mine[END] = np.array([float(length), 0.0, 0.0])
        given = self._density * self._section * (length or 0.0) if mass is None else mass
        required(check_finite, f"link {name!r}: mass", given)
        if given < 0.0:
            raise ModelError(f"link {name!r}: mass is {given}; give zero or more, kg")
        if at is not None:
            self._at(at, f"link {name!r}")  # nothing is added where it is refused
        made = rod(float(length or 0.0), given, self._section) if inertia is None else inertia
        self._bodies[name], self._points[name] = Body(name, None, made), mine
        for label, where in (points or {}).items():
            self.point(f"{name}.{label}", where)
        if at is not None:
            self.revolute(at, name, axis=axis, name=name)

    def point(self, name: str, where: ArrayLike) -> str:
        """Name a point "link.NAME", or "ground.NAME", at a place in the link's frame, m; returns its name."""
        check_text("point: name", name)
        link, _, label = name.partition(".")
        if link not in self._points or not label:
            raise ModelError(
                f"point {name!r}: write link.NAME, with a link of {', '.join(self._points)}"
                + hint(link, self._points)
            )
        if label in self._points[link]:
            raise ModelError(f"point {name!r} is there already; choose another name")
        self._points[link][label] = vector(where, f"point {name!r}")
        return name

    def revolute(
        self,
        one: str,
        other: str,
        axis: ArrayLike | None = None,
        name: str | None = None,
        axis2: ArrayLike | None = None,
    ) -> None:
        """A revolute joint between points of two links; it closes a loop where they are connected already.

        Parameters
        ----------
        one, other : str
            Points. The joint's angle is that of the second link against the first.
        axis, axis2 : array_like (3,), optional
            In the frame of the first link, and of the second, the same when left out.
        name : str, optional
            Of the joint; by default both points.
        """
        self._add("revolute", one, other, self._axis if axis is None else axis, axis2, name)

    def prismatic(self, one: str, other: str, axis: ArrayLike = (1, 0), name: str | None = None) -> None:
        """The second link slides along an axis through a point of the first, and does not turn against it."""
        self._add("prismatic", one, other, axis, name=name)

    def spherical(self, one: str, other: str, name: str | None = None) -> None:
        """A ball between points of two links."""
        self._add("spherical", one, other, name=name)

    def fixed(self, one: str, other: str, name: str | None = None) -> None:
        """Both links in one piece, their frames parallel."""
        self._add("fixed", one, other, name=name)

    def slider(
        self,
        point: str,
        along: ArrayLike = (1.0, 0.0),
        on: str = GROUND,
        mass: float = 0.0,
        name: str = "slider",
    ) -> None:
        """A block that slides on a line through a point, and is hinged to another: a link and two joints.

        Parameters
        ----------
        point : str
            What it is hinged to.
        along : array_like
            Direction of the line in the frame of the link that it slides on.
        on : str
            A point on the line.
        mass : float
            Of the block, kg.
        name : str
            Of the block and of the prismatic joint; the revolute one is called `NAME_pin`.
        """
        self.link(name, mass=mass)
        self.prismatic(on, name, along, name=name)
        self.revolute(point, name, name=f"{name}_pin")

    def mechanism(
        self,
        home: Mapping[str, float] | None = None,
        independent: Sequence[str] | None = None,
        forces: Sequence[Force] = (),
    ) -> Mechanism:
        """The mechanism, its loops closed.

        Parameters
        ----------
        home : dict, optional
            Joints that are to be there, rad and m; the others follow.
        independent : sequence of str, optional
            By default the joints on the ground, as far as they can serve, completed.
        forces : sequence of Force, whose frames are points by name

        Raises
        ------
        ModelError
            For a link that nothing connects to the ground, and for what `Mechanism.from_pinocchio` refuses.
        ClosureError
            With each loop that stays open, where no configuration closes them all.
        """
        if home is not None and not isinstance(home, Mapping):
            raise ModelError(f"{self.name}: home = {shown(home)} must be {{joint: number}}")
        # the ground's joints are in the tree, since most are motors
        joints = sorted(self._joints.values(), key=lambda joint: WORLD not in (joint.parent, joint.child))
        contents = spanned(self.name, list(self._bodies.values()), joints, self._gravity)
        model = contents.model
        floating = {i for i, joint in enumerate(model.names) if i and joint not in self._joints}
        apart = [b for b in self._bodies if floating & {*model.supports[self._carrier(model, b).parentJoint]}]
        if apart:
            raise ModelError(f"{self.name}: nothing connects {', '.join(apart)} to the ground; add a joint")
        self._add_frames(model)
        loops = ClosedLoops(model, contents.closures)
        q, free = self._start(loops, home or {})
        q = assembled_within(loops, q, free, self.name, FEW_STARTS if home else MANY_STARTS)
        grounded = [j.name for j in joints if WORLD in (j.parent, j.child) and j.name in loops.joint_names]
        if not home:
            own = independent if isinstance(independent, (list, tuple)) else grounded
            q = regular_near(loops, q, NEARLY_SINGULAR, own)
        if independent is None:
            independent, _ = completed(loops, regular_near(loops, q), grounded, self.name)
        return Mechanism.from_pinocchio(model, contents.closures, independent, q, self.name, forces)

    def _start(self, loops: ClosedLoops, home: Mapping[str, float]) -> tuple[Array, Any]:
        """A guess, and the velocities that are free to close the loops."""
        for joint, value in home.items():
            check_finite(f"home[{joint!r}]", value)
        q = with_numbers(loops.joints, pin.neutral(loops.own_model), home, "q", "home")
        held = [i for joint in home for i in loops.velocities_of(joint)]
        return q, np.setdiff1d(np.arange(loops.nv), held)

    def _add_frames(self, model: pin.Model) -> None:
        """The points as frames."""
        for link, points in self._points.items():
            joint, place = 0, pin.SE3.Identity()
            if link != GROUND:
                carrier = self._carrier(model, link)
                joint, place = carrier.parentJoint, carrier.placement
            for label, at in points.items():
                if label or link == GROUND:  # a link has a frame already
                    name, there = f"{link}.{label}" if label else link, place * pin.SE3(np.eye(3), at)
                    model.addFrame(pin.Frame(name, joint, there, pin.FrameType.OP_FRAME), False)

    def _carrier(self, model: pin.Model, link: str) -> pin.Frame:
        return model.frames[model.getFrameId(link, pin.FrameType.BODY)]

    def _add(
        self,
        kind: str,
        one: str,
        other: str,
        axis: ArrayLike | None = None,
        axis2: ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        label = f"{one} – {other}" if name is None else name
        check_text("joint: name", label)
        where = f"joint {label!r}"
        if label in self._joints:
            raise ModelError(f"{where}: the name is taken; choose another")
        ends = [self._at(point, where) for point in (one, other)]
        if ends[0][0] == ends[1][0]:
            raise ModelError(f"{where}: both points are of {ends[0][0]!r}; name points of two links")
        axes = [] if axis is None else [direction(axis, f"{where}: axis")]
        child = pin.SE3(np.eye(3), ends[1][1])
        if axis2 is not None:
            turn = pin.Quaternion.FromTwoVectors(axes[0], direction(axis2, f"{where}: axis2"))
            child.rotation = turn.toRotationMatrix()  # the least turn, where many would do
        links = [WORLD if link == GROUND else link for link, _ in ends]
        self._joints[label] = BodyJoint(
            label, kind, links[0], links[1], pin.SE3(np.eye(3), ends[0][1]), child, axes
        )

    def _at(self, point: Any, where: str) -> tuple[str, Array]:
        """The link of a point, and where it is on it."""
        check_text(where, point)
        link, _, label = point.partition(".")
        known = [f"{one}.{p}" if p else one for one, points in self._points.items() for p in points]
        if label not in self._points.get(link, {}):
            words = f"{where}: there is no point {point!r}{hint(point, known)}; there are"
            raise ModelError(f"{words} {', '.join(known)}")
        return link, self._points[link][label]
