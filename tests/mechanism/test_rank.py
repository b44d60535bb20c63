"""Regular or not, decided from the rank of K at a configuration and beside it."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import add_link
from robust_gcp.mechanism import tolerances
from robust_gcp.mechanism.constraint.rank import singular_words
from robust_gcp.mechanism.loops import ClosedLoops

PACKAGE = Path(rg.__file__).parent


@pytest.mark.parametrize("name", rg.model_names())
def test_homes_are_regular_as_the_second_order_says(name: str) -> None:
    mech = rg.load(name)
    kind = rg.analyse(mech, mech.home).kind
    assert (singular_words(mech, mech.home) == "") == (kind in ("regular", "redundant")), kind


@pytest.mark.parametrize(("name", "q"), [("rhombus", [0, 0, 0]), ("rhombus", [np.pi, -np.pi, np.pi])])
def test_places_where_modes_cross_are_singular(name: str, q: list[float]) -> None:
    mech = rg.load(name)
    assert singular_words(mech, np.array(q, dtype=float)).startswith("rank 1")
    auto = rg.Mechanism.from_pinocchio(mech.model, mech.closures, "auto", home=q)
    assert (auto.m, auto.home.tolist()) == (1, q)  # coordinates of a motion through it


def test_an_isolated_point_leads_nowhere() -> None:
    """l0 = l1 + l2 + l3: the four-bar closes stretched out and in no other place."""
    model = pin.Model()
    crank = add_link(model, 0, 0.0, "q1", 1.0)
    add_link(model, crank, 1.0, "q2", 1.0)
    add_link(model, 0, 3.0, "q3", 1.0)
    loops = ClosedLoops(model, [rg.PointClosure("q2_tip", "q3_tip")])
    q = np.array([0.0, 0.0, np.pi])
    assert loops.closure_residual(q) < 1e-15
    assert rg.analyse(loops, q).kind == "isolated"
    assert "leads nowhere" in singular_words(loops, q)
    with pytest.raises(rg.PartitionError, match="no regular configuration was found beside it"):
        rg.Mechanism.from_pinocchio(model, loops.closures, "auto", home=q)


def test_every_tolerance_has_a_reason() -> None:
    """Each is followed by a text, lies in (0, 1), and is used."""
    path = PACKAGE / "mechanism" / "tolerances.py"
    body = ast.parse(path.read_text(encoding="utf-8")).body
    named = [node.targets[0].id for node in body if isinstance(node, ast.Assign)]  # type: ignore[attr-defined]
    code = [p.read_text(encoding="utf-8") for p in PACKAGE.rglob("*.py") if p != path]
    for i, node in enumerate(body):
        if isinstance(node, ast.Assign):
            text = body[i + 1]
            assert isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
            assert len(str(text.value.value)) > 40
    for name in named:
        assert 0.0 < getattr(tolerances, name) < 1.0
        assert any(name in text for text in code), name
