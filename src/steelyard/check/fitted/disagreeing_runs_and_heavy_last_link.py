"""Runs whose bodies disagree, and a last link too heavy: loads that were not declared.

Friction and offsets differ from day to day and are fitted to every run by itself in both. Bodies do
not: where those of each run by itself leave clearly less than those of all runs together, runs are
of two robots, or one carried a load. A load adds the ten numbers of a body at the last link, in
that run alone; where these bring residuals down to those of the runs by themselves, it is a load.

All logs of a loaded robot agree with each other, and their model predicts them all; only what is
known of the links beforehand can show the load. A model file's masses are often wrong, and often
all of them alike: the last link is therefore compared with the others.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError
from steelyard.check.case_logs_and_checks import case_check
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.fitted_case_and_ranked_causes import FittedCase
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.payload.runs_with_payload import carrier, drifting, load_case

DISAGREEING_RESIDUAL = 2.0
"""Residual of common bodies over that of each run's own from which on runs disagree, root mean
square over joints: 1.02 on seven runs of the UR10e over two weeks, 14 of an arm whose bodies differ
by a fifth from the other's."""
EXPLAINED_BY_LOAD = 1.3  # the same with a load in one run that explains it


@case_check("runs")
def runs_disagree_check(case: FittedCase) -> Iterable[Finding]:
    """Runs of two robots, or of one with and without a load, in one fit."""
    whole = case.information
    if whole is None or len(whole.windows_of_runs) < 2:
        return ()
    try:
        runs = [whole.of(group) for group in whole.windows_of_runs.values()]
        own = np.array([WeightedLeastSquares().fit(run).variances for run in runs])
        times = residual_of_common_bodies(case.identified, runs, own)
        if times < DISAGREEING_RESIDUAL:
            return ()
        return (_disagreement_finding(case.identified, runs, own, times),)
    except DataError:
        return ()


def residual_of_common_bodies(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array
) -> float:
    """Residual of common bodies over that of each run's own, root mean square over rows.

    The residual variances of runs by themselves, `own`, have the shape `(runs, rows)`.
    """
    whole = reduce(add, runs)
    columns = whole.layout.columns
    free = tuple(columns[k] for k in drifting(identified.model, columns))
    return _times(WeightedLeastSquares(per_run=free).fit(whole).variances, runs, own)


def _times(variances: Array, runs: Sequence[Information], own: Array) -> float:
    counts = np.array([run.n_samples for run in runs])
    separate = np.sum(counts * own, axis=0) / np.maximum(counts.sum(axis=0), 1e-300)
    return float(np.sqrt(np.mean((variances / np.maximum(separate, 1e-300))[separate > 0.0])))


def _disagreement_finding(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, times: float
) -> Finding:
    """The load in one run that explains it, or else that the robots differ."""
    figure = f"a common fit has {times:.1f} times the residuals of separate fits"
    loads = [_load_in_one_run(identified, runs, own, number) for number in range(len(runs))]
    left, mass, half, name = min(loads)
    if left <= EXPLAINED_BY_LOAD:
        others = "the other run does" if len(runs) == 2 else "the other runs do"
        return Finding.wrong(
            f"it carries a payload of {mass:.3g} ± {half:.1g} kg that {others} not: the model is "
            "valid neither with nor without it",
            figure,
            fix=Fix("Leave this log out, or give it as --loaded"),
            log=name,
        )
    # whose bodies differ: those of the run without which the others agree, or all
    names = [run.runs for run in runs]
    who = f"{' and '.join(names)} differ"
    if len(runs) > 2:
        kept = [[k for k in range(len(runs)) if k != number] for number in range(len(runs))]
        rests = [residual_of_common_bodies(identified, [runs[k] for k in x], own[x]) for x in kept]
        if min(rests) < DISAGREEING_RESIDUAL:
            who = f"{names[int(np.argmin(rests))]} differ from the others'"
    return Finding.wrong(
        f"these logs are of two robots, or the robot was modified: the link inertias of {who}",
        figure,
        fix=Fix("Identify each robot separately"),
    )


def _load_in_one_run(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, number: int
) -> tuple[float, float, float, str]:
    """What a load in one run leaves, its mass and half-width [kg], and the run's name."""
    name = runs[number].runs
    others, model = [run for k, run in enumerate(runs) if k != number], identified.model
    if not others[0].windows or "m." + model.robot.bodies[-1].name not in identified.base.names:
        return np.inf, 0.0, 0.0, name
    frame, loaded = carrier(model.robot), [runs[number]]
    case = load_case(model, identified.base, frame, others, loaded, first_deviates=False)
    known = WeightedLeastSquares()(case.information)
    mass = known.parameters.as_dict().get("m.payload", -np.inf)
    if mass <= 0.0:
        return np.inf, 0.0, 0.0, name
    spread = dict(zip(known.parameters.names, known.std.tolist(), strict=True))["m.payload"]
    return _times(np.square(known.sigma), runs, own), mass, Z95 * spread, name


HEAVIER_LAST_LINK = 2.0
"""Mass over the model file's, relative to the median of the other links, from which on it is
reported. Links that are invented off by a quarter reach 1.5."""
KNOWN_MASS_SHARE = 0.5  # of a mass's knowledge that must come from the data


@case_check("last link")
def last_link_check(case: FittedCase) -> Iterable[Finding]:
    """A last link far heavier than the model file says, in fitted runs that agree, with masses."""
    standard, bodies = case.identified.estimate.standard, case.identified.model.robot.bodies
    if not case.fitted or standard is None:
        return
    # mass, standard deviation and the model file's mass of links that the data identify [kg]
    masses: dict[str, tuple[float, float, float]] = {}
    place = {name: k for k, name in enumerate(standard.parameters.names)}
    for body in bodies:
        k, nominal = place.get(f"m.{body.name}"), body.inertia.mass
        if k is None or not body.known or nominal <= 0.0 or standard.learned[k] < KNOWN_MASS_SHARE:
            continue
        values = float(standard.parameters.values[k]), float(standard.std[k])
        masses[body.name] = (*values, nominal)
    link = bodies[-1].name
    found = masses.pop(link, None)
    if found is None or not masses:
        return
    mass, std, nominal = found
    usual = float(np.median([one / known for one, _, known in masses.values()]))
    least, half = max(usual, 1.0) * nominal, Z95 * std
    if mass < HEAVIER_LAST_LINK * least or mass - half < least or runs_disagree_check(case):
        return
    yield Finding.doubtful(
        f"the last link ({link}) is estimated {mass - nominal:.2g} kg heavier than in the model "
        "file: the robot carries a payload or tool in all logs, or the model file is wrong",
        f"{mass:.3g} ± {half:.2g} kg for {nominal:.3g} kg, {mass / nominal:.1f} times, the other "
        f"links {usual:.1f} times",
        fix=Fix("Log without the load, or add the tool to the model file"),
    )


FINE_WINDOW = 0.25  # length of the windows that give its start and end [s]
