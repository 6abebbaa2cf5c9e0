"""Whether the fitted runs are of one robot: bodies fitted run by run, against those of all runs.

Friction and offsets differ from day to day and are fitted to every run by itself in both. Bodies do
not: where those of each run by itself leave clearly less than those of all runs together, runs are
of two robots, or one carried a load. A load adds the ten numbers of a body at the last link, in
that run alone; where these bring residuals down to those of the runs by themselves, it is a load.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.errors import DataError
from steelyard.estimation.estimate import Z95
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.payload.load_case import carrier, drifting, load_case
from steelyard.regression.information import Information

APART = 2.0
"""Residual of common bodies over that of each run's own from which on runs disagree, root mean
square over joints: 1.02 on seven runs of the UR10e over two weeks, 14 of an arm whose bodies differ
by a fifth from the other's."""

EXPLAINED = 1.3
"""The same with a load in one run, up to which the load explains the disagreement."""


class RunsDisagree:
    """Runs of two robots, or of one with and without a load, in one fit."""

    name: ClassVar[str] = "runs"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding if bodies differ; none for a single run and in `validate`."""
        runs = () if case.information is None else runs_of(case.information)
        if len(runs) < 2:
            return ()
        try:
            own = own_variances(runs)
            times = apart(case.identified, runs, own)
            return () if times < APART else (_finding(case.identified, runs, own, times),)
        except DataError:
            return ()


def runs_of(information: Information) -> tuple[Information, ...]:
    """One piece of information per run."""
    groups: dict[str, list[int]] = {}
    for number, window in enumerate(information.windows):
        groups.setdefault(window.run, []).append(number)
    return tuple(information.of(group) for group in groups.values())


def own_variances(runs: Sequence[Information]) -> Array:
    """Residual variances of runs fitted by themselves, shape `(runs, rows)`."""
    return np.array([WeightedLeastSquares().fit(run).variances for run in runs])


def apart(identified: IdentifiedModel, runs: Sequence[Information], own: Array) -> float:
    """Residual of common bodies over that of each run's own, root mean square over rows."""
    whole = runs[0]
    for run in runs[1:]:
        whole = whole + run
    columns = whole.layout.columns
    free = tuple(columns[k] for k in drifting(identified.model, columns))
    return _times(WeightedLeastSquares(per_run=free).fit(whole).variances, runs, own)


def _times(variances: Array, runs: Sequence[Information], own: Array) -> float:
    counts = np.array([run.n_samples for run in runs])
    separate = np.sum(counts * own, axis=0) / np.maximum(counts.sum(axis=0), 1e-300)
    return float(np.sqrt(np.mean((variances / np.maximum(separate, 1e-300))[separate > 0.0])))


def _finding(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, times: float
) -> Finding:
    """The load in one run that explains it, or else that the robots differ."""
    figure = f"a common fit has {times:.1f} times the residuals of separate fits"
    loads = [_load(identified, runs, own, number) for number in range(len(runs))]
    left, mass, half, name = min(loads)
    if left <= EXPLAINED:
        others = "the other run does" if len(runs) == 2 else "the other runs do"
        return Finding(
            RunsDisagree.name,
            name,
            Severity.WRONG,
            f"it carries a payload of {mass:.3g} ± {half:.1g} kg that {others} not: the model is "
            "valid neither with nor without it",
            figure,
            fix=Fix("Leave this log out, or give it as --loaded"),
        )
    return Finding(
        RunsDisagree.name,
        "",
        Severity.WRONG,
        "these logs are of two robots, or the robot was modified: the link inertias of "
        f"{_odd(identified, runs, own)}",
        figure,
        fix=Fix("Identify each robot separately"),
    )


def _load(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, number: int
) -> tuple[float, float, float, str]:
    """What a load in one run leaves, its mass and half-width [kg], and the run's name."""
    name = runs[number].windows[0].run
    others = [run for k, run in enumerate(runs) if k != number]
    model = identified.model
    if not others[0].windows or "m." + model.robot.bodies[-1].name not in identified.base.names:
        return np.inf, 0.0, 0.0, name
    frame = carrier(model.robot)
    case = load_case(
        model, identified.base, frame, others, [runs[number]], first_deviates=False
    ).information
    fit = WeightedLeastSquares()
    known = fit(case)
    values = known.parameters.as_dict()
    mass = values.get("m.payload", -np.inf)
    if mass <= 0.0:
        return np.inf, 0.0, 0.0, name
    spread = dict(zip(known.parameters.names, known.std.tolist(), strict=True))["m.payload"]
    left = _times(np.square(known.sigma), runs, own)
    return left, mass, Z95 * spread, name


def _odd(identified: IdentifiedModel, runs: Sequence[Information], own: Array) -> str:
    """Whose bodies differ: those of the run without which the others agree, or all."""
    names = [run.windows[0].run for run in runs]
    if len(runs) > 2:
        left = []
        for number in range(len(runs)):
            kept = [k for k in range(len(runs)) if k != number]
            left.append(apart(identified, [runs[k] for k in kept], own[kept]))
        if min(left) < APART:
            return f"{names[int(np.argmin(left))]} differ from the others'"
    return f"{' and '.join(names)} differ"
