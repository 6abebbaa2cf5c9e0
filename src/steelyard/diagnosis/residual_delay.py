r"""A delay of efforts that the residuals of a fit show, without a model of the robot.

Each effort row is fitted by least squares of its own at three delays; the sum of squares that is
left is a parabola of the delay, $S_j(d) = S_j + b_j d + \kappa_j d^2$. Logs that are late have the
same minimum in all joints, and most of the residual is gone there. Friction that gives way before
it slips looks late as well, mostly by another time in every joint; where the times agree, the delay
has to explain more than presliding friction of any length does.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Fix, Severity
from steelyard.diagnosis.hypotheses.by_friction import LENGTHS
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.errors import SteelyardError
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.gather import gather
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor, base_regressor
from steelyard.terms.laws.presliding import MaxwellSlip

SHIFT = 0.008
"""Delay that is tried to both sides [s]."""
SINGULAR = 1e-9
"""Eigenvalue of a row's normalised Gram matrix, over the largest, that counts as zero."""
LEAST, SURE = 1e-3, 4.0
"""Least delay [s], also in standard errors."""
ALIKE = 0.15
"""Scatter of the joints' delays over their mean, up to which they are one delay. Logs of nine real
robots, whose friction looks late, have 0.3 and more; delays put into simulated logs up to 0.1."""
GONE = 0.5
"""Share of the typical squared residual that a delay must explain."""
FEWEST = 2
"""Joints that must agree."""
RENEWED, ROUGH, FARTHEST = 3, 0.5, 0.05
"""How often the delay is found anew around the last one, from which scatter on it is not, and how
far it may be [s]."""


@dataclass(frozen=True, eq=False)
class Delays:
    """What the rows of one run say of the delay.

    Attributes:
        delay: Of all rows together [s].
        std: Its standard error [s].
        spread: Of the rows' delays around it [s].
        gone: Share of the typical squared residual that it explains.
        rows: How many rows are used.
    """

    delay: float
    std: float
    spread: float
    gone: float
    rows: int

    @property
    def scatter(self) -> float:
        """Of the rows' delays, over the delay of all."""
        return self.spread / max(abs(self.delay), 1e-12)

    def alike(self, scatter: float) -> bool:
        """Whether all rows are late, or early, by one time that explains most of the residual."""
        return (
            self.rows >= FEWEST
            and max(LEAST, SURE * self.std) <= abs(self.delay)
            and self.scatter <= scatter
            and self.gone >= GONE
        )


def residual_delay(case: Case, name: str) -> Finding | None:
    """The delay that the longest log shows, for all logs together; `None` if it shows none.

    A log with gaps is not looked at: what filters leave beside a gap may look late.

    Args:
        case: Robot and logs.
        name: Name of the check.
    """
    runs = [(e.run.duration, k) for k, e in enumerate(case.logs) if isinstance(e.run, Run)]
    if not runs:
        return None
    evidence = case.logs[max(runs)[1]]
    try:
        (run,) = clean_runs(replace(case, logs=(evidence,)))
        if len(run.segments) > 1:
            return None
        model = customary_model(case)
        regressor = base_regressor(model)
        found = delays_of(regressor, run)
        for _ in range(RENEWED if found.alike(ROUGH) else 0):
            more = float(np.clip(found.delay, -FARTHEST, FARTHEST))
            rest = delays_of(regressor, _later(run, more))
            found = replace(rest, delay=more + rest.delay, gone=found.gone)
        if not found.alike(ALIKE) or by_presliding(model, regressor, run) >= found.gone:
            return None
    except (SteelyardError, TypeError):
        return None
    return _late(evidence, name, found)


def by_presliding(model: Model, regressor: Regressor, run: Run) -> float:
    """Share of the typical squared residual that presliding friction explains.

    Raises:
        SteelyardError: The run cannot be fitted.
    """
    presliding = MaxwellSlip(lengths=LENGTHS, relaxing=True)
    with_it = base_regressor(Model(model.robot, (*model.terms, presliding)))
    before, after = (
        left / np.maximum(freedom, 1.0)
        for left, freedom in (_squares(gather(r, run)) for r in (regressor, with_it))
    )
    known = (before > 0.0) & (after > 0.0)
    return (
        1.0 - float(np.exp(np.mean(np.log(after[known] / before[known])))) if known.any() else 0.0
    )


def _late(evidence: Evidence, name: str, found: Delays) -> Finding:
    ms = 1e3 * found.delay
    whole = evidence.recording.signals.effort_delay + found.delay
    way = "late" if ms > 0.0 else "early"
    return Finding(
        name,
        "",
        Severity.WRONG,
        f"efforts are {abs(ms):.3g} ms {way} (± {2e3 * found.std:.1g}): the residuals of a fit of "
        f"{evidence.name} indicate this delay in all {found.rows} joints",
        f"a delay explains {100.0 * found.gone:.0f} % of the squared residual (at "
        f"least {100.0 * GONE:.0f} % required), joints differ by {100.0 * found.scatter:.1g} % (at "
        f"most {100.0 * ALIKE:.0f} % allowed)",
        fix=Fix(
            f"efforts are {abs(ms):.3g} ms {way}: state the delay",
            (Edit(("signals", "effort", "delay"), round(whole, 5)),),
        ),
    )


def delays_of(regressor: Regressor, run: Run) -> Delays:
    """What the residuals of least squares, row by row, say of the delay.

    Raises:
        SteelyardError: The run cannot be fitted.
    """
    early, now, late = (_squares(gather(regressor, _later(run, d))) for d in (-SHIFT, 0.0, SHIFT))
    slope, bend = (late - early)[0] / (2.0 * SHIFT), (late - 2.0 * now + early)[0] / (2 * SHIFT**2)
    left, freedom = now
    usable = (bend > 0.0) & (freedom >= 10.0) & (left > 0.0)
    if not usable.any():
        return Delays(0.0, np.inf, np.inf, 0.0, 0)
    slope, bend, left, freedom = (x[usable] for x in (slope, bend, left, freedom))
    own = -slope / (2.0 * bend)
    weights = bend * freedom / left
    delay = float(weights @ own / weights.sum())
    spread = np.sqrt(weights @ np.square(own - delay) / weights.sum())
    after = np.clip((left + slope * delay + bend * delay**2) / left, 1e-3, None)
    std = 1.0 / np.sqrt(np.sum(weights / np.minimum(after, 1.0)))
    gone = 1.0 - float(np.exp(np.mean(np.log(after))))
    return Delays(delay, float(std), float(spread), gone, int(usable.sum()))


def _later(run: Run, delay: float) -> Run:
    """The run with a delay taken out of its efforts, beside what is declared."""
    signals = run.recording.signals
    changed = replace(signals, effort_delay=signals.effort_delay + delay)
    return replace(run, recording=replace(run.recording, signals=changed))


def _squares(information: Information) -> Array:
    """Squares that each row's own least squares leave, and degrees of freedom, `(2, rows)`."""
    found = []
    for row in range(len(information.layout.rows)):
        gram = information.row_gram(row)
        lengths = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
        values, vectors = np.linalg.eigh(gram[:-1, :-1] / lengths[:, None] / lengths)
        kept = values > SINGULAR * values.max()
        along = vectors[:, kept].T @ (gram[:-1, -1] / lengths)
        left = float(gram[-1, -1] - np.sum(np.square(along) / values[kept]))
        found.append((left, float(information.n_samples[row] - kept.sum())))
    return np.array(found).T
