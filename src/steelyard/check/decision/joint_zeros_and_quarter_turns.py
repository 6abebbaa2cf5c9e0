r"""Do joints count their positions from where the model file says, or quarter turns away?

Controllers and model files often count joints from postures that are 90 or 180 degrees apart. Such
offsets are far beyond the reach of derivatives, and look like wrong lengths: the offset of one
joint turns the link behind it, and an opposite one of the next joint turns the others back. The
joints are therefore read with quarter turns, of one joint or of neighbours, one after another as
long as weighted least squares fits better, by $-2 \log L = \sum_j N_j \log \sigma_j^2$. Motion
that is left out then decides.

A fit cannot always tell which of two joints is turned, as parameters of the links change with it:
the nominal masses can. They are asked only where they agree badly with a log as declared, and no
other hypothesis explains it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError, SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check
from steelyard.check.decision.robot_file_edits import zero_edits
from steelyard.check.decision.undecided_questions import UNKNOWN_GAINS
from steelyard.check.decision.verdict_of_log import CLEAN, LEAST_FALL, STRIKING, judge_log
from steelyard.check.finding import ComparedHypothesis, Edit, Finding, Fix
from steelyard.check.fitted.causes_of_residuals import WORTH_A_SEARCH, LeftOutGain, left_out_logs
from steelyard.check.fitted.fitted_case_causes_and_constraints import (
    RankedCauses,
    can_be_ranked,
    first_parts_of_runs,
    ranked_causes,
    worst_residual_words,
)
from steelyard.check.hypotheses.hypotheses_and_their_scores import SURE
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    ZERO_CAUSE,
    zero_near,
    zeros_without_effect,
)
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_parameters,
    base_regressor,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import (
    ZeroOffsets,
    find_offsets,
    information_from,
    with_offsets,
)
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run

CLEAR_OFFSET = 4.0  # standard deviations from what is given from which on an offset is written


def estimated_offsets(
    model: Model, runs: Sequence[Run], start: Array | None = None
) -> ZeroOffsets | None:
    """Zero offsets of an open chain near a start, or those given; `None` of too few data."""
    rests = model.has_memory
    try:
        return find_offsets(
            model,
            lambda offsets: information_from(with_offsets(runs, offsets), rests=rests),
            _given_offsets(runs[0].recording.signals) if start is None else start,
            [True] * model.robot.n,
        )
    except DataError:
        return None


def _given_offsets(signals: Signals) -> Array:
    return np.zeros(signals.n) if signals.position_offset is None else signals.position_offset


def far_offsets(offsets: ZeroOffsets) -> NDArray[np.bool_]:
    """Which offsets differ clearly from those that were given, shape `(n,)`."""
    spread = np.nan_to_num(offsets.std, nan=np.inf)
    far = np.abs(offsets.values - offsets.start) > CLEAR_OFFSET * spread
    return np.asarray(far & offsets.converged)


def offset_line(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> Fix:
    """The line of the robot file that corrects offsets; others stay as they are given."""
    values = np.where(chosen, np.round(offsets.values, 4), offsets.start).tolist()
    says = f'Set position_offset = {values} in [signals], or position_offset = "identify"'
    return Fix(says, (Edit(("signals", "position_offset"), values),))


TurnedJoints = tuple[tuple[int, float], ...]  # joints, and by how much each is turned [rad]
TRIED_TURNS = (0.5 * np.pi, -0.5 * np.pi, np.pi)  # offsets of a joint that are tried [rad]
NO_TURN_EFFECT = 1e-3  # change of it up to which a zero has no effect: as about gravity
OTHER_ZEROS = "joint zeros other than those of the model file: "
IF_CONFIRMED = (
    "if the robot's zeros confirm it; otherwise the origin or the axis of the next joint is turned "
    "by as much in the model file: correct it there"
)
"""What else has the effect of a turned zero, for people to read."""
MOST_TURN_SAMPLES = 20_000  # samples looked at: every turn of every joint is a pass over them


def turned_zeros(model: Model, sigma: Array, runs: Sequence[Run]) -> Finding | None:
    """Quarter turns of joints that explain residuals and predict left-out motion better.

    Of a fitted model of an open chain; `sigma` has the standard deviations of its residuals,
    shape `(n,)`.
    """
    some, regressor = first_parts_of_runs(runs, MOST_TURN_SAMPLES), base_regressor(model)
    start, own = _given_offsets(some[0].recording.signals), base_parameters(model).base_names
    try:
        turned = _search_turns(regressor, some, start)
        if not turned:
            return None
        found = _turned_by(start, turned)
        (left_out, (plain,)), (_, (errors,)) = (
            left_out_logs(model, regressor, sigma, with_offsets(some, offsets), [own])
            for offsets in (start, found)
        )
    except DataError:
        return None
    gain = LeftOutGain.of(plain, errors, left_out, WORTH_A_SEARCH)
    if not gain.confirmed:
        return None
    values = [round(value, 4) for value in found.tolist()]
    fitted = estimated_offsets(model, some, found)
    holds = fitted is None or not far_offsets(fitted)[[k for k, _ in turned]].any()
    line = (Edit(("signals", "position_offset"), values),) if holds else ()
    return Finding.doubtful(
        f"{OTHER_ZEROS}{turn_words(model.robot, turned)} (error on left-out motion "
        f"{gain.before:.2g} %, with these zeros {gain.after:.2g} %)",
        joints=tuple(model.robot.joint_names[k] for k, _ in turned),
        fix=Fix(
            f"Set position_offset = {values} in [signals], {IF_CONFIRMED}"
            + ("" if holds else "; no line is written, as a fit gives other zeros near these"),
            line,
        ),
    )


def turn_words(robot: Robot, turned: TurnedJoints) -> str:
    """Like `elbow +90°`."""
    return ", ".join(f"{robot.joint_names[k]} {np.rad2deg(turn):+.0f}°" for k, turn in turned)


def _search_turns(regressor: Regressor, runs: Sequence[Run], start: Array) -> TurnedJoints:
    """Turns with the best fit; each joint is turned once at most, alone or with the next one."""
    left = _turning_joints(regressor.model.robot)
    turns: TurnedJoints = ()
    least = _turn_misfit(regressor, runs, start)
    while left:
        tried: dict[TurnedJoints, float] = {}
        for joints in (1, 2):
            for more in _quarter_turns_of(left, joints):
                tried[more] = _turn_misfit(regressor, runs, _turned_by(start, (*turns, *more)))
            moved = {
                k for ((k, _), *_), found in tried.items() if abs(found - least) > NO_TURN_EFFECT
            }
            left = [k for k in left if k in moved]
        if not tried or min(tried.values()) > least - 2.0 * SURE:
            break
        best = min(tried, key=lambda turned: tried[turned])
        left = [k for k in left if k not in dict(best)]
        turns, least = (*turns, *best), tried[best]
    return tuple(sorted(turns))


def _turning_joints(robot: Robot) -> list[int]:
    return [k for k, coordinate in enumerate(robot.coordinates) if coordinate.unit == "rad"]


def _quarter_turns_of(left: Sequence[int], joints: int) -> Iterator[TurnedJoints]:
    """Turns of every joint alone, or of neighbours such that later links keep their orientation."""
    if joints == 1:
        yield from (((k, turn),) for k in left for turn in TRIED_TURNS)
        return
    for k in (k for k in left if k + 1 in left):
        for turn, other in product(TRIED_TURNS, TRIED_TURNS):
            if abs(turn) == abs(other):
                yield (k, turn), (k + 1, other)


def _turned_by(offsets: Array, turned: TurnedJoints) -> Array:
    found = offsets.copy()
    for joint, turn in turned:
        found[joint] += turn
    return found


def _turn_misfit(regressor: Regressor, runs: Sequence[Run], offsets: Array) -> float:
    r"""$-2 \log L$ of weighted least squares, but for a constant."""
    model = regressor.model
    read = information_from(with_offsets(runs, offsets), rests=model.has_memory)
    information = read(regressor)
    fit = WeightedLeastSquares(per_run=model.per_run_names).fit(information)
    return float(information.n_samples @ np.log(fit.variances))


@case_check(ZERO_CAUSE, "Are the joint zeros those of the model file?")
def joint_zeros_check(case: Case) -> Iterable[Finding]:
    """Zero offsets that explain the residuals of a fit better than anything else.

    Nothing without runs of an open chain, and with a reference, where a hypothesis check decides.
    """
    signals, known = case.logs[0].recording.signals if case.logs else None, case.knowledge
    if signals is None or any(signals.unknown_offsets) or (known is not None and known.identified):
        return ()
    try:
        runs, model = case.runs, case.model
        if not runs or not can_be_ranked(model):
            return ()
        if any(signals.unknown_gains):
            return (Finding.ok(UNKNOWN_GAINS[ZERO_CAUSE], answered=False),)
        some = first_parts_of_runs(runs)
        information = information_from(some, rests=model.has_memory)(case.regressor)
        estimate = WeightedLeastSquares(per_run=model.per_run_names)(information)
        ranked = ranked_causes(model, estimate, some)
        if case.quick and not ranked.of_geometry:
            return ()
        found = _zeros_by_derivatives(model.robot, ranked, estimated_offsets(model, some))
        if not found.severity and ranked.of_geometry:
            turned = turned_zeros(model, estimate.sigma, some)
            if turned is not None:
                found = replace(turned, figure=worst_residual_words(ranked.beside))
        return (found,)
    except SteelyardError as error:
        return (Finding.ok(f"not estimated: {error.wrong}", answered=False),)


def _zeros_by_derivatives(
    robot: Robot, ranked: RankedCauses, offsets: ZeroOffsets | None
) -> Finding:
    """What offsets within reach of derivatives say."""
    if offsets is None:
        return Finding.ok("not estimated: too few samples", answered=False)
    far, known = far_offsets(offsets), np.isfinite(offsets.std)
    if not known.any():
        says = "not identifiable from these data: the zero offset of every joint"
        return Finding.ok(says, answered=False)
    identified, left = (
        ", ".join(j for j, sure in zip(offsets.joints, known, strict=True) if sure == wanted)
        for wanted in (True, False)
    )
    hidden = f"; not identifiable: {left}" if left else ""
    figure = f"zero offset of {offsets.words(known)}{hidden}"
    if not far.any():
        says = "no significant zero offset" + (f" of {identified}{hidden}" if left else "")
        answered = bool(np.all(known | zeros_without_effect(robot)))
        says += "" if answered else "; a model from runs known to be correct (--model) tests more"
        return Finding.ok(says, figure, answered=answered)
    says = f"zero offset of {offsets.words(far)}"
    if not ranked.blamed or ranked.blamed[0].kind != "zero_offset":
        says += (
            " is undecided: other model errors explain as much; compare the zeros with the robot"
        )
        return Finding.ok(f"{says}{hidden}", figure, answered=False)
    return Finding.doubtful(
        f"{says} explains the residuals of a fit best",
        f"{100.0 * ranked.blamed[0].chi2 / ranked.total:.2g} % of chi², "
        f"{worst_residual_words(ranked.beside)}",
        joints=tuple(j for j, wrong in zip(offsets.joints, far, strict=True) if wrong),
        fix=offset_line(offsets, far),
    )


def quarter_turns(case: Case) -> Iterator[Finding]:
    """A doubtful finding per log that the nominal model explains with turned zeros alone."""
    known = case.knowledge
    if known is None or known.identified or known.robot.passive:
        return
    turns = [
        x for joints in (1, 2) for x in _quarter_turns_of(_turning_joints(known.robot), joints)
    ]
    for log in case.logs:
        decision = judge_log(case, log)
        if decision is None or decision.of_other_check or decision.winners or not turns:
            continue
        if not any(log.recording.signals.unknown_offsets):
            yield from _quarter_turn_found(case, log, decision.last.reading, turns)


def turned_joints(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What limits a fit: zeros that the check before found to be turned, once for all logs."""
    found = [f for f in findings if f.check == ZERO_CAUSE and f.severity and f.hypotheses]
    return tuple(replace(f, log="", figure="") for f in found[:1])


