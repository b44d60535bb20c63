"""The machine that figures are measured on, in words, and least times of calls on it."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path

from .. import __version__
from .contender import clock

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
PACKAGES = ("numpy", "scipy", "pin", "mujoco", "exudyn")


def machine() -> dict[str, str]:
    """CPU, cores, OS, versions, threads and commit, in words."""
    versions = []
    for package in PACKAGES:
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"no {package}")
    set_to = {os.environ.get(name, "not set") for name in THREADS}
    return {
        "cpu": _cpu(),
        "cores": str(os.cpu_count()),
        "os": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "packages": ", ".join(versions),
        "threads": set_to.pop() if len(set_to) == 1 else "as set: " + ", ".join(sorted(set_to)),
        "robust_gcp": __version__,
        "commit": _commit(),
    }


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown CPU"


def _commit() -> str:
    here = Path(__file__).parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return done.stdout.strip() or "unknown"


def footer(m: dict[str, str], begun: str = "") -> str:
    """Date and machine in one line."""
    return (
        f"{begun or date.today().isoformat()}; {m['cpu']}, {m['cores']} cores, {m['os']}, "
        f"Python {m['python']}, {m['packages']}, BLAS threads {m['threads']}; "
        f"robust_gcp {m['robust_gcp']}, commit {m['commit']}"
    )


# --------------------------------------------------------------------------- times on it


def seconds(call: Callable[[], object], now: Callable[[], float]) -> float:
    """Of one call, by this clock."""
    begun = now()
    call()
    return now() - begun


def least(call: Callable[[], object], rounds: int) -> float:
    """The least of some calls, s of the processor's time."""
    return min(seconds(call, clock) for _ in range(rounds))


def in_turn(works: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The least of what each returns, called in turn so that other work on the machine meets all alike."""
    found = [{name: work() for name, work in works.items()} for _ in range(rounds)]
    return {name: min(times[name] for times in found) for name in works}
