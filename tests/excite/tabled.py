"""An arm of three joints with shapes, and what `[excitation]` tables make of it."""

import json
import pickle
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from typing import Any
from unittest.mock import patch

import numpy as np

from designing import random_starts
from excite.colliding import joint, link, urdf, written
from steelyard.excite.constraints.certificate import certify
from steelyard.excite.design_problem_and_information import Earlier, Problem
from steelyard.excite.design_problem_from_tables import Tables, build
from steelyard.excite.search import parallel_search as parallel_search
from steelyard.excite.search.feasibility import (
    NoMotion,
    explained_no_motion,
    refuse_impossible,
)
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.search.repair_until_proven import Kept, finished
from steelyard.excite.searched_or_planned_motion import Designed, design
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.model import Model, with_friction
from steelyard.model.model import model_with_open_friction as model_with_rigid_bodies
from steelyard.robot.file.robot_file import LoadedRobot, load_robot

ARM = urdf(
    link("base", '<cylinder radius="0.08" length="0.1"/>', xyz="0 0 0.05"),
    link("tower", '<cylinder radius="0.06" length="0.2"/>', xyz="0 0 0.1"),
    link("boom", '<box size="0.25 0.06 0.06"/>', xyz="0.14 0 0"),
    link("stick", '<box size="0.6 0.24 0.05"/>', xyz="0.35 0 0"),
    link("tool"),
    joint("base", "tower", "0 0 0.12"),
    joint("tower", "boom", "0 0.15 0.2", "0 1 0"),
    joint("boom", "stick", "0.3 0 0", "0 1 0"),
    joint("stick", "tool", "0.35 0 0.02", kind="fixed", rpy="0 0.5 0"),
).replace('effort="10"', 'effort="60"')
"""Limits of every joint: 2.5 rad, 3 rad/s, 60 Nm."""

QUICK = "[excitation.motion]\nperiod = 4.0\nharmonics = 3\n"
OPEN = "[excitation.collision]\nbodies = false\n"


def arm(folder: Path, tables: str = "", terms: str = '"rigid_body", "viscous"') -> LoadedRobot:
    """The arm, with tables in its robot file."""
    written(folder, ARM)
    head = f'[robot]\nurdf = "arm.urdf"\n[model]\nterms = [{terms}]\n'
    return load_robot(written(folder, head + tables, "arm.toml"))


def model_with_open_friction(loaded: LoadedRobot) -> Model:
    """Its model."""
    return with_friction(model_with_rigid_bodies(loaded), loaded)


def problem_of(folder: Path, tables: str = "", earlier: Earlier | None = None) -> Problem:
    """The problem of tables."""
    loaded = arm(folder, tables)
    return build(loaded, model_with_open_friction(loaded), earlier)


@contextmanager
def searching_here(tables: Tables, method: str, effort: SearchBudget) -> Iterator["Queue[Any]"]:
    """Search in this process, which has all packages loaded; `test_runner` has real ones."""
    messages: Queue[Any] = Queue()
    for number in range(effort.useful):
        task = pickle.loads(parallel_search.task_of(tables, method, effort, number))
        for line in parallel_search.explained_answers(*task, tell=messages.put):
            messages.put(json.loads(json.dumps(line)))
        messages.put({"ended": 0})
    yield messages


def designed(
    folder: Path,
    tables: str = "",
    *,
    earlier: Earlier | None = None,
    start: ExactTrajectory | None = None,
    seed: int = 0,
    seconds: float = 60.0,
) -> Designed:
    """A short design of tables, with its search in this process."""
    loaded = arm(folder, tables)
    effort = SearchBudget(seconds, searches=1, processes=1, seed=seed)
    with patch.object(parallel_search, "_workers", searching_here):
        return design((loaded, model_with_open_friction(loaded), earlier), effort, start=start)


def some_motion(folder: Path, tables: str) -> Kept:
    """The first motion that a search would begin with, proven; whatever refuses it is raised."""
    loaded = arm(folder, tables)
    problem = build(loaded, model_with_open_friction(loaded))
    refuse_impossible(problem, loaded)
    try:
        starts = random_starts(problem.inequalities, np.random.default_rng(0), 3)
        found = finished(problem, starts, deadline=time.monotonic() - 1.0)
    except NoMotion as error:
        raise explained_no_motion(problem, error) from None
    assert certify(loaded.robot, found.trajectory, problem.limits, problem.constraints).holds
    return found
