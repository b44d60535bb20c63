"""The page: self-contained, honest, and playing in a real browser without a network."""

from __future__ import annotations

import base64
import contextlib
import html
import io
import itertools
import json
import os
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main

pytest.importorskip("meshcat", reason="meshcat (extra viz) is not installed")

END = 2.2
LABELS = ["robust", "classical GCP: locks"]
DATA = re.compile(r'<script id="data" type="application/json">(.*?)</script>', re.DOTALL)


def data_of(page: str) -> dict[str, Any]:
    found = DATA.search(page)
    assert found is not None
    return json.loads(found[1])


def positions(run: dict[str, Any]) -> np.ndarray:
    values = np.frombuffer(base64.b64decode(run["points"]), dtype="<f4")
    return values.reshape(run["frames"], run["count"], 3)


@pytest.fixture(scope="module")
def pair() -> list[rg.Trajectory]:
    """The paper's fall: through the crossings, and locked by classical GCP."""
    mechanism = rg.load("rhombus")
    with pytest.warns(rg.SingularityWarning):
        return [
            rg.simulate(mechanism, [0.2, -0.2, 0.2], duration=END, step=2e-3),
            rg.simulate(
                mechanism,
                [0.2, -0.2, 0.2],
                duration=END,
                step=1e-3,
                method="classical",
                newton_start="previous",
            ),
        ]


