"""Every kind of joint that Pinocchio has: inertia, energies, forces and closures agree with each other."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.maps.closed_form import pendulum
from robust_gcp.mechanism.constraint.closures import closure_frames
from robust_gcp.mechanism.constraint.constraint import ImplicitConstraint
from robust_gcp.mechanism.tree.tree import Tree

Array = NDArray[np.float64]

AXIS = np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0)


def composite() -> pin.JointModelComposite:
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelRevoluteUnaligned(AXIS), pin.SE3(pin.exp3(AXIS), 0.3 * AXIS))
    joint.addJoint(pin.JointModelPY(), pin.SE3(pin.exp3(-AXIS), 0.2 * AXIS))
    return joint


MADE: dict[str, Callable[[], object]] = {
    "JointModelComposite": composite,
    "JointModelEllipsoid": lambda: pin.JointModelEllipsoid(0.3, 0.4, 0.5),
    "JointModelHX": lambda: pin.JointModelHX(0.3),
    "JointModelHY": lambda: pin.JointModelHY(0.3),
    "JointModelHZ": lambda: pin.JointModelHZ(0.3),
    "JointModelHelicalUnaligned": lambda: pin.JointModelHelicalUnaligned(AXIS, 0.3),
    "JointModelPrismaticUnaligned": lambda: pin.JointModelPrismaticUnaligned(AXIS),
    "JointModelRevoluteUnaligned": lambda: pin.JointModelRevoluteUnaligned(AXIS),
    "JointModelUniversal": lambda: pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1]),
}
"""How to make the kinds that need more than their name."""

NOT_JOINTS = {"JointModel", "JointModelMimic"}
"""The base, and a kind that `check_model` refuses."""

NAMELESS = {"JointModelRevoluteUnboundedUnaligned"}
"""Pinocchio's Python cannot give it an axis; the one that its URDF reader makes is tested instead."""

KINDS = sorted({n for n in dir(pin) if n.startswith("JointModel")} - NOT_JOINTS - NAMELESS)


