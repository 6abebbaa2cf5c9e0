"""Step 2, the logs: which column is what, its unit and sign; curves beside the arm that moves."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from steelyard.app.jobs import Work
from steelyard.app.step import OPEN, Desk, Step, Values, one_of, text_of
from steelyard.app.step_robot import init_of, propose, scene_of
from steelyard.base.errors import DataError
from steelyard.robot.file.signals import EFFORT_UNITS, POSITION_UNITS, TIME_UNITS, expanded
from steelyard.robot.file.toml_edits import Edit
from steelyard.robot.file.toml_schema import tomllib
from steelyard.robot.robot import Coordinate

KINDS = {
    "joint_torque": "joint torque",
    "motor_current": "motor current",
    "motor_torque": "motor torque",
    "link_torque": "torque sensor on the link side",
}
"""Kinds of effort as the robot file names them, in words."""


ROLES = {
    "fit": "fits the model",
    "validate": "validates it",
    "loaded": "carries a known mass",
    "out": "is left out",
}
"""What a log is for, in words."""


def columns_work(log: str) -> Work:
    """Names of the columns of a log."""
    return Work("steelyard.app.work_logs:columns", {"log": log}, (log,), f"opening {log}")


def preview_work(desk: Desk, log: str) -> Work:
    """Curves and motion of a log as the robot file reads it."""
    robot = desk.workspace.robot_file.name
    files = (robot, log, *desk.workspace.model_files)
    return Work(
        "steelyard.app.work_logs:preview", {"robot": robot, "log": log}, files, f"reading {log}"
    )


def roles(desk: Desk) -> dict[str, str]:
    """What each log is for; if nothing was chosen, the last of several validates."""
    logs, every = desk.workspace.logs, desk.workspace.choices.get("roles", {})
    chosen = {log: every[log] for log in logs if log in every}
    last = {logs[-1]: "validate"} if len(logs) > 1 and "validate" not in chosen.values() else {}
    return {log: {**last, **chosen}.get(log, "fit") for log in logs}


def logs_that(desk: Desk, *which: str) -> list[str]:
    """The logs with one of some roles."""
    return [log for log, role in roles(desk).items() if role in which]


def payload_mass(desk: Desk) -> float | None:
    """Mass of what logs that are loaded carry [kg]; `None` if it is not given."""
    found = desk.workspace.choices.get("payload_mass")
    return float(found) if isinstance(found, int | float) else None


def _locked(desk: Desk) -> str:
    return OPEN if desk.workspace.robot_text is not None else "First give the robot, in step 1."


def _numbers(desk: Desk) -> Values:
    workspace = desk.workspace
    logs, scene = workspace.logs, scene_of(desk)
    shown = workspace.choices.get("shown")
    shown = str(shown) if shown in logs else next(iter(logs), None)
    robot = None if scene is None else scene.result
    return {
        "logs": logs,
        "shown": shown,
        "roles": roles(desk),
        "role_words": ROLES,
        "payload_mass": payload_mass(desk),
        "scene": scene,
        "init": init_of(desk),
        "model": workspace.choices.get("model"),
        "preview": desk.done(preview_work(desk, shown)) if robot and shown else None,
        "columns": desk.done(columns_work(shown)) if shown is not None else None,
        "table": _table(desk, robot) if robot and shown else None,
        "kinds": KINDS,
        "untouched": _untouched(desk),
    }


def _untouched(desk: Desk) -> bool:
    """Whether the robot file is as it was proposed last, or is being proposed."""
    init = init_of(desk)
    return desk.workspace.untouched or (init is not None and init.job is not None)


def _signals(desk: Desk) -> Mapping[str, Any]:
    """The table `[signals]` of the robot file as it stands there."""
    try:
        found = tomllib.loads(desk.workspace.robot_text or "").get("signals", {})
    except tomllib.TOMLDecodeError:
        return {}
    return found if isinstance(found, dict) else {}


def _table(desk: Desk, scene: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What the robot file says of each joint's columns; `None` where a table cannot show it."""
    if scene["floating"] or scene["targets"]:
        return None
    joints = scene["joints"][: scene["identified"]]
    signals = _signals(desk)
    effort = signals.get("effort", {})
    names = [joint["name"] for joint in joints]
    position = _each(_columns(signals.get("position"), names), len(joints))
    efforts = _each(_columns(effort.get("columns"), names), len(joints))
    rows = zip(
        joints,
        position,
        _each(signals.get("position_unit"), len(joints)),
        _each(signals.get("position_sign", 1), len(joints)),
        efforts,
        _each(effort.get("unit"), len(joints)),
        strict=True,
    )
    return {
        "time": signals.get("time"),
        "time_unit": signals.get("time_unit", "s"),
        "time_units": list(TIME_UNITS),
        "kind": effort.get("kind"),
        "effort_units": list(EFFORT_UNITS),
        "rows": [
            {
                "joint": joint["name"],
                "position": q,
                "unit": unit or joint["unit"],
                "units": list(
                    POSITION_UNITS["revolute" if joint["unit"] == "rad" else "prismatic"]
                ),
                "sign": sign,
                "effort": column,
                "effort_unit": effort_unit,
            }
            for joint, q, unit, sign, column, effort_unit in rows
        ],
        "declared": bool(signals),
    }


