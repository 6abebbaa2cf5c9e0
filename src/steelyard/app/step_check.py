"""Step 3, the check: findings with their pictures, fixes that are accepted or left."""

import json
from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import Any

from steelyard.app.jobs import Work
from steelyard.app.step import OPEN, Desk, Outcome, Step, Values, one_of, text_of
from steelyard.app.step_logs import logs_that, preview_work
from steelyard.app.workspace import REPORTS
from steelyard.base.errors import DataError
from steelyard.check.finding import OPEN_WORD
from steelyard.robot.file.toml_edits import Edit

WRONG = 2  # the severity that keeps the next step locked
LEAST_REASON = 5  # letters of a reason to go on all the same


def check_work(desk: Desk) -> Work:
    """The check of all logs."""
    workspace = desk.workspace
    robot, logs = workspace.robot_file.name, logs_that(desk, "fit", "validate")
    chosen = workspace.choices.get("check_model")
    model = chosen if chosen in workspace.models else None
    given = {"robot": robot, "logs": logs, "model": model, "report": REPORTS}
    files = (robot, *logs, *workspace.model_files, *([f"{model}/model.json"] if model else []))
    return Work("steelyard.app.work_check:findings", given, files, "checking the logs", long=True)


def reason_of(desk: Desk) -> str:
    """Why the user goes on though something is wrong; empty if there is no such reason."""
    chosen = desk.workspace.choices.get("all_the_same")
    if not isinstance(chosen, dict) or chosen.get("key") != check_work(desk).key(desk.workspace):
        return ""
    return str(chosen.get("reason", ""))


def passed(desk: Desk) -> bool:
    """Whether the next step is open: nothing wrong is left, or there is a reason to go on."""
    if _locked(desk):
        return False
    found = desk.look(check_work(desk)).result
    clean = found is not None and not any(one["severity"] >= WRONG for one in found["findings"])
    return clean or bool(reason_of(desk))


def _locked(desk: Desk) -> str:
    if desk.workspace.robot_text is None:
        return "First give the robot, in step 1."
    if not desk.workspace.logs:
        return "First drop logs, in step 2."
    return OPEN if logs_that(desk, "fit") else "First choose a log that fits the model, in step 2."


def _numbers(desk: Desk) -> Values:
    found = desk.look(check_work(desk))
    left = desk.workspace.choices.get("left", [])
    every = [] if found.result is None else found.result["findings"]
    bad = [one for one in every if one["severity"]]
    return {
        "found": found,
        "bad": _by_change(one for one in bad if _name(one) not in left),
        "left": _by_change(one for one in bad if _name(one) in left),
        "undecided": [one for one in every if one["word"] == OPEN_WORD],
        "fine": [one for one in every if not one["severity"] and one["word"] != OPEN_WORD],
        "wrong": [one for one in every if one["severity"] >= WRONG],
        "right": _put_right(desk, every),
        "reason": reason_of(desk),
        "passed": passed(desk),
        "level": {"ok": "good", "doubtful": "fair", "wrong": "poor"},
        "curves": {log: desk.done(preview_work(desk, log)) for log in _unpictured(desk, bad)},
        "log_of": lambda finding: _log_of(desk, finding),
        "name": _name,
        "least": LEAST_REASON,
        "models": desk.workspace.models,
        "reference": check_work(desk).given["model"],
    }


def _by_change(findings: Iterable[Any]) -> list[list[Any]]:
    """Findings whose fix is the same change of the robot file together, in order of the first."""
    groups = dict[str, list[Any]]()
    for number, one in enumerate(findings):
        key = json.dumps(one["edits"], sort_keys=True) if one["edits"] else f"{number}"
        groups.setdefault(key, []).append(one)
    return list(groups.values())


def _name(finding: Any) -> str:
    return " | ".join(finding[name] for name in ("check", "log", "place"))


def _log_of(desk: Desk, finding: Any) -> str:
    """The log that a finding is about; the first one if it is about all."""
    logs: list[str] = check_work(desk).given["logs"]
    return next((log for log in logs if finding["log"] == PurePosixPath(log).stem), logs[0])


def _unpictured(desk: Desk, findings: list[Any]) -> set[str]:
    """Logs of findings that have no picture of their own: their curves are shown instead."""
    return {_log_of(desk, one) for one in findings if one["picture"] is None}


def _put_right(desk: Desk, now: list[Any]) -> list[tuple[Any, Any]]:
    """Findings before the last fix that are better now, and what is found now."""
    key = desk.workspace.choices.get("before")
    if not isinstance(key, str) or not now:
        return []
    before = desk.known(key)
    worst = {_name(one): one for one in now[::-1]}
    pairs = [(one, worst.get(_name(one))) for one in (before or {}).get("findings", ())]
    return [
        (old, new) for old, new in pairs if new is not None and new["severity"] < old["severity"]
    ]


def _model(desk: Desk, form: Values) -> None:
    model = one_of(form, "model", ("", *desk.workspace.models))
    desk.workspace.choose(check_model=model or None)


def _run(desk: Desk, form: Values) -> None:
    desk.again(check_work(desk))


def _accept(desk: Desk, form: Values) -> None:
    """Write the lines of a finding into the robot file, and check again."""
    found = _found(desk)
    finding = _chosen(found, form)
    if not finding["edits"]:
        raise DataError(
            "there is no line to write", where=finding["check"], fix=str(finding["fix"])
        )
    edits = [Edit(tuple(edit["path"]), edit["value"]) for edit in finding["edits"]]
    desk.workspace.edit_robot(edits)
    desk.workspace.choose(before=found.key)
    desk.again(check_work(desk))


def _leave(desk: Desk, form: Values) -> None:
    """Put a finding aside, or take it up again."""
    name = _name(_chosen(_found(desk), form))
    left = [one for one in desk.workspace.choices.get("left", []) if one != name]
    again = name in desk.workspace.choices.get("left", [])
    desk.workspace.choose(left=left if again else [*left, name])


def _go_on(desk: Desk, form: Values) -> None:
    reason = text_of(form, "reason")
    if len(reason) < LEAST_REASON:
        raise DataError(
            "a reason is needed to go on while something is wrong",
            where="reason",
            fix="say in a few words why; it is kept in the report",
        )
    key = check_work(desk).key(desk.workspace)
    desk.workspace.choose(all_the_same={"key": key, "reason": reason})


def _found(desk: Desk) -> Outcome:
    found = desk.look(check_work(desk))
    if found.result is None:
        raise DataError("the logs are not checked as they are now", where="check", fix="check them")
    return found


def _chosen(found: Outcome, form: Values) -> Any:
    name = text_of(form, "finding", 1000)
    for one in found.result["findings"]:
        if _name(one) == name and one["severity"]:
            return one
    raise DataError("there is no such finding any more", where=name, fix="load the page again")


STEP = Step(
    "check",
    "Check",
    _numbers,
    _locked,
    {"run": _run, "model": _model, "accept": _accept, "leave": _leave, "go-on": _go_on},
)
