"""Imports go one way, from later rooms to earlier ones; heavy packages wait until needed."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "steelyard"
SCRIPTS = ("proofs", "benchmarks", "studies", "tools")
ORDER = (
    "base",
    "report",
    "symbolic",
    "robot",
    "model",
    "terms",
    "logs",
    "runs",
    "estimate",
    "check",
    "identify",
    "actuators",
    "excite",
    "uses",
    "fleet",
    "export",
    "simulate",
    "app",
    "cli",
    "__main__",
)
RANK = {room: rank for rank, room in enumerate(ORDER)}
ONE_FILE = {
    "clarabel": {"estimate/consistent/conic_solver_and_scaled_parameters.py"},
    "pymoo": {"excite/search/search_methods.py"},
    "cma": {"excite/search/search_methods.py"},
    "llvmlite": {"symbolic/native/compiler.py"},
    "jinja2": {"base/templates.py"},
    "starlette": {"app/answers.py"},
    "uvicorn": {"app/server.py"},
    "viser": {"excite/page/browser_replay.py"},
    "pydantic": {
        "robot/file/excitation_sections.py",
        "robot/file/sections.py",
        "robot/file/toml_schema.py",
    },
    "mujoco": {
        "excite/collision/mjcf_geoms_and_solid_distances.py",
        "robot/models/mjcf.py",
        "robot/models/mjcf_equalities_and_forces.py",
        "simulate/mujoco_model.py",
    },
    "h5py": {"logs/formats.py", "logs/hdf5_reading_process.py"},
    "tomlkit": {"robot/file/toml_edits.py"},
    "mcap": {"logs/messages/mcap_and_ros1_bag.py"},
    "rosbags": {"logs/messages/containers_and_decoding.py"},
    "zstandard": {"logs/messages/decompression.py"},
    "dask": {"base/workers.py"},
    "distributed": {"base/workers.py"},
    "fsspec": {"logs/files_and_urls.py"},
    "lz4": {"logs/messages/decompression.py"},
}


@cache
def imports(path: Path, *, types: bool = False) -> tuple[str, ...]:
    """Full names of all modules that a file imports, lazily or not; with `types`, for types too."""
    return tuple(_imported(path, types))


def _imported(path: Path, types: bool) -> Iterator[str]:
    nodes = _read(path)[1]
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
def _read(path: Path) -> tuple[str | None, tuple[ast.AST, ...]]:
    """The docstring of a file; its imports, wherever they stand, and its branches."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.If, ast.Import, ast.ImportFrom)
    return ast.get_docstring(tree), tuple(n for n in ast.walk(tree) if isinstance(n, kinds))


FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


@pytest.mark.slow
def test_imports_go_one_way() -> None:
    backward = [
        f"{path.relative_to(PACKAGE)} imports {name}, which comes later"
        for path in FILES
        for name in imports(path)
        if name.startswith("steelyard.") and name != "steelyard.__version__"
        if RANK[name.split(".")[1]] > RANK[path.relative_to(PACKAGE).parts[0].removesuffix(".py")]
    ]
    assert len(FILES) > 250 and backward == []


def test_no_file_imports_in_a_circle() -> None:
    """Files can be put in an order, imports inside of functions counted."""
    modules = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts) for p in FILES}
    TopologicalSorter(
        {
            ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): modules
            & set(imports(path))
            for path in FILES
        }
    ).prepare()


def test_the_map_lists_every_room_in_the_order_of_imports() -> None:
    text = (PACKAGE.parent.parent / "docs/rooms.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 45, "a person reads the map once"
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| `")]
    rooms = {row[1].strip(" `/"): row for row in rows}
    folders = [p for p in PACKAGE.rglob("*") if (p / "__init__.py").exists()]
    assert tuple(rooms) == tuple(name for name in ORDER if (PACKAGE / name).is_dir())
    for room, row in rooms.items():
        subs = {p.name for p in folders if p.parent == PACKAGE / room}
        assert set(re.findall(r"`(\w+)/`", row[2])) == subs, room
        for file in re.findall(r"`([\w/]+\.py)`", row[3]):
            assert (PACKAGE / room / file).exists(), f"{room}/{file}"


def test_rooms_are_two_folders_deep_and_say_what_they_hold() -> None:
    for path in PACKAGE.rglob("*.py"):
        assert len(path.relative_to(PACKAGE).parts) <= 3, path
        assert _read(path)[0], f"{path}: no docstring"


@pytest.mark.parametrize("package", list(ONE_FILE))
def test_foreign_packages_stay_in_their_files(package: str) -> None:
    users = {
        str(path.relative_to(PACKAGE).as_posix())
        for path in FILES
        if any(name.split(".")[0] == package for name in imports(path))
    }
    assert users == ONE_FILE[package]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("steelyard", ("llvmlite", "polars", "mujoco", "scipy", "pydantic")),
        ("steelyard.cli.app", ("llvmlite", "polars", "mujoco", "scipy", "pydantic")),
        ("steelyard.runs.runs_of_named_logs", ("llvmlite", "polars", "mujoco")),
    ],
)
def test_a_start_loads_nothing_heavy(module: str, heavy: tuple[str, ...]) -> None:
    code = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_foreign_package_is_declared() -> None:
    """What is not declared is there only where another package happens to bring it."""
    project = tomllib.loads((PACKAGE.parents[1] / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    runtime = [name for name in extras if name not in ("test", "check", "docs")]
    lines = [*project["dependencies"], *(line for name in runtime for line in extras[name])]
    declared = {_normal(re.match(r"[\w.-]+", line)[0]) for line in lines}  # type: ignore[index]
    packages = packages_distributions()
    missing = {
        (name, path.relative_to(PACKAGE).as_posix())
        for path in PACKAGE.rglob("*.py")
        for name in _imported_roots(path)
        if name not in sys.stdlib_module_names
        and name != "steelyard"
        and not declared & {_normal(d) for d in packages.get(name, [name])}
    }
    assert not missing


def _normal(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _imported_roots(path: Path) -> Iterator[str]:
    for node in _read(path)[1]:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


def test_scripts_beside_the_package_import_what_there_is() -> None:
    missing = []
    for path in (p for folder in SCRIPTS for p in sorted((ROOT / folder).rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("steelyard."):
                module = PACKAGE.parent.joinpath(*str(node.module).split("."))
                names = "" if module.is_dir() else module.with_suffix(".py").read_text()
                for name in (alias.name for alias in node.names):
                    beside = (module / f"{name}.py").is_file() or (module / name).is_dir()
                    if not beside and not re.search(rf"\b{name}\b", names):
                        missing.append(f"{path.name}: {node.module}.{name}")
    assert not missing
