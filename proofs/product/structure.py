"""How large the package is, what its functions reach, and how fast it starts.

`python -m proofs.product.structure SRC` prints the table of another checkout's `src/steelyard`.
"""

import ast
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeVar

from proofs.support.claims import Claim, main_of

TIMED = True  # nothing else may run beside it

PACKAGE = Path(__file__).parents[2] / "src" / "steelyard"
LARGEST = 24
"""Files that a folder may hold, so that its list is read at a glance."""

NEWER = ("steelyard.actuators", "steelyard.app", "steelyard.fleet")
"""Rooms that there were not when the bound of lines was set."""

MOST = {
    "lines of older rooms": 90_000,  # of the rooms that there were when it was set
    "files": 400,
    "files that health reaches": 270,
    "files that validate reaches": 270,
}

STARTS = 5

T = TypeVar("T")


@dataclass(frozen=True)
class Figures:
    """How large a checkout of the package is.

    Attributes:
        counts: Numbers by their names.
        largest: Files in the largest folders, with their names.
        fan_out: Modules that import most modules of the package, with their numbers.
    """

    counts: dict[str, int]
    largest: list[tuple[int, str]]
    fan_out: list[tuple[int, str]]


def measured(package: Path) -> Figures:
    """The figures of `src/steelyard` of a checkout."""
    files = {_module(package, path): path for path in package.rglob("*.py")}
    trees = {name: ast.parse(path.read_text("utf-8")) for name, path in files.items()}
    graph = {name: _imported(tree) & set(files) for name, tree in trees.items()}
    graph["steelyard"] = set()
    counts = Counter[str]()
    for name, path in files.items():
        lines, nodes = path.read_text("utf-8").splitlines(), list(ast.walk(trees[name]))
        texts = {n for node in nodes if _is_text(node) for n in _rows(node)}
        counts["lines"] += len(lines)
        counts["lines of older rooms"] += len(lines) * (not name.startswith(NEWER))
        counts["lines of docstrings"] += len(texts)
        counts["blank lines"] += sum(
            not line.strip() for n, line in enumerate(lines, 1) if n not in texts
        )
        counts["functions"] += sum(isinstance(node, ast.FunctionDef) for node in nodes)
        counts["classes"] += sum(isinstance(node, ast.ClassDef) for node in nodes)
        counts["numeric constants of modules"] += sum(map(_is_number, trees[name].body))
        counts["files"] += path.name != "__init__.py"
    counts["folders"] = len({path.parent for path in files.values()})
    for name, home in _homes(package).items():
        if name in ("health", "validate", "identify", "design_excitation"):
            counts[f"files that {name} reaches"] = len(_reached(graph, home))
    folders = Counter(str(p.parent.relative_to(package)) for p in files.values())
    return Figures(
        dict(counts),
        sorted(((n, folder) for folder, n in folders.items()), reverse=True)[:5],
        sorted(((len(names), name) for name, names in graph.items()), reverse=True)[:5],
    )


def _module(package: Path, path: Path) -> str:
    parts = ("steelyard", *path.relative_to(package).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


def _rows(node: ast.AST) -> range:
    return range(node.lineno, node.end_lineno + 1)  # type: ignore[attr-defined]


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _is_number(node: ast.stmt) -> bool:
    """Whether a statement of a module names a number, or an expression of numbers."""
    value = getattr(node, "value", None)
    if not isinstance(node, ast.Assign | ast.AnnAssign) or value is None:
        return False
    parts = list(ast.walk(value))
    numbers = [part for part in parts if isinstance(part, ast.Constant)]
    rest = (ast.operator, ast.unaryop, ast.Load, ast.BinOp, ast.UnaryOp, ast.Name, ast.Constant)
    return (
        all(isinstance(part, rest) for part in parts)
        and bool(numbers)
        and all(isinstance(number.value, int | float) for number in numbers)
    )


def _imported(tree: ast.Module) -> set[str]:
    """Names of modules that a module imports, lazily or not; those for types alone left out."""
    typed = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and id(node) not in typed:
            found |= {str(node.module)} | {f"{node.module}.{name.name}" for name in node.names}
    return found - {"steelyard"}


def _homes(package: Path) -> dict[str, str]:
    """Modules of the public names: from the stub, or from the table of older checkouts."""
    stub = package / "__init__.pyi"
    if stub.exists():
        text = stub.read_text("utf-8")
        return {name: home for home, name in re.findall(r"^from (\S+) import (\w+)", text, re.M)}
    table = re.findall(r'^    "(\w+)": "([\w.]+)",$', (package / "__init__.py").read_text(), re.M)
    return {name: f"steelyard.{home}" for name, home in table}


def _reached(graph: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += graph[name]
    return seen


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
    from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
    from steelyard.estimate.information.gather import gather
    from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
    from steelyard.identify.identify import identify
    from steelyard.identify.scores_and_model_report import render
    from steelyard.logs.formats import open_log
    from steelyard.model.model import Model
    from steelyard.robot.file.robot_file import load_robot
    from steelyard.runs.prepare import prepare
    from steelyard.runs.recording import Recording
    from steelyard.simulate.simulate import demo_runs

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
    figures = measured(PACKAGE)
    bare = fastest("-c", "pass")
    imported = fastest("-W", "error", "-c", "import steelyard") - bare
    helped = fastest("-m", "steelyard", "--help")
    bounded = [
        Claim(name, f"{figures.counts[name]}", f"<= {most}", figures.counts[name] <= most)
        for name, most in MOST.items()
    ]
    told = [
        Claim(name, f"{count}", "reported", True)
        for name, count in figures.counts.items()
        if name not in MOST
    ]
    largest = ", ".join(f"{folder} {n}" for n, folder in figures.largest)
    widest = ", ".join(f"{name.removeprefix('steelyard.')} {n}" for n, name in figures.fan_out)
    ways = " ".join(map(str, way()))
    return [
        *bounded,
        *told,
        Claim(
            "files of the largest folders",
            largest,
            f"<= {LARGEST}",
            figures.largest[0][0] <= LARGEST,
        ),
        Claim("modules that import most modules", widest, "reported", True),
        Claim(
            "public names entered from log to information, to estimate, to page",
            ways,
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
        other = measured(Path(sys.argv[1]))
        for name, count in measured(PACKAGE).counts.items():
            print(f"{name:<34} {other.counts.get(name, 0):7} {count:7}")
        print("imports most modules", other.fan_out, measured(PACKAGE).fan_out, sep="\n")
    else:
        main_of(main)
