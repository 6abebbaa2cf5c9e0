"""Residuals far above the measurement noise: the model is incomplete, and what most likely."""

from collections.abc import Iterable, Sequence

import numpy as np

from steelyard.check.decision.zeros_and_quarter_turns import (
    estimated_offsets,
    far_offsets,
    offset_line,
    turned_zeros,
)
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.causes_of_residuals import Cause, LeftOutGain
from steelyard.check.fitted.fitted_case_and_causes import (
    FittedCase,
    RankedCauses,
    largest_residual,
    post_fit_check,
    worst_residual_words,
)
from steelyard.estimate.scores.residuals import ResidualNoise
from steelyard.model.laws.bodies_springs_and_offset import Cogging

INCOMPLETE_RESIDUAL = 2.0  # over the noise's upper bound, of an incomplete model
LARGE_FIT_ERROR = 10.0  # error of fitted runs [%] from which on unknown noise is reported
CAUSE_ADVICE = {
    "gain": "Check the gain and unit of this effort",
    "saturation": "Check the gain of this effort at large currents",
    "hysteresis": "Check the mounting of this sensor, and its calibration with rising and "
    "falling torques",
    "crosstalk": "Check the calibration of this sensor under loads of the other joint",
    "tilt": "Check gravity (or mounting) in [robot], its direction in the frame of the base",
    "compliance": "Positions may be measured before an elastic gear",
}
"""What to do about a cause, by its kind; of the geometry otherwise."""
LIKE_THE_BEST = 1.1  # error on left-out motion over the best cause's up to which one is as likely
INTO_TERMS = (
    'Add it to [model] terms (with friction = "auto", which takes no fixed law: list the laws '
    "that it chose there instead)"
)
ADD_TERM = f". {INTO_TERMS}"  # about a term that predicts left-out motion better
AS_LOGGED = (
    f" at the present effort scales, which change with it. {INTO_TERMS} only if the error as "
    "logged then falls"
)
"""What to do about it where scales of the efforts are estimated: errors of two models that divide
efforts by other scales cannot be compared."""
GEOMETRY_ADVICE = (
    "Check the joint zeros (position_offset in [signals]), then the lengths and axes in the model "
    "file, against the robot"
)


@post_fit_check("model error")
def model_error_check(case: FittedCase) -> Iterable[Finding]:
    """Residuals over noise, and the causes in order, of all fitted runs together.

    Doubtful if an error of geometry or efforts stands out; nothing where residuals are noise, in
    `validate`, and for closed chains.
    """
    ranked = case.ranked
    if ranked is None:
        return ()
    ratios, blamed = ranked.beside.ratios, _confirmed(case, ranked)
    if not blamed and not np.isfinite(ratios).any():
        errors = [score.pooled_percent or score.mean_percent for score in case.fitted_scores]
        error, run = max(errors, default=0.0), case.examined[0]
        if not error > LARGE_FIT_ERROR:
            return ()
        says = (
            "residuals could not be compared with noise: the regression cut-off of "
            f"{run.matched_cutoff:g} Hz leaves no band above it at {run.rate:g} Hz, and the fitted "
            f"runs have errors up to {error:.0f} %"
        )
        return (Finding.ok(says, headline=True),)
    if not blamed and float(np.nanmax(ratios)) < INCOMPLETE_RESIDUAL:
        return _periodic(case)
    zeros = _zeros(case, ranked)
    if not blamed and zeros is None:
        return (_remark(case, ranked),)
    return (_doubtful(case, ranked, blamed, zeros),)


def _confirmed(case: FittedCase, ranked: RankedCauses) -> tuple[Cause, ...]:
    """The causes to blame: shapes of a reading only if left-out motion confirms them, clearly."""
    gains = dict(case.tested) if any(cause.of_reading for cause in ranked.blamed) else {}
    sure = {cause: gain for cause, gain in gains.items() if gain is not None and gain.confirmed}
    least = min((gain.after for gain in sure.values()), default=0.0)
    return tuple(
        cause
        for cause in ranked.blamed
        if not cause.of_reading or (cause in sure and sure[cause].after <= LIKE_THE_BEST * least)
    )


def _periodic(case: FittedCase) -> tuple[Finding, ...]:
    """An effort with a period, which raises the noise above the band too, if it is confirmed."""
    ranked = case.ranked
    if ranked is None or all(cause.kind != Cogging.law for cause in ranked.likely):
        return ()
    sure = [(gain.after, cause) for cause, gain in case.tested if gain and gain.confirmed]
    if not sure or min(sure, key=lambda one: one[0])[1].kind != Cogging.law:
        return ()
    return (Finding.ok(term_advice(case.tested, case.scales is not None), headline=True),)


