"""A figure that a notebook shows by itself; the one module that imports Matplotlib when it is imported."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text

from ...checks import plain

NOTEBOOK_DPI = 150


class Picture(Figure):
    """A `Figure` outside pyplot: nothing stays open, no backend is chosen; names are drawn as they are."""

    def draw(self, renderer: Any) -> None:
        """Draw, with dollar signs and control characters of names as text: Matplotlib would parse them."""
        for text in self.findobj(Text):
            assert isinstance(text, Text)
            words = text.get_text()
            if "$" in words and "\\mathdefault" not in words:  # but those of its own ticks
                text.set_parse_math(False)
            if plain(words) != words:
                text.set_text(plain(words))
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        """Draw for a notebook."""
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=NOTEBOOK_DPI)
        return buffer.getvalue()
