"""Headless Chromium, to see what a page is once it has run."""

import base64
import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

NAMES = ("chromium", "chromium-browser", "google-chrome")

OF_THE_BROWSER = re.compile("WebGL|Canvas2D")
"""Messages about how Chromium draws in space, which are no errors of a page."""

WIDTH = 1400
"""Of the window [px]."""

AUDIT = Path(__file__).with_name("audit.js")
"""Functions that the checks of a page call in it."""


@dataclass(frozen=True)
class Rendered:
    """What the browser had after it ran a page."""

    dom: str
    console: tuple[str, ...]

    @property
    def drawn(self) -> int:
        """Plots with lines in them."""
        pieces = self.dom.split('class="plot js-plotly-plot"')[1:]
        return sum("main-svg" in piece and "scatterlayer" in piece for piece in pieces)

    @property
    def errors(self) -> list[str]:
        """What the page itself wrote down."""
        return re.findall(r'<body[^>]*data-errors="([^"]*)"', self.dom)


def chromium() -> str | None:
    """The browser's program, if there is one."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


def look(tab: "Tab", file: Path, script: str = "") -> Rendered:
    """Open a page, run a script in it if there is one, and read what it is then."""
    tab.show(WIDTH)
    tab.open(file)
    if script:
        tab.run(f"{{{script}}}")
        tab.run("drawn()")
    return Rendered(tab.run("document.documentElement.outerHTML"), tuple(tab.console))


def quiet_flags(folder: Path) -> list[str]:
    """Without a window, a network or a profile of somebody."""
    return [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--user-data-dir={folder / 'profile'}",
    ]


@dataclass(eq=False)
class Tab:
    """A page in a running Chromium, driven by the DevTools protocol over two pipes.

    Attributes:
        commands: Where commands go, each ended by a zero byte.
        answers: Where answers and events come from, likewise.
        session: Of the page.
        console: What was written to the console, errors included, in that order.
    """

    commands: IO[bytes]
    answers: IO[bytes]
    session: str = ""
    console: list[str] = field(default_factory=list)
    number: int = 0
    rest: bytes = b""

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Give a command, and wait for its answer; events on the way are noted."""
        self.number += 1
        message: dict[str, Any] = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.commands.write(json.dumps(message).encode() + b"\0")
        self.commands.flush()
        while (answer := self._next()).get("id") != self.number:
            self._note(answer)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self.rest:
            more = os.read(self.answers.fileno(), 1 << 16)
            assert more, "Chromium has ended"
            self.rest += more
        line, _, self.rest = self.rest.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        """Remember what is written to the console."""
        method, params = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.console.append(json.dumps(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled":
            self.console.append(" ".join(str(one.get("value")) for one in params["args"]))
        elif method == "Log.entryAdded" and not OF_THE_BROWSER.search(params["entry"]["text"]):
            self.console.append(params["entry"]["text"])

    def open(self, file: Path) -> None:
        """Load a file, with the functions of the checks, and wait until its pictures are drawn."""
        self.console.clear()
        self.send("Page.navigate", url=file.resolve().as_uri())
        self.run(
            "new Promise(done => document.readyState === 'complete' ? done() : "
            "addEventListener('load', done))"
        )
        self.run(AUDIT.read_text(encoding="utf-8"))
        self.run("drawn()")

    def show(self, width: int, dark: bool = False, height: int = 900) -> None:
        """Change the width of the window and the colours that the user prefers."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        wanted = {"color-scheme": "dark" if dark else "light", "reduced-motion": "reduce"}
        media = [{"name": f"prefers-{name}", "value": own} for name, own in wanted.items()]
        self.send("Emulation.setEmulatedMedia", features=media)

    def run(self, script: str) -> Any:
        """The value of a script in the page; a promise is awaited."""
        done = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def press(self, key: str) -> None:
        """Press and release a key."""
        code, text = {"Tab": (9, ""), "Enter": (13, "\r")}[key]
        own = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        self.send("Input.dispatchKeyEvent", type="keyDown", text=text, **own)
        self.send("Input.dispatchKeyEvent", type="keyUp", **own)

    def picture(self, file: Path, most: float = 20_000.0) -> None:
        """Save a picture of the page, or of its upper `most` pixels."""
        size = self.send("Page.getLayoutMetrics")["cssContentSize"]
        height = min(size["height"], most)
        clip = {"x": 0, "y": 0, "width": size["width"], "height": height, "scale": 1}
        shot = self.send("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        file.write_bytes(base64.b64decode(shot["data"]))


@contextmanager
def running(program: str, folder: Path) -> Iterator[Tab]:
    """A Chromium with one page; the profile goes to `folder`."""
    (reads, writes), (hears, says) = os.pipe(), os.pipe()
    process = subprocess.Popen(
        ["bash", "-c", f'exec "$@" 3<&{reads} 4>&{says}', "bash", program]
        + [*quiet_flags(folder), "--hide-scrollbars", "--remote-debugging-pipe", "about:blank"],
        pass_fds=(reads, says),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(reads)
    os.close(says)
    try:
        with open(writes, "wb") as commands, open(hears, "rb", buffering=0) as answers:
            tab = Tab(commands, answers)
            targets = tab.send("Target.getTargets")["targetInfos"]
            target = next(one["targetId"] for one in targets if one["type"] == "page")
            attached = tab.send("Target.attachToTarget", targetId=target, flatten=True)
            tab.session = attached["sessionId"]
            for domain in ("Page", "Runtime", "Log"):
                tab.send(f"{domain}.enable")
            yield tab
            tab.session = ""
            tab.send("Browser.close")
            process.wait(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
