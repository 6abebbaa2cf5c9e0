"""Arguments in the wrong order: a log where the robot belongs, a robot file among the logs."""

import inspect
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from steelyard.errors import ModelError

ROBOT_SUFFIXES = (".toml", ".urdf", ".xacro", ".xml", ".mjcf")
"""Endings of robot files and robot models; no log has them."""

FIRST = {"robot": ("robot file", "ROBOT"), "model": ("model", "MODEL")}
"""Parameters that stand before the logs, with their name and placeholder."""


def refuse_wrong_order(command: Callable[..., None], arguments: Mapping[str, Any]) -> None:
    """The robot or the model comes first, then the logs.

    Args:
        command: The function of the command.
        arguments: Its arguments.

    Raises:
        ModelError: A log is in the place of the robot, or a robot file among the logs.
    """
    role = next(iter(inspect.signature(command).parameters), "")
    given = arguments.get("logs") or arguments.get("log")
    if role not in FIRST or not given:
        return
    first, logs = arguments[role], [given] if isinstance(given, str) else list(given)
    what, placeholder = ("robot model", "URDF") if command.__name__ == "init" else FIRST[role]
    if _is_log(first):
        wrong = f"a log is in the place of the {what}"
    elif misplaced := [text for text in logs if _is_robot(text)]:
        wrong = f"'{misplaced[0]}' is among the logs, but is a robot file"
    else:
        return
    words = _in_order([first, *logs], placeholder, model=placeholder == "MODEL")
    raise ModelError(
        wrong,
        where=f"steelyard {command.__name__} {shlex.join([first, *logs])}",
        fix=f"{what} first, then logs: steelyard {command.__name__} {words}",
    )


def _in_order(texts: Sequence[str], placeholder: str, *, model: bool) -> str:
    """The robot, or the first that can be an identified model, or a placeholder; then the logs."""
    able = [t for t in texts if (not _is_log(t) and not _is_robot(t) if model else _is_robot(t))]
    first = able[0] if able else None
    logs = [text for text in texts if text != first and not _is_robot(text)]
    return f"{placeholder if first is None else shlex.quote(first)} {shlex.join(logs) or 'LOG'}"


def _is_log(text: str) -> bool:
    """Whether an argument has the suffix or the window of a log."""
    from steelyard.formats.register import FORMATS

    name = re.sub(r"[@#][^@#/]*:[^@#/]*$", "", text)
    return Path(name).suffix.lower() in FORMATS or (name != text and not _is_robot(name))


def _is_robot(text: str) -> bool:
    """Whether an argument has the suffix of a robot file, arguments of a xacro file apart."""
    return Path(text.split(" ")[0]).suffix.lower() in ROBOT_SUFFIXES