def skew_continuous() -> pin.JointModel:
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="1 -2 3"/></joint>
      </robot>"""
    return pin.buildModelFromXML(text).joints[1]


def chain(kind: str) -> pin.Model:
    """Two joints of the kind with a skew hinge between them, all with rotor inertia."""
    rng = np.random.default_rng(5)
    model, parent = pin.Model(), 0
    for i in range(3):
        joint = pin.JointModelRevoluteUnaligned(AXIS[[2, 0, 1]])
        if i != 1:
            made = MADE.get(kind, getattr(pin, kind, skew_continuous))
            joint = skew_continuous() if kind in NAMELESS else made()
        place = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))
        parent = model.addJoint(parent, joint, place, f"j{i}")
        body = pin.Inertia(1.0 + i, rng.uniform(-0.2, 0.2, 3), np.diag([0.05, 0.06, 0.07]))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.armature = rng.uniform(1.0, 2.0, model.nv)
    for name, joint in (("tip", parent), ("ground", 0)):
        place = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return model


def state(model: pin.Model) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(8)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-0.6, 0.6, model.nv))
    return q, rng.uniform(-1.0, 1.0, model.nv), rng.uniform(-1.0, 1.0, model.nv)


@pytest.mark.parametrize("kind", [*KINDS, *NAMELESS])
def test_inertia_forces_and_energies_agree(kind: str, derivative: Callable[..., Array]) -> None:
    """T = ½ vᵀ M v with rotors, τ = M a + C, and v · τ is the rate of T + U along q(s) with q̇ = v + s a."""
    model = chain(kind)
    tree, (q, v, a) = Tree(model), state(model)
    M = tree.crba(q).copy()
    assert tree.kinetic(q, v) == pytest.approx(0.5 * v @ M @ v, rel=1e-13)
    force, bias = tree.rnea(q, v, a).copy(), tree.rnea(q, v, tree.zero).copy()
    np.testing.assert_allclose(M @ a, force - bias, atol=1e-13 * np.abs(force).max())
    # ⊕ along v + s a/2 is right to the second order in s; the energies' rate at s = 0 needs the first
    energy = derivative(lambda s: np.array(sum(tree.energies(tree.integrate(q, s * v), v + s * a))), h=2e-3)
    assert v @ force == pytest.approx(float(energy), rel=1e-9)


@pytest.mark.parametrize("kind", [*KINDS, *NAMELESS])
def test_closures_have_their_derivatives(kind: str, derivative: Callable[..., Array]) -> None:
    """K v = dφ/dt and k = −(dK/dt) v through each kind, also where its motion subspace depends on q."""
    model = chain(kind)
    closure = rg.FrameClosure("tip", "ground")
    tree = Tree(model, closure_frames(model, [closure]))
    implicit = ImplicitConstraint(tree, [closure])
    q, v, _ = state(model)

    def at(s: float) -> tuple[Array, Array]:
        # the curve with q̇ = v throughout: joint by joint a group's ⊕ has a constant velocity
        tree.jacobians(tree.integrate(q, s * v))
        return implicit.residual(), implicit.jacobian() @ v

    rate, second = derivative(lambda s: at(s)[0]), derivative(lambda s: at(s)[1])
    np.testing.assert_allclose(at(0.0)[1], rate, atol=1e-10)
    tree.jacobians(q)
    tree.rnea(q, v, tree.zero)
    np.testing.assert_allclose(implicit.bias(), -second, atol=1e-9)


@pytest.mark.parametrize("kind", [*KINDS, *NAMELESS])
def test_the_jacobian_has_its_rate(kind: str, derivative: Callable[..., Array]) -> None:
    """dK/dt row by row and column by column, which loops are followed by beside singular places."""
    model = chain(kind)
    closures = [rg.FrameClosure("tip", "ground"), rg.PrismaticClosure("tip", "ground", (0.6, 0.0, 0.8))]
    tree = Tree(model, closure_frames(model, closures))
    implicit = ImplicitConstraint(tree, closures)
    q, v, _ = state(model)

    def at(s: float) -> Array:
        tree.jacobians(tree.integrate(q, s * v))
        return implicit.jacobian().copy()

    wanted = derivative(at)
    if kind == "JointModelEllipsoid":
        with pytest.raises(rg.ModelError, match="is no chain"):
            tree.jacobian_rates(q, v)
        return
    tree.jacobian_rates(q, v)
    np.testing.assert_allclose(implicit.jacobian_rate(v), wanted, atol=1e-9)


@pytest.mark.parametrize("axis", [(-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("backend", ["python", "native"])
def test_a_pendulum_with_a_rotor(axis: tuple[float, float, float], backend: str) -> None:
    """A ÿ = −B sin θ with A = I + m l² + the rotor's 2 kg m², whatever axis it turns about."""
    if backend == "native" and not rg.backends()["native"].available:
        pytest.skip("the compiled kernel is not built")
    turn = np.array(axis)
    down = np.cross(turn, [0.3, 0.5, 0.2])
    down /= np.linalg.norm(down)
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRevoluteUnaligned(turn), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(1.5, 0.4 * down, 0.1 * np.eye(3)), pin.SE3.Identity())
    model.armature = np.array([2.0])
    model.gravity.linear = 9.81 * down
    mechanism = rg.Mechanism.from_pinocchio(model)
    run = rg.simulate(mechanism, [1.2], duration=3.0, step=1e-3, backend=backend, record=("energy",))
    # θ = y + π/2 from the rest position turns −B sin θ into pendulum's −B cos y
    y, _, _ = pendulum(run.t, 1.2 - np.pi / 2, 0.0, 0.1 + 1.5 * 0.16 + 2.0, 1.5 * 0.4 * 9.81)
    np.testing.assert_allclose(run.q[:, 0], y + np.pi / 2, atol=1e-11)
    assert np.abs(run.energy_error()).max() < 1e-10


def with_rotors(mechanism: rg.Mechanism) -> rg.Mechanism:
    """The same with rotor inertia on every velocity."""
    model = mechanism.model.copy()
    model.armature = np.linspace(0.5, 1.5, model.nv)
    return rg.Mechanism(model, mechanism.closures, mechanism.independent, mechanism.home)


@pytest.mark.parametrize("name", ["tripod", "spherical loop", "seven hinges", "rhombus"])
def test_the_kernel_has_the_same_rotors(mechanisms: dict[str, rg.Mechanism], name: str) -> None:
    """Both backends, free bodies and balls included, from the same start: the same motion."""
    if not rg.backends()["native"].available:
        pytest.skip("the compiled kernel is not built")
    mechanism = with_rotors(mechanisms[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        runs = [
            rg.simulate(mechanism, duration=0.1, step=1e-3, backend=backend, record=("energy",))
            for backend in ("python", "native")
        ]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)
    np.testing.assert_allclose(runs[0].energy, runs[1].energy, rtol=1e-12, atol=1e-12)
    assert max(np.abs(run.energy_error()).max() for run in runs) < 1e-6