@pytest.fixture(scope="module")
def overlay(pair: list[rg.Trajectory], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = rg.replay(pair, tmp_path_factory.mktemp("page") / "overlay.html", labels=LABELS)
    assert path.name == "overlay.html"
    return path


# --------------------------------------------------------------------------- the file


class Outside(HTMLParser):
    """Collects whatever a page asks for from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        asks = [f"{tag} {name}={value}" for name, value in attrs if name in ("src", "href", "action", "data")]
        self.asked += asks + ([tag] if tag in ("link", "iframe", "object", "embed") else [])


def test_the_page_asks_for_nothing_from_elsewhere(overlay: Path) -> None:
    parser = Outside()
    text = overlay.read_text(encoding="utf-8")
    parser.feed(text)
    assert parser.asked == []
    assert "@import" not in text
    assert "three.js" in text.lower() and "MIT" in text  # licences travel along


def test_the_page_tells_the_crossings_and_where_they_are(overlay: Path, pair: list[rg.Trajectory]) -> None:
    run = data_of(overlay.read_text(encoding="utf-8"))["runs"][0]
    assert [c["time"] for c in run["crossings"]] == [c.time for c in pair[0].crossings]
    assert len(run["crossings"]) == 4
    for told, crossing in zip(run["crossings"], pair[0].crossings, strict=True):
        assert told["kind"] == "transversal"
        assert told["y"] == f"q1 = {'0.0000' if abs(crossing.y[0]) < 1 else '−3.1416'} rad"
        # at y = 0 the coupler tip is at 2 m from the origin along y, at y = −π back at the origin;
        # crossings are located to some 1e-11 rad
        place = [0.0, 2.0 if abs(crossing.y[0]) < 1 else 0.0, 0.0]
        np.testing.assert_allclose(told["place"], place, atol=1e-9)


def test_the_page_tells_when_joints_are_at_their_stops(overlay: Path) -> None:
    """From the impact on, at rest on the stop, and four pictures more; the mark is on the slide."""
    mech = rg.load("slider_crank")
    stop = rg.Stop("q3", lower=float(mech.home[2]) - 0.25)
    run = rg.simulate(mech, duration=2.0, step=2e-3, joints=[stop])
    (hit,) = [h.time for h in run.happenings if h.kind == "impact"]
    assert [h.kind for h in run.happenings] == ["impact", "hold"]  # plastic: it rests on from there
    (told,) = data_of(rg.replay(run, speed=1.0).html)["runs"]
    (shown,) = told["stops"]
    assert shown["joint"] == "q3"
    np.testing.assert_allclose(shown["times"], [[hit, 2.0 + 4 / 30]], atol=1e-12)
    place = positions(told)[:, shown["point"]]
    slide = np.interp(np.linspace(0.0, 2.0, len(place)), run.t, run["q3"])
    np.testing.assert_allclose(place[:, 1], slide, atol=1e-3)
    assert data_of(overlay.read_text(encoding="utf-8"))["runs"][0]["stops"] == []


def test_pictures_are_those_of_the_motion(overlay: Path, pair: list[rg.Trajectory]) -> None:
    data = data_of(overlay.read_text(encoding="utf-8"))
    assert [run["label"] for run in data["runs"]] == LABELS
    run = data["runs"][0]
    tip = positions(run)[:, run["trails"][0]["point"]]
    assert run["frames"] == 67  # 2.2 s, 30 a second, both ends
    t = np.linspace(0.0, END, 67)
    y = np.interp(t, pair[0].t, pair[0].q[:, 0])
    # parallelogram: the coupler stays level
    exact = np.column_stack([np.zeros(67), np.cos(y) + 1.0, np.sin(y)])
    assert np.abs(tip - exact).max() < 1e-4  # np.interp over 2 ms: h²/8 · 30 rad/s² = 2e-5, f4 1e-7
    assert np.abs(positions(data["runs"][1])[-1] - positions(run)[-1]).max() > 0.5  # the other one has locked


def test_a_million_steps_make_a_page_like_any_other() -> None:
    mechanism = rg.load("rhombus")
    t = np.linspace(0.0, 1000.0, 1_000_001)
    y, rate = np.sin(t), np.cos(t)
    sign = np.array([1.0, -1.0, 1.0])
    run = rg.Trajectory(mechanism, t, y[:, None] * sign, rate[:, None] * sign)
    page = rg.replay(run).html
    data = data_of(page)
    assert data["speed"] == 5.0
    assert len(page) < 3_000_000
    tip = positions(data["runs"][0])[:, data["runs"][0]["trails"][0]["point"]]
    y = np.sin(np.linspace(0.0, 1000.0, len(tip)))
    np.testing.assert_allclose(tip[:, 1:], np.column_stack([np.cos(y) + 1.0, np.sin(y)]), atol=1e-6)


def test_a_notebook_shows_the_same_page(pair: list[rg.Trajectory], overlay: Path) -> None:
    page = rg.replay(pair, labels=LABELS)
    assert page.html == overlay.read_text(encoding="utf-8")
    assert rg.replay(dict(zip(LABELS, pair, strict=True))).html == page.html
    shown = page._repr_html_()
    source = re.search(r'srcdoc="([^"]*)"', shown)
    assert source is not None and html.unescape(source[1]) == page.html
    assert shown.startswith("<iframe") and "620px" in shown


def test_many_starts_are_a_list_of_motions() -> None:
    mech = rg.load("rhombus")
    runs = rg.simulate_many(mech, [(mech.home, None)] * 2, 0.1)
    assert rg.replay(runs).html == rg.replay(list(runs)).html


def test_words_of_the_user_stay_words(pair: list[rg.Trajectory]) -> None:
    evil = "</script><img src=x onerror=alert(1)> @@DATA@@"
    page = rg.replay(pair, labels=[evil, "b"], title=evil).html
    parser = Outside()
    parser.feed(page)
    assert parser.asked == []
    assert data_of(page)["runs"][0]["label"] == evil
    assert data_of(page)["title"] == evil


def test_drawing_a_page_loads_neither_meshcat_nor_matplotlib(tmp_path: Path) -> None:
    script = (
        "import sys, robust_gcp as rg\n"
        "heavy = {'meshcat', 'matplotlib', 'tornado', 'zmq', 'IPython', 'asyncio'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "run = rg.simulate(rg.load('rhombus'), duration=0.1)\n"
        "rg.replay(run, sys.argv[1])\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    file = str(tmp_path / "page.html")
    subprocess.run([sys.executable, "-c", script, file], check=True, timeout=120)


def test_without_the_extra_the_remedy_is_named(
    pair: list[rg.Trajectory], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(rg.MissingExtraError, match=r'pip install "\.\[viz\]"'):
        rg.replay(pair, tmp_path / "page.html")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"layout": "stacked"}, "use one of overlay, side by side"),
        ({"labels": ["one"]}, "give 2 names"),
        ({"labels": "ab"}, "give 2 names"),
        ({"trajectories": {}, "labels": ["one"]}, "names the motions already"),
        ({"speed": 0.0}, "must be positive"),
        ({"height": "tall"}, "height = 'tall' must be a whole number"),
        ({"speed": 1e-6}, "give speed="),
        ({"view": (0, 0, 0)}, "not a direction"),
        ({"trails": ["tip"]}, "no frame 'tip'"),
        ({"path": "motion.png"}, "end its name in .html"),
    ],
)
def test_bad_input_is_refused(pair: list[rg.Trajectory], options: dict[str, Any], words: str) -> None:
    with pytest.raises((rg.OptionError, rg.ModelError), match=re.escape(words)):
        rg.replay(**{"trajectories": pair, **options})


def test_what_is_no_motion_is_refused(pair: list[rg.Trajectory]) -> None:
    for wrong in ([], pair * 3, [pair[0], 3], {}, {"a": 3}):
        with pytest.raises(rg.OptionError, match="a list of 1 to 4"):
            rg.replay(wrong)  # type: ignore[call-overload]
    with pytest.raises(rg.OptionError, match="Mechanism"):
        rg.replay(pair[0].mechanism)


def test_the_command_writes_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "beest.html"
    given = ["simulate", "strandbeest", "--duration", "0.1", "--step", "5e-3", "--trails", "foot"]
    assert main([*given, "--replay", str(page)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"wrote {page}"
    (run,) = data_of(page.read_text(encoding="utf-8"))["runs"]
    assert [trail["name"] for trail in run["trails"]] == ["foot"]
    assert main([*given, "--replay", str(tmp_path / "beest.png")]) == 2
    out, err = capsys.readouterr()
    assert out == "" and "a replay is a .html or a .htm file" in err  # refused before anything was simulated


# --------------------------------------------------------------------------- the browser

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--no-first-run", "--disable-quic", "--disable-background-networking",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND", "--remote-debugging-pipe",
)  # fmt: skip
PATIENCE = 60.0
SIZES = [(1280, 800), (390, 844)]


class Browser:
    """A headless browser without a network, spoken to in Chrome's DevTools protocol over a pipe."""

    def __init__(self, program: str, profile: Path) -> None:
        hears, self._tell = os.pipe()
        self._hear, tells = os.pipe()
        pipes = f'exec "$0" "$@" 3<&{hears} 4>&{tells}'
        self._process = subprocess.Popen(
            ["/bin/bash", "-c", pipes, program, *FLAGS, f"--user-data-dir={profile}"],
            pass_fds=(hears, tells), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(hears)
        os.close(tells)
        self._rest, self._count, self._session = b"", itertools.count(1), ""
        self.events: list[dict[str, Any]] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for part in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{part}.enable")

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._count)
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._tell, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def _next(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._hear], [], [], max(0.0, end - time.monotonic()))
            assert ready, "the browser does not answer"
            piece = os.read(self._hear, 1 << 20)
            assert piece, "the browser has gone"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def open(self, page: Path, fragment: str = "", size: tuple[int, int] = SIZES[0]) -> None:
        self.events.clear()
        width, height = size
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.ask("Page.navigate", url="about:blank")
        self.ask("Page.navigate", url=f"{page.as_uri()}#{fragment}")
        self.until("document.readyState === 'complete' && document.body.dataset.state !== undefined")

    def run(self, script: str) -> Any:
        """The value of an expression; of its promise, if it is one."""
        answer = self.ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, condition: str) -> None:
        end = time.monotonic() + PATIENCE
        while not self.run(condition):
            assert time.monotonic() < end, condition
            time.sleep(0.02)

    def draw(self) -> None:
        """Wait until the page has drawn what it was told."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def press(self, key: str) -> None:
        text = {"text": key} if len(key) == 1 else {}
        self.ask("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.ask("Input.dispatchKeyEvent", type="keyUp", key=key)
        self.draw()

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        self.draw()

    def box(self, element: str) -> dict[str, float]:
        return self.run(f"document.querySelector('{element}').getBoundingClientRect().toJSON()")

    def picture(self) -> np.ndarray:
        """The pane, (height, width, 3), 0 to 1."""
        from PIL import Image

        box = self.box("#frame")
        clip = {k: box[k] for k in ("x", "y", "width", "height")} | {"scale": 1}
        png = self.ask("Page.captureScreenshot", clip=clip)["data"]
        with Image.open(io.BytesIO(base64.b64decode(png))) as image:
            return np.asarray(image.convert("RGB"), dtype=float) / 255.0

    def complaints(self) -> list[str]:
        """Errors of scripts, and requests that went elsewhere."""
        found = []
        self.run("0")
        for event in self.events:
            kind, about = event.get("method", ""), event.get("params", {})
            if kind == "Runtime.exceptionThrown":
                found.append(str(about["exceptionDetails"].get("exception", about)))
            if kind == "Log.entryAdded" and about["entry"]["level"] == "error":
                found.append(about["entry"]["text"])
            if kind == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
                found.append(str(about["args"]))
            if kind == "Network.requestWillBeSent":
                url = about["request"]["url"]
                if not url.startswith(("file:", "data:", "blob:", "about:")):
                    found.append(url)
        return found

    def close(self) -> None:
        with contextlib.suppress(AssertionError, OSError):
            self.ask("Browser.close")
        os.close(self._tell)
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._hear)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"none of the browsers {', '.join(BROWSERS)} is installed")
    browser = Browser(program, tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


def test_it_plays_pauses_and_scrubs(browser: Browser, overlay: Path) -> None:
    browser.open(overlay)
    browser.until("document.body.dataset.state === 'playing' && replay.time() > 0.1")
    first = browser.run("replay.time()")
    browser.until(f"replay.time() > {first}")
    browser.press(" ")
    assert browser.run("document.body.dataset.state") == "paused"
    held = browser.run("replay.time()")
    time.sleep(0.1)
    assert browser.run("replay.time()") == held
    assert f"{held:.3f}" in browser.run("document.getElementById('clock').textContent")

    box = browser.box("#time")  # the thumb's centre runs from half its width to half its width
    browser.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    middle = browser.run("replay.time()")
    assert middle == pytest.approx(END / 2, abs=0.01)
    browser.press("ArrowRight")
    assert browser.run("replay.time()") == pytest.approx(middle + 1 / 30, abs=1e-9)
    browser.press("End")
    assert browser.run("replay.time()") == END

    play = browser.box("#play")
    browser.click(play["x"] + 10, play["y"] + 10)
    browser.until("document.body.dataset.state === 'playing' && replay.time() < 2.1")
    assert browser.complaints() == []


def test_it_plays_inside_a_notebook(browser: Browser, pair: list[rg.Trajectory], tmp_path: Path) -> None:
    notebook = tmp_path / "notebook.html"
    notebook.write_text(
        f"<body data-state=''>{rg.replay(pair, labels=LABELS)._repr_html_()}", encoding="utf-8"
    )
    browser.open(notebook)
    inner = "document.querySelector('iframe').contentWindow"
    browser.until(f"{inner}.document.body.dataset.state === 'playing' && {inner}.replay.time() > 0.1")
    assert browser.run(f"{inner}.document.documentElement.scrollHeight") <= 620  # no second scroll bar
    assert browser.complaints() == []


def test_a_scale_a_grid_and_a_camera_that_follows(browser: Browser, overlay: Path, tmp_path: Path) -> None:
    """The bar is as long as it says; a planar motion has no grid at first; what is followed stays."""
    browser.open(overlay, "t=0&paused")
    browser.draw()
    bar, text = (
        browser.box("#scale i")["width"],
        browser.run("document.querySelector('#scale span').textContent"),
    )
    number, unit = text.split()
    length = float(number) * {"m": 1.0, "mm": 1e-3}[unit]
    points = "[new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, 1, 0)]"
    ends = browser.run(f"{points}.map(p => replay.scene.project(p, replay.scene.views()[0]).x)")
    assert bar / length == pytest.approx(abs(ends[1] - ends[0]), rel=0.02) and 50 < bar < 170
    assert browser.run("replay.around.grid.visible") is False
    flying = rg.load("walker", base="free")
    page = rg.replay(rg.simulate(flying, duration=1.0), tmp_path / "walker.html")
    browser.open(page, "t=0&paused")
    assert browser.run("replay.around.grid.visible") is True
    for followed in (False, True):
        browser.run(f"replay.seek(0); document.getElementById('follow').checked = {str(followed).lower()}")
        before = browser.run("replay.scene.viewer.controls.target.z")
        browser.run("replay.seek(1)")
        fallen = before - browser.run("replay.scene.viewer.controls.target.z")
        assert fallen == pytest.approx(4.9 * followed, abs=0.5 * followed)
    assert browser.complaints() == []


def test_a_video_of_the_motion_is_saved(browser: Browser, tmp_path: Path) -> None:
    page = rg.replay(
        rg.simulate(rg.load("rhombus"), duration=1.0, step=1e-2), tmp_path / "short.html", speed=1.0
    )
    browser.open(page, "t=0&paused")
    assert browser.run("document.getElementById('record').hidden") is False
    assert browser.run("replay.record()") > 1000
    assert browser.run("replay.time()") == pytest.approx(1.0)
    assert browser.complaints() == []


def test_speed_is_that_of_the_clock(browser: Browser, overlay: Path) -> None:
    browser.open(overlay, "t=0&paused")
    script = """(async () => {
        const select = document.getElementById("speed");
        select.value = [...select.options].find((o) => o.textContent === "0.25×").value;
        select.dispatchEvent(new Event("change"));
        replay.play();
        // the time that a picture is drawn for, which the page's own clock goes by too
        const frame = () => new Promise(requestAnimationFrame);
        await frame(); await frame();
        const from = [await frame(), replay.time()];
        let now = from[0], passed = 0;
        while (now - from[0] < 500) {
            const next = await frame();
            passed += Math.min(next - now, 500); // after a longer pause it goes on from where it was
            now = next;
        }
        return (replay.time() - from[1]) / passed * 1000;
    })()"""
    assert browser.run(script) == pytest.approx(0.25, rel=1e-6)


def test_a_fragment_opens_it_at_a_time_to_the_digit(browser: Browser, overlay: Path) -> None:
    browser.open(overlay, "t=1.2345678901234&paused")
    assert browser.run("replay.time()") == 1.2345678901234
    assert browser.run("document.body.dataset.state") == "paused"
    assert browser.complaints() == []


def test_between_pictures_the_motion_is_followed(
    browser: Browser, overlay: Path, pair: list[rg.Trajectory]
) -> None:
    """Catmull and Rom's cubic errs by h⁴/48 · |d⁴x/dt⁴|: 1e-3 m at 1/30 s and 7 rad/s on 2 m."""
    run = data_of(overlay.read_text(encoding="utf-8"))["runs"][0]
    point = run["trails"][0]["point"]
    browser.open(overlay, "t=0&paused")
    for i in (100, 308, 617, 925):  # outputs that are no pictures: multiples of 2 ms but not of 1/30 s
        t, y = pair[0].t[i], pair[0].q[i, 0]
        script = f"[...replay.scene.drawings[0].motion.at({t}).slice({3 * point}, {3 * point + 3})]"
        np.testing.assert_allclose(browser.run(script), [0.0, np.cos(y) + 1.0, np.sin(y)], atol=1e-3)


