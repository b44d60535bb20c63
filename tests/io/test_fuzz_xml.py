"""URDF and MJCF files spoilt by the thousand: a sane mechanism or an error of ours, nothing else.

FUZZ_EXAMPLES=5000 pytest tests/io/test_fuzz_xml.py searches longer than CI does.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robust_gcp as rg
from robust_gcp.io.loader import models_folder

from ..campaigns.fuzz.spoil import spoiled_text, spoiled_xml

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
"""Limits of joints are not what these tests are about."""

FUZZ = settings.get_profile("fuzz")
Accepted = Callable[[Callable[[], object]], object]
Sane = Callable[[rg.Mechanism], None]

RANDOM = st.randoms(use_true_random=False)

URDFS = {
    name: (models_folder() / name / "robot.urdf").read_text(encoding="utf-8")
    for name in ("rhombus", "slider_crank", "five_bar", "bricard", "stewart")
}
CLOSURES: dict[str, list[Any]] = {name: list(rg.load(name).closures) for name in URDFS}
INDEPENDENT = {name: rg.load(name).independent for name in URDFS}
HOMES = {name: rg.load(name).home for name in URDFS}

ROD = '<inertial pos="0 0.5 0" mass="1" diaginertia="0.0833 0.001 0.0833"/>'
MJCF = f"""<mujoco model="m"><compiler angle="radian" eulerseq="xyz" autolimits="true"/>
<option gravity="0 0 -9.81" density="0"><flag gravity="enable"/></option>
<default><joint damping="0.1"/><default class="c"><geom type="capsule" size="0.05 0.3"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/><site name="w" pos="1 2 3" axisangle="1 1 0 0.7"/>
<body name="crank" euler="0 0 0"><joint name="q1" axis="1 0 0" stiffness="2" springref="0.3"/>{ROD}
 <body name="coupler" pos="0 1 0"><joint name="q2" axis="1 0 0"/>{ROD}<site name="c" pos="0 1 0"/>
  <geom type="box" size="0.1 0.2 0.3" density="10" pos="0 0.1 0" xyaxes="1 0 0 0 1 0"/></body></body>
<body name="rocker" pos="0 1 0"><joint name="q3" axis="1 0 0" armature="0.01"/>{ROD}
 <site name="r" pos="0 1 0"/><body name="bob" pos="0 0 -1" zaxis="0 0 1" childclass="c"><joint name="b"
 type="hinge"/><geom/><geom type="sphere" size="0.1" mass="1" quat="1 0 0 0"/></body></body>
</worldbody><equality><connect name="tip" body1="coupler" body2="rocker" anchor="0 1 0"/></equality>
<actuator><motor name="a" joint="q1"/></actuator>
<keyframe><key name="start" qpos="0.2 -0.2 0.2 0.4"/></keyframe></mujoco>"""


def check_urdf(name: str, text: str, accepted: Accepted, require_sane: Sane) -> None:
    made = accepted(
        lambda: rg.Mechanism.from_urdf(text, CLOSURES[name], INDEPENDENT[name], HOMES[name], "spoilt")
    )
    if isinstance(made, rg.Mechanism):
        require_sane(made)


def check_mjcf(text: str, accepted: Accepted, require_sane: Sane) -> None:
    made = accepted(lambda: rg.Mechanism.from_mjcf(text, ["q1", "b"], "start", "spoilt"))
    if isinstance(made, rg.Mechanism):
        require_sane(made)


@FUZZ
@given(name=st.sampled_from(sorted(URDFS)), rng=RANDOM)
def test_urdf_elements(name: str, rng: random.Random, accepted: Accepted, require_sane: Sane) -> None:
    text = spoiled_xml(URDFS[name], rng)
    check_urdf(name, text, accepted, require_sane)


@FUZZ
@given(name=st.sampled_from(sorted(URDFS)), rng=RANDOM)
def test_urdf_text(name: str, rng: random.Random, accepted: Accepted, require_sane: Sane) -> None:
    # without shapes, so that the changes meet what is read
    bare = re.sub(r"(?s)<visual.*?</visual>|<material.*?</material>", "", URDFS[name])
    check_urdf(name, spoiled_text(bare, rng), accepted, require_sane)


@FUZZ
@given(rng=RANDOM)
def test_mjcf_elements(rng: random.Random, accepted: Accepted, require_sane: Sane) -> None:
    check_mjcf(spoiled_xml(MJCF, rng), accepted, require_sane)


@FUZZ
@given(rng=RANDOM)
def test_mjcf_text(rng: random.Random, accepted: Accepted, require_sane: Sane) -> None:
    check_mjcf(spoiled_text(MJCF, rng), accepted, require_sane)


def test_what_is_spoilt_is_sound(accepted: Accepted, require_sane: Sane) -> None:
    """Untouched, every document gives a mechanism that moves, so that the properties are not empty."""
    made = [
        rg.Mechanism.from_urdf(text, CLOSURES[name], INDEPENDENT[name], HOMES[name])
        for name, text in URDFS.items()
    ]
    made.append(rg.Mechanism.from_mjcf(MJCF, ["q1", "b"], "start"))
    for mechanism in made:
        require_sane(mechanism)
        assert rg.simulate(mechanism, duration=1e-3, step=1e-3).t[-1] == 1e-3
