"""Closed-loop mechanisms in minimal coordinates, straight through singular configurations."""

from .analysis.local import LocalAnalysis, analyse
from .analysis.space import ConfigurationSpace, ModeCurve, trace_modes
from .drawing.figures.modes import plot_modes
from .drawing.replay.live import live
from .drawing.replay.replay import ReplayPage, replay
from .dynamics.equations import implicit_dynamics
from .dynamics.inverse import inverse_dynamics
from .dynamics.linearise import Linearisation, StabilityWarning, linearise
from .errors import (
    BranchError,
    ClosureError,
    MissingExtraError,
    ModelError,
    NonFiniteError,
    NotCertifiedError,
    OptionError,
    PartitionError,
    RobustGcpError,
    SimulationError,
    SingularStartError,
    StateError,
    SweepError,
    ToggleError,
)
from .maps.bridge.bridge import BridgeOptions
from .maps.classical import SingularityWarning
from .maps.explicit import Crossing
from .mechanism.closures import FrameClosure, PointClosure, RevoluteClosure
from .mechanism.folders.loader import load, model_names
from .mechanism.forces import JointDamper, JointSpring, JointTorque, PointSpring
from .mechanism.mechanism import Mechanism
from .native import Backend, NativeBuildWarning, backends
from .simulation.coarse import CoarseStepWarning
from .simulation.simulate import simulate
from .simulation.trajectory import Stats, Trajectory
from .sweeps.record import Failure, RunRecord
from .sweeps.runs import grid, sweep, sweep_as_completed

__version__ = "0.1.0"

__all__ = [
    "Backend",
    "BranchError",
    "BridgeOptions",
    "ClosureError",
    "CoarseStepWarning",
    "ConfigurationSpace",
    "Crossing",
    "Failure",
    "FrameClosure",
    "JointDamper",
    "JointSpring",
    "JointTorque",
    "Linearisation",
    "LocalAnalysis",
    "Mechanism",
    "MissingExtraError",
    "ModeCurve",
    "ModelError",
    "NativeBuildWarning",
    "NonFiniteError",
    "NotCertifiedError",
    "OptionError",
    "PartitionError",
    "PointClosure",
    "PointSpring",
    "ReplayPage",
    "RevoluteClosure",
    "RobustGcpError",
    "RunRecord",
    "SimulationError",
    "SingularStartError",
    "SingularityWarning",
    "StabilityWarning",
    "StateError",
    "Stats",
    "SweepError",
    "ToggleError",
    "Trajectory",
    "analyse",
    "backends",
    "grid",
    "implicit_dynamics",
    "inverse_dynamics",
    "linearise",
    "live",
    "load",
    "model_names",
    "plot_modes",
    "replay",
    "simulate",
    "sweep",
    "sweep_as_completed",
    "trace_modes",
]
