"""Following a branch: no step is so long that another mode can be taken for it."""

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.cluster.cluster_map import ClusterMap
from robust_gcp.maps.cluster.options import BridgeOptions
from robust_gcp.maps.cluster.regular_ground import FARTHEST, same_branch
from robust_gcp.maps.explicit import Counters
from robust_gcp.maps.start import initial_point

LENGTHS = (4.0, 2.0, 3.0, 3.0)


def map_at(y: float, lengths=LENGTHS) -> ClusterMap:
    mechanism = four_bar(*lengths, y=y)
    start = initial_point(mechanism, mechanism.home, None, None, BridgeOptions(), Counters())
    return ClusterMap(start.path, start.point, BridgeOptions())


@pytest.mark.parametrize(("before", "after"), [(7.43178, 2.18453), (2.0, 5.9), (4.9, 0.5), (-4.0, 1.3)])
def test_a_long_step_over_a_crossing_keeps_the_mode(before, after):
    # both assemblies have a determinant of the same sign on the two sides: only the way between tells
    followed = map_at(before).point_at(np.array([after]), np.zeros(1)).q
    apart = FourBar(*LENGTHS).evaluate(after)[0] - FourBar(*LENGTHS).evaluate(before)[0]
    expected = four_bar(*LENGTHS, y=before).home + apart
    assert followed == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_reach_of_a_step_does_not_depend_on_units(scale):
    explicit = map_at(1.0, tuple(scale * length for length in LENGTHS))
    near, far = (explicit.path.step(explicit.anchor, np.array([y]), np.zeros(1)) for y in (1.3, 1.9))
    assert near is not None
    assert same_branch(explicit.anchor, near)
    assert far is not None
    assert far.turn > FARTHEST
    assert not same_branch(explicit.anchor, far)


def test_more_than_a_turn_at_once_is_refused():
    with pytest.raises(rg.BranchError, match="more than a turn"):
        map_at(2.5).point_at(np.array([12.5]), np.zeros(1))
