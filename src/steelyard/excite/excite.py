r"""The motion that shows a robot's parameters best, and its files: what `steelyard excite` does.

With points a step $h$ apart, straight lines stay within $h^2 \max|\ddot q| / 8$, and lines whose
corners are rounded from half step to half step within $h^2 \max|\ddot q| / 4$. The error of a cubic
spline is taken at times $\delta$ apart; between them it is greater by at most
$\delta^2 \max|\ddot s - \ddot q| / 8$, and $\ddot s$ is greatest at a point.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from steelyard.base.arrays import Array, finite_json
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import DESIGN_BUDGET_S, Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.excite.collision.workspace_from_tables import WALL_RESERVE
from steelyard.excite.constraints.certificate import COVERS
from steelyard.excite.constraints.constraint_and_limits import Gap
from steelyard.excite.controller_file_formats import (
    EXPORTS,
    Export,
    even_times,
    exported,
    grid_times,
    write_export,
)
from steelyard.excite.design_problem_and_information import earlier_of, identified_before
from steelyard.excite.design_problem_from_tables import Tables
from steelyard.excite.held_base import held_by_its_base
from steelyard.excite.page.design_page import render_design
from steelyard.excite.page.design_text import DesignContent, design_headline, print_design, scopes
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.searched_or_planned_motion import Designed, design, refuse_other_kind
from steelyard.excite.standing.forces_of_feet import FeetForces
from steelyard.excite.standing.standing_robot import standing, tree_of
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    PiecewiseMotion,
    through_postures,
)
from steelyard.excite.trajectories.motion_families import FAMILIES, basis_of
from steelyard.excite.trajectories.trajectory_files import read_motion, write_motion
from steelyard.model.model import Model, model_with_open_friction, with_friction
from steelyard.report.result import Result
from steelyard.robot.file.excitation_sections import changed_excitation
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import refuse_floating

_SAMPLES_PER_STEP = 64
_RATE_FACTOR = 1.15
_MOST_ADVISED_RATE = 2000.0
_SPLINE_ERROR = 1e-6
OF_TARGETS = (
    "the robot file names position targets: the motion is in the joints of the model file "
    "[rad; m], not in the unit, signs and zeros of the log; what is proven holds for the targets, "
    "if these are right, and the arm lags behind them; accuracies are those of a robot whose "
    "torques are logged"
)


def error_between(trajectory: ExactTrajectory, between: str, rate: float) -> Array:
    """Bound of what a controller leaves a motion by between points, shape `(n,)` [rad; m].

    Between them it does `lines`, `rounded lines`, `cubic spline` or `quintic splines`, of which
    there are as many as they need.
    """
    if between == "quintic splines":
        return np.full(len(trajectory.extremes(0)[0]), _SPLINE_ERROR)
    steepest = np.maximum(*(np.abs(x) for x in trajectory.extremes(2)))
    if between != "cubic spline":
        return np.asarray(steepest / rate**2 / (4.0 if between == "rounded lines" else 8.0))
    from scipy.interpolate import CubicSpline

    times = even_times(trajectory.duration, rate)
    spline = CubicSpline(times, trajectory.derivative(times, 0), bc_type="clamped")
    fine = np.linspace(0.0, trajectory.duration, _SAMPLES_PER_STEP * (len(times) - 1) + 1)
    seen = np.abs(spline(fine) - trajectory.derivative(fine, 0)).max(axis=0)
    bend = np.abs(spline(times, 2)).max(axis=0) + steepest
    return np.asarray(seen + bend * fine[1] ** 2 / 8.0)


def gaps_of_files(designed: Designed, forms: Sequence[str], rate: float | None) -> list[Gap]:
    """What is not proven of files for controllers, one sentence each.

    None of a motion whose certificate does not hold.
    """
    if not designed.certificate.holds:
        return []
    return [
        Gap(text)
        for export in (EXPORTS[form] for form in forms)
        if export.between is not None
        for text in _gap_of_file(designed, export, export.between, rate or export.rate)
    ]


def _gap_of_file(designed: Designed, export: Export, between: str, rate: float) -> list[str]:
    """What the way between the points of one file lacks, none or one sentence."""
    trajectory = designed.trajectory
    error = error_between(trajectory, between, rate)
    lower, upper = trajectory.extremes(0)
    labels, margins, rates = list[str](), list[float](), [np.zeros((0, designed.robot.n))]
    for constraint, proof in zip(designed.constraints, designed.certificate.proofs, strict=True):
        reaches = constraint.reaches(lower - error, upper + error)
        if reaches is not None:
            labels, margins = [*labels, *proof.labels], [*margins, *proof.proven]
            rates.append(reaches)
    per_error = np.concatenate(rates)
    lacks = per_error @ error - margins  # of every margin [m]
    if not lacks.max(initial=0.0) > WALL_RESERVE:
        return []
    enough = rate
    while enough <= _MOST_ADVISED_RATE and np.max(per_error @ error - margins) > WALL_RESERVE:
        enough = float(np.ceil(_RATE_FACTOR * enough))
        error = error_between(trajectory, between, enough)
    millimetres = 1e3 * float(lacks.max())
    words = f"{millimetres:.0f}" if millimetres >= 10.0 else f"{millimetres:.2g}"
    fix = f"; --rate {enough:g} is enough" if enough <= _MOST_ADVISED_RATE else ""
    return [
        f"{export.file} has {rate:g} points per second; between them ({between}) a controller may "
        f"violate a constraint by up to {words} mm: {labels[int(lacks.argmax())]}{fix}"
    ]


def refuse_formats(loaded: LoadedRobot, formats: Sequence[str], rate: float | None) -> None:
    """Refuse formats that do not exist or cannot hold the motion, before time is spent on it."""
    robot, section = loaded.robot, loaded.excitation.motion
    zero = np.zeros(robot.n)
    still = through_postures([zero, zero], 1.0)
    motion: ExactTrajectory = still
    if section.kind in FAMILIES:
        basis = basis_of(section, robot)
        motion = basis.motion(basis.still(zero) + 1e-3)
    for form in formats:
        if form == "csv" and (rate is None or 0.0 < rate < np.inf):
            grid_times(motion.duration, rate or EXPORTS[form].rate)
        exported(still if form == "csv" else motion, robot, form, rate)


@dataclass(frozen=True, eq=False, repr=False)
class DesignedMotion(Result):
    """A designed motion, and the formats of its files.

    These have `rate` points a second; each format's own if `None`.
    """

    designed: Designed
    loaded: LoadedRobot
    formats: tuple[str, ...] = ("csv",)
    rate: float | None = None

    @property
    def trajectory(self) -> ExactTrajectory:
        """The motion."""
        return self.designed.trajectory

    @property
    def written_formats(self) -> tuple[str, ...]:
        """The formats that are written: no controller program of a motion that is not proven."""
        wanted = tuple(dict.fromkeys(self.formats))
        return wanted if self.designed.certificate.holds else tuple(f for f in wanted if f == "csv")

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return self._page(())

    def write(self, folder: Path) -> None:
        """Write the motion, its certificate, the formats that may be written, and the page."""
        self.written_to(folder)

    def written_to(self, folder: Path) -> dict[str, str]:
        """The same; returns what each file is, and its name."""
        designed = self.designed
        write_motion(folder / "trajectory.json", designed.trajectory, designed.robot)
        designed.certificate.write(folder / "certificate.json")
        names = {"trajectory": "trajectory.json", "certificate": "certificate.json"}
        on_feet = [one.columns for one in designed.constraints if isinstance(one, FeetForces)]
        for form in self.written_formats:
            path = write_export(
                designed.trajectory, designed.robot, form, folder, self.rate, *on_feet
            )
            names[form] = path.name
        (folder / "report.html").write_text(self._page(tuple(names.items())), encoding="utf-8")
        return names | {"report": "report.html"}

    def _page(self, files: tuple[tuple[str, str], ...]) -> str:
        designed = self.designed
        content = DesignContent(
            title=f"Excitation motion for {designed.robot.name}",
            robot=designed.robot.name,
            notes=tuple(n for n in designed.notes if n not in designed.certificate.uncovered),
            design=designed,
            workspace=self.loaded.excitation.workspace,
            files=files,
        )
        return render_design(content)

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the predicted accuracy, and which limits are proven; with `verbose` all of it."""
        print_design(self.designed, console, verbose)

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard excite --json` prints them."""
        designed, shown = self.designed, self.designed.shown
        std = shown.std(designed.prior)
        return {
            "robot": designed.robot.name,
            "motion": designed.kind,
            "duration_s": designed.trajectory.duration,
            "criterion": designed.criterion,
            "figure": finite_json(shown.criterion_value),
            "condition": finite_json(shown.raw),
            "condition_normalised": finite_json(shown.normalised),
            "certified": designed.certificate.holds,
            "headline": design_headline(designed),
            "limits": scopes(designed),
            "covers": COVERS,
            "not_covered": list(designed.certificate.gaps),
            "not_covered_as_asked": list(designed.certificate.declined),
            "failures": list(designed.certificate.failures),
            "searches": designed.searches,
            "improvements": [list(one) for one in designed.course],
            "seconds": designed.seconds,
            "stopped": designed.stopped,
            "predicted_std": dict(zip(shown.names, finite_json(std), strict=True)),
            "noise": designed.noise_from,
            "notes": list(designed.notes),
        }


@dataclass(frozen=True, eq=False)
class DesignTask:
    """A design problem, checked as far as possible before the search.

    The files have `rate` points a second; each format's own if `None`.
    """

    tables: Tables
    formats: tuple[str, ...]
    rate: float | None
    start: ExactTrajectory | None = None
    held: Gap | None = None  # what is not covered where the base of the robot floats

    @property
    def searched(self) -> bool:
        """Whether the motion is searched, and not planned."""
        return self.tables[0].excitation.motion.kind in FAMILIES

    def done(
        self, effort: SearchBudget, *, progress: Progress = silent, since: float | None = None
    ) -> DesignedMotion:
        """The motion; see `design` for the arguments and errors."""
        designed = design(self.tables, effort, start=self.start, progress=progress, since=since)
        found = DesignedMotion(designed, self.tables[0], self.formats, self.rate)
        gaps = gaps_of_files(designed, found.written_formats, self.rate)
        gaps += [] if self.held is None else [self.held]
        certificate = designed.certificate
        certificate = replace(certificate, notes=(*certificate.notes, *gaps))
        notes = (*designed.notes, *gaps)
        if self.tables[0].targets is not None:
            notes += (OF_TARGETS,)
        designed = replace(designed, certificate=certificate, notes=notes)
        return replace(found, designed=designed)


def design_task(
    robot: str | Path | LoadedRobot,
    *,
    earlier: str | Path | IdentifiedModel | None = None,
    start: str | Path | None = None,
    formats: Sequence[str] = (),
    rate: float | None = None,
    fixed_base: str | None = None,
    **tables: Any,
) -> DesignTask:
    """The design problem; arguments and errors are those of `design_excitation`."""
    loaded = load_robot(robot, base=fixed_base)
    if earlier is not None:
        refuse_floating(loaded.robot, "the design of a motion beside an earlier log")
    stance, held = loaded.excitation.stance, None
    if stance is None:
        loaded, held = held_by_its_base(loaded)
    try:
        loaded = replace(loaded, excitation=changed_excitation(loaded.excitation, **tables))
    except ValueError as error:
        raise DataError(
            str(error), where="options of steelyard excite", fix="see steelyard excite --help"
        ) from None
    if stance is None:
        model = with_friction(model_with_open_friction(loaded), loaded)
    else:
        _refuse_controllers(formats)
        loaded, model, held = standing(loaded, stance)
    known = None if earlier is None else identified_before(earlier, loaded)
    if known is not None:
        model = Model(loaded.robot, known.model.terms)
    forms = ("csv", *formats)
    refuse_formats(loaded, forms, rate)
    before = None if known is None else earlier_of(known)
    first = None if start is None else _read_start(Path(start), loaded)
    if first is not None:
        refuse_other_kind(first, loaded, str(start))
    return DesignTask((loaded, model, before), forms, rate, first, held)


def _read_start(path: Path, loaded: LoadedRobot) -> ExactTrajectory:
    """A motion to start from, of the robot's independent joints."""
    robot = loaded.robot
    if loaded.excitation.stance is None:
        return read_motion(path, robot)
    motion = read_motion(path, tree_of(robot))
    if not isinstance(motion, PiecewiseMotion):
        raise DataError(
            "the motion to start from is none of a robot that stands",
            where=str(path),
            fix="give a trajectory.json that excite wrote of the same stance",
        )
    return PiecewiseMotion(motion.edges, motion.coefficients[:, :, : robot.n])


def _refuse_controllers(formats: Sequence[str]) -> None:
    """Motions on feet are tables: no program of a controller balances."""
    if other := [form for form in formats if form != "csv"]:
        raise DataError(
            f"the motion of a robot that stands is not written as '{other[0]}'",
            where="formats of steelyard excite",
            fix="use the csv: it has all joints, and the base as q_base_x to q_base_rz",
        )


@checked(budget=0.0, rate=1.0, searches=1, processes=1, seed=0)
def design_excitation(
    robot: str | Path | LoadedRobot,
    *,
    budget: float = DESIGN_BUDGET_S,
    motion: str | None = None,
    period: float | None = None,
    harmonics: int | None = None,
    criterion: str | None = None,
    method: str | None = None,
    still_unknown: bool = False,
    earlier: str | Path | IdentifiedModel | None = None,
    start: str | Path | None = None,
    formats: Sequence[str] = (),
    rate: float | None = None,
    fixed_base: str | None = None,
    searches: int | None = None,
    processes: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> DesignedMotion:
    """Design an excitation motion, and prove that it satisfies all limits.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it; limits,
            workspace, obstacles and criterion are in its `[excitation]` tables.
        budget: Time limit [s].
        motion: Kind of motion: `fourier`, `raw_fourier`, `blended_fourier`, `ramped_fourier`,
            `spline` or `reaching` are optimised; `pick_and_place`, `square`, `waypoints`, `circle`,
            `cartesian_reaching`, `sweeps`, `postures` and `replay` are planned. If `None`, the
            robot file's, or `fourier`.
        period: Duration or period of the motion [s].
        harmonics: Harmonics of a Fourier series.
        criterion: `condition`, `normalised_condition`, `d_optimal`, `a_optimal` or `e_optimal`.
        method: Search method: `gradient`, `genetic` or `cma_es`.
        still_unknown: Optimise the information of previous and new log together; needs `earlier`.
        earlier: model.json identified from a previous log: gives noise for predicted standard
            deviations, and parameter values for predicted torques. Parameters that it was reduced
            by are absent.
        start: `trajectory.json` of a motion of the same kind, such as the last one: an additional
            starting point of the search.
        formats: Also write the motion for a controller: `csv`, `ros2`, `urscript`, `krl`, `rapid`,
            `mujoco`.
        rate: Points per second in the files of these formats.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        searches: Stop after this many searches; if the budget suffices, the result depends on the
            seed only.
        processes: Search processes; all cores if `None`.
        seed: Same seed and number of searches, same motion.
        progress: Receives events of progress; when it requests a stop, the design ends with the
            best so far.

    Raises:
        SteelyardError: The tables allow no motion, or a file cannot be used.

    Example:
        >>> motion = design_excitation("arm.toml", budget=1.0, processes=1)
        >>> motion.designed.certificate.holds
        True
    """
    task = design_task(
        robot,
        earlier=earlier,
        start=start,
        formats=formats,
        rate=rate,
        fixed_base=fixed_base,
        motion=motion,
        period=period,
        harmonics=harmonics,
        criterion=criterion,
        method=method,
        still_unknown=still_unknown,
    )
    effort = SearchBudget(budget, searches, processes, seed)
    return task.done(effort, progress=progress)
