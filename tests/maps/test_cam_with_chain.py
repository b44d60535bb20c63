"""A cam's slider-crank with a chain of three links beside it: one cluster of two coordinates.

Its two modes meet where x = 0, whatever the chain does: they cross (k = 1), or touch.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import meetings
from robust_gcp.examples.linkages import add_link
from tests.compiled import needs_kernel

BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]
CHAIN = (0.8, 0.9, 1.0)


def cam_with_chain(order: int) -> rg.Mechanism:
    """y = the slide x and the first link's angle, home at x = 0.3."""
    cam = meetings.touching_cams(order, 0.3)
    model = cam.own_model.copy()
    body, at, names = int(model.getJointId("x")), 0.0, ("c1", "c2", "c3")
    chain = pin.Model()
    for name, length in zip(names, CHAIN, strict=True):
        parent = 0 if name == "c1" else chain.getJointId(chain.names[-1])
        add_link(chain, parent, at, name, length)
        at = length
    joined = pin.appendModel(model, chain, model.addFrame(_fixed("hinge", body)), pin.SE3.Identity())
    pose = {"c1": 0.6, "c2": 0.7, "c3": -1.0}
    q = np.array([pose.get(name, 0.0) for name in joined.names[1:]])
    for name, value in zip(cam.own_model.names[1:], cam.home, strict=True):
        q[joined.joints[joined.getJointId(name)].idx_q] = value
    data = joined.createData()
    pin.forwardKinematics(joined, data, q)
    pin.updateFramePlacements(joined, data)
    pivot = data.oMf[joined.getFrameId("c3_tip")].translation
    joined.addFrame(_fixed("pivot", 0, pivot))
    closures = [*cam.closures, rg.PointClosure("c3_tip", "pivot")]
    return rg.Mechanism(joined, closures, ["x", "c1"], home=q)


def _fixed(name: str, joint: int, at: np.ndarray | None = None) -> pin.Frame:
    place = pin.SE3(np.eye(3), np.zeros(3) if at is None else at)
    return pin.Frame(name, joint, place, pin.FrameType.OP_FRAME)


def run(order: int, rates: tuple[float, float], backend: str, steps: int = 250) -> rg.Trajectory:
    mechanism = cam_with_chain(order)
    v0 = mechanism.lift(mechanism.home, rates)
    return rg.simulate(mechanism, v0=v0, duration=0.25, step=0.25 / steps, backend=backend)


@needs_kernel
@pytest.mark.parametrize("rates", [(-3.0, 0.0), (-3.0, 0.8)])
def test_a_curved_surface_is_crossed_alike_in_both_backends(rates: tuple[float, float]) -> None:
    """With lines that are short enough, and in coordinates that are changed where x turns back beyond it."""
    python, native = (run(1, rates, backend) for backend in ("python", "native"))
    assert native.q[-1] == pytest.approx(python.q[-1], abs=1e-8)
    assert native.stats.repartitions == python.stats.repartitions != []
    for trajectory in (python, native):
        assert [(c.kind, c.corank) for c in trajectory.crossings] == [("transversal", 1)] * 2
        assert np.abs(trajectory.energy_error()).max() < 3e-5


@needs_kernel
def test_its_order() -> None:
    ends = [run(1, (-3.0, 0.0), "native", n).q[-1] for n in (500, 1000, 2000, 4000)]
    errors = [float(np.abs(end - ends[-1]).max()) for end in ends[:-1]]
    assert errors[0] / errors[1] > 12.0 and errors[2] < 1e-7


@pytest.mark.parametrize("backend", BACKENDS)
def test_surfaces_that_touch_are_refused_by_name(backend: str) -> None:
    with pytest.raises(rg.NotCertifiedError, match="modes touch in a cluster of 2 coordinates"):
        run(2, (-3.0, 0.0), backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_motion_that_does_not_come_there_is_not_refused(backend: str) -> None:
    trajectory = run(2, (0.5, 0.5), backend)
    assert trajectory.crossings == [] and np.abs(trajectory.energy_error()).max() < 1e-6
