"""Checks of a fitted model in their order, with the short ones of its efforts and bands.

Bands are calibrated on left-out motion of the fitted logs. Where they hold clearly less of another
log, it differs from the fitted ones by more than these differ from each other.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from steelyard.base.arrays import Z95
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.cases_and_checks import CaseCheck, case_check
from steelyard.check.finding import MOST_LISTED, Finding, Fix, Severity, percent_of
from steelyard.check.fitted.changes_within_run import change_in_run_check
from steelyard.check.fitted.disagreeing_runs_and_passing_forces import (
    last_link_check,
    runs_disagree_check,
)
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.implausible_estimates_and_gear_side import (
    LINK_SIDE_INSTEAD,
    SEPARABLE_ROTORS,
    absurd_bodies_check,
    light_links_check,
    load_friction_check,
    rotors_at_zero,
    rotors_at_zero_check,
)
from steelyard.check.fitted.incomplete_model_and_unseen_error import (
    model_error_check,
    unseen_reason_check,
)
from steelyard.estimate.consistent.convex_estimator import CONTRADICTED_KNOWLEDGE
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.hidden_by_contacts import touched_samples
from steelyard.estimate.scores.effort_errors import PROMISED, known_efforts
from steelyard.model.laws.friction_with_memory import LoadDependent
from steelyard.model.laws.laws_without_friction import RotorInertia, Spring
from steelyard.model.laws.register import law_of
from steelyard.report.words import first_names, significant, with_interval
from steelyard.robot.robot import BASE_COORDINATES


@case_check("95 % bands")
def band_coverage_check(case: FittedCase) -> Iterable[Finding]:
    """A remark on logs in motion that were not fitted, of which the bands hold too little."""
    scores = [score for score in case.unseen_scores if not score.errors.at_rest]
    known = {score.run: score.coverage_percent for score in scores}
    below = {run: x for run, x in known.items() if x is not None and x < PROMISED}
    if not below:
        return ()
    worst = min(below, key=lambda run: below[run])
    score = next(score for score in scores if score.run == worst)
    several = len(scores) > 1
    where, shares = f" of {worst}" if several else " of the samples", score.traces.coverage
    brief = f"the 95 % bands of efforts hold {below[worst]:.0f} %{where}"
    if shares is not None and len(shares) > 1:
        fewest = int(np.nanargmin(shares))
        brief += f" (fewest: {score.joints[fewest].joint}, {100.0 * shares[fewest]:.0f} %)"
    if several:
        brief += f", less than {PROMISED:.0f} % in {len(below)} of {len(known)} logs"
    says = (
        f"{brief}: this motion differs from the fitted one by more than parts of that differ from "
        "each other; the model is incomplete there, or a parameter error shifts all samples"
    )
    log = "" if several else worst
    brief += ": errors on other motion may be larger than stated"
    return (Finding.ok(says, headline=True, brief=brief, log=log),)


OF_FRICTION = (
    "Friction below zero means that the sign of an effort or position is wrong, that the drive "
    "compensates friction, or that a term is missing"
)
OF_ROTORS = (
    "Rotor inertia below zero means that efforts do not contain the rotors' torques (sensors on "
    "the link side), or are late"
)
OF_OTHERS = "A term is missing, or what is known beforehand is wrong"
OF_LINKS = (
    "Masses or geometry of the model file, signs or gains of the efforts are wrong, or a term is "
    "missing"
)
CHECK_BOUNDS = "Check these efforts; [[knowledge]] with a lower bound below zero allows such values"
TURN_EFFORTS = (
    "Change the sign of gain in [signals.effort]; `steelyard check ROBOT LOG...` tests it"
)
CHECK_LINKS = "`steelyard check ROBOT LOG...` compares them; `--method least_squares` uses neither"


@case_check("constraints")
def constraints_check(case: FittedCase) -> Iterable[Finding]:
    """Doubtful if bounds or priors cost far more than noise, and unseen motion is worse for it."""
    found = case.binding
    if found is None:
        return ()
    motion = "unseen motion" if found.of_unseen else "left-out motion"
    figure = (
        f"prior and constraints raise χ² by {found.rise:.3g}, where {found.rank} is within noise"
    )
    falls = f"the error on {motion} is {found.error:.2g} %, without them {found.without:.2g} %"
    if found.turned is not None:
        says = (
            "all efforts, or all positions, have the opposite sign: masses and friction come out "
            f"below zero, {falls}; with the signs of all efforts changed the constraints hold"
        )
        figure += f", with the signs of all efforts changed {found.turned:.3g}"
        return (Finding.wrong(says, figure, (), Fix(TURN_EFFORTS), headline=True),)
    if not found.bounds:
        says = f"the log contradicts the prior or the valid inertias of the links: {falls}"
        says, fix = f"{says}. {OF_LINKS}", Fix(CHECK_LINKS)
        return (Finding.doubtful(says, figure, (), fix, headline=True),)
    laws = {law_of(name) for name in found.negative}
    means = [OF_FRICTION] if any(law.dissipation != "none" for law in laws) else []
    means += [OF_ROTORS] if RotorInertia in laws else []
    meaning, fix = ". ".join(means or [OF_OTHERS]), Fix(CHECK_BOUNDS)
    bounds = first_names(found.bounds, MOST_LISTED)
    what = f"the log contradicts bounds at {', '.join(found.joints)} ({bounds}): {falls}"
    brief = f"{what}. {meaning}. {fix.says}"
    least = f" Least squares finds {', '.join(found.values)}." if found.values else ""
    says = f"{what}.{least} {meaning}"
    return (Finding.doubtful(says, figure, found.joints, fix, headline=True, brief=brief),)


LEAST_CLIPPED_SHARE = 0.002  # share of the values of all efforts from which on they are named


@case_check("clipped efforts")
def clipped_efforts_check(case: FittedCase) -> Iterable[Finding]:
    """Efforts at a limit in runs that were not fitted."""
    for run in case.unseen:
        count = run.quality.marked.cut_off
        values = run.quality.rows * len(run.recording.signals.effort_units)
        if count > LEAST_CLIPPED_SHARE * values:
            says = (
                f"{count} efforts ({percent_of(count / values)}) are saturated: the "
                "error includes them, though the required effort was not measured there"
            )
            yield Finding.ok(says, headline=True, log=run.name)


TERMS_LIKE_A_SCALE = (Spring.law, LoadDependent.law)  # their efforts change with posture or load
WRONG_SCALE = 1.3  # factor beyond a scale's interval from which on a gain is doubtful


@case_check("gains")
def assumed_gains_check(case: FittedCase) -> Iterable[Finding]:
    """Gains that the logs do not show; doubtful if these are most, as nothing then has a scale."""
    if case.gains is None:
        return ()
    unseen = tuple(one.joint for one in case.gains.each if one.assumed)
    fix = Fix("Give these gains, move these joints faster, or add a log with a load (--loaded)")
    said = []
    if unseen:
        said.append(
            f"the gain of {first_names(unseen, 3)} is assumed, as these logs do not show it: "
            "torques, friction and rotor inertia there are relative to it"
        )
    if not all(known_efforts(case.identified)):
        said.append(
            "a gain of 1 stands for unknown ones: masses, inertias and torques are up to one "
            "common factor"
        )
    says = "; ".join(said)
    if 2 * len(unseen) > len(case.gains.known) - sum(case.gains.known):
        return (
            Finding.doubtful(says, "", unseen, fix, headline=True, brief=f"{says}. {fix.says}"),
        )
    return (Finding.ok(says, headline=True, brief=says),) if said else ()


MUCH_WORSE = 1.1  # error of a search over that of least squares from which on it has not ended


@case_check("genetic search")
def unfinished_search_check(case: FittedCase) -> Iterable[Finding]:
    """A genetic algorithm that ends far from least squares without bounds."""
    found = case.identified.estimate.evolution
    if found is None or found.best[-1] <= MUCH_WORSE * found.least_squares:
        return
    worse = found.best[-1] / max(found.least_squares, 1e-300)
    says = (
        f"the genetic search ended at {significant(worse)} times the root mean square error of "
        "least squares without bounds: it ended too early, or its bounds exclude the optimum"
    )
    fix = Fix(
        "Give more generations, a larger population or a smaller `sufficient` in "
        '[estimation.genetic], wider bounds, or take method = "WLS"'
    )
    yield Finding.doubtful(says, "", (), fix, headline=True, brief=f"{says}. {fix.says}")


@case_check("contact flags")
def constant_flags_check(case: FittedCase) -> Iterable[Finding]:
    """Contacts of unknown force that touch in no sample, or in all of them, in every log."""
    base = case.identified.signals.base
    if base is None or not base.touches or not case.fitted:
        return
    on, _, samples = touched_samples(case.fitted, len(base.touches))
    for kind, constant in (("never", on == 0), ("always", on == samples)):
        named = [t.frame for t, so in zip(base.touches, constant, strict=True) if so]
        if named:
            says = (
                f"{', '.join(named)} {kind} touch{'es' if len(named) == 1 else ''} in these logs: "
                "a flag or threshold that is wrong would look the same"
            )
            yield Finding.ok(says, headline=True)


@case_check("prior constraints")
def contradicted_knowledge_check(case: FittedCase) -> Iterable[Finding]:
    """Prior constraints of the robot file that the data contradict, as a note of the fit says."""
    for note in case.identified.estimate.notes if case.fitted else ():
        if note.startswith(CONTRADICTED_KNOWLEDGE):
            yield Finding.ok(f"{note}; intervals assume that they hold", headline=True)


@case_check("standstill")
def standstill_check(case: FittedCase) -> Iterable[Finding]:
    """Samples at standstill that are fitted as the robot file requests it."""
    if case.fitted and not any(run.rest_speed.any() for run in case.fitted):
        says = (
            'samples at standstill are fitted (rest_speed = "off"): friction there is anything up '
            "to breakaway, so residuals, and causes named for them, contain it"
        )
        yield Finding.ok(says, headline=True, brief=says)


@case_check("effort scales")
def scaled_efforts_check(case: FittedCase) -> Iterable[Finding]:
    """Estimated scales of the efforts; doubtful if one is far off 1, its interval aside."""
    scales = case.scales
    if scales is None:
        return ()
    beyond = np.abs(np.log(scales.found.values)) - Z95 * scales.found.std
    values = zip(scales.joints, scales.found.values, scales.known.half_width, beyond, strict=True)
    off = [f"{name} {with_interval(x, h)}" for name, x, h, far in values if far > 0.0]
    pairs = zip(scales.joints, beyond, strict=True)
    wrong = tuple(joint for joint, far in pairs if far > np.log(WRONG_SCALE))
    listed = ", ".join(off) or "none significant by itself"
    alone = 0 < 2 * len(off) < len(scales.joints)
    says = (
        f"a scale of the efforts is estimated per joint ({listed}): sensors or gains may be "
        "off by these factors, or a missing term may have the same effect. Masses are as "
        f"uncertain as the scales{_term_instead(case, scales.found.distance)}"
    )
    brief = f"sensors or gains may be off, or a term missing: estimated scales {listed}"
    if alone:
        brief = (
            f"effort over what the efforts of the other joints imply: {listed}. Its sensor or gain "
            "is off by this factor, or a term is missing (a factor common to all joints looks like "
            "heavier links)"
        )
    elif not off:
        brief = (
            "estimated scales of the efforts are used: together they differ significantly from 1, "
            "though none does by itself"
        )
    if not wrong:
        return (Finding.ok(says, headline=True, brief=brief),)
    fix = Fix(f"Check gain and unit of the effort of {', '.join(wrong)}")
    brief = f"{brief}. {fix.says}"
    return (Finding.doubtful(says, "", wrong, fix, headline=True, brief=brief),)


def _term_instead(case: FittedCase, distance: float) -> str:
    """A term that looks like a scale and explains more of what is left beside them than they do.

    The squared distance of the scales from 1 is about what they take from chi square.
    """
    if not case.tested:
        return ""
    first, gain = case.tested[0]
    if first.kind not in TERMS_LIKE_A_SCALE or first.chi2 <= distance:
        return ""
    more = (
        f"; {first.says} explains more than the scales (reduces χ² by {first.chi2:.0f} in "
        f"addition to them, the scales by {distance:.0f})"
    )
    if gain is None or not gain.confirmed:
        return f"{more}, but is not confirmed on left-out motion"
    return (
        f"{more} and reduces the error on left-out motion ({gain.words}): add it, and keep it if "
        "the error as logged falls"
    )


OF_A_LOG = ("force on the base", "nominal model", "unseen log", "95 % bands", "clipped efforts")
"""Checks of logs that a model is compared with; `validate` makes them of its own logs."""


def doubts_of_fit(findings: Iterable[Finding], unseen: Sequence[str]) -> list[dict[str, str]]:
    """What findings doubt of a fit, whatever log it is compared with, as a model keeps it."""
    return [
        {
            "check": one.check,
            "log": one.log,
            "severity": one.severity.name,
            "says": one.says,
            "figure": one.figure,
            "fix": "" if one.fix is None else one.fix.says,
            "brief": one.brief,
        }
        for one in findings
        if one.severity and one.check not in OF_A_LOG and one.log not in unseen
    ]


WORSE_THAN_NOMINAL = 1.2  # RMSE over the nominal model's from which on a joint is named
LOADED_JOINT_SHARE = 0.25  # RMS effort over the largest of its unit of a joint with load


@case_check("nominal model")
def below_nominal_check(case: FittedCase) -> Iterable[Finding]:
    """Joints with load that the nominal model predicts better, in unseen runs if there are any."""
    identified = case.identified
    zero, every = rotors_at_zero(identified.estimate, identified.signals.effort_kind)
    fix = Fix("Review the terms, and the check of this joint's effort")
    if zero:
        fix = Fix(
            f"{len(zero)} of {every} {SEPARABLE_ROTORS} are zero: torques may be those of sensors "
            f"on the link side; try {LINK_SIDE_INSTEAD} first"
        )
    base = identified.signals.base
    unknown = [] if base is None or base.wrench_known else [c.name for c in BASE_COORDINATES]
    for score in case.unseen_scores or case.fitted_scores:
        most: dict[str, float] = {}
        for joint in score.joints:
            most[joint.unit] = max(most.get(joint.unit, 0.0), joint.predict_zero)
        worse = {
            j.joint: f"{j.joint} (RMSE {j.rmse:.2g} {j.unit}, nominal model {j.prior_rmse:.2g})"
            for j in score.joints
            if j.prior_rmse is not None
            and j.joint not in unknown
            and j.predict_zero >= LOADED_JOINT_SHARE * most[j.unit]
            and j.rmse > WORSE_THAN_NOMINAL * j.prior_rmse
        }
        if worse:
            words = ", ".join(worse.values())
            yield Finding.doubtful(
                f"larger prediction error than the nominal model of the robot file: {words}",
                "",
                tuple(worse),
                fix,
                brief=f"worse than the nominal model: {words}. {fix.says}",
                log=score.run,
            )


def kept_doubts(identified: IdentifiedModel) -> tuple[Finding, ...]:
    """The findings that `doubts_of_fit` made."""
    found = []
    for one in identified.provenance.doubts:
        fix = Fix(one["fix"]) if one["fix"] else None
        where = one["check"], one["log"], Severity[one["severity"]]
        says, brief = (one["says"], one["figure"]), one["brief"]
        found.append(Finding(*where, *says, fix=fix, headline=True, brief=brief))
    return tuple(found)


BASE_FORCE_ERRORS = 0.02, 0.1
"""Errors of the force on a floating base over the robot's weight from which on something acts that
the log does not have: doubtful, wrong."""
OF_BASE_FORCE = Fix(
    "Check contacts that are not measured, axes, signs, units and clock of the forces, and "
    "mounting, unit, bias and clock of the inertial sensor"
)


@case_check("force on the base")
def base_force_check(case: FittedCase) -> Iterable[Finding]:
    """How far the force on a floating base is from that of the contacts, over the weight.

    Only these rows see the total mass and the contacts; errors of joints can be small beside it.
    """
    identified = case.identified
    base, robot = identified.signals.base, identified.robot
    if base is None or not base.wrench_known:
        return
    own = identified.estimate.values.as_dict().get(f"m.{robot.bodies[0].name}", 0.0)
    nominal = sum(body.inertia.mass for body in robot.bodies)
    weight = max(own, nominal) * float(np.linalg.norm(base.gravity))
    axes = [coordinate.name for coordinate in BASE_COORDINATES[:3]]
    for score in case.unseen_scores or case.fitted_scores:
        error = float(np.hypot.reduce([j.error for j in score.errors.joints if j.joint in axes]))
        share = error / max(weight, 1e-300)
        if share < BASE_FORCE_ERRORS[0]:
            continue
        says = (
            f"the force on the base is predicted with an error of {significant(error)} N, "
            f"{100.0 * share:.2g} % of the weight: masses and the total mass are wrong by as much"
        )
        brief, made = f"{says}. {OF_BASE_FORCE.says}", (says, "", (), OF_BASE_FORCE)
        wrong = share >= BASE_FORCE_ERRORS[1]
        finding = Finding.wrong if wrong else Finding.doubtful
        yield finding(*made, headline=True, brief=brief, log=score.run)


POST_FIT: tuple[CaseCheck[FittedCase], ...] = (
    absurd_bodies_check,
    light_links_check,
    constraints_check,
    runs_disagree_check,
    change_in_run_check,
    rotors_at_zero_check,
    unfinished_search_check,
    standstill_check,
    contradicted_knowledge_check,
    constant_flags_check,
    model_error_check,
    assumed_gains_check,
    scaled_efforts_check,
    load_friction_check,
    last_link_check,
    base_force_check,
    below_nominal_check,
    unseen_reason_check,
    band_coverage_check,
    clipped_efforts_check,
)


OF_FIXED_BASE = (model_error_check,)
"""Checks that take every effort row for a joint's."""


def examine_fit(
    case: FittedCase,
    progress: Progress = silent,
    checks: Sequence[CaseCheck[FittedCase]] | None = None,
) -> tuple[Finding, ...]:
    """The findings that are doubtful, wrong or for the headline, the most severe first."""
    chosen = checks
    if chosen is None:
        floats = case.identified.robot.floating
        chosen = [check for check in POST_FIT if not (floats and check in OF_FIXED_BASE)]
    found: list[Finding] = []
    for number, check in enumerate(chosen):
        report_progress(progress, f"checking the fit: {check.name}", number, len(chosen))
        found += [finding for finding in check(case) if finding.severity or finding.headline]
    return tuple(sorted(found, key=lambda finding: -finding.severity))
