"""The pictures of docs/gallery.md: `python docs/gallery.py` draws them anew into docs/figures/gallery."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

import robust_gcp as rg

FOLDER = Path(__file__).parent / "figures" / "gallery"

STROBED = {
    "andrews": (0.0, 0.03),
    "change_point": (0.0, 1.2),
    "crank_rocker": (0.0, 1.5),
    "five_bar": (0.0, 0.5),
    "kite": (0.0, 0.6),
    "parallelogram": (0.0, 1.0),
    "rhombus": (0.0, 0.8),
    "slider_crank": (0.0, 1.0),
    "strandbeest": (0.0, 1.0),
}
"""Planar ones at eight instants between these times, s; the others at home."""


def main() -> None:
    """Draw each shipped model."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in rg.model_names():
        mechanism = rg.load(name)
        path = FOLDER / f"{name}.png"
        if name in STROBED:
            figure = rg.simulate(mechanism).strobe(8, between=STROBED[name])
        else:
            figure = rg.draw(mechanism)
        figure.set_size_inches(4.2, 3.2)
        figure.savefig(path, dpi=90, bbox_inches="tight")
        plt.close(figure)
        print(f"drew {path.name}, {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
