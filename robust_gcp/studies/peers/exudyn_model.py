"""What both models for Exudyn share: the system, its springs, and the sensors that keep its states.

Exudyn's packages are untyped here: its stubs do not describe how its functions are called.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from ...mechanism.forces import PointSpring
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .parts import Place, frame_place

exu: Any = importlib.import_module("exudyn")
items: Any = importlib.import_module("exudyn.itemInterface")


class ExudynModel(ABC):
    """A scene as Exudyn sees it; a model adds its bodies and joints, then calls `finish`.

    Attributes
    ----------
    container, mbs
        Exudyn's, assembled.
    linear_solver : (str, bool)
        Exudyn's name, and whether singular Jacobians are solved all the same.
    sensors : list of list of int
        Positions, velocities and accelerations of the nodes.
    """

    linear_solver: tuple[str, bool]

    def __init__(self) -> None:
        self.container = exu.SystemContainer()
        self.mbs: Any = self.container.AddSystem()
        self.sensors: list[list[int]] = []

    @abstractmethod
    def tree_coordinates(self, stored: list[list[Array]]) -> tuple[Array, Array, Array]:
        """q, v and a of the spanning tree, (n, nq), from what each sensor stored after the time."""

    @abstractmethod
    def marker(self, place: Place) -> int:
        """A new marker at a place."""

    def finish(self, mechanism: Mechanism, nodes: Sequence[int]) -> None:
        """Add point springs between markers, and sensors of the nodes; assemble."""
        for spring in mechanism.forces:
            if isinstance(spring, PointSpring):
                ends = [self.marker(frame_place(mechanism, f)) for f in (spring.frame1, spring.frame2)]
                self.mbs.AddObject(
                    items.ObjectConnectorSpringDamper(
                        markerNumbers=ends, referenceLength=spring.rest_length,
                        stiffness=spring.stiffness, damping=spring.damping,
                    )
                )  # fmt: skip
        kinds = exu.OutputVariableType
        for kind in (kinds.Coordinates, kinds.Coordinates_t, kinds.Coordinates_tt):
            options = {"storeInternal": True, "writeToFile": False, "outputVariableType": kind}
            made = [self.mbs.AddSensor(items.SensorNode(nodeNumber=node, **options)) for node in nodes]
            self.sensors.append(made)
        self.mbs.Assemble()
