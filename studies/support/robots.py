"""Robot files of `studies/robots/`, with tables that a study changes."""

from collections.abc import MutableMapping
from pathlib import Path
from shutil import copy
from typing import Any

import tomlkit

ROBOTS = Path(__file__).parents[1] / "robots"

TORQUE = """
[signals]
time = "time_s"
position = "q{}_rad"
[signals.effort]
columns = "tau{}_Nm"
kind = "joint_torque"
unit = "Nm"
[prior]
source = "none"
"""
"""Logs with positions and joint torques; the masses of the robot file are not used."""


def robot_file(name: str, target: Path, tables: str = "") -> Path:
    """Write a robot file of `studies/robots/` with some of its tables changed.

    Args:
        name: File in `studies/robots/`, without its suffix.
        target: File to write.
        tables: TOML, see `changed`.

    Returns:
        `target`.
    """
    document = tomlkit.parse((ROBOTS / f"{name}.toml").read_text(encoding="utf-8"))
    return changed(document, target, tables)


def changed(document: tomlkit.TOMLDocument, target: Path, tables: str) -> Path:
    """Write a robot file with some of its tables changed.

    Args:
        document: The robot file.
        target: File to write.
        tables: TOML; its tables are merged into those of the file, or replace those of another
            `kind`; its other values replace the file's.

    Returns:
        `target`.
    """
    _merge(document, tomlkit.parse(tables))
    target.parent.mkdir(parents=True, exist_ok=True)
    model = Path(document.get("robot", {}).get("urdf", ""))
    if model.parent == ROBOTS:  # beside the file, so that the folder can be moved
        copy(model, target.parent)
        document["robot"]["urdf"] = model.name
    target.write_text(tomlkit.dumps(document), encoding="utf-8")
    return target


def _merge(known: MutableMapping[str, Any], changes: MutableMapping[str, Any]) -> None:
    for key, value in changes.items():
        inner = known.get(key)
        if (
            isinstance(value, MutableMapping)
            and isinstance(inner, MutableMapping)
            and value.get("kind") in (None, inner.get("kind"))
        ):
            _merge(inner, value)
        else:
            known[key] = value