def test_another_time_is_another_picture_and_the_same_time_the_same(browser: Browser, overlay: Path) -> None:
    browser.open(overlay, "t=0.5&paused")
    browser.draw()
    early = browser.picture()
    browser.run("replay.seek(1.5)")
    browser.draw()
    late = browser.picture()
    browser.run("replay.seek(0.5)")
    browser.draw()
    again = browser.picture()

    def changed(one: np.ndarray, other: np.ndarray) -> float:
        return float((np.abs(one - other).max(axis=2) > 0.1).mean())

    assert changed(early, late) > 0.01  # two linkages of some per cent of the picture each
    assert changed(early, again) == 0.0
    coloured = np.ptp(late, axis=2) > 0.3
    assert coloured.mean() > 0.01  # links are there at all, not a blank pane


@pytest.mark.parametrize("size", SIZES, ids=["desktop", "phone"])
@pytest.mark.parametrize("layout", ["overlay", "side by side"])
def test_everything_fits_and_no_label_covers_another(
    browser: Browser, pair: list[rg.Trajectory], tmp_path: Path, layout: Any, size: tuple[int, int]
) -> None:
    page = rg.replay(pair, tmp_path / "page.html", layout=layout, labels=LABELS)
    browser.open(page, "t=0&paused", size)
    assert browser.run("document.documentElement.scrollWidth") <= size[0]
    pane = browser.box("#pane")
    assert pane["height"] >= 0.4 * size[1]
    for place in browser.run(
        "replay.scene.views().flatMap((tile) => replay.scene.cloud.map((p) => {"
        "  const at = replay.scene.project(p, tile);"
        "  const below = replay.scene.pane.clientHeight - tile.y - at.y;"
        "  return [(at.x - tile.x) / tile.w, below / tile.h];"
        "}))"
    ):
        assert 0.0 < place[0] < 1.0 and 0.0 < place[1] < 1.0
    for crossing in pair[0].crossings:
        browser.run(f"replay.seek({crossing.time})")
        browser.draw()
        boxes = browser.run(
            "[...document.querySelectorAll('#labels .mark, #labels .caption, #view-buttons')]"
            ".filter((e) => getComputedStyle(e).visibility === 'visible')"
            ".map((e) => e.getBoundingClientRect().toJSON())"
        )
        shown = browser.run("document.querySelector('#labels .mark.now').textContent")
        assert f"t = {crossing.time:.3f} s" in shown and "q1 = " in shown and "transversal" in shown
        for a, b in itertools.combinations(boxes, 2):
            apart = (
                a["right"] <= b["left"] or b["right"] <= a["left"]
                or a["bottom"] <= b["top"] or b["bottom"] <= a["top"]
            )  # fmt: skip
            assert apart, (a, b)
        for box in boxes:
            assert box["left"] >= pane["left"] and box["right"] <= pane["right"]
            assert box["top"] >= pane["top"] and box["bottom"] <= pane["bottom"]
    assert browser.complaints() == []


