"""Imports go one way, from later rooms to earlier ones; heavy packages wait until needed."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "steelyard"
ORDER = (
    (
        "errors",
        "extras",
        "processes",
        "arguments",
        "arrays",
        "parameters",
        "motion",
        "progress",
        "files",
        "suggest",
    ),
    ("robot",),
    ("robot_file",),
    ("kernel",),
    ("terms",),
    ("dynamics",),
    ("model",),
    ("formats",),
    ("measurement",),
    ("regression",),
    ("excitation",),
    ("estimation",),
    ("validation",),
    ("diagnosis",),
    ("application",),
    ("control",),
    ("virtual",),
    ("report",),
    ("identification",),
    ("cli", "__main__"),
)
RANK = {room: rank for rank, rooms in enumerate(ORDER) for room in rooms}
ONE_FILE = {
    "clarabel": {"estimation/consistent/conic.py"},
    "pymoo": {"excitation/search/genetic.py"},
    "cma": {"excitation/search/cma_es.py"},
    "llvmlite": {"kernel/native/machine.py"},
    "jinja2": {"report/html.py"},
    "viser": {"report/replay/replay.py"},
    "pydantic": {
        "robot_file/excitation_sections.py",
        "robot_file/motion_sections.py",
        "robot_file/sections.py",
        "robot_file/section.py",
        "robot_file/toml_check.py",
    },
    "mujoco": {
        "excitation/shapes/mujoco_geometry.py",
        "robot/mjcf/read.py",
        "robot/mjcf/assets.py",
        "robot/mjcf/efforts.py",
        "robot/mjcf/equalities.py",
        "robot/mjcf/passive_forces.py",
        "virtual/mujoco_model.py",
    },
    "h5py": {"formats/arrays/hdf5_child.py", "formats/writers.py"},
    "tomlkit": {"robot_file/edits.py"},
    "mcap": {"formats/messages/mcap.py"},
    "rosbags": {"formats/messages/message_types.py"},
    "zstandard": {"formats/messages/byte_streams.py"},
    "lz4": {"formats/messages/byte_streams.py"},
}


@cache
def imports(path: Path, *, types: bool = False) -> tuple[str, ...]:
    """Full names of all modules that a file imports, lazily or not; with `types`, for types too."""
    return tuple(_imported(path, types))


def _imported(path: Path, types: bool) -> Iterator[str]:
    nodes = _nodes(path)
    typing_only = {
        id(inner)
        for node in nodes
        if isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in nodes:
        if not types and id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            if (PACKAGE.parent / node.module.replace(".", "/")).is_dir():
                yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    """The imports of a file, wherever they stand, and its branches."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.If, ast.Import, ast.ImportFrom)
    return tuple(node for node in ast.walk(tree) if isinstance(node, kinds))


FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def test_imports_go_one_way() -> None:
    backward = [
        f"{path.relative_to(PACKAGE)} imports {name}, which comes later"
        for path in FILES
        for name in imports(path)
        if name.startswith("steelyard.") and name != "steelyard.__version__"
        if RANK[name.split(".")[1]] > RANK[path.relative_to(PACKAGE).parts[0].removesuffix(".py")]
    ]
    assert len(FILES) > 400 and backward == []


def test_no_room_imports_in_a_circle() -> None:
    """Sub-rooms, and files beside them, can be put in an order; imports for types count too."""
    graph: dict[str, set[str]] = {}
    for path in FILES:
        own = _place(".".join(path.relative_to(PACKAGE).with_suffix("").parts))
        for name in imports(path, types=True):
            other = _place(name.removeprefix("steelyard."))
            if name.startswith("steelyard.") and other not in ("", own):
                graph.setdefault(own, set()).add(other)
    TopologicalSorter(graph).prepare()


def _place(module: str) -> str:
    """The sub-room of a module; the module itself where it lies beside sub-rooms, or alone."""
    folder = PACKAGE.joinpath(*module.split("."))
    if folder.is_dir():
        return ""
    if not folder.with_suffix(".py").exists():
        return _place(module.rpartition(".")[0])
    beside = any(child.is_dir() and child.name[0] != "_" for child in folder.parent.iterdir())
    return module if beside else ".".join(module.split(".")[:-1])


def test_the_map_lists_every_room_in_the_order_of_imports() -> None:
    text = (PACKAGE.parent.parent / "docs/rooms.md").read_text(encoding="utf-8")
    listed = [
        name.rstrip("/")
        for line in text.splitlines()
        if line.startswith("| `")
        for name in re.findall(r"`([\w/.]+)`", line.split("|")[1])
    ]
    rooms = [name for name in listed if not name.endswith(".py")]
    parts = [p for p in PACKAGE.rglob("*") if (p / "__init__.py").exists()]
    subs = {p.relative_to(PACKAGE).as_posix() for p in parts}
    assert set(rooms) == {s for s in subs if s != "kernel"}
    assert {n for n in listed if n.endswith(".py")} == {
        p.name for p in PACKAGE.glob("*.py") if p.name[:2] != "__"
    }
    for path in FILES:
        own = path.parent.relative_to(PACKAGE).as_posix()
        for name in imports(path, types=True):
            other = _place(name.removeprefix("steelyard.")).replace(".", "/")
            if own in rooms and other in rooms and own != other:
                assert rooms.index(other) < rooms.index(own) or own in other or other in own, (
                    f"{own} imports {name}, which stands below it in docs/rooms.md"
                )
    begin = re.findall(r"^\| `([\w/]+)/` \|[^|]*\|([^|]*)\|", text, re.M)
    for room, files in begin:
        for file in re.findall(r"`([\w.]+)`", files):
            assert (PACKAGE / room / file).exists(), f"{room}/{file}"


@pytest.mark.parametrize("package", list(ONE_FILE))
def test_foreign_packages_stay_in_their_files(package: str) -> None:
    users = {
        str(path.relative_to(PACKAGE).as_posix())
        for path in FILES
        if any(name.split(".")[0] == package for name in imports(path))
    }
    assert users == ONE_FILE[package]


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("steelyard", ("llvmlite", "polars", "mujoco", "scipy", "pydantic")),
        ("steelyard.cli.app", ("llvmlite", "polars", "mujoco", "scipy", "pydantic")),
        ("steelyard.identify.scores", ("llvmlite", "polars", "mujoco")),
    ],
)
def test_a_start_loads_nothing_heavy(module: str, heavy: tuple[str, ...]) -> None:
    code = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
