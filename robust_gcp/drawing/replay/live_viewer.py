"""The live viewer: a mechanism in a browser on this machine, posed from here."""

from __future__ import annotations

import asyncio
import atexit
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from ...checks import check_positive
from ...errors import OptionError, RobustGcpError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import components_of
from ...mechanism.tree.tree import Array
from ...simulation.trajectories.trajectory import Trajectory
from .frames import FPS, pictures
from .live_scene import LiveScene
from .live_server import LoopbackServer
from .live_sliders import NOTICE, Sliders
from .replay import meshcat_folder

PATIENCE = 5.0
"""Seconds that an answer of the server is waited for."""

T = TypeVar("T")


class LiveViewer:
    """meshcat's page, served to this machine alone from a thread of this process.

    Made by `live`; a context manager. Nothing outlives `close`, the end of the `with` block or the end
    of the program: there is no process to leave behind, and no call waits longer than it says.

    Attributes
    ----------
    url : str
        Address of the page, on 127.0.0.1.
    """

    def __init__(self, shown: Mechanism | Trajectory, port: int = 0, sliders: bool = False) -> None:
        folder = meshcat_folder() / "viewer" / "dist"
        self._scene = LiveScene(shown)
        self._mechanism = self._scene.mechanism
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="live viewer", daemon=True)
        self._thread.start()
        try:
            self._server = self._ask(LoopbackServer, folder, port)
        except OSError as error:
            self._end_thread()
            raise OptionError(f"port = {port} cannot be used ({error}); 0 takes a free one") from error
        atexit.register(self.close)
        self.url: str = self._server.url
        self._q = self._mechanism.home if isinstance(shown, Mechanism) else shown.q[0]
        self._sliders = Sliders(self._mechanism, self._q) if sliders else None
        controls = [] if self._sliders is None else self._sliders.controls()
        self._server.scene = [*self._scene.commands(), *controls]
        self.show(self._q)
        if self._sliders is not None:
            self._server.listener = self._heard

    @property
    def q(self) -> Array:
        """The configuration shown (nq,)."""
        return (self._q if self._sliders is None else self._sliders.q).copy()

    def show(self, q: ArrayLike) -> None:
        """Show the configuration q (nq,)."""
        self._q = self._mechanism.configuration(q)
        if self._sliders is not None:
            self._sliders.place(self._q)
        self._ask(self._server.tell, self._scene.poses(self._q))

    def _heard(self, message: str | bytes) -> None:
        """Move to where a slider was dragged, in the server's thread."""
        sliders = self._sliders
        asked = None if sliders is None else sliders.heard(message)
        if sliders is None or asked is None:
            return
        name, value = asked
        answer = sliders.answer(name, sliders.move(name, value))
        self._server.tell(self._scene.poses(sliders.q) | answer, forgotten=NOTICE)

    def play(self, trajectory: Trajectory, speed: float = 1.0) -> None:
        """Play a motion at `speed` simulated seconds a second; returns when it is over.

        Pictures that this machine is too slow for are left out, so that it takes the time it should.
        """
        given: Any = trajectory
        if not (isinstance(given, Trajectory) and _alike(given.mechanism, self._mechanism)):
            raise OptionError(f"play: the trajectory is not one of {self._mechanism.name!r}")
        check_positive("speed", speed)
        q = pictures(trajectory, speed)
        begin, i = time.monotonic(), 0
        while i < len(q) - 1:
            self.show(q[i])
            time.sleep(max(0.0, begin + (i + 1) / FPS - time.monotonic()))
            i = max(i + 1, int((time.monotonic() - begin) * FPS))
        self.show(q[-1])

    def watchers(self) -> int:
        """Number of browsers that look on."""
        return len(self._server.watchers)

    def wait_for_browser(self, timeout: float = 30.0) -> bool:
        """Wait until a browser looks on, at most `timeout` s; returns whether one does."""
        end = time.monotonic() + timeout
        while not self.watchers() and time.monotonic() < end:
            time.sleep(0.02)
        return self.watchers() > 0

    def close(self) -> None:
        """Free the port and end the thread; may be called again."""
        atexit.unregister(self.close)
        if self._thread.is_alive():
            try:
                asyncio.run_coroutine_threadsafe(self._server.stop(), self._loop).result(PATIENCE)
            finally:
                self._end_thread()

    def __enter__(self) -> LiveViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _ask(self, function: Callable[..., T], *given: Any) -> T:
        """Call in the server's thread and wait, within reason."""
        if not self._thread.is_alive():
            raise RobustGcpError("the live viewer is closed; open another one with live(...)")

        async def called() -> T:
            return function(*given)

        return asyncio.run_coroutine_threadsafe(called(), self._loop).result(PATIENCE)

    def _end_thread(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        if not self._loop.is_running():
            self._loop.close()


def _alike(one: Mechanism, other: Mechanism) -> bool:
    """Whether joints are the same, and where the same."""
    places = [mechanism.own_model.jointPlacements for mechanism in (one, other)]
    same = components_of(one.joints) == components_of(other.joints)
    return same and all(a.isApprox(b, 1e-9) for a, b in zip(*places, strict=True))
