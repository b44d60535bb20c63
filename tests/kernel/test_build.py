"""The build of the compiled kernel: what it reports when it works, fails, or cannot be tried."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.kernel import build, structures

from ..compiled import needs_kernel


def _report(folder: Path) -> dict[str, str]:
    report: dict[str, str] = json.loads((folder / "build_report.json").read_text())
    return report


def test_no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither CXX nor the PATH names one: said, and not called a failure."""
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "1")
    monkeypatch.setenv("CXX", "/nowhere/c++")
    assert build.main(["--into", str(tmp_path)]) == 1
    assert _report(tmp_path) == {"status": "no compiler", "detail": "CXX=/nowhere/c++ is not there"}
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    assert build.attempt(tmp_path)["status"] == "no compiler"


def test_the_wheel_of_a_compiler_serves_where_there_is_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(build, "find_spec", lambda name: name)
    assert build.compiler()[:4] == [sys.executable, "-m", "ziglang", "c++"]
    assert "-mcpu=baseline" in build.compiler()  # as of others, not of this processor


def test_a_failed_build_is_reported_with_its_log(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A compiler that fails: the report has its first error, the log all of it, and it is printed."""
    broken = tmp_path / "c++"
    broken.write_text("#!/bin/sh\necho 'spatial.h:1: error: this compiler is broken' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "1")
    monkeypatch.setenv("CXX", str(broken))
    monkeypatch.setattr(build, "headers", lambda *wanted: [])
    assert build.main(["--into", str(tmp_path)]) == 1
    report = _report(tmp_path)
    assert report["status"] == "failed"
    assert "this compiler is broken" in report["detail"]
    assert "dense.cpp" in (tmp_path / report["log"]).read_text()
    said = capsys.readouterr().out
    assert "failed" in said
    assert "Python backend" in said


def test_a_compiler_that_leaves_nothing_failed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whatever its exit code says."""
    idle = tmp_path / "c++"
    idle.write_text("#!/bin/sh\nexit 0\n")
    idle.chmod(0o755)
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "1")
    monkeypatch.setenv("CXX", str(idle))
    monkeypatch.setattr(build, "headers", lambda *wanted: [])
    report = build.attempt(tmp_path)
    assert (report["status"], report["log"]) == ("failed", "build.log")
    assert "left no library" in report["detail"]


def test_what_was_compiled_is_kept_where_a_folder_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Taken again by the same sources and compiler alone."""
    compiler, calls = tmp_path / "c++", tmp_path / "calls"
    told = '[ "$*" = --version ] && {{ echo {}; exit; }}\n'
    work = f'echo x >> "{calls}"\nwhile [ "$1" != -o ]; do shift; done\necho made > "$2"\n'
    compiler.write_text("#!/bin/sh\n" + told.format("one") + work)
    compiler.chmod(0o755)
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "1")
    monkeypatch.setenv("CXX", str(compiler))
    monkeypatch.setenv("ROBUST_GCP_COMPILE", str(tmp_path / "kept"))
    monkeypatch.setattr(build, "headers", lambda *wanted: [])
    monkeypatch.setattr(build, "fingerprint", lambda folder: "these")  # an installed package has no sources
    reports = [build.attempt(tmp_path / name) for name in ("first", "second")]
    once = len(build.SOURCES) + 1
    assert len(calls.read_text().split()) == once
    assert reports[0]["sha256"] == reports[1]["sha256"]
    compiler.write_text("#!/bin/sh\n" + told.format("two") + work)
    build.attempt(tmp_path / "third")
    assert len(calls.read_text().split()) == 2 * once
    monkeypatch.setenv("ROBUST_GCP_COMPILE", "0")
    build.attempt(tmp_path / "fourth")
    assert len(calls.read_text().split()) == 3 * once


@needs_kernel
@pytest.mark.skipif(shutil.which("nm") is None or sys.platform == "darwin", reason="needs nm of binutils")
def test_the_library_shows_its_c_interface_and_no_path_of_its_builder() -> None:
    path = rg.backends()["native"].reason.removeprefix("compiled kernel ")
    done = subprocess.run(["nm", "-D", "--defined-only", path], capture_output=True, text=True, check=True)
    names = [line.split()[-1] for line in done.stdout.splitlines()]
    assert "rg_run" in names
    assert [name for name in names if not name.startswith(("rg_", "rgcp_", "fmi2", "fmi3"))] == []
    whole = Path(path).read_bytes()
    for folder in (build.HERE, Path(sys.prefix), Path.home()):
        assert os.fsencode(folder) + b"/" not in whole


def test_missing_headers_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wheel that carries what is missing."""
    monkeypatch.setattr("sys.path", [])
    monkeypatch.setattr("sys.prefix", "/nowhere")
    monkeypatch.setattr(Path, "is_file", lambda self: False)
    with pytest.raises(build.BuildError, match="pip install cmeel-eigen"):
        build.headers(build.EIGEN)


