"""`torquescale` of welds in MJCF: zero holds a point, any other factor the whole frame, as MuJoCo has it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.linalg import subspace_angles

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf

BODIES = """<body name="a" pos="0 0 1"><freejoint name="free_a"/><geom size="0.1" pos="0 1 0"/>
  <body name="b" pos="0 1 0.2"><joint name="hinge" axis="0 1 0"/><joint name="slide" type="slide"/>
    <geom size="0.1" pos="0.3 0 0"/><site name="s" pos="0.1 0.2 0.3" euler="10 20 30"/></body></body>
<body name="c" pos="1 0.5 0"><freejoint name="free_c"/>
  <geom size="0.1" pos="0 0.2 0"/><site name="t" pos="0 0.3 0.1" euler="0 40 0"/></body>"""
ENDS = {
    "where it is": 'body1="b" body2="c" anchor="0.1 0.2 0.3"',
    "relpose": 'body1="b" body2="c" anchor="0.1 0.2 0.3" relpose="0.2 0.1 0 1 0.3 0 0"',
    "sites": 'site1="s" site2="t"',
}


def document(ends: str, scale: float | None) -> str:
    written = "" if scale is None else f'torquescale="{scale}"'
    return f"""<mujoco><option><flag contact="disable"/></option><worldbody>{BODIES}</worldbody>
    <equality><weld {ENDS[ends]} {written}/></equality></mujoco>"""


@pytest.mark.parametrize(("scale", "kind"), [(None, "6d"), (0, "3d"), (1e-3, "6d"), (0.3, "6d"), (7, "6d")])
@pytest.mark.parametrize("ends", ENDS)
def test_a_weld_holds_what_its_torquescale_leaves(scale: float | None, kind: str, ends: str) -> None:
    (closure,) = read_mjcf(document(ends, scale)).closures
    assert isinstance(closure, rg.PointClosure | rg.FrameClosure)
    assert closure.kind == kind


@pytest.mark.parametrize("scale", [0.0, 0.3])
@pytest.mark.parametrize("ends", ENDS)
def test_its_rows_are_those_of_mujoco(scale: float, ends: str) -> None:
    """Closed here is closed there, and K has the row space of MuJoCo's own constraint Jacobian."""
    mech = rg.Mechanism.from_mjcf(document(ends, scale))
    model = mujoco.MjModel.from_xml_string(document(ends, scale))
    data = mujoco.MjData(model)
    ours = np.zeros((mech.nv, model.nv))  # velocities in MuJoCo's order: a free joint's v is in world axes
    for j in range(model.njnt):
        joint = mech.joint(model.joint(j).name)
        numbers = mech.home[joint.idx_q : joint.idx_q + joint.nq]
        at, dof = model.jnt_qposadr[j], model.jnt_dofadr[j]
        place = np.eye(joint.nv)
        if joint.nv == 6:
            numbers = numbers[[0, 1, 2, 6, 3, 4, 5]]
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, numbers[3:])
            place[:3, :3] = turn.reshape(3, 3).T
        data.qpos[at : at + len(numbers)] = numbers
        ours[joint.v, dof : dof + joint.nv] = place
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-9
    J = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    else:
        J = data.efc_J.reshape(data.nefc, model.nv).copy()
    J = J[np.abs(J).max(axis=1) > 0.0]
    K = mech.K(mech.home) @ ours
    assert len(K) == len(J) == (3 if scale == 0.0 else 6)
    assert subspace_angles(K.T, J.T).max() < 1e-7
