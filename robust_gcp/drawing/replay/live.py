"""A live view of a mechanism in a browser on this machine: `with live(mechanism) as viewer: ...`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...checks import check_whole
from ...errors import OptionError, missing_extra
from ...mechanism.mechanism import Mechanism
from ...simulation.trajectories.trajectory import Trajectory
from .replay import meshcat_folder

if TYPE_CHECKING:
    from .live_viewer import LiveViewer

LAST_PORT = 65_535


def live(
    shown: Mechanism | Trajectory, port: int = 0, open_browser: bool = False, sliders: bool = False
) -> LiveViewer:
    """Serve a live view of a mechanism to browsers on this machine, at 127.0.0.1 only.

    ```
    with rg.live(mechanism, open_browser=True) as viewer:
        viewer.wait_for_browser()
        viewer.play(trajectory)
    ```

    Parameters
    ----------
    shown : Mechanism or Trajectory
        Shown at home, or at the motion's start with all of the motion in the picture.
    port : int
        0 takes a free one.
    open_browser : bool
        Whether to open the page in the user's browser.
    sliders : bool
        Whether the page has a slider for each independent joint. The mechanism follows it along its mode, and
        stops with a notice at a dead point; `viewer.q` is where it is. The page then sends these numbers, and
        nothing else is taken from it.

    Returns
    -------
    LiveViewer
        With `show(q)`, `play(trajectory, speed)`, `wait_for_browser(timeout)`, `close()`, `url`.

    Raises
    ------
    MissingExtraError
        When meshcat is not installed.
    OptionError
        When the port is none, or taken.
    """
    if not isinstance(shown, Mechanism | Trajectory):
        raise OptionError(f"live takes a mechanism or a trajectory, not a {type(shown).__name__}")
    check_whole("port", port, 0, LAST_PORT)
    meshcat_folder()
    try:
        from .live_viewer import LiveViewer
    except ImportError as error:
        raise missing_extra(f"live needs meshcat with tornado ({error})", "meshcat", "viz") from error
    viewer = LiveViewer(shown, port, sliders)
    if open_browser:
        import webbrowser

        webbrowser.open(viewer.url, new=2)
    return viewer