def test_crossings_on_the_time_line_lead_there(
    browser: Browser, overlay: Path, pair: list[rg.Trajectory]
) -> None:
    browser.open(overlay, "t=0&paused")
    assert browser.run("document.querySelectorAll('#ticks span').length") == len(pair[0].crossings)
    browser.run("document.querySelectorAll('#crossing-list button')[2].click()")
    assert browser.run("replay.time()") == pair[0].crossings[2].time
    browser.press("n")
    assert browser.run("replay.time()") == pair[0].crossings[3].time
    browser.press("p")
    browser.press("p")
    assert browser.run("replay.time()") == pair[0].crossings[1].time


@pytest.mark.parametrize("name", ["bricard", "stewart", "slider_crank", "flyball", "delta", "walker"])
def test_every_kind_of_joint_is_drawn_without_an_error(browser: Browser, tmp_path: Path, name: str) -> None:
    mechanism = rg.load(name)
    t = np.linspace(0.0, 1.0, 11)
    run = rg.Trajectory(
        mechanism, t, np.repeat(mechanism.home[None], 11, axis=0), np.zeros((11, mechanism.nv))
    )
    browser.open(rg.replay(run, tmp_path / "page.html"), "t=0.5&paused")
    browser.draw()
    assert (np.ptp(browser.picture(), axis=2) > 0.25).mean() > 0.002
    assert browser.complaints() == []


