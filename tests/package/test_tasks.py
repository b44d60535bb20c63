"""The task table: the other tools' scripts run, and err and are as long as the table says."""

from __future__ import annotations

import ast
import csv
import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.io.loader import models_folder

Array = NDArray[np.float64]
DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "tasks.md").read_text(encoding="utf-8")
TASKS = ("simulate", "drive", "event", "stop", "pin_force", "frame", "export", "control", "sweep", "singular")
PEERS = {"SciPy": "by_scipy", "MuJoCo": "by_mujoco", "Pinocchio": "by_pinocchio"}
SHARP: Any = {"duration": 2.0, "step": 1e-3, "stepper": "DOP853", "rtol": 1e-11, "atol": 1e-12}


def table() -> dict[str, dict[str, str]]:
    """Cells by task, "before all" among them, and by tool."""
    rows = [line.strip("|").split("|") for line in PAGE.splitlines() if line.startswith("|")]
    tools = [cell.strip() for cell in rows[0]][1:]
    found = [dict(zip(tools, (cell.strip() for cell in row[1:]), strict=True)) for row in rows[2:]]
    return dict(zip(("before all", *TASKS), found, strict=True))


def lines(code: str) -> int:
    """Lines of code: no blank ones, comments, docstrings, imports."""
    tree = ast.parse(code)
    left_out: set[int] = set()
    for node in ast.walk(tree):
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if text or isinstance(node, ast.Import | ast.ImportFrom):
            left_out |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    counted = enumerate(code.splitlines(), start=1)
    return sum(
        1 for n, line in counted if line.strip() and not line.strip().startswith("#") and n not in left_out
    )


def parts(module: str) -> dict[str, str]:
    """Source of each task in a peer's script, and of all the rest together."""
    code = (DOCS / "tasks" / f"{module}.py").read_text(encoding="utf-8")
    split: dict[str, str] = {}
    rest = code.splitlines()
    for node in ast.parse(code).body:
        if isinstance(node, ast.FunctionDef) and node.name in TASKS:
            first, last = node.lineno - 1, node.end_lineno or node.lineno
            split[node.name] = "\n".join(code.splitlines()[first:last])
            rest[first:last] = [""] * (last - first)
    return split | {"before all": "\n".join(rest)}


@pytest.mark.parametrize("peer", PEERS)
def test_lines_are_those_of_the_scripts(peer: str) -> None:
    counted = {task: str(lines(code)) for task, code in parts(PEERS[peer]).items()}
    assert {task: cells[peer].split(",")[0] for task, cells in table().items()} == counted


def test_lines_are_those_of_the_blocks() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    counted = ["0", *(str(lines(block)) for block in blocks)]
    assert [cells["here"] for cells in table().values()] == counted


@pytest.fixture(scope="module")
def exact() -> dict[str, Any]:
    """What each task is about, by DOP853 to 1e-11."""
    mech = rg.load("crank_rocker")
    low = rg.Event(lambda t, q, v: q[0] + 0.5, terminal=True)
    run = rg.simulate(mech, record=("a", "multipliers"), events=lambda t, q, v: v[2], **SHARP)
    turn = {"q1": rg.Motion(lambda t: 1.0 + 3.0 * t)}
    sim = rg.Simulation(mech)
    for _ in range(200):
        sim.step({"q1": 400.0 * (2.0 - sim.q[0]) - 40.0 * sim.v[0]}, n=10)
    starts = [mech.assemble([crank, *mech.home[1:]]) for crank in np.linspace(0.6, 1.4, 5)]
    swing = rg.simulate(rg.load("rhombus"), [0.5, -0.5, 0.5], [0.0, 0.0, 0.0], **SHARP | {"duration": 5.0})
    return {
        "simulate": run.q[-1],
        "drive": rg.simulate(mech, None, None, 2.0, 1e-2, drive=turn)["drive.q1"],
        "event": run.t_events[0][1:],
        "stop": rg.simulate(mech, events=low, **SHARP).t[-1],
        "pin_force": run.reaction("coupler_tip").force[::100, 1:],
        "frame": run.frame("rocker_tip").acceleration[::100, 1:],
        "control": sim.q[0],
        "sweep": np.array([rg.simulate(mech, q0, [0.0] * 3, **SHARP)["q1"][-1] for q0 in starts]),
        "singular": np.array([swing["q1"][-1], 0.0]),
    }


@pytest.fixture(params=PEERS)
def peer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[str, Any]:
    if request.param == "MuJoCo":
        pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(DOCS / "tasks"))
    module = importlib.import_module(PEERS[request.param])
    for name in PEERS.values():
        monkeypatch.delitem(sys.modules, name, raising=False)
    return request.param, module


def test_their_results_err_by_what_the_table_says(
    peer: tuple[str, Any], exact: dict[str, Any], tmp_path: Path
) -> None:
    """Not more, and hardly less, so that the table flatters nobody."""
    name, module = peer
    stated = table()

    def run(task: str, *more: Any) -> Any:
        function: Callable[..., Any] = getattr(module, task)
        model = "rhombus" if task == "singular" else "crank_rocker"
        urdf = next((models_folder() / model).glob("*.urdf"))
        return function(*([urdf] if name == "Pinocchio" else []), *more)

    for task, wanted in exact.items():
        found, said = np.asarray(run(task)), stated[task][name].split(",")[1].strip()
        assert found.shape == np.shape(wanted), task
        error = float(np.abs(found - wanted).max())
        if said == "—":
            assert error > 0.1, task
        else:
            assert error <= float(said.split()[0]), (task, error)
            assert error >= 1e-13 or float(said.split()[0]) <= 1e-8, (task, error)
    run("export", tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert (len(rows), len(rows[0])) == (2002, 7)
    np.testing.assert_allclose(float(rows[-1][1]), exact["simulate"][0], atol=1e-6)
