"""What tests of the compiled kernel need."""

from __future__ import annotations

import pytest

import robust_gcp as rg

KERNEL = rg.backends()["native"]

needs_kernel = pytest.mark.skipif(not KERNEL.available, reason=f"no compiled kernel: {KERNEL.reason}")
