"""Headless Chromium, to see what a page is once it has run."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")


@dataclass(frozen=True)
class SampledInformation:
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


def look(program: str, file: Path, folder: Path) -> SampledInformation:
    """Open a page; the profile goes to `folder`."""
    done = subprocess.run(
        [program, *chromium_flags(folder), "--dump-dom", file.resolve().as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    lines = tuple(line for line in done.stderr.splitlines() if ":CONSOLE" in line)
    return SampledInformation(done.stdout, lines)


def chromium_flags(folder: Path) -> list[str]:
    return [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--enable-logging=stderr",
        "--v=0",
        "--virtual-time-budget=20000",
        f"--user-data-dir={folder / 'profile'}",
    ]