def test_shapes_are_where_pinocchio_puts_them(browser: Browser, tmp_path: Path) -> None:
    mechanism = rg.load("bricard")
    run = rg.simulate(mechanism, duration=0.5, step=1e-2)
    rng = np.random.default_rng(5)
    visual = pin.GeometryModel()
    for joint in range(mechanism.model.njoints):
        at = pin.SE3(pin.exp3(rng.normal(size=3)), 0.1 * rng.normal(size=3))
        visual.addGeometryObject(pin.GeometryObject(f"box{joint}", joint, at, coal.Box(0.3, 0.2, 0.1)))
    page = rg.replay(run, tmp_path / "page.html", visual=visual, speed=0.3)  # a picture each 10 ms
    i = 25
    browser.open(page, f"t={run.t[i]}&paused")
    data = mechanism.model.createData()
    pin.forwardKinematics(mechanism.model, data, run.q[i])
    drawn = browser.run("replay.scene.drawings[0].meshes.map((mesh) => mesh.made.matrix.elements)")
    for matrix, shape in zip(drawn, visual.geometryObjects, strict=True):
        expected = (data.oMi[shape.parentJoint] * shape.placement).homogeneous
        np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, expected, atol=1e-5)  # 32-bit floats
    assert browser.complaints() == []


def test_an_error_of_the_page_is_shown_on_it(browser: Browser, overlay: Path) -> None:
    browser.open(overlay, "t=0&paused")
    assert browser.run("document.getElementById('errors').hidden")
    browser.run("setTimeout(() => { throw new Error('a wheel came off'); }, 0); 0")
    browser.until("!document.getElementById('errors').hidden")
    assert "a wheel came off" in browser.run("document.getElementById('errors').textContent")
    assert any("a wheel came off" in c for c in browser.complaints())
