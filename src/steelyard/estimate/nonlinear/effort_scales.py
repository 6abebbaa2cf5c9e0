r"""A scale of each joint's logged efforts: estimated, and taken where it predicts better.

Sensors and published drive gains are off by some percent, those of wrists by more. Bodies are
shared by the rows of all joints, so rows whose scales differ contradict each other:
$y_j = s_j\,A_j\phi$. A Gauss-Newton step estimates $\phi$ and $w_j = \ln s_j$ together, at scales
$\bar s$ and parameters $\bar\phi$ that were reached, as a convex program over the efforts
$y_j / \bar s_j + \ln\bar s_j\,A_j\bar\phi$ with the column $A_j\bar\phi$ beside those of row $j$,
where $w_j$ has the standard deviation that is known of it.

What all scales have in common cannot be told from heavier links: only priors decide it. Most gains
agree, and a wrong one may be off by any factor, so $w_j$ has a prior of a heavy tail, $p(w) \propto
(1 + w^2 / (4 d^2))^{-2}$ (Student's t of three degrees of freedom), with the scatter $d$ of most
joints around their median. At every step it is a normal one of the variance $d^2 + w^2 / 4$ at the
$w$ that was reached [Lange1989]. So few joints differ, by what they are off: one that is off by a
factor of two does not pull all others.

They ask where all scales being 1 is further from the estimate than chance explains: that tells
scales from chance. Whether they serve is judged by leaving one run out, one stretch of a single
run: scales are found without it, and its efforts predicted, in both cases with the weight of the
prior that all data give. Found anew for each part, that weight scatters more than the gain.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.consistent.convex_estimator import Consistent, root_of_inverse
from steelyard.estimate.estimate import Estimate, KnownScales
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.normal_equations import condition_of, unit_length
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened
from steelyard.estimate.scores import cross_validation

DEVIATION = (0.02, 0.1)  # least and greatest $d$, the greatest where no scale is known
NORMAL_MEDIAN = 0.6745  # median size of a standard normal variable
ROUNDS = 12  # most Gauss-Newton steps
LONGEST = 0.5  # longest step of a logarithm
TOLERANCE = 1e-3  # step of a logarithm at which the search has converged

LAW = "effort_scale"


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales and what they were found with."""

    values: Array  # logged effort over that of the model, `(rows,)`
    covariance: Array  # of their logarithms, `(rows, rows)`
    parameters: Array  # of the information's columns, `(p,)`
    gamma: float  # weight of the prior of the bodies
    standard: Array  # all standard parameters, then the logarithms of the scales

    @property
    def std(self) -> Array:
        """Standard deviations of the logarithms, shape `(rows,)`."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def deviation(self) -> float:
        """$d$: robust standard deviation of the logarithms around their median, within bounds."""
        logs = np.log(self.values)
        if not logs.any():
            return DEVIATION[1]
        scatter = float(np.median(np.abs(logs - np.median(logs)))) / NORMAL_MEDIAN
        return float(np.clip(scatter, *DEVIATION))

    @property
    def before(self) -> str:
        """How well a scale is known without the data, for people to read."""
        return f"known a priori to ± {100.0 * Z95 * self.deviation:.0f} %, the scatter of most"

    @property
    def prior_std(self) -> Array:
        """Standard deviations of the logarithms before the data, at these, shape `(rows,)`."""
        return np.asarray(np.sqrt(self.deviation**2 + 0.25 * np.square(np.log(self.values))))

    @property
    def distance(self) -> float:
        """Squared distance of all logarithms from zero, in what is left open of them."""
        logs = np.log(self.values)
        return float(logs @ np.linalg.solve(self.covariance, logs))


@dataclass(frozen=True, eq=False)
class Scaled:
    """The consistent estimate with a scale of each row's efforts."""

    estimator: Consistent
    rows: tuple[str, ...]

    def unscaled(self, information: Information, gamma: float | None = None) -> Scales:
        """All scales 1, with a weight of the prior; of that which the estimate finds, if `None`."""
        values, gamma, standard = self.estimator.values(information, gamma)
        n = len(self.rows)
        standard = np.concatenate([standard, np.zeros(n)])
        return Scales(np.ones(n), DEVIATION[1] ** 2 * np.eye(n), values, gamma, standard)

    def step(self, information: Information, at: Scales, *, weigh: bool = False) -> Scales:
        """One Gauss-Newton step from scales and parameters that were reached, efforts as logged.

        `weigh` finds the weight of the prior anew. Raises as the estimate does.
        """
        wide, gamma = self._wide(at), at.gamma
        data = whitened(self._extended(information, at), equal=wide.equal)
        program = wide.program(data)
        if weigh:
            tried = wide.weighed(data, program)
            u, gamma = tried.u, tried.gamma
        else:
            u = wide.solve(program, gamma, program.unknowns.of_standard(at.standard))
        standard = program.unknowns.standard(u)
        logs, before = standard[-len(self.rows) :], np.log(at.values)
        logs = before + np.clip(logs - before, -LONGEST, LONGEST)
        precision = program.stated_precision(u, gamma)
        precision += program.unknowns.matrix.T @ program.unknowns.matrix
        n, columns = len(self.rows), information.layout.columns
        root = at.prior_std[:, None] * root_of_inverse(precision)[-n:]
        values = self.estimator.base.values_of(columns, standard[:-n])
        return Scales(np.exp(logs), root @ root.T, values, gamma, standard)

    def converged(self, information: Information, at: Scales, *, weigh: bool = False) -> Scales:
        """Steps until the scales stand still; arguments and errors as of `step`.

        The weight is found when they do, and once more when they do with it.
        """
        weighing = False
        for _ in range(ROUNDS):
            found = self.step(information, at, weigh=weighing)
            steady = np.abs(np.log(found.values / at.values)).max() < TOLERANCE
            at = found
            if steady and (weighing or not weigh):
                break
            weighing = weigh and steady
        return at

    def estimate(self, information: Information, scales: Scales) -> Estimate:
        """The estimate of efforts in the model's scale, as unsure as the scales make it.

        Efforts of the information are already divided by the scales. The weight of the prior is
        that they were found with: with another one they would be others. Condition numbers are
        those of the parameters, without the scales.
        """
        logged = information.scaled(scales.values, information.signature.effort)
        wide = replace(self._wide(scales), gamma=scales.gamma or None)
        found = wide(self._extended(logged, scales))
        standard = None if found.standard is None else found.standard.without(self._names)
        own = whitened(information, equal=self.estimator.equal).fit
        return replace(
            found.without(self._names),
            standard=standard,
            condition=condition_of(own.normal),
            condition_normalised=condition_of(unit_length(own.normal)[0]),
        )

    def _extended(self, information: Information, at: Scales) -> Information:
        scaled = information.scaled(1.0 / at.values, information.signature.effort)
        return scaled.with_predicted(at.parameters, self._names, np.log(at.values))

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"{LAW}.{row}" for row in self.rows)

    def _wide(self, at: Scales) -> Consistent:
        """The estimator over the scales' logarithms beside all parameters."""
        known, names, stds = self.estimator.knowledge, self._names, at.prior_std.tolist()
        n = len(names)
        knowledge = replace(
            known,
            names=(*known.names, *names),
            lower=np.append(known.lower, np.full(n, -np.inf)),
            upper=np.append(known.upper, np.full(n, np.inf)),
            deviations={**known.deviations, **dict(zip(names, stds, strict=True))},
        )
        base = self.estimator.base.beside(names, ["1"] * n)
        return replace(self.estimator, base=base, knowledge=knowledge)


