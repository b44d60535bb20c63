"""Pinocchio's constraint models in place of closures: the same mechanism, or a refusal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.mechanism.constraint.pin_constraints import with_named_frames

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]

RIGID = {"3d": pin.ContactType.CONTACT_3D, "6d": pin.ContactType.CONTACT_6D}
ANCHOR = {"3d": pin.PointAnchorConstraintModel, "6d": pin.FrameAnchorConstraintModel}


def ends(mechanism: rg.Mechanism, closure: Any) -> tuple[Any, ...]:
    frames = [mechanism.model.frames[mechanism.model.getFrameId(n)] for n in (closure.frame1, closure.frame2)]
    return tuple(x for f in frames for x in (int(f.parentJoint), f.placement))


def rigid(mechanism: rg.Mechanism, closure: Any) -> Any:
    made = pin.RigidConstraintModel(
        RIGID[closure.kind], mechanism.model, *ends(mechanism, closure), pin.ReferenceFrame.LOCAL
    )
    made.name = "rigid"
    return made


def anchor(mechanism: rg.Mechanism, closure: Any) -> Any:
    return ANCHOR[closure.kind](mechanism.model, *ends(mechanism, closure))


def generic(mechanism: rg.Mechanism, closure: Any) -> Any:
    return pin.ConstraintModel(anchor(mechanism, closure))


def remade(mechanism: rg.Mechanism, closures: list[Any]) -> rg.Mechanism:
    return rg.Mechanism.from_pinocchio(
        mechanism.model, closures, mechanism.independent, home=mechanism.home, name=mechanism.name
    )


@pytest.mark.parametrize("make", [rigid, anchor, generic])
@pytest.mark.parametrize("name", ["rhombus", "kite", "tripod", "seven hinges", "humanoid"])
def test_constraint_models_are_the_same_mechanism(
    mechanisms: dict[str, rg.Mechanism], closed_states: States, make: Callable[..., Any], name: str
) -> None:
    named = mechanisms[name]
    other = remade(named, [make(named, c) for c in named.closures])
    q = pin.integrate(named.model, named.home, np.random.default_rng(1).uniform(-0.5, 0.5, named.nv))
    np.testing.assert_array_equal(other.phi(q), named.phi(q))
    np.testing.assert_array_equal(other.K(q), named.K(q))
    for q, v in closed_states(named, 2):
        np.testing.assert_array_equal(other.k(q, v), named.k(q, v))
        np.testing.assert_array_equal(
            rg.implicit_dynamics(other, q, v)[0], rg.implicit_dynamics(named, q, v)[0]
        )


def test_a_list_may_mix_closures_and_constraint_models(spatial: dict[str, rg.Mechanism]) -> None:
    named = spatial["tripod"]
    first, second, third = named.closures
    mixed = remade(named, [rigid(named, first), second, anchor(named, third)])
    assert mixed.closures[0] == rg.PointClosure("rigid_1", "rigid_2")
    assert mixed.closures[1] == second
    np.testing.assert_array_equal(mixed.K(named.home), named.K(named.home))
    again = mixed.with_independent(mixed.independent)
    np.testing.assert_array_equal(again.K(named.home), named.K(named.home))


def test_a_vector_of_pinocchio_is_a_list_too(mechanisms: dict[str, rg.Mechanism]) -> None:
    named = mechanisms["rhombus"]
    listed = pin.StdVec_RigidConstraintModel()
    listed.append(rigid(named, named.closures[0]))
    np.testing.assert_array_equal(remade(named, listed).K(named.home), named.K(named.home))


def test_the_same_accelerations_as_pinocchios_own_solver(
    spatial: dict[str, rg.Mechanism], closed_states: States
) -> None:
    named = spatial["seven hinges"]
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    models.append(rigid(named, named.closures[0]))
    datas.append(models[0].createData())
    mechanism = remade(named, list(models))
    model, data = named.model, named.model.createData()
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-10, 50)
    for q, v in closed_states(named, 3):
        theirs = pin.constraintDynamics(model, data, q, v, np.zeros(model.nv), models, datas, settings)
        ours, _ = rg.implicit_dynamics(mechanism, q, v)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


def test_the_users_model_stays_as_it_was(mechanisms: dict[str, rg.Mechanism]) -> None:
    named = mechanisms["rhombus"]
    model = named.model.copy()
    frames = model.nframes
    made = [rigid(named, named.closures[0])] * 2  # of one name: told apart
    extended, closures = with_named_frames(model, made)
    assert model.nframes == frames
    assert extended.nframes == frames + 4
    assert len({name for c in closures for name in (c.frame1, c.frame2)}) == 4


def test_closures_between_frames_copy_nothing(mechanisms: dict[str, rg.Mechanism]) -> None:
    named = mechanisms["rhombus"]
    assert with_named_frames(named.model, named.closures)[0] is named.model


def test_the_offset_of_a_point_anchor_is_kept(spatial: dict[str, rg.Mechanism]) -> None:
    """Its φ is R₁ᵀ (p₂ − p₁) − offset; ours is p₁ − p₂ in world axes with p₁ moved by the offset."""
    named = spatial["tripod"]
    constraint = anchor(named, named.closures[0])
    constraint.desired_constraint_offset = np.array([0.1, -0.2, 0.3])
    mechanism = remade(named, [constraint, *named.closures[1:]])
    q = pin.integrate(named.model, named.home, 0.3 * np.ones(named.nv))
    data, theirs = named.model.createData(), constraint.createData()
    pin.forwardKinematics(named.model, data, q)
    constraint.calc(named.model, data, theirs)
    expected = -theirs.oMc1.rotation @ theirs.constraint_position_error
    np.testing.assert_allclose(mechanism.phi(q)[:3], expected, atol=1e-14)


@pytest.mark.parametrize(
    ("make", "attribute", "value"),
    [
        (anchor, "desired_constraint_velocity", np.ones(6)),
        (anchor, "desired_constraint_acceleration", np.ones(6)),
        (anchor, "desired_constraint_offset", np.ones(6)),
        (rigid, "desired_contact_placement", pin.SE3(np.eye(3), np.ones(3))),
        (rigid, "desired_contact_velocity", pin.Motion(np.ones(6))),
        (rigid, "desired_contact_acceleration", pin.Motion(np.ones(6))),
    ],
)
def test_what_a_closure_cannot_do_is_refused(
    spatial: dict[str, rg.Mechanism], make: Callable[..., Any], attribute: str, value: Any
) -> None:
    named = spatial["seven hinges"]
    constraint = make(named, named.closures[0])
    setattr(constraint, attribute, value)
    with pytest.raises(rg.ModelError, match=f"{attribute}.*joint1_placement"):
        remade(named, [constraint])


def test_a_soft_constraint_is_refused(spatial: dict[str, rg.Mechanism]) -> None:
    named = spatial["seven hinges"]
    constraint = anchor(named, named.closures[0])
    constraint.setCompliance(1e-3 * np.ones(6))
    with pytest.raises(rg.ModelError, match=r"compliance.*PointSpring"):
        remade(named, [constraint])


def test_other_constraints_are_refused_by_name(spatial: dict[str, rg.Mechanism]) -> None:
    named = spatial["seven hinges"]
    for wrong in (pin.JointLimitConstraintModel(named.model, [1]), "a string"):
        with pytest.raises(rg.ModelError, match=rf"closures\[0\]: {type(wrong).__name__} does not close"):
            remade(named, [wrong])


def test_a_constraint_of_another_model_is_refused(
    mechanisms: dict[str, rg.Mechanism], spatial: dict[str, rg.Mechanism]
) -> None:
    hinges = spatial["seven hinges"]
    foreign = rigid(hinges, hinges.closures[0])
    with pytest.raises(rg.ModelError, match=r"'rigid'.*joint 7.*has 3.*another model"):
        remade(mechanisms["rhombus"], [foreign])
