"""The live viewer: for this machine alone, never waiting without end, leaving nothing behind."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

import robust_gcp as rg

umsgpack = pytest.importorskip("umsgpack", reason="meshcat (extra viz) is not installed")
pytest.importorskip("meshcat", reason="meshcat (extra viz) is not installed")


def port_of(url: str) -> int:
    port = urlsplit(url).port
    assert port is not None
    return port


def listening(address: str, port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((address, port)) == 0


async def received(url: str, count: int) -> list[dict]:
    from tornado.websocket import websocket_connect

    connection = await websocket_connect(url)
    messages = []
    for _ in range(count):
        message = await asyncio.wait_for(connection.read_message(), 5.0)
        assert isinstance(message, bytes)
        messages.append(umsgpack.unpackb(message))
    connection.close()
    while await connection.read_message() is not None:
        pass
    return messages


def test_this_machine_alone_can_see_it(capfd: pytest.CaptureFixture[str]) -> None:
    with rg.live(rg.load("rhombus")) as viewer:
        port = port_of(viewer.url)
        assert listening("127.0.0.1", port)
        assert not listening("127.0.0.2", port)  # any other address, even one of this machine
        with urllib.request.urlopen(viewer.url, timeout=5) as page:
            assert b"MeshCat" in page.read()
        # a page from elsewhere whose name points here, names that begin or end as ours do among them
        for name in (
            "example.org",
            "127.0.0.1.example.org",
            "127.0.0.1x",
            "localhost.example.org",
            "xlocalhost",
        ):
            elsewhere = urllib.request.Request(viewer.url, headers={"Host": f"{name}:{port}"})
            with pytest.raises(urllib.error.HTTPError, match="404") as refused:
                urllib.request.urlopen(elsewhere, timeout=5)
            refused.value.close()
    assert capfd.readouterr() == ("", "")  # nothing is printed, refusals included


def test_a_browser_is_told_the_scene_and_where_its_parts_are() -> None:
    mechanism = rg.load("rhombus")
    with rg.live(mechanism) as viewer:
        viewer.show([0.7, -0.7, 0.7])
        url = f"ws://127.0.0.1:{port_of(viewer.url)}/"
        messages = asyncio.run(received(url, 21))
    objects = [m["path"] for m in messages if m["type"] == "set_object"]
    poses = {m["path"]: np.reshape(m["matrix"], (4, 4)).T for m in messages if m["type"] == "set_transform"}
    assert set(objects) == set(poses)
    sticks = [T for path, T in poses.items() if "stick" in path]
    # four unit rods, ground included, at one scale: meshcat's unit cylinder is along y
    lengths = [np.linalg.norm(T[:3, 1]) for T in sticks]
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-12)
    ends = np.array([T[:3, 3] + s * T[:3, 1] for T in sticks for s in (-0.5, 0.5)]) / lengths[0]
    # the rhombus' corners: sides 1, angle 0.7, so the diagonals are 2 cos 0.35 and 2 sin 0.35
    apart = np.linalg.norm(ends[:, None] - ends[None], axis=2)
    expected = {0.0, 1.0, 2 * np.cos(0.35), 2 * np.sin(0.35)}
    assert {min(expected, key=lambda x, d=d: abs(x - d)) for d in apart.ravel()} == expected
    assert max(min(abs(x - d) for x in expected) for d in apart.ravel()) < 1e-12


def test_playing_takes_the_time_of_the_motion_with_nobody_looking_on() -> None:
    run = rg.simulate(rg.load("rhombus"), duration=0.5, step=1e-2)
    with rg.live(run) as viewer:
        begin = time.monotonic()
        viewer.play(run)
        assert 0.4 < time.monotonic() - begin < 3.0
        begin = time.monotonic()
        assert not viewer.wait_for_browser(timeout=0.1)
        assert time.monotonic() - begin < 2.0


def test_a_motion_without_outputs_is_refused() -> None:
    rhombus = rg.load("rhombus")
    empty = rg.Trajectory(rhombus, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(rg.StateError, match="empty"):
        rg.live(empty)
    with rg.live(rhombus) as viewer, pytest.raises(rg.StateError, match="empty"):
        viewer.play(empty)


def test_closing_frees_port_and_thread_and_may_be_repeated() -> None:
    before = set(threading.enumerate())
    viewer = rg.live(rg.load("rhombus"))
    port = port_of(viewer.url)
    viewer.close()
    viewer.close()
    assert set(threading.enumerate()) == before
    assert not listening("127.0.0.1", port)
    with pytest.raises(rg.RobustGcpError, match="closed"):
        viewer.show([0.2, -0.2, 0.2])
    with rg.live(rg.load("rhombus"), port=port) as again:
        assert port_of(again.url) == port


def test_a_browser_that_stays_does_not_keep_it_open() -> None:
    from tornado.websocket import websocket_connect

    async def stay() -> None:
        loop = asyncio.get_running_loop()
        viewer = await loop.run_in_executor(None, rg.live, rg.load("rhombus"))
        connection = await websocket_connect(f"ws://127.0.0.1:{port_of(viewer.url)}/")
        assert await loop.run_in_executor(None, viewer.wait_for_browser, 5.0)
        for y in np.linspace(0.2, 0.9, 50):  # never read: nothing may pile up or wait
            await loop.run_in_executor(None, viewer.show, [y, -y, y])
        await loop.run_in_executor(None, viewer.close)
        while await connection.read_message() is not None:
            pass  # what had been sent, then the end
        connection.close()

    asyncio.run(asyncio.wait_for(stay(), 20.0))


def test_a_program_that_forgets_to_close_still_ends() -> None:
    script = 'import robust_gcp as rg; viewer = rg.live(rg.load("rhombus")); print(viewer.url)'
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stderr == ""
    assert not listening("127.0.0.1", port_of(done.stdout.strip()))


def test_a_taken_port_and_other_bad_input_are_refused() -> None:
    before = set(threading.enumerate())
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(rg.OptionError, match="0 takes a free one"):
            rg.live(rg.load("rhombus"), port=taken.getsockname()[1])
    with pytest.raises(rg.OptionError, match="not a str"):
        rg.live("rhombus")  # type: ignore[arg-type]
    assert set(threading.enumerate()) == before
    with rg.live(rg.load("rhombus")) as viewer:
        with pytest.raises(rg.StateError):
            viewer.show([0.2])
        with pytest.raises(rg.OptionError, match="not one of"):
            viewer.play(rg.simulate(rg.load("bricard"), duration=0.01))


def test_without_the_extra_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(rg.MissingExtraError, match=r"pip install meshcat, or .*\.\[viz\]"):
        rg.live(rg.load("rhombus"))


@pytest.mark.parametrize("port", [-1, 70_000, 80.5, "80", True])
def test_a_port_that_is_none_is_refused_and_leaves_no_thread(port: object) -> None:
    with pytest.raises(rg.OptionError, match=r"port = .* must be a whole number, from 0 to 65535"):
        rg.live(rg.load("rhombus"), port=port)  # type: ignore[arg-type]
    assert "live viewer" not in {thread.name for thread in threading.enumerate()}


async def dragged(url: str, moves: list[str], quiet: float = 1.5) -> list[dict]:
    """What a page is told that opens, sends these messages and reads until nothing comes for `quiet` s."""
    from tornado.websocket import websocket_connect

    connection = await websocket_connect(url)
    found: list[dict] = []

    async def drain() -> None:
        while True:
            message = await asyncio.wait_for(connection.read_message(), quiet)
            assert isinstance(message, bytes)
            found.append(umsgpack.unpackb(message))

    for move in ["", *moves]:
        if move:
            await connection.write_message(move)
        with contextlib.suppress(asyncio.TimeoutError):
            await drain()
    connection.close()
    while await connection.read_message() is not None:
        pass
    return found


def slide(name: str, value: float) -> str:
    return json.dumps({"name": name, "value": value})


def test_a_slider_moves_the_mechanism_along_its_mode() -> None:
    """Through a singular configuration, on the parallelogram mode, and far in one message."""
    with rg.live(rg.load("rhombus"), sliders=True) as viewer:
        url = f"ws://127.0.0.1:{port_of(viewer.url)}/"
        found = asyncio.run(dragged(url, [slide("q1", 0.7), slide("q1", -2.0)]))
        (control,) = [m for m in found if m["type"] == "set_control"]
        assert control["name"] == "q1" and control["value"] == pytest.approx(0.2)
        assert control["min"] < -6.0 and control["max"] > 6.0
        np.testing.assert_allclose(viewer.q, [-2.0, 2.0, -2.0], atol=1e-12)
        viewer.show([0.5, -0.5, 0.5])
        np.testing.assert_array_equal(viewer.q, [0.5, -0.5, 0.5])


def test_a_slider_stops_at_a_dead_point_and_says_so() -> None:
    """A slider-crank moved by its slide goes to where crank and rod are in line, and comes back."""
    mechanism = rg.load("slider_crank").with_independent(["q3"])
    with rg.live(mechanism, sliders=True) as viewer:
        url = f"ws://127.0.0.1:{port_of(viewer.url)}/"
        start = viewer.q[2]
        found = asyncio.run(dragged(url, [slide("q3", 50.0)]))
        assert viewer.q[2] < 50.0 and mechanism.closure_residual(viewer.q) < 1e-9
        notices = [m["name"] for m in found if m["type"] == "set_control" and m["name"] != "q3"]
        assert notices and set(notices) == {"q3: a dead point"}
        back = [m["value"] for m in found if m["type"] == "set_control_value"]
        assert back[-1] == pytest.approx(viewer.q[2])
        found = asyncio.run(dragged(url, [slide("q3", float(start))]))
        assert {"type": "delete_control", "name": "q3: a dead point"} in found
        np.testing.assert_allclose(viewer.q, mechanism.home, atol=1e-6)


@pytest.mark.parametrize(
    "message",
    [
        "", "no json", "[" * 150, json.dumps({"name": "q9", "value": 1.0}), json.dumps({"name": "q1"}),
        json.dumps({"name": "q1", "value": "1"}), json.dumps({"name": "q1", "value": True}),
        json.dumps({"name": "q1", "value": 1.0, "more": 1}), '{"name": "q1", "value": NaN}',
        '{"name": "q1", "value": 1e400}', json.dumps({"name": "q1", "value": 1.0}) + " " * 300,
        json.dumps({"name": "q1", "value": 1.0}).encode(),
    ],
)  # fmt: skip
def test_nothing_else_is_taken_from_a_page(message: str | bytes) -> None:
    with rg.live(rg.load("rhombus"), sliders=True) as viewer:
        url = f"ws://127.0.0.1:{port_of(viewer.url)}/"
        asyncio.run(dragged(url, [message] if isinstance(message, str) else [], 0.4))
        np.testing.assert_allclose(viewer.q, rg.load("rhombus").home)
    with rg.live(rg.load("rhombus")) as viewer:  # without sliders nothing at all
        asyncio.run(dragged(f"ws://127.0.0.1:{port_of(viewer.url)}/", [slide("q1", 1.0)], 0.4))
        np.testing.assert_array_equal(viewer.q, rg.load("rhombus").home)


def test_a_page_of_another_origin_is_refused() -> None:
    from tornado.httpclient import HTTPClientError, HTTPRequest
    from tornado.websocket import websocket_connect

    async def connect(url: str, origin: str) -> None:
        await websocket_connect(HTTPRequest(url, headers={"Origin": origin}))

    with rg.live(rg.load("rhombus"), sliders=True) as viewer:
        url = f"ws://127.0.0.1:{port_of(viewer.url)}/"
        with pytest.raises(HTTPClientError, match="403"):
            asyncio.run(connect(url, "http://elsewhere.example"))


def test_motions_of_other_linkages_with_as_many_joints_are_refused() -> None:
    """They were played on this one, and drawn over it in its units."""
    rhombus, slide = rg.load("rhombus"), rg.load("slider_crank")
    run, other = (rg.simulate(mech, duration=0.01, step=1e-3) for mech in (rhombus, slide))
    with rg.live(rhombus) as viewer:
        viewer.play(run)
        for wrong in (other, rg.simulate(rg.load("crank_rocker"), duration=0.01, step=1e-3), "run"):
            with pytest.raises(rg.OptionError, match="play: the trajectory is not one of 'rhombus'"):
                viewer.play(wrong)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="other joints"):
        run.plot("q", overlay=other)


def test_a_page_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    page = rg.replay(rg.simulate(rg.load("rhombus"), duration=0.01, step=1e-3))
    with pytest.raises(rg.OptionError, match="cannot be written"):
        page.save(tmp_path / "no" / "page.html")
