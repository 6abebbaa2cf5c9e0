"""What `steelyard compare` compares: estimators by name, and the data that they are given."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from steelyard.errors import ModelError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.register import ESTIMATORS, Context, Offer, offer_of
from steelyard.identification.checks.precheck import passed, prechecked
from steelyard.identification.described_model import model_with_open_friction
from steelyard.identification.descriptions import dropped, dropped_rows, notes_of
from steelyard.identification.method import Sources, context_of, method_of
from steelyard.identification.named_logs import log_files, refuse_overlaps, runs_of, signals_of
from steelyard.identification.prepare_model import Ground, Payload, grounded
from steelyard.progress import Progress
from steelyard.regression.regressor import base_regressor
from steelyard.report import ReportContent
from steelyard.robot_file.file import load_robot
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.validation.compare import Parts
from steelyard.validation.comparison import Comparison
from steelyard.validation.cross import longest_window
from steelyard.validation.friction.mixes import remembers

ONE_RUN = (
    "it simulates whole runs, and there is only one",
    "give several logs, or several cuts of this one: LOG@0:10 LOG@10:20",
)
"""Why a single run cannot be left out of an experiment."""


@dataclass(frozen=True, eq=False)
class ComparisonInputs:
    """What estimators are given.

    Attributes:
        context: What they are made from.
        parts: What they look at.
        ground: The model and its runs.
        notes: What is missing, assumed or doubtful.
        details: What else was decided on the way.
        lines: What to write into the robot file for estimators that it does not choose now.
    """

    context: Context
    parts: Parts
    ground: Ground
    notes: tuple[str, ...]
    details: tuple[str, ...]
    lines: Mapping[str, str]

    def content(self, comparison: Comparison) -> ReportContent:
        """What the page shows."""
        name = self.ground.model.robot.name
        return ReportContent(
            title=f"{name}: estimators compared",
            robot=name,
            qualities=tuple((run.name, run.quality.rows_of_text) for run in self.ground.runs),
            notes=self.notes,
            details=self.details,
            friction=self.ground.choice,
            findings=self.ground.findings,
            gains=self.ground.gains,
            comparison=comparison,
        )


def offers_of(names: Sequence[str], everything: bool) -> tuple[Offer, ...]:
    """The estimators that are named; if none is, those that neither search nor simulate.

    Args:
        names: Their names; several may stand in one, with commas between them.
        everything: Without names, also those that search or simulate.

    Raises:
        ModelError: There is none of that name, or both names and all are requested.
    """
    if names and everything:
        raise ModelError(
            "estimators are named, and all are requested",
            where="estimators, everything (--estimators, --all)",
            fix="leave out one of the two",
        )
    if not names:
        return tuple(offer for offer in ESTIMATORS if everything or not offer.slow)
    each = [name.strip() for some in names for name in some.split(",") if name.strip()]
    found = [offer_of(name, "estimators (--estimators)") for name in each]
    return tuple(dict.fromkeys(found))


def comparison_inputs(
    robot: str | Path | LoadedRobot,
    logs: Sequence[str],
    check: bool,
    threads: int,
    progress: Progress,
    base: str | None = None,
) -> ComparisonInputs:
    """Clean runs, the model with all that its file leaves open, and what the runs say of it."""
    file = load_robot(robot, base=base)
    files = log_files(logs)
    refuse_overlaps(files, ())
    signals, reasons = signals_of(file, files[0])
    if signals.unknown_gains and all(signals.unknown_gains):
        raise ModelError(
            "estimators cannot be compared while every drive gain is to be identified",
            where="[signals.effort] gain",
            fix="identify the gains first (steelyard identify ROBOT LOG --loaded LOG "
            "--payload-mass KG), and write them into the robot file",
        )
    model = model_with_open_friction(file)
    found_out = (
        prechecked(file.reference, replace(file, signals=signals), files, progress)
        if check
        else None
    )
    runs = runs_of(file, signals, files, (), progress)[0]
    unresolved = () if found_out is None else passed(found_out, file.reference)
    ground = grounded(model, file, runs, (), Payload(), WeightedLeastSquares(), threads, progress)
    notes = (*file.notes, *reasons, *dropped_rows(runs), *unresolved)
    details = (*notes_of(runs), *ground.notes, *dropped(model, runs))
    return _given(ground, file, notes, details, threads, progress)


def _given(
    ground: Ground,
    file: LoadedRobot,
    notes: tuple[str, ...],
    details: tuple[str, ...],
    threads: int,
    progress: Progress,
) -> ComparisonInputs:
    """One more pass, in windows that parts can be made of."""
    model, runs = ground.model, ground.runs
    regressor, rests = base_regressor(model), remembers(model.terms)
    information_of = information_from(
        runs,
        rests=rests,
        longest=longest_window(runs),
        threads=threads,
        progress=progress,
    )
    information = information_of(regressor)
    context = context_of(file, regressor, runs, progress)
    sources = Sources(regressor, runs, information, threads, progress)
    several = len(runs) > 1
    parts = Parts.of(
        runs,
        information,
        {"samples": sources.samples, **({"experiment": sources.experiment} if several else {})},
        {"experiment": ONE_RUN},
    )
    return ComparisonInputs(
        context, parts, ground, notes, (*details, *context.knowledge.notes), lines_of(file)
    )


def lines_of(file: LoadedRobot) -> dict[str, str]:
    """What to write into the robot file for every estimator that it does not choose now."""
    now = method_of(file)
    return {
        offer.name: f'[estimation] method = "{offer.name}"'
        for offer in ESTIMATORS
        if offer.name != now.name
    }
