r"""The payload of a robot from loaded runs and an identified model, in one fit.

All parameters are estimated together: the arm's, starting from what the model knows of them, each
run's friction and offset, which drift from day to day, and the payload's ten,

$$ \min \sum_j \frac{\|r_j\|^2}{\sigma_j^2} + \|\phi - \hat\phi\|^2_{\Sigma^{-1}}
   + \sum_r \|\delta_r\|^2_{D^{-1}} $$

so the payload's intervals hold the model's uncertainty and that of friction. What the model lacks
shows as residuals that are alike within windows of time and runs: they widen the covariance as they
do a model's (see `covariance_from_residuals`). Where efforts are currents, an error $\epsilon_j$ of
the gain of a joint scales what the payload adds to its effort, $\epsilon_j B_j \phi_L$; fitted, it
moves the payload by $\epsilon_j v_j$, and the covariance grows by $\sum_j s^2 v_j v_j^T$ with the
gains' relative deviation $s$. The arm's own part was identified with the same gains. Scales of the
efforts that were identified with the model are of any unit, and correlated: with the covariance $C$
of their logarithms it grows by $\sum_{jk} C_{jk} v_j v_k^T$ instead. Where the arm is found from
the runs alone, its part of the efforts scales too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen
from steelyard.base.errors import DataError, SteelyardError
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload import payload_estimate
from steelyard.estimate.payload.runs_with_payload import (
    LoadCase,
    carrier,
    covariance_of,
    inverse,
    load_case,
    refuse_foreign,
    scatter,
    seen_information,
)
from steelyard.robot.file.signals import MOTOR_KINDS
from steelyard.robot.robot import Frame
from steelyard.uses.effort_plausibility import LEAST_FITTED, refuse_unexplained
from steelyard.uses.payload import known_and_consistent_payload_body as payload_body

FRICTION_DRIFT = 0.5  # of friction and offset from run to run, over the effort they make in a joint
GAIN_RELATIVE_STD = 0.02  # relative standard deviation of motors' gains given without one

ROUND_OFF = float(np.finfo(float).eps)  # of squared residuals, over the greatest squared effort

UNEXPLAINED, NOTABLE = 2.5, 0.05
"""Residual over that of the model's own logs, and over the effort, from which on a joint's efforts
are not explained: 2.0 at most in the loaded logs of a UR10e, on days without fitted logs."""

REMOVED_SHARE = 0.01
"""Rise of the squares by a body that was removed, over that by one that is carried, up to which a
negative mass is that of a body: efforts in another scale are none's."""
LEAST_SIGMA = 1e-3  # least residual of the model's logs, over the effort, to compare with
KNOWN = 1e-6  # standard deviation of what was not estimated, of its size or of 1 SI unit

ROUNDS = 50
TOLERANCE = 1e-6  # relative change of the rows' variances at which they have converged

NOTHING_KNOWN = payload_body.PayloadKnowledge()


@dataclass(frozen=True, eq=False)
class CaseFit:
    """Values, their information matrix, and the variance of each row's residuals."""

    values: Array
    matrix: Array
    variances: Array


def fit_payload(
    identified: IdentifiedModel,
    loaded: Sequence[Information],
    frame: str | None = None,
    *,
    unloaded: Sequence[Information] = (),
    gain: float | None = None,
    known: payload_body.PayloadKnowledge = NOTHING_KNOWN,
) -> payload_estimate.PayloadEstimate:
    """Weigh what a robot carries: a physically consistent body.

    The model's covariance says how far its parameters may move; with unloaded runs they are found
    from the runs alone. Efforts are as logged. `gain` is the relative standard deviation of each
    gain of the efforts; if `None`, `GAIN_RELATIVE_STD` where efforts are currents, or nothing
    beside scales that were identified with the model.
    """
    if not loaded:
        wrong = "there is no run with the payload"
        fix = "give at least one log of the loaded robot"
        raise DataError(wrong, where="identification of a payload", fix=fix)
    share = gain_share(identified, gain)
    refuse_foreign(identified.model, (*unloaded, *loaded))
    carries = carrier(identified.model.robot, frame)
    model, gains, units = identified.model, identified.signals.gains, identified.robot.effort_units
    both = ([run.scaled(gains, units) for run in some] for some in (unloaded, loaded))
    zero = {one.name for one in identified.estimate.removed}
    case = load_case(model, identified.base, carries, *both, first_deviates=True, zero=zero)
    fit = fitted_case(identified, case, bool(unloaded))
    if not unloaded:
        refuse_unexplained_case(identified, case, fit)
    return weighed(identified, case, fit, case.payload, carries, bool(unloaded), share, known)


