"""What `steelyard compare` compares: estimators by name, and the data that they are given."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add

from steelyard.errors import ModelError
from steelyard.estimation.closed_loop.experiment import Experiment
from steelyard.estimation.fields.fields import said_by
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.prior.wishes import knowledge_of
from steelyard.estimation.register import ESTIMATORS, Context, Offer
from steelyard.identification.descriptions import dropped, notes_of
from steelyard.identification.logs import log_files, model_of, refuse_overlaps, runs_of, signals_of
from steelyard.identification.precheck import checked, passed
from steelyard.identification.prepare_model import Ground, Payload, grounded, own_columns
from steelyard.measurement import Run
from steelyard.measurement.run import fastest_of
from steelyard.progress import Progress
from steelyard.regression.gather_samples import gather_samples
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor, base_regressor
from steelyard.regression.samples import Samples
from steelyard.report import ReportContent
from steelyard.robot_file.file import LoadedRobot, load_robot
from steelyard.robot_file.sections import EstimationSection
from steelyard.suggest import advice
from steelyard.validation.compare import Parts
from steelyard.validation.cross import longest_window, stretches_of
from steelyard.validation.friction.mixes import remembers
from steelyard.validation.trial import Comparison

ONE_RUN = (
    "it simulates whole runs, and there is only one",
    "give several logs, or several cuts of this one: LOG@0:10 LOG@10:20",
)
"""Why a single run cannot be left out of an experiment."""


@dataclass(frozen=True, eq=False)
class Rivals:
    """What estimators are given.

    Attributes:
        context: What they are made from.
        parts: What they look at.
        ground: The model and its runs.
        notes: What was decided on the way.
        lines: What to write into the robot file for estimators that it does not choose now.
    """

    context: Context
    parts: Parts
    ground: Ground
    notes: tuple[str, ...]
    lines: Mapping[str, str]

    def content(self, comparison: Comparison) -> ReportContent:
        """What the page shows."""
        name = self.ground.model.robot.name
        return ReportContent(
            title=f"{name}: estimators compared",
            robot=name,
            qualities=tuple((run.name, run.quality.rows_of_text) for run in self.ground.runs),
            notes=self.notes,
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
        ModelError: There is none of that name, or both names and all are asked for.
    """
    if names and everything:
        raise ModelError(
            "both --estimators and --all are given",
            where="--estimators with --all",
            mend="leave out one of the two options",
        )
    if not names:
        return tuple(offer for offer in ESTIMATORS if everything or not offer.slow)
    known = {_plain(offer.name): offer for offer in ESTIMATORS}
    each = [name.strip() for some in names for name in some.split(",") if name.strip()]
    for name in each:
        if _plain(name) not in known:
            raise ModelError(
                f"there is no estimator '{name}'",
                where="--estimators",
                mend=advice(name, [o.name for o in ESTIMATORS], "estimators", len(ESTIMATORS)),
            )
    return tuple(known[name] for name in dict.fromkeys(map(_plain, each)))


def _plain(name: str) -> str:
    """A name whatever its case, and whatever stands between its words."""
    return name.lower().replace("-", " ").replace("_", " ")


def rivals_of(
    robot: str,
    logs: Sequence[str],
    check: bool,
    threads: int,
    progress: Progress,
    base: str | None = None,
) -> Rivals:
    """Clean runs, the model with all that its file leaves open, and what the runs say of it."""
    file = load_robot(robot, base=base)
    files = log_files(logs)
    refuse_overlaps(files, ())
    signals, reasons = signals_of(file, files[0])
    if signals.unknown_gains and all(signals.unknown_gains):
        raise ModelError(
            "estimators cannot be compared while every drive gain is to be identified",
            where="[signals.effort] gain",
            mend="identify the gains first (steelyard identify ROBOT LOG --loaded LOG "
            "--payload-mass KG), and write them into the robot file",
        )
    model = model_of(file)
    found_out = checked(robot, replace(file, signals=signals), files, progress) if check else None
    runs = runs_of(file, signals, files, (), progress)[0]
    doubts = () if found_out is None else passed(found_out, robot)
    ground = grounded(model, file, runs, (), Payload(), WeightedLeastSquares(), threads, progress)
    notes = (
        *file.notes,
        *reasons,
        *notes_of(runs),
        *doubts,
        *ground.notes,
        *dropped(model, runs),
    )
    return _given(ground, file, notes, threads, progress)


def _given(
    ground: Ground, file: LoadedRobot, notes: tuple[str, ...], threads: int, progress: Progress
) -> Rivals:
    """One more pass, in windows that parts can be made of."""
    model, runs = ground.model, ground.runs
    regressor, rests = base_regressor(model), remembers(model.terms)
    said = said_by(
        runs,
        rests=rests,
        longest=longest_window(runs),
        threads=threads,
        progress=progress,
    )
    information = said(regressor)
    own = set(own_columns(model))
    per_run = tuple(name for name in information.layout.columns if name in own)
    knowledge = knowledge_of(model, file, fastest_of(runs))
    sources = Sources(regressor, runs, rests, information, threads, progress)
    several = len(runs) > 1
    parts = Parts.of(
        runs,
        information,
        {"samples": sources.samples, **({"experiment": sources.experiment} if several else {})},
        {"experiment": ONE_RUN},
    )
    equal = file.estimation.weights == "equal"
    context = Context(regressor, knowledge, per_run, progress, equal)
    return Rivals(context, parts, ground, (*notes, *knowledge.notes), lines_of(file.estimation))


def lines_of(now: EstimationSection) -> dict[str, str]:
    """What a robot file's `[estimation]` lacks for those estimators that it can choose."""
    wanted = {
        "consistent": {"method": "consistent"},
        "WLS": {"method": "least_squares", "weights": "noise"},
        "OLS": {"method": "least_squares", "weights": "equal"},
    }
    lines = {}
    for name, keys in wanted.items():
        other = [f'{key} = "{value}"' for key, value in keys.items() if getattr(now, key) != value]
        if other:
            lines[name] = f"[estimation] {', '.join(other)}"
    return lines


@dataclass(frozen=True, eq=False)
class Sources:
    """Samples and experiments of runs, gathered when they are first asked for.

    Attributes:
        regressor: The columns.
        runs: The runs.
        rests: Whether rests count.
        information: What the runs say.
        threads: Native threads.
        progress: Told about the pass.
    """

    regressor: Regressor
    runs: tuple[Run, ...]
    rests: bool
    information: Information
    threads: int
    progress: Progress

    def samples(self, parts: Sequence[int]) -> Samples:
        """Samples of some runs, or of stretches of a single one."""
        if len(self.runs) > 1:
            return reduce(add, [self._gathered[k] for k in parts])
        stretches = stretches_of(self.runs[0])
        return self._gathered[0].during([stretches[k] for k in parts])

    def experiment(self, parts: Sequence[int]) -> Experiment:
        """An experiment of some runs; how they were controlled is not logged."""
        runs = [self.runs[k] for k in parts]
        names = {run.name for run in runs}
        windows = [k for k, w in enumerate(self.information.windows) if w.run in names]
        return Experiment.of_runs(self.regressor, runs, information=self.information.of(windows))

    @cached_property
    def _gathered(self) -> list[Samples]:
        units = self.regressor.model.robot.effort_units
        return [
            gather_samples(
                self.regressor, run, rests=self.rests, threads=self.threads, progress=self.progress
            ).scaled(run.recording.signals.gains, units)
            for run in self.runs
        ]