def _quarter_turn_found(
    case: Case, log: CheckedLog, now: Reading, turns: Sequence[TurnedJoints]
) -> Iterator[Finding]:
    tried = {x: reduce(lambda reading, one: reading.with_zero(*one), x, now) for x in turns}
    # turns that fit about as well as any, the best first; none with a joint more than it needs
    least = max(reading.log_likelihood for reading in tried.values()) - SURE
    near = [x for x in turns if tried[x].log_likelihood > least]
    near.sort(key=lambda x: -tried[x].log_likelihood)
    near = [x for x in near if not any(set(y) < set(x) for y in near)]
    best, robot = near[0], case.loaded.robot
    before, after = now.percent, tried[best].percent
    rise = tried[best].log_likelihood - now.log_likelihood
    if rise < STRIKING or after > min(CLEAN, before / LEAST_FALL):
        return
    words = " or ".join(turn_words(robot, turned) for turned in near)
    fitted = {robot.joint_names[k]: (x, *zero_near(tried[best], k)) for k, x in best}
    holds = all(abs(more) <= Z95 * std for _, more, std in fitted.values())
    if not holds:
        words += " (fitted: {})".format(
            ", ".join(
                f"{name} {np.rad2deg(x + more):+.1f} ± {np.rad2deg(Z95 * std):.1f}°"
                for name, (x, more, std) in fitted.items()
            )
        )
    # no line of the robot file where another one explains the log about as well
    line = zero_edits(tried[best]) if len(near) == 1 and holds else ()
    yield Finding.doubtful(
        f"{OTHER_ZEROS}{words}: misfit of the nominal model {after:.1f} %, as declared "
        f"{before:.1f} %",
        f"misfit {before:.1f} % falls to {after:.1f} %, log-likelihood {rise:+.0f}",
        tuple(case.joints[k] for k, _ in best),
        Fix(f"Set position_offset in [signals], {IF_CONFIRMED}", line),
        hypotheses=(
            ComparedHypothesis(turn_words(robot, best), after, 0.0),
            ComparedHypothesis("as declared", before, -rise, declared=True),
        ),
        nominal=True,
        log=log.name,
    )
