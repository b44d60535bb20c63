"""Exudyn's packages, untyped: its stubs do not describe how its functions are called."""

from __future__ import annotations

import importlib
from typing import Any

exu: Any = importlib.import_module("exudyn")
items: Any = importlib.import_module("exudyn.itemInterface")
