"""Units for co-simulation: sound to a checker, the same bits as Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

fmpy = pytest.importorskip("fmpy")
if not rg.backends()["native"].available:
    pytest.skip("no compiled kernel", allow_module_level=True)

from fmpy.fmi2 import FMU2Slave  # noqa: E402


class Unit:
    """A unit that has begun."""

    def __init__(self, path: Path, folder: Path) -> None:
        from fmpy import extract, read_model_description

        self.description = read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        identifier = self.description.coSimulation.modelIdentifier
        where = {"unzipDirectory": extract(str(path), str(folder)), "modelIdentifier": identifier}
        self.fmu = FMU2Slave(guid=self.description.guid, instanceName="one", **where)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, name: str, value: float) -> None:
        self.fmu.setReal([self.references[name]], [value])

    def get(self, names: list[str]) -> Any:
        return np.array(self.fmu.getReal([self.references[name] for name in names]))


@pytest.mark.parametrize("name", ["rhombus", "five_bar", "delta"])
def test_a_checker_finds_no_problem(name: str, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(rg.load(name).export(tmp_path / f"{name}.fmu"))) == []


def test_the_same_bits_through_crossings(tmp_path: Path) -> None:
    mech = rg.load("rhombus")
    unit = Unit(mech.export(tmp_path / "rhombus.fmu", step=1e-3), tmp_path / "unit")
    here, rng = rg.Simulation(mech, keep="last"), np.random.default_rng(3)
    saved: Any = None
    for k in range(200):
        torque = float(rng.normal())
        unit.set("tau.q1", torque)
        assert unit.fmu.doStep(k * 1e-2, 1e-2) is None
        here.step({"q1": torque}, 10)
        np.testing.assert_array_equal(unit.get(["q.q1", "q.q2", "q.q3"]), here.q)
        np.testing.assert_array_equal(unit.get(["v.q1", "v.q2", "v.q3"]), here.v)
        if k == 120:
            saved = unit.fmu.getFMUState()
            there = unit.get(["q.q1", "tau.q1"])
    assert unit.fmu.getInteger([unit.references["crossings"]]) == [len(here.crossings)] and here.crossings
    raw = unit.fmu.serializeFMUstate(saved)
    unit.fmu.setFMUState(unit.fmu.deSerializeFMUstate(raw))
    np.testing.assert_array_equal(unit.get(["q.q1", "tau.q1"]), there)
    unit.fmu.freeFMUState(saved)
    unit.fmu.terminate()
    unit.fmu.freeInstance()


def test_controls_and_steps_of_other_lengths(tmp_path: Path) -> None:
    mech = rg.load("crank_rocker")
    unit = Unit(mech.export(tmp_path / "crank_rocker.fmu", step=2e-3), tmp_path / "unit")
    here = rg.Simulation(mech, step=0.0015, keep="last")
    name = mech.actuators[0].name
    unit.set(f"ctrl.{name}", 0.3)
    unit.fmu.doStep(0.0, 3e-3)  # two steps of 1.5 ms
    here.step(None, 2, ctrl={name: 0.3})
    np.testing.assert_allclose(unit.get(["q.q1"]), here.q[:1], rtol=0.0, atol=1e-15)


def test_simulate_fmu(tmp_path: Path) -> None:
    mech = rg.load("change_point")
    path = mech.export(tmp_path / "change_point.fmu")
    wanted = {"output_interval": 1e-2, "output": ["q.q1", "crossings"]}
    result = fmpy.simulate_fmu(str(path), stop_time=5.0, step_size=1e-3, **wanted)
    run = rg.simulate(mech, duration=5.0, step=1e-3)
    assert result["q.q1"][-1] == pytest.approx(run["q1"][-1], abs=1e-9)
    assert result["crossings"][-1] == len(run.crossings) > 0
