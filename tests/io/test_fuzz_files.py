"""Files that mean harm: bombs, bottomless nesting, names of other files, and what never ends."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.io.loader import models_folder
from robust_gcp.io.text_file import read_text
from robust_gcp.io.yaml_text import parsed_yaml

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
"""Limits of joints are not what these tests are about."""

SECRET = "6ac1f0 the secret"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the rhombus, beside a file that it must not read."""
    (tmp_path / "secret.txt").write_text(SECRET, encoding="utf-8")
    shutil.copytree(models_folder() / "rhombus", tmp_path / "model")
    return tmp_path / "model"


def refused(folder: str | Path, *words: str) -> str:
    with pytest.raises(rg.ModelError) as caught:
        rg.load(folder)
    message = str(caught.value)
    assert SECRET not in message
    assert len(message) < 2000
    assert [word for word in words if word not in message] == []
    return message


def chain(count: int, kind: str = "revolute") -> str:
    """A URDF of as many joints one after the other."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    links = [
        f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
        for i in range(1, count + 1)
    ]
    return '<robot name="chain"><link name="l0"/>' + "".join(links) + "</robot>"


# --------------------------------------------------------------------------- YAML

NINE = {i: ", ".join([f"*a{i - 1}"] * 9) for i in range(1, 20)}
LAUGHS = "\n".join(["a0: &a0 [ha, ha]"] + [f"a{i}: &a{i} [{many}]" for i, many in NINE.items()])
MERGES = "\n".join(["a0: &a0 {x: 1}"] + [f"a{i}: &a{i} {{<<: [{many}]}}" for i, many in NINE.items()])

YAML = {
    "aliases of aliases": (LAUGHS, ("makes more than", "write less")),
    "merges of merges": (MERGES, ("makes more than",)),
    "an alias of itself": ("closed_loop: &a [*a]", ("contains itself", "line 1")),
    "a bottomless list": ("closed_loop: " + "[" * 900_000, ("nested more than 50",)),
    "a deep list": ("closed_loop: " + "[" * 60 + "]" * 60, ("nested more than 50",)),
    "a key twice": ("name_mot: [q1]\nname_mot: [q2]", ("'name_mot' is there twice", "line 2")),
    "a key of home twice": ("robust_gcp: {home: {q1: 0, q1: 1}}", ("'q1' is there twice",)),
    "an object of Python's": ("closed_loop: !!python/object/apply:os.getcwd []", ("could not determine",)),
    "a name of Python's": ("closed_loop: !!python/name:os.system", ("could not determine",)),
    "a number without end": ("robust_gcp: {home: {q1: " + "9" * 5000 + "}}", ("cannot be read as YAML",)),
    "no date": ("name_mot: 2001-99-99", ("name_mot must be a list", "'2001-99-99'")),
    "an integer of nothing": ("a: !!int ''", ("line 1", "'' is no value of kind 'int'")),
    "an integer of a sign": ("a: !!int '-'", ("'-' is no value of kind 'int'",)),
    "a number of nothing": ("a: !!float ''", ("'' is no value of kind 'float'",)),
    "a truth of another kind": ("a:\n  !!bool x", ("line 2", "'x' is no value of kind 'bool'")),
    "a null of another kind": ("a: !!null x", ("'x' is no value of kind 'null'",)),
    "a time": ("a: !!timestamp hello", ("timestamp", "remove it")),
    "bytes": ("a: !!binary x", ("binary", "remove it")),
    "an ordered mapping": ("a: !!omap [b: 1]", ("omap", "remove it")),
    "a list called integer": ("a: !!int [1]", ("tag:yaml.org,2002:int", "remove it")),
    "a key of nothing": ("!!int '': 1", ("'' is no value of kind 'int'",)),
    "a tag without end": ("a: !<" + "x" * 900_000 + "> 1", ("could not determine",)),
    "a merge of text": ("a: {<<: x}", ("<< takes a mapping",)),
    "a merge of numbers": ("a: {<<: [1]}", ("<< takes a mapping",)),
    "a list as a key": ("a: {[1]: 2}", ("cannot be a key",)),
    "half a character": ('a: "\\ud800"', ("half a character",)),
    "no character": ('a: "\\UFFFFFFFF"', ("cannot be read as YAML",)),
    "a deep block": ("\n".join(" " * i + "a:" for i in range(900)), ("line 51", "nested more than 50")),
    "deep questions": ("? " * 400_000, ("nested more than 50",)),
    "deep mappings": ("{a: " * 200_000, ("nested more than 50",)),
    "two documents": ("name_mot: [q1]\n---\nname_mot: [q1]", ("cannot be read as YAML",)),
    "a key that is no text": ("1: 2", ("the key 1 is not text",)),
    "a long name": ("closed_loop: " + "x" * 100_000, ("closed_loop", "list of pairs")),
    "too many bytes": ("# " + "x" * 1_000_000, ("more than 1,000,000",)),
}


@pytest.mark.parametrize("name", YAML)
def test_yaml_that_means_harm(folder: Path, name: str) -> None:
    """The file is named, in time and memory that do not grow with what it would make."""
    text, words = YAML[name]
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    refused(folder, str(path), *words)


def test_aliases_that_stay_small_are_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a, y: 2}\n", encoding="utf-8")
    assert parsed_yaml(path) == {"a": {"x": 1}, "b": [{"x": 1}, {"x": 1}], "c": {"x": 1, "y": 2}}
    path.write_text(f"a: [{'0, ' * 5000}]\n", encoding="utf-8")
    assert len(parsed_yaml(path)["a"]) == 5000


CORE = {
    "null": (None, "null", "Null", "NULL", "~", ""),
    "true": (True, "true", "True", "TRUE", "!!bool true"),
    "false": (False, "false", "False"),
    "integer": (12, "12", "+12", "0012", "0xC", "0o14", "!!int '12'"),
    "number": (-0.015, "-0.015", "-1.5e-2", "-15E-3", "-.015", "-1.5e-02", "!!float '-1.5e-2'"),
    "whole number": (12.0, "12.", "1.2e1", "12e0", "!!float 12"),
    "infinite": (float("inf"), ".inf", "+.Inf", "1e999"),
    **{
        t: (t, t)
        for t in ("yes", "off", "y", "1:30", "1_000", "2001-01-01", "0b1", "0x", "1e", "=", ".", "+")
    },
    "quoted": ("12", "'12'", '"12"', "!!str 12"),
}


@pytest.mark.parametrize("name", CORE)
def test_plain_values_are_those_of_the_core_schema(tmp_path: Path, name: str) -> None:
    """YAML 1.2, 10.3.2; what programs for YAML 1.1 take for dates, minutes or truths is text."""
    wanted, *texts = CORE[name]
    for text in texts:
        (tmp_path / "robot.yaml").write_text(f"a: {text}\n", encoding="utf-8")
        found = parsed_yaml(tmp_path / "robot.yaml")["a"]
        assert (type(found), found) == (type(wanted), wanted), text


def test_merges_yield_to_what_is_written(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {z: 3, <<: [*a, *b]}\n", encoding="utf-8")
    assert parsed_yaml(path)["c"] == {"x": 1, "y": 1, "z": 3}


LONG = {
    "sexagesimal": lambda n: "a: " + ":".join(["1"] * (n // 2)),
    "sexagesimal number": lambda n: "a: " + ":".join(["1"] * (n // 2)) + ".5",
    "digits": lambda n: "a: " + "9" * n,
    "hexadecimal": lambda n: "a: 0x" + "f" * n,
    "underscores": lambda n: "a: 1" + "_" * n,
    "decimals": lambda n: "a: 0." + "3" * n,
    "exponent": lambda n: "a: 1e" + "9" * n,
    "fraction of a second": lambda n: "a: 2001-01-01T00:00:00." + "9" * n,
    "anchor": lambda n: "a: &" + "x" * n + " 1",
    "lines of text": lambda n: "a: x" + "\n  x" * (n // 4),
    "folded": lambda n: "a: >\n" + "  x\n" * (n // 4),
    "escapes": lambda n: 'a: "' + "\\n" * (n // 2) + '"',
    "comments": lambda n: "#\n" * (n // 2) + "a: 1",
    "directives": lambda n: "%X y\n" * (n // 5) + "---\na: 1",
    "brackets": lambda n: "a: " + "[" * n,
    "braces": lambda n: "a: " + "{b: " * (n // 4),
    "list": lambda n: "a: [" + "x, " * (n // 3) + "]",
    "keys": lambda n: "\n".join(f"k{i}: 1" for i in range(n // 9)),
    "merges": lambda n: "a: {<<: [" + ", ".join(f"{{k{i}: 1}}" for i in range(n // 16)) + "]}",
}


@pytest.mark.parametrize("name", LONG)
def test_reading_takes_work_in_proportion(tmp_path: Path, name: str) -> None:
    """Eight times the text takes eight times as many calls, not 64."""
    path, calls = tmp_path / "robot.yaml", []

    def count(frame: object, event: str, argument: object) -> None:
        calls[-1] += event in ("call", "c_call")

    for n in (2_000, 16_000):
        path.write_text(LONG[name](n), encoding="utf-8")
        calls.append(0)
        sys.setprofile(count)
        try:
            with contextlib.suppress(rg.ModelError):
                parsed_yaml(path)
        finally:
            sys.setprofile(None)
    assert calls[1] < 10.0 * calls[0], calls


@pytest.mark.campaign
@pytest.mark.parametrize("name", LONG)
def test_reading_takes_time_in_proportion(tmp_path: Path, name: str) -> None:
    """Eight times the text takes eight times as long, not 64: 900 kB stay far below a minute of CPU."""
    path, spent = tmp_path / "robot.yaml", []
    for n in (900_000 // 8, 900_000):
        path.write_text(LONG[name](n), encoding="utf-8")
        begun = time.process_time()
        with contextlib.suppress(rg.ModelError):
            parsed_yaml(path)
        spent.append(time.process_time() - begun)
    assert spent[1] < 24.0 * max(spent[0], 0.05), spent


# --------------------------------------------------------------------------- XML

LAUGHING = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
XML = {
    "entities of entities": f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHING}]><robot name="&l11;"/>',
    "another file": '<!DOCTYPE r [<!ENTITY x SYSTEM "file://{secret}">]><robot><link name="&x;"/></robot>',
    "another file's document type": '<!DOCTYPE r SYSTEM "file://{secret}"><robot name="r"/>',
    "an address": '<!DOCTYPE r PUBLIC "x" "http://127.0.0.1:{port}/x.dtd"><robot name="r"/>',
    "an unknown entity": '<robot name="&x;"><link name="a"/></robot>',
    "bottomless elements": "<robot>" * 100_000,
    "deep elements": "<robot>" + "<link>" * 299 + "</link>" * 299 + "</robot>",
    "half a character": "<robot name='\ud800'/>",
    "a null character": "<robot name='\0'/>",
}


@pytest.mark.parametrize("reader", [rg.Mechanism.from_urdf, rg.Mechanism.from_mjcf])
@pytest.mark.parametrize("name", XML)
def test_xml_that_means_harm(folder: Path, name: str, reader: object) -> None:
    """No other file is read, no address asked, no stack or memory filled."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.0)
        text = XML[name].replace("{secret}", str(folder.parent / "secret.txt"))
        text = text.replace("{port}", str(server.getsockname()[1]))
        with pytest.raises(rg.ModelError) as caught:
            reader(text)  # type: ignore[operator]
        with pytest.raises(BlockingIOError):
            server.accept()
    assert SECRET not in str(caught.value)


