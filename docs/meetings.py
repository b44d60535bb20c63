"""The figures of docs/method.md on meetings of modes: g over the mid curve, and the modes themselves.

Run from the checkout: python docs/meetings.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import robust_gcp as rg
from robust_gcp.examples import meetings
from robust_gcp.examples.kinematotropic import wunderlich
from robust_gcp.maps.cluster.touching.contact import contact_at

CASES = {
    "crossing, k = 1": (meetings.touching_cams(1), [0.0, 0.0, 0.8]),
    "contact of order 2": (meetings.touching_cams(2), [0.0, 0.0, 0.0, 0.0, 0.8]),
    "contact of order 3": (meetings.touching_cams(3), [0.0] * 6 + [0.8]),
    "cusp": (meetings.cusp_cam(0.0), [0.0, 0.0, 0.0, 0.8]),
}


FIGURES = Path(__file__).parent / "figures"


def main() -> None:
    """Draw and save."""
    draw_cams()
    draw_linkages()


def draw_cams() -> None:
    """g, and the modes as curves."""
    figure, rows = plt.subplots(2, len(CASES), figsize=(11.0, 5.0), layout="constrained")
    x = np.linspace(-0.45, 0.45, 401)
    for (title, (mechanism, profile)), above, below in zip(CASES.items(), *rows, strict=True):
        contact = contact_at(mechanism, np.array([0.0, 1.0, 0.0, 0.0]))
        assert contact is not None
        curve = contact.found.curve
        us = np.linspace(-curve.R, curve.R, 201)
        above.plot(us, [1e3 * curve.values_at(curve.u0 + u)[1] for u in us], color="C0")
        above.axhline(0.0, color="0.7", linewidth=0.8)
        above.set(title=title, xlabel="u along the mid curve")
        depth = np.polynomial.polynomial.polyval(x, profile)
        bend = np.where(depth >= 0.0, 2.0 * np.arcsin(np.sqrt(np.abs(depth) * (2.0 - depth) / 0.96)), np.nan)
        side = np.sign(x) ** max(contact.found.order, 1) if contact.found.kind == "meets" else 1.0
        below.plot(x, side * bend, color="C1")
        below.plot(x, -side * bend, color="C2")
        below.set_xlabel("slide x [m]")
    rows[0, 0].set_ylabel("g [1e-3 lengths]")
    rows[1, 0].set_ylabel("bend of the rod [rad]")
    figure.savefig(FIGURES / "meetings.png", dpi=110)


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Within ±π."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def draw_linkages() -> None:
    """Configuration spaces of the double Watt linkage, its copy, and Wunderlich's."""
    figure, axes = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    for axis, mirrored in zip(axes, (True, False), strict=False):
        mechanism = meetings.double_watt(mirrored)
        bar = [mechanism.joint(name).idx_q for name in ("low0", "coupler0", "bar0")]
        space = rg.trace_modes(mechanism, seeds=8)
        for mode in space.modes:
            near = wrapped(mode.q)
            near = near[np.abs(near).max(axis=1) < 1.2]
            axis.plot(near[:, bar[0]], wrapped(near[:, bar].sum(axis=1)), ".", markersize=3.0)
        axis.plot(0.0, 0.0, "o", color="k", fillstyle="none")
        axis.set(xlabel="crank [rad]", ylabel="lean of the bar [rad]", xlim=(-0.45, 0.45), ylim=(-0.12, 0.12))
        axis.set_title("double Watt: cusp" if mirrored else "its copy: contact of order 4")
    mechanism = wunderlich("2P4A", (0.0, 1.6))
    space = rg.trace_modes(mechanism, seeds=4)
    (mode,) = space.modes
    model = mechanism.own_model
    _, y, z = model.jointPlacements[model.getJointId("a00b10")].translation
    start = np.array([np.arctan2(z, y), 1.6])
    at = [mechanism.joint(name).idx_q for name in ("a00", "c00")]

    def angles(q: np.ndarray) -> np.ndarray:
        return wrapped(start + q[..., at] + 1e-9)

    axes[2].plot(*angles(mode.q).T, ".", color="C2", markersize=2.0)
    axes[2].plot(
        *angles(np.array([point.q for point in space.singular_points])).T, "o", color="k", fillstyle="none"
    )
    axes[2].set(title="Wunderlich: mobility 1 meets 2", xlabel="α [rad]", ylabel="γ [rad]")
    figure.savefig(FIGURES / "configuration_spaces.png", dpi=110)


if __name__ == "__main__":
    main()
