"""What docs/extending.md adds works in every backend, with derivatives where they apply."""

from __future__ import annotations

import contextlib
import io
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from tests.compiled import needs_kernel

Array = NDArray[np.float64]
PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]


@cache
def recipe(word: str) -> dict[str, Any]:
    """The names that the example with this word in it leaves behind."""
    (code,) = (found for found in BLOCK.findall(PAGE.read_text(encoding="utf-8")) if word in found)
    names: dict[str, Any] = {"__name__": "recipe"}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(code, str(PAGE), "exec", dont_inherit=True), names)
    return names


def on_a_sleeve() -> rg.Mechanism:
    """A sleeve that slides and turns on a rod which swings: the closure's recipe, with gravity."""
    loops = recipe("CylindricalClosure")["mechanism"]
    return rg.Mechanism.from_pinocchio(loops.model, loops.closures, "auto", pin.neutral(loops.model))


def on_a_composite() -> rg.Mechanism:
    """A sleeve on a rod, which carries a pendulum."""
    model = recipe("JointModelComposite")["model"].copy()
    size = pin.Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.02 * np.eye(3))
    model.appendBodyToJoint(1, size, pin.SE3.Identity())
    arm = model.addJoint(1, pin.JointModelRX(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(
        arm, pin.Inertia(0.5, np.array([0.0, 0.2, 0.0]), 0.01 * np.eye(3)), pin.SE3.Identity()
    )
    return rg.Mechanism.from_pinocchio(model, forces=[rg.JointSpring("arm", 2.0)])


SCENES = {
    "closure": on_a_sleeve,
    "composite": on_a_composite,
    "force": lambda: recipe("CubicSpring")["mechanism"],
    "format": lambda: recipe("read_links")["mechanism"],
}
IN_PYTHON = {"composite"}
"""What the compiled kernel refuses by name."""


def start(mech: rg.Mechanism) -> tuple[Array, Array]:
    q = mech.assemble(mech.home) if mech.closures else mech.home
    return q, mech.lift(q, np.random.default_rng(0).uniform(-1.0, 1.0, mech.m))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", SCENES)
def test_what_was_added_moves_alike(name: str, backend: Any) -> None:
    mech = SCENES[name]()
    q, v = start(mech)
    if backend == "native" and name in IN_PYTHON:
        with pytest.raises(rg.OptionError, match="which the compiled kernel does not know"):
            rg.simulate(mech, q, v, 0.02, 1e-3, backend=backend)
        backend = "auto"
    run = rg.simulate(mech, q, v, 0.02, 1e-3, backend=backend)
    exact = rg.simulate(mech, q, v, 0.02, 0.02, stepper="DOP853", rtol=1e-12, atol=1e-13, backend="python")
    np.testing.assert_allclose(run.q[-1], exact.q[-1], atol=1e-9)
    assert run.closure_error().max(initial=0.0) < 1e-12
    assert np.abs(run.energy_error()).max() < 1e-8


@pytest.mark.parametrize("name", SCENES)
def test_what_was_added_has_its_derivatives(name: str) -> None:
    """By whatever serves and by the reference, against differences of the forward dynamics."""
    mech = SCENES[name]()
    q, v = start(mech)
    u, h = v[mech.iv_independent], 1e-5

    def udot(eta: Array, du: Array) -> Array:
        moved = mech.tree.integrate(q, mech.G(q) @ eta)
        moved = mech.assemble(moved) if mech.closures else moved
        return np.asarray(rg.forward_dynamics(mech, moved, mech.lift(moved, u + du)))

    eye, none = np.eye(mech.m), np.zeros(mech.m)
    by_y = np.array([(udot(h * e, none) - udot(-h * e, none)) / (2 * h) for e in eye]).T
    by_u = np.array([(udot(none, h * e) - udot(none, -h * e)) / (2 * h) for e in eye]).T
    for found in (rg.derivatives(mech, q, v), reference.derivatives(mech, q, v)):
        np.testing.assert_allclose(found.da_dy, by_y, atol=1e-6 * (1.0 + np.abs(by_y).max()))
        np.testing.assert_allclose(found.da_dv, by_u, atol=1e-6 * (1.0 + np.abs(by_u).max()))


def test_a_stepper_that_was_added() -> None:
    """In both backends."""
    tableau = recipe("three_eighths")["three_eighths"]
    mech = rg.load("crank_rocker")
    run = rg.simulate(mech, duration=0.01, step=1e-3, stepper=tableau)
    same = rg.simulate(mech, duration=0.01, step=1e-3, stepper=tableau, backend="python")
    np.testing.assert_allclose(run.q, same.q, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(run.q, rg.simulate(mech, duration=0.01, step=1e-3).q, atol=1e-10)
    if rg.backends()["native"].available:
        assert run.stats.native_steps == 10
