"""`steelyard doctor`: what is there, and what is not."""

import json
from pathlib import Path

import pytest

from cli.conftest import Command
from steelyard.cli import doctor_command as doctor


def lines(command: Command, code: int = 0) -> dict[str, dict[str, object]]:
    done = command("doctor", "--json")
    assert done.exit_code == code, done.output
    return {line["name"]: line for line in json.loads(done.stdout)}


def test_everything_is_there_and_named_with_its_version(command: Command) -> None:
    found = lines(command)
    assert all(line["ok"] for line in found.values())
    packages = str(found["packages"]["says"])
    assert all(name in packages for name in ("numpy 2", "mujoco", "llvmlite ", "tomlkit "))
    assert "polars " not in packages and "polars " in str(found["extra polars"]["says"])
    assert "viser" in str(found["extra replay"]["says"]) and "llvmlite" in str(
        found["compiler"]["says"]
    )
    text = command("doctor").stdout
    assert all(name in text for name in found) and "wrong" not in text
    assert text.splitlines()[-1] == "All that steelyard needs is there"
    assert not any(line["optional"] for line in found.values())


def test_what_is_missing_comes_with_the_line_that_installs_it(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = doctor._names

    def more(extra: str = "") -> list[str]:
        return [*known(extra), f"steelyard-lacks-{extra or 'this'}"]

    monkeypatch.setattr(doctor, "_names", more)
    found = lines(command, 1)
    assert found["packages"]["says"] == "missing: steelyard-lacks-this"
    assert str(found["packages"]["fix"]).endswith("-m pip install steelyard-lacks-this")
    assert found["extra replay"]["ok"] and '"steelyard[replay]"' in str(
        found["extra replay"]["fix"]
    )
    text = command("doctor").stdout
    marks = [line.split()[0] for line in text.splitlines() if " extra " in line[:20]]
    assert "wrong" in text and marks == ["optional"] * 4
    left = "optional extras that are not installed: app, polars, population, replay"
    assert f"To be corrected: packages; {left}" in " ".join(text.split())


def test_the_cache_is_counted_off_or_untrusted(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STEELYARD_CACHE", str(tmp_path))
    (tmp_path / "kernels").mkdir(mode=0o700)
    (tmp_path / "kernels/one.kernel").write_bytes(bytes(2**20))
    assert str(lines(command)["cache"]["says"]).endswith(": 1 programs, 1.0 MiB")
    monkeypatch.setenv("STEELYARD_CACHE", "")
    assert "off" in str(lines(command)["cache"]["says"])
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STEELYARD_CACHE", str(tmp_path / "file"))
    assert "STEELYARD_CACHE" in str(lines(command)["cache"]["fix"])


def test_a_folder_that_cannot_be_written_is_wrong(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(doctor.tempfile, "gettempdir", lambda: str(tmp_path / "gone"))
    found = lines(command, 1)
    assert not found["temporary files"]["ok"] and found["temporary files"]["fix"]