def refuse_unexplained_case(identified: IdentifiedModel, case: LoadCase, fit: CaseFit) -> None:
    """The model and what the arm carries explain most of the efforts."""
    information, values = case.information, fit.values.copy()
    known = identified.estimate.parameters.as_dict()
    for k, name in enumerate(information.layout.columns[: case.n_arm]):
        values[k] = known.get(name, values[k])
    variances = np.square(identified.estimate.sigma)
    residual, measured = (
        float(np.sum(squares / variances)) / float(information.n_samples.sum())
        for squares in (information.residual_squares(values), information.effort_squares())
    )
    refuse_unexplained(residual, measured, information.runs, LEAST_FITTED, " with any payload")


def gain_share(identified: IdentifiedModel, stated: float | None) -> float:
    """Relative standard deviation of each gain.

    Efforts of motors are currents times a constant, whatever their unit.
    """
    of_motors = identified.signals.effort_kind in MOTOR_KINDS
    usual = GAIN_RELATIVE_STD if of_motors and identified.effort_scales is None else 0.0
    gain = usual if stated is None else stated
    if not 0.0 <= gain < 1.0:
        wrong = f"the relative uncertainty of the drive gains is {gain:g}"
        fix = "give 0 for exact gains, or a share such as 0.02"
        raise DataError(wrong, where="identification of a payload", fix=fix)
    return gain


CERTAIN_PAYLOAD_STD = 3.0  # standard deviations of its mass from which on there is one
LEAST_PAYLOAD_SHARE = 0.02  # least mass that is reported, over that of the moving links


def unknown_payload(identified: IdentifiedModel, run: Information) -> str:
    """What a run, as logged, carries beyond doubt, in words; empty if nothing, or unknown."""
    if identified.signals.effort_kind == "gravity_compensated_torque":
        return ""
    try:
        found = fit_payload(identified, [run])
    except SteelyardError:
        return ""
    least = LEAST_PAYLOAD_SHARE * sum(body.inertia.mass for body in identified.model.robot.bodies)
    if not found.mass > max(least, CERTAIN_PAYLOAD_STD / Z95 * float(found.half_width[0])):
        return ""
    return (
        f"the efforts of {run.runs} are those with a payload of {found.mass:.2f} ± "
        f"{found.half_width[0]:.2f} kg on '{found.body}' that the model does not have, or with "
        "other drive gains: see steelyard payload"
    )


def fitted_case(identified: IdentifiedModel, case: LoadCase, jointly: bool) -> CaseFit:
    """Arm, friction of the runs and payloads together, without physical constraints.

    Weighted least squares with prior knowledge, of the arm unless it is found from the runs alone
    (`jointly`); every row weighs by its own residuals.
    """
    information, mean = case.information, np.zeros(case.size)
    precision = np.zeros((case.size, case.size))
    values, known = _knowledge(identified, case)
    if not jointly:
        mean[: case.n_arm], precision[: case.n_arm, : case.n_arm] = values, known
    allowed = FRICTION_DRIFT * _friction(identified, case, values)
    for run in case.deviations:
        precision[run, run] = 1.0 / np.square(allowed)
    counts = information.n_samples
    powers = information.effort_squares() / np.maximum(counts, 1.0)
    floor = ROUND_OFF * max(float(powers.max()), 1e-300)
    variances = np.maximum(powers, floor)
    for _ in range(ROUNDS):
        matrix, vector, _square = information.normal(1.0 / variances)
        matrix += precision
        covariance = inverse(matrix)
        values = covariance @ (vector + precision @ mean)
        values += covariance @ (vector + precision @ mean - matrix @ values)
        used = np.empty(len(counts))
        for row, seen in enumerate(information.layout.sees):
            gram = information.row_gram(row)[:-1, :-1]
            used[row] = np.sum(gram * covariance[np.ix_(seen, seen)]) / variances[row]
        squares = information.residual_squares(values)
        updated = np.maximum(squares / np.maximum(counts - used, 1.0), floor)
        change = np.abs(updated / variances - 1.0).max()
        variances = updated
        if change < TOLERANCE:
            break
    return CaseFit(values, matrix, variances)


