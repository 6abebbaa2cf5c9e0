"""The clean runs of logs, and the model that is customary for them."""

from collections.abc import Callable
from dataclasses import replace

from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, CheckedLog
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.register import DEFAULT_TERMS, term_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.runs.prepare import prepare
from steelyard.runs.run import Run


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
