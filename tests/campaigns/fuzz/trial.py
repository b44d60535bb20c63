"""One spoilt file: read, started, and judged, in a process that may hang or die."""

from __future__ import annotations

import multiprocessing
import random
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Literal

import numpy as np

from robust_gcp.errors import RobustGcpError
from robust_gcp.io.loader import load, model_names, models_folder
from robust_gcp.io.mjcf.writer import mjcf_text
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.simulation.simulate import simulate

from .spoil import spoiled

Verdict = Literal["moved", "accepted", "refused", "foreign", "not finite", "slow", "hung", "died"]
GOOD = ("moved", "accepted", "refused")

SLOWEST = 10.0
"""s of processor time that one file may take."""

HUNG = 6.0 * SLOWEST
"""s on the clock after which its process is ended: others may use the processor."""

STEP = 1e-3
HOME = "home"


@dataclass(frozen=True)
class Document:
    """A sound file to spoil, with what stands beside it."""

    label: str
    file: str  # what it is called in a model's folder
    text: str
    beside: dict[str, str]  # the folder's other file, by name; without one the file is read alone
    independent: tuple[str, ...] = ()  # of a shipped model that is read alone, from its key frame `HOME`


@dataclass(frozen=True)
class Outcome:
    """What became of a spoilt file: the verdict, in words what was wrong, and s of processor time."""

    verdict: Verdict
    words: str = ""
    seconds: float = 0.0


Judge = Callable[[Document, str], Outcome]


def shipped() -> list[Document]:
    """The shipped models as URDF, YAML and MJCF; a four-bar as SDF and USD, as often as these."""
    here = Path(__file__).parent
    found = [
        Document(file, f"robot{Path(file).suffix}", (here / file).read_text("utf-8"), {})
        for file in ("bar.sdf", "bar.usda") * 8
    ]
    for name in model_names():
        found += _of_folder(models_folder() / name)
        mechanism = load(name)
        text = mjcf_text(mechanism, {})
        found.append(Document(f"{name}, as MJCF", "robot.xml", text, {}, mechanism.independent))
    return found


def below(folder: Path) -> list[Document]:
    """Every *.urdf, *.xml and robot.yaml of a folder and of those in it."""
    found = []
    for path in sorted({*folder.rglob("*.urdf"), *folder.rglob("*.xml"), *folder.rglob("robot.yaml")}):
        if path.name == "robot.yaml":
            found += _of_folder(path.parent)
        elif not (path.parent / "robot.yaml").is_file():
            file = f"robot{path.suffix}"
            found.append(Document(str(path.relative_to(folder)), file, path.read_text("utf-8"), {}))
    return found


def _of_folder(folder: Path) -> list[Document]:
    """Each of the two files, beside the other."""
    texts = {
        name: (folder / name).read_text("utf-8")
        for name in ("robot.yaml", "robot.urdf", "robot.xml")
        if (folder / name).is_file()
    }
    return [
        Document(f"{folder.name}/{name}", name, text, {n: t for n, t in texts.items() if n != name})
        for name, text in texts.items()
    ]


def case(documents: list[Document], seed: int, index: int) -> tuple[Document, str]:
    """The document and the spoilt text of a case: the same for the same seed and index."""
    rng = random.Random(f"{seed} {index}")
    document = rng.choice(documents)
    return document, spoiled(document.text, document.file not in ("robot.yaml", "robot.usda"), rng)


def judge(document: Document, text: str) -> Outcome:
    """Read a spoilt file and take two steps, in this process."""
    begun, verdict, words = time.process_time(), "refused", ""
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for file, content in {**document.beside, document.file: text}.items():
            (Path(name) / file).write_bytes(content.encode("utf-8", "surrogatepass"))
        try:
            mechanism = _read(document, Path(name))
            verdict = "accepted"
            run = simulate(mechanism, duration=2.0 * STEP, step=STEP, record=("energy",))
            sane = all(np.isfinite(values).all() for values in (run.q, run.v, run.energy_error()))
            verdict = "moved" if sane else "not finite"
        except RobustGcpError as error:
            words = str(error)
        except BaseException as error:
            verdict, words = "foreign", "".join(traceback.format_exception(error))[-3000:]
    seconds = time.process_time() - begun
    if verdict in GOOD and seconds > SLOWEST:
        verdict = "slow"
    return Outcome(verdict, words, seconds)  # type: ignore[arg-type]


def _read(document: Document, folder: Path) -> Mechanism:
    if document.beside:
        return load(folder)
    if document.file == "robot.xml":
        home = HOME if document.independent else None
        return Mechanism.from_mjcf(folder / document.file, document.independent or "auto", home)
    return load(folder / document.file)


class JudgeProcess:
    """A process in which `by` judges one file after the other; replaced when it hangs or dies."""

    def __init__(self, by: Judge = judge, patience: float = HUNG) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._by, self._patience = by, patience
        self._start()

    def _start(self) -> None:
        self._here, there = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(there, self._by), daemon=True)
        self._process.start()
        there.close()
        if self._here.poll(10.0 * HUNG):  # imports take a while on a busy machine
            self._here.recv()

    def judge(self, document: Document, text: str) -> Outcome:
        """What `by` says; "hung" or "died" where the process did."""
        self._here.send((document, text))
        try:
            if self._here.poll(self._patience):
                outcome: Outcome = self._here.recv()
                return outcome
            outcome = Outcome("hung", f"no answer in {self._patience:g} s", self._patience)
        except (EOFError, OSError):
            self._process.join()
            outcome = Outcome("died", f"exit code {self._process.exitcode}")
        self.close()
        self._start()
        return outcome

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._here.close()


def _serve(connection: Connection, by: Judge) -> None:
    """Answer until the other end closes."""
    connection.send("ready")
    while True:
        try:
            document, text = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(by(document, text))
