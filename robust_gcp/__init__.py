"""Closed-loop mechanisms in minimal coordinates, straight through singular configurations."""

from .bridge import BridgeOptions
from .closure import FrameClosure, PointClosure, RevoluteClosure
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
    ToggleError,
)
from .explicit import Crossing
from .forces import JointDamper, JointSpring, JointTorque, PointSpring
from .gcp import SingularityWarning
from .inverse import inverse_dynamics
from .loader import load, model_names
from .mechanism import Mechanism
from .simulate import simulate
from .singularity import LocalAnalysis, analyse
from .trajectory import Stats, Trajectory

__version__ = "0.1.0"

__all__ = [
    "BranchError",
    "BridgeOptions",
    "ClosureError",
    "Crossing",
    "FrameClosure",
    "JointDamper",
    "JointSpring",
    "JointTorque",
    "LocalAnalysis",
    "Mechanism",
    "MissingExtraError",
    "ModelError",
    "NonFiniteError",
    "NotCertifiedError",
    "OptionError",
    "PartitionError",
    "PointClosure",
    "PointSpring",
    "RevoluteClosure",
    "RobustGcpError",
    "SimulationError",
    "SingularStartError",
    "SingularityWarning",
    "StateError",
    "Stats",
    "ToggleError",
    "Trajectory",
    "analyse",
    "implicit_dynamics",
    "inverse_dynamics",
    "load",
    "model_names",
    "simulate",
]
