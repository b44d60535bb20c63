"""What a motion came to, for people and for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..mechanism.tree.joints import Component, components_of, in_q, in_v
from ..printing import finite, fixed, table
from ..simulation.trajectories.trajectory import Trajectory


def summary(trajectory: Trajectory) -> str:
    """Tell end state, certificates, cost and crossings in lines to print."""
    stats, q, v = trajectory.stats, trajectory.q[-1], trajectory.v[-1]
    state = [
        [c.name, fixed(q[c.iq]) if c.iq >= 0 else "", fixed(v[c.iv]) if c.iv >= 0 else "", _units(c)]
        for c in components_of(trajectory.mechanism.joints)
    ]
    figures = {
        "max closure error": f"{trajectory.closure_error().max(initial=0.0):.1e}",
        "max |energy error|": f"{np.abs(trajectory.energy_error()).max(initial=0.0):.1e} J",
        "right-hand sides": str(stats.rhs),
        "wall time": f"{stats.wall_seconds:.3g} s",
        "crossings": str(len(trajectory.crossings) or "none"),
    }
    if trajectory.dissipated is not None:
        counts = Counter(happening.kind for happening in trajectory.happenings)
        told = ", ".join(f"{count} × {kind}" for kind, count in counts.items())
        figures |= {"happenings": told or "none", "dissipated": f"{trajectory.dissipated[-1]:.4g} J"}
    lines = [
        f"state at t = {trajectory.t[-1]:g} s",
        table(["joint", " q", " v", ""], state),
        "",
        *(f"{name:<20}{value}" for name, value in figures.items()),
    ]
    if trajectory.crossings:
        rows = [
            [f"{c.time:.6f}", " ".join(fixed(y, 6) for y in c.y), c.kind, f"{c.certificate:.1e}"]
            for c in trajectory.crossings
        ]
        lines.append(table(["t [s]", " y", "kind", "certificate"], rows))
    lines += [f"from t = {t:.6g} s: y = {', '.join(names)}" for t, names in stats.repartitions]
    return "\n".join(lines)


def _units(component: Component) -> str:
    """Of what is shown of it: "rad, rad/s" where it has both."""
    if not component.unit:
        return ""
    shown = [component.unit] * (component.iq >= 0) + [f"{component.unit}/s"] * (component.iv >= 0)
    return ", ".join(shown)


def as_json(trajectory: Trajectory, method: str, stop: Exception | None, written: Sequence[str]) -> str:
    """Tell the same, all digits, as JSON: numbers of q and v by name."""
    joints, q, v = trajectory.mechanism.joints, trajectory.q[-1], trajectory.v[-1]
    crossings: list[dict[str, Any]] = [
        {"time": c.time, "y": np.asarray(c.y).tolist(), "kind": c.kind, "certificate": c.certificate}
        for c in trajectory.crossings
    ]
    found = {
        "model": trajectory.mechanism.name,
        "method": method,
        "independent": list(trajectory.mechanism.independent),
        "stopped": None if stop is None else str(stop),
        "times": len(trajectory.t),
        "t": float(trajectory.t[-1]),
        "q": {c.name: float(q[c.iq]) for c in in_q(joints)},
        "v": {c.name: float(v[c.iv]) for c in in_v(joints)},
        "max_closure_error": float(trajectory.closure_error().max(initial=0.0)),
        "max_energy_error": float(np.abs(trajectory.energy_error()).max(initial=0.0)),
        "crossings": crossings,
        "happenings": [asdict(happening) for happening in trajectory.happenings],
        "stats": asdict(trajectory.stats),
        "written": list(written),
    }
    return json.dumps(finite(found), indent=2, ensure_ascii=False, allow_nan=False)
