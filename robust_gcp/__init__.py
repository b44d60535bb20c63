"""Closed-loop mechanisms in minimal coordinates, straight through singular configurations."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .analysis.configuration_space import ConfigurationSpace, ModeCurve
from .analysis.local import LocalAnalysis, analyse
from .analysis.space import trace_modes
from .dynamics.derivatives import Derivatives
from .dynamics.equations import implicit_dynamics
from .dynamics.inverse import inverse_dynamics
from .dynamics.linearise import Linearisation
from .dynamics.loads import Wrench
from .dynamics.prescribed.drive import KinkedDriveWarning
from .dynamics.prescribed.motion import Motion
from .dynamics.regressor import Regressor, regressor
from .dynamics.tableau import Tableau
from .errors import (
    BranchError,
    ClosureError,
    CuspError,
    MissingExtraError,
    MissingFileError,
    ModelError,
    ModelWarning,
    NonFiniteError,
    NotCertifiedError,
    NotDifferentiableError,
    OptionError,
    PartitionError,
    PerformanceWarning,
    RobustGcpError,
    SimulationError,
    SingularStartError,
    StateError,
    SweepError,
    ToggleError,
)
from .io.loader import load, model_names
from .kernel import Backend, NativeBuildWarning, backends
from .maps.classical import SingularityWarning
from .maps.cluster.options import BridgeOptions
from .maps.explicit import Crossing
from .mechanism.actuation.actuators import Actuator
from .mechanism.actuation.muscle import Muscle
from .mechanism.actuation.paths import FixedTendon, TurningJoint
from .mechanism.actuation.site_paths import SiteForce, SliderCrank
from .mechanism.actuation.spatial_tendon import Pulley, SpatialTendon, Wrap
from .mechanism.actuation.tendon_springs import TendonSpring
from .mechanism.building.linkage import Linkage
from .mechanism.constraint.closures import (
    Closure,
    FrameClosure,
    PointClosure,
    PrismaticClosure,
    RevoluteClosure,
    UniversalClosure,
)
from .mechanism.constraint.couplings import CouplingClosure
from .mechanism.forces.ball_springs import BallSpring
from .mechanism.forces.forces import Force, JointDamper, JointSpring, JointTorque, PointSpring
from .mechanism.forces.lifted_weights import GravityCompensation
from .mechanism.mechanism import Mechanism
from .mechanism.recommended import Recommended
from .simulation.derivatives.accelerations import derivatives, forward_dynamics
from .simulation.derivatives.cost import Cost, Gradient
from .simulation.derivatives.gradient import gradient
from .simulation.derivatives.linearised import linearise
from .simulation.derivatives.motion_point import MotionPoint, motion_point
from .simulation.derivatives.one_step import Stepped, step, step_jacobians
from .simulation.events import Event
from .simulation.runs.stability import StabilityWarning
from .simulation.runs.stats import Stats
from .simulation.runs.too_long_steps import CoarseStepWarning
from .simulation.simulate import simulate
from .simulation.simulation import Simulation
from .simulation.trajectories.access import FrameMotion, Sample
from .simulation.trajectories.acted import Acted
from .simulation.trajectories.load import load_trajectory
from .simulation.trajectories.reactions import Reaction
from .simulation.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from .drawing.figures.draw import draw
    from .drawing.figures.modes import plot_modes
    from .drawing.replay.live import live
    from .drawing.replay.replay import ReplayPage, replay
    from .mechanism.assembly.keyframes import Keyframe
    from .mechanism.building.lengths import along
    from .mechanism.parts import JointFriction, Lock, Stop
    from .mechanism.sensing.sensors import Sensor
    from .simulation.batches.batch import Batch
    from .simulation.batches.many import simulate_many
    from .simulation.batches.runs import Runs
    from .simulation.derivatives.parameter_derivatives import by_parameters
    from .simulation.derivatives.second_derivatives import second_derivatives
    from .simulation.derivatives.sensitivity import Sensitivity, sensitivity
    from .simulation.phases.happening import Happening
    from .simulation.phases.impact import Impact
    from .sweeps.record import Failure, Records, RunRecord
    from .sweeps.runs import grid, sweep, sweep_as_completed

__version__ = "0.2.0"

_LATER = {
    "Batch": ".simulation.batches.batch",
    "Failure": ".sweeps.record",
    "Happening": ".simulation.phases.happening",
    "Impact": ".simulation.phases.impact",
    "JointFriction": ".mechanism.parts",
    "Keyframe": ".mechanism.assembly.keyframes",
    "Lock": ".mechanism.parts",
    "ReplayPage": ".drawing.replay.replay",
    "Records": ".sweeps.record",
    "RunRecord": ".sweeps.record",
    "Runs": ".simulation.batches.runs",
    "Sensitivity": ".simulation.derivatives.sensitivity",
    "Sensor": ".mechanism.sensing.sensors",
    "Stop": ".mechanism.parts",
    "along": ".mechanism.building.lengths",
    "by_parameters": ".simulation.derivatives.parameter_derivatives",
    "draw": ".drawing.figures.draw",
    "grid": ".sweeps.runs",
    "live": ".drawing.replay.live",
    "plot_modes": ".drawing.figures.modes",
    "replay": ".drawing.replay.replay",
    "second_derivatives": ".simulation.derivatives.second_derivatives",
    "sensitivity": ".simulation.derivatives.sensitivity",
    "simulate_many": ".simulation.batches.many",
    "sweep": ".sweeps.runs",
    "sweep_as_completed": ".sweeps.runs",
}
"""Names whose modules, pictures and many runs, are imported when they are first asked for."""

__all__ = [
    "Acted",
    "Actuator",
    "Backend",
    "BallSpring",
    "Batch",
    "BranchError",
    "BridgeOptions",
    "Closure",
    "ClosureError",
    "CoarseStepWarning",
    "ConfigurationSpace",
    "Cost",
    "CouplingClosure",
    "Crossing",
    "CuspError",
    "Derivatives",
    "Event",
    "Failure",
    "FixedTendon",
    "Force",
    "FrameClosure",
    "FrameMotion",
    "Gradient",
    "GravityCompensation",
    "Happening",
    "Impact",
    "JointDamper",
    "JointFriction",
    "JointSpring",
    "JointTorque",
    "Keyframe",
    "KinkedDriveWarning",
    "Linearisation",
    "Linkage",
    "LocalAnalysis",
    "Lock",
    "Mechanism",
    "MissingExtraError",
    "MissingFileError",
    "ModeCurve",
    "ModelError",
    "ModelWarning",
    "Motion",
    "MotionPoint",
    "Muscle",
    "NativeBuildWarning",
    "NonFiniteError",
    "NotCertifiedError",
    "NotDifferentiableError",
    "OptionError",
    "PartitionError",
    "PerformanceWarning",
    "PointClosure",
    "PointSpring",
    "PrismaticClosure",
    "Pulley",
    "Reaction",
    "Recommended",
    "Records",
    "Regressor",
    "ReplayPage",
    "RevoluteClosure",
    "RobustGcpError",
    "RunRecord",
    "Runs",
    "Sample",
    "Sensitivity",
    "Sensor",
    "Simulation",
    "SimulationError",
    "SingularStartError",
    "SingularityWarning",
    "SiteForce",
    "SliderCrank",
    "SpatialTendon",
    "StabilityWarning",
    "StateError",
    "Stats",
    "Stepped",
    "Stop",
    "SweepError",
    "Tableau",
    "TendonSpring",
    "ToggleError",
    "Trajectory",
    "TurningJoint",
    "UniversalClosure",
    "Wrap",
    "Wrench",
    "along",
    "analyse",
    "backends",
    "by_parameters",
    "derivatives",
    "draw",
    "forward_dynamics",
    "gradient",
    "grid",
    "implicit_dynamics",
    "inverse_dynamics",
    "linearise",
    "live",
    "load",
    "load_trajectory",
    "model_names",
    "motion_point",
    "plot_modes",
    "regressor",
    "replay",
    "second_derivatives",
    "sensitivity",
    "simulate",
    "simulate_many",
    "step",
    "step_jacobians",
    "sweep",
    "sweep_as_completed",
    "trace_modes",
]


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(_LATER[name], __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
