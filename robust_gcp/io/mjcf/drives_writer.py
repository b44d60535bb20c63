"""Actuators and tendons of a mechanism as MJCF."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ...mechanism.actuation.actuators import Actuator
from ...mechanism.actuation.paths import FixedTendon, Path, TurningJoint
from ...mechanism.actuation.site_paths import SiteForce, SliderCrank
from ...mechanism.actuation.spatial_tendon import Pulley, SpatialTendon, Wrap
from ...mechanism.actuation.tendon_springs import TendonSpring
from ...mechanism.forces.forces import PointSpring
from ...mechanism.mechanism import Mechanism
from ..names import unlike
from ..written import Lost, note, quaternion, text

SCALE = 200.0
"""MuJoCo's default of a muscle's scale, which a force that is given does not use."""


DEFAULT = [-1.0, -1.0]
"""Two ends that say nothing: MuJoCo then takes the tendon's length in its first configuration."""


class DrivesWriter:
    """Elements of tendons and actuators.

    Parameters
    ----------
    mechanism : Mechanism
    bodies : list of Element
        By the joint that carries them.
    site : callable (frame) -> str
        The site of a frame.
    lost : dict
        What MJCF has no place for.

    Attributes
    ----------
    tendons, actuators : list of Element
    activations : list of float
        At the start, of the actuators that have some.
    """

    def __init__(
        self, mechanism: Mechanism, bodies: list[Element], site: Callable[[str], str], lost: Lost
    ) -> None:
        self._mechanism, self._bodies, self._site, self._lost = mechanism, bodies, site, lost
        self.tendons, self.actuators = list[Element](), list[Element]()
        self.activations: list[float] = []
        self._names: dict[Path, str] = {}
        self._wraps = 0
        for name, path in mechanism.tendons.items():
            self._tendon(path, name)
        for spring in mechanism.forces:
            if isinstance(spring, PointSpring):  # a tendon straight from site to site
                along, rest = SpatialTendon([spring.frame1, spring.frame2]), spring.rest_length
                self._spring(TendonSpring(along, spring.stiffness, rest, rest, spring.damping))
            elif isinstance(spring, TendonSpring):
                self._spring(spring)
        for actuator in mechanism.actuators:
            self._actuator(actuator)

    def _tendon(self, path: Path, name: str | None = None) -> Element | None:
        """A new element of a path; None where MJCF has no such tendon."""
        if name is None:
            name = unlike(f"tendon_{len(self.tendons)}", self._mechanism.tendons)
        made = Element("fixed" if isinstance(path, FixedTendon) else "spatial", name=name)
        if isinstance(path, FixedTendon):
            for joint, arm in path.coefficients.items():
                SubElement(made, "joint", joint=joint, coef=repr(float(arm)))
        elif isinstance(path, SpatialTendon):
            for element in path.elements:
                self._add(made, element)
        else:
            note(self._lost, "tendons", [name])
            return None
        self._names.setdefault(path, name)
        self.tendons.append(made)
        return made

    def _add(self, tendon: Element, element: str | Pulley | Wrap) -> None:
        if isinstance(element, str):
            SubElement(tendon, "site", site=self._site(element))
        elif isinstance(element, Pulley):
            SubElement(tendon, "pulley", divisor=repr(float(element.divisor)))
        else:
            made = SubElement(tendon, "geom", geom=self._wrap(element))
            if element.side is not None:
                made.set("sidesite", self._site(element.side))

    def _wrap(self, wrap: Wrap) -> str:
        """A shape without mass and contacts; its name."""
        model, self._wraps = self._mechanism.own_model, self._wraps + 1
        frame = model.frames[model.getFrameId(wrap.frame)]
        place = frame.placement * pin.SE3(np.array(wrap.rotation, dtype=float), np.array(wrap.position))
        size = [wrap.radius] if wrap.shape == "sphere" else [wrap.radius, wrap.radius]
        where = {"pos": text(place.translation), "quat": quaternion(place.rotation), "type": wrap.shape}
        name = f"wrap_{self._wraps}"
        SubElement(
            self._bodies[frame.parentJoint], "geom", where, name=name, size=text(size), mass="0",
            contype="0", conaffinity="0",
        )  # fmt: skip
        return name

    def _spring(self, spring: TendonSpring) -> None:
        made: Element | None = next(
            (t for t in self.tendons if t.get("name") == self._names.get(spring.path)), None
        )
        if made is None or made.get("stiffness") is not None:
            made = self._tendon(spring.path)
        if made is not None:
            numbers = {"stiffness": [spring.stiffness], "damping": [spring.damping]}
            ends = [float(spring.lower), float(spring.upper)]
            numbers["springlength"] = ends if ends != DEFAULT else [np.nextafter(ends[0], -np.inf), ends[1]]
            for name, values in numbers.items():
                made.set(name, text(values))

    def _actuator(self, actuator: Actuator) -> None:
        where = self._driven(actuator)
        if where is None:
            return
        muscle, gain = actuator.muscle, actuator.gain
        plain = actuator.kind == "motor" and gain[0] == 1.0 and actuator.dynamics == "none"
        if plain and where.get("gear") == "1.0":
            del where["gear"]
        made = Element("motor" if plain else "general", where, name=actuator.name)
        if muscle is not None:
            curves = muscle.lmin, muscle.lmax, muscle.vmax, muscle.fpmax, muscle.fvmax
            numbers = text([*muscle.range, muscle.force, SCALE, *curves])
            made.attrib |= dict.fromkeys(("gaintype", "biastype"), "muscle")
            made.attrib |= dict.fromkeys(("gainprm", "biasprm"), numbers)
            made.set("lengthrange", text(muscle.lengths))
        elif not plain:
            made.attrib |= {"gaintype": "affine" if any(gain[1:]) else "fixed", "gainprm": text(gain)}
            made.attrib |= {"biastype": "affine", "biasprm": text(actuator.bias)}
        if actuator.dynamics != "none":
            made.set("dyntype", actuator.dynamics)
            self.activations.append(actuator.activation)
            if actuator.time:
                made.set("dynprm", text(actuator.time))
        limits = {
            "ctrl": actuator.ctrl_range,
            "force": actuator.force_range,
            "act": None if actuator.dynamics == "none" else actuator.activation_range,
        }
        for what, ends in limits.items():
            if ends is not None:
                made.attrib |= {f"{what}limited": "true", f"{what}range": text(ends)}
        self.actuators.append(made)

    def _driven(self, actuator: Actuator) -> dict[str, str] | None:
        """The attributes that say what it drives, by which gear; None where MJCF has nothing like it."""
        path, gear = actuator.along, float(actuator.gear)
        single = len(path.joints) == 1 and actuator.shared_range is None
        if isinstance(path, FixedTendon) and single and path not in self._names:
            (arm,) = path.coefficients.values()
            if arm == 1.0:
                return {"joint": path.joints[0], "gear": repr(gear)}
        if isinstance(path, FixedTendon | SpatialTendon):
            if path not in self._names:
                self._tendon(path)
            if actuator.shared_range is not None:
                found = next(t for t in self.tendons if t.get("name") == self._names[path])
                ends = {"actuatorfrclimited": "true", "actuatorfrcrange": text(actuator.shared_range)}
                found.attrib |= ends
            return {"tendon": self._names[path], "gear": repr(gear)}
        return self._elsewhere(actuator, path, gear)

    def _elsewhere(self, actuator: Actuator, path: Path, gear: float) -> dict[str, str] | None:
        if isinstance(path, TurningJoint):
            kind = "jointinparent" if path.in_parent else "joint"
            return {kind: path.joint, "gear": text([gear * x for x in path.gear])}
        if isinstance(path, SiteForce):
            found = {"site": self._site(path.site), "gear": text([gear * x for x in path.gear])}
            return found if path.reference is None else found | {"refsite": self._site(path.reference)}
        if isinstance(path, SliderCrank):
            ends = {"cranksite": self._site(path.crank), "slidersite": self._site(path.slider)}
            return {**ends, "cranklength": repr(float(path.rod)), "gear": repr(gear)}
        note(self._lost, "actuators", [actuator.name])
        return None
