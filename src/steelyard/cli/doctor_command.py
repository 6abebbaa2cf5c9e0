"""`steelyard doctor`: what is installed, what is cached, and where steelyard can write."""

import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import typer

from steelyard.cli.commands_from_functions import from_function
from steelyard.cli.shared_by_commands import print_json, print_lines

EXTRA_PACKAGES = {
    "app": "`steelyard app`",
    "polars": "logs in Parquet, results as data frames, CSV logs ten times faster",
    "population": "genetic search and CMA-ES in `excite` and `compare`",
    "replay": "`steelyard replay`",
}
"""Extras of the package that commands need, and what they are for."""


@dataclass(frozen=True)
class Line:
    """One thing that was examined."""

    name: str
    says: str
    ok: bool = True  # whether commands work with it
    fix: str = ""  # what to do if they do not, or what would add to them; empty if nothing
    optional: bool = False  # whether it is not there, and only some commands use it


@from_function()
def doctor(as_json: bool = False) -> None:
    """Print what is installed, what is cached, and where files can be written.

    The exit code is 1 if something is missing that commands need.

    Example: steelyard doctor
    """
    from rich.table import Table
    from rich.text import Text

    from steelyard.report.terminal import terminal

    found = list(examined())
    if as_json:
        print_json([asdict(line) for line in found])
    else:
        table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
        for line in found:
            words = Text(line.says, overflow="fold")
            if line.fix:
                words.append(f"\n{line.fix}", "cyan")
            mark = ("optional", "cyan") if line.optional else ("ok", "bold green")
            table.add_row(Text(*mark if line.ok else ("wrong", "bold red")), line.name, words)
        terminal().print(table)
        print_lines(summary(found))
    if not all(line.ok for line in found):
        raise typer.Exit(1)


def summary(found: Sequence[Line]) -> str:
    """What is missing, in one sentence."""
    wrong = [line.name for line in found if not line.ok]
    left = [line.name.removeprefix("extra ") for line in found if line.optional]
    extras = f"; optional extras that are not installed: {', '.join(left)}" * bool(left)
    if wrong:
        return f"To be corrected: {', '.join(wrong)}{extras}"
    return f"All that steelyard needs is there{extras}"


def examined() -> Iterator[Line]:
    """All lines, one after the other."""
    yield Line("steelyard", f"{version('steelyard')} in {Path(__file__).parents[1]}")
    yield Line("Python", f"{platform.python_version()}, {sys.executable}")
    yield Line("machine", f"{platform.platform()}, {os.cpu_count() or 1} cores")
    yield _packages()
    yield from (_packages(extra, use) for extra, use in EXTRA_PACKAGES.items())
    from steelyard.symbolic.native import compiler

    about = f"{compiler.version()} for {compiler.host()[0]}, {compiler.lanes()} lanes"
    yield Line("compiler", about)
    yield _cache()
    yield _writable("temporary files", Path(tempfile.gettempdir()), "set TMPDIR to another folder")
    yield _writable("this folder", Path.cwd(), "go to another folder, or name one with --output")


def _names(extra: str = "") -> list[str]:
    """Packages that steelyard needs on this version of Python, or that an extra adds."""
    found = []
    for line in requires("steelyard") or ():
        wanted = re.search(r"extra == ['\"](\w+)", line)
        name = re.match(r"[\w.-]+", line)
        bound = re.search(r"python_version (<|>=) ['\"]3\.(\d+)['\"]", line)
        here = not bound or (bound[1] == "<") == (sys.version_info < (3, int(bound[2])))
        if name and here and (wanted[1] if wanted else "") == extra:
            found.append(name[0])
    return found


def _packages(extra: str = "", use: str = "") -> Line:
    """What steelyard needs, or an extra adds: with versions, or what of it is missing."""
    name, there, missing = f"extra {extra}" if extra else "packages", [], []
    for package in _names(extra):
        try:
            there.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    if not missing:
        return Line(name, ", ".join(there) + f": {use}" * bool(extra))
    wanted = f'"steelyard[{extra}]"' if extra else " ".join(missing)
    fix = f"{sys.executable} -m pip install {wanted}"
    says = f"not installed: {use}" if extra else f"missing: {', '.join(missing)}"
    return Line(name, says, bool(extra), fix, bool(extra))


def _cache() -> Line:
    from steelyard.symbolic.native.cache import folder

    if os.environ.get("STEELYARD_CACHE") == "":
        return Line("cache", "off: STEELYARD_CACHE is empty, so every start compiles again")
    place = folder()
    if place is None:
        says = "no private folder could be made, so every start compiles again"
        return Line("cache", says, fix="set STEELYARD_CACHE to a folder that only you can write to")
    sizes = [file.stat().st_size for file in place.glob("*.kernel")]
    return Line("cache", f"{place}: {len(sizes)} programs, {sum(sizes) / 2**20:.1f} MiB")


def _writable(name: str, folder: Path, fix: str) -> Line:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return Line(name, f"{folder} can be written")
    except OSError as error:
        return Line(name, f"{folder} cannot be written: {error.strerror}", False, fix)
