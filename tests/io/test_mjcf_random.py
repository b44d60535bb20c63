"""MJCF written at random, in the many ways that the format allows, against what MuJoCo makes of it."""

from __future__ import annotations

import random
import re
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf
from robust_gcp.mechanism.contents import FileContents
from robust_gcp.mechanism.loops import ClosedLoops

Array = NDArray[np.float64]


class Writer:
    """One document."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.count = 0
        self.root = Element("mujoco")
        pick = self.rng.choice
        self.compiler = SubElement(self.root, "compiler", {"autolimits": pick(["true", "false"])})
        for key, values in {
            "angle": ["radian", "degree", None],
            "eulerseq": ["xyz", "zyx", "XYZ", "zXy", "ZyZ", "YXY", None],
            "inertiafromgeom": ["auto", "true", None],
            "inertiagrouprange": ["0 2", None],
            "balanceinertia": ["true", None],
        }.items():
            value = pick(values)
            if value is not None:
                self.compiler.set(key, value)
        self.defaults()
        self.world = SubElement(self.root, "worldbody")
        self.bodies: list[str] = []
        self.sites: list[str] = []
        self.hinges: list[str] = []
        for _ in range(pick([1, 2])):
            self.body(self.world, 0)
        self.equalities()

    # ----------------------------------------------------------------- numbers

    def numbers(self, n: int, size: float = 1.0) -> str:
        return " ".join(f"{self.rng.uniform(-size, size):.4g}" for _ in range(n))

    def sizes(self, n: int) -> str:
        return " ".join(f"{self.rng.uniform(0.05, 0.4):.4g}" for _ in range(n))

    def pose(self, element: Element) -> None:
        if self.rng.random() < 0.8:
            element.set("pos", self.numbers(3))
        kind = self.rng.choice(["quat", "axisangle", "euler", "xyaxes", "zaxis", None])
        sizes = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
        if kind is not None:
            element.set(kind, self.numbers(sizes[kind], 2.0))

    def name(self, kind: str) -> str:
        self.count += 1
        return f"{kind}{self.count}"

    # ----------------------------------------------------------------- parts

    def defaults(self) -> None:
        top = SubElement(self.root, "default")
        if self.rng.random() < 0.5:
            SubElement(top, "joint", {"armature": "0.01", "axis": self.numbers(3)})
        if self.rng.random() < 0.5:
            SubElement(top, "geom", {"density": "700"})
        first = SubElement(top, "default", {"class": "a"})
        SubElement(first, "joint", {"axis": self.numbers(3), "pos": self.numbers(3, 0.2)})
        SubElement(first, "geom", {"type": "capsule", "size": "0.05 0.2", "pos": self.numbers(3)})
        inner = SubElement(first, "default", {"class": "b"})
        SubElement(inner, "joint", {"ref": "0.3", "damping": "0.1"})
        SubElement(inner, "site", {"pos": self.numbers(3), "euler": self.numbers(3)})
        other = SubElement(top, "default", {"class": "c"})
        SubElement(other, "geom", {"type": "box", "size": "0.1 0.2 0.1", "mass": "0.7"})

    def classed(self, element: Element, key: str = "class", share: float = 0.3) -> Element:
        if self.rng.random() < share:
            element.set(key, self.rng.choice("abc"))
        return element

    def is_plain(self, parent: Element, element: Element) -> bool:
        """Whether nothing here may give a position by default, beside which `fromto` is refused."""
        parents = {child: above for above in self.root.iter() for child in above}
        while parent in parents:
            if element.get("class") or parent.get("childclass"):
                return False
            parent = parents[parent]
        return True

    def geom(self, parent: Element) -> None:
        geom = self.classed(SubElement(parent, "geom"))
        if geom.get("class") in ("a", "b", "c") or self.rng.random() < 0.7:
            kind = self.rng.choice(["sphere", "capsule", "cylinder", "box", "ellipsoid"])
            count = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}[kind]
            geom.set("type", kind)
            if kind != "sphere" and self.is_plain(parent, geom) and self.rng.random() < 0.5:
                geom.set("fromto", self.numbers(6))
                count -= 1
            else:
                self.pose(geom)
            geom.set("size", self.sizes(count))
        else:
            geom.set("type", "sphere")
            geom.set("size", self.sizes(1))
        if self.rng.random() < 0.3:
            geom.set("mass", f"{self.rng.uniform(0.1, 2.0):.4g}")
        elif self.rng.random() < 0.3:
            geom.set("density", "1234")
        if self.rng.random() < 0.2:
            geom.set("group", self.rng.choice("0123"))

    def inertial(self, parent: Element) -> None:
        made = SubElement(parent, "inertial", {"mass": f"{self.rng.uniform(0.5, 2.0):.4g}"})
        moments = [self.rng.uniform(0.2, 0.3) for _ in range(3)]
        if self.compiler.get("balanceinertia") and self.rng.random() < 0.3:
            moments[1] = 0.9
        if self.rng.random() < 0.5:
            self.pose(made)
            made.set("diaginertia", " ".join(f"{m:.4g}" for m in moments))
        else:
            made.set("fullinertia", " ".join(f"{m:.4g}" for m in moments) + " 0.01 -0.02 0.015")
        made.set("pos", self.numbers(3))

    def site(self, parent: Element, replicated: bool) -> None:
        site = self.classed(SubElement(parent, "site", {"name": self.name("s")}))
        if self.is_plain(parent, site) and self.rng.random() < 0.5:
            site.attrib |= {"fromto": self.numbers(6), "type": "capsule", "size": "0.01"}
        else:
            self.pose(site)
        if not replicated:
            self.sites.append(site.get("name", ""))

    def joint(self, parent: Element, kind: str, replicated: bool) -> None:
        joint = self.classed(SubElement(parent, "joint", {"name": self.name("j"), "type": kind}))
        if kind != "ball":
            joint.set("axis", self.numbers(3))
            if self.rng.random() < 0.3:
                joint.set("ref", self.numbers(1))
        if self.rng.random() < 0.5:
            joint.set("pos", self.numbers(3, 0.3))
        if self.rng.random() < 0.3:
            joint.set("armature", "0.05")
        if kind == "hinge" and not replicated:
            self.hinges.append(joint.get("name", ""))

    def body(self, parent: Element, depth: int, replicated: bool = False) -> None:
        wrapped = parent
        roll = self.rng.random()
        if roll < 0.25:
            wrapped = self.classed(SubElement(parent, "frame"), "childclass")
            self.pose(wrapped)
            if self.rng.random() < 0.3:
                wrapped = SubElement(wrapped, "frame", {"pos": self.numbers(3)})
        elif roll < 0.35 and depth > 0:
            wrapped = SubElement(parent, "replicate", {"count": self.rng.choice("23")})
            wrapped.attrib |= {"offset": self.numbers(3), "euler": self.numbers(3), "sep": "_"}
            replicated = True
        name = self.name("b")
        body = self.classed(SubElement(wrapped, "body", {"name": name}), "childclass")
        self.pose(body)
        floats = depth == 0 and self.rng.random() < 0.3
        if floats:
            SubElement(body, "freejoint", {"name": self.name("f")})
        inner = body
        if self.rng.random() < 0.2:
            inner = self.classed(SubElement(body, "frame"), "childclass")
            self.pose(inner)
        kinds = [["hinge"], ["slide"], ["ball"], ["hinge", "hinge"], ["slide", "hinge", "hinge"], []]
        jointed = [] if floats else self.rng.choice(kinds if depth else kinds[:-1])
        if jointed and not replicated:
            self.bodies.append(name)
        for kind in jointed:
            self.joint(inner, kind, replicated)
        if self.rng.random() < 0.4:
            self.inertial(body)
        SubElement(body, "geom", {"type": "sphere", "size": "0.1", "group": "0"})  # some mass in any case
        for _ in range(self.rng.randrange(2)):
            self.geom(inner)
        for _ in range(self.rng.randrange(2)):
            self.site(inner, replicated)
        if depth < 3:
            for _ in range(self.rng.choice([0, 1, 1, 2])):
                self.body(inner, depth + 1, replicated)

    def equalities(self) -> None:
        section = SubElement(self.root, "equality")
        if len(self.bodies) > 1:
            one, two = self.rng.sample(self.bodies, 2)
            SubElement(section, "connect", {"body1": one, "body2": two, "anchor": self.numbers(3)})
            SubElement(section, "weld", {"body1": one, "anchor": self.numbers(3), "active": "false"})
        if len(self.sites) > 1:
            one, two = self.rng.sample(self.sites, 2)
            kind = self.rng.choice(["connect", "weld"])
            SubElement(section, kind, {"site1": one, "site2": two})
        if len(self.hinges) > 1:
            one, two = self.rng.sample(self.hinges, 2)
            SubElement(section, "joint", {"joint1": one, "joint2": two, "polycoef": "0.1 0.5 -0.2 0 0"})

    def text(self) -> str:
        return ElementTree.tostring(self.root, encoding="unicode")


def compare(text: str) -> None:
    """Names, home, poses of bodies and sites, M, gravity and the equalities' Jacobians."""
    theirs, ours = mujoco.MjModel.from_xml_string(text), read_mjcf(text)
    model, rng = ours.model, np.random.default_rng(0)
    data, state = model.createData(), mujoco.MjData(theirs)
    theirs.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    assert list(model.names)[1:] == [theirs.joint(i).name for i in range(theirs.njnt)]
    home = np.zeros(theirs.nv)
    mujoco.mj_differentiatePos(theirs, home, 1.0, scalar_first(model, ours.home), theirs.qpos0)
    np.testing.assert_allclose(home, 0.0, atol=1e-12)
    for _ in range(2):
        q = pin.integrate(model, ours.home, rng.uniform(-1.0, 1.0, model.nv))
        pin.framesForwardKinematics(model, data, q)
        state.qpos[:] = scalar_first(model, q)
        mujoco.mj_forward(theirs, state)
        for kind, count, places in (
            (pin.FrameType.BODY, theirs.nbody, state.body),
            (pin.FrameType.OP_FRAME, theirs.nsite, state.site),
        ):
            for i in range(1 if kind == pin.FrameType.BODY else 0, count):
                pose = data.oMf[model.getFrameId(places(i).name, kind)]
                name = places(i).name
                np.testing.assert_allclose(pose.translation, places(i).xpos, atol=1e-11, err_msg=name)
                np.testing.assert_allclose(pose.rotation.ravel(), places(i).xmat, atol=1e-11, err_msg=name)
        turn = np.eye(model.nv)  # a free body's linear velocity is in world axes there
        for joint in list(model.joints)[1:]:
            if joint.nq == 7:
                at = slice(joint.idx_v, joint.idx_v + 3)
                turn[at, at] = data.oMi[joint.id].rotation
        M = np.zeros((model.nv, model.nv))
        for row, direction in zip(M, turn.T, strict=True):
            mujoco.mj_mulM(theirs, state, row, direction.copy())
        mine = pin.crba(model, model.createData(), q)
        size = np.abs(mine).max()
        np.testing.assert_allclose(M @ turn, np.triu(mine) + np.triu(mine, 1).T, atol=1e-9 * size)
        weight = pin.computeGeneralizedGravity(model, model.createData(), q)
        np.testing.assert_allclose(turn.T @ state.qfrc_bias, weight, atol=1e-9 * np.abs(weight).max())
        same_rows(ours, theirs, state, q, turn)


