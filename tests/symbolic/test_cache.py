"""The cache of machine code: found again, checked, and never trusted blindly."""

import re
from pathlib import Path

import numpy as np
import pytest

import steelyard
from steelyard.symbolic.native import cache, compiled_programs, compiler
from steelyard.symbolic.program_and_softening import InputArray, Program, Step

DOUBLE = Program((InputArray("x", 1),), (Step("input", (0, 0)), Step("add", (0, 0))), (1,))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STEELYARD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "kernels"


def run() -> int:
    """Evaluate a small program; how often it was built."""
    built = 0

    def build() -> tuple[Program, dict[str, object]]:
        nonlocal built
        built += 1
        return DOUBLE, {"note": "twice"}

    code = compiled_programs.compiled("a test", build)
    assert code.about["note"] == "twice"
    assert code([np.array([[1.5, -2.0]])]).tolist() == [[3.0, -4.0]]
    return built


def test_a_second_start_builds_and_compiles_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run() == 1

    def refuse(*_: object) -> bytes:
        raise AssertionError("compiled again")

    monkeypatch.setattr(compiler, "compile_code", refuse)
    assert run() == 0


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-20], lambda b: b"", lambda b: b[:300] + b"x" + b[301:]]
)
def test_damaged_entries_are_rebuilt(folder: Path, damage: object) -> None:
    run()
    (entry,) = folder.iterdir()
    entry.write_bytes(damage(entry.read_bytes()))  # type: ignore[operator]
    assert run() == 1
    assert run() == 0


def test_a_folder_that_others_may_write_is_not_used(folder: Path) -> None:
    run()
    folder.chmod(0o777)
    assert cache.load(folder.iterdir().__next__().stem) is None
    assert run() == 1


def test_the_folder_is_private(folder: Path) -> None:
    run()
    assert folder.stat().st_mode & 0o077 == 0


def test_the_cache_can_be_switched_off(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STEELYARD_CACHE", "")
    assert run() == 1
    assert run() == 1
    assert not folder.exists()


def test_edited_equations_are_a_new_program(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run() == 1
    monkeypatch.setattr(cache, "_sources", lambda: "edited")
    assert run() == 1
    assert run() == 0


def test_all_files_that_make_programs_are_part_of_the_key() -> None:
    """An edited file must not run the machine code of the file before it."""
    package = Path(steelyard.__file__).parent
    users = [
        file.relative_to(package).as_posix()
        for file in package.rglob("*.py")
        if re.search(r"\b(compiled|compiled_equations|key_of)\(\s*\[", file.read_text("utf-8"))
    ]
    assert len(users) > 10
    assert [f for f in users if not any(f"{f}/".startswith(f"{s}/") for s in cache.SOURCES)] == []
    assert all((package / source).exists() for source in cache.SOURCES)
