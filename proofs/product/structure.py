"""How the package is built: files and lines per room, modules that import most, time of a start.

`python -m proofs.product.structure SRC` prints the table of another checkout's `src/steelyard`.
"""

import ast
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TypeVar

from proofs.support.claims import Claim, main_of

PACKAGE = Path(__file__).parents[2] / "src" / "steelyard"
LARGEST = 24
"""Files that a folder may hold, so that its list is read at a glance."""

STARTS = 5

T = TypeVar("T")


def sizes(package: Path) -> list[tuple[str, int, int]]:
    """Folder, number of files, number of lines; the largest first."""
    files = [path for path in package.rglob("*.py") if path.name != "__init__.py"]
    lines = {path: len(path.read_text("utf-8").splitlines()) for path in files}
    count = Counter(path.parent for path in files)
    return [
        (
            folder.relative_to(package).as_posix(),
            n,
            sum(lines[f] for f in files if f.parent == folder),
        )
        for folder, n in count.most_common()
    ]


def fan_out(package: Path) -> list[tuple[str, int]]:
    """Modules of the package that each module imports, lazily or not; the most first."""
    found = []
    for path in package.rglob("*.py"):
        tree = ast.walk(ast.parse(path.read_text("utf-8")))
        names = {
            node.module
            for node in tree
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("steelyard.")
        }
        found.append((path.relative_to(package).as_posix(), len(names)))
    return sorted(found, key=lambda pair: -pair[1])


def fastest(*command: str) -> float:
    """Least time of some starts [s]."""
    times = []
    for _ in range(STARTS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *command], check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    return min(times)


def met(work: Callable[[], T]) -> tuple[T, int]:
    """What some work gives, and how many public functions and classes of the package it enters."""
    names: set[str] = set()

    def watch(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(str(PACKAGE)):
            parts = code.co_qualname.split(".")
            if not any(part.startswith(("_", "<")) for part in parts[:1] + parts[-1:]):
                names.add(f"{code.co_filename}:{code.co_qualname}")

    sys.setprofile(watch)
    try:
        return work(), len(names)
    finally:
        sys.setprofile(None)


def way() -> tuple[int, int, int]:
    """Names met from a log to information, to the estimate, and to the page."""
    from steelyard.estimate.information.gather import gather
    from steelyard.estimate.information.regressor import base_regressor
    from steelyard.estimate.least_squares.least_squares import WeightedLeastSquares
    from steelyard.identify.identify import identify
    from steelyard.identify.page.section_register import render
    from steelyard.logs.formats import open_log
    from steelyard.model.model import Model
    from steelyard.robot.file.robot_file import load_robot
    from steelyard.runs.prepare import prepare
    from steelyard.runs.recording import Recording
    from steelyard.simulate.demo import demo_runs

    with tempfile.TemporaryDirectory() as folder:
        files = demo_runs(Path(folder))
        robot = load_robot(files.robot)
        regressor, signals = base_regressor(Model(robot.robot)), robot.signals
        assert signals is not None
        information, first = met(
            lambda: gather(regressor, prepare(Recording(open_log(files.identification), signals)))
        )
        joint = information.scaled(signals.gains, robot.robot.effort_units)
        _, second = met(lambda: WeightedLeastSquares()(joint))
        found = identify(files.robot, files.identification, files.validation)
        _, third = met(lambda: render(found.content))
    return first, second, third


def main() -> list[Claim]:
    """Sizes and times."""
    rooms, hubs = sizes(PACKAGE), fan_out(PACKAGE)
    bare = fastest("-c", "pass")
    imported = fastest("-W", "error", "-c", "import steelyard") - bare
    helped = fastest("-m", "steelyard", "--help")
    total = sum(lines for _, _, lines in rooms)
    widest = ", ".join(f"{name} {count}" for name, count, _ in rooms[:5])
    most = ", ".join(f"{name} {count}" for name, count in hubs[:5])
    return [
        Claim(
            f"{len(rooms)} folders, files in the largest",
            widest,
            f"<= {LARGEST}",
            rooms[0][1] <= LARGEST,
        ),
        Claim("modules that import most modules", most, "reported", True),
        Claim("lines of the package", f"{total}", "reported", True),
        Claim(
            "public names entered from log to information, to estimate, to page",
            " ".join(map(str, way())),
            "reported",
            True,
        ),
        Claim(
            "import steelyard, beyond Python's start",
            f"{1e3 * imported:.0f} ms",
            "<= 60 ms",
            imported <= 0.06,
        ),
        Claim("steelyard --help", f"{helped:.2f} s", "<= 0.5 s", helped <= 0.5),
    ]


if __name__ == "__main__":
    if len(sys.argv) > 1:
        for name, count, lines in sizes(Path(sys.argv[1])):
            print(f"{name:<34} {count:4} files {lines:6} lines")
        for name, number in fan_out(Path(sys.argv[1]))[:5]:
            print(f"{name:<50} imports {number}")
        sys.exit()
    main_of(main)
