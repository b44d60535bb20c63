"""The peers' parameters, as `scan` chose them; docs/peers.md has its tables."""

from __future__ import annotations

from ..contender import Scene

TURNS = 200.0
LARGEST = 0.5
OMEGA_RULE = f"omega = {TURNS:g} / duration, at most {LARGEST:g} / step"


def omega(scene: Scene, step: float) -> float:
    """Baumgarte's ω for Pinocchio, 1/s; RK4 is stable with ω h < 2.8 at critical damping."""
    return min(TURNS / float(scene.times[-1]), LARGEST / step)


MUJOCO_HARDEST = 0.9999
"""Largest `solimp` that MuJoCo does not clip: 1 − d = 1e-4 of softness is left."""

MUJOCO_TIME_CONSTANT = 2.0
"""Steps; MuJoCo clips smaller ones (`refsafe`)."""


def mujoco_time_constant(step: float) -> float:
    """`solref` of MuJoCo's constraints, s."""
    return MUJOCO_TIME_CONSTANT * step
