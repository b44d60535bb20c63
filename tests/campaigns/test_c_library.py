"""A million steps of each scene in C and in Python: the same bits, through all crossings.

Not here: what is too stiff for the step or changes coordinates."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg

if not rg.backends()["native"].available:
    pytest.skip("no compiled kernel", allow_module_level=True)

from robust_gcp.export.description import described

from ..export.c_library import CMotion, Exported

ELSEWHERE = ("andrews", "flyball", "five_bar", "kite")
SCENES = [name for name in rg.model_names() if name not in ELSEWHERE]
AT_ONCE = 1000


@pytest.mark.campaign
@pytest.mark.parametrize("name", SCENES)
def test_a_million_steps(name: str) -> None:
    mech = rg.load(name)
    speed = np.full(mech.m, 0.5 if mech.m == 1 else 0.0)
    there = CMotion(Exported(described(mech)), 1 << 24).begin(mech.home, speed)
    here = rg.Simulation(mech, mech.home, mech.lift(mech.home, speed), keep="last")
    for _ in range(1_000_000 // AT_ONCE):
        there.step(1e-3, AT_ONCE)
        here.step(None, AT_ONCE)
        np.testing.assert_array_equal(there.q, here.q)
        np.testing.assert_array_equal(there.v, here.v)
        assert there.crossings == len(here.crossings)