def same_rows(ours: FileContents, theirs: Any, state: Any, q: Array, turn: Array) -> None:
    """Each equality's residual (positions) and row space."""
    assert len(ours.closures) == int(state.eq_active.sum())
    if any(joint.nq == 7 for joint in ours.model.joints):
        return  # off the constraint a loop on a floating body sees its base there
    J = state.efc_J.reshape(-1, len(turn)) @ turn
    for index, closure in zip(np.flatnonzero(state.eq_active), ours.closures, strict=True):
        rows = np.flatnonzero((state.efc_type == 0) & (state.efc_id == index))
        K = ClosedLoops(ours.model, [closure]).K(q)
        kernel = np.linalg.svd(K)[2][np.linalg.matrix_rank(K, tol=1e-9) :]
        assert np.abs(J[rows] @ kernel.T).max(initial=0.0) < 1e-8 * max(1.0, np.abs(J[rows]).max())
        assert np.linalg.matrix_rank(J[rows], tol=1e-8) == np.linalg.matrix_rank(K, tol=1e-8)


def scalar_first(model: pin.Model, q: Array) -> Array:
    q = q.copy()
    for joint in list(model.joints)[1:]:
        if joint.nq in (4, 7):
            end = joint.idx_q + joint.nq
            q[end - 4 : end] = np.roll(q[end - 4 : end], 1)
    return q


