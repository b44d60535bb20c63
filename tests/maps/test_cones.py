"""Beside an isolated cone of the configuration space: followed to the accuracy promised, or refused."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.cluster.apex import BesideApex
from robust_gcp.maps.cluster.cluster_map import ClusterMap
from robust_gcp.maps.cluster.space import space_of
from robust_gcp.mechanism.loops import ClosedLoops

from ..compiled import needs_kernel

APEX = np.array([0.0, 0.0, 0.0, np.pi])


def five_bar(home: np.ndarray) -> rg.Mechanism:
    """Cranks of 1, couplers of 1.4, pivots 2.8 apart: in line at the apex, 1 + 1.4 = 2.8 + 1 − 1.4."""
    model = pin.Model()
    left = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, left, 1.0, "q2", 1.4)
    right = linkages.add_link(model, 0, 2.8, "q3", 1.0)
    linkages.add_link(model, right, 1.0, "q4", 1.4)
    return rg.Mechanism(model, [rg.PointClosure("q2_tip", "q4_tip")], ["q1", "q3"], home=home)


def beside(distance: float) -> tuple[rg.Mechanism, np.ndarray]:
    """The linkage on the cone at this distance from its apex, and the velocity 2 around the apex."""
    mechanism = five_bar(APEX)
    U, _, Vt = np.linalg.svd(mechanism.K(APEX))
    u, N = U[:, 1], Vt[1:].T

    def bend(a: np.ndarray, b: np.ndarray) -> float:
        return float(u @ (mechanism.k(APEX, a - b) - mechanism.k(APEX, a + b))) / 4.0

    values, vectors = np.linalg.eigh(np.array([[bend(a, b) for a in N.T] for b in N.T]))
    assert (np.sign(values) == [-1.0, 1.0, 1.0]).all()  # a cone, no crossing and no isolated point
    axes = N @ vectors / np.sqrt(np.abs(values))
    ruling = axes @ [1.0, np.cos(1.0), np.sin(1.0)]
    around = axes @ [0.0, -np.sin(1.0), np.cos(1.0)]
    q = APEX + distance * ruling / np.linalg.norm(ruling)
    for _ in range(20):
        q = q - np.linalg.lstsq(mechanism.K(q), mechanism.phi(q), rcond=None)[0]
    free = np.linalg.svd(mechanism.K(q))[2][2:].T
    v = free @ (free.T @ around)
    return five_bar(q), 2.0 * v / np.linalg.norm(v)


@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-4])
def test_the_way_past_a_cone_is_the_way_back(distance: float) -> None:
    """Without friction a motion goes back as it came: through the pass, to 1e-11, energy to 1e-8 of 4 J."""
    mechanism, v = beside(distance)
    back = rg.simulate(mechanism, v0=-v, duration=0.002, step=1e-3)
    run = rg.simulate(mechanism, back.q[-1], -back.v[-1], duration=0.004, step=1e-3)
    assert np.abs(run.q[2] - mechanism.home).max() < 1e-11
    assert np.abs(run.energy_error()).max() < 1e-8
    assert run.closure_error().max() < 1e-12
    assert run.stats.refined_steps > 0
    assert not run.crossings


def towards(share: float) -> tuple[rg.Mechanism, np.ndarray]:
    """2e-3 from the apex, with the velocity 2 towards it but for this share around it."""
    mechanism, around = beside(2e-3)
    free = np.linalg.svd(mechanism.K(mechanism.home))[2][2:].T
    inward = free @ (free.T @ (APEX - mechanism.home))
    inward /= np.linalg.norm(inward)
    around = around - inward * (around @ inward)
    around /= np.linalg.norm(around)
    return mechanism, 2.0 * (inward * np.sqrt(1.0 - share**2) + around * share)


def test_a_pass_close_to_the_apex_goes_back_as_it_came() -> None:
    mechanism, v = towards(1.5e-2)
    run = rg.simulate(mechanism, v0=v, duration=0.002, step=1e-3)
    assert min(np.linalg.norm(run.q - APEX, axis=1)) < 1e-4
    back = rg.simulate(mechanism, run.q[-1], -run.v[-1], duration=0.002, step=1e-3)
    assert np.abs(back.q[-1] - mechanism.home).max() < 1e-9
    assert np.abs(run.energy_error()).max() < 1e-7
    assert np.abs(back.energy_error()).max() < 1e-7


def test_a_motion_through_the_apex_is_refused_by_that_name() -> None:
    mechanism, v = towards(5e-3)  # what is curved of the way there makes up for the share
    with pytest.raises(rg.NotCertifiedError, match="isolated cone"):
        rg.simulate(mechanism, v0=v, duration=0.002, step=1e-3)


def test_phi_beside_the_apex_keeps_the_digits_that_phi_itself_loses() -> None:
    """1e-6 beside it uᵀφ is 1e-12, of which φ keeps three digits; exactly, cos a − 1 = −2 sin²(a/2)."""
    mechanism = five_bar(APEX)
    space = space_of(mechanism, mechanism.clusters[0], APEX)
    apex = space.x(APEX)
    x = apex + np.array([3e-7, -8e-7, 5e-7, 4e-7])
    a, b, c, d = space.D * (x - apex)
    squares = np.sin(0.5 * np.array([a, a + b, c, c + d])) ** 2
    exact = 2.0 * float(np.array([-1.0, -1.4, 1.0, -1.4]) @ squares) / space.loops.length
    near = BesideApex(space, apex).linear(x)[0][0]
    assert abs(near - exact) < 1e-21
    assert abs(space.linear(x)[0][0] - exact) > 1e-17


def test_a_start_at_the_apex_is_refused() -> None:
    mechanism, v = beside(1e-6)
    with pytest.raises(rg.NotCertifiedError, match="signature 1, 2"):
        rg.simulate(mechanism, v0=v, duration=0.005, step=1e-3)


def origami(cut: int) -> tuple[rg.Mechanism, np.ndarray]:
    """Six panels of 60 degrees about one vertex, the loop cut at this crease, beside the flat state; v."""
    creases = [(cut + k) % 6 for k in range(6)]
    axes = {k: np.array([np.cos(k * np.pi / 3), np.sin(k * np.pi / 3), 0.0]) for k in creases}
    model, joint = pin.Model(), 0
    for k in creases[1:]:
        hinge = pin.JointModelRevoluteUnaligned(*axes[k])
        joint = model.addJoint(joint, hinge, pin.SE3.Identity(), f"c{k}")
        centre = (axes[k] + axes[(k + 1) % 6]) / 3.0
        model.appendBodyToJoint(joint, pin.Inertia(1.0, centre, 0.05 * np.eye(3)), pin.SE3.Identity())
    for name, parent in (("end", joint), ("ground", 0)):
        model.addFrame(pin.Frame(name, parent, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    closure = rg.RevoluteClosure("end", "ground", axis=tuple(axes[cut]))
    folded = np.array([0.25 if k % 2 else -0.2 for k in creases[1:]])
    home = ClosedLoops(model, [closure]).polish(folded, np.arange(5))
    mechanism = rg.Mechanism.from_pinocchio(model, [closure], "auto", home=home)
    free = np.linalg.svd(mechanism.K(home))[2][-mechanism.m :].T
    v = free @ (free.T @ -home)
    return mechanism, 1.2 * v / np.abs(v).max()


@needs_kernel
@pytest.mark.parametrize("cut", [0, 1, 2])
def test_a_pass_of_three_coordinates_is_as_good_as_its_steps(cut: int) -> None:
    """Energy, kept beside the apex of a vertex where m = 3, to the fourth order of the step, in every cut."""
    mechanism, v = origami(cut)
    runs = [rg.simulate(mechanism, v0=v, duration=0.6, step=h) for h in (4e-3, 2e-3, 1e-3)]
    assert min(np.linalg.norm(runs[-1].q, axis=1)) < 0.1
    lost = [np.abs(run.energy_error()).max() for run in runs]
    assert lost[-1] < 1e-6
    assert all(fine < coarse / 7.0 for coarse, fine in itertools.pairwise(lost))
    assert all(run.stats.refined_steps for run in runs)


@needs_kernel
def test_steps_with_error_control_beside_a_cone_are_the_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python evaluates the map where the run turns to such steps, and nowhere else."""
    asked: list[float] = []
    at = ClusterMap.point_at
    monkeypatch.setattr(ClusterMap, "point_at", lambda self, y, ydot: asked.append(0.0) or at(self, y, ydot))
    mechanism, v = origami(0)
    run = rg.simulate(mechanism, v0=v, duration=0.3, step=1e-3)
    assert run.stats.refined_steps > 100
    assert run.stats.rhs > 10 * run.stats.refined_steps
    assert len(asked) < 0.02 * run.stats.rhs
