"""Published benchmarks: what is delivered, what the numbers of others are, and the files that are written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from robust_gcp.__main__ import main
from robust_gcp.maps.pendulum import pendulum
from robust_gcp.reports.published import values
from robust_gcp.reports.published.command import Reached, fastest
from robust_gcp.reports.published.problems import CRANK, PROBLEMS, Problem

BY_NAME = {problem.name: problem for problem in PROBLEMS}


def placed(problem: Problem, joint: str, local: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """What a problem delivers at its start and at a state beside it, and a point of a joint's body there."""
    mechanism = problem.motion().scene.mechanism
    model = mechanism.model
    data, states = model.createData(), [mechanism.home, mechanism.home.copy()]
    states[1][mechanism.iq_independent[0]] += 0.1
    states[1] = mechanism.assemble(states[1], hold=mechanism.independent)
    found = []
    for q in states:
        pin.forwardKinematics(model, data, q)
        found.append(data.oMi[model.getJointId(joint)].act(np.array(local)))
    q = np.array(states)
    return problem.delivered(mechanism, q, np.zeros((2, mechanism.nv))), np.array(found)


@pytest.mark.parametrize(
    ("name", "joint", "local", "axes"),
    [
        ("A01", "theta", (1.0, 0.0, 0.0), [0, 1]),
        ("A04", "hinge3", (0.0, 0.0, 0.0), [0, 1, 2]),
        ("A05", "s", (0.0, 0.0, 0.0), [2]),
    ],
)
def test_what_is_delivered(name: str, joint: str, local: tuple[float, float, float], axes: list[int]) -> None:
    found, exact = placed(BY_NAME[name], joint, local)
    np.testing.assert_allclose(found, exact[:, axes], rtol=0.0, atol=1e-14)


def test_andrews_crank_ends_in_the_plane_of_its_model() -> None:
    """F, 7 mm from O, where the next link begins."""
    found, exact = placed(BY_NAME["A03"], "theta", (0.0, 0.0, 0.0))
    np.testing.assert_allclose(np.linalg.norm(exact, axis=1), CRANK, rtol=1e-12)
    turned = [
        np.arctan2(*(points[1] - points[0])[:2])
        for points in (found, exact[:, np.abs(exact).max(axis=0) > 1e-12])
    ]
    assert turned[0] == pytest.approx(turned[1], abs=1e-12)


def test_numbers_of_others() -> None:
    """Each as near as its own error leaves it; the four-bar against its closed form."""
    four_bar = values.double_four_bar()
    angle, _, _ = pendulum(np.array([0.0, 4.0]), np.pi / 2, -1.0, 3.0, 3.5 * 9.81)
    assert four_bar.ours == pytest.approx(0.5 * np.cos(angle[-1]), abs=1e-9)
    assert four_bar.theirs + 0.1140155972774224 == pytest.approx(0.1721665271840173, abs=1e-15)
    assert 1e-4 < four_bar.apart < 1e-3
    assert values.bricard().apart < 2e-6
    assert values.spatial_slider_crank().apart < 3e-8
    assert values.soft_flyball().apart < 3e-6
    andrews = values.andrews()
    assert andrews.apart < 1e-6 * abs(andrews.theirs)


def test_the_fastest_of_each_family() -> None:
    slow = Reached("A01", "a", "ours", 1e-3, 1e-4, 0.1, 2.0)
    fast, other = Reached("A01", "b", "ours", 1e-3, 9e-4, 0.2, 1.0), Reached("A01", "c", "MuJoCo", 1e-3)
    assert fastest([slow, fast, other]) == [fast]


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    marks = [
        f"<!-- {end}: {name} -->"
        for name in ("published values", "published benchmarks")
        for end in ("begin", "end")
    ]
    page.write_text("\n".join(marks) + "\n", encoding="utf-8")
    words = ["reports", "benchmarks", "--problem", "A01", "A03", "--method", "bridge"]
    assert main([*words, "--out", str(tmp_path / "out"), "--refresh", str(page)]) == 0
    told = capsys.readouterr().out
    assert "0.172166527184" in told and "1e-08 (ours)" in told
    for problem in ("A01", "A03"):
        table = np.loadtxt(tmp_path / "out" / f"{problem}_solution.txt")
        assert table.shape == (401, 3)
        assert table[-1, 0] == pytest.approx(10.0 if problem == "A01" else 0.05)
        assert "Accuracy:" in (tmp_path / "out" / f"{problem}_submit.txt").read_text(encoding="utf-8")
    angle, _, _ = pendulum(np.array([0.0, 10.0]), np.pi, 0.0, 1.0, 9.81)
    table = np.loadtxt(tmp_path / "out" / "A01_solution.txt")
    np.testing.assert_allclose(table[-1, 1:], [np.cos(angle[-1]), np.sin(angle[-1])], atol=1e-6)
    assert "| A01 |" in page.read_text(encoding="utf-8")