def weighed(
    identified: IdentifiedModel,
    case: LoadCase,
    fit: CaseFit,
    columns: tuple[int, ...],
    carries: Frame,
    jointly: bool,
    gain: float,
    known: payload_body.PayloadKnowledge,
) -> payload_estimate.PayloadEstimate:
    """One payload of a case, with ten columns, as a physically consistent body in a frame.

    The arm was found from the runs alone if `jointly`; gains are exact if `gain` is zero.
    """
    scales, free = identified.effort_scales, fit.values[list(columns)]
    moved = _by_scale(case, fit, columns, jointly)
    widening = _of_model(identified, case, fit, columns) + gain**2 * moved @ moved.T
    of_scales = None if scales is None else moved @ scales.covariance @ moved.T
    if of_scales is not None:
        widening = widening + of_scales
    by_data = covariance_of(fit.matrix, columns) + widening
    payload_estimate.refuse_unseen(by_data, carries)
    payload_body.refuse_contradiction(free, by_data, known)
    information = seen_information(fit.matrix, columns)
    body = payload_body.consistent_body(free, information, by_data, widening, known)
    sign, unexplained = 1.0, _unexplained(identified, case, fit)
    if not (known.words or unexplained) and free[0] < -payload_estimate.BEYOND_DOUBT * np.sqrt(
        by_data[0, 0]
    ):
        removed = payload_body.consistent_body(-free, information, by_data, widening, known)
        if removed.chi_squared <= REMOVED_SHARE * body.chi_squared:
            sign, body = -1.0, removed
    return payload_estimate.payload_of(
        carries,
        identified.model.robot,
        sign * body.ten,
        body.covariance,
        sigma=frozen(np.sqrt(fit.variances)),
        n_samples=frozen(case.information.n_samples),
        notes=(
            *(f"known: {words}" for words in known.words),
            "arm and payload are identified together from the unloaded and loaded runs"
            if jointly
            else "the arm's parameters are the model's, within its uncertainty",
            "friction and offsets are estimated per run, within "
            f"{100.0 * FRICTION_DRIFT:g} % of the model's",
            _scale_note(gain, of_scales, body.covariance),
        ),
        chi_squared=body.chi_squared,
        free_mass=float(free[0]),
        unexplained=unexplained,
    )


def _unexplained(identified: IdentifiedModel, case: LoadCase, fit: CaseFit) -> str:
    """Joints whose residuals with any payload are not those of the model's own logs, in words."""
    information = case.information
    residual = np.sqrt(fit.variances)
    effort = np.sqrt(information.effort_squares() / np.maximum(information.n_samples, 1.0))
    own = residual / np.maximum(identified.estimate.sigma, LEAST_SIGMA * effort)
    wrong = np.flatnonzero((own > UNEXPLAINED) & (residual > NOTABLE * effort))
    if not len(wrong):
        return ""
    names = ", ".join(identified.joints[k] for k in wrong)
    return (
        f"the model with any payload does not explain this log: at {names} the residual is up to "
        f"{own[wrong].max():.1f} times that of the model's own logs; positions, efforts or units "
        "differ from theirs, and the interval may be too narrow: run steelyard check with this log"
    )


