"""Each warning names the line of the caller's that brought it about, however deep it arose."""

from __future__ import annotations

import contextlib
import inspect
import pkgutil
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from tests.compiled import KERNEL

GAP = four_bar(4.0 - 1e-10, 2.0, 3.0, 3.0, y=2.5)
STIFF = rg.Mechanism.from_pinocchio(
    rg.load("rhombus").model, rg.load("rhombus").closures, ["q1"], rg.load("rhombus").home,
    forces=[rg.JointDamper("q1", 1e5)],
)  # fmt: skip
FAST = {"q0": [0.1, -0.1, 0.1], "v0": [-1.0, 1.0, -1.0], "duration": 0.2, "method": "classical"}
RHOMBUS = rg.load("rhombus")
LIMITED = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" limited="true" range="-9 9"/>
<geom size=".1" mass="1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


def abs_shifted(t: Any) -> Any:
    """RHOMBUS's home on, with a kink at 0.037 s."""
    return RHOMBUS.home[0] + abs(t - 0.037) - 0.037


def screw() -> rg.Mechanism:
    """A joint that the compiled kernel does not know."""
    model = pin.Model()
    kind = pin.JointModelHelicalUnaligned(np.array([1.0, 0.0, 0.0]), 0.1)
    joint = model.addJoint(0, kind, pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, [], ["screw"])


CASES: dict[str, tuple[type[Warning], Callable[[], Any]]] = {
    "StabilityWarning": (rg.StabilityWarning, lambda: rg.simulate(STIFF, duration=0.02, step=0.01)),
    "CoarseStepWarning": (
        rg.CoarseStepWarning,
        lambda: rg.simulate(RHOMBUS, v0=RHOMBUS.lift(RHOMBUS.home, [10.0]), duration=1.0, step=0.2),
    ),
    "SingularityWarning": (rg.SingularityWarning, lambda: rg.simulate(RHOMBUS, **FAST)),
    "SingularityWarning, kernel off": (
        rg.SingularityWarning,
        lambda: rg.simulate(RHOMBUS, backend="python", **FAST),
    ),
    "SingularityWarning, through scipy": (
        rg.SingularityWarning,
        lambda: rg.simulate(RHOMBUS, stepper="RK45", **FAST),
    ),
    "SingularityWarning, through scipy's Radau": (
        rg.SingularityWarning,
        lambda: rg.simulate(RHOMBUS, stepper="Radau", **FAST),
    ),
    "SingularityWarning, in a sweep": (
        rg.SingularityWarning,
        lambda: rg.sweep(RHOMBUS, [FAST], workers=0),
    ),
    "SingularityWarning, of a gap": (
        rg.SingularityWarning,
        lambda: rg.simulate(GAP, duration=1.0, step=4e-3),
    ),
    "SingularityWarning, of a gap, kernel off": (
        rg.SingularityWarning,
        lambda: rg.simulate(GAP, duration=1.0, step=4e-3, backend="python"),
    ),
    "KinkedDriveWarning": (
        rg.KinkedDriveWarning,
        lambda: rg.simulate(RHOMBUS, duration=0.1, step=1e-2, drive={"q1": rg.Motion(abs_shifted)}),
    ),
    "ModelWarning": (rg.ModelWarning, lambda: rg.Mechanism.from_mjcf(LIMITED)),
    "PerformanceWarning": (rg.PerformanceWarning, lambda: rg.simulate(screw(), duration=2e-3, step=1e-3)),
    "PerformanceWarning, of derivatives": (
        rg.PerformanceWarning,
        lambda: rg.step(screw(), [0.1], h=1e-3),
    ),
    "NativeBuildWarning": (rg.NativeBuildWarning, lambda: rg.simulate(RHOMBUS, duration=2e-3)),
    "NativeBuildWarning, in a sweep": (
        rg.NativeBuildWarning,
        lambda: rg.sweep(RHOMBUS, [{"duration": 2e-3}], workers=0),
    ),
}


def lines_of(call: Callable[[], Any]) -> range:
    """The lines of the call in this file."""
    text, first = inspect.getsourcelines(call)
    return range(first, first + len(text))


def caught_from(call: Callable[[], Any], kind: type[Warning]) -> list[warnings.WarningMessage]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.suppress(rg.SimulationError):  # of the unstable motion that was warned of
            call()
    return [w for w in caught if w.category is kind]


@pytest.mark.parametrize("name", CASES)
def test_the_line_of_the_call_is_named(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kind, call = CASES[name]
    if kind is rg.PerformanceWarning and not KERNEL.available:
        pytest.skip(KERNEL.reason)
    if kind is rg.NativeBuildWarning:
        broken = tmp_path / "kernel.so"
        broken.write_bytes(b"no library")
        monkeypatch.setenv("ROBUST_GCP_NATIVE", str(broken))
    found = caught_from(call, kind)
    assert found
    for warning in found:
        assert warning.filename == __file__
        assert warning.lineno in lines_of(call)


def test_every_warning_of_the_package_has_a_case() -> None:
    names = {
        name
        for module in ("robust_gcp", *(f"robust_gcp.{m.name}" for m in pkgutil.iter_modules(rg.__path__)))
        if not module.endswith("__main__")
        for name, value in vars(import_module(module)).items()
        if isinstance(value, type)
        and issubclass(value, Warning)
        and value.__module__.startswith("robust_gcp")
    }
    texts = [path.read_text(encoding="utf-8") for path in Path(rg.__file__).parent.rglob("*.py")]
    given = {name for name in names if any("import warn\n" in text and name in text for text in texts)}
    assert given == {kind.__name__ for kind, _ in CASES.values()}


def test_there_is_one_way_to_warn() -> None:
    for path in Path(rg.__file__).parent.rglob("*.py"):
        if path.name != "warning.py":
            assert "warnings.warn(" not in path.read_text(encoding="utf-8"), path


def inner(torque: Callable[..., Any]) -> None:
    rg.simulate(RHOMBUS, duration=2e-3, torque=torque)


def test_a_call_within_a_callback_is_the_callers_too() -> None:
    """The innermost line outside the package: that of the simulation within the simulation."""

    def torque(t: float, q: Any, v: Any) -> list[float]:
        if t == 0.0:
            rg.simulate(RHOMBUS, **FAST)
        return [0.0, 0.0, 0.0]

    found = caught_from(lambda: inner(torque), rg.SingularityWarning)
    assert found and all(w.filename == __file__ and w.lineno in lines_of(torque) for w in found)


def test_filters_see_the_callers_module_and_each_line_is_told_once() -> None:
    """Python's default: once for each line; and a filter by module reaches the caller's."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.filterwarnings("default", category=rg.SingularityWarning, module=f"{__name__}$")
        globals().pop("__warningregistry__", None)
        for _ in range(3):
            rg.simulate(RHOMBUS, **FAST)
        rg.simulate(RHOMBUS, **FAST)
    assert len(caught) == 2
    with warnings.catch_warnings():
        warnings.filterwarnings("error", category=rg.SingularityWarning, module=f"{__name__}$")
        with pytest.raises(rg.SingularityWarning):
            rg.simulate(RHOMBUS, **FAST)
