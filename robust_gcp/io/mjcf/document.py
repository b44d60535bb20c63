"""A MJCF document as MuJoCo's compiler gets it: no path in it leads anywhere.

MuJoCo follows every path that a file writes, and takes the memory that its numbers ask for. So the document
is walked before: includes are put in their places, other files are read here, within the folders that the
user allows, and what has no bearing on the motion goes.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

from ...checks import shown
from ...errors import ModelError, missing_file
from ...mechanism.sensing.sensors import KINDS
from ..text_file import LONGEST_PATH, is_file, is_link, read_bytes
from ..xml_text import parsed_xml, require_shallow

MOST_FILES = 100
"""Documents that one may include or attach."""

LARGEST = 6000
"""Bodies and joints once replicates are written out: MuJoCo's time grows with their square, 4 s here."""

LARGEST_SIZE = 200.0
"""Of `builtin` meshes, whose vertices grow with its square, and of buffers of actuators."""

LARGEST_FLEX = 200_000
"""Bytes of a file of a flexible body, which has a body at each vertex."""

DROPPED = ("contact", "visual", "statistic", "size", "custom", "skin", "texture", "layer")
"""Elements without a bearing on masses, joints and loops."""

TOLD = {"contact": "contact pairs", "sensor": "sensors", "extension": "extensions"}
"""Parts that are not simulated and that MuJoCo's model does not hold."""

ANSWERED = {("sensor", kind) for kind in KINDS}
"""Sensors that stay for MuJoCo's compiler, by their section and tag."""

LABELS = ("name", "joint", "tendon", "site", "body", "objname", "plugin")
ABSENT = "there is no such file"
FILLER = "0 0 0 {0} 0 0 0 {0} 0 0 0 {0}"


