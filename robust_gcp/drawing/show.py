"""A picture in a notebook, and beside the script where the notebook is run as one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .figures.style import save
from .replay.replay import ReplayPage

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def show(picture: Figure | ReplayPage, name: str) -> Figure | ReplayPage | None:
    """Show a picture where it is made.

    Parameters
    ----------
    picture : Figure or ReplayPage
    name : str
        Of the file beside the script, without its ending.

    Returns
    -------
    Figure or ReplayPage or None
        The picture in a notebook, which displays what its cell ends with. Elsewhere None: the picture is
        written beside the script that runs, as .png or .html, and the path printed.
    """
    if "ipykernel" in sys.modules:
        if "matplotlib.pyplot" in sys.modules:
            sys.modules["matplotlib.pyplot"].close("all")  # or pyplot would show its figures once more
        return picture
    main = getattr(sys.modules["__main__"], "__file__", None)
    folder = Path(main).parent if main else Path.cwd()
    if isinstance(picture, ReplayPage):
        path = picture.save(folder / f"{name}.html")
    else:
        path = save(picture, folder / f"{name}.png", dpi=150)
    print(f"drew {path}")
    return None
