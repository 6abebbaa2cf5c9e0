"""The section with the verdict, the key figures and the errors of every joint and run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.findings_text import finding_dict
from steelyard.estimate.scores.joint_errors import JointError, PooledError, as_logged, pooled
from steelyard.identify.page.content import ReportContent
from steelyard.identify.page.effort_figures import band_text
from steelyard.identify.page.model_verdict import (
    MOST_FAIR_PERCENT,
    MOST_GOOD_PERCENT,
    level_of,
    verdict,
)
from steelyard.identify.page.parameter_table import parameter_rows, usable
from steelyard.identify.page.score_words import (
    basis_words,
    both_words,
    coverage_words,
    limit_words,
    reference_words,
    relative,
    relative_errors,
    scale_words,
)
from steelyard.report.page import Numbers, Section, fill
from steelyard.report.tables import light_table
from steelyard.report.words import COLOURS, NONE, percent, significant

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from steelyard.estimate.scores.score import RunScore


LEAST_FITTED_OVER_UNSEEN = 1.5
"""Error of fitted over unseen runs from which on it is explained."""

RESIDUAL_WINDOW = 2.0
"""Width of the windows of time [s]."""

LOCATED_SHARE = 0.5
"""Share of the squared residuals that is located."""

MOST_CONCENTRATED_SHARE = 0.25
"""Share of the time up to which that half counts as concentrated."""


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
    starts, squares = _windows(run)
    order = np.argsort(-squares)
    total = np.cumsum(squares[order])
    count = int(np.searchsorted(total, LOCATED_SHARE * total[-1])) + 1
    if count > max(MOST_CONCENTRATED_SHARE * len(starts), 1.0):
        return f"in {run.run} residuals are spread over the whole time"
    times = ", ".join(f"{a:.0f} to {b:.0f} s" for a, b in _merged(np.sort(starts[order[:count]])))
    return (
        f"in {run.run} {percent(100.0 * float(total[count - 1] / total[-1]))} of the squared "
        f"residuals lie in {percent(100.0 * count / len(starts))} of the time: {times}"
    )


def _windows(run: RunScore) -> tuple[Array, Array]:
    """Starts of windows of time, and squared residuals in each, in the unit of the errors."""
    traces = run.traces
    counts = np.ones(traces.moving.shape) if run.errors.at_rest else traces.moving.astype(float)
    squares = counts * (traces.measured - traces.predicted) ** 2
    mean = squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0)
    errors = np.array([joint.error if joint.counted else 0.0 for joint in run.errors.joints])
    weights = np.divide(errors**2, mean, out=np.zeros(len(mean)), where=mean > 0.0)
    number = ((traces.t - traces.t[0]) // RESIDUAL_WINDOW).astype(int)
    total = np.asarray(np.bincount(number, squares @ weights), dtype=np.float64)
    return np.asarray(float(traces.t[0]) + RESIDUAL_WINDOW * np.arange(len(total))), total


def _merged(starts: Array) -> list[tuple[float, float]]:
    """Windows as intervals, neighbours as one."""
    found: list[tuple[float, float]] = []
    for start in starts.tolist():
        if found and start - found[-1][1] < 0.5 * RESIDUAL_WINDOW:
            found[-1] = (found[-1][0], start + RESIDUAL_WINDOW)
        else:
            found.append((start, start + RESIDUAL_WINDOW))
    return found


CAPTION = (
    "moving, all: relative error where the joint moves, and of the whole log; pooled: norms over "
    "all joints together; MAE: mean absolute error; zero, nominal: RMSE of predicting zero, and of "
    "the nominal model, which has no friction. RMSE, MAE, zero and nominal are of the whole log, "
    "in the logged unit"
)


MOST_OTHERS = 8
"""Runs whose errors in the validation band the page lists."""


class VerdictSection(Section):
    """Headline, key figures, and one table of joints per run."""

    name: ClassVar[str] = "verdict"
    title: ClassVar[str] = "Verdict"

    def numbers(self, content: ReportContent) -> Numbers:
        """Verdict, key figures and scores."""
        return {
            "verdict": verdict(content),
            "usable": _usable(content),
            "fitted_larger": fitted_larger(content.fitted, content.scores),
            "facts": _facts(content),
            "runs": [_run(score) for score in content.scores if not score.repeats],
            "repeated": [_run(score) for score in content.scores if score.repeats],
            "fitted": [_run(score) for score in content.fitted],
            "scaled": any(run.errors.as_logged for run in (*content.scores, *content.fitted)),
            "scales": scale_words(
                content.identified, content.scores or content.fitted, content.unscaled
            ),
            "good": MOST_GOOD_PERCENT,
            "fair": MOST_FAIR_PERCENT,
            "most_others": MOST_OTHERS,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("verdict.html", numbers)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Verdict, limitations, scores and notes."""
        return {
            "verdict": verdict(content).to_dict(),
            "validation": [score.to_dict() for score in content.scores],
            "validation_without_scales": [score.to_dict() for score in content.unscaled],
            "identification": [score.to_dict() | {"motion": "fitted"} for score in content.fitted],
            "limitations": [finding_dict(finding) for finding in content.limitations],
            "notes": [*content.notes, *content.details],
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The verdict with its limitations, and the errors of every joint, or of every run."""
        from rich.console import Group
        from rich.text import Text

        judged = verdict(content)
        yield Group(
            Text(judged.line, style=f"bold {COLOURS[judged.level]}"),
            *([Text(judged.detail)] if judged.detail else []),
            *(Text(f"! {one.brief}", style=COLOURS[one.level]) for one in judged.limitations),
        )
        scores = content.scores or content.fitted
        if not scores:
            return
        several = len(scores) > 1
        scales = scale_words(content.identified, scores, content.unscaled)
        shown = (
            _runs_table(scores, bool(content.scores))
            if several
            else joints_table(scores[0], bool(content.scores))
        )
        yield Group(shown, Text(scales)) if scales else shown

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The errors of every joint in every run, in the fixed band and in that of the fit."""
        from rich.console import Group
        from rich.text import Text

        judged, unseen = verdict(content), bool(content.scores)
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
                inside = coverage_words(score.coverage_percent, unseen)
                parts.append(Text(f"95 % bands {band_text(content.identified)}; {inside}"))
            yield Group(*parts)


def _usable(content: ReportContent) -> str:
    """What the parameters are good for, beside the error; empty of a validation alone."""
    if content.identified is None or content.only_errors:
        return ""
    return ". ".join(usable(content.identified))


def _facts(content: ReportContent) -> list[tuple[str, str]]:
    """Values and labels of the key figures."""
    facts = [
        (percent(error.value), f"error {error.kind}, in the validation band")
        for error in relative_errors(content.scores)
    ]
    if content.fitted:
        errors = pooled(score.errors for score in content.fitted)
        facts += [
            (
                percent(error.percent_of_used),
                "error of the fitted runs, of the effort used, in the band of the headline"
                + (f" (joints in {error.unit})" if len(errors) > 1 else ""),
            )
            for error in errors
        ]
    if content.identified is not None:
        table = parameter_rows(content.identified)
        well = sum(row.status in ("identified", "small effect") for row in table)
        condition = significant(content.identified.estimate.condition_normalised, 2)
        left = sum(row.status not in ("removed", "known") for row in table)
        facts.append((f"{well} of {left}", "base parameters identified or of small effect"))
        facts.append((condition, "normalised condition number"))
    return facts


def _run(score: RunScore) -> dict[str, Any]:
    return {
        "run": score.run,
        "repeats": score.repeats,
        "cutoff": score.cutoff,
        "band": score.errors.cutoff,
        "figures": _figures(score),
        "basis": basis_words([score]),
        "raised": reference_words(score.errors.joints),
        "errors": [
            _error(joint)
            | {
                "as_logged": logged,
                "as_logged_level": level_of(logged) if joint.counted else "none",
            }
            for joint, logged in zip(score.errors.joints, _logged_shares(score), strict=True)
        ],
        "joints": score.joints,
    }


def _figures(score: RunScore) -> str:
    """The errors over all joints of a run."""
    errors = pooled([score.errors])
    words = both_words(errors, pooled(as_logged([score.errors]))), limit_words(errors)
    return "; ".join(part for part in words if part)


def _logged_shares(score: RunScore) -> list[float | None]:
    """The errors of the joints against efforts as logged [%]; `None` without estimated scales."""
    if not score.errors.as_logged:
        return [None] * len(score.errors.joints)
    return [joint.percent_of_used for joint in score.errors.as_logged]


def _error(joint: JointError) -> dict[str, Any]:
    """A joint's error in the fixed band; one that rests while others move has no level."""
    share = joint.percent_of_used
    return {
        **vars(joint),
        "share": share,
        "of_limit": joint.percent_of_limit,
        "level": level_of(share) if joint.counted else "none",
        "bar": min(share, 100.0) if share == share else 0.0,
    }


def _runs_table(scores: Sequence[RunScore], unseen: bool) -> RenderableType:
    """One row per run: its error, and its worst joint."""
    from rich.console import Group
    from rich.text import Text

    title = f"{len(scores)} runs, {'not fitted' if unseen else 'fitted'} ({basis_words(scores)})"
    scaled = any(score.errors.as_logged for score in scores)
    logged = ["as logged"] if scaled else []
    table = light_table(
        ("run", "error", "of used", *logged, "of limit", "worst joint"), (0, 4 + len(logged))
    )
    for score in scores:
        unscaled: Sequence[PooledError | None] = pooled(as_logged([score.errors]))
        errors = pooled([score.errors])
        for error, other in zip(errors, unscaled or [None] * len(errors), strict=True):
            name = f"{score.run} (repeats {score.repeats})" if score.repeats else score.run
            _add(table, name, error, _worst(score), logged=other)
    return Group(Text(title), table)


def _worst(score: RunScore) -> str:
    """The joint with the largest error relative to the effort it used."""
    counted = [
        j for j in score.errors.joints if j.counted and j.percent_of_used == j.percent_of_used
    ]
    if not counted:
        return NONE
    worst = max(counted, key=lambda joint: joint.percent_of_used)
    return f"{worst.joint} {percent(worst.percent_of_used)}"


def joints_table(score: RunScore, unseen: bool) -> RenderableType:
    """One row per joint: its error in the fixed band, beside what it used and its effort limit."""
    from rich.console import Group
    from rich.text import Text

    again = f"not fitted, repeats the motion of {score.repeats}" if score.repeats else "not fitted"
    where = "whole log" if score.errors.at_rest else "where each joint moves"
    basis = f"RMS below {score.errors.cutoff:g} Hz, {where}"
    if not all(joint.counted for joint in score.errors.joints):
        basis += "; joints at rest do not count"
    logged = ["as logged"] if score.errors.as_logged else []
    headings = ("joint", "error", "of used", *logged, "of limit", "used", "limit", "")
    table = light_table(headings, (0, 6 + len(logged)))
    others = score.errors.as_logged or [None] * len(score.errors.joints)
    for joint, other in zip(score.errors.joints, others, strict=True):
        effort = significant(joint.used), significant(joint.limit)
        note = "" if joint.counted else "at rest"
        _add(table, joint.joint, joint, *effort, note, logged=other)
    errors = pooled([score.errors])
    unscaled = pooled(as_logged([score.errors])) or [None] * len(errors)
    for error, one in zip(errors, unscaled, strict=True):
        name = f"pooled, {error.unit}" if len(errors) > 1 else "pooled"
        _add(table, name, error, logged=one)
    title = Text(f"{score.run}, {again if unseen else 'fitted'} ({basis})")
    raised = reference_words(score.errors.joints)
    return Group(title, table, Text(f"of used: {raised}")) if raised else Group(title, table)


def _add(
    table: Table,
    name: str,
    error: JointError | PooledError,
    *more: str,
    logged: JointError | PooledError | None = None,
) -> None:
    """A row: error with its unit, relative to what was used, as logged too, and to the limit."""
    from rich.text import Text

    counted = not isinstance(error, JointError) or error.counted
    shares = [one.percent_of_used for one in (error, logged) if one is not None]
    styles = [COLOURS[level_of(share)] if counted else "dim" for share in shares]
    table.add_row(
        Text(name),
        f"{significant(error.error)} {error.unit}",
        *(Text(percent(share), style=style) for share, style in zip(shares, styles, strict=True)),
        percent(error.percent_of_limit),
        *(Text(cell) for cell in more),
    )


def _fit_table(score: RunScore) -> RenderableType:
    """Errors in the validation band, between its title and the meaning of its columns."""
    from rich.console import Group
    from rich.text import Text

    headings = ("joint", "moving", "all", "RMSE", "MAE", "zero", "nominal", "unit")
    table = light_table(headings, (0, 7))
    for joint in score.joints:
        style = COLOURS[level_of(relative(joint))]
        table.add_row(
            Text(joint.joint),
            Text(percent(joint.relative_percent_moving), style=style),
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
