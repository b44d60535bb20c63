"""Builds the compiled kernel with the C++ compiler at hand; needs nothing but the standard library.

`python -m robust_gcp.kernel.build` does so in a checkout; at installation CMakeLists.txt runs this
file. Eigen is all that it needs, as headers, as the wheel cmeel-eigen carries them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = (
    ("cluster/clusters.cpp",),  # the longest first
    ("linalg/dense.cpp",),
    # together, as what their headers hold is compiled once then: in half the time of one by one
    ("public/public.cpp", "simulation/simulation.cpp", "derivatives/derivatives.cpp"),
    ("dynamics/dynamics.cpp",),
    ("public/fmu2.cpp",),
    ("public/fmu3.cpp",),
    ("linalg/memory.cpp",),
)
"""Each compiled as one file, which includes the others of its row."""
SWITCH = "ROBUST_GCP_NATIVE"
KEPT = "ROBUST_GCP_COMPILE"
"""Names a folder that keeps what was compiled, taken again where sources, Eigen and compiler are the same."""
COMPILERS = ("c++", "g++", "clang++")
FLAGS = (
    *("-std=c++17", "-O3", "-DNDEBUG", "-fno-math-errno", "-fno-tree-slp-vectorize"),
    *("-fPIC", "-fvisibility=hidden"),
)
"""No -march, so that the library runs on any processor of its kind; no -ffast-math: digits count. Vectors of
three numbers packed in pairs wait for the numbers to be stored first."""
SANITIZED = (
    *("-std=c++17", "-O1", "-g", "-fPIC", "-fno-omit-frame-pointer"),
    *("-fsanitize=address", "-fsanitize=undefined"),
)
EIGEN = ("Eigen/Core", "cmeel-eigen", "eigen3")
"""A header, the wheel that carries it, and the folder of headers that it lies in."""
EXPORTED = "{ global: rg_*; rgcp_*; fmi2*; fmi3*; local: *; };\n"
"""A version script: the C interface, and none of the C++ that its functions are made of."""


class BuildError(Exception):
    """The kernel cannot be built; `status` and the message go into the report."""

    def __init__(self, message: str, status: str = "failed") -> None:
        super().__init__(message)
        self.status = status


def fingerprint(folder: Path) -> str | None:
    """What tells the C++ sources in a folder, and how they are compiled, from others; None without any."""
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".h", ".cpp"))
    whole = hashlib.sha256(repr((FLAGS, SOURCES, EXPORTED)).encode())
    for path in files:
        whole.update(
            f"{path.relative_to(folder).as_posix()}\0".encode()
            + path.read_bytes().replace(b"\r\n", b"\n")
            + b"\0"
        )
    return whole.hexdigest() if files else None


def compiler() -> list[str]:
    """The command of CXX, else the first compiler on the PATH, else the one of the wheel ziglang."""
    named = shlex.split(os.environ.get("CXX", ""))
    for command in [named] if named else [[name] for name in COMPILERS]:
        if shutil.which(command[0]):
            return command
    if named:
        raise BuildError(f"CXX={' '.join(named)} is not there", "no compiler")
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "c++", "-mcpu=baseline"]  # as others, for any processor
    looked = f"none of {', '.join(COMPILERS)} on the PATH"
    raise BuildError(f"{looked}, and no wheel ziglang: pip install ziglang", "no compiler")


def headers(*wanted: tuple[str, str, str]) -> list[Path]:
    """Folders that these headers are included from, each given as `EIGEN` is."""
    roots = [Path(entry or ".") / "cmeel.prefix" / "include" for entry in sys.path]
    roots += [Path(sys.prefix) / "include", Path("/usr/local/include"), Path("/usr/include")]
    found = []
    for header, wheel, within in wanted:
        folder = next((root / within for root in roots if (root / within / header).is_file()), None)
        if folder is None:
            raise BuildError(f"the header {header} was not found; pip install {wheel}")
        if folder not in found:
            found.append(folder)
    return found


def build(into: Path, log: list[str], sanitize: bool = False) -> Path:
    """Compile and link; the commands and what they say are appended to `log`.

    Raises
    ------
    BuildError
    """
    command = [
        *compiler(),
        *(SANITIZED if sanitize else FLAGS),
        f"-I{HERE}",
        f"-I{HERE.parent / 'include'}",
        f"-ffile-prefix-map={HERE}=kernel",  # the same bytes wherever it is built
    ]
    for folder in headers(EIGEN):
        command += ["-isystem", str(folder), f"-ffile-prefix-map={folder}=eigen"]
    mac = sys.platform == "darwin"
    library = into / ("kernel.dylib" if mac else "kernel.so")
    before = None if sanitize else kept()
    if before is not None and before.is_file():
        log.append(f"taken from {before}")
        return install(before, library)
    with tempfile.TemporaryDirectory() as scratch:
        objects = [str(Path(scratch) / f"{Path(name).name}.o") for name, *_ in SOURCES]
        jobs = [
            [*command, *(part for name in more for part in ("-include", str(HERE / name)))]
            + ["-c", str(HERE / name), "-o", made]
            for (name, *more), made in zip(SOURCES, objects, strict=True)
        ]
        with ThreadPoolExecutor(min(len(jobs), os.cpu_count() or 1)) as pool:
            list(pool.map(lambda job: call(job, log), jobs))
        linked, script = Path(scratch) / library.name, Path(scratch) / "exported.map"
        script.write_text(EXPORTED, encoding="utf-8")
        names = "-Wl" + "".join(f",-exported_symbol,_{name}*" for name in ("rg_", "rgcp_", "fmi2", "fmi3"))
        export = names if mac else f"-Wl,--version-script={script}"
        strip = [] if mac or sanitize else ["-s"]
        call([*command, "-shared", export, *strip, *objects, "-o", str(linked)], log)
        if not linked.is_file():
            raise BuildError(f"{command[0]} said that all is well and left no library")
        if before is not None:
            install(linked, before)
        return install(linked, library)


def kept() -> Path | None:
    """Where the library of these sources is kept, if it is; None where no folder is named for that."""
    folder, sources = os.environ.get(KEPT, "0"), fingerprint(HERE)
    if folder in ("", "0") or sources is None:
        return None
    told = subprocess.run([*compiler(), "--version"], capture_output=True, text=True, check=False).stdout
    key = hashlib.sha256(f"{sources}{told}{sys.platform}".encode())
    for eigen in headers(EIGEN):
        key.update((eigen / "Eigen/src/Core/util/Macros.h").read_bytes())  # tells its version
    return Path(folder).expanduser() / f"kernel-{key.hexdigest()[:24]}"


def install(library: Path, into: Path) -> Path:
    """Put a library there: a new file, not new contents, as a process may have the old one loaded."""
    into.parent.mkdir(parents=True, exist_ok=True)
    staged = into.with_name(f".{into.name}.{os.getpid()}")
    shutil.copyfile(library, staged)
    staged.replace(into)
    return into


def call(command: list[str], log: list[str]) -> None:
    """Run a command, which is appended to `log` with what it says; raises BuildError where it fails."""
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    log += [f"$ {shlex.join(command)}", done.stdout + done.stderr]
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
        raise BuildError(f"{command[0]} failed: {errors[0][:300] if errors else done.returncode}")


def attempt(into: Path, sanitize: bool = False) -> dict[str, str]:
    """Build and write build_report.json (and build.log after a failure) beside the library."""
    log: list[str] = []
    into.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    try:
        if os.environ.get(SWITCH) == "0":
            raise BuildError(f"{SWITCH}=0", "skipped")
        sources = fingerprint(HERE)
        library = build(into, log, sanitize)
        report = {
            "status": "built",
            "detail": f"{library.name} in {time.monotonic() - begun:.0f} s",
            "sha256": hashlib.sha256(library.read_bytes()).hexdigest(),
        }
        if not sanitize and sources is not None and sources == fingerprint(HERE):  # not edited meanwhile
            report["sources"] = sources
    except BuildError as error:
        report = {"status": error.status, "detail": str(error)}
        if error.status == "failed":
            report["log"] = "build.log"
            (into / "build.log").write_text("\n".join(log), encoding="utf-8")
    (into / "build_report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    return report


def main(arguments: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="build the compiled kernel of robust_gcp")
    parser.add_argument(
        "--into", type=Path, default=HERE, help="folder for the library (default: the package)"
    )
    parser.add_argument("--sanitize", action="store_true", help="with address and undefined-behaviour checks")
    options = parser.parse_args(arguments)
    report = attempt(options.into.resolve(), options.sanitize)
    built = report["status"] == "built"
    print(f"robust_gcp: compiled kernel: {report['status']} ({report['detail']})")
    if not built:
        print("robust_gcp: simulations will run on the slower Python backend")
    if "log" in report:
        print((options.into / report["log"]).read_text(encoding="utf-8"))
    return 0 if built else 1


if __name__ == "__main__":
    sys.exit(main())