CHANCE = 1e-3  # probability of a distance as great or greater at which the data ask for scales


@dataclass(frozen=True, eq=False)
class EffortScales:
    """Scales of the logged efforts, estimated together with the parameters."""

    joints: tuple[str, ...]
    found: Scales
    # relative error on what was left out, mean over parts: the geometric mean of a typical joint's
    # and of all joints' together [%]
    error: float
    without: float  # the same with all scales 1 [%]
    scaled: Scaled  # estimates with scales

    @property
    def known(self) -> KnownScales:
        """What an identified model keeps of them."""
        return KnownScales(self.joints, frozen(self.found.values), frozen(self.found.covariance))

    @property
    def note(self) -> str:
        """Scales with their intervals and what they gain, for people to read."""
        values = zip(self.joints, self.found.values, self.known.half_width, strict=True)
        listed = ", ".join(f"{joint} {x:.2f} ± {half:.2f}" for joint, x, half in values)
        return (
            "a scale of the efforts is estimated per joint (logged over model, "
            f"{self.found.before}): {listed}; error on left-out motion {self.error:.3g} % instead "
            f"of {self.without:.3g} %; masses are as uncertain as the scales; "
            'effort_scales = "off" in [estimation] keeps the given gains'
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "joints": list(self.joints),
            "values": self.found.values.tolist(),
            "half_width": self.known.half_width.tolist(),
            "left_out_error_percent": self.error,
            "left_out_error_without_percent": self.without,
        }


def effort_scales(
    estimator: Consistent, information: Information, *, progress: Progress = silent
) -> EffortScales | None:
    """Scales, where data in the model's units ask for them and predict better; or `None`."""
    scaled = Scaled(estimator, information.layout.rows)
    try:
        start = scaled.unscaled(information)
        first = scaled.step(information, start)
        if not _significant(first):
            return None
        found = scaled.converged(information, first, weigh=True)
    except DataError:
        return None
    if not _significant(found):
        return None
    folds = information.grouped(cross_validation.windows_of_folds(information))
    errors = []
    for fold in range(len(folds.windows)):
        report_progress(progress, "judging effort scales", fold, len(folds.windows))
        rest = folds.of([k for k in range(len(folds.windows)) if k != fold])
        left_out = folds.of([fold])
        try:
            plain = scaled.unscaled(rest, start.gamma)
            with_scales = scaled.converged(rest, found)
        except DataError:
            continue
        sizes, two = left_out.effort_squares(), []
        for scales in (plain, with_scales):  # efforts as logged
            logged = left_out.scaled(1.0 / scales.values, left_out.signature.effort)
            shares = logged.relative_errors(scales.parameters)
            two.append(float(cross_validation.logarithms(shares[None], sizes[None])[0]))
        errors.append(two)
    if len(errors) < cross_validation.FEWEST:
        return None
    plain_errors, scaled_errors = np.array(errors).T
    if (plain_errors - scaled_errors).mean() <= cross_validation.LEAST_GAIN_PER_PARAMETER:
        return None
    mean = np.exp([scaled_errors.mean(), plain_errors.mean()])
    return EffortScales(information.layout.rows, found, float(mean[0]), float(mean[1]), scaled)


def _significant(scales: Scales) -> bool:
    """Whether scales of 1 are further away than chance explains."""
    from scipy.special import chdtrc

    return bool(chdtrc(len(scales.values), scales.distance) < CHANCE)
