"""Reduction with the robot in the loop: excite, run, identify, remove, excite again."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree

from steelyard.base.checked_arguments import checked
from steelyard.base.motion import Rig, run
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.reduction.stopping_rules_and_reduction import criterion_of
from steelyard.excite.excite import design_task
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.searched_or_planned_motion import condition_of_motion
from steelyard.excite.trajectories.trajectory_files import read_trajectory
from steelyard.identify.identify import identify
from steelyard.identify.reduce import reduce
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import refuse_floating


@dataclass(frozen=True, eq=False)
class Round:
    """One round: a motion, its log, and the model that was identified from it."""

    number: int  # from 0 on
    folder: Path  # folder with `motion`, `log.csv` and `model`
    condition: float  # condition number of the motion for the parameters that the model has
    # base parameters that the model does without, in the order of their removal
    removed: tuple[str, ...]
    model: IdentifiedModel  # the model, identified from this round's log alone


@checked(limit=1.0, rounds=1, budget=1.0, searches=1, processes=1, seed=0)
def reduction_loop(
    robot: str | Path | LoadedRobot,
    rig: Rig,
    folder: str | Path,
    *,
    criterion: str = "contribution",
    limit: float = 100.0,
    rounds: int | None = None,
    budget: float = 10.0,
    searches: int | None = None,
    processes: int | None = None,
    seed: int = 0,
    check: bool = True,
    progress: Progress = silent,
) -> tuple[Round, ...]:
    """Reduce a model with the robot in the loop [Wang].

    Each round designs a motion for the parameters that are left, runs it on the robot, identifies
    the model from its log, and removes the parameter that is worth least. It ends where the
    motion's condition number is small enough. A motion is improved from the last one, and the last
    one is run again if none is better, so the condition number never rises. The loop continues
    where it was interrupted: what is in the folder is not made again.

    Args:
        robot: Robot file with the limits of motions; joints weigh as `[estimation] weights` says.
        rig: What runs a motion and logs it.
        folder: Folder of the rounds; made if it does not exist.
        criterion: What a parameter is worth, see `reduce`.
        limit: Condition number at which the loop ends: of the observation matrix of a round's
            motion, designed for the parameters that are left, not normalised.
        rounds: Most rounds; as many as there are parameters if `None`.
        budget: Time of each design [s].
        searches: Number of searches after which a design ends; `None` for no limit.
        processes: Parallel searches; as many as the machine has cores if `None`.
        seed: Same seed and number of searches, same motions.
        check: Whether the first log is checked before it is identified.
        progress: Receives events of progress; an exception from it stops the work.

    Returns:
        All rounds, the last one with the model to use.

    Raises:
        SteelyardError: No motion keeps the limits, or a log cannot be used.

    Example:
        >>> from steelyard.simulate.ground_truth import random_truth
        >>> from steelyard.simulate.virtual_robot import VirtualRobot
        >>> from steelyard.simulate.virtual_robot import customary_sensors
        >>> arm = load_robot("arm.toml").robot
        >>> truth = random_truth(arm, 1)
        >>> rig = VirtualRobot(arm, truth, customary_sensors(arm, truth))
        >>> first, second = reduction_loop("arm.toml", rig, "rounds", rounds=2, limit=1, searches=1)
        >>> second.condition <= first.condition and len(second.removed) == 1
        True
    """
    loaded = load_robot(robot)
    refuse_floating(loaded.robot, "the design of a motion")
    effort = SearchBudget(budget, searches, processes, seed)
    criterion_of(criterion)
    done: list[Round] = []
    while not done or not (
        done[-1].condition <= limit
        or len(done) == rounds
        or len(done[-1].model.estimate.parameters) < 2
    ):
        place = Path(folder) / f"round_{len(done):02d}"
        smaller = _smaller(loaded, done[-1], criterion, progress) if done else None
        condition = _motion(loaded, place, smaller, done, effort, progress)
        log = place / "log.csv"
        if not log.exists():
            run(rig, read_trajectory(_motion_file(place), loaded), log)
        model = _model(loaded, place, smaller, check, progress)
        removed = tuple(one.name for one in model.estimate.removed)
        done.append(Round(len(done), place, condition, removed, model))
    return tuple(done)


def _motion_file(place: Path) -> Path:
    return place / "motion" / "trajectory.json"


def _smaller(
    loaded: LoadedRobot, last: Round, criterion: str, progress: Progress
) -> IdentifiedModel:
    folder, weights = last.folder / "smaller", loaded.estimation.weights
    if not folder.exists():
        reduce(
            last.model,
            last.folder / "log.csv",
            criterion=criterion,
            stop="one_fewer",
            weights=weights,
            progress=progress,
        ).save(folder)
    return load_model(folder)


def _motion(
    loaded: LoadedRobot,
    place: Path,
    smaller: IdentifiedModel | None,
    done: Sequence[Round],
    effort: SearchBudget,
    progress: Progress,
) -> float:
    """Design this round's motion, if it is not there; its condition number."""
    start = _motion_file(done[-1].folder) if done else None
    task = design_task(loaded, earlier=smaller, start=start, criterion="condition")
    if not _motion_file(place).exists():
        motion = task.done(effort, progress=progress)
        if done and not motion.designed.shown.raw <= done[-1].condition:
            copytree(done[-1].folder / "motion", place / "motion")
        else:
            motion.save(place / "motion")
    trajectory = read_trajectory(_motion_file(place), loaded)
    return condition_of_motion(task.tables, trajectory)


def _model(
    loaded: LoadedRobot,
    place: Path,
    smaller: IdentifiedModel | None,
    check: bool,
    progress: Progress,
) -> IdentifiedModel:
    folder, log = place / "model", place / "log.csv"
    if not folder.exists():
        if smaller is None:
            method = "least_squares"
            identify(loaded, log, method=method, check=check, progress=progress).save(folder)
        else:
            weights = loaded.estimation.weights
            reduce(smaller, log, stop="refit", weights=weights, progress=progress).save(folder)
    return load_model(folder)
