"""The app as a process, and a real browser that clicks in it."""

import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from browser import chromium
from steelyard.app.jobs import Job, Work
from steelyard.app.step import Desk, fill
from steelyard.app.steps import named
from steelyard.app.work_process import finish
from steelyard.app.workspace import Workspace, opened
from steelyard.base.progress import silent

FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""So that it draws in space without a graphics card."""

PATIENCE_MS = 180_000.0  # for whatever a page waits for


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

    def jobs(self) -> dict[str, str]:
        """Keys of running works and their words, from the first event."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        connection.request("GET", "/events", headers={"Cookie": self.cookie})
        line = connection.getresponse().readline()
        connection.close()
        return {
            job["key"]: job["words"] for job in json.loads(line.removeprefix(b"data: "))["jobs"]
        }

    def running(self, words: str, most: float = 60.0) -> str:
        """The key of a work, once it runs; empty if it never does."""
        end = time.monotonic() + most
        while time.monotonic() < end:
            for key, said in self.jobs().items():
                if words in said:
                    return key
        return ""

    def idle(self, most: float = 120.0) -> bool:
        """Wait until no work runs; whether that comes."""
        end = time.monotonic() + most
        while self.jobs():
            if time.monotonic() > end:
                return False
        return True

    def kill(self) -> None:
        """End it as `kill -9` does."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def serving(folder: Path, stderr: int | None = None) -> Iterator[Server]:
    """`steelyard app FOLDER --no-browser`, until the block ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "steelyard", "app", str(folder), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=stderr,
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
def visiting(address: str) -> Iterator[Visitor]:
    """A browser at an address."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        context = browser.new_context(viewport={"width": 1400, "height": 900})
        context.set_default_timeout(PATIENCE_MS)
        visitor = another_tab(context, address)
        try:
            yield visitor
        except Exception:  # what was on the page tells why something was not
            print(visitor.page.url, visitor.page.locator("body").inner_text(), visitor.wrong)
            print(visitor.page.locator("#step").evaluate("one => one.outerHTML.slice(0, 200)"))
            raise
        finally:
            browser.close()


def another_tab(context: Any, address: str) -> Visitor:
    """A page of the same browser at an address."""
    visitor = Visitor(context.new_page())
    visitor.page.on("pageerror", lambda error: visitor.wrong.append(str(error)))
    visitor.page.on(
        "console", lambda said: visitor.wrong.append(said.text) if said.type == "error" else None
    )
    visitor.page.goto(address)
    return visitor


SERIOUS = ("serious", "critical")


def serious_faults(visitor: Visitor) -> list[str]:
    """What axe-core finds in a page, as serious or critical, with the first place of each."""
    from axe_playwright_python.sync_playwright import Axe

    answer = Axe().run(visitor.page).response
    assert answer["passes"], "axe-core has not run"
    serious = [one for one in answer["violations"] if one["impact"] in SERIOUS]
    return [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in serious]


URDF = """<robot name="small arm">
<link name="base"/>{links}
</robot>
"""

LINK = """
<link name="link{k}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{x} 0 0"/><geometry><box size="0.3 0.08 0.08"/></geometry></collision>
</link>
<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>
<origin xyz="{at}"/><axis xyz="{axis}"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="80"/></joint>"""

ROBOT = """[robot]
urdf = "arm.urdf"

[model]
terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]

[signals]
time = "time_s"
position = "q{}_rad"

[signals.effort]
columns = "tau{}_Nm"
kind = "joint_torque"
unit = "Nm"
"""


def simulated_arm(folder: Path) -> Path:
    """Write `arm.urdf`, three joints, and two logs of it, simulated from other motions.

    Columns are `time_s`, `q1` to `q3` [rad] and `tau1_Nm` to `tau3_Nm`.
    """
    import polars as pl

    import steelyard

    links = [
        LINK.format(k=1, x=0.02, mass=4.0, parent="base", at="0 0 0.3", axis="0 0 1"),
        LINK.format(k=2, x=0.2, mass=3.0, parent="link1", at="0.05 0 0.1", axis="0 1 0"),
        LINK.format(k=3, x=0.15, mass=1.5, parent="link2", at="0.4 0 0", axis="0 1 0"),
    ]
    (folder / "arm.urdf").write_text(URDF.format(links="".join(links)))
    with TemporaryDirectory() as name:
        there = Path(name)
        (there / "arm.urdf").write_bytes((folder / "arm.urdf").read_bytes())
        (there / "arm.toml").write_text(ROBOT)
        for log, seed in (("a", 3), ("b", 8)):
            truth = {"truth": there / "a" / "truth.json"} if log == "b" else {}
            given = {"period": 12.0, "seed": seed, **truth}
            steelyard.simulate(there / "arm.toml", there / log, **given)
            table = pl.read_csv(there / log / "log.csv")
            named = {f"q{k}_rad": f"q{k}" for k in (1, 2, 3)}
            kept = ["time_s", *named, *(f"tau{k}_Nm" for k in (1, 2, 3))]
            table.select(kept).rename(named).write_csv(folder / f"{log}.csv")
    return folder


class AtOnce:
    """Does works in this process, when they are begun."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.running: dict[str, Job] = {}
        self.latest: dict[str, str] = {}
        self.unwritten: dict[str, dict[str, str]] = {}
        self.begun: list[Work] = []

    def start(self, work: Work) -> str:
        """Do it."""
        key = work.key(self.workspace)
        self.begun.append(work)
        finish(work.function, work.given, self.workspace.derived(key), silent)
        return key


@dataclass(frozen=True)
class Finished(Desk):
    """A desk whose works are done at once."""

    @classmethod
    def on(cls, folder: Path) -> "Finished":
        """On a folder."""
        workspace = opened(folder)
        return cls(workspace, AtOnce(workspace))  # type: ignore[arg-type]

    def act(self, step: str, action: str, **form: Any) -> None:
        """What a form of a step does."""
        named(step).actions[action](self, form)

    def page(self, step: str) -> str:
        """What a step shows."""
        return fill(f"step_{step}.html", named(step).numbers(self))
