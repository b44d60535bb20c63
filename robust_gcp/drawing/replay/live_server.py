"""The server behind a live view: meshcat's page and one web socket, on 127.0.0.1 and nowhere else.

meshcat's own server listens on every interface, runs as a process of its own, and its client waits for
answers without limit; this one does none of that, and serves the same page.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from pathlib import Path

import tornado.httpserver
import tornado.web
import tornado.websocket

ADDRESS = "127.0.0.1"

LARGEST = 1024
"""Bytes of a message from a browser."""


class Watcher(tornado.websocket.WebSocketHandler):
    """One browser that looks on. It is sent poses as fast as it takes them, the newest ones only."""

    def initialize(self, server: LoopbackServer) -> None:
        """Tornado's constructor."""
        self.server = server
        self.news = asyncio.Event()
        self.feeding: asyncio.Task[None] | None = None

    def open(self, *args: str, **kwargs: str) -> None:
        """Begin to send."""
        self.server.watchers.add(self)
        self.feeding = asyncio.ensure_future(self._feed())

    def on_message(self, message: str | bytes) -> None:
        """Nothing is taken from a browser but what somebody listens to."""
        if self.server.listener is not None:
            self.server.listener(message)

    def on_close(self) -> None:
        """Forget it."""
        self.server.watchers.discard(self)
        if self.feeding is not None:
            self.feeding.cancel()

    async def _feed(self) -> None:
        with contextlib.suppress(tornado.websocket.WebSocketClosedError):
            for command in self.server.scene:
                await self.write_message(command, binary=True)
            while True:
                self.news.clear()
                for command in list(self.server.poses.values()):
                    await self.write_message(command, binary=True)
                await self.news.wait()


class LoopbackServer:
    """The page's files, the scene, and the newest pose of each part; made and told in one event loop.

    Attributes
    ----------
    url : str
    scene : list of bytes
        Commands that build the scene, in order.
    poses : dict of str to bytes
        The newest command for each part.
    watchers : set of Watcher
    listener : callable (message) or None
        Takes what browsers send.
    """

    def __init__(self, folder: Path, port: int) -> None:
        self.scene: list[bytes] = []
        self.poses: dict[str, bytes] = {}
        self.watchers: set[Watcher] = set()
        self.listener: Callable[[str | bytes], None] | None = None
        application = tornado.web.Application(
            log_function=lambda handler: None,  # a browser asks for icons
            websocket_max_message_size=LARGEST,
        )
        # another host name would be a page from elsewhere that had its name point here; the group, since
        # tornado appends the end of the name to the last alternative alone
        application.add_handlers(
            r"(127\.0\.0\.1|localhost)",
            [
                (
                    r"/static/(.*)",
                    tornado.web.StaticFileHandler,
                    {"path": str(folder), "default_filename": "index.html"},
                ),
                (r"/", Watcher, {"server": self}),
            ],
        )
        self._http = tornado.httpserver.HTTPServer(application)
        door = socket.create_server((ADDRESS, port))
        door.setblocking(False)
        self._http.add_socket(door)
        self.url = f"http://{ADDRESS}:{door.getsockname()[1]}/static/"

    def tell(self, poses: dict[str, bytes], forgotten: str = "") -> None:
        """Set where parts are, inside the event loop; those named `forgotten…` are told of no more."""
        if forgotten:
            self.poses = {name: told for name, told in self.poses.items() if not name.startswith(forgotten)}
        self.poses.update(poses)
        for watcher in self.watchers:
            watcher.news.set()

    async def stop(self) -> None:
        """Free the port and let all browsers go."""
        self._http.stop()
        for watcher in list(self.watchers):
            watcher.close()
        for _ in range(100):  # a second for the browsers to say goodbye
            if not self.watchers:
                break
            await asyncio.sleep(0.01)
        await self._http.close_all_connections()
