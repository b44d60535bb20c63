"""Starts where two modes of a loop in space cross: the motion is on the mode that was named."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg

from ..compiled import needs_kernel
from ..dynamics.gradient_problems import CROSSINGS, spatial


@pytest.mark.parametrize("backend", ["python", pytest.param("native", marks=needs_kernel)])
@pytest.mark.parametrize("seed", CROSSINGS)
def test_named_by_number_tangent_or_velocity(seed: int, backend: str) -> None:
    mechanism = spatial(seed, 4, True, slides=seed % 3 == 0)
    modes = rg.analyse(mechanism, mechanism.home).modes
    assert len(modes) == 2
    for number, mode in enumerate(modes):
        most = int(np.argmax(np.abs(mode)))
        mech = mechanism.with_independent([mechanism.joints[most].name])
        v = mode / mode[most]
        for named in (number, mode, None):
            run = rg.simulate(mech, mech.home, v, mode=named, duration=2e-3, step=1e-3, backend=backend)
            np.testing.assert_allclose(run.v[0], v, rtol=0, atol=1e-8)
            away = rg.analyse(mech, run.q[1]).modes[0]
            np.testing.assert_allclose(away / away[most], run.v[1] / run.v[1, most], rtol=0, atol=1e-8)
