"""`robust-gcp reports fuzz`: spoilt model files, each read in a process that may hang or die."""

from __future__ import annotations

import argparse
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ...arguments import DEFAULT, Arguments, folder, whole
from ...errors import OptionError
from ...printing import progress_bar, table, write
from .trial import GOOD, SLOWEST, Document, JudgeProcess, Outcome, case, documents

Told = Callable[[float], object] | None


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.add("--count", whole(1), type=int, default=1000, metavar="N", help=f"how many; {DEFAULT}")
    add_to.add("--seed", whole(0), type=int, default=0, metavar="N", help=f"of the drawing; {DEFAULT}")
    text = "spoil every *.urdf, *.xml and robot.yaml below it too, besides the shipped models"
    add_to.add("--folder", type=Path, metavar="FOLDER", help=text)
    add_to.add("--only", whole(0), type=int, metavar="INDEX", help="do this case alone")
    add_to.add("--jobs", whole(1, 256), type=int, default=1, metavar="N", help=f"processes; {DEFAULT}")
    text = "write the files that are read wrongly to this folder"
    add_to.add("--out", folder, type=Path, metavar="FOLDER", help=text)


def run(args: argparse.Namespace) -> int:
    """Print what became of the files; exit code 1 when one was read wrongly."""
    if args.folder is not None and not args.folder.is_dir():
        raise OptionError(f"--folder {args.folder}: there is no such folder")
    known = documents(args.folder)
    indices = range(args.count) if args.only is None else [args.only]
    begun = time.perf_counter()
    with progress_bar(float(len(indices)), "files") as told:
        outcomes = dict(judged(known, args.seed, list(indices), args.jobs, told))
    spent = time.perf_counter() - begun
    print(f"{len(outcomes)} spoilt files of {len(known)} sound ones, seed {args.seed}, in {spent:.0f} s")
    counts = Counter(outcome.verdict for outcome in outcomes.values())
    print(table(("verdict", " files"), [(v, str(n)) for v, n in counts.most_common()]))
    slowest = max(outcomes, key=lambda i: outcomes[i].seconds)
    print(
        f"slowest: case {slowest}, {outcomes[slowest].seconds:.2f} s of processor time (at most {SLOWEST:g})"
    )
    bad = {i: outcome for i, outcome in sorted(outcomes.items()) if outcome.verdict not in GOOD}
    for i, outcome in bad.items():
        document, text = case(known, args.seed, i)
        print(f"case {i} ({document.label}): {outcome.verdict}\n{outcome.words}")
        if args.out is not None:
            for name, content in {**document.beside, document.file: text}.items():
                write(args.out / str(i) / name, content.encode("utf-8", "replace").decode())
    return 1 if bad else 0


def judged(
    known: list[Document], seed: int, indices: list[int], jobs: int = 1, told: Told = None
) -> Iterator[tuple[int, Outcome]]:
    """Cases and their outcomes, in the order of `indices`; `told` sees the fraction that is done."""
    mine = threading.local()
    testers: list[JudgeProcess] = []

    def judge(index: int) -> Outcome:
        if not hasattr(mine, "tester"):
            mine.tester = JudgeProcess()
            testers.append(mine.tester)
        outcome: Outcome = mine.tester.judge(*case(known, seed, index))
        return outcome

    with ThreadPoolExecutor(jobs) as pool:
        try:
            for done, (index, outcome) in enumerate(zip(indices, pool.map(judge, indices), strict=True), 1):
                if told is not None:
                    told(done / len(indices))
                yield index, outcome
        finally:
            pool.shutdown(cancel_futures=True)
            for tester in testers:
                tester.close()