def test_meshes_are_not_opened(folder: Path) -> None:
    """Shapes that name files leave the mechanism as it is, whether the files exist or not."""
    path = folder / "robot.urdf"
    text = path.read_text(encoding="utf-8")
    for place in ("package://nowhere/x.stl", f"file://{folder.parent}/secret.txt", "http://127.0.0.1/x.stl"):
        shape = f'<visual><geometry><mesh filename="{place}"/></geometry></visual>'
        collision = shape.replace("visual", "collision")
        path.write_text(text.replace("</link>", f"{shape}{collision}</link>"), encoding="utf-8")
        assert rg.load(folder).model == rg.load("rhombus").model


def test_mjcf_does_not_include_files(folder: Path) -> None:
    for inner in ("<include file='secret.txt'/>", "<worldbody><include file='secret.txt'/></worldbody>"):
        with pytest.raises(rg.ModelError, match=r"include.*cannot be read"):
            rg.Mechanism.from_mjcf(f"<mujoco>{inner}</mujoco>")


def test_long_chains_do_not_end_the_process() -> None:
    """Pinocchio's parsers call themselves once a joint: a chain of some thousand ends in a crash."""
    for kind in ("revolute", "fixed"):
        with pytest.raises(rg.ModelError, match="20000 joints lie between the root and link 'l20000'"):
            rg.Mechanism.from_urdf(chain(20_000, kind))
    assert rg.Mechanism.from_urdf(chain(60)).nv == 60
    bodies = "<body>" + "".join(f"<joint name='j{i}'/>" for i in range(5000)) + "</body>"
    with pytest.raises(rg.ModelError, match="more than 6 dofs in body"):
        rg.Mechanism.from_mjcf(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def test_names_that_end_pinocchios_process() -> None:
    """A joint called `universe` takes the ground's place in a pin.Model, and a body in its parser's."""
    for old in ('name="l1"', 'name="j1"'):
        with pytest.raises(rg.ModelError, match="'universe', which is the ground"):
            rg.Mechanism.from_urdf(chain(2).replace(old, 'name="universe"'))
    for kind, name in (("body", "universe"), ("joint", "universe"), ("body", "world")):
        text = (
            "<mujoco><worldbody><body name='b'><joint name='j'/><geom size='1'/></body></worldbody></mujoco>"
        )
        with pytest.raises(rg.ModelError, match=f"'{name}', which is the ground|repeated name 'world'"):
            rg.Mechanism.from_mjcf(text.replace(f"<{kind} name='{kind[0]}'", f"<{kind} name='{name}'"))


# --------------------------------------------------------------------------- places


@pytest.mark.parametrize("file", ["robot.yaml", "robot.urdf"])
def test_links_out_of_the_folder_are_not_followed(folder: Path, file: str) -> None:
    target = folder.parent / file
    (folder / file).rename(target)
    (folder / file).symlink_to(target)
    refused(folder, str(folder / file), str(target), "copy the file into the folder")
    (folder / file).unlink()
    (folder / file).symlink_to(file)  # a link to itself
    refused(folder, file)
    (folder / file).unlink()
    shutil.copy(target, folder / "real")
    (folder / file).symlink_to("real")  # within the folder
    assert rg.load(folder).nv == 3
    (folder.parent / "alias").symlink_to(folder)  # a folder may be a link itself
    assert rg.load(folder.parent / "alias").nv == 3


def test_names_in_a_file_are_no_paths(folder: Path) -> None:
    path = folder / "robot.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("coupler_tip", "../secret.txt"), encoding="utf-8")
    refused(folder, "no frame '../secret.txt'")


@pytest.mark.parametrize(
    "name", ["../models/rhombus", "rhombus/../kite", "./rhombus", "rhombus/", "a" * 900, "a" * 5000, "a\0b"]
)
def test_names_do_not_lead_out_of_the_shipped_models(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_what_never_ends_is_not_read(folder: Path) -> None:
    (folder / "robot.urdf").unlink()
    os.mkfifo(folder / "robot.urdf")
    refused(folder, "robot.urdf", "folder or a device")
    for reader in (rg.Mechanism.from_urdf, rg.Mechanism.from_mjcf):
        for path in (folder / "robot.urdf", Path("/dev/zero"), folder):
            with pytest.raises(rg.ModelError, match="cannot be read"):
                reader(path)


def test_large_files_are_not_read(folder: Path) -> None:
    with (folder / "robot.urdf").open("ab") as file:
        file.truncate(10**12)  # a hole: takes no room on the disk
    refused(folder, "robot.urdf", "1,000,000,000,000 bytes", "shorten")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
@pytest.mark.parametrize("file", ["robot.yaml", "robot.urdf"])
def test_other_encodings_are_told(folder: Path, file: str, encoding: str) -> None:
    (folder / file).write_text("name: rhombus à charnières", encoding=encoding)
    refused(folder, file, "save it as UTF-8")


def test_a_mark_of_byte_order_is_skipped(folder: Path) -> None:
    for file in ("robot.yaml", "robot.urdf"):
        text = (folder / file).read_text(encoding="utf-8")
        (folder / file).write_text(text, encoding="utf-8-sig")
    assert rg.load(folder).nv == 3


@pytest.mark.skipif(not Path("/proc/kallsyms").is_file(), reason="no files without a size here")
def test_files_without_a_size_are_not_read_without_end(tmp_path: Path) -> None:
    """What a kernel makes up says that it has 0 bytes."""
    with pytest.raises(rg.ModelError, match="more than 1,000;"):
        read_text(Path("/proc/kallsyms"), 1000)


def test_faults_in_a_thread_of_small_stack() -> None:
    """Documents as deep as they may be are read on the 512 kB stack of a thread, in a process of its own."""
    script = textwrap.dedent(
        """
        import threading, robust_gcp as rg
        from tests_chain import text
        threading.stack_size(512 * 1024)
        thread = threading.Thread(target=lambda: print(rg.Mechanism.from_urdf(text).nv))
        thread.start(); thread.join()
        """
    ).replace("from tests_chain import text", f"text = {chain(200)!r}")
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, capture_output=True, text=True, timeout=100, check=False)
    assert done.stdout.strip() == "200", done.stderr
