"""Step 1, the robot: a model file or a Denavit-Hartenberg table, the arm in space, its notes."""

from collections.abc import Sequence
from math import isfinite

from steelyard.app.jobs import Work
from steelyard.app.step import Desk, Outcome, Step, Values, one_of, text_of
from steelyard.base.errors import DataError
from steelyard.robot.file.toml_edits import toml_key, toml_text

DH_COLUMNS = ("a", "alpha", "d", "theta")
DH_EXAMPLE = """0.0  90  0.181  0
-0.613  0  0.0  0
-0.572  0  0.0  0
0.0  90  0.174  0
0.0 -90  0.120  0
0.0   0  0.117  0"""
"""The arm of a UR10e, for the empty field."""

MOST_DH_ROWS = 40


def scene_work(desk: Desk) -> Work:
    """The robot's bodies and shapes in space."""
    workspace = desk.workspace
    name = workspace.robot_file.name
    files = (name, *workspace.model_files)
    return Work("steelyard.app.work_robot:scene", {"robot": name}, files, "reading the robot")


def scene_of(desk: Desk) -> Outcome | None:
    """The scene of the robot file; `None` without one."""
    return desk.done(scene_work(desk)) if desk.workspace.robot_text is not None else None


def init_work(desk: Desk, model: str, logs: Sequence[str]) -> Work:
    """The robot file for a model and logs."""
    words = "proposing a robot file"
    given = {"model": model, "logs": list(logs)}
    return Work("steelyard.app.work_robot:init", given, (model, *logs), words)


def init_of(desk: Desk) -> Outcome | None:
    """What is known of the robot file that was proposed last."""
    model = desk.workspace.choices.get("model")
    if not isinstance(model, str) or model not in desk.workspace.robot_models:
        return None
    return desk.look(init_work(desk, model, desk.workspace.choices.get("init", ())))


def propose(desk: Desk, model: str, logs: Sequence[str]) -> None:
    """Begin to write the robot file for a model and logs."""
    desk.workspace.choose(model=model, init=list(logs))
    desk.again(init_work(desk, model, logs))


def _numbers(desk: Desk) -> Values:
    workspace = desk.workspace
    return {
        "models": workspace.robot_models,
        "chosen": workspace.choices.get("model"),
        "text": workspace.robot_text,
        "robot_file": workspace.robot_file.name,
        "scene": scene_of(desk),
        "init": init_of(desk),
        "dh_example": DH_EXAMPLE,
    }


def _added(desk: Desk, form: Values) -> None:
    """After files were dropped: with one model and no robot file yet, that is the robot."""
    models = desk.workspace.robot_models
    if desk.workspace.robot_text is None and len(models) == 1:
        propose(desk, models[0], desk.workspace.logs)


def _choose(desk: Desk, form: Values) -> None:
    propose(desk, one_of(form, "model", desk.workspace.robot_models), desk.workspace.logs)


def _table(desk: Desk, form: Values) -> None:
    """A robot file with a Denavit-Hartenberg table."""
    convention = one_of(form, "convention", ("standard", "modified"))
    rows = [row for row in text_of(form, "rows", 4000).splitlines() if row.strip()]
    if not 0 < len(rows) <= MOST_DH_ROWS:
        raise DataError("the table has no rows, or too many", where="rows", fix="one row a joint")
    links = [_dh_row(number, row) for number, row in enumerate(rows, 1)]
    name = text_of(form, "name") or "arm"
    lines = [
        f"{{ {', '.join(f'{toml_key(k)} = {v!r}' for k, v in link.items())} }}," for link in links
    ]
    desk.workspace.write_robot(
        "\n".join(
            [
                "[robot]",
                f"name = {toml_text(name)}",
                "",
                "[robot.dh]",
                f"convention = {toml_text(convention)}",
                'angle_unit = "deg"',
                "links = [",
                *(f"  {line}" for line in lines),
                "]",
                "",
            ]
        )
    )


def _dh_row(number: int, row: str) -> dict[str, float]:
    words = row.replace(",", " ").replace(";", " ").split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != len(DH_COLUMNS) or not all(map(isfinite, values)):
        raise DataError(
            f"row {number} of the table is not four numbers",
            where=f"row {number}: {row}",
            fix="write a [m], alpha [deg], d [m], theta [deg] with spaces between them",
        )
    return dict(zip(DH_COLUMNS, values, strict=True))


STEP = Step(
    "robot",
    "Robot",
    _numbers,
    actions={"added": _added, "choose": _choose, "table": _table},
)