def _columns(given: Any, names: Sequence[str]) -> Any:
    """Columns of a pattern such as `q{}`, one for each joint."""
    if not isinstance(given, str):
        return given
    return expanded(given, [Coordinate(name, "revolute") for name in names])


def _each(given: Any, count: int) -> list[Any]:
    """One value for each joint; of a list of another length as many as there are."""
    values = list(given) if isinstance(given, list | tuple) else [given] * count
    return (values + [None] * count)[:count]


def _short(values: Sequence[Any]) -> Any:
    return values[0] if len(set(values)) == 1 else list(values)


def _added(desk: Desk, form: Values) -> None:
    """After logs were dropped: columns are proposed anew unless the robot file was edited."""
    model = desk.workspace.choices.get("model")
    if isinstance(model, str) and model in desk.workspace.robot_models and _untouched(desk):
        propose(desk, model, desk.workspace.logs)


def _propose(desk: Desk, form: Values) -> None:
    model = desk.workspace.choices.get("model")
    propose(
        desk, one_of({"model": model}, "model", desk.workspace.robot_models), desk.workspace.logs
    )


def _show(desk: Desk, form: Values) -> None:
    desk.workspace.choose(shown=one_of(form, "log", desk.workspace.logs))


def _role(desk: Desk, form: Values) -> None:
    log, role = one_of(form, "log", desk.workspace.logs), one_of(form, "role", [*ROLES])
    desk.workspace.choose(roles={**desk.workspace.choices.get("roles", {}), log: role})


def _payload(desk: Desk, form: Values) -> None:
    text = text_of(form, "mass")
    try:
        mass = float(text.replace(",", ".")) if text else None
    except ValueError:
        mass = math.nan
    if mass is not None and not 0.0 < mass < math.inf:
        raise DataError("the mass is no positive number", where="mass", fix="give it in kg: 1.5")
    desk.workspace.choose(payload_mass=mass)


def _remove(desk: Desk, form: Values) -> None:
    log = one_of(form, "log", desk.workspace.logs)
    desk.workspace.remove(log)
    left = {x: role for x, role in desk.workspace.choices.get("roles", {}).items() if x != log}
    desk.workspace.choose(roles=left)


def _set(desk: Desk, form: Values) -> None:
    """Write what the table says, as far as it differs from the robot file."""
    scene = scene_of(desk)
    table = _table(desk, scene.result) if scene is not None and scene.result else None
    if table is None:
        raise DataError("the robot is not read yet", where="columns", fix="wait a moment")
    rows, count = table["rows"], len(table["rows"])
    fields = ("position", "unit", "sign", "effort", "effort_unit")
    now = {name: [_value(name, form.get(f"{name}-{k}")) for k in range(count)] for name in fields}
    edits = []
    keys = {
        "position": ("signals", "position"),
        "unit": ("signals", "position_unit"),
        "sign": ("signals", "position_sign"),
        "effort": ("signals", "effort", "columns"),
        "effort_unit": ("signals", "effort", "unit"),
    }
    for name in ("time", "time_unit"):
        if (value := _value(name, form.get(name))) and value != table[name]:
            edits.append(Edit(("signals", name), value))
    for name, path in keys.items():
        if now[name] == [row[name] for row in rows] and table["declared"]:
            continue
        if any(value in (None, "") for value in now[name]):
            raise DataError(
                "a column is not chosen yet",
                where=f"{name.replace('_', ' ')} of {rows[now[name].index('')]['joint']}",
                fix="choose one for each joint",
            )
        plain = now[name] if name in ("position", "effort") else _short(now[name])
        edits.append(Edit(path, None if name == "sign" and plain == 1 else plain))
    kind = _value("kind", form.get("kind"))
    if kind and kind != table["kind"]:
        edits.append(
            Edit(("signals", "effort", "kind"), one_of({"kind": kind}, "kind", list(KINDS)))
        )
    if edits:
        desk.workspace.edit_robot(edits)


def _value(name: str, given: Any) -> Any:
    if not isinstance(given, str) or len(given) > 400:
        raise DataError("a field is missing", where=name, fix="load the page again")
    return int(given) if name == "sign" and given in ("1", "-1") else given


STEP = Step(
    "logs",
    "Logs",
    _numbers,
    _locked,
    {
        "added": _added,
        "propose": _propose,
        "show": _show,
        "role": _role,
        "payload": _payload,
        "remove": _remove,
        "set": _set,
    },
)
