"""Which data are fitted: below what cut-off, and without which stretches."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from steelyard.base.progress import Progress
from steelyard.check.fitted.changes_within_run import force_of_run, force_words
from steelyard.estimate.scores.cutoff_choice import choose_cutoff
from steelyard.identify.fit import Fit
from steelyard.identify.gains_zeros_and_friction import FitTask
from steelyard.model.model import Model, with_friction
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.signals import Signals
from steelyard.runs.run import Run

MOST_FORCES = 3  # rounds in which a force is found in each run


def below_described_band(
    loaded: LoadedRobot,
    signals: Signals,
    model: Model,
    runs: Sequence[Run],
    threads: int,
    progress: Progress,
) -> tuple[LoadedRobot, tuple[str, ...]]:
    """The robot with the cut-off of regression at which its model predicts best, and why.

    As it is where the robot file states one, gains or zeros are unknown, or none is better.
    """
    stated = loaded.processing.matched_cutoff is not None
    if stated or any(signals.unknown_gains) or any(signals.unknown_offsets):
        return loaded, ()
    choice = choose_cutoff(with_friction(model, loaded), runs, threads, progress)
    if choice is None or choice.chosen == choice.cutoffs[0]:
        return loaded, ()
    cutoff = {"matched_cutoff": choice.chosen}
    return replace(loaded, processing=loaded.processing.model_copy(update=cutoff)), (choice.note,)


def without_forces(
    found: Fit, refit: Callable[[FitTask, tuple[str, ...]], Fit]
) -> tuple[Fit, tuple[str, ...]]:
    """The fit to what is left of the runs without forces that pass, and what is left out.

    A round leaves out one force of each run; `refit` fits anew, with notes on what is left out.
    """
    notes: tuple[str, ...] = ()
    for _ in range(MOST_FORCES):
        identified, information = found.identified, found.information
        groups = information.windows_of_runs
        forces = {
            run.name: force
            for run in found.runs
            if run.name in groups
            and (force := force_of_run(identified, information.of(groups[run.name]), run))
        }
        if not forces:
            break
        coordinates = identified.model.robot.coordinates
        notes += tuple(
            f"{name}: efforts {force.when} are left out of the fit: a force acts that the other "
            f"motion does not have, as by a contact (rms {force_words(force, coordinates)})"
            for name, force in forces.items()
        )
        runs = tuple(
            run.leaving_out([forces[run.name].stretch]) if run.name in forces else run
            for run in found.task.runs
        )
        found = refit(replace(found.task, runs=runs), notes)
    return found, notes
