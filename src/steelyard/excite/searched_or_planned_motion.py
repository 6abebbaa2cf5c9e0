"""From the `[excitation]` tables to a motion, searched or planned, proven and described."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters, clear_map
from steelyard.excite.collision.workspace_from_tables import tool_of
from steelyard.excite.constraints.certificate import Certificate, certify, holds_note
from steelyard.excite.constraints.constraint_and_limits import Constraint, Gap, MotionLimits
from steelyard.excite.constraints.tool_workspace import Marker
from steelyard.excite.criterion_from_tables import cases_of
from steelyard.excite.design_problem_and_information import Case, Earlier, Problem, composed_motions
from steelyard.excite.design_problem_from_tables import (
    Tables,
    build,
    constraints_of,
    limits_of,
    memoryless,
)
from steelyard.excite.planned.plans_from_tables import planned
from steelyard.excite.predicted_accuracy_and_advice import (
    Advice,
    PredictedAccuracy,
    advised_motions,
    predicted_accuracy,
    samples_of,
)
from steelyard.excite.search.feasibility import NoMotion, explained_no_motion, refuse_impossible
from steelyard.excite.search.parallel_search import (
    ProcessPace,
    SearchBudget,
    SearchResult,
    search_in_parallel,
    time_after,
)
from steelyard.excite.search.repair_until_proven import finished
from steelyard.excite.search.search_methods import method_of
from steelyard.excite.standing.whole_motion import loads_of_base, whole_motion
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.motion_families import FAMILIES, basis_of, coefficients_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import BASE_COORDINATES, Robot, frame_origins

ASSUMED_NOISE = 0.01  # assumed without an earlier log, over the joint's greatest effort
ASSUMED_RATE = 20.0  # independent samples a second that are assumed with it
FINISH_SHARE = 0.08  # share of the time for polishing, scaling and proofs; a second at least
FINISH_SHARE_ON_FEET = 0.35  # the same where legs follow: margins bend more between samples
HURRY_SECONDS = 1.0  # time for polishing after the user has ended the search [s]
FEW_SEARCHES = 4  # searches below which a note says that more time would help

_LEAST_SEARCH_SECONDS = 0.5
_HEIGHT_SAMPLES = 500


@dataclass(frozen=True, eq=False)
class Designed:
    """A designed motion, its `kind` in a few words.

    The `course` is time [s] and criterion of every improvement of the search, empty if it was
    planned; so many `searches` came to their end; `stopped` says whether the user ended it early.
    Predictions assume the standard deviations of effort `noise`, `(n,)` [Nm; N], and information of
    earlier runs (`prior`), if it counts; `values` are base parameters as far as known. The
    certificate's proofs are of the `constraints`. Base parameters that matter are `chosen`, all if
    `None`; so many `faint` ones no motion shows apart from others: they are left out; the model
    does without the `absent`.
    """

    robot: Robot
    trajectory: ExactTrajectory
    kind: str
    limits: MotionLimits
    certificate: Certificate
    criterion: str
    shown: PredictedAccuracy
    course: tuple[tuple[float, float], ...]
    searches: int
    seconds: float
    stopped: bool
    noise: Array
    noise_from: str
    prior: Array | None
    values: Mapping[str, float]
    advice: tuple[Advice, ...]
    tool: Marker
    notes: tuple[str, ...]
    constraints: tuple[Constraint, ...] = ()
    chosen: tuple[int, ...] | None = None
    faint: int = 0
    absent: tuple[str, ...] = ()

    @property
    def gram(self) -> Array:
        """Information of the motion and of earlier runs, if that counts, shape `(b, b)`."""
        return self.shown.gram if self.prior is None else self.shown.gram + self.prior

    @property
    def chosen_parameters(self) -> tuple[int, ...]:
        """The base parameters that were to be shown: those chosen, or all."""
        return tuple(range(len(self.shown.names))) if self.chosen is None else self.chosen


def design(
    tables: Tables,
    effort: SearchBudget,
    *,
    start: ExactTrajectory | None = None,
    progress: Progress = silent,
    since: float | None = None,
) -> Designed:
    """The best motion that the time allows, or the one that is planned, of what a model is to show.

    The effort's seconds are those of the whole design, which began at `since` of `time.monotonic`;
    now if `None`. A motion of the same kind to `start` from, such as the last one that was run, is
    improved beside what is searched, so that the criterion does not rise above its own. When
    `progress` requests a stop, it gets the best so far.

    Raises:
        DataError: The tables allow no motion; says what would have to be changed.
        ModelError: A frame or a shape is missing.
        Stopped: `progress` requested a stop before any motion was found.
    """
    loaded, model, earlier = tables
    begun = time.monotonic() if since is None else since
    if start is not None:
        refuse_other_kind(start, loaded)
    if loaded.excitation.motion.kind in FAMILIES:
        return _searched(tables, effort, start, progress, begun)
    section = loaded.excitation
    limits = limits_of(loaded.robot, section.limits)
    plain, notes = memoryless(model)
    constraints, more = constraints_of(loaded, model, earlier)
    trajectory, plan_notes = planned(loaded, limits, effort.seed)
    cases = cases_of(section, plain, limits, earlier)
    notes = (*plan_notes, *limits.notes, *notes, *more)
    return _described(tables, begun, trajectory, cases, limits, constraints, notes)


def condition_of_motion(tables: Tables, trajectory: ExactTrajectory) -> float:
    """Condition number of the regressor along a motion, for the parameters that a model has."""
    loaded, model, earlier = tables
    section, (plain, _) = loaded.excitation, memoryless(model)
    cases = cases_of(section, plain, limits_of(loaded.robot, section.limits), earlier)
    samples = max(section.samples, samples_of(trajectory.duration))
    return predicted_accuracy(trajectory, cases, np.ones(loaded.robot.n), samples).raw


def refuse_other_kind(
    start: ExactTrajectory, loaded: LoadedRobot, where: str = "motion to start from"
) -> None:
    """Refuse a motion to start from that the search for which a robot file asks cannot contain."""
    motion = loaded.excitation.motion
    basis = basis_of(motion, loaded.robot) if motion.kind in FAMILIES else None
    if basis is None or coefficients_of(basis, start) is None:
        lasting = "" if basis is None else f" ({basis.duration:g} s)"
        raise DataError(
            f"the motion to start from ({start.duration:g} s) is no motion of kind "
            f"'{motion.kind}' as the robot file describes it{lasting}",
            where=where,
            fix="give one that was designed with the same period and number of harmonics",
        )


def _searched(
    tables: Tables,
    effort: SearchBudget,
    start: ExactTrajectory | None,
    progress: Progress,
    begun: float,
) -> Designed:
    loaded = tables[0]
    method_of(loaded.excitation.search.method)
    pace = ProcessPace()
    problem = build(*tables)
    first = None if start is None else coefficients_of(problem.basis, start)
    refuse_impossible(problem, loaded)
    deadline = begun + effort.seconds - time_after(problem, effort.seconds, pace)
    share = FINISH_SHARE if loaded.excitation.stance is None else FINISH_SHARE_ON_FEET
    left = deadline - max(share * effort.seconds, 1.0) - time.monotonic()
    try:
        result = search_in_parallel(
            tables,
            problem,
            loaded.excitation.search.method,
            replace(effort, seconds=max(left, _LEAST_SEARCH_SECONDS)),
            progress,
        )
        if result.stopped:
            deadline = min(deadline, time.monotonic() + HURRY_SECONDS)
        best = finished(problem, _candidates(problem, result, first), deadline)
    except NoMotion as error:
        raise explained_no_motion(problem, error) from None
    notes, sizes = problem.notes, [f"{len(limb.joints)}" for limb in problem.limbs]
    if len(sizes) > 1:
        notes += (
            f"{len(sizes)} limbs share no parameter ({', '.join(sizes)} joints): each starts with "
            "its own best motion; limits apply to all together",
        )
    if result.killed:
        notes += (f"{result.killed} of {effort.useful} search processes were killed externally",)
    hints: tuple[str, ...] = ()
    converged = result.searches
    if not result.stopped and converged < min(FEW_SEARCHES, effort.searches or FEW_SEARCHES):
        whole = {0: "no search converged", 1: "only 1 search converged"}.get(
            converged, f"only {converged} searches converged"
        )
        hints = (f"{whole} in the time limit: a longer --budget finds better motions",)
    trajectory, limits = best.trajectory, problem.limits
    constraints, proven = problem.constraints, best.proven
    if loaded.excitation.stance is not None:
        stood = whole_motion(loaded, trajectory, constraints, proven)
        tables = (stood.loaded, *tables[1:])
        trajectory, limits = stood.trajectory, stood.limits
        constraints, proven = stood.constraints, stood.proven
        notes += stood.notes
    return _described(
        tables,
        begun,
        trajectory,
        problem.cases,
        limits,
        constraints,
        notes,
        hints,
        proven,
        result,
    )


def _candidates(problem: Problem, result: SearchResult, first: Array | None) -> list[Array]:
    """The best motions and one of the best of every limb, best first: time may end after one."""
    found = [one.x for one in result.best] + ([] if first is None else [first])
    *_, mixed = composed_motions(problem, found)
    every = found if any(mixed is x for x in found) else [mixed, *found]
    return sorted(every, key=problem.criterion_value)


def _described(
    tables: Tables,
    begun: float,
    trajectory: ExactTrajectory,
    cases: Sequence[Case],
    limits: MotionLimits,
    constraints: Sequence[Constraint],
    notes: tuple[str, ...],
    hints: tuple[str, ...] = (),
    proven: Sequence[Array] | None = None,
    result: SearchResult | None = None,
) -> Designed:
    loaded, _, earlier = tables
    robot, section = loaded.robot, loaded.excitation
    notes = (*notes, *holds_note(trajectory), *_cell(loaded, trajectory))
    certificate = certify(robot, trajectory, limits, constraints, notes=notes, proven=proven)
    noise, rate, source = noise_of(loaded, earlier)
    weights = rate / noise**2
    # as many samples as requested, and 50 a second of long motions
    samples = max(section.samples, samples_of(trajectory.duration))
    seen = predicted_accuracy(trajectory, cases, weights, samples)
    shows = cases[0].shows
    base = shows.base
    prior = None
    if earlier is not None and section.criterion.after_earlier:
        prior = earlier.information(base, shows.absent)
    return Designed(
        robot=robot,
        trajectory=trajectory,
        kind=section.motion.kind,
        limits=limits,
        certificate=certificate,
        criterion=cases[0].criterion.name,
        shown=seen,
        course=() if result is None else result.course,
        searches=0 if result is None else result.searches,
        seconds=time.monotonic() - begun,
        stopped=result is not None and result.stopped,
        noise=noise,
        noise_from=source,
        prior=prior,
        values={} if earlier is None else dict(zip(earlier.names, earlier.values, strict=True)),
        advice=advised_motions(seen, trajectory, cases, weights, limits, prior),
        tool=tool_of(section.workspace, robot),
        notes=(*loaded.notes, *notes, *hints),
        constraints=tuple(constraints),
        chosen=cases[0].criterion.chosen,
        faint=len(base_parameters(shows.model)) - len(clear_map(shows.model)),
        absent=shows.absent,
    )


def _cell(loaded: LoadedRobot, trajectory: ExactTrajectory) -> tuple[str, ...]:
    section, robot = loaded.excitation, loaded.robot
    space, collision = section.workspace, section.collision
    limits_links = space is not None and space.limits_links
    if limits_links or robot.passive or (collision is not None and collision.world is not None):
        return ()
    moving = [frame for frame in robot.frames if frame.body >= 0]
    q = trajectory.derivative(np.linspace(0.0, trajectory.duration, _HEIGHT_SAMPLES), 0)
    heights = frame_origins(robot, moving, q)[:, :, 2]
    lowest = int(heights.min(axis=0).argmin())
    floor = "HEIGHT, in metres from the base's origin," if loaded.floats else "0.0"
    return (
        Gap(
            "no floor or cell is defined for the links: the origin of "
            f"'{moving[lowest].name}' goes down to z = {heights[:, lowest].min():.2f} m; "
            f"floor = {floor} in [excitation.workspace] keeps all links above it"
        ),
    )


def noise_of(loaded: LoadedRobot, earlier: Earlier | None) -> tuple[Array, float, str]:
    """Noise of the efforts `(n,)`, independent samples per second, and where both come from."""
    if earlier is not None:
        return earlier.noise, earlier.independent_rate, "the residuals of the earlier log"
    own = np.array([joint.limits.effort for joint in loaded.robot.coordinates])
    if loaded.excitation.stance is not None:
        own[: len(BASE_COORDINATES)] = loads_of_base(loaded.robot, loaded.excitation.stance)
    known = np.isfinite(own) & (own > 0.0)
    each = f"{ASSUMED_RATE:g} independent samples per second"
    if not known.any():
        return np.ones(loaded.robot.n), ASSUMED_RATE, f"assumed: 1 Nm (1 N), {each}"
    own[~known] = np.median(own[known])
    share = f"assumed: {100.0 * ASSUMED_NOISE:g} % of each joint's greatest effort"
    if loaded.excitation.stance is not None:
        share += ", and of the weight on the base"
    source = f"{share}, {each}; --earlier MODEL gives the actual noise"
    return frozen(ASSUMED_NOISE * own), ASSUMED_RATE, source
