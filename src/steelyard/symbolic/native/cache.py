"""Machine code on disk, by content: a second start traces and compiles nothing.

An entry is one file: a line of JSON (the entry's own description, with the code's hash), then the
code. The folder belongs to the user alone; an entry that is not what it says is ignored and
rebuilt. `STEELYARD_CACHE` names another folder, or switches the cache off when it is empty.
"""

import hashlib
import json
import os
import stat
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from steelyard.base.errors import OutputError
from steelyard.base.files import cache_folder, whole_file

FORMAT = 1

SOURCES = (
    "symbolic",
    "model",
    "excite/constraints/bounds_in_time_and_effort_limits.py",
    "excite/standing",
    "robot/models",
    "robot/robot_from_mechanism.py",
    "robot/floating_ball_and_coupled_joints.py",
    "robot/loop_closures.py",
    "robot/mechanism.py",
    "robot/inertia_and_placement.py",
    "robot/robot.py",
    "estimate/information",
    "actuators/closed_loop_step.py",
    "estimate/closed_loop",
    "estimate/external",
    "check/hypotheses/nuisance_fit_and_score.py",
    "excite/design_problem_and_information.py",
    "simulate/laws_beside_mujoco.py",
)
"""Folders and files of the package that programs are made from."""


def key_of(description: Any) -> str:
    """Hash of anything JSON can write, and of the equations as they stand in the package."""
    text = json.dumps([FORMAT, _sources(), description], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _sources() -> str:
    """Hash of those files: an edited law is a new program."""
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for source in SOURCES:
        place = package / source
        inside = (x for x in place.rglob("*.*") if x.suffix in (".py", ".ll"))
        for file in sorted(inside) if place.is_dir() else [place]:
            digest.update(file.relative_to(package).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def load(key: str) -> tuple[dict[str, Any], bytes] | None:
    """Description and code of an entry, or `None` if there is no sound one."""
    place = folder()
    if place is None:
        return None
    try:
        head, _, code = (place / f"{key}.kernel").read_bytes().partition(b"\n")
        entry = json.loads(head)
        sound = entry["key"] == key and entry["sha256"] == _seal(entry["about"], code)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return (entry["about"], code) if sound else None


def store(key: str, about: dict[str, Any], code: bytes) -> None:
    """Keep an entry; a cache that cannot be written is no error."""
    place = folder()
    if place is None:
        return
    head = json.dumps({"key": key, "sha256": _seal(about, code), "about": about}).encode()
    with suppress(OutputError), whole_file(place / f"{key}.kernel") as part:
        part.write_bytes(head + b"\n" + code)


def _seal(about: dict[str, Any], code: bytes) -> str:
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode() + b"\n" + code).hexdigest()


def folder() -> Path | None:
    """The private folder, made if need be; `None` where there is none to trust."""
    place = cache_folder("kernels", mode=0o700)
    if place is None:
        return None
    facts = place.stat()
    if hasattr(os, "getuid") and (
        facts.st_uid != os.getuid() or facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    ):
        return None
    return place
