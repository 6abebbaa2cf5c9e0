import csv
import io
from dataclasses import replace

from rich.console import Console

from steelyard.report import ReportContent, parameters_csv, summary
from steelyard.report.terminal.terminal import CSV_COLUMNS
from steelyard.report.text.score_words import coverage_words
from steelyard.report.text.verdict import verdict


def printed(content: ReportContent, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width)
    summary(content, console)
    return console.file.getvalue()


def test_the_summary_says_what_matters(usual):
    text = printed(usual)
    assert text.startswith("GOOD: Predicts") and verdict(usual).to_dict()["level"] == "good"
    assert "Predicts unseen motion with an error of 6.5\u00a0% of the measured effort" in text
    assert "points (not fitted, below 8 Hz)" in text and "run1" not in text
    line = next(line for line in text.splitlines() if "elbow" in line)
    assert [c.strip() for c in line.split("│")[1:-1]] == [
        "elbow",
        "10.0\u00a0%",
        "12.5\u00a0%",
        "0.200",
        "3.00",
        "2.00",
        "A",
    ]
    assert "13 base parameters, normalised condition number 41.5" in text
    assert "2 poorly identifiable: mz.link of shoulder, Iyy.link of shoulder" in text
    assert "1 not identifiable from these data: offset.elbow" in text
    assert "note: velocity: from positions" in text


def test_unseen_runs_alone_make_the_headline_where_others_repeat_a_motion(usual):
    again = replace(usual.scores[0], run="again", repeats="run1")
    both = printed(replace(usual, scores=(*usual.scores, again)))
    assert "Predicts unseen motion with an error of 6.5" in both
    assert "again (not fitted, repeats the motion of run1, below 8 Hz)" in both
    alone = replace(usual, scores=(again,))
    assert printed(alone).startswith("Predicts repeated motion with an error of")
    assert verdict(alone).level == "none" and verdict(usual).level == "good"


def test_names_are_no_markup_and_numbers_may_be_none(nasty):
    text = printed(nasty, 400)
    assert "Not validated on unseen motion" in text and "(fitted, below 8 Hz)" in text
    assert "<script>" in text
    bracket = ReportContent("t", "r", notes=("[bold]not bold[/bold]",))
    assert "note: [bold]not bold[/bold]" in printed(bracket)


def test_the_csv_holds_every_base_parameter_exactly(usual):
    table = list(csv.DictReader(io.StringIO(parameters_csv(usual.identified))))
    estimate = usual.identified.estimate
    assert tuple(table[0]) == CSV_COLUMNS
    assert len(table) == len(usual.identified.base)
    seen = [row for row in table if row["value"]]
    assert [float(row["value"]) for row in seen] == estimate.parameters.values.tolist()
    assert [float(row["std"]) for row in seen] == estimate.std.tolist()
    assert table[0]["group"] == "mx.link of shoulder + 0.4 m.link of elbow"
    assert table[0]["unit"] == "kg m" and table[0]["status"] == "identified"
    last = table[-1]
    assert last["status"] == "not identifiable (tied to mx.link of shoulder)"
    assert [last[c] for c in ("value", "std", "lower95", "upper95", "relative_std_percent")] == (
        [""] * 5
    )


def test_the_csv_of_broken_numbers_has_empty_cells(nasty):
    table = list(csv.DictReader(io.StringIO(parameters_csv(nasty.identified))))
    assert table[0]["std"] == "" and table[0]["value"] != ""
    assert "nan" not in parameters_csv(nasty.identified).lower()
    assert "inf" not in parameters_csv(nasty.identified).lower()


def test_bands_that_hold_less_than_they_promise_are_named():
    assert coverage_words(85.0, True) == "85.0\u00a0% of this log inside: less than stated"
    assert "less" not in coverage_words(92.0, True) + coverage_words(85.0, False)
