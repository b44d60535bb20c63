"""Every valid set of independent joints describes the same motion; LCABA agrees as well."""

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.reports.a02 import measure

GOOD = {"andrews": 1e-3, "five_bar": 0.03, "stewart": 0.03}
"""Share of the motion that a set must see at the start to count as valid for a short while: no toggle is
near. Andrews' crank turns some hundred times as fast as its arms move."""


def moving(name: str, before: float, step: float) -> tuple[rg.Mechanism, np.ndarray, np.ndarray]:
    """A scene and a state on its motion where nothing is at rest or in line."""
    mechanism = rg.load(name)
    v0 = None
    if name != "andrews":  # Andrews' motor drives it
        v0 = mechanism.lift(mechanism.home, np.linspace(0.5, 1.0, mechanism.m))
    run = rg.simulate(mechanism, v0=v0, duration=before, step=step)
    return mechanism, run.q[-1], run.v[-1]


def quality(mechanism: rg.Mechanism, q: np.ndarray, names: tuple[str, ...]) -> float:
    """σ_min of the chosen rows of an orthonormal kernel basis; 0 where they cannot be coordinates."""
    K = mechanism.scaled(mechanism.K(q))
    N = np.linalg.svd(K)[2][mechanism.nv - mechanism.m :].T
    rows = [mechanism.joint(name).idx_v for name in names]
    return float(np.linalg.svd(N[rows], compute_uv=False)[-1])


@pytest.mark.parametrize(
    ("name", "before", "step", "duration", "fine"),
    [("andrews", 0.004, 2e-5, 6e-4, 1e-5), ("five_bar", 0.1, 1e-3, 0.1, 1e-3)],
)
def test_every_valid_choice_gives_the_same_motion(
    name: str, before: float, step: float, duration: float, fine: float
) -> None:
    mechanism, q0, v0 = moving(name, before, step)
    reference = rg.simulate(mechanism, q0, v0, duration=duration, step=fine)
    sets = list(combinations(mechanism.joint_names, mechanism.m))
    valid = [names for names in sets if quality(mechanism, q0, names) > GOOD[name]]
    assert len(valid) >= 5
    for names in valid:
        other = rg.simulate(mechanism.with_independent(names), q0, v0, duration=duration, step=fine)
        np.testing.assert_allclose(other.q, reference.q, atol=1e-9, err_msg=str(names))


def test_stewart_in_many_of_its_thousands_of_choices() -> None:
    # 18 joints with one number each, 18564 sets of six: a reproducible sample of the valid ones
    mechanism, q0, v0 = moving("stewart", 0.02, 1e-3)
    single = [n for n in mechanism.joint_names if mechanism.joint(n).nq == 1]
    rng = np.random.default_rng(6)
    reference = rg.simulate(mechanism, q0, v0, duration=0.01, step=1e-3)
    tried = 0
    while tried < 10:
        names = tuple(sorted(rng.choice(single, 6, replace=False).tolist()))
        if quality(mechanism, q0, names) < GOOD["stewart"]:
            continue
        tried += 1
        other = rg.simulate(mechanism.with_independent(names), q0, v0, duration=0.01, step=1e-3)
        np.testing.assert_allclose(other.q, reference.q, atol=1e-9, err_msg=str(names))


@pytest.mark.parametrize("name", ["rhombus", "crank_rocker", "five_bar", "slider_crank", "strandbeest"])
def test_lcaba_agrees(name: str) -> None:
    """Pinocchio's loop-constrained articulated-body algorithm, where all closures are points."""
    mechanism, q, v = moving(name, 0.05, 1e-3)
    model = mechanism.model.copy()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in mechanism.closures:
        one, two = (model.frames[model.getFrameId(f)] for f in (closure.frame1, closure.frame2))
        ends = (one.parentJoint, one.placement, two.parentJoint, two.placement)
        contact = pin.ContactType.CONTACT_3D
        models.append(pin.RigidConstraintModel(contact, model, *ends, pin.ReferenceFrame.LOCAL))
        datas.append(models[-1].createData())
    data = model.createData()
    pin.computeJointMinimalOrdering(model, data, models)
    settings = pin.ProximalSettings(1e-14, 1e-14, 1e-6, 200)
    tau = np.zeros(model.nv) if mechanism.applied is None else mechanism.applied.tau(q, v)
    theirs = pin.lcaba(model, data, q, v, tau, models, datas, settings)
    ours = rg.simulate(mechanism, q, v, duration=1e-6, step=1e-6, record=("a",)).a
    assert ours is not None
    np.testing.assert_allclose(ours[0], theirs, atol=1e-9 * max(1.0, np.abs(theirs).max()))


@pytest.mark.parametrize(("n", "duration"), [(1, 20.0), (2, 5.0), (5, 3.0), (10, 2.0), (40, 1.0)])
def test_rows_of_four_bars_against_the_closed_form(n: int, duration: float) -> None:
    # `robust-gcp reports a02` runs all of them for 20 s; 1e-8 m holds at h = 1 ms and here at twice that
    result = measure(n, 2e-3, duration)
    assert result.position < 1e-8
    assert result.velocity < 1e-7
    assert result.closure < 1e-11
    assert result.crossings >= 1
