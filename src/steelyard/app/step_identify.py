"""Step 5, identification: a fit that can be stopped, its report, earlier models beside it."""

from steelyard.app.jobs import Work
from steelyard.app.step import OPEN, Desk, Step, Values, one_of
from steelyard.app.step_check import passed, reason_of
from steelyard.app.step_logs import logs_that, payload_mass
from steelyard.app.workspace import MODELS, REPORTS
from steelyard.base.errors import DataError

FIT = "steelyard.app.work_identify:identify"


def _work(desk: Desk, folder: str) -> Work:
    workspace = desk.workspace
    robot, loaded = workspace.robot_file.name, logs_that(desk, "loaded")
    given = {
        "robot": robot,
        "logs": logs_that(desk, "fit"),
        "validate": logs_that(desk, "validate"),
        "loaded": loaded,
        "payload_mass": payload_mass(desk) if loaded else None,
        "folder": folder,
        "reason": reason_of(desk),
    }
    files = (robot, *logs_that(desk, "fit", "validate", "loaded"), *workspace.model_files)
    return Work(FIT, given, files, f"identifying {folder}", long=True)


def _comparison(desk: Desk) -> Work | None:
    chosen = desk.workspace.choices.get("compare")
    known, unseen = desk.workspace.models, logs_that(desk, "validate")
    if not isinstance(chosen, list) or not unseen or not set(chosen) <= {*known}:
        return None
    folder = f"{REPORTS}/compare-{'-'.join(name.rsplit('/', 1)[-1] for name in chosen)}"
    given = {"models": chosen, "logs": unseen, "folder": folder}
    files = (*(f"{name}/model.json" for name in chosen), *unseen)
    return Work("steelyard.app.work_identify:compare", given, files, "comparing models", long=True)


def _locked(desk: Desk) -> str:
    if passed(desk):
        return OPEN
    return "First check the logs, in step 3: nothing wrong may be left, or say there why to go on."


def _numbers(desk: Desk) -> Values:
    workspace = desk.workspace
    models, shown = workspace.models, workspace.choices.get("model_shown")
    begun = workspace.choices.get("fit")
    fit = None if begun is None else desk.at(begun["key"])
    comparison = _comparison(desk)
    return {
        "models": models,
        "shown": shown if shown in models else next(iter(models), None),
        "fit": fit,
        "running": fit is not None and fit.job is not None,
        "interrupted": fit is not None
        and fit.job is None
        and fit.error is None
        and fit.result is None,
        "unseen": logs_that(desk, "validate"),
        "known": logs_that(desk, "fit"),
        "loaded": logs_that(desk, "loaded"),
        "reason": reason_of(desk),
        "comparison": None if comparison is None else desk.look(comparison),
    }


def _run(desk: Desk, form: Values) -> None:
    """Begin a fit, into a folder with a new number."""
    workspace = desk.workspace
    if not passed(desk):
        raise DataError("the logs are not checked", where="check", fix="check them in step 3")
    if any(job.work.function == FIT for job in desk.jobs.running.values()):
        raise DataError(
            "a fit is running already, of the files as they were",
            where="identify",
            fix="wait until it is done, or stop it",
        )
    number = 1
    while workspace.path(f"{MODELS}/model-{number}").exists():
        number += 1
    folder = f"{MODELS}/model-{number}"
    work = _work(desk, folder)
    workspace.choose(fit={"folder": folder, "key": work.key(workspace)}, model_shown=None)
    desk.again(work)


def _show(desk: Desk, form: Values) -> None:
    desk.workspace.choose(model_shown=one_of(form, "model", desk.workspace.models))


def _compare(desk: Desk, form: Values) -> None:
    models = desk.workspace.models
    chosen = [one_of(form, name, models) for name in ("first", "second")]
    if chosen[0] == chosen[1]:
        raise DataError("this is one model", where=chosen[0], fix="choose two different ones")
    desk.workspace.choose(compare=chosen)
    work = _comparison(desk)
    if work is None:
        raise DataError("no log validates", where="logs", fix="choose one in step 2")
    if not desk.workspace.path(str(work.given["folder"])).exists():
        desk.again(work)


STEP = Step(
    "identify",
    "Identify",
    _numbers,
    _locked,
    {"run": _run, "show": _show, "compare": _compare},
)
