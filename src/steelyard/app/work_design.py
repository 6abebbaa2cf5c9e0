"""Work on a motion in a process: its room, its design, what is left to the walls, a rehearsal."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.app.work_logs import COLOURS, MOST_FRAMES
from steelyard.app.work_robot import scene, solid_of
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.base.files import read_json, whole_folder
from steelyard.base.progress import Progress, report_progress
from steelyard.excite.collision.solids_and_shapes import Ball, Box, Shape
from steelyard.excite.collision.workspace_from_tables import tool_of, walls_of, world_of
from steelyard.excite.design_problem_from_tables import constraints_of
from steelyard.excite.excite import design_excitation, design_task
from steelyard.excite.page.browser_replay import staged
from steelyard.excite.page.design_text import design_headline, design_level, scopes
from steelyard.excite.page.tool_path_and_walls import all_lines, faces_of
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.trajectory_files import read_trajectory
from steelyard.identify.identify import identify
from steelyard.identify.page.parameters_and_truth import TruthSection
from steelyard.report.page import packed
from steelyard.report.page_figures import Figure, line
from steelyard.report.words import significant
from steelyard.robot.file.excitation_sections import WorkspaceSection
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import body_frames
from steelyard.simulate.ground_truth import read_truth
from steelyard.simulate.simulate import simulate

LEAST_TOOL_RADIUS = 0.012  # of the ball that is drawn for the tool [m]
OPEN_WALL_SHARE = 0.6  # how far walls without an end are drawn, over the length of the arm
MOST_PATH_POINTS = 800  # of the tool's path that is drawn
CLEARANCE_SAMPLES = 600  # times at which clearances are drawn
MOST_CURVES = 2  # the smallest clearances of a constraint that are drawn
MOST_MARGINS = 3  # the smallest proven margins of a constraint that are listed


def room(robot: str, progress: Progress) -> dict[str, Any]:
    """The scene of a robot with its tool, its walls and its cell, and the frames it has."""
    loaded = load_robot(robot)
    reach = sum(float(np.linalg.norm(body.position)) for body in loaded.robot.bodies)
    corners = OPEN_WALL_SHARE * reach * np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    return _room(robot, loaded, corners, progress)


def _room(robot: str, loaded: LoadedRobot, seen: Array, progress: Progress) -> dict[str, Any]:
    """The same; walls without an end go on beyond what is seen, `(N, 3)` [m]."""
    arm, section = loaded.robot, loaded.excitation.workspace
    tool = tool_of(section, arm)
    at = tool.on(arm)
    ball = Ball(max(tool.radius, LEAST_TOOL_RADIUS))
    marker = Shape(tool.frame, at.body, at.rotation, at.position, ball)
    forbidden = [
        w for w in walls_of(section or WorkspaceSection(), arm) if isinstance(w.solid, Box)
    ]
    solids = [
        solid_of(marker) | {"colour": "--green", "opacity": 0.8},
        *(solid_of(wall) | {"colour": "--poor", "opacity": 0.2} for wall in forbidden),
        *(solid_of(thing) | {"colour": "--amber", "opacity": 0.4} for thing in world_of(loaded)),
    ]
    faces = faces_of(section, arm, seen)
    kinds = [(bad, [face for face in faces if face.forbidden == bad]) for bad in (False, True)]
    drawn = scene(robot, progress)
    return drawn | {
        "bodies": [body | {"ellipsoid": None} for body in drawn["bodies"]],
        "solids": [*drawn["solids"], *solids],
        "lines": [
            {"points": all_lines(own).tolist(), "colour": "--poor" if bad else "--blue"}
            for bad, own in kinds
            if own
        ],
        "frames": list(dict.fromkeys(f.name for f in (*body_frames(arm)[1:], *arm.frames))),
        "tool": tool.frame,
    }


def design(
    robot: str, folder: str, budget: float, formats: Sequence[str], progress: Progress
) -> dict[str, Any]:
    """What `steelyard excite ROBOT --budget S --format NAME -o FOLDER` does.

    A stop ends the search, and keeps the best motion so far.
    """
    found = design_excitation(robot, budget=budget, formats=formats, progress=progress)
    with whole_folder(Path(folder)) as part:
        found.written_to(part)
    designed = found.designed
    return {
        "folder": folder,
        "level": design_level(designed),
        "line": design_headline(designed),
        "scopes": scopes(designed),
        "gaps": list(designed.certificate.gaps),
        "failures": list(designed.certificate.failures),
        "stopped": designed.stopped,
        "withheld": [form for form in formats if form not in found.written_formats],
    }


def view(robot: str, folder: str, progress: Progress) -> dict[str, Any]:
    """A designed motion as frames and clearances over time, in the room as it is now."""
    loaded = load_robot(robot)
    motion = read_trajectory(Path(folder) / "trajectory.json", loaded)
    stage = staged(loaded, motion)
    frames = slice(None, None, -(-len(stage.t) // MOST_FRAMES))
    found = _room(robot, loaded, stage.path, progress)
    points = stage.path[:: -(-len(stage.path) // MOST_PATH_POINTS)].round(4)
    path = np.stack([points[:-1], points[1:]], axis=1)
    report_progress(progress, "clearances", 0.0, 0.0)
    return found | {
        "lines": [*found["lines"], {"points": path.tolist(), "colour": "--vermillion"}],
        "motion": {"t": packed(stage.t[frames]), "q": packed(stage.joints[frames].ravel())},
        **_clearances(loaded, motion),
        "proven": _proven(Path(folder) / "certificate.json"),
    }


def _clearances(loaded: LoadedRobot, motion: ExactTrajectory) -> dict[str, Any]:
    """The smallest clearances over time as a figure with its key, and those that are violated."""
    constraints, _ = constraints_of(*design_task(loaded).tables)
    t = np.linspace(0.0, motion.duration, CLEARANCE_SAMPLES)
    state = motion.sample(t)
    curves, beyond = list[tuple[str, Array]](), list[str]()
    for constraint in (one for one in constraints if one.unit == "m"):
        margins = constraint.margins(state.q, state.dq, state.ddq).values
        least = margins.min(axis=0)
        order = np.argsort(least)
        curves += [(constraint.labels[k], margins[:, k]) for k in order[:MOST_CURVES]]
        beyond += [
            f"{constraint.labels[k]}: violated by {significant(-1e3 * least[k])} mm"
            for k in order[: int(np.sum(least < 0.0))]
        ]
    lines = [
        line(label, t, 1e3 * margins, colour, width=1.4)
        for (label, margins), colour in zip(curves, COLOURS, strict=False)
    ]
    label = "The smallest clearances over time"
    layout = {"yaxis": {"rangemode": "tozero"}, "showlegend": False}
    figure = Figure(label, label, "time [s]", "clearance [mm]", lines, layout)
    key = [[colour, one] for (one, _), colour in zip(curves, COLOURS, strict=False)]
    return {"figure": figure.json if lines else None, "key": key, "beyond": beyond}


def _proven(certificate: Path) -> list[dict[str, Any]]:
    """The smallest margins of every constraint that the certificate proves."""

    def parse(values: Any) -> list[dict[str, Any]]:
        found = []
        for one in values["constraints"]:
            known = [m for m in one["margins"] if m["proven"] is not None]
            for margin in sorted(known, key=lambda m: m["proven"] / m["room"])[:MOST_MARGINS]:
                least = float(margin["proven"])
                scaled = (1e3 * least, "mm") if one["unit"] == "m" else (least, str(one["unit"]))
                row = {"name": str(one["name"]), "label": str(margin["label"])}
                found.append(row | {"least": scaled[0], "unit": scaled[1]})
        return found

    return read_json(
        certificate,
        parse,
        what="the certificate",
        damaged="the certificate is damaged",
        fix="design the motion again",
    )


def rehearse(robot: str, motion: str, folder: str, seed: int, progress: Progress) -> dict[str, Any]:
    """A virtual robot with planted parameters runs a motion; they are identified from its log.

    As `steelyard simulate ROBOT --motion MOTION --seed N`, a second run of the same robot with a
    random motion, and `steelyard identify ROBOT designed.csv --validate other.csv`.
    """
    with whole_folder(Path(folder)) as part:
        run = simulate(
            robot, part / "run", Path(motion) / "trajectory.json", seed=seed, progress=progress
        )
        other = simulate(
            robot, part / "other", truth=run.files.truth, seed=seed + 1, progress=progress
        )
        log = run.files.log.rename(part / "designed.csv")
        unseen = other.files.log.rename(part / "other.csv")
        truth, _ = read_truth(run.files.truth, load_robot(robot).robot)
        found = identify(robot, log, unseen, progress=progress).beside(truth.values)
        (part / "model").mkdir()
        found.write(part / "model")
    told = TruthSection().numbers(found.content)
    if told is None:
        raise ModelError(
            "no parameter of the virtual robot has an interval",
            where=robot,
            fix="see the report of the rehearsal",
        )
    (table,), (figure,) = told["tables"], told["groups"][0].figures
    return {
        "folder": folder,
        "level": found.verdict.level,
        "line": found.verdict.line,
        "words": told["words"],
        "figure": figure.json,
        "height": figure.height,
        "headings": list(table.headings),
        "rows": [list(row.cells) for row in table.rows],
    }
