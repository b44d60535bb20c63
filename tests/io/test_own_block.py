"""The block `robust_gcp` of a model folder: forces, gravity and axes, and what it may not say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import robust_gcp as rg
from robust_gcp.io.loader import models_folder


def folder_with(tmp_path: Path, **own: object) -> Path:
    """The crank-rocker with more in its own block."""
    source = models_folder() / "crank_rocker"
    (tmp_path / "robot.urdf").write_text((source / "robot.urdf").read_text(encoding="utf-8"))
    settings = yaml.safe_load((source / "robot.yaml").read_text(encoding="utf-8"))
    settings["robust_gcp"] |= own
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(settings))
    return tmp_path


def test_forces_from_a_model_folder(tmp_path: Path) -> None:
    mech = rg.load(
        folder_with(
            tmp_path,
            springs=[{"joint": "q2", "stiffness": 3, "rest": 0.4}],
            dampers=[{"joint": "q3", "damping": 0.8}],
            point_springs=[
                {"frames": ["coupler_tip", "universe"], "stiffness": 5, "rest_length": 1, "damping": 0.6}
            ],
            torques={"q1": 2},
            gravity=[0, 1, -2],
        )
    )
    assert mech.forces == (
        rg.JointSpring("q2", 3.0, 0.4),
        rg.JointDamper("q3", 0.8),
        rg.PointSpring("coupler_tip", "universe", 5.0, 1.0, 0.6),
        rg.JointTorque("q1", 2.0),
    )
    np.testing.assert_array_equal(mech.model.gravity.linear, [0.0, 1.0, -2.0])


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"spring": []}, r"unknown key 'spring' in robust_gcp; did you mean 'springs'"),
        ({"springs": {"q1": 3}}, r"springs must be a list of mappings with joint, stiffness"),
        ({"springs": [{"joint": "q1"}]}, r"springs\[0\] lacks stiffness"),
        (
            {"springs": [{"joint": "q1", "stiffnes": 1}]},
            r"unknown key 'stiffnes' in robust_gcp.springs\[0\]; did you mean 'stiffness'",
        ),
        ({"springs": [{"joint": "q1", "stiffness": -1}]}, r"springs\[0\]: .* stiffness is -1; give zero"),
        ({"springs": [{"joint": "q9", "stiffness": 1}]}, r"robot.yaml: JointSpring: .* no joint 'q9'"),
        ({"dampers": [{"joint": "q1", "damping": "much"}]}, r"dampers\[0\]: .* 'much'; give a number"),
        (
            {"point_springs": [{"frames": ["coupler_tip"], "stiffness": 1}]},
            r"point_springs\[0\]: frames must",
        ),
        ({"torques": [2.0]}, r"torques must map joint names"),
        ({"torques": {"q1": float("nan")}}, r"torques: .* torque is nan; give a finite"),
        ({"gravity": [0, 0]}, r"gravity is \[0, 0\]; give three finite numbers"),
        ({"gravity": [0, 0, float("inf")]}, r"gravity .* give three finite numbers"),
        ({"axes": [[1, 0, 0]]}, r"axes\[0\]: loop 0 is of type '3d', which has no axis; write null"),
        ({"axes": []}, r"axes must list an axis or null for each of 1 loops"),
    ],
)
def test_what_a_model_folder_may_not_say(tmp_path: Path, own: dict[str, object], message: str) -> None:
    """Each error names the file, the key and the remedy."""
    with pytest.raises(rg.ModelError, match=message) as caught:
        rg.load(folder_with(tmp_path, **own))
    assert "robot.yaml" in str(caught.value)


def test_axes_of_hinges_and_their_faults(tmp_path: Path) -> None:
    """Bricard's cut hinge turns about x; the axis is a direction, with three numbers."""
    source = models_folder() / "bricard"
    assert rg.load("bricard").closures == (
        rg.RevoluteClosure("rod5_tip", "ground_tip", axis=(1.0, 0.0, 0.0)),
    )
    for axis, message in (([0, 0, 0], "axes.0. is zero; give a direction"), ([1, 0], "three finite")):
        (tmp_path / "robot.urdf").write_text((source / "robot.urdf").read_text(encoding="utf-8"))
        settings = yaml.safe_load((source / "robot.yaml").read_text(encoding="utf-8"))
        settings["robust_gcp"]["axes"] = [axis]
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(settings))
        with pytest.raises(rg.ModelError, match=message):
            rg.load(tmp_path)
