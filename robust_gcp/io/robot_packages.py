"""Robots that other packages bring, by name: nothing is fetched, they are taken where they are."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
from pathlib import Path
from typing import Any

from ..checks import hint, shown
from ..errors import ModelError

PACKAGES = ("robot_descriptions", "example_robot_data")


def named_path(given: Any) -> Any:
    """The file that "package:robot" stands for; what is no such name comes back as it is.

    Raises
    ------
    ModelError
        Where the package is not installed, has no such robot, or would have to fetch it.
    """
    package, colon, robot = given.partition(":") if isinstance(given, str) else ("", "", "")
    if not colon or package not in PACKAGES:
        return given
    try:
        importlib.import_module(package)
    except ImportError as error:
        raise ModelError(f"{shown(given)}: {package} is not installed; pip install {package}") from error
    return (_described if package == PACKAGES[0] else _example)(given, robot)


def _described(given: str, robot: str) -> Path:
    """A robot of robot_descriptions whose repository is in its cache already."""
    descriptions = importlib.import_module("robot_descriptions._descriptions").DESCRIPTIONS
    if robot not in descriptions:
        raise ModelError(f"{shown(given)}: there is no such description{hint(robot, descriptions)}")
    # its source is read, not run: to import it fetches what is not there
    spec = importlib.util.find_spec(f"robot_descriptions.{robot}")
    source = "" if spec is None or spec.origin is None else Path(spec.origin).read_text(encoding="utf-8")
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    cloned = [ast.literal_eval(c.args[0]) for c in calls if getattr(c.func, "id", "") == "_clone_to_cache"]
    repositories = importlib.import_module("robot_descriptions._repositories").REPOSITORIES
    cache = Path(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")).expanduser()
    for repository in cloned:
        folder = cache / repositories[repository].cache_path
        if not folder.is_dir():
            raise ModelError(
                f"{shown(given)}: {folder} is not there, and nothing is fetched; get it once by: "
                f"python -c 'import robot_descriptions.{robot}'"
            )
    before = os.environ.get("GIT_ALLOW_PROTOCOL")
    os.environ["GIT_ALLOW_PROTOCOL"] = "file"  # git reaches for nothing that is not on this machine
    try:
        module = importlib.import_module(f"robot_descriptions.{robot}")
    except Exception as error:
        raise ModelError(f"{shown(given)}: its package cannot tell where it is ({error})") from error
    finally:
        if before is None:
            del os.environ["GIT_ALLOW_PROTOCOL"]
        else:
            os.environ["GIT_ALLOW_PROTOCOL"] = before
    for key in ("MJCF_PATH", "URDF_PATH", "USD_PATH"):
        if hasattr(module, key):
            return Path(getattr(module, key))
    raise ModelError(f"{shown(given)}: it is neither MJCF nor URDF; run xacro on it and load its output")


def _example(given: str, robot: str) -> Path:
    """A robot of example_robot_data."""
    loaders = importlib.import_module("example_robot_data.robots_loader")
    if robot not in loaders.ROBOTS:
        raise ModelError(f"{shown(given)}: there is no such robot{hint(robot, loaders.ROBOTS)}")
    one = loaders.ROBOTS[robot]
    part = Path(one.path, one.urdf_subpath, one.urdf_filename or one.sdf_filename)
    return Path(loaders.getModelPath(str(part))) / part
