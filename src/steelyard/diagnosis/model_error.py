"""Residuals far above the measurement noise: the model lacks something, and what most likely."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.causes import Cause, causes, wide_model
from steelyard.diagnosis.finding import Edit, Finding, Judgement, Mend
from steelyard.diagnosis.fitted_case import FittedCase
from steelyard.estimation.fields import said_by
from steelyard.estimation.least_squares import WeightedLeastSquares
from steelyard.estimation.per_run import own_columns
from steelyard.estimation.sandwich import inflations
from steelyard.estimation.zero_offset import ZeroOffsets, find_offsets, with_offsets
from steelyard.regression.base import base_map
from steelyard.regression.regressor import base_regressor
from steelyard.robot.signals import Signals
from steelyard.validation.mixes import remembers
from steelyard.validation.residuals import ResidualNoise, residual_noise

FAR = 2.0
"""Residual over the noise's upper bound from which on the model lacks something."""

SHARE = 0.2
"""Share of what noise does not explain from which on a cause is named."""

NAMED = 3
"""Most causes that are named."""

CLEAR = 1.5
"""How many times more than a lack of friction an error of the geometry or of an effort must
explain to be blamed: on five real robots friction explains more than any such error."""

LEAST, EACH = 25.0, 3.0
"""Chi square that it must explain, and more per column, over the factor by which the estimate
scatters more than by white residuals: a single column reaches 25 by noise once in a million."""

ALIKE = 0.8
"""Rank over the first's from which on another error is named beside it."""

BEYOND = 4.0
"""Standard deviations from what is given at which a zero offset is written as a number."""

ADVICE = {
    "gain": "Check the gain and unit of this effort",
    "saturation": "Check the gain of this effort at large currents",
    "compliance": "Positions may be measured before an elastic gear",
}
"""What to do about a cause, by its kind; of the geometry otherwise."""

GEOMETRY = "Check the lengths and axes in the model file against the robot"


class ModelError:
    """Residuals over noise, and the causes in order."""

    name: ClassVar[str] = "model error"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding for all fitted runs: doubtful if an error of geometry or efforts stands out.

        None where residuals are noise, in `validate`, and for closed chains.
        """
        identified = case.identified
        model, sigma = identified.model, identified.estimate.sigma
        if not case.fitted or model.robot.passive:
            return ()
        gains = identified.signals.gains
        beside = residual_noise(identified.valued, case.fitted, sigma, gains)
        wide = base_regressor(wide_model(model, identified.estimate))
        information = said_by(case.fitted, rests=remembers(model.terms))(wide)
        found, total = causes(model, information, sigma, beside.ratios), information.n_samples.sum()
        own = information.select(base_map(model).base_names)
        fit = WeightedLeastSquares(per_run=own_columns(model)).fit(own)
        blamed = _blamed(found, float(inflations(fit).max()))
        if blamed:
            return (_doubtful(case, beside, blamed, float(total)),)
        worst = float(np.nanmax(beside.ratios, initial=0.0))
        return (_remark(beside, found),) if worst >= FAR else ()


def _blamed(found: Sequence[Cause], inflation: float) -> list[Cause]:
    """Errors of geometry or efforts that explain much more than a lack of friction, best first."""
    terms = max((cause.rank for cause in found if cause.of_friction), default=0.0)
    others = [cause for cause in found if not cause.of_friction]
    if not others:
        return []
    first = others[0]
    enough = LEAST + EACH * first.columns
    if first.chi2 / inflation < enough or first.rank < CLEAR * terms:
        return []
    return [cause for cause in others if cause.rank >= ALIKE * first.rank][:NAMED]


def _remark(beside: ResidualNoise, found: Sequence[Cause]) -> Finding:
    """What stands beside the headline where no single error is to blame."""
    likely = [cause for cause in found if cause.share >= SHARE][:NAMED]
    says = f"{_residuals(beside)}: the model lacks something, and intervals do not cover it"
    if likely:
        named = (f"{cause.says} {100.0 * cause.share:.0f} %" for cause in likely)
        says += f"; alone would explain of it: {', '.join(named)}"
    return Finding(ModelError.name, "", Judgement.OK, says, "", headline=True)


def _doubtful(
    case: FittedCase, beside: ResidualNoise, blamed: Sequence[Cause], total: float
) -> Finding:
    """An error that stands out; zero offsets with their values."""
    first = blamed[0]
    words = " or ".join(cause.says for cause in blamed)
    mend = Mend(ADVICE.get(first.kind, GEOMETRY))
    if first.kind == "zero_offset":
        offsets = offsets_of(case)
        found = far_offsets(offsets, case.identified.signals)
        if found.any():
            words, mend = numbers(offsets, found), correction(offsets, found)
    says = "they fit an error of the model that intervals do not cover"
    return Finding(
        ModelError.name,
        "",
        Judgement.DOUBTFUL,
        f"{_residuals(beside)}: {says}, {words}",
        f"{100.0 * first.chi2 / total:.2g} % of chi²",
        joints=tuple(j for j in beside.joints if j == first.joint),
        mend=mend,
    )


def _residuals(beside: ResidualNoise) -> str:
    """The worst joint's residual in measurement noise."""
    if not np.isfinite(beside.ratios).any():
        return "residuals are not noise"
    worst = int(np.nanargmax(beside.ratios))
    ratio = float(beside.ratios[worst])
    times = f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"
    return f"residuals are {times} x the measurement noise ({beside.joints[worst]})"


def offsets_of(case: FittedCase) -> ZeroOffsets:
    """Zero offsets of all joints, from the fitted runs."""
    model, rests = case.identified.model, remembers(case.identified.model.terms)
    return find_offsets(
        model,
        lambda offsets: said_by(with_offsets(case.fitted, offsets), rests=rests),
        given_offsets(case.identified.signals),
        [True] * model.robot.n,
    )


def given_offsets(signals: Signals) -> Array:
    """The offsets that logs were read with, shape `(n,)`."""
    given = signals.position_offset
    return np.zeros(signals.n) if given is None else given.copy()


def far_offsets(offsets: ZeroOffsets, signals: Signals) -> NDArray[np.bool_]:
    """Which offsets differ clearly from those that are given, shape `(n,)`."""
    spread = np.nan_to_num(offsets.std, nan=np.inf)
    far = np.abs(offsets.values - given_offsets(signals)) > BEYOND * spread
    return np.asarray(far & offsets.converged)


def numbers(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> str:
    """Like `zero offset of elbow 0.4992 ± 0.0008 rad`."""
    parts = [
        f"{offsets.joints[k]} {offsets.values[k]:.4f} ± {offsets.half_width[k]:.4f} "
        f"{offsets.units[k]}"
        for k in np.flatnonzero(chosen)
    ]
    return f"zero offset of {', '.join(parts)}"


def correction(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> Mend:
    """The line of the robot file that corrects offsets; others stay as they are given."""
    values = [
        round(float(value), 4) if far else float(start)
        for value, start, far in zip(offsets.values, offsets.start, chosen, strict=True)
    ]
    says = f'Set position_offset = {values} in [signals], or position_offset = "identify"'
    return Mend(says, (Edit(("signals", "position_offset"), values),))