def test_skipped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """ROBUST_GCP_NATIVE=0 leaves the build out."""
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "0")
    assert build.attempt(tmp_path) == {"status": "skipped", "detail": "ROBUST_GCP_NATIVE=0"}


def test_the_interface_has_one_version() -> None:
    """abi.h and structures.py agree on the version and the reasons."""
    header = (Path(build.__file__).parent / "abi.h").read_text() if _in_checkout() else ""
    if not header:
        pytest.skip("the sources are not installed")
    assert f"VERSION = {structures.VERSION};" in header
    for reason in structures.Reason:
        assert f"{reason.name} = {reason.value}," in header


def _in_checkout() -> bool:
    return (Path(build.__file__).parent / "abi.h").exists()


@needs_kernel
def test_the_library_has_the_same_structures() -> None:
    """Sizes of the structures on both sides."""
    path = rg.backends()["native"].reason.removeprefix("compiled kernel ")
    found = ctypes.CDLL(path)
    shared = (structures.Description, structures.Cluster, structures.Bridging, structures.Request)
    for i, structure in enumerate(shared):
        assert found.rg_size(i) == ctypes.sizeof(structure)


@needs_kernel
def test_a_checkout_takes_the_kernel_that_was_installed_from_it(tmp_path: Path) -> None:
    """Of the same sources; of others it has none, and where its own build was skipped neither."""
    kernel = Path(rg.backends()["native"].reason.removeprefix("compiled kernel "))
    if not _in_checkout() or _report(kernel.parent).get("sources") != build.fingerprint(build.HERE):
        pytest.skip("the sources of the kernel are not here")
    checkout, site = tmp_path / "checkout", tmp_path / "site"
    left = shutil.ignore_patterns(kernel.name, "build_report.json", "__pycache__")
    native = shutil.copytree(build.HERE.parent, checkout / "robust_gcp", ignore=left) / "kernel"
    installed = site / "robust_gcp" / "kernel"
    installed.mkdir(parents=True)
    for file in (kernel, kernel.with_name("build_report.json")):
        shutil.copy(file, installed)

    def reason() -> str:
        told = "import robust_gcp as rg; print(rg.backends()['native'].reason)"
        paths = os.pathsep.join([str(checkout), str(site)])
        more = {"PYTHONPATH": paths, "ROBUST_GCP_NATIVE": ""}
        done = subprocess.run(
            [sys.executable, "-c", told], env=os.environ | more, cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert reason() == f"compiled kernel {installed / kernel.name}"
    source = native / "linalg" / "lu.h"
    before = source.read_text()
    source.write_text(before + "// changed\n")
    assert "not built in this checkout" in reason()
    source.write_text(before)
    (native / "build_report.json").write_text('{"status": "skipped", "detail": ""}')
    assert "skipped" in reason()


def test_sources_edited_while_they_were_compiled_are_not_vouched_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sources = tmp_path / "sources"
    sources.mkdir()
    (sources / "lu.h").write_text("// as compiled\n")
    monkeypatch.setattr(build, "HERE", sources)
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "1")

    def compiled(into: Path, log: list[str], sanitize: bool = False) -> Path:
        (into / "kernel.so").write_bytes(b"made")
        return into / "kernel.so"

    def edited(into: Path, log: list[str], sanitize: bool = False) -> Path:
        (sources / "lu.h").write_text("// edited since\n")
        return compiled(into, log)

    monkeypatch.setattr(build, "build", compiled)
    assert build.attempt(tmp_path)["sources"] == build.fingerprint(sources)
    monkeypatch.setattr(build, "build", edited)
    assert "sources" not in build.attempt(tmp_path)
