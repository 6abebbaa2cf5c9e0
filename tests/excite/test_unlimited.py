"""A limit that cannot be kept is refused where it was requested, and noted where it was not."""

from pathlib import Path

import pytest

from excite.colliding import written
from excite.tabled import ARM, OPEN, arm, model_with_open_friction, problem_of
from excite.test_criterion_table import earlier
from steelyard.base.errors import ModelError, OutputError
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import EffortLimit
from steelyard.excite.constraints.constraint_and_limits import Declined
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.excite import refuse_formats
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.searched_or_planned_motion import design
from steelyard.robot.file.robot_file import load_robot

COMPENSATED = """[signals]
time = "t"
position = "q_{joint}"
[signals.effort]
columns = "tau_{joint}"
kind = "KIND"
unit = "Nm"
"""
LIMITS = "[excitation.limits]\n"
EFFORT_LIMITS = ["effort = 20.0", "power = 30.0", "total_power = 30.0"]
DAHL = '"rigid_body", {law = "dahl", length = 0.01}'
LOAD = "[[excitation.loads]]\nmass = 2.0\n"
ANY = f'{OPEN}{LIMITS}effort = "any"\n'
PLANNED = '[excitation.motion]\nkind = "sweeps"\n'


def names_of(problem: Problem) -> list[str]:
    return [constraint.name for constraint in problem.constraints]


def test_efforts_without_gravity_limit_no_torque(tmp_path: Path) -> None:
    usual = problem_of(tmp_path, OPEN + COMPENSATED.replace("KIND", "joint_torque"))
    assert names_of(usual) == ["torque"]
    tables = OPEN + COMPENSATED.replace("KIND", "gravity_compensated_torque")
    problem = problem_of(tmp_path, tables)
    note = "torque is not limited: the robot file's efforts are gravity compensated"
    assert names_of(problem) == [] and note in problem.notes
    for limit in EFFORT_LIMITS:
        with pytest.raises(ModelError, match="cannot be limited: .* gravity compensated"):
            problem_of(tmp_path, f"{tables}{LIMITS}{limit}\n")


def test_friction_with_memory_of_an_earlier_model_limits_no_torque(tmp_path: Path) -> None:
    known, loaded = earlier(tmp_path), arm(tmp_path, OPEN, DAHL)
    problem = build(loaded, model_with_open_friction(loaded), known)
    note = "torque is not limited: 'dahl' has internal states"
    assert names_of(problem) == [] and note in problem.notes
    assert names_of(build(loaded, model_with_open_friction(loaded))) == ["torque"]
    for limit in EFFORT_LIMITS:
        loaded = arm(tmp_path, f"{OPEN}{LIMITS}{limit}\n", DAHL)
        with pytest.raises(ModelError, match="limited: 'dahl' has internal states"):
            build(loaded, model_with_open_friction(loaded), known)


def test_planned_motions_are_held_to_the_same(tmp_path: Path) -> None:
    known, loaded = earlier(tmp_path), arm(tmp_path, f"{OPEN}{LIMITS}effort = 9.0\n{PLANNED}", DAHL)
    with pytest.raises(ModelError, match="limited: 'dahl' has internal states"):
        design((loaded, model_with_open_friction(loaded), known), SearchBudget(20.0, processes=1))


def notes_without(folder: Path, joints: int, tables: str = "") -> tuple[tuple[str, ...], list[str]]:
    """Notes and constraints of an arm whose first joints have no limit of effort."""
    arm(folder)
    written(folder, ARM.replace('effort="60"', 'effort="0"', joints))
    (folder / "arm.toml").write_text((folder / "arm.toml").read_text() + OPEN + tables)
    loaded = load_robot(folder / "arm.toml")
    problem = build(loaded, model_with_open_friction(loaded))
    return problem.notes, names_of(problem)


def test_joints_without_a_limit_of_effort_are_named(tmp_path: Path) -> None:
    head = "torque is not limited for joints without a known effort limit: "
    notes, names = notes_without(tmp_path, 1)
    assert head + "'tower_joint'" in notes and names == ["torque"]
    notes, names = notes_without(tmp_path, 3)
    assert head + "'tower_joint', 'boom_joint', 'stick_joint'" in notes and names == []
    for tables in ('effort = "any"', "effort = 20.0"):
        notes, _ = notes_without(tmp_path, 3, f"{LIMITS}{tables}\n")
        assert not any(head in note for note in notes)


def test_speeds_above_the_robots_own_are_noted(tmp_path: Path) -> None:
    notes = problem_of(tmp_path, f"{OPEN}{LIMITS}share = 1.0\nvelocity = {{boom_joint = 20}}").notes
    words = "the model file's speed limits are exceeded"
    (line,) = [note for note in notes if words in note]
    assert line.endswith(": boom_joint 20 against 3 rad/s") and isinstance(line, Declined)
    assert not any(words in n for n in problem_of(tmp_path, f"{OPEN}{LIMITS}velocity = 3").notes)


def test_the_headline_says_whose_torques_are_limited(tmp_path: Path) -> None:
    (torque,) = problem_of(tmp_path, OPEN).constraints
    assert isinstance(torque, EffortLimit)
    assert torque.scope == "masses of the model file, without friction"


def test_limits_that_nobody_gave_are_assumed(tmp_path: Path) -> None:
    names = {"tower_joint", "boom_joint", "stick_joint"}
    every = {("acceleration", name) for name in names}
    assert problem_of(tmp_path, OPEN).limits.assumed == every
    one = problem_of(tmp_path, f"{OPEN}{LIMITS}acceleration = {{boom_joint = 2.0}}").limits
    assert one.assumed == every - {("acceleration", "boom_joint")} and one.share == 0.95
    assert not problem_of(tmp_path, f"{OPEN}{LIMITS}acceleration = 2.0").limits.assumed


def test_loads_without_radius_are_noted_where_links_are_looked_at(tmp_path: Path) -> None:
    note = "loads without a radius are not checked against the robot's own links: load 1"
    box = "[excitation.workspace]\nbox = {z = [-2.0, 2.0]}\n"
    assert note in problem_of(tmp_path, LOAD).notes
    assert note not in problem_of(tmp_path, f"{LOAD}radius = 0.1\n").notes
    assert note not in problem_of(tmp_path, OPEN + LOAD).notes
    assert note not in problem_of(tmp_path, OPEN + box).notes


def test_a_radius_alone_is_noted(tmp_path: Path) -> None:
    tables, words = f"{ANY}[excitation.workspace]\nradius = 0.1\n", "radius has no effect"
    assert any(words in note for note in problem_of(tmp_path, tables).notes)
    constrained = problem_of(tmp_path, tables + "box = {z = [-2.0, 2.0]}\n")
    assert not any(words in note for note in constrained.notes)


def test_too_many_samples_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="samples"):
        arm(tmp_path, "[excitation]\nsamples = 1_000_001\n")


def test_a_table_too_long_is_refused_before_the_search(tmp_path: Path) -> None:
    loaded = arm(tmp_path, "[excitation.motion]\nperiod = 30.0\n")
    refuse_formats(loaded, ["csv"], 1000.0)
    with pytest.raises(OutputError, match="30 s at 1e\\+06 points per second are more than"):
        refuse_formats(loaded, ["csv"], 1e6)
