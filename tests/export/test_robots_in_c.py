"""Published robots in C: the same bits as in Python.

The files are data beside the checkout (`../shared/robots`, or where ROBUST_GCP_ROBOTS says); without them
these tests are skipped.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.reports.robots import files_below

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
if not ROBOTS.is_dir():
    pytest.skip("the folder of robots' files is not here", allow_module_level=True)
if not rg.backends()["native"].available:
    pytest.skip("no compiled kernel", allow_module_level=True)

from robust_gcp.export.description import described  # noqa: E402

from .c_library import CMotion, Exported  # noqa: E402

pytestmark = pytest.mark.filterwarnings(
    "ignore::robust_gcp.ModelWarning", "ignore::robust_gcp.StabilityWarning"
)

NOT_LOADED = ("disney_robot", "kangaroo_like", "kangaroo_like_2legs", "four_bar.sdf")
"""As tests/io/test_robot_files.py says."""
ROBOT_FILES = {str(file.relative_to(ROBOTS)): file for file in files_below(ROBOTS)}
STEPS = 300


@pytest.mark.parametrize("name", [name for name in ROBOT_FILES if Path(name).name not in NOT_LOADED])
def test_the_same_bits(name: str) -> None:
    """In the coordinates that the run takes, as far as it keeps them."""
    mech = rg.load(ROBOT_FILES[name])
    u = np.random.default_rng(0).normal(size=mech.m) * 0.1
    begun = rg.Simulation(mech, mech.home, mech.lift(mech.home, u), step=1e-4, keep="last")
    q, v = begun.q, begun.v
    for _ in range(3):  # a run in other coordinates may have a better choice of its own
        changes = begun.step(None, 20).trajectory.stats.repartitions
        if not changes:
            break
        mech = mech.with_independent(changes[-1][1])
        begun = rg.Simulation(mech, q, v, step=1e-4, keep="last")
    here = rg.Simulation(mech, q, v, step=1e-4, keep="last")
    there = CMotion(Exported(described(mech))).begin(q, v[mech.iv_independent])
    for _ in range(STEPS // 20):
        here.step(None, 20)
        if here.trajectory.stats.repartitions:
            break
        np.testing.assert_array_equal(there.step(1e-4, 20).q, here.q)
    assert there.time >= 1.5e-2
