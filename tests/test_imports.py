"""Imports go one way, from later rooms to earlier ones; heavy packages wait until needed."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "steelyard"
ORDER = (
    ("errors", "arrays", "parameters", "motion", "progress", "files"),
    ("search",),
    ("robot",),
    ("kernel",),
    ("terms",),
    ("scan",),
    ("model",),
    ("measurement", "formats"),
    ("regression",),
    ("excitation",),
    ("estimation",),
    ("validation",),
    ("diagnosis",),
    ("application",),
    ("virtual",),
    ("report",),
    ("cli", "__main__"),
)
RANK = {room: rank for rank, rooms in enumerate(ORDER) for room in rooms}
ONE_FILE = {
    "clarabel": {"estimation/conic.py"},
    "pymoo": {"search/genetic.py"},
    "cma": {"search/cma_es.py"},
    "llvmlite": {"kernel/machine.py"},
    "plotly": {"report/html.py"},
    "jinja2": {"report/html.py"},
    "viser": {"report/replay.py"},
    "pydantic": {
        "robot/excitation_schema.py",
        "robot/motion_schema.py",
        "robot/schema.py",
        "robot/section.py",
        "robot/toml_check.py",
    },
    "mujoco": {
        "excitation/mujoco_geometry.py",
        "robot/mjcf.py",
        "robot/mjcf_assets.py",
        "robot/mjcf_efforts.py",
        "robot/mjcf_equalities.py",
        "robot/mjcf_passive.py",
        "virtual/mujoco_model.py",
    },
    "h5py": {"formats/hdf5_child.py", "formats/writers.py"},
    "tomlkit": {"robot/edits.py"},
    "mcap": {"formats/mcap.py"},
    "rosbags": {"formats/message_types.py"},
    "zstandard": {"formats/byte_streams.py"},
    "lz4": {"formats/byte_streams.py"},
}


def imports(path: Path) -> Iterator[str]:
    """Full names of all modules that a file imports, lazily or not, but not for types only."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            if node.module == "steelyard":
                yield from (f"steelyard.{alias.name}" for alias in node.names)


FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_one_way(path: Path) -> None:
    room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    for name in imports(path):
        if name.startswith("steelyard.") and name != "steelyard.__version__":
            other = name.split(".")[1]
            assert RANK[other] <= RANK[room], f"{room} imports {name}, which comes later"


@pytest.mark.parametrize("package", list(ONE_FILE))
def test_foreign_packages_stay_in_their_files(package: str) -> None:
    users = {
        str(path.relative_to(PACKAGE).as_posix())
        for path in FILES
        if any(name.split(".")[0] == package for name in imports(path))
    }
    assert users == ONE_FILE[package]


@pytest.mark.parametrize("module", ["steelyard", "steelyard.cli.app"])
def test_a_start_loads_nothing_heavy(module: str) -> None:
    heavy = ("llvmlite", "polars", "mujoco", "plotly", "scipy", "pydantic")
    code = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
