"""A figure that a notebook shows by itself; the one module that imports Matplotlib when it is imported."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

NOTEBOOK_DPI = 150


class Picture(Figure):
    """A `Figure` outside pyplot: nothing stays open, no backend is chosen."""

    def _repr_png_(self) -> bytes:
        """Draw for a notebook."""
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=NOTEBOOK_DPI)
        return buffer.getvalue()
