"""The section with the verdict, the key figures and the errors of every joint and run."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from math import isnan
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from steelyard.base.arrays import stretches
from steelyard.check.findings_text_and_page import finding_dict
from steelyard.estimate.scores.effort_errors import EffortError, as_logged, pooled
from steelyard.estimate.scores.score import RunScore
from steelyard.identify import verdict_and_next_steps as judging
from steelyard.identify.page import report_content_and_error_words as in_words
from steelyard.identify.page.efforts_their_parts_and_residuals import band_text
from steelyard.identify.page.parameters_and_truth import parameter_rows, usable
from steelyard.report.page import Numbers, Section
from steelyard.report.tables import light_table
from steelyard.report.words import COLOURS, NONE, percent, significant

LEAST_FITTED_OVER_UNSEEN = 1.5  # error of fitted over unseen runs from which on it is explained
RESIDUAL_WINDOW = 2.0  # width of the windows of time [s]
LOCATED_SHARE = 0.5  # share of the squared residuals that is located
MOST_CONCENTRATED_SHARE = 0.25  # share of the time up to which that half counts as concentrated


def fitted_larger(fitted: Sequence[RunScore], unseen: Sequence[RunScore]) -> str:
    """Why the error of fitted runs may be clearly above that of unseen ones; else nothing."""
    fresh = [run for run in unseen if not run.repeats]
    own, other = (pooled(run.errors for run in runs) for runs in (fitted, fresh))
    if len(own) != 1 or len(other) != 1:
        return ""
    error, reference = own[0].percent_of_used, other[0].percent_of_used
    if not error > LEAST_FITTED_OVER_UNSEEN * reference:
        return ""
    worst = max(fitted, key=lambda run: pooled([run.errors])[0].percent_of_used)
    return (
        f"The error on the fitted runs ({percent(error)}) is larger than on unseen motion "
        f"({percent(reference)}): {_where(worst)}"
    )


def _where(run: RunScore) -> str:
    """The times that hold half of a run's squared residuals, if these are few."""
    traces = run.traces
    counts = np.ones(traces.moving.shape) if run.errors.at_rest else traces.moving.astype(float)
    squares = counts * (traces.measured - traces.predicted) ** 2
    mean = squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0)
    errors = np.array([joint.error if joint.counted else 0.0 for joint in run.errors.joints])
    weights = np.divide(errors**2, mean, out=np.zeros(len(mean)), where=mean > 0.0)
    number = ((traces.t - traces.t[0]) // RESIDUAL_WINDOW).astype(int)
    windows = np.bincount(number, squares @ weights)
    order = np.argsort(-windows)
    total = np.cumsum(windows[order])
    count = int(np.searchsorted(total, LOCATED_SHARE * total[-1])) + 1
    if count > max(MOST_CONCENTRATED_SHARE * len(windows), 1.0):
        return f"in {run.run} residuals are spread over the whole time"
    ends = float(traces.t[0]) + RESIDUAL_WINDOW * np.arange(len(windows) + 1)
    chosen = stretches(np.isin(np.arange(len(windows)), order[:count]))
    times = ", ".join(f"{ends[a]:.0f} to {ends[b]:.0f} s" for a, b in chosen)
    return (
        f"in {run.run} {percent(100.0 * float(total[count - 1] / total[-1]))} of the squared "
        f"residuals lie in {percent(100.0 * count / len(windows))} of the time: {times}"
    )


CAPTION = (
    "moving, all: relative error where the joint moves, and of the whole log; pooled: norms over "
    "all joints together; MAE: mean absolute error; zero, nominal: RMSE of predicting zero, and of "
    "the nominal model, which has no friction. RMSE, MAE, zero and nominal are of the whole log, "
    "in the logged unit"
)

MOST_OTHERS = 8  # runs whose errors in the validation band the page lists


class VerdictSection(Section, name="verdict", title="Verdict", template="verdict.html"):
    """Headline, key figures, and one table of joints per run."""

    def numbers(self, content: in_words.ReportContent) -> Numbers:
        """Verdict, key figures and scores."""
        facts = [
            (percent(error.value), f"error {error.kind}, in the validation band")
            for error in in_words.relative_errors(content.scores)
        ]
        if content.fitted:
            errors = pooled(score.errors for score in content.fitted)
            what = "error of the fitted runs, of the effort used, in the band of the headline"
            units = [f" (joints in {one.unit})" * (len(errors) > 1) for one in errors]
            each = zip(errors, units, strict=True)
            facts += [(percent(one.percent_of_used), f"{what}{unit}") for one, unit in each]
        table = parameter_rows(content.identified)
        well = sum(row.status in ("identified", "small effect") for row in table)
        condition = significant(content.identified.estimate.condition_normalised, 2)
        left = sum(row.status not in ("removed", "known") for row in table)
        facts.append((f"{well} of {left}", "base parameters identified or of small effect"))
        return {
            "verdict": judging.verdict(content),
            "usable": "" if content.only_errors else ". ".join(usable(content.identified)),
            "fitted_larger": fitted_larger(content.fitted, content.scores),
            "facts": [*facts, (condition, "normalised condition number")],
            "runs": [_run(score) for score in content.scores if not score.repeats],
            "repeated": [_run(score) for score in content.scores if score.repeats],
            "fitted": [_run(score) for score in content.fitted],
            "scaled": any(run.errors.as_logged for run in (*content.scores, *content.fitted)),
            "scales": in_words.scale_words(
                content.identified, content.scores or content.fitted, content.unscaled
            ),
            "good": judging.MOST_GOOD_PERCENT,
            "fair": judging.MOST_FAIR_PERCENT,
            "most_others": MOST_OTHERS,
        }

    def to_dict(self, content: in_words.ReportContent) -> dict[str, Any]:
        """Verdict, limitations, scores and notes."""
        return {
            "verdict": judging.verdict(content).to_dict(),
            "validation": [score.to_dict() for score in content.scores],
            "validation_without_scales": [score.to_dict() for score in content.unscaled],
            "identification": [score.to_dict() | {"motion": "fitted"} for score in content.fitted],
            "limitations": [finding_dict(finding) for finding in content.limitations],
            "notes": [*content.notes, *content.details],
        }

    def printed(self, content: in_words.ReportContent) -> Iterable[RenderableType]:
        """The verdict with its limitations, and the errors of every joint, or of every run."""
        judged = judging.verdict(content)
        yield Group(
            Text(judged.line, style=f"bold {COLOURS[judged.level]}"),
            *([Text(judged.detail)] if judged.detail else []),
            *(Text(f"! {one.brief}", style=COLOURS[one.level]) for one in judged.limitations),
        )
        scores = content.scores or content.fitted
        if not scores:
            return
        scales = in_words.scale_words(content.identified, scores, content.unscaled)
        several, unseen = len(scores) > 1, bool(content.scores)
        shown = _runs_table(scores, unseen) if several else joints_table(scores[0], unseen)
        yield Group(shown, Text(scales)) if scales else shown

    def detailed(self, content: in_words.ReportContent) -> Iterable[RenderableType]:
        """The errors of every joint in every run, in the fixed band and in that of the fit."""
        judged, unseen = judging.verdict(content), bool(content.scores)
        for one in judged.limitations:
            if one.brief != one.text:
                yield Text(f"! {one.text}", style=COLOURS[one.level])
        if judged.others:
            yield Text(judged.others)
        if larger := fitted_larger(content.fitted, content.scores):
            yield Text(larger)
        scores = content.scores or content.fitted
        for score in scores:
            if len(scores) > 1:
                yield joints_table(score, unseen)
            parts: list[RenderableType] = [_fit_table(score)]
            if score.coverage_percent is not None:
                inside = in_words.coverage_words(score.coverage_percent, unseen)
                parts.append(Text(f"95 % bands {band_text(content.identified)}; {inside}"))
            yield Group(*parts)


def _run(score: RunScore) -> dict[str, Any]:
    """A run as its template shows it; a joint that rests while others move has no level."""
    errors, joints = pooled([score.errors]), score.errors.joints
    figures = (
        in_words.both_words(errors, pooled(as_logged([score.errors]))),
        in_words.limit_words(errors),
    )
    shown = []
    for joint, logged in score.errors.pairs:
        share, other = joint.percent_of_used, None if logged is None else logged.percent_of_used
        shown.append(
            {
                **vars(joint),
                "aside": joint.aside,
                "share": share,
                "of_limit": joint.percent_of_limit,
                "over": f"{significant(joint.seconds)} s",
                "level": judging.level_of(share) if joint.counted else "none",
                "bar": min(share, 100.0) if share == share else 0.0,
                "as_logged": other,
                "as_logged_level": judging.level_of(other) if joint.counted else "none",
            }
        )
    return {
        "run": score.run,
        "repeats": score.repeats,
        "cutoff": score.cutoff,
        "band": score.errors.cutoff,
        "figures": "; ".join(filter(None, figures)),
        "basis": in_words.basis_words([score]),
        "raised": in_words.reference_words(joints),
        "errors": shown,
        "joints": score.joints,
    }


def _runs_table(scores: Sequence[RunScore], unseen: bool) -> RenderableType:
    kind, basis = "not fitted" if unseen else "fitted", in_words.basis_words(scores)
    title = f"{len(scores)} runs, {kind} ({basis})"
    logged = ["as logged"] if any(score.errors.as_logged for score in scores) else []
    table = light_table(
        ("run", "error", "of used", *logged, "of limit", "worst joint"), (0, 4 + len(logged))
    )
    for score in scores:
        counted = [x for x in score.errors.joints if x.counted and not isnan(x.percent_of_used)]
        worst = max(counted, key=lambda joint: joint.percent_of_used, default=None)
        last = NONE if worst is None else f"{worst.joint} {percent(worst.percent_of_used)}"
        for error, other in _pooled_pairs(score):
            name = f"{score.run} (repeats {score.repeats})" if score.repeats else score.run
            _add(table, name, error, last, logged=other)
    return Group(Text(title), table)


def joints_table(score: RunScore, unseen: bool) -> RenderableType:
    """One row per joint: its error in the fixed band, what it used, its limit, its time."""
    again = f"not fitted, repeats the motion of {score.repeats}" if score.repeats else "not fitted"
    where = "whole log" if score.errors.at_rest else "where each joint moves"
    basis = f"RMS below {score.errors.cutoff:g} Hz, {where}"
    apart = dict.fromkeys(joint.aside for joint in score.errors.joints if joint.aside)
    if apart:
        named = {"at rest": "at rest", "no motor": "without a motor"}
        basis += f"; joints {' or '.join(named[why] for why in apart)} do not count"
    logged = ["as logged"] if score.errors.as_logged else []
    headings = ("joint", "error", "of used", *logged, "of limit", "used", "limit", "over", "")
    table = light_table(headings, (0, 7 + len(logged)))
    for joint, other in score.errors.pairs:
        more = significant(joint.used), significant(joint.limit), f"{significant(joint.seconds)} s"
        _add(table, joint.joint, joint, *more, joint.aside, logged=other)
    every = _pooled_pairs(score)
    for error, one in every:
        _add(table, f"pooled, {error.unit}" if len(every) > 1 else "pooled", error, logged=one)
    title = Text(f"{score.run}, {again if unseen else 'fitted'} ({basis})")
    raised = in_words.reference_words(score.errors.joints)
    return Group(title, table, Text(f"of used: {raised}")) if raised else Group(title, table)


def _pooled_pairs(score: RunScore) -> list[tuple[EffortError, EffortError | None]]:
    """Errors of all joints, and those as logged; `None` without estimated scales."""
    return list(zip_longest(pooled([score.errors]), pooled(as_logged([score.errors]))))


def _add(
    table: Table, name: str, error: EffortError, *more: str, logged: EffortError | None = None
) -> None:
    """A row: error with its unit, relative to what was used, as logged too, and to the limit."""
    shares = [one.percent_of_used for one in (error, logged) if one is not None]
    styles = [COLOURS[judging.level_of(share)] if error.counted else "dim" for share in shares]
    table.add_row(
        Text(name),
        f"{significant(error.error)} {error.unit}",
        *(Text(percent(share), style=style) for share, style in zip(shares, styles, strict=True)),
        percent(error.percent_of_limit),
        *(Text(cell) for cell in more),
    )


def _fit_table(score: RunScore) -> RenderableType:
    headings = ("joint", "moving", "all", "RMSE", "MAE", "zero", "nominal", "unit")
    table = light_table(headings, (0, 7))
    for joint in score.joints:
        table.add_row(
            Text(joint.joint),
            Text(
                percent(joint.relative_percent_moving),
                style=COLOURS[judging.level_of(in_words.relative(joint))],
            ),
            percent(joint.relative_percent),
            significant(joint.rmse),
            significant(joint.mae),
            significant(joint.predict_zero),
            significant(joint.prior_rmse),
            Text(joint.unit),
        )
    table.add_section()
    if score.pooled_percent is not None:
        pooled = percent(score.pooled_percent_moving), percent(score.pooled_percent)
        table.add_row("pooled", *pooled)
    table.add_row("mean", percent(score.mean_percent_moving), percent(score.mean_percent))
    title = f"{score.run}, in the validation band, below {score.cutoff:g} Hz"
    return Group(Text(title), table, Text(CAPTION, style="dim"))
