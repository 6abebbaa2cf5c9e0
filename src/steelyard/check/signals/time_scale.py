r"""A clock that runs fast or slow, from positions and efforts alone.

Stamps that are $s$ times too late make velocities $1/s$ and accelerations $1/s^2$ of what they are.
Inertias and friction can make up for that, gravity cannot: first moments stand in its torque and,
through the links' lengths, in that of accelerations. So a fit identifies $s$ as it identifies the
size of gravity. The typical residual variance, in logarithms, is sought over $\ln s$.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from steelyard.base.errors import SteelyardError
from steelyard.check.case import Case, Evidence
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.identifiability import clean_runs, customary_model
from steelyard.check.signals.units import driven_joints, unit_reading
from steelyard.check.signals.velocity_agreement import (
    FEWEST_RATE_JOINTS,
    MOST_OFF,
    RATE_TOLERANCE,
    UNEVEN_RATE,
)
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.regressor import Regressor, base_regressor
from steelyard.estimate.least_squares.least_squares import WeightedLeastSquares
from steelyard.runs.run import BLOCK_SAMPLES, Block, Run

TRIED_SCALE = 0.05
"""Relative scale that is tried first to both sides."""
VARIANCE_FALL = 0.045
"""Fall of the logarithm of the variance there from which on others are tried."""
TRIED_SCALES = np.log([0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.25, 1.43, 1.67, 2.0])
SCALE_STEPS = (0.05, 0.015, 0.005)
"""Logarithms of the scale between the points of the parabolas that refine it."""
DOUBTFUL_SCALE_SHARE, WRONG_SCALE_SHARE, LEAST_SCALE_ERROR = 0.5, 0.9, 0.005
"""Share of the typical squared residual that a scale must explain to be doubtful, and wrong, and
its least distance from 1. Nine real robots have at most 0.04; a link that is 50 % longer than its
model 0.8, for its length stands in the torque of accelerations alone."""
SHARP_SCALE_STD = 0.01
"""Largest standard deviation of a scale [relative]: where no scale fits, the residual falls on."""
ROW_WEIGHT_ROUNDS = 10
"""Iterations of the rows' weights."""


@dataclass(frozen=True, eq=False)
class _Scaled(Run):
    """A run with time read in other seconds: the motion is so many times as fast."""

    factor: float = 1.0

    def blocks(self, size: int = BLOCK_SAMPLES) -> Iterator[Block]:
        """The blocks of the run with the faster motion."""
        for block in super().blocks(size):
            yield replace(block, dq=self.factor * block.dq, ddq=self.factor**2 * block.ddq)


class _Search:
    """Logarithm of the typical residual variance of one run, by scale of its clock."""

    def __init__(self, regressor: Regressor, run: Run) -> None:
        self._regressor, self._run = regressor, run
        self._known: dict[float, float] = {}
        self.samples = 1.0

    def __call__(self, x: float) -> float:
        if x not in self._known:
            values = {f.name: getattr(self._run, f.name) for f in fields(Run)}
            scaled = _Scaled(**values, factor=float(np.exp(x)))
            information = gather(self._regressor, scaled)
            fit = WeightedLeastSquares(rounds=ROW_WEIGHT_ROUNDS).fit(information)
            counts = information.n_samples
            self.samples = float(counts.sum())
            self._known[x] = float(counts @ np.log(fit.variances) / self.samples)
        return self._known[x]

    def best(self) -> tuple[float, float]:
        """The best logarithm of the scale, and its standard deviation."""
        x, std = min(TRIED_SCALES.tolist(), key=self), np.inf
        for step in SCALE_STEPS:
            x, std = self._parabola(x, step)
        return x, std

    def _parabola(self, x: float, step: float) -> tuple[float, float]:
        low, mid, high = (self(x + d) for d in (-step, 0.0, step))
        bend = (low - 2.0 * mid + high) / step**2
        if bend <= 0.0:
            return x, np.inf
        shift = float(np.clip(0.5 * (low - high) / step / bend, -step, step))
        return x + shift, float(np.sqrt(2.0 / (bend * self.samples)))


def time_scale(case: Case, name: str) -> Finding | None:
    """The scale of the clock that the longest log without velocities suggests, if it is not 1."""
    runs = [
        (e.run.duration, k)
        for k, e in enumerate(case.logs)
        if isinstance(e.run, Run) and np.count_nonzero(driven_joints(case, e)) >= FEWEST_RATE_JOINTS
    ]
    signals = case.loaded.signals
    if not runs or signals is None or signals.velocity is not None:
        return None
    evidence = case.logs[max(runs)[1]]
    try:
        (run,) = clean_runs(replace(case, logs=(evidence,)))
        search = _Search(base_regressor(customary_model(case)), run)
        if min(search(TRIED_SCALE), search(-TRIED_SCALE)) > search(0.0) - VARIANCE_FALL:
            return None
        x, std = search.best()
        gone = 1.0 - float(np.exp(search(x) - search(0.0)))
    except (SteelyardError, TypeError):
        return None
    if (
        gone < DOUBTFUL_SCALE_SHARE
        or std > SHARP_SCALE_STD
        or abs(x) < max(LEAST_SCALE_ERROR, 4.0 * std)
    ):
        return None
    return _scale_error(evidence.name, name, x, std, gone)


def _scale_error(log: str, name: str, x: float, std: float, gone: float) -> Finding:
    scale, half = float(np.exp(x)), 2.0 * std * float(np.exp(x))
    sure, way = gone >= WRONG_SCALE_SHARE, "slow" if scale < 1.0 else "fast"
    other = "" if sure else ", or a length in the model file is wrong"
    return Finding(
        name,
        "",
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"the clock runs {way}{other}: by a fit of {log} time stamps are {scale:.4g} ± "
        f"{half:.1g} times "
        "the true time, as only then accelerations and gravity give the same inertial parameters",
        f"this explains {100.0 * gone:.0f} % of the squared residual; doubtful from "
        f"{100.0 * DOUBTFUL_SCALE_SHARE:.0f} % on, wrong from {100.0 * WRONG_SCALE_SHARE:.0f} % on",
        fix=Fix(
            f"check the log's rate; divide the stamps by {scale:.4g} if it is so. If the clock is "
            "right, check gravity and lengths in the model file"
        ),
    )


def time_scale_by_velocities(case: Case, evidence: Evidence, name: str) -> Finding | None:
    """The scale of the clock that logged velocities ask for, if all joints agree on one but 1."""
    units = unit_reading(case, evidence)
    if (
        units.agreement is None
        or np.count_nonzero(units.agreement.reliable_joints) < FEWEST_RATE_JOINTS
    ):
        return None
    ratio = np.array(
        [units.relative(int(j)) for j in np.flatnonzero(units.agreement.reliable_joints)]
    )
    scale, spread = float(np.mean(ratio)), float(np.ptp(ratio))
    if spread > UNEVEN_RATE or not RATE_TOLERANCE < abs(scale - 1.0) < MOST_OFF:
        return None
    way = "slow" if scale < 1.0 else "fast"
    return Finding(
        name,
        evidence.name,
        Severity.DOUBTFUL,
        f"velocities of all {len(ratio)} joints are {scale:.4g} times d(q)/dt: the clock runs "
        f"{way}, or their unit is off",
        f"{100.0 * abs(scale - 1.0):.2g} % from 1 (at most {100.0 * RATE_TOLERANCE:g} % "
        "allowed), joints "
        f"differ by {100.0 * spread:.1g} % (a clock: at most {100.0 * UNEVEN_RATE:g} %)",
        fix=Fix("check the log's rate, and leave velocities out if the clock is right"),
    )
