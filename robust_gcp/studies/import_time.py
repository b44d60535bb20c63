"""How long `import robust_gcp` takes, and whose share it is."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

SHARES = ("robust_gcp", "pinocchio", "numpy", "scipy")
"""Packages told apart; `pinocchio` with the collision library `coal` that it loads."""


def import_milliseconds(rounds: int = 3) -> dict[str, float]:
    """Milliseconds of the import in a fresh interpreter by package, the least of some rounds.

    From `python -X importtime`, which itself slows imports down by a little: the shares travel, the
    sum is an upper bound.
    """
    found = [_shares(_run(["-X", "importtime", "-c", "import robust_gcp"]).stderr) for _ in range(rounds)]
    return min(found, key=lambda shares: sum(shares.values()))


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    here = str(Path(__file__).parents[2])
    script = [f"import sys; sys.path.insert(0, {here!r}); {words[-1]}"]
    return subprocess.run(
        [sys.executable, *words[:-1], *script], capture_output=True, text=True, check=True, timeout=300
    )


def _shares(report: str) -> dict[str, float]:
    total: Counter[str] = Counter()
    for line in report.splitlines():
        fields = line.removeprefix("import time:").split("|")
        if not line.startswith("import time:") or not fields[0].strip().isdigit():
            continue  # the heading
        package = fields[2].strip().split(".")[0]
        package = "pinocchio" if package == "coal" else package
        total[package if package in SHARES else "others"] += int(fields[0])
    return {name: total[name] / 1e3 for name in (*SHARES, "others")}