@pytest.mark.parametrize("seed", range(60))
def test_documents_at_random(seed: int) -> None:
    try:
        compare(Writer(seed).text())
    except rg.ModelError as refusal:  # of equalities that no joint can satisfy
        assert re.search("there is no loop to close|apart in every configuration", str(refusal))


REPLICATED = """<mujoco><worldbody><replicate count="3" offset="0.5 0 0" euler="0 0 20" sep="_">
<body name="arm"><joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0 0 1"/><site name="tip"/>
<body name="hand" pos="0 0 1"><joint name="wrist" axis="0 1 0"/><geom size="0.1" pos="0 0 0.5"/></body></body>
</replicate></worldbody><equality><joint joint1="hinge" joint2="wrist"/>{}</equality></mujoco>"""


def test_what_refers_to_replicas_is_replicated() -> None:
    """Couplings within each replica; replicas may be named with their numbers."""
    more = '<connect body1="hand_0" body2="hand_2" anchor="0 0 1"/>'
    ours = read_mjcf(REPLICATED.format(more))
    point, *couplings = ours.closures
    assert [(c.joint1, c.joint2) for c in couplings] == [(f"hinge_{i}", f"wrist_{i}") for i in range(3)]
    assert isinstance(point, rg.PointClosure)
    compare(REPLICATED.format(""))
    with pytest.raises(rg.ModelError, match="refers to a replicated element and to another one"):
        read_mjcf(REPLICATED.format('<connect body1="hand" body2="hand_2" anchor="0 0 1"/>'))
