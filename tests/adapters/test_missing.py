"""Without the library that an adapter is named after, an error names the extra."""

from __future__ import annotations

import importlib
import sys

import pytest

import robust_gcp as rg


@pytest.mark.parametrize(
    ("library", "extra"),
    [("jax", "jax"), ("torch", "torch"), ("crocoddyl", "control"), ("gymnasium", "gymnasium")],
)
def test_the_extra_is_named(library: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.delitem(sys.modules, f"robust_gcp.adapters.{library}", raising=False)
    with pytest.raises(rg.MissingExtraError, match=rf"pip install {library},.*\[{extra}\]"):
        importlib.import_module(f"robust_gcp.adapters.{library}")