def _remark(case: FittedCase, ranked: RankedCauses) -> Finding:
    """What stands beside the headline where no single error is to blame."""
    worst, tested = _worst(ranked.beside), case.tested
    says = (
        f"{worst_residual_words(ranked.beside)}: the model is incomplete, which the intervals of "
        "parameters do not cover"
    )
    if not tested:
        says += ", or the noise varies slowly"
        brief = f"model incomplete, or the noise varies slowly: residuals {worst}"
        return Finding.ok(says, headline=True, brief=brief)
    named = ", ".join(_share(cause, gain) for cause, gain in tested)
    says += ". Share of the residuals above noise that each candidate alone explains "
    says += f"(not additive): {named}"
    parts = next((gain.left_out for _, gain in tested if gain is not None), None)
    if parts is not None:
        says += ". Errors on left-out motion: least squares without prior, cross-validation over "
        says += f"{parts}s"
    brief = f"model incomplete: residuals {worst}. {term_advice(tested, case.scales is not None)}"
    return Finding.ok(says, headline=True, brief=brief)


def _share(cause: Cause, gain: LeftOutGain | None) -> str:
    """A candidate, what it explains, and whether it predicts left-out motion."""
    columns = f"{cause.columns} parameter" + "s" * (cause.columns != 1)
    text = f"{cause.says} {100.0 * cause.share:.0f} % by {columns}"
    if gain is None:
        return text
    confirmed = "" if gain.confirmed else ", not confirmed"
    return f"{text} (error on left-out motion {gain.words}{confirmed})"


def term_advice(tested: Sequence[tuple[Cause, LeftOutGain | None]], scaled: bool) -> str:
    """The candidate that reduces the error on left-out motion most, or that none is confirmed."""
    sure = [(gain.after, cause, gain) for cause, gain in tested if gain and gain.confirmed]
    if sure:
        _, cause, gain = min(sure, key=lambda one: one[0])
        falls = (
            f"With {cause.says} the error on left-out motion falls from {gain.before:.2g} to "
            f"{gain.after:.2g} % (least squares, fitted logs)"
        )
        rivals = [other.says for other, its in tested if its and its.after < gain.after]
        if rivals:
            return f"{falls}, and further with {rivals[0]}: the logs do not decide between them"
        if cause.of_friction:
            return f"{falls}{AS_LOGGED if scaled else ADD_TERM}"
        return f"{falls}. {CAUSE_ADVICE.get(cause.kind, GEOMETRY_ADVICE)}"
    (cause, found), *_ = tested
    most = (
        f"Of single causes {cause.says} would explain most, {100.0 * cause.share:.0f} % of the "
        "residuals above noise"
    )
    if found is None:
        return f"{most}: not tested on left-out motion, the logs are too short"
    more = 100.0 * (found.after / found.before - 1.0)
    way = "larger with it" if more >= 0.0 else "smaller with it"
    way += ", not significantly" if found.after < found.before else ""
    return f"{most}: not confirmed on left-out motion (error {abs(more):.0f} % {way})"


def _doubtful(
    case: FittedCase,
    ranked: RankedCauses,
    blamed: Sequence[Cause],
    zeros: tuple[str, Fix] | None,
) -> Finding:
    """An error that stands out; joint zeros with their values."""
    first, *_ = blamed or ranked.found
    words = " or ".join(cause.says for cause in blamed)
    gain = dict(case.tested).get(first) if first.of_reading else None
    if gain is not None:
        words += f" (error on left-out motion {gain.words})"
    fix = Fix(CAUSE_ADVICE.get(first.kind, GEOMETRY_ADVICE))
    if zeros is not None:
        words, fix = zeros
    says = "a model error that the intervals of parameters do not cover"
    return Finding.doubtful(
        f"{worst_residual_words(ranked.beside)}: {says}, {words}",
        f"{100.0 * first.chi2 / ranked.total:.2g} % of chi²",
        joints=tuple(j for j in ranked.beside.joints if j == first.joint),
        fix=fix,
        brief=f"{words}: residuals {_worst(ranked.beside)}. {fix.says}",
    )


def _zeros(case: FittedCase, ranked: RankedCauses) -> tuple[str, Fix] | None:
    """Joint zeros that explain an error of the geometry, in words and as a line."""
    if not ranked.of_geometry:
        return None
    model = case.identified.model
    if ranked.blamed and ranked.blamed[0].kind == "zero_offset":
        offsets = estimated_offsets(model, case.examined)
        if offsets is not None and (far := far_offsets(offsets)).any():
            return f"zero offset of {offsets.words(far)}", offset_line(offsets, far)
    turned = turned_zeros(model, case.identified.estimate.sigma, case.fitted)
    return None if turned is None or turned.fix is None else (turned.says, turned.fix)


def _worst(beside: ResidualNoise) -> str:
    if not np.isfinite(beside.ratios).any():
        return "are not noise"
    joint = beside.joints[int(np.nanargmax(beside.ratios))]
    return f"up to {largest_residual(beside)} x noise (largest: {joint})"
