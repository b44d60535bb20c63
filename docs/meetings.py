"""The figure of docs/method.md on meetings of modes: g over the mid curve, and the modes themselves.

Run from the checkout: python docs/meetings.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from robust_gcp.examples import meetings
from robust_gcp.maps.cluster.contact import contact_at

CASES = {
    "crossing, k = 1": (meetings.touching_cams(1), [0.0, 0.0, 0.8]),
    "contact of order 2": (meetings.touching_cams(2), [0.0, 0.0, 0.0, 0.0, 0.8]),
    "contact of order 3": (meetings.touching_cams(3), [0.0] * 6 + [0.8]),
    "cusp": (meetings.cusp_cam(0.0), [0.0, 0.0, 0.0, 0.8]),
}


def main() -> None:
    """Draw and save."""
    figure, rows = plt.subplots(2, len(CASES), figsize=(11.0, 5.0), layout="constrained")
    x = np.linspace(-0.45, 0.45, 401)
    for (title, (mechanism, profile)), above, below in zip(CASES.items(), *rows, strict=True):
        contact = contact_at(mechanism, np.array([0.0, 1.0, 0.0, 0.0]))
        assert contact is not None
        curve = contact.found.curve
        us = np.linspace(-curve.R, curve.R, 201)
        above.plot(us, [1e3 * curve.at(curve.u0 + u)[1] for u in us], color="C0")
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
    figure.savefig(Path(__file__).parent / "figures" / "meetings.png", dpi=110)


if __name__ == "__main__":
    main()
