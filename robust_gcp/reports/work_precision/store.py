"""Points on disk: appended as they come, so that an interrupted run goes on where it was."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

from ... import OptionError
from ..machine import machine
from .measure import Point, point_of


class Store:
    """The points of a folder, made when missing.

    Raises
    ------
    OptionError
        When the folder holds points of other settings, another version or another machine, which do not
        compare; `fresh` forgets what is there.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], fresh: bool = False) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._path = folder, folder / "points.jsonl"
        begun = date.today().isoformat()
        self.header: dict[str, Any] = {"settings": settings, "machine": machine(), "begun": begun}
        self.points: dict[tuple[str, str, float], Point] = {}
        if fresh or not self._path.exists():
            self._path.write_text(json.dumps(self.header) + "\n", encoding="utf-8")
        else:
            self._read()

    def _read(self) -> None:
        first, *lines = self._path.read_text(encoding="utf-8").splitlines() or ["{}"]
        old = json.loads(first)
        for part in ("settings", "machine"):
            for name, value in self.header[part].items():
                there = old.get(part, {}).get(name)
                if there != json.loads(json.dumps(value)):
                    raise OptionError(
                        f"{self._path} holds points with {name} = {there!r}, now it is {value!r}: points of "
                        "different runs do not compare; give another --out, or start anew with --fresh"
                    )
        self.header["begun"] = old["begun"]
        complete = [first]
        for line in lines:
            try:
                point = point_of(json.loads(line))
            except (json.JSONDecodeError, TypeError):  # cut off while being written
                break
            complete.append(line)
            self.points[point.key] = point
        self._path.write_text("\n".join(complete) + "\n", encoding="utf-8")

    def known(self, scene: str, contender: str) -> dict[float, Point]:
        """Finished points by setting."""
        return {p.setting: p for p in self.points.values() if (p.scene, p.contender) == (scene, contender)}

    def add(self, point: Point) -> None:
        """Keep a point, on disk at once."""
        if point.key in self.points:
            return
        self.points[point.key] = point
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(point.record()) + "\n")
