"""Estimators compared: the section, the page of its own, and the terminal."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from steelyard.estimate.scores.estimator_comparison import Comparison
from steelyard.identify.comparison.estimators_page import (
    COMPARE_SECTIONS,
    CompareSection,
    ComparisonContent,
    comparison_lines,
    time_words,
)
from steelyard.report.page import render_sections


def cells(page: str) -> list[list[str]]:
    rows = re.findall(r"<tr[^>]*>(.*?)</tr>", page, re.DOTALL)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]


def section(content: ComparisonContent) -> str:
    return str(CompareSection().show(CompareSection().numbers(content))).replace("\u00a0", " ")


def printed(content: ComparisonContent, width: int = 100, verbose: bool = False) -> str:
    stream = io.StringIO()
    comparison_lines(content, Console(file=stream, width=width, no_color=True), verbose)
    return stream.getvalue().replace("\u00a0", " ")


def test_the_table_has_the_best_first_and_the_failed_last(compared: ComparisonContent) -> None:
    rows = cells(section(compared))
    assert rows[0] == [
        "Estimator",
        "Link inertias",
        "Error",
        "Pooled",
        "Time",
        "Values",
        "Condition",
        "χ²",
    ]
    assert [row[0] for row in rows[1:6]] == ["WLS", "consistent", "plain", "once", "never"]
    wls, consistent, plain, once, never = rows[1:6]
    assert wls[1:] == ["not estimated", "4.17 ± 0.67 %", "5.0 %", "12 ms", "36", "42", "1.000"]
    assert consistent[1] == "all valid" and consistent[4] == "120 ms"
    assert plain[1] == "link 1  and 1 more invalid" and plain[2] == "37.5 ± 6.0 %"
    assert once[2] == "3.50 % (failed 1 of 3)"
    assert never[1:] == ["–", "failed", "–", "–", "–", "42", "1.000"]


def test_the_advice_is_marked_and_explained(compared: ComparisonContent) -> None:
    page = section(compared)
    assert "Recommended: consistent" in page
    assert "within one standard error of the difference, and its inertias are valid" in page
    (marked,) = re.findall(r'<tr class="marked"><th scope="row">(.*?)</th>', page)
    assert marked == "consistent"
    assert "stopped: 5 of 6 estimators compared; not tried: genetic" in page


def test_failures_have_a_reason_and_what_to_do(compared: ComparisonContent) -> None:
    rows = cells(section(compared))
    assert ["once", "without run2", "not convex ", "try again"] in rows
    assert ["never", "every fit", "too few [data] ", "log longer "] in rows


def test_joints_and_runs_have_their_errors(compared: ComparisonContent) -> None:
    rows = cells(section(compared))
    assert ["WLS", "3.3 %", "5.0 %"] in rows
    assert ["run2", "5.5 %", "5.5 %", "49.5 %", "–"] in rows


def test_the_picture_has_every_error_its_mean_and_the_time(compared: ComparisonContent) -> None:
    numbers = CompareSection().numbers(compared)
    figure = json.loads(numbers["picture"])
    dots, means, times = figure["traces"]
    assert dots["x"][:3] == [3.5, 5.5, 3.5] and dots["y"][:3] == ["WLS"] * 3
    assert means["x"][0] == pytest.approx(25.0 / 6.0, rel=1e-5)
    assert means["more"]["error_x"]["array"][0] == pytest.approx(2.0 / 3.0, rel=1e-5)
    assert times["x"] == [0.012, 0.12, 0.012, 0.012] and times["more"]["xaxis"] == "x2"
    assert figure["layout"]["xaxis"]["type"] == "log"
    assert figure["layout"]["xaxis2"]["ticktext"] == ["10 ms", "0.1 s", "1 s"]
    assert figure["layout"]["yaxis"]["categoryarray"][0] == "WLS"


def test_errors_that_are_alike_have_a_linear_axis(compared: ComparisonContent) -> None:
    two = replace(compared.comparison, scores=compared.comparison.scores[:2])
    numbers = CompareSection().numbers(replace(compared, comparison=two))
    assert json.loads(numbers["picture"])["layout"]["xaxis"]["type"] == "linear"


def test_nothing_came_through(compared: ComparisonContent) -> None:
    none = Comparison(
        compared.comparison.scores[-1:], ("a", "b", "c"), "segment", ("shoulder", "elbow")
    )
    content = replace(compared, comparison=none)
    page = section(content)
    assert "No estimator succeeded" in page and 'class="picture"' not in page
    assert "No estimator succeeded" in printed(content)
    assert "all but one segment of the run" in printed(content)


def test_the_terminal_says_the_same(compared: ComparisonContent) -> None:
    text = printed(compared)
    assert "4.17 ± 0.67 %" in text and "all valid" in text
    assert "never failed (every fit): too few [data] ; log longer" in text
    assert "Recommended: consistent\nconsistent: " in text
    assert "stopped: 5 of 6 estimators compared; not tried: genetic" in text
    assert "note: joint 'wrist' is locked at 0.3 rad" in text
    detailed = replace(compared, details=("cut-offs: motion 12 Hz",))
    assert "cut-offs" not in printed(detailed) and "cut-offs" in printed(detailed, verbose=True)
    assert all(len(line) <= 80 for line in printed(compared, 80).splitlines())


def test_columns_of_the_terminal_are_explained(compared: ComparisonContent) -> None:
    text = " ".join(printed(compared, verbose=True).split())
    assert "χ²: squared residuals over the noise variance by WLS" in text
    assert "Condition" not in text
    apart = tuple(
        replace(one, condition=10.0**k) for k, one in enumerate(compared.comparison.scores)
    )
    text = printed(
        replace(compared, comparison=replace(compared.comparison, scores=apart)), verbose=True
    )
    assert "Condition" in text and "number of the whitened regressor" in text


def test_the_terminal_shows_ten_estimators_and_names_the_others(
    compared: ComparisonContent,
) -> None:
    first = compared.comparison.scores[0]
    twelve = tuple(replace(first, name=f"number {k}") for k in range(12))
    many = replace(compared, comparison=replace(compared.comparison, scores=twelve))
    assert "and 2 more: number 10, number 11 (-v)" in printed(many)
    rows = [line for line in printed(many).splitlines() if "not estimated" in line]
    assert len(rows) == 10 and "more: " not in printed(many, verbose=True)


def test_a_joint_that_does_not_move_has_a_dash(compared: ComparisonContent) -> None:
    wls = compared.comparison.scores[0]
    errors = wls.errors.copy()
    errors[:, 1], errors[1] = np.nan, np.nan
    still = replace(compared.comparison, scores=(replace(wls, errors=errors),))
    rows = cells(section(replace(compared, comparison=still)))
    assert ["WLS", "2.5 %", "–"] in rows and ["run2", "–"] in rows
    assert not any("failed" in cell for row in rows for cell in row)


def test_the_robot_files_line_stands_with_the_advice(compared: ComparisonContent) -> None:
    line = '[estimation] method = "consistent"'
    content = replace(compared, comparison=replace(compared.comparison, current="WLS"))
    assert f"in the robot file: {line}" in printed(content)
    assert "In the robot file: [estimation] method =" in section(content)
    assert "robot file" not in printed(compared)


def test_nothing_beats_predicting_zero(compared: ComparisonContent) -> None:
    bad = tuple(replace(t, errors=t.errors + 100.0) for t in compared.comparison.scores)
    content = replace(compared, comparison=replace(compared.comparison, scores=bad))
    assert "No estimator is recommended" in printed(content)
    page = section(content)
    assert "nothing is better than predicting zero" in page and 'class="marked"' not in page
    assert 'class="verdict none"' in page


@pytest.mark.slow
@pytest.mark.parametrize("which", ["compared", "strange"])
def test_the_browser_draws_the_page_without_an_error(which, request, browse) -> None:
    page = render_sections(COMPARE_SECTIONS, request.getfixturevalue(which), "compared")
    seen = browse(page)
    assert seen.console == () and seen.errors == []
    assert 'id="compare"' in seen.dom and 'id="settings"' in seen.dom
    drawn = seen.dom.split('class="picture js-plotly-plot"')
    assert len(drawn) == 2 and "scatterlayer" in drawn[1]
    if which == "compared":
        assert drawn[1].count('class="errorbar"') >= 3 and "time of one fit" in drawn[1]


def test_times_in_words() -> None:
    words = [time_words(x).replace("\u00a0", " ") for x in (None, 0.0123, 0.9, 61.2)]
    assert words == ["–", "12 ms", "900 ms", "61.2 s"]
