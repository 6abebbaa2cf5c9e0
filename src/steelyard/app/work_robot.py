"""Work on a robot in a process: its bodies as solids in space, and robot files for it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.app.workspace import Workspace
from steelyard.base.arrays import Array
from steelyard.base.progress import Progress, report_progress
from steelyard.check.decision.drive_gains_and_what_init_learns import (
    known_from_logs,
    refuse_other_columns,
)
from steelyard.excite.collision.solids_and_shapes import Shape
from steelyard.excite.collision.workspace_from_tables import tool_of
from steelyard.excite.page.browser_replay import mesh_of, shapes_of, sticks
from steelyard.identify.page.link_inertias_and_ellipsoids import semi_axes
from steelyard.report.page import packed, rounded
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.init.draft_robot_file import assigned, drafted, gears_of, proposed
from steelyard.robot.init.draft_tables import Known
from steelyard.robot.robot import Body, Coordinate
from steelyard.runs.runs_of_named_logs import log_files, sample_of

FREE_RANGE = np.pi  # of a slider where the model states no limit [rad; m]


def scene(robot: str, progress: Progress) -> dict[str, Any]:
    """Bodies, joints and shapes of a robot file, for the scene of the page."""
    loaded = load_robot(robot)
    arm = loaded.robot
    report_progress(progress, "shapes", 0.0, 1.0)
    shapes, notes = shapes_of(loaded)
    shapes = (*shapes, *sticks(arm, tool_of(None, arm), {shape.body for shape in shapes}))
    return {
        "name": arm.name,
        "floating": arm.floating,
        "bodies": [_body(body) for body in arm.bodies],
        "joints": [_joint(one, at) for one, at in zip(arm.joints, arm.assembly, strict=True)],
        "identified": arm.n,
        "solids": [solid_of(shape) for shape in shapes],
        "notes": [*dict.fromkeys((*loaded.notes, *loaded.ignored.values(), *notes))],
        "signals": loaded.signals is not None,
        "targets": loaded.targets is not None,
    }


def _body(body: Body) -> dict[str, Any]:
    inertia, ellipsoid = body.inertia, None
    if body.known and (found := semi_axes(inertia)) is not None:
        ellipsoid = {"half": found[0].tolist(), "axes": _proper(found[1]).ravel().tolist()}
    return {
        "name": body.name,
        "joint": body.joint,
        "kind": body.kind,
        "parent": body.parent,
        "rotation": body.rotation.ravel().tolist(),
        "position": body.position.tolist(),
        "axis": body.axis.tolist(),
        "coordinate": body.coordinate,
        "ratio": body.ratio,
        "offset": body.offset,
        "mass": rounded(inertia.mass, 4) if body.known else None,
        "com": inertia.com.tolist() if inertia.mass > 0.0 else None,
        "ellipsoid": ellipsoid,
    }


def _proper(axes: Array) -> Array:
    """Directions as a rotation: one of them may point the other way."""
    return np.asarray(axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))]))


def _joint(joint: Coordinate, at: float) -> dict[str, Any]:
    limits = joint.limits
    low = limits.lower if np.isfinite(limits.lower) else -FREE_RANGE
    high = limits.upper if np.isfinite(limits.upper) else FREE_RANGE
    return {
        "name": joint.name,
        "unit": joint.unit,
        "lower": low,
        "upper": high,
        "limited": bool(np.isfinite([limits.lower, limits.upper]).all()),
        "velocity": rounded(limits.velocity, 4),
        "effort": rounded(limits.effort, 4),
        "effort_unit": joint.effort_unit,
        "at": float(np.clip(at, low, high)),
    }


def solid_of(shape: Shape) -> dict[str, Any]:
    """A shape as the scene of the page draws it."""
    corners, faces = mesh_of(shape.solid)
    return {
        "body": shape.body,
        "rotation": shape.rotation.ravel().tolist(),
        "position": shape.position.tolist(),
        "corners": packed(corners.ravel()),
        "faces": faces.ravel().tolist(),
    }


def init(model: str, logs: Sequence[str], progress: Progress) -> dict[str, Any]:
    """Write the robot file as `steelyard init MODEL LOG... --no-input` does; what it rests on."""
    workspace = Workspace(Path.cwd())
    proposal, found = proposed(model), log_files(logs)
    report_progress(progress, "reading logs", 0.0, 1.0)
    columns, sample = sample_of(found[0].path) if found else (None, None)
    assignment, known = assigned(proposal, columns, sample), Known()
    moving, guess = assignment.moving, assignment.guess
    if guess is not None:
        refuse_other_columns(found, guess, moving)
        gears = gears_of(proposal, moving, guess)
        known = known_from_logs(proposal.loaded, moving, found, guess, gears)
        known = replace(known, gears=gears)
    draft = drafted(proposal, assignment, workspace.robot_file, known)
    report_progress(progress, "writing", 1.0, 1.0)
    asked = workspace.choices.get("model"), workspace.choices.get("init")
    if asked == (model, list(logs)):  # and nothing else since
        workspace.draft_robot(draft.text)
    return {
        "reasons": list(draft.reasons),
        "contradictions": [] if guess is None else list(guess.contradictions),
        "missing": [list(pair) for pair in draft.missing],
        "without": list(draft.without_columns),
        "notes": list(proposal.notes),
        "friction": known.friction,
        "gains": known.gains_source,
    }
