"""Step 4, no log yet: the room of the robot, a motion designed for it, and a rehearsal of it."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from steelyard.app.jobs import Work
from steelyard.app.step import OPEN, Desk, Step, Values, one_of, text_of
from steelyard.app.workspace import MOTIONS, REPORTS
from steelyard.base.errors import DataError
from steelyard.excite.controller_file_formats import EXPORTS
from steelyard.robot.file.excitation_sections import ExcitationSection
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.toml_edits import Edit, edited
from steelyard.robot.file.toml_schema import checked

FORMATS = {
    "csv": "a table (CSV)",
    "ros2": "ROS 2, joint trajectory",
    "urscript": "Universal Robots, URScript",
    "krl": "KUKA, KRL",
    "rapid": "ABB, RAPID",
    "mujoco": "MuJoCo, keyframes",
}
"""Formats of motions in words; all of them."""

AXES = ("x", "y", "z")
ENDS = ("from", "to")
FIRST_ASKED: Values = {"budget": 10, "formats": ["csv"]}  # of a design: time [s], formats
LONGEST_DESIGN = 3600.0  # budget of a design [s]
LIMITING: tuple[str, ...] = ("floor", "planes", "keep_out", "world")
LIMITING += tuple(f"box-{axis}-{end}" for axis in AXES for end in ENDS)
"""Fields of the form that limit where the robot may move."""

MOST_WALLS = 50


def _robot_files(desk: Desk) -> tuple[str, ...]:
    workspace = desk.workspace
    return (workspace.robot_file.name, *workspace.model_files)


def room_work(desk: Desk) -> Work:
    """The robot with its walls in space."""
    given = {"robot": desk.workspace.robot_file.name}
    return Work("steelyard.app.work_design:room", given, _robot_files(desk), "drawing the room")


def view_work(desk: Desk, folder: str) -> Work:
    """A designed motion with its clearances."""
    given = {"robot": desk.workspace.robot_file.name, "folder": folder}
    files = (*_robot_files(desk), f"{folder}/trajectory.json", f"{folder}/certificate.json")
    return Work("steelyard.app.work_design:view", given, files, f"reading {folder}")


def _design_work(desk: Desk) -> Work | None:
    chosen = desk.workspace.choices.get("design")
    if not isinstance(chosen, dict):
        return None
    given = {"robot": desk.workspace.robot_file.name, **chosen}
    words = f"designing {chosen.get('folder')}"
    return Work("steelyard.app.work_design:design", given, _robot_files(desk), words, long=True)


def _rehearsal_work(desk: Desk) -> Work | None:
    chosen = desk.workspace.choices.get("rehearsal")
    if not isinstance(chosen, dict):
        return None
    given = {"robot": desk.workspace.robot_file.name, **chosen}
    files = (*_robot_files(desk), f"{chosen.get('motion')}/trajectory.json")
    words = f"rehearsing {chosen.get('motion')}"
    return Work("steelyard.app.work_design:rehearse", given, files, words, long=True)


def _excitation(desk: Desk) -> ExcitationSection:
    """The tables `[excitation]` of the robot file.

    Raises:
        ModelError: The robot file has a wrong key or value.
    """
    workspace = desk.workspace
    return checked(workspace.robot_file, workspace.robot_text or "", RobotFile)[0].excitation


def _locked(desk: Desk) -> str:
    return OPEN if desk.workspace.robot_text is not None else "First give the robot, in step 1."


def _shown(desk: Desk) -> str | None:
    motions, chosen = desk.workspace.motions, desk.workspace.choices.get("motion_shown")
    return chosen if chosen in motions else next(iter(motions), None)


def _numbers(desk: Desk) -> Values:
    workspace, shown = desk.workspace, _shown(desk)
    design, rehearsal = _design_work(desk), _rehearsal_work(desk)
    fit = None if design is None else desk.look(design)
    trial = None if rehearsal is None else desk.look(rehearsal)
    excitation = _excitation(desk)
    now = _fields(excitation)
    return {
        "room": desk.done(room_work(desk)),
        "now": now,
        "unlimited": all(now[name] in ("", []) for name in LIMITING),
        "own_links": excitation.collision is None or excitation.collision.bodies,
        "asked": {**FIRST_ASKED, **({} if design is None else design.given)},
        "seed": 1 if rehearsal is None else rehearsal.given.get("seed", 1),
        "axes": AXES,
        "worlds": [m for m in workspace.robot_models if m != workspace.choices.get("model")],
        "formats": FORMATS,
        "motions": workspace.motions,
        "shown": shown,
        "fit": fit,
        "designing": fit is not None and fit.job is not None,
        "view": None if shown is None else desk.done(view_work(desk, shown)),
        "files": [] if shown is None else _offered(desk, shown),
        "trial": trial,
        "rehearsing": trial is not None and trial.job is not None,
        "of_shown": rehearsal is not None and rehearsal.given.get("motion") == shown,
    }


def _offered(desk: Desk, folder: str) -> list[tuple[str, str]]:
    """Files of a motion for controllers, and what each is."""
    there = [(f"{folder}/{EXPORTS[form].file}", words) for form, words in FORMATS.items()]
    there += [(f"{folder}/certificate.json", "the certificate")]
    return [(name, words) for name, words in there if desk.workspace.path(name).is_file()]


def _fields(section: ExcitationSection) -> dict[str, Any]:
    """What the form of the room shows, as text; numbers of a kind of motion without them lack."""
    tables = section.model_dump()
    space, collision = tables["workspace"] or {}, tables["collision"] or {}
    box = space.get("box") or {}
    spans = {axis: box.get(axis) or ("", "") for axis in AXES}
    shown: dict[str, Any] = {
        f"box-{axis}-{end}": spans[axis][k] for axis in AXES for k, end in enumerate(ENDS)
    }
    shown |= {name: _blank(space.get(name)) for name in ("frame", "radius", "floor")}
    shown["planes"] = [[*one["normal"], one["above"]] for one in space.get("planes", ())]
    shown["keep_out"] = [
        [x for axis in AXES for x in one[axis] or ("", "")] for one in space.get("keep_out", ())
    ]
    shown |= {"world": _blank(collision.get("world")), "share": tables["limits"]["share"]}
    own = tables["motion"]
    return shown | {name: own[name] for name in ("kind", "period", "harmonics") if name in own}


def _blank(value: Any) -> Any:
    return "" if value is None else value


def _room(desk: Desk, form: Values) -> None:
    """Write what differs into the robot file."""
    now = _fields(_excitation(desk))
    edits = [Edit(("excitation", *path), value) for path, value in _changes(desk, form, now)]
    text = desk.workspace.robot_text
    if edits and text is not None:
        text = edited(text, edits)
        checked(desk.workspace.robot_file, text, RobotFile)
        desk.workspace.write_robot(text)


def _changes(desk: Desk, form: Values, now: Values) -> Iterator[tuple[tuple[str, str], Any]]:
    """Keys below `[excitation]` and their new values; `None` takes one out."""
    frame, world = text_of(form, "frame"), text_of(form, "world")
    if frame != now["frame"]:
        yield ("workspace", "frame"), frame or None
    for name in ("radius", "floor"):
        if (value := _number(form, name)) != _optional(now[name]):
            yield ("workspace", name), value
    spans = {axis: [_number(form, f"box-{axis}-{end}") for end in ENDS] for axis in AXES}
    if spans != {axis: [_optional(now[f"box-{axis}-{end}"]) for end in ENDS] for axis in AXES}:
        box = {axis: _span(span, f"box along {axis}") for axis, span in spans.items()}
        yield ("workspace", "box"), {k: v for k, v in box.items() if v is not None} or None
    planes = _rows(form, "planes", 4)
    if planes != now["planes"]:
        walls = [{"normal": row[:3], "above": row[3]} for row in planes]
        yield ("workspace", "planes"), walls or None
    boxes = _rows(form, "keep_out", 6)
    if boxes != now["keep_out"]:
        tables = [
            {
                axis: _span(row[2 * k : 2 * k + 2], f"box along {axis}")
                for k, axis in enumerate(AXES)
            }
            for row in boxes
        ]
        yield ("workspace", "keep_out"), tables or None
    if world != now["world"]:
        known = ["", *desk.workspace.robot_models]
        yield ("collision", "world"), one_of(form, "world", known) or None
    for name, table in (("share", "limits"), ("period", "motion"), ("harmonics", "motion")):
        if name in now and (value := _number(form, name)) != float(now[name]):
            whole = name == "harmonics" and value is not None and value.is_integer()
            yield (table, name), int(value) if whole and value is not None else value


def _optional(value: Any) -> float | None:
    return None if value == "" else float(value)


def _span(span: Sequence[float | None], where: str) -> list[float] | None:
    low, high = span
    if low is None and high is None:
        return None
    if low is None or high is None or not low < high:
        raise DataError(
            "a range needs two numbers, the lower one first",
            where=where,
            fix="fill in both, or leave both empty where it is open",
        )
    return [low, high]


def _number(form: Values, name: str) -> float | None:
    """A field as a number; `None` if it is empty."""
    text = text_of(form, name)
    return _of_text(text, name) if text else None


def _of_text(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"'{text}' is not a number", where=where, fix="write one such as 0.25")
    return value


def _rows(form: Values, name: str, count: int) -> list[list[float]]:
    """Rows of numbers of a field."""
    lines = [row for row in text_of(form, name, 4000).splitlines() if row.strip()]
    found = [[_of_text(x, name) for x in row.replace(",", " ").split()] for row in lines]
    if len(found) > MOST_WALLS or any(len(row) != count for row in found):
        raise DataError(
            f"each row needs {count} numbers, and there are at most {MOST_WALLS} rows",
            where=name.replace("_", " "),
            fix="write one wall a row, with spaces between the numbers",
        )
    return found


def _design(desk: Desk, form: Values) -> None:
    """Begin a design in the room that the form describes, into a folder with a new number."""
    budget, form_of = _number(form, "budget"), one_of(form, "format", [*FORMATS])
    if budget is None or not 1.0 <= budget <= LONGEST_DESIGN:
        raise DataError(
            f"the time of the design is between 1 and {LONGEST_DESIGN:g} s",
            where="time for the search",
            fix="10 s is usual",
        )
    _room(desk, form)
    folder = desk.workspace.new_name(MOTIONS, "motion")
    chosen = {"folder": folder, "budget": budget, "formats": [form_of]}
    desk.workspace.choose(design=chosen, motion_shown=None)
    work = _design_work(desk)
    assert work is not None
    desk.again(work)


def _show(desk: Desk, form: Values) -> None:
    desk.workspace.choose(motion_shown=one_of(form, "motion", desk.workspace.motions))


def _rehearse(desk: Desk, form: Values) -> None:
    """Begin a rehearsal of the motion that is shown."""
    seed, motion = _number(form, "seed"), _shown(desk)
    if motion is None:
        raise DataError("there is no motion yet", where="motions", fix="design one first")
    if seed is None or not (seed.is_integer() and 0 <= seed < 1 << 31):
        raise DataError("a seed is a whole number", where="seed", fix="write one such as 1")
    folder = desk.workspace.new_name(REPORTS, "rehearsal")
    desk.workspace.choose(rehearsal={"motion": motion, "folder": folder, "seed": int(seed)})
    work = _rehearsal_work(desk)
    assert work is not None
    desk.again(work)


def _added(desk: Desk, form: Values) -> None:
    """After a model of the cell was dropped: it is to choose from."""


STEP = Step(
    "design",
    "Design",
    _numbers,
    _locked,
    {
        "added": _added,
        "room": _room,
        "design": _design,
        "show": _show,
        "rehearse": _rehearse,
    },
    aside=True,
)
