"""Work of identification in a process: a model's folder, as the commands write it; a comparison."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from steelyard.app.workspace import DERIVED
from steelyard.base.files import explained, whole_folder
from steelyard.base.progress import Progress
from steelyard.identify.comparison.compare import compare_models
from steelyard.identify.identify import identify as identified
from steelyard.report.result import Result
from steelyard.robot.file.robot_file import load_robot


def identify(
    robot: str,
    logs: Sequence[str],
    validate: Sequence[str],
    loaded: Sequence[str],
    payload_mass: float | None,
    folder: str,
    reason: str,
    progress: Progress,
) -> dict[str, Any]:
    """What `steelyard identify ROBOT LOG... --validate LOG -o FOLDER` does.

    With a `reason` to go on though something is wrong, which becomes a note of the model and its
    report, the logs are not checked before.
    """
    more: dict[str, Any] = {"loaded": loaded, "payload_mass": payload_mass, "progress": progress}
    if reason:
        known = load_robot(robot)
        note = f"the check found something wrong in the logs, and it was left so: {reason}"
        found = identified(
            replace(known, notes=(*known.notes, note)), logs, validate, check=False, **more
        )
    else:
        found = identified(robot, logs, validate, **more)
    _written(found, folder)
    return {"folder": folder, "level": found.verdict.level, "line": found.verdict.line}


def compare(
    models: Sequence[str], logs: Sequence[str], folder: str, progress: Progress
) -> dict[str, Any]:
    """What `steelyard compare-models MODEL... --on LOG... -o FOLDER` does."""
    found = compare_models(models, logs, progress=progress)
    _written(found, folder)
    return {"folder": folder}


def _written(found: Result, folder: str) -> None:
    """Write a result's files; what a killed process leaves lies where the next start clears it."""
    beside = Path(DERIVED) / Path(folder).name
    with whole_folder(beside) as part:
        found.write(part)
    with explained(Path(folder)):
        beside.rename(folder)
