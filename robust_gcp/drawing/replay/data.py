"""What a replay page is told: poses, sticks, crossings, and where to look from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...maps.explicit import Crossing
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...simulation.trajectories.trajectory import Trajectory
from ..skeleton import PARALLEL, placements, plane_normal, upward
from .frames import pictures
from .geometry import Sticks, face_on, layers, sticks
from .meshes import bare_bodies, mesh_data, packed, shapes_of

FLASH = 4 / 30
"""How long a contact is shown after its end, s of play: an impact has no duration."""

NAMED = 3
"""Independent coordinates that a crossing's label spells out; more are counted."""


def run_data(
    trajectory: Trajectory,
    label: str,
    speed: float,
    trails: Sequence[str] | None,
    visual: Any = None,
) -> tuple[dict[str, Any], Array]:
    """One motion as the page wants it, and its points' positions (n, points, 3), m.

    Parameters
    ----------
    trajectory : Trajectory
    label : str
    speed : float
        Simulated seconds for one second of play.
    trails : sequence of str or None
        Frames to follow; None: the first closure's.
    visual : pin.GeometryModel, path or True, optional
        Shapes of the bodies; see `shapes_of`.
    """
    mechanism = trajectory.mechanism
    visual = None if visual is None or visual is False else shapes_of(mechanism, visual)
    q = pictures(trajectory, speed)
    R, p = placements(mechanism, q)
    made = sticks(mechanism, R, p, trails)
    positions = made.positions(R, p)
    normal = plane_normal(mechanism)
    flat = visual is None and _one_plane(normal, positions[:, made.ends()], positions)
    meshes = [] if visual is None else mesh_data(mechanism, made, visual)
    bare = [] if visual is None else bare_bodies(made, visual)
    every = made.positions(R, p)  # once more: meshes have added points, which no size is taken from
    data = {
        "label": label,
        "start": float(trajectory.t[0]),
        "end": float(trajectory.t[-1]),
        "frames": len(q),
        "points": packed(every),
        "count": every.shape[1],
        "seen": positions.shape[1],
        "meshes": meshes,
        "bare": bare,
        "links": made.links,
        "slides": made.slides,
        "rails": made.rails,
        "faces": made.faces,
        "pins": made.pins,
        "trails": [{"name": name, "point": i} for name, i in made.trails.items()],
        "layers": layers(made, positions) if flat else None,
        "radius": link_radius(made, positions),
        "crossings": _crossings(mechanism, made, trajectory.crossings),
        "stops": _stops(trajectory, made, FLASH * speed),
    }
    return data, positions


def scene_data(mechanism: Mechanism, positions: Sequence[Array], view: Array | None) -> dict[str, Any]:
    """Where to look from, for all motions together; `view` (3,) points from the scene to the camera."""
    gravity = mechanism.own_model.gravity.linear
    some = np.concatenate([p.reshape(1, -1, 3) for p in positions], axis=1)
    found = face_on(plane_normal(mechanism), gravity, some)
    if view is not None:
        up = upward(gravity)
        if np.linalg.norm(np.cross(up, view)) < 1e-3 * np.linalg.norm(view):
            up = np.array(found["up"])  # seen from above, up is no direction in the picture
        found = {"view": (view / np.linalg.norm(view)).tolist(), "up": up.tolist()}
    return found


def _one_plane(normal: Array | None, ends: Array, positions: Array) -> bool:
    """Whether the bodies lie in one plane, so that a drawing has to tell them apart in depth."""
    if normal is None:
        return False
    return float(np.ptp(ends @ normal)) <= PARALLEL * float(np.ptp(positions, axis=(0, 1)).max())


def link_radius(made: Sticks, positions: Array) -> float:
    """Of a link, m: a share of the links' length, within shares of the scene's size."""
    start = positions[0]
    size = float(np.linalg.norm(np.ptp(positions, axis=(0, 1))))
    lengths = [float(np.linalg.norm(start[a] - start[b])) for a, b, _ in made.links]
    typical = float(np.median(lengths)) if lengths else 0.0
    return float(np.clip(0.05 * typical, 0.005 * size, 0.02 * size)) or 0.01 * _some_length(positions)


def _some_length(positions: Array) -> float:
    """Some length for a scene that has none, m."""
    return float(np.abs(positions).max(initial=0.0)) or 1.0


def _crossings(mechanism: Mechanism, made: Sticks, crossings: Sequence[Crossing]) -> list[dict[str, Any]]:
    if not crossings:
        return []
    R, p = placements(mechanism, np.array([c.q for c in crossings]))
    places = made.positions(R, p)[:, made.mark]
    return [
        {"time": c.time, "y": spelled(mechanism, c.y), "kind": c.kind, "place": at.tolist()}
        for c, at in zip(crossings, places, strict=True)
    ]


def _stops(trajectory: Trajectory, made: Sticks, flash: float) -> list[dict[str, Any]]:
    """Joints with stops: the point of each, and from when to when it is at one, s."""
    joints = trajectory.mechanism.joint_names
    found: dict[str, list[list[float]]] = {}
    t = trajectory.t.tolist()
    for k, name in enumerate(trajectory.part_names if trajectory.part_forces is not None else ()):
        kind, _, row = name.partition(".")  # of a sum of joints the first; names may have hyphens
        joint = max((j for j in joints if row == j or row.startswith(f"{j}-")), key=len, default="")
        if kind == "stop" and joint:
            assert trajectory.part_forces is not None
            pressed = np.concatenate([[False], trajectory.part_forces[:, k] != 0.0, [False]])
            ends = np.flatnonzero(np.diff(pressed.astype(int))).reshape(-1, 2).tolist()
            found.setdefault(joint, []).extend([t[first], t[last - 1] + flash] for first, last in ends)
    for happening in trajectory.happenings:
        for joint in happening.joints if happening.kind in ("impact", "grazing") else ():
            found.setdefault(joint, []).append([happening.time, happening.time + flash])
    points = {joints[seat.joint - 1]: seat.point for seat in made.seats}
    return [
        {"point": points[joint], "joint": joint, "times": _merged(times)}
        for joint, times in found.items()
        if times and joint in points
    ]


def _merged(times: list[list[float]]) -> list[list[float]]:
    """Intervals in order, those that overlap as one."""
    found: list[list[float]] = []
    for first, last in sorted(times):
        if found and first <= found[-1][1]:
            found[-1][1] = max(found[-1][1], last)
        else:
            found.append([first, last])
    return found


def spelled(mechanism: Mechanism, y: Array) -> str:
    """Independent coordinates with names and units, as `q1 = −3.1416 rad`."""
    names = mechanism.independent
    if len(y) != len(names) or len(y) > NAMED:
        return f"y of {len(y)} coordinates"
    units = [mechanism.joint(name).components[0].unit for name in names]
    return ", ".join(
        f"{name} = {value + 0.0:.4f} {unit}".replace("-", "−")
        for name, value, unit in zip(names, np.round(y, 4), units, strict=True)
    )
