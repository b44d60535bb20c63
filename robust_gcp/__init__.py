"""Closed-loop mechanisms in minimal coordinates, straight through singular configurations."""

from .bridge import BridgeOptions
from .closure import FrameClosure, PointClosure, RevoluteClosure
from .coarse import CoarseStepWarning
from .dynamics import implicit_dynamics
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
from .explicit import Crossing
from .folders.loader import load, model_names
from .forces import JointDamper, JointSpring, JointTorque, PointSpring
from .gcp import SingularityWarning
from .inverse import inverse_dynamics
from .linearise import Linearisation, StabilityWarning, linearise
from .mechanism import Mechanism
from .modes.space import ConfigurationSpace, ModeCurve, trace_modes
from .native import Backend, NativeBuildWarning, backends
from .pictures.modes import plot_modes
from .simulate import simulate
from .singularity import LocalAnalysis, analyse
from .sweeps.record import Failure, RunRecord
from .sweeps.runs import grid, sweep, sweep_as_completed
from .trajectory import Stats, Trajectory
from .viewing.live import live
from .viewing.replay import ReplayPage, replay

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