def _scale_note(gain: float, of_scales: Array | None, covariance: Array) -> str:
    """How well the scale of the efforts is known.

    `of_scales` is the part of the covariance that the model's scales make; `None` without scales.
    """
    if of_scales is not None:
        half, all_of_it = (Z95 * np.sqrt(matrix[0, 0]) for matrix in (of_scales, covariance))
        more = f"; each drive gain has a further uncertainty of {100.0 * gain:g} %" if gain else ""
        return (
            "efforts are corrected by the scales identified with the model; their uncertainty "
            f"contributes ± {half:.2g} kg to the mass's 95 % interval of ± {all_of_it:.2g} kg{more}"
        )
    if not gain:
        return (
            "efforts are assumed exact: a common scale error of 1 % changes the mass by 1 % and is "
            "not in the intervals"
        )
    return (
        f"drive gains are assumed known within {100.0 * gain:g} % each (one standard deviation); "
        "if they are less accurate, state --gain-uncertainty, or the interval of the mass is too "
        "narrow"
    )


def _knowledge(identified: IdentifiedModel, case: LoadCase) -> tuple[Array, Array]:
    """The model's values of the arm's columns, and the inverse of their covariance.

    Nothing is known of what the model's data did not see.
    """
    estimate = identified.estimate
    columns = case.information.layout.columns[: case.n_arm]
    place = {name: k for k, name in enumerate(estimate.parameters.names)}
    mine = [k for k, name in enumerate(columns) if name in place]
    theirs = [place[columns[k]] for k in mine]
    values, precision = np.zeros(case.n_arm), np.zeros((case.n_arm, case.n_arm))
    values[mine] = estimate.parameters.values[theirs]
    covariance = np.array(estimate.covariance[np.ix_(theirs, theirs)])
    given = [k for k, column in enumerate(mine) if columns[column] in estimate.known]
    sizes = np.maximum(np.abs(values[mine])[given], 1.0)
    covariance[given, given] = np.square(KNOWN * sizes)
    precision[np.ix_(mine, mine)] = inverse(covariance)
    return values, precision


def _friction(identified: IdentifiedModel, case: LoadCase, values: Array) -> Array:
    """Per drifting column the value with which it alone makes all friction of its joints.

    Noise counts as friction, so that a joint without friction may get some.
    """
    information, drift = case.information, list(case.drift)
    own, makes = np.zeros(case.n_arm), np.zeros(case.n_arm)
    for row, seen in enumerate(information.layout.sees):
        mine = [k for k, column in enumerate(seen) if column in drift]
        columns = [seen[k] for k in mine]
        gram = information.row_gram(row)[np.ix_(mine, mine)]
        made = values[columns] @ gram @ values[columns]
        made += information.n_samples[row] * identified.estimate.sigma[row] ** 2
        own[columns] += np.diag(gram)
        makes[columns] += made
    largest = np.sqrt(np.divide(makes, own, out=np.full(case.n_arm, np.inf), where=own > 0.0))
    return np.asarray(largest[drift])


def _of_model(
    identified: IdentifiedModel, case: LoadCase, fit: CaseFit, columns: tuple[int, ...]
) -> Array:
    """Covariance of a payload by residuals alike for longer than the filter, `(10, 10)`.

    They count as what they are in windows, between runs, and in the model's left-out runs.
    """
    information, covariance = case.information, inverse(fit.matrix)
    factors = scatter(information, fit.values, fit.variances, covariance)
    if identified.calibration is not None:
        ratios = np.square(identified.calibration.factors[:, 1:] / Z95)
        factors = np.maximum(factors, ratios.mean(axis=1))
    more, _vector, _square = information.normal((factors - 1.0) / fit.variances)
    some = covariance[list(columns)]
    return np.asarray(some @ more @ some.T)


def _by_scale(case: LoadCase, fit: CaseFit, columns: tuple[int, ...], jointly: bool) -> Array:
    """Derivatives of a payload by the logarithm of each row's scale, shape `(10, rows)`.

    The model's part of the efforts was identified with the same scales.
    """
    information = case.information
    values, covariance = fit.values.copy(), inverse(fit.matrix)
    if not jointly:
        values[: case.payloads[0][0]] = 0.0
    moved = np.empty((len(columns), len(information.layout.sees)))
    for row, seen in enumerate(information.layout.sees):
        gram = information.row_gram(row)[:-1, :-1] / fit.variances[row]
        moved[:, row] = covariance[np.ix_(columns, seen)] @ (gram @ values[list(seen)])
    return moved
