"""What to do with a model next, as commands with the paths at hand."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from steelyard.report.text.table import rows
from steelyard.report.text.verdict import verdict

if TYPE_CHECKING:
    from steelyard.diagnosis import Finding
    from steelyard.report.content import ReportContent

MODEL_ERROR = "model error"
"""The check that compares residuals with noise."""

GEAR_SIDE = "gear side"
"""The check of rotor inertias at zero."""

MANY = 1.0 / 3.0
"""Share of base parameters that are poorly identified or not at all, above which a motion is
advised; any share where a good model is not good for every joint."""

OPEN = ("poorly identified", "not identifiable")
"""Statuses of parameters that other motion would identify."""

Step = tuple[str, str]
"""A command, or nothing, and a remark: what it is for, or what to change in the robot file."""


def next_steps(content: ReportContent, robot: str, model: Path) -> tuple[Step, ...]:
    """Steps after an identification, the most urgent first.

    Args:
        content: Of its report.
        robot: The robot file as it was given.
        model: The folder with the model.
    """
    judged, weak = verdict(content), _weak(content)
    steps = list(fixing(content, str(model), robot))
    robot, folder = path_word(robot), path_word(model)
    logs = " ".join(path_word(log) for log in content.logs.values())
    if content.diagnosis is not None and content.diagnosis.inconclusive:
        steps.insert(0, (f"steelyard check {robot} {logs}", "open questions about the robot file"))
    steps += gear_side_steps(content.limitations, robot)
    if not content.scores:
        steps.append((f"steelyard validate {folder} OTHER_LOG", "error on another motion"))
    elif judged.level == "poor" and not steps:
        steps.append((f"steelyard check {robot} {logs}", "errors in the logs or the robot file"))
    if content.friction is None and any(
        found.check == MODEL_ERROR and not found.severity for found in content.limitations
    ):
        steps.append(
            (
                "",
                f'to have friction laws chosen from the logs: friction = "auto" in {robot}, '
                '[model], and no "coulomb", "viscous" in terms',
            )
        )
    if weak > MANY or (weak and judged.level == "good" and judged.scope):
        command = f"steelyard excite {robot} --earlier {folder} --still-unknown"
        steps.append((command, "a motion for parameters that are poorly identified or not at all"))
    if judged.level == "good":
        uses = "use the model, here as a URDF; also: feedforward, wrench, payload, watch"
        steps.append((f"steelyard export {folder} --to urdf", uses))
    return tuple(steps)


def path_word(path: str | Path) -> str:
    """A path as a word of a command: from the current folder, if it lies in it, and quoted."""
    here, there = Path.cwd(), Path(path)
    return shlex.quote(str(there.relative_to(here)) if there.is_relative_to(here) else str(path))


def gear_side_steps(findings: Sequence[Finding], robot: str) -> list[Step]:
    """The edit for sensors on the link side, where a finding proposes it."""
    edit = f'if sensors are on the link side: kind = "link_torque" in {robot}, no rotor_inertia'
    proposed = any(found.check == GEAR_SIDE and found.fix is not None for found in findings)
    return [("", f"{edit} in terms")] if proposed else []


def identifying(robot: str, logs: Sequence[str]) -> str:
    """The command that identifies from all logs but the last one, which validates; or from one."""
    words = [path_word(log) for log in logs]
    if len(words) > 1:
        words.insert(-1, "--validate")
    return " ".join(["steelyard", "identify", path_word(robot), *words])


def fixing(content: ReportContent, model: str, robot: str = "ROBOT") -> tuple[Step, ...]:
    """The commands that go on from what limits the verdict."""
    found = {}
    for one in content.limitations:
        if one.severity and one.fix is not None and one.fix.command:
            paths = {"MODEL": model, "ROBOT": robot, "LOG": content.logs.get(one.log, "LOG")}
            given = {word: path_word(path) for word, path in paths.items()}
            words = (given.get(word, word) for word in one.fix.command.split(" "))
            found[" ".join(words)] = ""
    return tuple(found.items())


def robot_file(content: ReportContent) -> str:
    """The robot file that the model was identified with, if it lies here; else `ROBOT`."""
    inputs = {} if content.identified is None else content.identified.provenance.inputs
    names = (role.removeprefix("robot ") for role in inputs if role.startswith("robot "))
    return next(
        (name for name in names if name.endswith(".toml") and Path(name).is_file()), "ROBOT"
    )


def step_lines(steps: tuple[Step, ...], indent: int = 8) -> list[str]:
    """The steps as lines of a terminal, `indent` columns of each for the heading; none without.

    A remark is a line of its own before its command, a comment to a shell.
    """
    lines = [
        line
        for command, remark in steps
        for line in (f"# {remark}" if remark else "", command)
        if line
    ]
    heads = ("next", *[""] * (len(lines) - 1))
    return [f"{head:{indent}}{line}" for head, line in zip(heads, lines, strict=False)]


def _weak(content: ReportContent) -> float:
    """Share of the base parameters that other motion would identify."""
    table = () if content.identified is None else rows(content.identified)
    return sum(row.status in OPEN for row in table) / max(len(table), 1)
