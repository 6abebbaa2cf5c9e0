"""The app as a process, and a real browser that clicks in it."""

import http.client
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from browser import chromium

FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""So that it draws in space without a graphics card."""

PATIENCE_MS = 120_000.0  # for whatever a page waits for


@dataclass(eq=False)
class Server:
    """A running `steelyard app`."""

    folder: Path
    process: subprocess.Popen[str]
    address: str  # with the token
    cookie: str = ""

    @property
    def port(self) -> int:
        """Of its address."""
        return urlsplit(self.address).port or 0

    @property
    def origin(self) -> str:
        """Of its pages."""
        return f"http://127.0.0.1:{self.port}"

    def ask(
        self, method: str, path: str, body: bytes | None = None, headers: Mapping[str, str] = {}
    ) -> tuple[int, bytes]:
        """Status and content of an answer; headers are sent as given, beside Host if it lacks."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(method, path, skip_host="Host" in headers)
            for name, value in headers.items():
                connection.putheader(name, value)
            if body is not None and "Content-Length" not in headers:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            answer = connection.getresponse()
            if found := answer.getheader("Set-Cookie"):
                self.cookie = found.split(";")[0]
            return answer.status, answer.read()
        finally:
            connection.close()

    def enter(self) -> None:
        """Use the token, for a session of `own`."""
        status, _ = self.ask("GET", self.address.removeprefix(self.origin))
        assert status == 303

    def own(self, method: str, path: str, body: bytes | None = None) -> tuple[int, bytes]:
        """The answer to what a page of the app itself asks."""
        return self.ask(method, path, body, {"Cookie": self.cookie, "Origin": self.origin})

    def act(self, path: str, **values: Any) -> tuple[int, bytes]:
        """The answer to a form."""
        return self.own("POST", path, json.dumps(values).encode())

    def kill(self) -> None:
        """End it as `kill -9` does."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def serving(folder: Path) -> Iterator[Server]:
    """`steelyard app FOLDER --no-browser`, until the block ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "steelyard", "app", str(folder), "--no-browser"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    try:
        yield Server(folder, process, process.stdout.readline().strip())
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        process.stdout.close()


@dataclass(eq=False)
class Visitor:
    """A page in a browser, and what went wrong in it."""

    page: Any
    wrong: list[str] = field(default_factory=list)

    def click(self, name: str, role: str = "button", exact: bool = True) -> None:
        """Click what has a name."""
        self.page.get_by_role(role, name=name, exact=exact).first.click()

    def step(self, name: str) -> None:
        """Go to a step by the list of steps."""
        self.page.locator("#steps").get_by_role("link", name=name).click()

    def drop(self, kind: str, *files: Path) -> None:
        """Choose files for `robot` or `logs`."""
        self.page.set_input_files(f"#files-{kind}", [str(file) for file in files])

    def see(self, what: str) -> Any:
        """Wait until something is there, by its selector."""
        return self.page.wait_for_selector(what)

    def idle(self) -> None:
        """Wait until no work is running."""
        self.page.wait_for_selector("body:not([data-busy])")


@contextmanager
def visiting(
    address: str, width: int = 1400, dark: bool = False, height: int = 900
) -> Iterator[Visitor]:
    """A browser at an address."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        page = browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme="dark" if dark else "light",
            reduced_motion="reduce",
        )
        page.set_default_timeout(PATIENCE_MS)
        visitor = Visitor(page)
        page.on("pageerror", lambda error: visitor.wrong.append(str(error)))
        page.on(
            "console",
            lambda said: visitor.wrong.append(said.text) if said.type == "error" else None,
        )
        page.goto(address)
        yield visitor
        browser.close()
