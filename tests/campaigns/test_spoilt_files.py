"""10,000 damaged files of the C library: refused in words, or a motion that stops."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import Block

SEED, COUNT = 11, 10000

CODE = """
import random, sys
sys.path.insert(0, sys.argv[1])
import robust_gcp as rg
from robust_gcp.export.description import described
from tests.export.c_library import CMotion, Exported, StoppedError
from tests.export.spoilt import spoilt

names = ("rhombus", "five_bar", "delta", "andrews", "bricard", "stewart")
files = [described(rg.load(name)) for name in names]
told = dict(refused=0, stopped=0, moved=0)
for k in map(int, sys.argv[3:]):
    rng = random.Random(f"{sys.argv[2]} {k}")
    whole = rng.choice(files)
    data = spoilt(whole, rng, k % 2 == 0)
    try:
        exported = Exported(data)
    except ValueError as error:
        assert len(str(error)) > 10
        told["refused"] += 1
        continue
    assert k % 2 == 0 or data == whole
    try:
        CMotion(exported).begin().step(1e-3, 3)
        told["moved"] += 1
    except StoppedError as stop:
        assert len(str(stop)) > 10
        told["stopped"] += 1
print(told)
"""


@pytest.mark.campaign
def test_no_file_crashes_or_hangs(block: Block) -> None:
    root = Path(__file__).parents[2]
    words = [sys.executable, "-c", CODE, str(root), str(block.seed), *map(str, block.indices)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
