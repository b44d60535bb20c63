"""Which file of a robot is read, and by what."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import ModelError, OptionError
from ..mechanism.contents import FileContents
from .mjcf.reader import read_mjcf
from .sdf.reader import read_sdf
from .text_file import files_in, is_file, is_link
from .urdf.loops import open_ends
from .urdf.reader import read_urdf
from .usd.reader import read_usd
from .xml_text import parsed_xml

UNREAD = {
    ".xacro": "xacro is not expanded; run xacro on the file and load its output",
    ".mjb": "compiled models cannot be read; load the MJCF that it was made from",
    ".osim": "OpenSim's models cannot be read; write the mechanism as URDF or MJCF",
}
"""Other formats of robots' files, and what helps."""


Reader = Callable[[Path, "str | None", "str | Path | None"], FileContents]
"""What a format is: from a file, what its robot stands on (`base`), and a folder besides its own (`root`), a
spanning tree and what belongs to it."""


def is_mjcf(path: Path) -> bool:
    """By its suffix; of *.xml by its root element, which some files have of a URDF."""
    if path.suffix == ".xml":
        root, _ = parsed_xml(path, "MJCF")
        return root.tag != "robot"
    return path.suffix == ".mjcf"


def _urdf(path: Path, base: str | None, root: str | Path | None) -> FileContents:
    """A URDF without a robot.yaml; one that only such a file could close is refused."""
    del root  # it opens no other files
    contents = read_urdf(path, base)
    ends = open_ends(contents.model) if not contents.closures else []
    if ends:
        raise ModelError(
            f"{path}: {' and '.join(map(repr, ends[0]))} are named as the ends of a loop that was cut "
            f"({len(ends)} such pairs), and nothing closes it; list them under closed_loop in a robot.yaml "
            "beside it, or give closures to Mechanism.from_urdf"
        )
    return contents


READERS: dict[str, Reader] = {
    ".mjcf": read_mjcf,
    **dict.fromkeys((".urdf", ".xml"), _urdf),
    **dict.fromkeys((".sdf", ".world"), read_sdf),
    **dict.fromkeys((".usda", ".usdc", ".usd"), read_usd),
}
"""Of each suffix, *.xml where it is no MJCF; another format is one more entry."""


def read_robot(path: Path, base: str | None, root: Any, moving: Any, with_yaml: bool) -> FileContents:
    """What the reader of a file finds; the loops that a URDF leaves open are for its robot.yaml.

    Raises
    ------
    OptionError
        For `moving` in other formats than MJCF.
    """
    if is_mjcf(path):
        return read_mjcf(path, base, root, moving)
    if moving is not None:
        raise OptionError(f"{path}: moving= is for MJCF; write the joint into the file, and drive it")
    return read_urdf(path, base) if with_yaml else READERS[path.suffix](path, base, root)


def has_yaml(path: Path) -> bool:
    """Whether a robot.yaml beside a robot's file belongs to it.

    Raises
    ------
    ModelError
        Where one belongs to it that is not read; see `require_read`.
    """
    folder = path.parent
    if is_file(folder / "robot.yaml"):
        return robot_file(folder) == path.name
    robots = [file.name for file in files_in(folder) if file.suffix in READERS]
    if robots == [path.name] or path.stem == "robot":
        require_read(folder)
    return False


def require_read(folder: Path) -> None:
    """Refuse what was meant to be robot.yaml, in a folder without one: its loops would stay open.

    Raises
    ------
    ModelError
        For robot.yml, Robot.yaml and the like, and for a robot.yaml that is a folder or a device.
    """
    try:
        names = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    except OSError:
        return
    for name in names:
        if name == "robot.yaml" and not is_link(folder / name):
            raise ModelError(f"{folder / name}: cannot be read: it is a folder or a device; give a file")
        if name != "robot.yaml" and name.lower() in ("robot.yaml", "robot.yml"):
            raise ModelError(f"{folder / name}: is not read under this name; call it robot.yaml")


def others_beside(path: Path) -> list[str]:
    """YAML files beside a robot's file, which are not read."""
    return [file.name for file in files_in(path.parent) if file.suffix.lower() in (".yaml", ".yml")]


def robot_file(folder: Path) -> str:
    """The robot's file beside robot.yaml: of that name, or the only one."""
    for name in ("robot.urdf", "robot.xml"):
        if is_file(folder / name) or is_link(folder / name):
            return name
    names = sorted(f.name for f in files_in(folder) if f.suffix in READERS)
    if len(names) == 1:
        return names[0]
    for name in ("robot.urdf", "robot.xml"):
        if (folder / name).exists():  # a folder or a device: whoever reads it refuses it by name
            return name
    beside = f"stands beside {', '.join(names)}: call the one that is meant" if names else "needs"
    raise ModelError(f"{folder}: robot.yaml {beside} robot.urdf or robot.xml")
