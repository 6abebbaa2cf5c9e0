"""Step 6, use: payload, contact, wrench and health of logs by a model; exports of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.app.jobs import Work
from steelyard.app.step import OPEN, Desk, Outcome, Step, Values, one_of, text_of
from steelyard.app.step_logs import logs_that
from steelyard.app.workspace import EXPORTS, REPORTS, USED_LOGS
from steelyard.base.errors import DataError


@dataclass(frozen=True)
class Use:
    """Something that a model is used for.

    Attributes:
        title: To choose from.
        words: What it tells.
        several: Whether it takes several logs.
        frame: Whether it is about a frame.
        free: What logs beside it are, such as those without the payload; empty if it takes none.
    """

    title: str
    words: str
    several: bool = False
    frame: bool = False
    free: str = ""


USES = {
    "payload": Use("Payload: how heavy", "mass, centre and inertia", True, True, "unloaded"),
    "payload-events": Use("Payload: when", "picked up and put down", True, True),
    "contact": Use("Contact", "when, at which joints, on which link", free="without contact"),
    "wrench": Use("Wrench", "force and moment on a frame", frame=True),
    "health": Use("Health", "drift of friction, offsets and effort scales", several=True),
}
"""All uses; `USES` of `work_use.py` does them."""

NOTHING: dict[str, Any] = {"what": "", "model": "", "frame": None, "free": []}
"""What is chosen of a use at first."""

FORMATS = {
    "urdf": ("URDF", ".urdf"),
    "mjcf": ("MJCF", ".xml"),
    "c": ("C", "-c"),
    "python": ("Python", ".py"),
    "fmu": ("FMU", ".fmu"),
    "ros2": ("ROS 2 package", "-ros2"),
    "simulink": ("Simulink", "-simulink"),
}
"""Formats of exports in words, and the endings of their files."""


def _locked(desk: Desk) -> str:
    return OPEN if desk.workspace.models else "First identify a model, in step 5."


def _use_work(desk: Desk) -> Work | None:
    chosen = desk.workspace.choices.get("use")
    if not isinstance(chosen, dict):
        return None
    files = [f"{chosen.get('model')}/model.json"]
    files += [*chosen.get("logs", ()), *chosen.get("free", ())]
    words = f"{chosen.get('what')} of {', '.join(chosen.get('logs', ()))}"
    return Work("steelyard.app.work_use:use", chosen, tuple(files), words, long=True)


def _export_work(desk: Desk) -> Work | None:
    chosen = desk.workspace.choices.get("export")
    if not isinstance(chosen, dict):
        return None
    files = (f"{chosen.get('model')}/model.json",)
    return Work("steelyard.app.work_use:export", chosen, files, f"writing {chosen.get('path')}")


def _known(desk: Desk, work: Work | None) -> Outcome | None:
    return None if work is None else desk.look(work)


def _numbers(desk: Desk) -> Values:
    workspace = desk.workspace
    chosen, exported = (workspace.choices.get(name) for name in ("use", "export"))
    used, written = _known(desk, _use_work(desk)), _known(desk, _export_work(desk))
    folder = None if used is None or used.result is None else str(used.result["folder"])
    return {
        "models": workspace.models,
        "logs": workspace.used_logs,
        "ticked": workspace.choices.get("ticked")
        or (logs_that(desk, "loaded") or [*workspace.used_logs])[:1],
        "uses": USES,
        "chosen": NOTHING | (chosen if isinstance(chosen, dict) else {}),
        "used": used,
        "files": [] if folder is None else _files(desk, folder),
        "earlier": _earlier(desk),
        "formats": FORMATS,
        "own": [name for name in workspace.robot_models if name.endswith(".urdf")],
        "exported": exported if isinstance(exported, dict) else {},
        "written": written,
        "exports": _exports(desk),
    }


def _files(desk: Desk, folder: str) -> list[str]:
    found = desk.workspace.files(REPORTS, (".html", ".csv", ".json"))
    return [name for name in found if name.startswith(f"{folder}/")]


def _earlier(desk: Desk) -> list[str]:
    """Folders of all results, the latest first."""
    found = desk.workspace.files(REPORTS, (".html", ".json"))
    folders = {name.rsplit("/", 1)[0] for name in found if name.count("/") == 2}
    named = [x for x in folders if x.split("/")[1].rsplit("-", 1)[0] in USES]
    return sorted(named, key=lambda x: -desk.workspace.path(x).stat().st_mtime_ns)


def _exports(desk: Desk) -> list[str]:
    top = desk.workspace.path(EXPORTS)
    names = sorted(p.name for p in top.iterdir()) if top.is_dir() else []
    return [f"{EXPORTS}/{name}" for name in names if not name.startswith(".")]


def _use(desk: Desk, form: Values) -> None:
    """Begin a use of a model on logs, into a folder with a new number."""
    workspace = desk.workspace
    what, model = one_of(form, "what", [*USES]), one_of(form, "model", workspace.models)
    use, logs = USES[what], _ticked(form, "log", workspace.used_logs)
    free = _ticked(form, "free", workspace.used_logs)
    frame = text_of(form, "frame")
    if not logs or (len(logs) > 1 and not use.several):
        raise DataError(
            f"{len(logs)} logs are chosen",
            where=use.title,
            fix="choose at least one" if use.several else "choose one",
        )
    for there, takes, words in (
        (bool(free), bool(use.free), "logs without load or contact"),
        (bool(frame), use.frame, "a frame"),
    ):
        if there and not takes:
            raise DataError(
                f"{words} cannot be given here", where=use.title, fix="leave the field empty"
            )
    folder = workspace.new_name(REPORTS, what)
    given = {"what": what, "folder": folder, "model": model, "logs": logs}
    workspace.choose(use={**given, "free": free, "frame": frame or None}, ticked=logs)
    work = _use_work(desk)
    assert work is not None
    desk.again(work)


def _ticked(form: Values, name: str, logs: Sequence[str]) -> list[str]:
    return [log for k, log in enumerate(logs) if form.get(f"{name}-{k}") == log]


def _export(desk: Desk, form: Values) -> None:
    """Begin to write a model in another format, under a new name."""
    workspace = desk.workspace
    model, to = one_of(form, "model", workspace.models), one_of(form, "to", [*FORMATS])
    original = one_of(form, "original", ["", *workspace.robot_models]) or None
    if original is not None and to != "urdf":
        raise DataError(
            "values are written into a copy of a URDF alone",
            where=FORMATS[to][0],
            fix="choose URDF, or a file of its own",
        )
    name = model.split("/", 1)[-1].replace("/", "-")
    path = f"{EXPORTS}/{name}{FORMATS[to][1]}"
    if workspace.path(path).exists():
        path = workspace.new_name(EXPORTS, name, FORMATS[to][1])
    workspace.choose(export={"model": model, "to": to, "path": path, "original": original})
    work = _export_work(desk)
    assert work is not None
    desk.again(work)


def _added(desk: Desk, form: Values) -> None:
    """After logs were dropped: the latest is ticked."""
    dropped = [log for log in desk.workspace.used_logs if log.startswith(f"{USED_LOGS}/")]
    if dropped:
        latest = max(dropped, key=lambda log: desk.workspace.path(log).stat().st_mtime_ns)
        desk.workspace.choose(ticked=[latest])


STEP = Step(
    "use",
    "Use",
    _numbers,
    _locked,
    {"added": _added, "use": _use, "export": _export},
)
