"""The list of all ways to derivatives, and which of them warn."""

from __future__ import annotations

from robust_gcp.reports.derivative_paths import CALLS, ways
from tests.compiled import needs_kernel

pytestmark = needs_kernel


def test_what_the_kernel_leaves_is_warned_of_and_nothing_else() -> None:
    found = ways(1)
    left = [way for way in found if way.warned]
    assert {way.what for way in left} == set(CALLS)
    assert {way.where for way in left} == {"beside singular, two coordinates"}
    assert {"singular, moving", "singular, at rest with mode=", "beside a dead point"} <= {
        way.where for way in found
    }
