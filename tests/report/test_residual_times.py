"""Fitted runs that fit worse than unseen ones: the times that dominate are named."""

from dataclasses import replace

import numpy as np

from report.conftest import run_score
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.page.verdict_and_joint_errors import fitted_larger
from steelyard.identify.scores_and_model_report import render


def with_residuals(ends: float) -> RunScore:
    """A run of 40 s with a larger residual in its first and last 2 s."""
    score = run_score("start", error=0.1)
    traces = score.traces
    outside = (traces.t < 2.0) | (traces.t >= 38.0)
    residual = np.where(outside, ends, 0.1)[:, None] * np.ones(2)
    moving = np.ones(traces.moving.shape, dtype=bool)
    traces = replace(traces, predicted=traces.measured - residual, moving=moving)
    return replace(score, traces=traces)


def test_the_start_and_the_end_are_named():
    said = fitted_larger([with_residuals(2.0)], [run_score("other", error=0.05)])
    assert said.startswith("The error on the fitted runs (10.0\u00a0%) is larger than on unseen ")
    assert said.endswith("squared residuals lie in 10.0\u00a0% of the time: 0 to 2 s, 38 to 40 s")
    assert "in start 97.8\u00a0%" in said


def test_an_even_residual_is_said_to_be_spread():
    said = fitted_larger([with_residuals(0.1)], [run_score("other", error=0.05)])
    assert said.endswith("in start residuals are spread over the whole time")


def test_nothing_is_said_of_errors_alike_or_without_unseen_runs():
    assert fitted_larger([with_residuals(2.0)], [run_score("other", error=0.08)]) == ""
    assert fitted_larger([with_residuals(2.0)], []) == ""


def test_the_page_says_it_below_the_verdict(usual):
    content = replace(
        usual, fitted=(with_residuals(2.0),), scores=(run_score("other", error=0.05),)
    )
    assert "38 to 40 s" in render(content)
    assert "larger than on unseen motion" not in render(usual)
