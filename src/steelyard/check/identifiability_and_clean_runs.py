"""Which parameters logs together identify; their clean runs, and the model that is customary."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import reduce
from operator import add

from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, CheckedLog, case_check
from steelyard.check.finding import Finding, Fix
from steelyard.estimate.estimate import Unidentifiable
from steelyard.estimate.information.base_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.register import DEFAULT_TERMS, law_of, term_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.runs.prepare import prepare
from steelyard.runs.run import Run

SHOWN_PARAMETERS = 6
HELPFUL_MOTION = {
    "m": "other configurations of the joints before",
    "mx": "other configurations of the joints up to",
    "my": "other configurations of the joints up to",
    "mz": "other configurations of the joints up to",
}
"""What shows mass and first moments of a body; other parameters, what their laws say."""


@case_check("identifiability", "What can be identified from these logs?", quick=False)
def identifiability_check(case: Case) -> Iterable[Finding]:
    """Parameters that no log shows; nothing where no run can be made of the logs."""
    runs = clean_runs(case)
    if not runs:
        return
    try:
        regressor = base_regressor(customary_model(case))
        estimate = WeightedLeastSquares()(reduce(add, [gather(regressor, r) for r in runs]))
    except SteelyardError as error:
        yield Finding.doubtful(f"undecided: {error.wrong}", "none", fix=Fix(error.fix))
        return
    left_open = case.loaded.friction and case.reference is None
    of = " (of the model with Coulomb and viscous friction)" if left_open else ""
    seen, blind = len(estimate.parameters.names), estimate.blind
    whole = seen + len(blind)
    says = f"the motion makes {seen} of {whole} base parameters{of} identifiable"
    figure = f"{seen} of {whole}, condition number {estimate.condition_normalised:.3g} (normalised)"
    if blind:
        listed = ", ".join(b.name for b in blind[:SHOWN_PARAMETERS])
        says += f"; not {listed}" + (" and more" if len(blind) > SHOWN_PARAMETERS else "")
        yield Finding.doubtful(says, figure, fix=Fix(_advice(blind)))
    else:
        says += "; how accurately they are identified depends on the noise"
        yield Finding.ok(says, figure)


def _advice(blind: Sequence[Unidentifiable]) -> str:
    wanted: dict[str, list[str]] = {}
    for parameter in blind:
        kind, _, of = parameter.name.partition(".")
        wanted.setdefault(HELPFUL_MOTION.get(kind, law_of(parameter.name).shown_by), []).append(of)
    parts = [f"{help_} {', '.join(dict.fromkeys(names))}" for help_, names in wanted.items()]
    return f"additional motion:  {'; '.join(parts)}"


def clean_runs(case: Case) -> list[Run]:
    """Clean runs of the logs, with common cut-offs; logs that cannot be read are left out."""
    runs = [(e, e.run) for e in case.logs if isinstance(e.run, Run)]
    if not runs:
        return []
    motion = max(run.motion_cutoff for _, run in runs)
    matched = max(run.matched_cutoff for _, run in runs)
    common = []
    for number, (log, run) in enumerate(runs):
        processing = replace(log.processing, motion_cutoff=motion, matched_cutoff=matched)
        if (run.motion_cutoff, run.matched_cutoff) != (motion, matched):
            try:
                run = prepare(log.recording, processing)
            except SteelyardError:
                continue
        common.append(replace(run, name=f"{number} {run.name}"))
    return common


def longest_run(
    case: Case, of: Callable[[CheckedLog], bool] = bool
) -> tuple[CheckedLog, Run] | None:
    """The log with the longest clean run of those that something holds for, and that run."""
    runs = [
        (e.run.duration, k) for k, e in enumerate(case.logs) if isinstance(e.run, Run) and of(e)
    ]
    if not runs:
        return None
    log = case.logs[max(runs)[1]]
    (run,) = clean_runs(replace(case, logs=(log,)))
    return log, run


def customary_model(case: Case) -> Model:
    """The model that is to be identified; Coulomb and viscous friction where that is left open."""
    if case.reference is not None:
        return case.reference.model
    loaded = case.loaded
    if loaded.terms is None:
        behind = loaded.signals is not None and loaded.signals.effort_kind == "link_torque"
        terms = [t for t in DEFAULT_TERMS if not (behind and t.on_motors)]
        return Model(loaded.robot, tuple(terms))
    terms = [term_of(t.description, t.where) for t in loaded.terms]
    known = tuple(t for t in terms if not finds_of(t))
    return Model(loaded.robot, (*known, *((Coulomb(), Viscous()) if loaded.friction else ())))