class Document:
    """A document with those that it includes and attaches.

    Parameters
    ----------
    root : Element
        Changed in place.
    folder : Path or None
        Where the file is, which paths in it start from; None for text.
    allowed : Path or None
        A folder besides, whose files may be read.

    Attributes
    ----------
    meshes : dict of Element to Path or str
        Where each mesh's file is, or why there is none to read.
    told : dict of str to list of str
        What is not simulated, a kind each, and where it is.

    Raises
    ------
    ModelError
        For a file that is needed and is absent, outside the folders, or named twice (MuJoCo refuses that
        too), and for more bodies than can be compiled.
    """

    def __init__(self, root: Element, name: str, folder: Path | None, allowed: Path | None) -> None:
        self.name = name
        self.meshes: dict[Element, Path | str] = {}
        self.told: dict[str, list[str]] = {}
        self._folder = folder
        self._places = [place.resolve() for place in (folder, allowed) if place is not None]
        self._from: dict[Element, Path] = {}  # folders of included files, by their elements
        self._seen: list[Path] = []
        self._roots: dict[str, Element] = {}
        self._files: dict[str, Path] = {}
        self._take(root, "")

    def absent(self) -> dict[str, str]:
        """Meshes that cannot be read, and why."""
        return {m.get("name", ""): why for m, why in self.meshes.items() if isinstance(why, str)}

    def written(self, filler: float, with_files: bool) -> tuple[str, dict[str, bytes], dict[str, bytes]]:
        """Text, further files and meshes.

        Parameters
        ----------
        filler : float
            Size of the tetrahedra that stand for meshes without files, m.
        with_files : bool
            Whether meshes are read whose files are there.
        """
        assets: dict[str, bytes] = {}
        for i, (mesh, path) in enumerate(self.meshes.items()):
            mesh.attrib.pop("vertex", None)
            if with_files and isinstance(path, Path):
                mesh.set("file", f"mesh{i}{path.suffix}")
                assets[mesh.attrib["file"]] = read_bytes(path)
            else:
                mesh.set("vertex", FILLER.format(filler))
        texts = {key: tostring(root, encoding="unicode") for key, root in self._roots.items()}
        main = texts.pop("")
        include = {key: text.encode() for key, text in texts.items()}
        return main, include | {k: read_bytes(path, LARGEST_FLEX) for k, path in self._files.items()}, assets

    def _take(self, root: Element, key: str) -> float:
        """Read a document in; how large it is, in bodies and joints."""
        if root.tag != "mujoco":
            raise self._error(f"the root element is <{root.tag}>, a MJCF file starts with <mujoco>")
        self._roots[key] = root
        self._expand(root)
        require_shallow(root, self.name)
        compiler: dict[str, str] = {}
        for element in root.iter("compiler"):
            compiler |= element.attrib
        meshes = Path(compiler.get("meshdir", compiler.get("assetdir", "")))
        attached = 0.0
        for element in root.iter():
            given = element.attrib.pop("file", None)
            if given is not None and element.tag not in DROPPED:
                given = Path(given).name if compiler.get("strippath") == "true" else given
                attached = max(attached, self._open(element, given, meshes))
        for element in list(root.iter()):
            self._bound(element)
            self._drop(element)
        size = _size(root, attached)
        if not size <= LARGEST:
            raise self._error(
                f"it is as large as {size:.3g} bodies and joints, more than {LARGEST}; write less"
            )
        return size

    def _expand(self, parent: Element) -> None:
        """Includes in their places."""
        position = 0
        while position < len(parent):
            child = parent[position]
            if child.tag == "include":
                path = self._needed(child, child.get("file", ""))
                if path.resolve() in self._seen:
                    raise self._error(
                        f"<include file={shown(child.get('file'))}> is there twice; write it out"
                    )
                included = self._parsed(path)
                self._from |= dict.fromkeys(included.iter(), path.parent)
                self._expand(included)
                parent[position : position + 1] = list(included)
                position += len(included)
            else:
                self._expand(child)
                position += 1

    def _parsed(self, path: Path) -> Element:
        self._seen.append(path.resolve())
        if len(self._seen) > MOST_FILES:
            raise self._error(f"it includes or attaches more than {MOST_FILES} files; write fewer")
        return parsed_xml(path, "MJCF")[0]

    def _open(self, element: Element, given: str, meshes: Path) -> float:
        """See to the file that an element names; how large is what comes with it."""
        if element.tag in ("mesh", "hfield"):
            element.attrib.setdefault("name", Path(given).stem)
            if element.tag == "mesh":
                element.attrib.pop("content_type", None)
                self.meshes[element] = self._found(element, meshes / given)
            return 0.0
        path = self._needed(element, given)
        key = f"{element.tag}{len(self._roots)}_{len(self._files)}{path.suffix}"
        element.set("file", key)
        if element.tag != "model":
            self._files[key] = path
            return 0.0
        outer, self._folder = self._folder, path.parent
        size = self._take(self._parsed(path), key)
        self._folder = outer
        return size

    def _drop(self, parent: Element) -> None:
        """Leave out what has no bearing on the motion."""
        for child in [c for c in parent if c.tag in DROPPED or c.tag in TOLD]:
            if child.tag in TOLD:
                apart = [e for e in child if e.tag != "exclude" and (child.tag, e.tag) not in ANSWERED]
                self.told.setdefault(TOLD[child.tag], []).extend(_label(e) for e in apart)
                for element in apart if child.tag == "sensor" else ():
                    child.remove(element)
            if child.tag in DROPPED:
                parent.remove(child)
        if parent.tag == "material":
            parent.attrib.pop("texture", None)
        elif parent.tag == "hfield":  # flat
            parent.attrib.pop("elevation", None)
            parent.attrib.update(nrow="2", ncol="2")

    def _bound(self, element: Element) -> None:
        """Refuse what ends or hangs MuJoCo: sizes that take all memory, formats for its messages, NaN."""
        for key, value in element.items():
            if "%" in value:
                raise self._error(f"<{element.tag}> {key}={shown(value)} has a per cent sign; leave it out")
            if any(math.isnan(_number(word)) for word in value.split()):
                raise self._error(f"<{element.tag}> {key}={shown(value)} has a number that is none (NaN)")
            if key == "anchor" and not value.strip():
                raise self._error(
                    f"<{element.tag}> {element.get('name', '')!r}: its anchor is empty; write three numbers"
                )
        for key in ("actdim", "nsample", *(("params",) if element.get("builtin") else ())):
            if not all(abs(_number(word)) <= LARGEST_SIZE for word in element.get(key, "").split()):
                raise self._error(
                    f"<{element.tag}> {element.get('name', '')!r} asks for {key}={shown(element.get(key))}, "
                    f"more than {LARGEST_SIZE:g}; write less"
                )

    def _needed(self, element: Element, given: str) -> Path:
        """The file that an element cannot do without."""
        found = self._found(element, Path(given)) if given else "it names no file"
        if isinstance(found, Path):
            return found
        if found == ABSENT and self._folder is not None and len(given) < LONGEST_PATH:
            raise missing_file(self._folder / given)
        raise self._error(f"<{element.tag} file={shown(given)}> cannot be read: {found}")

    def _found(self, element: Element, given: Path) -> Path | str:
        """The file where MuJoCo would find it, or why it is not read."""
        if self._folder is None:
            return "this is text; give the file's path"
        for folder in (self._folder, self._from.get(element, self._folder)):
            path = folder / str(given).replace("\\", "/")
            try:
                target = path.resolve()
            except (OSError, RuntimeError):  # a link to itself, a name too long for the system
                return ABSENT
            if is_file(path) or is_link(path):
                if any(target.is_relative_to(place) for place in self._places):
                    return path
                return f"it is outside the folder {self._folder}; name one that holds it by root="
        return ABSENT

    def _error(self, words: str) -> ModelError:
        return ModelError(f"{self.name}: {words}")


def _label(element: Element) -> str:
    return next((element.get(key, "") for key in LABELS if element.get(key)), element.tag)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:  # MuJoCo refuses it
        return 0.0


def _size(element: Element, attached: float) -> float:
    """Bodies and joints of an element, replicates written out; `attached` come with an <attach>."""
    own = 1.0 if element.tag in ("body", "joint", "freejoint") else 0.1
    own += sum(_size(child, attached) for child in element) + attached * (element.tag == "attach")
    if element.tag in ("replicate", "flexcomp", "composite"):
        own *= math.prod(max(1.0, abs(_number(word))) for word in element.get("count", "1").split())
    return own * (40.0 if element.tag in ("flexcomp", "composite") else 1.0)  # four at each vertex
