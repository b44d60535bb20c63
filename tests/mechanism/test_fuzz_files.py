"""Files that mean harm: bombs, bottomless nesting, names of other files, and what never ends."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.mechanism.folders.loader import models_folder
from robust_gcp.mechanism.folders.yaml_text import parsed_yaml

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
    "a bottomless list": ("closed_loop: " + "[" * 20_000, ("cannot be read as YAML",)),
    "a deep list": ("closed_loop: " + "[" * 60 + "]" * 60, ("nested more than 50",)),
    "a key twice": ("name_mot: [q1]\nname_mot: [q2]", ("'name_mot' is there twice", "line 2")),
    "a key of home twice": ("robust_gcp: {home: {q1: 0, q1: 1}}", ("'q1' is there twice",)),
    "an object of Python's": ("closed_loop: !!python/object/apply:os.getcwd []", ("could not determine",)),
    "a name of Python's": ("closed_loop: !!python/name:os.system", ("could not determine",)),
    "a number without end": ("robust_gcp: {home: {q1: " + "9" * 5000 + "}}", ("cannot be read as YAML",)),
    "no date": ("name_mot: 2001-99-99", ("cannot be read as YAML",)),
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
    with pytest.raises(rg.ModelError, match="deep"):
        rg.Mechanism.from_mjcf(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def test_names_that_end_pinocchios_process() -> None:
    """A joint called `universe` takes the ground's place in a pin.Model, and a body in its parser's."""
    for old in ('name="l1"', 'name="j1"'):
        with pytest.raises(rg.ModelError, match="'universe', which is the ground"):
            rg.Mechanism.from_urdf(chain(2).replace(old, 'name="universe"'))
    for kind, name in (("body", "universe"), ("joint", "universe"), ("body", "world")):
        text = "<mujoco><worldbody><body name='b'><joint name='j'/></body></worldbody></mujoco>"
        with pytest.raises(rg.ModelError, match=f"'{name}', which is the ground"):
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
