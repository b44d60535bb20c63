"""Which files are read: what stands beside a robot's file, what is missing or too large, what floats."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.io import xml_text
from robust_gcp.io.loader import models_folder

SHIPPED = models_folder() / "crank_rocker"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot's file without its YAML: an open tree."""
    (tmp_path / "robot.urdf").write_bytes((SHIPPED / "robot.urdf").read_bytes())
    return tmp_path


@pytest.mark.parametrize("name", ["robot.yml", "Robot.yaml", "ROBOT.YAML"])
@pytest.mark.parametrize("given", [".", "robot.urdf"])
def test_a_yaml_by_another_name_is_not_passed_over(name: str, given: str, folder: Path) -> None:
    (folder / name).write_bytes((SHIPPED / "robot.yaml").read_bytes())
    with pytest.raises(rg.ModelError, match=rf"{name}: .*call it robot\.yaml"):
        rg.load(folder / given)
    with pytest.raises(rg.ModelError, match=rf"{name}: give the folder that it is in"):
        rg.load(folder / name)


@pytest.mark.parametrize("made", [Path.mkdir, os.mkfifo])
@pytest.mark.parametrize("given", [".", "robot.urdf"])
def test_a_yaml_that_is_no_file_is_refused(made: object, given: str, folder: Path) -> None:
    made(folder / "robot.yaml")  # type: ignore[operator]
    with pytest.raises(rg.ModelError, match=r"robot\.yaml: cannot be read: it is a folder or a device"):
        rg.load(folder / given)


def test_other_yaml_files_beside_a_robot_are_told(folder: Path) -> None:
    (folder / "controllers.yaml").write_text("a: 1\n", encoding="utf-8")
    with pytest.warns(rg.ModelWarning, match=r"files beside it \(controllers\.yaml\)"):
        assert rg.load(folder).m == 3
    with pytest.raises(rg.ModelError, match=r"controllers\.yaml"):
        rg.load(folder, strict=True)


def test_a_robot_yaml_by_its_own_path_is_its_folder(folder: Path) -> None:
    (folder / "robot.yaml").write_bytes((SHIPPED / "robot.yaml").read_bytes())
    mech, same = rg.load(folder / "robot.yaml"), rg.load(folder)
    assert (mech.name, mech.closures) == (same.name, same.closures)
    np.testing.assert_array_equal(mech.home, same.home)


@pytest.mark.parametrize("name", ["robot.urdf", "robot.xml", "robot.yaml", "run.npz"])
def test_missing_files_have_a_type_of_their_own(name: str, tmp_path: Path) -> None:
    """Also where Python's own is caught; it travels between processes."""
    read = rg.load_trajectory if name.endswith(".npz") else rg.load
    with pytest.raises(
        rg.MissingFileError, match=rf"{name}: cannot be read: there is no such file"
    ) as caught:
        read(tmp_path / name)
    assert isinstance(caught.value, rg.ModelError | rg.OptionError)
    assert isinstance(caught.value, FileNotFoundError)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


LINK = """<link name="{0}"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"""


def test_a_free_base_says_what_stays_on_the_ground() -> None:
    links = "".join(map(LINK.format, ("ball", "trunk", "arm")))
    urdf = f"""<robot name="r"><link name="world"/>{links}
    <joint name="f" type="floating"><parent link="world"/><child link="ball"/></joint>
    <joint name="w" type="fixed"><parent link="world"/><child link="trunk"/></joint>
    <joint name="j" type="continuous"><parent link="trunk"/><child link="arm"/></joint></robot>"""
    with pytest.warns(rg.ModelWarning, match=r"base='free' where other bodies float already \(trunk\)"):
        assert rg.Mechanism.from_urdf(urdf, base="free").m == 7
    mjcf = """<mujoco><option><flag contact="disable"/></option><worldbody>
    <body name="ball"><freejoint/><geom size="1"/></body>
    <body name="trunk"><body name="arm"><joint name="j"/><geom size="1"/></body></body>
    </worldbody></mujoco>"""
    with pytest.warns(rg.ModelWarning, match=r"base='free' where other bodies float already \(trunk\)"):
        assert rg.Mechanism.from_mjcf(mjcf, base="free").m == 7
    assert rg.Mechanism.from_mjcf(mjcf).m == 7  # nothing to say where nothing was asked


def test_large_files_are_refused_before_they_are_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the number of elements, and by the memory that their joints would take; comments do not count."""

    def parsed(*_: object) -> None:
        raise AssertionError("it was parsed")

    joint = f'<joint name="{"j" * 80}{{0}}" type="revolute"><parent link="l"/><child link="l{{0}}"/></joint>'
    many = "".join(joint.format(i) for i in range(100_000))
    monkeypatch.setattr(xml_text.expat, "ParserCreate", parsed)
    with pytest.raises(rg.ModelError, match="100000 velocities need a workspace"):
        rg.Mechanism.from_urdf(f"<robot>{many}</robot>")
    with pytest.raises(rg.ModelError, match="600,001 elements, more than 500,000"):
        rg.Mechanism.from_mjcf("<mujoco>" + "<geom/>" * 600_000 + "</mujoco>")
    monkeypatch.undo()
    text = (SHIPPED / "robot.urdf").read_text(encoding="utf-8")
    assert rg.Mechanism.from_urdf(text.replace("</robot>", f"<!--{many}--></robot>")).m == 3


def test_an_include_of_any_length_is_refused_by_type(tmp_path: Path) -> None:
    for name in ("a" * 5000 + ".xml", "b" * 300 + ".xml"):
        file = tmp_path / "m.xml"
        body = "<body><joint/><geom size='1'/></body>"
        file.write_text(f"<mujoco><worldbody>{body}</worldbody><include file='{name}'/></mujoco>")
        with pytest.raises(rg.ModelError, match="cannot be read") as caught:
            rg.Mechanism.from_mjcf(file)
        assert len(str(caught.value)) < 1000
