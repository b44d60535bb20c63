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
from fmpy.fmi3 import FMU3Slave  # noqa: E402

STATES = ("serializeFMUState", "deserializeFMUState")
VERSIONS = pytest.mark.parametrize("version", [2, 3])


class Unit:
    """A unit that has begun, of either version."""

    def __init__(self, path: Path, folder: Path, version: int = 2) -> None:
        from fmpy import extract, read_model_description

        self.description = read_model_description(str(path))
        assert self.description.fmiVersion == f"{version}.0"
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        identifier = self.description.coSimulation.modelIdentifier
        where = {"unzipDirectory": extract(str(path), str(folder)), "modelIdentifier": identifier}
        slave = FMU2Slave if version == 2 else FMU3Slave
        self.fmu: Any = slave(guid=self.description.guid, instanceName="one", **where)
        self.fmu.instantiate()
        if version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        real, whole = ("Real", "Integer") if version == 2 else ("Float64", "Int32")
        self._set, self._get = getattr(self.fmu, f"set{real}"), getattr(self.fmu, f"get{real}")
        self._whole = getattr(self.fmu, f"get{whole}")

    def set(self, name: str, value: float) -> None:
        self._set([self.references[name]], [value])

    def get(self, names: list[str]) -> Any:
        return np.array(self._get([self.references[name] for name in names]))

    @property
    def crossings(self) -> int:
        return int(self._whole([self.references["crossings"]])[0])


@VERSIONS
@pytest.mark.parametrize("name", ["rhombus", "five_bar", "delta"])
def test_a_checker_finds_no_problem(name: str, version: int, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(rg.load(name).export(tmp_path / f"{name}.fmu", fmi=version))) == []


@VERSIONS
def test_the_same_bits_through_crossings(version: int, tmp_path: Path) -> None:
    mech = rg.load("rhombus")
    unit = Unit(mech.export(tmp_path / "rhombus.fmu", step=1e-3, fmi=version), tmp_path / "unit", version)
    here, rng = rg.Simulation(mech, keep="last"), np.random.default_rng(3)
    saved: Any = None
    for k in range(200):
        torque = float(rng.normal())
        unit.set("tau.q1", torque)
        unit.fmu.doStep(k * 1e-2, 1e-2)
        here.step({"q1": torque}, 10)
        np.testing.assert_array_equal(unit.get(["q.q1", "q.q2", "q.q3"]), here.q)
        np.testing.assert_array_equal(unit.get(["v.q1", "v.q2", "v.q3"]), here.v)
        if k == 120:
            saved = unit.fmu.getFMUState()
            there = unit.get(["q.q1", "tau.q1"])
    assert unit.crossings == len(here.crossings) > 0
    write, read = ("serializeFMUstate", "deSerializeFMUstate") if version == 2 else STATES
    raw = getattr(unit.fmu, write)(saved)
    unit.fmu.setFMUState(getattr(unit.fmu, read)(raw))
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


@VERSIONS
def test_simulate_fmu(version: int, tmp_path: Path) -> None:
    mech = rg.load("change_point")
    path = mech.export(tmp_path / "change_point.fmu", fmi=version)
    wanted = {"output_interval": 1e-2, "output": ["q.q1", "crossings"]}
    result = fmpy.simulate_fmu(str(path), stop_time=5.0, step_size=1e-3, **wanted)
    run = rg.simulate(mech, duration=5.0, step=1e-3)
    assert result["q.q1"][-1] == pytest.approx(run["q1"][-1], abs=1e-9)
    assert result["crossings"][-1] == len(run.crossings) > 0


def test_a_third_version(tmp_path: Path) -> None:
    """What a unit of version 3 is asked for besides, and versions that there are none of."""
    mech = rg.load("rhombus")
    unit = Unit(mech.export(tmp_path / "rhombus.fmu", fmi=3), tmp_path / "unit", 3)
    unit.fmu.doStep(0.0, 0.25)
    assert unit.get(["time"]) == pytest.approx([0.25], abs=1e-15)
    with pytest.raises(Exception, match="status"):
        unit.fmu.getInt64([0])
    with pytest.raises(rg.OptionError, match="fmi = 4"):
        mech.export(tmp_path / "rhombus.fmu", fmi=4)


@VERSIONS
def test_after_a_reset_it_begins_anew(version: int, tmp_path: Path) -> None:
    """The unit is as it was made: no step from where it was, and no start of the experiment before."""
    mech = rg.load("rhombus")
    unit = Unit(mech.export(tmp_path / "rhombus.fmu", fmi=version), tmp_path / "unit", version)
    unit.fmu.doStep(0.0, 0.1)
    unit.fmu.reset()
    with pytest.raises(Exception, match="status 3"):
        unit.fmu.doStep(0.0, 0.1)
    unit.fmu.enterInitializationMode()
    unit.fmu.exitInitializationMode()
    np.testing.assert_array_equal(unit.get(["q.q1", "q.q2", "q.q3"]), mech.home)
